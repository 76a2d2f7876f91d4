"""A run as its result folder has it, for pictures and comparisons."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.datasets.poses import read_track
from collabslam.errors import DataError
from collabslam.evaluation.record import RunRecord
from collabslam.evaluation.scoring import AlignedTruth, score
from collabslam.formats.landmarks import read_ply
from collabslam.formats.schema import items, number, table
from collabslam.formats.trajectory import read_covariances
from collabslam.geometry import pose_from_quaternion
from collabslam.results import Landmarks, Loop, StepResult, SubmapPoses
from collabslam.runs.folder import CONFIG
from collabslam.runs.results import (
    COVARIANCE,
    FRAMES,
    GROUND_TRUTH,
    MAP,
    POSE_COLUMNS,
    SUBMAPS,
    SUBMAPS_COVARIANCE,
    SUMMARY,
    WHOLE_MAP,
)
from collabslam.runs.run_folder import RunFolder
from collabslam.runs.runner import RunResult
from collabslam.settings.table import Settings
from collabslam.types import Array, Status

_LOOPS = items(table(str, number(nan=True)))
_TEXTS = ("ate_alignment", "path_length_of", "status_final", "mode", "start")
"""What of a summary is text; all else that follows from frames and truth is a number, or is missing."""


def read_run(folder: Path) -> RunResult:
    """The result of a run, or of a live run, that has left its files in a folder.

    Of what files do not keep there is nothing: no features, no places of worn cameras, and no covariance
    where the pose may not be used.

    Raises
    ------
    DataError
        If it is no result folder, or a file of it is missing or broken.
    """
    run = RunFolder(folder)
    told, metric = run.summary(), run.is_metric()
    try:
        record = _record(run, metric=metric)
        if not len(record):
            raise DataError(f"{folder / FRAMES} has no frames; run the recording again.")
        scores = _scores(record, folder, metric)
        if "path_length_m" in told:
            _check(told, scores, folder)
        summary = {**scores, "recording": folder.name, "metric": metric, **told}
        landmarks = read_ply(folder / MAP)
        submaps = _submaps(folder, summary, record)
        return RunResult(summary, record, _truth(folder, record), landmarks, folder, submaps)
    except DataError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{folder} is damaged ({FRAMES} or {SUMMARY}); run the recording again.") from error


def _record(run: RunFolder, *, metric: bool) -> RunRecord:
    times, covariances = read_covariances(run.path / COVARIANCE)
    known = dict(zip((f"{t:.9f}" for t in times), covariances, strict=True))
    record = RunRecord()
    for row in run.frames():
        x, y, z, qx, qy, qz, qw = (float(row[column] or "nan") for column in POSE_COLUMNS)
        finite = np.isfinite([x, y, z, qx, qy, qz, qw]).all()
        t_wc = pose_from_quaternion([x, y, z], [qw, qx, qy, qz]) if finite else np.full((4, 4), np.nan)
        covariance = known.get(row["t"], np.full((6, 6), np.nan))
        step = StepResult(
            float(row["t"]),
            t_wc,
            covariance,
            Status(row["status"]),
            row["valid"] == "1",
            row["started"] == "1",
            metric,
            np.inf,
            t_wc,
            covariance,
            {column: _number(text) for column, text in row.items() if column not in POSE_COLUMNS},
        )
        record.append(step, worn=row["worn"] == "1", seconds=1e-3 * (_number(row["ms_total"]) or 0.0))
    return record


def _number(text: str | None) -> float | None:
    """A cell's number; None if it is empty or text."""
    try:
        return float(text or "")
    except ValueError:
        return None


def _scores(record: RunRecord, folder: Path, metric: bool) -> dict[str, Any]:
    """What a live run does not sum up itself."""
    return {
        **score(record, None, metric=metric),
        "mode": Settings.load(folder / CONFIG).filter.estimator.mode,
        "start": "live",
        "interrupted": False,
        "ms_per_frame": {"step": 1e3 * float(np.mean(record.seconds))},
        "loops": [],
        "submaps": 0,
        "worn": [],
    }


def _check(told: Mapping[str, Any], scores: Mapping[str, Any], folder: Path) -> None:
    """Raises DataError where a summary lacks one of these, or has something of another kind in its place."""
    for key, value in scores.items():
        if key not in told or not _is_like(told[key], value, text=key in _TEXTS):
            raise DataError(f"{folder / SUMMARY} has no usable {key}; run the recording again.")


def _is_like(given: Any, value: Any, *, text: bool) -> bool:
    """Whether something is of the kind of a value: numbers by name, a list, a text, or a number."""
    if isinstance(value, dict):
        return isinstance(given, dict) and all(_is_like(v, None, text=False) for v in given.values())
    if isinstance(value, list):
        return isinstance(given, list)
    return given is None or isinstance(given, str if text else int | float)


def _truth(folder: Path, record: RunRecord) -> AlignedTruth | None:
    path = folder / GROUND_TRUTH
    if not path.exists():
        return None
    times, poses = read_track(path)
    true = np.full((len(record), 4, 4), np.nan)
    at = np.searchsorted(np.round(record.times, 9), np.round(times, 9))
    inside = at < len(record)
    true[at[inside]] = poses[inside]
    known = np.isfinite(true).all(axis=(1, 2)) & np.isfinite(record.poses).all(axis=(1, 2))
    if record.start is None or not known.any():
        return None
    known &= np.arange(len(record)) >= record.start
    return AlignedTruth(true, record.start, known)


def _submaps(folder: Path, summary: Mapping[str, Any], record: RunRecord) -> SubmapPoses | None:
    _LOOPS(summary["loops"], "loops")
    loops = [Loop(**loop) for loop in summary["loops"]]
    if not (folder / SUBMAPS).exists():
        return None
    times, covariances = read_covariances(folder / SUBMAPS_COVARIANCE)
    poses = (
        read_track(folder / SUBMAPS)[1] if len(times) else np.empty((0, 4, 4))
    )  # of a run that never started
    if len(poses) != len(times):
        raise DataError(
            f"{folder / SUBMAPS} has {len(poses)} poses, not {len(times)}; run the recording again."
        )
    at = np.clip(np.searchsorted(record.times, times - 1e-9), 0, len(record) - 1)
    odometry: Array = record.poses[at]
    landmarks: Landmarks = read_ply(folder / WHOLE_MAP)
    return SubmapPoses(times, poses, covariances, odometry, loops, landmarks)
