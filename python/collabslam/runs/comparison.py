"""Two runs beside each other: how far apart their ways are, and what was set otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from collabslam.evaluation.record import RunRecord
from collabslam.geometry import pose_inverse
from collabslam.runs.folder import CONFIG
from collabslam.runs.runner import RunResult
from collabslam.settings.table import Settings
from collabslam.types import Array, Indices


def labels(first: Path, second: Path) -> tuple[str, str]:
    """Short names of two folders that tell them apart."""
    a, b = first.resolve().parts, second.resolve().parts
    for count in range(1, max(len(a), len(b)) + 1):
        names = "/".join(a[-count:]), "/".join(b[-count:])
        if names[0] != names[1]:
            return names
    return f"{first.name} (1)", f"{second.name} (2)"


def on_first(first: RunResult, second: RunResult) -> tuple[RunResult, Indices]:
    """The second run in the world of the first, and the frames that both have a pose of.

    Both worlds become one where both runs have their first pose in common; runs without one stay as they are.

    Returns
    -------
    RunResult
    (N, 2) int64
        Indices of the common frames in both runs, those of one stamp.
    """
    a, b = first.record, second.record
    _, i, j = np.intersect1d(np.round(a.times, 6), np.round(b.times, 6), return_indices=True)
    both = a.valid[i] & b.valid[j] if len(i) else np.zeros(0, bool)
    frames = np.column_stack([i[both], j[both]]).astype(np.int64)
    if not len(frames):
        return second, frames
    t = a.poses[frames[0, 0]] @ pose_inverse(b.poses[frames[0, 1]])
    steps = [replace(s, pose=t @ s.pose, pose_map=t @ s.pose_map) for s in b.steps]
    record = RunRecord(steps, b.worn, b.seconds)
    truth = None if second.truth is None else replace(second.truth, poses=t @ second.truth.poses)
    points = second.landmarks.points @ t[:3, :3].T + t[:3, 3]
    landmarks = replace(second.landmarks, points=points)
    submaps = second.submaps
    if submaps is not None:
        whole = replace(submaps.landmarks, points=submaps.landmarks.points @ t[:3, :3].T + t[:3, 3])
        submaps = replace(submaps, poses=t @ submaps.poses, landmarks=whole)
    moved = replace(second, record=record, truth=truth, landmarks=landmarks, submaps=submaps)
    return moved, frames


def apart_text(first: RunResult, second: RunResult, frames: Indices) -> str:
    """How far the ways are apart, in frames that both have a pose of."""
    if not len(frames):
        return "  the runs have no frame of one time stamp with a pose in both: they are of other recordings"
    if first.summary["metric"] != second.summary["metric"]:
        return "  one of them is not in metres: the ways cannot be held against each other"
    a, b = (run.record.poses[frames[:, k]] for k, run in enumerate((first, second)))
    metres: Array = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1)
    turned = np.einsum("nij,nij->n", a[:, :3, :3], b[:, :3, :3])
    degrees = np.degrees(np.arccos(np.clip((turned - 1.0) / 2.0, -1.0, 1.0)))
    unit = "m" if first.summary["metric"] else first.summary["unit"]
    return (
        f"  apart in {len(frames)} frames with a pose in both, the first of them laid on each other: "
        f"{metres.mean():.3f} {unit} in the mean, {metres.max():.3f} {unit} at most, {metres[-1]:.3f} {unit} "
        f"and {degrees[-1]:.2f} degrees at the end"
    )


def settings_text(first: Path, second: Path) -> str:
    """The settings that differ, a line each."""
    a, b = (Settings.load(folder / CONFIG).values for folder in (first, second))
    other = [key for key in a if a[key] != b[key]]
    if not other:
        return "  the settings are the same"
    return "\n".join(["  settings that differ", *(f"    {key}: {a[key]} and {b[key]}" for key in other)])
