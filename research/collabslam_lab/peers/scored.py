"""Every system by the same measure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from collabslam.errors import InputError
from collabslam.evaluation import metrics
from collabslam.evaluation.headline import frame_times
from collabslam.types import Array
from collabslam_lab.peers.prepared import Found, Positions
from collabslam_lab.report import markdown_table

Row = dict[str, Any]

LEAST = 3
"""Positions without which there is no alignment."""


def scored(found: Found, truth: Array, *, metric: bool, given: int) -> Row:
    """The numbers of a row.

    Parameters
    ----------
    found : Found
    truth : (N, 4, 4) float64
        ``T_WC`` of all frames, NaN where it is missing.
    metric : bool
        Whether the positions are in metres; if not, there is no error without a fitted scale.
    given : int
        Frames that the system was given.

    Returns
    -------
    dict
        ``ate_sim3_pct`` and ``ate_se3_pct``: RMS error of the positions in percent of the whole true path,
        None where there is none; ``ate_sim3_live_pct``: of the positions as told when the frames came;
        ``coverage``: share of the frames given that have a position; ``cpu_ms``: of all threads, per frame
        given; ``ms_p99`` and ``ms_max``: of the clock, from a frame to its answer.
    """
    return {
        "ate_sim3_pct": _ate(found.best, truth, with_scale=True),
        "ate_se3_pct": _ate(found.best, truth, with_scale=False) if metric else None,
        "ate_sim3_live_pct": _ate(found.live, truth, with_scale=True),
        "coverage": len(found.best) / given,
        "cpu_ms": 1e3 * found.cpu / given,
        **frame_times(found.wall),
    }


def _ate(positions: Positions, truth: Array, *, with_scale: bool) -> float | None:
    known = np.asarray(np.isfinite(truth[:, :3, 3]).all(axis=1))
    frames = [k for k in sorted(positions) if 0 <= k < len(known) and known[k]]
    path = metrics.path_length(truth[known, :3, 3])
    if len(frames) < LEAST or path <= 0.0:
        return None
    try:
        estimate = np.array([positions[k] for k in frames])
        return 100.0 * metrics.ate_rmse(estimate, truth[frames, :3, 3], with_scale=with_scale) / path
    except InputError:  # it never moves
        return None


_HEAD = ("recording", "system", "version", "ATE Sim(3), %", "as it went, %", "ATE SE(3), %",
         "frames with a pose, %", "CPU ms a frame", "p99, ms", "slowest, ms", "covariance")  # fmt: skip


def peers_markdown(rows: Sequence[Row]) -> str:
    """The table of the documentation, and below it what could not be measured."""
    lines, faults = [], []
    for row in rows:
        if row["status"] != "done":
            faults.append(f"- {row['recording']}, {row['system']}: {row['error']}")
            continue
        few = "" if row["given"] == row["frames"] else f" (of {row['given']} frames)"
        lines.append(
            [
                row["recording"],
                row["system"],
                row["version"],
                _number(row["ate_sim3_pct"], 2),
                _number(row["ate_sim3_live_pct"], 2),
                _number(row["ate_se3_pct"], 2),
                f"{100.0 * row['coverage']:.0f}{few}",
                _number(row["cpu_ms"], 0),
                _number(row["ms_p99"], 0),
                _number(row["ms_max"], 0),
                "yes" if row["covariance"] else "no",
            ]
        )
    parts = [markdown_table(_HEAD, lines)] if lines else []
    return "\n\n".join([*parts, *(["Not measured:", "\n".join(faults)] if faults else [])])


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
