"""One recording, every mode: what a process does in one go, and what is kept of it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.batch.engines import LOCAL, Engine
from collabslam.batch.processes import use_one_thread
from collabslam.errors import CollabslamError
from collabslam.runs.runner import RunResult, run
from collabslam.settings.table import Settings
from collabslam.simulation.held import HeldRecording
from collabslam.types import Recording
from collabslam_lab.kept import Task, kept
from collabslam_lab.paper_worlds.poses import sensed
from collabslam_lab.paper_worlds.variants import Variant, varied
from collabslam_lab.worlds import LIFE, WorldRecording, world_recording

Row = dict[str, Any]

SENSORS, UNCALIBRATED, DIRECT = "sensors", "sensors-uncalibrated", "direct"
"""Where the worn camera's pose comes from: laser and AHRS with a person who first walked towards a board, the
same with a person of whom no more than the height is known, or measured directly with Table C1's errors."""
MODES = ("mono", "mono-undelayed", "collab-init", "collab", "collab-tight")


@dataclass(frozen=True)
class Case:
    """What to run on one recording.

    Attributes
    ----------
    name : str
        Of the recipe.
    runs : tuple of (str, str)
        Modes, and where each has the poses from: `SENSORS`, `DIRECT` or `UNCALIBRATED`.
    variants : tuple of Variant
        Changes to the worn camera, each run on its own (for the study); the recording as it is if empty.
    seed : int
        Of all noise.
    plain : bool
        Whether the recipe is taken as it is, and not under the conditions of life.
    """

    name: str
    runs: tuple[tuple[str, str], ...] = ()
    variants: tuple[Variant, ...] = ()
    seed: int = 0
    plain: bool = False

    @property
    def world(self) -> str:
        """Name of the world."""
        return self.name if self.plain else self.name + LIFE

    @property
    def stem(self) -> str:
        """Begins the name of its file."""
        return f"{self.world}-{self.seed}"


@dataclass(frozen=True)
class CaseResult:
    """Attributes
    ----------
    case : Case
    rows : list of dict
        One for each mode, pose source and variant.
    tracks : dict
        Positions x, y (N, 2), metres: ``"truth"``, and ``"MODE/POSES"`` in the truth's frame.
    """

    case: Case
    rows: list[Row]
    tracks: dict[str, list[list[float]]]

    def row(self, mode: str, poses: str) -> Row:
        """The row of a mode and a source of poses."""
        return next(r for r in self.rows if r["mode"] == mode and r["poses"] == poses)


def gather(
    cases: Iterable[Case], folder: Path, *, jobs: int, progress: bool, engine: Engine = LOCAL
) -> dict[Case, CaseResult]:
    """Results of the cases; those that `folder` already holds are not run again."""
    wanted = list(dict.fromkeys(cases))
    task = Task(run_case, _parsed, _told, "experiments", "recording")
    results = kept(task, wanted, folder, jobs=jobs, engine=engine, progress=progress)
    return dict(zip(wanted, results, strict=True))


def run_case(case: Case) -> str:
    """Render a recording once and run all that is asked for; also the work of a child process."""
    use_one_thread()
    seed = case.seed
    world = world_recording(case.world, seed, keep=True)
    held = HeldRecording(world)
    rows: list[Row] = []
    tracks = {"truth": _rounded(world.truth[:, :2, 3])}
    if case.variants:
        known: dict[Any, Row] = {}
        for variant in case.variants:
            run_of = variant.mode, variant.values
            if run_of not in known:
                recording = varied(world, held, variant, seed)
                known[run_of], _ = _scored(case, world, recording, variant.mode, DIRECT, {})
            rows.append({**known[run_of], "factor": variant.factor, "value": variant.value})
        return json.dumps({"rows": rows, "tracks": tracks})
    for poses in dict.fromkeys(poses for _, poses in case.runs):
        calibrated = poses == SENSORS
        recording, changes = (
            (held, {}) if poses == DIRECT else sensed(world, held, seed, calibrated=calibrated)
        )
        for mode in [mode for mode, source in case.runs if source == poses]:
            row, positions = _scored(case, world, recording, mode, poses, changes)
            rows.append(row)
            tracks[f"{mode}/{poses}"] = positions
    return json.dumps({"rows": _shared_overlap(rows), "tracks": tracks})


