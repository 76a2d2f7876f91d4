"""What ``summary.json`` says of a run, and whether that is to be trusted."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.evaluation.record import RunRecord
from collabslam.evaluation.scoring import score
from collabslam.results import Landmarks
from collabslam.runs.plan import Plan
from collabslam.runs.worn_results import worn_numbers
from collabslam.types import Array, Recording, worn_cameras
from collabslam.version import version

Summary = dict[str, Any]

LEAST_OK_SHARE = 0.5
"""A run that says OK in a smaller share of its frames counts as having lost the camera."""
MOST_DEGRADED_SHARE = 0.1
"""A run with a larger share of DEGRADED frames is not to be trusted as a whole."""
INTERRUPTED, TERMINATED = "Ctrl-C", "SIGTERM"
"""How a run can have been ended, besides by an error's message."""


def summarise(
    plan: Plan,
    recording: Recording,
    record: RunRecord,
    *,
    truth: Array | None,
    landmarks: Landmarks,
    ended_by: str | None,
) -> Summary:
    """Everything in ``summary.json``.

    Parameters
    ----------
    plan : Plan
    recording : Recording
    record : RunRecord
        Of its usable frames, as far as the run came.
    truth : (N, 4, 4) array or None
        Of the usable frames, in the data set's own world.
    landmarks : Landmarks
        The map at the end.
    ended_by : str or None
        What ended the run before its last frame: `INTERRUPTED`, `TERMINATED`, or an error's message.
    """
    return {
        **score(record, truth, metric=plan.metric),
        **_timing(record),
        "worn": worn_numbers(list(worn_cameras(recording)), record.steps),
        "mode": plan.mode,
        "start": plan.start,
        "unit": plan.unit,
        "metric": plan.metric,
        "recording": recording.name,
        "source": recording.source,
        "camera": _camera(recording.camera),
        "version": version(),
        "interrupted": ended_by is not None,
        "ended_by": ended_by,
        "frames_available": len(recording),
        "frames_unseen": int(np.nansum(record.diagnostic("unseen"))),
        "frames_slipped": int(np.nansum(record.diagnostic("slipped"))),
        "frames_turned": int(np.nansum(record.diagnostic("turned"))),
        "degraded_by": _degraded_by(record),
        "points_fixed_to_camera": int(np.nansum(record.diagnostic("candidates_fixed"))),
        "map_size_final": len(landmarks.ids),
        "settings_hash": plan.settings.hash(),
        "options": plan.notes,
    }


def _camera(camera: Camera) -> Summary:
    """The arguments that make the camera again."""
    names, lists = ("model", "width", "height"), ("intrinsics", "distortion")
    return {name: getattr(camera, name) for name in names} | {k: list(getattr(camera, k)) for k in lists}


def is_trusted(summary: Summary) -> bool:
    """Whether a run is to be trusted, by what it says of itself: a truth, where there is one, is not asked.

    The camera was there at the end, not DEGRADED; OK in at least half of the frames; DEGRADED in at most a
    tenth of them.  The monitor looks back on 30 frames, so one that passes does not spoil a run of some
    length; but nothing puts right what went wrong while one lasted.
    """
    frames = summary["frames"]
    ended_well = summary["status_final"] not in ("LOST", "DEGRADED")
    enough = summary["frames_ok_reported"] >= LEAST_OK_SHARE * frames
    degraded = summary["frames_degraded"] > MOST_DEGRADED_SHARE * frames
    return bool(frames and ended_well and enough and not degraded)


def _degraded_by(record: RunRecord) -> dict[str, int]:
    """DEGRADED frames by the cause, most first."""
    causes = Counter(s.diagnostics.get("degraded_by") for s in record.steps)
    return {str(cause): count for cause, count in causes.most_common() if cause}


def _timing(record: RunRecord) -> Summary:
    """Mean milliseconds per stage, and frames per second without reading or rendering images."""
    stages = sorted({k for s in record.steps for k in s.diagnostics if k.startswith("ms_")})
    means = {}
    for key in stages:
        values = record.diagnostic(key)
        if np.isfinite(values).any():
            means[key.removeprefix("ms_")] = float(np.nanmean(values))
    total = float(np.sum(record.seconds))
    if len(record):
        means["step"] = 1e3 * total / len(record)
    return {"ms_per_frame": means, "fps": len(record) / total if total > 0.0 else None}
