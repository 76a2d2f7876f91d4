"""One run of an evaluation, where its result lies, and whether that still holds."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.batch.fingerprint import files_hash
from collabslam.batch.isolated import why
from collabslam.runs.plan import MODE_KEY
from collabslam.runs.results import SUMMARY
from collabslam.settings.table import Settings
from collabslam.version import version
from collabslam_lab.benchmark.plan import Entry
from collabslam_lab.program import code_hash
from collabslam_lab.switches import with_switches

Row = dict[str, Any]

KEY = "evaluated_as"
"""Where a summary's options say what it was made from."""


@dataclass(frozen=True)
class Item:
    """One run.

    Attributes
    ----------
    entry : Entry
    mode : str
    seed : int
    data : Path
        Folder of the recordings.
    out : Path
        Of the whole evaluation.
    independent : bool
        An error of ``T_CF`` of its own in each frame, in place of one for each block of overlap.
    lever : str
        Of the ablation; empty for the plain runs, which get a whole result folder.
    changes : tuple of (key, value)
        Changes of the settings, over those of the entry.
    """

    entry: Entry
    mode: str
    seed: int
    data: Path
    out: Path
    independent: bool = False
    lever: str = ""
    changes: tuple[tuple[str, Any], ...] = ()

    @property
    def settings(self) -> Settings:
        """All settings of the run."""
        changes = {**self.entry.settings, **dict(self.changes), MODE_KEY: self.used_mode}
        return with_switches(Settings.default(), changes)

    @property
    def used_mode(self) -> str:
        """The mode it is run in; a lever may be a change of it."""
        return str(dict(self.changes).get(MODE_KEY, self.mode))

    @property
    def bias_per_block(self) -> bool:
        """Whether one error of ``T_CF`` is drawn for each block of overlap."""
        return self.entry.noisy and not self.independent

    @property
    def title(self) -> str:
        """Name for messages."""
        parts = [
            self.entry.name,
            self.mode,
            f"seed {self.seed}",
            "independent" if self.independent else "",
            self.lever,
        ]
        return " ".join(part for part in parts if part)

    @property
    def folder(self) -> Path | None:
        """Result folder; None for a lever's run, of which only the summary is kept."""
        if self.lever:
            return None
        independent = "-independent" if self.independent else ""
        return self.out / "runs" / f"{slug(self.entry.name)}-{self.mode}{independent}-seed{self.seed}"

    @property
    def summary(self) -> Path:
        """File of the summary."""
        if self.folder is not None:
            return self.folder / SUMMARY
        name = f"{slug(self.entry.name)}-{self.mode}-seed{self.seed}.json"
        return self.out / "ablation" / slug(self.lever) / name

    @property
    def row(self) -> Row:
        """What names the run in ``evaluate.json``."""
        row: Row = {"recording": self.entry.name, "mode": self.mode, "seed": self.seed}
        row |= {"bias_per_block": self.bias_per_block, "independent": self.independent}
        return {**row, "lever": self.lever} if self.lever else row

    def fingerprint(self) -> str:
        """Changes when anything does that the result depends on: options, settings, code, recording."""
        entry = self.entry
        facts = {
            "worn": [entry.worn, entry.available, entry.period, entry.noise, self.bias_per_block],
            "poses": [entry.truth, entry.view_poses],
            "calibration": entry.calibration_sd,
            "draws": entry.draws,
            "scored": entry.scored,
            "run": [entry.start, self.used_mode, self.seed if entry.seeded else 0, entry.rendered],
            "settings": self.settings.hash(),
            "version": [version(), code_hash()],
            "recording": [files_hash(folder) for folder in self._folders()],
        }
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]

    def _folders(self) -> list[Path]:
        """What is read for the run."""
        if self.entry.rendered:
            return []
        kind, _, views = (self.entry.worn or "").partition(":")
        folder = self.data / self.entry.folder
        return [folder, *([folder / views] if kind == "views" else [])]

    def done(self) -> Row | None:
        """The row of an earlier run that still holds, or None."""
        try:
            summary = json.loads(self.summary.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        if not isinstance(summary, dict) or summary.get("interrupted"):
            return None
        if summary.get("options", {}).get(KEY) != self.fingerprint():
            return None
        return self.finished(summary)

    def finished(self, summary: Mapping[str, Any]) -> Row:
        """The row of a summary."""
        return {**summary, **self.row, "status": "done"}

    def failed(self, error: str) -> Row:
        """The row of a run that could not be finished."""
        return {**self.row, "status": "failed", "error": error}

    def row_of(self, answer: Row | Exception) -> Row:
        """The row of what `isolated` answered."""
        return self.failed(why(answer)) if isinstance(answer, Exception) else answer


def slug(name: str) -> str:
    """A name that is a file's; what had to be changed is told apart by a hash."""
    plain = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-.")
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"