def _scored(
    case: Case,
    world: WorldRecording,
    recording: Recording,
    mode: str,
    poses: str,
    changes: dict[str, Any],
) -> tuple[Row, list[list[float]]]:
    """One run: its row, and its positions in the truth's frame."""
    row: Row = {"sequence": case.name, "seed": case.seed, "mode": mode, "poses": poses}
    try:
        result = run(recording, mode=mode, start="worn", settings=Settings.default().replace(changes))
    except CollabslamError as error:
        return {**row, "error": str(error)}, []
    row.update(_numbers(result, mode))
    start = 0 if result.truth is None else result.truth.start
    first = world.truth[start] @ np.linalg.inv(result.record.poses[start])
    positions = result.record.poses[:, :3, 3] @ first[:3, :3].T + first[:3, 3]
    return row, _rounded(positions[:, :2])


def _numbers(result: RunResult, mode: str) -> Row:
    s, record = result.summary, result.record
    total, cf = record.diagnostic("ms_total"), record.diagnostic("ms_cf")
    overlap = np.nan_to_num(record.diagnostic("overlap")) > 0.0
    heading = s["heading_error_final_deg"]
    return {
        "path_length_m": s["path_length_m"],
        "avg_position_error_m": s["avg_position_error_all_m"],
        "sum_position_error_m": s["sum_position_error_m"],
        "final_position_error_m": s["final_position_error_m"],
        "final_error_pct": s["final_error_pct"],
        "heading_error_deg": None if heading is None else abs(heading),
        "overlap_ratio": s["overlap_ratio"],
        "matched_ratio": float(np.mean(np.nan_to_num(record.diagnostic("cf_matches")) > 0.0)),
        "tau": s["overlap_tau_s"],
        "kappa": s["overlap_kappa_s2"],
        "U": s["overhead_u"] if mode.startswith("collab") else None,
        "frames": s["frames"],
        "frames_ok": s["frames_ok"],
        "frames_ok_reported": s["frames_ok_reported"],
        "frames_lost": s["frames_lost"],
        "features_per_frame": s["features_per_frame"],
        "scale_error": s["scale_error"],
        "nees_mean": s["nees_mean"],
        "ms_per_frame": float(np.nanmean(total)),
        "ms_pseudo_stereo": float(np.nansum(cf) / len(record)),
        "ms_pseudo_stereo_overlap": float(cf[overlap].mean()) if overlap.any() else None,
        "ms_per_frame_overlap": float(total[overlap].mean()) if overlap.any() else None,
    }


def _shared_overlap(rows: list[Row]) -> list[Row]:
    """Overlap is the recording's: the modes that do not look for it get what `collab` found."""
    for row in rows:
        twin = next((r for r in rows if r["mode"] == "collab" and r["poses"] == row["poses"]), None)
        if twin is not None and "error" not in twin:
            row.update({key: twin[key] for key in ("overlap_ratio", "tau", "kappa")})
    return rows


def _told(case: Case, result: CaseResult) -> str:
    return f"{case.name}, {_worst(result.rows)}"


def _parsed(case: Case, content: dict[str, Any]) -> CaseResult:
    return CaseResult(case, content["rows"], content["tracks"])


def _rounded(positions: Any) -> list[list[float]]:
    return np.round(np.asarray(positions, float), 4).tolist()  # type: ignore[no-any-return]


def _worst(rows: list[Row]) -> str:
    errors = [r.get("final_error_pct") for r in rows if r["mode"] == "collab"]
    known = [e for e in errors if e is not None]
    return f"collab up to {max(known):.1f} % off at the end" if known else "no collab"
