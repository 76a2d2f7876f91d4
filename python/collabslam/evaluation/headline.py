"""The numbers by which runs are compared, lost ones too: error over all frames, coverage, the slowest frames.

An error over the frames that have a pose says little by itself: a run that is lost after an eighth of the way
has a small one.  ``coverage`` stands beside it, and ``ate_pct_all_frames`` leaves no frame out: where the
filter gives no valid pose its last or predicted one counts, which is what it reports in that frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from collabslam.evaluation import metrics
from collabslam.evaluation.record import RunRecord
from collabslam.types import Array

SE3, SIM3 = "SE(3)", "Sim(3)"
"""How the trajectory was laid over the truth: moved and turned, or scaled as well."""


def coverage(record: RunRecord) -> float | None:
    """Share of the frames with a valid pose; None without frames."""
    return float(record.valid.mean()) if len(record) else None


def held_positions(record: RunRecord) -> Array:
    """(N, 3) position reported in each frame, valid or not; the last finite one where it is not finite.

    Before the filter has started that is W's origin.
    """
    positions: Array = record.poses[:, :3, 3].copy()
    last = np.zeros(3)
    for k, position in enumerate(positions):
        if np.isfinite(position).all():
            last = position
        else:
            positions[k] = last
    return positions


def all_frames(record: RunRecord, truth: Array, *, metric: bool) -> dict[str, Any]:
    """``ate_pct_all_frames`` and ``ate_alignment``: error over every frame that has a truth.

    Parameters
    ----------
    record : RunRecord
        Of N frames.
    truth : (N or more, 4, 4) array
        ``T_WC`` in the data set's own world, NaN where it is missing.
    metric : bool
        Whether the estimate is in metres: then no scale is fitted.

    Returns
    -------
    dict
        RMS position error in percent of the true path; both None if the truth never moves.
    """
    true = np.asarray(truth, np.float64)[: len(record), :3, 3]
    known = np.isfinite(true).all(axis=1)
    path = metrics.path_length(true[known])
    if path <= 0.0:
        return {"ate_pct_all_frames": None, "ate_alignment": None}
    estimate = held_positions(record)[known]
    scaled = not metric and metrics.path_length(estimate) > 0.0
    ate = metrics.ate_rmse(estimate, true[known], with_scale=scaled)
    return {"ate_pct_all_frames": 100.0 * ate / path, "ate_alignment": SE3 if metric else SIM3}


def frame_times(seconds: Sequence[float]) -> dict[str, float | None]:
    """``ms_p99`` and ``ms_max``: milliseconds that 99 of 100 frames need at most, and the slowest one."""
    if not len(seconds):
        return {"ms_p99": None, "ms_max": None}
    ms = 1e3 * np.sort(np.asarray(seconds, np.float64))
    return {"ms_p99": float(ms[int(np.ceil(0.99 * len(ms))) - 1]), "ms_max": float(ms[-1])}
