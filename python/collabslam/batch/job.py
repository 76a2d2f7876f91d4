"""One run of a batch: where its results lie, whether they still hold, and the work itself."""

from __future__ import annotations

import contextlib
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.batch.fingerprint import files_hash
from collabslam.batch.plan import Entry
from collabslam.batch.processes import use_one_thread
from collabslam.errors import CollabslamError
from collabslam.runs import runner
from collabslam.runs.checkpoint import Checkpoint
from collabslam.runs.plan import Output
from collabslam.runs.results import SUMMARY
from collabslam.runs.run_folder import read_summary
from collabslam.runs.summary import Summary
from collabslam.settings.table import Settings
from collabslam.version import version

NOTE = "batch"
"""Where a summary's options say what it was made from."""


@dataclass(frozen=True)
class Job:
    """An entry in one mode.

    Attributes
    ----------
    entry : Entry
    mode : str or None
    out : Path
        Folder of the whole batch.
    checkpoint_every : str
        As of `collabslam.Output`.
    """

    entry: Entry
    mode: str | None
    out: Path
    checkpoint_every: str = "60s"

    @property
    def title(self) -> str:
        """Name for messages."""
        return self.entry.name if self.mode is None else f"{self.entry.name} {self.mode}"

    @property
    def folder(self) -> Path:
        """Its result folder."""
        return self.out / self.title.replace(" ", "-")

    def fingerprint(self) -> str:
        """Changes when anything does that the result depends on: options, settings, version, recording."""
        entry, state = self.entry, self.entry.source.state()
        paths = [state["path"], *(v for v in state["given"].values() if isinstance(v, str))]
        facts = [
            state,
            self.mode,
            entry.start,
            sorted((k, str(v)) for k, v in entry.settings.items()),
            version(),
            [files_hash(Path(p)) for p in paths if Path(p).exists()],
        ]
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]

    def done(self) -> Summary | None:
        """The summary of an earlier run that still holds, or None."""
        with contextlib.suppress(CollabslamError):
            summary = read_summary(self.folder / SUMMARY)
            whole = not summary.get("interrupted", True)
            if whole and summary.get("options", {}).get(NOTE) == self.fingerprint():
                return summary
        return None


def run_job(job: Job) -> Summary:
    """The work: goes on from a checkpoint of the same job, or begins; raises as `collabslam.run` does."""
    use_one_thread()
    fingerprint = job.fingerprint()
    with contextlib.suppress(CollabslamError):  # no checkpoint, or one that cannot be used: it begins
        if Checkpoint.read(job.folder).plan["notes"].get(NOTE) == fingerprint:
            return runner.resume(job.folder).summary
    entry = job.entry
    output = Output(
        job.folder,
        overwrite=True,
        latest=False,
        checkpoint_every=job.checkpoint_every,
        reopen=entry.source,
        notes={NOTE: fingerprint},
    )
    recording = entry.source.open()
    settings = Settings.default().replace(entry.settings)
    return runner.run(recording, mode=job.mode, start=entry.start, settings=settings, out=output).summary


def jobs_of(entries: tuple[Entry, ...], out: Path) -> list[Job]:
    """A job for each entry and mode."""
    return [Job(entry, mode, out) for entry in entries for mode in entry.modes]


def row_of(job: Job, answer: Summary | Exception, why: str = "") -> dict[str, Any]:
    """A row of the table: what names the job, what became of it, and the numbers that a reader asks first."""
    named = {"recording": job.entry.name, "mode": job.mode or ""}
    if isinstance(answer, Exception):
        return {**named, "status": "failed", "why": why}
    return {
        **named,
        "mode": answer.get("mode", ""),
        "status": "done",
        "why": "",
        **{name: answer.get(name) for name in NUMBERS},
    }


NUMBERS = (
    "frames",
    "coverage",
    "status_final",
    "ok_share",
    "metric",
    "path_length_m",
    "ate_pct_all_frames",
    "nees_position",
    "nees_attitude",
    "map_size_final",
    "fps",
    "ms_p99",
)
"""Columns of the table that are the summary's."""
