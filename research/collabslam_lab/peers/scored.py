"""Every system by the same measure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from collabslam.errors import InputError
from collabslam.evaluation import metrics
from collabslam.evaluation.consistency import nees, pose_tangent_error, sharpness
from collabslam.evaluation.headline import frame_times
from collabslam.geometry import nearest_rotation
from collabslam.types import Array
from collabslam_lab.peers.prepared import Arrays, Positions, SystemResult
from collabslam_lab.report import markdown_table

Row = dict[str, Any]

LEAST = 3
"""Positions without which there is no alignment."""


def scored(found: SystemResult, truth: Array, *, metric: bool, given: int, ours: Arrays | None = None) -> Row:
    """The numbers of a row.

    Parameters
    ----------
    found : SystemResult
    truth : (N, 4, 4) float64
        ``T_WC`` of all frames, NaN where it is missing.
    metric : bool
        Whether the positions are in metres; if not, there is no error without a fitted scale.
    given : int
        Frames that the system was given.
    ours : dict of frame to (3, 3) array, optional
        R_WC of this system with Cf on the same recording.

    Returns
    -------
    dict
        ``ate_sim3_pct`` and ``ate_se3_pct``: RMS error of the positions in percent of the whole true path,
        None where there is none; ``ate_sim3_live_pct``: of the positions as told when the frames came;
        ``attitude_deg`` and ``attitude_to_ours_deg``: RMS angle to the attitudes of the truth and of this
        system with Cf, see `apart`;
        ``coverage``: share of the frames given that have a position; ``cpu_ms``: of all threads, per frame
        given; ``ms_p99`` and ``ms_max``: of the clock, from a frame to its answer; what `consistency` gives.
    """
    return {
        "ate_sim3_pct": _ate(found.best, truth, with_scale=True),
        "ate_se3_pct": _ate(found.best, truth, with_scale=False) if metric else None,
        "ate_sim3_live_pct": _ate(found.live, truth, with_scale=True),
        "attitude_deg": apart(found.turns, _turns(truth)),
        "attitude_to_ours_deg": apart(found.turns, ours or {}),
        "coverage": len(found.best) / given,
        "cpu_ms": 1e3 * found.cpu / given,
        **frame_times(found.wall),
        **consistency(found, truth, metric=metric),
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


def consistency(found: SystemResult, truth: Array, *, metric: bool) -> Row:
    """Whether the poses are as far off as is told.

    The world is laid on the truth at the pose that is known best; positions without metres get the one scale
    that fits best.

    Returns
    -------
    dict
        ``nees_position`` and ``nees_attitude``: means over the frames, expected 3; ``over_sd_position`` and
        ``over_sd_attitude``: error over claimed standard deviation, root mean squares, expected 1;
        ``residual_px``, by whose square a NEES is divided where pixels err so and not by one.  None where no
        covariance is told.
    """
    empty = dict.fromkeys(("nees_position", "nees_attitude", "over_sd_position", "over_sd_attitude"))
    frames = sorted(found.best.keys() & found.turns.keys() & found.covariances.keys())
    frames = [k for k in frames if k < len(truth) and np.isfinite(truth[k]).all()]
    if len(frames) < LEAST:
        return {**empty, "residual_px": found.residual_px}
    poses = np.tile(np.eye(4), (len(frames), 1, 1))
    poses[:, :3, :3] = [found.turns[k] for k in frames]
    poses[:, :3, 3] = [found.best[k] for k in frames]
    covariances = np.array([found.covariances[k] for k in frames])
    best = int(np.argmin(np.trace(covariances, axis1=1, axis2=2)))
    known = metrics.first_poses_aligned(truth[frames], truth[frames[best]], np.eye(4))
    poses = metrics.first_poses_aligned(poses, poses[best], np.eye(4))
    if not metric:
        scale = (poses[:, :3, 3] * known[:, :3, 3]).sum() / (poses[:, :3, 3] ** 2).sum()
        poses[:, :3, 3] *= scale
        units = np.diag([scale] * 3 + [1.0] * 3)
        covariances = units @ covariances @ units
    others = np.arange(len(frames)) != best
    errors, covariances = pose_tangent_error(poses, known)[others], covariances[others]
    parts = {"position": slice(3), "attitude": slice(3, 6)}
    return {
        **{f"nees_{k}": float(nees(errors[:, s], covariances[:, s, s]).mean()) for k, s in parts.items()},
        **{f"over_sd_{k}": sharpness(errors[:, s], covariances[:, s, s]) for k, s in parts.items()},
        "residual_px": found.residual_px,
    }


def apart(a: Arrays, b: Arrays) -> float | None:
    """RMS angle between two systems' attitudes in the frames that both have, degrees.

    Their worlds may be turned against each other: the one turn that fits best over all these frames is taken
    out, so that no frame counts more than another.  None where fewer than `LEAST` are common to both.
    """
    frames = sorted(a.keys() & b.keys())
    if len(frames) < LEAST:
        return None
    first, second = np.array([a[k] for k in frames]), np.array([b[k] for k in frames])
    turn = nearest_rotation(np.einsum("kij,klj->il", first, second))
    angles = metrics.rotation_angles(first.transpose(0, 2, 1) @ turn @ second)
    return float(np.degrees(np.sqrt(np.mean(angles**2))))


def _turns(poses: Array) -> Arrays:
    return {k: pose[:3, :3] for k, pose in enumerate(poses) if np.isfinite(pose).all()}


_HEAD = ("recording", "system", "version", "ATE Sim(3), %", "as it went, %", "ATE SE(3), %",
         "attitude, degrees", "to ours, degrees", "frames with a pose, %", "CPU ms a frame", "p99, ms",
         "slowest, ms", "covariance")  # fmt: skip
_TOLD = ("recording", "system", "NEES position", "NEES attitude", "error over sd, position",
         "error over sd, attitude", "by its residuals, position", "by its residuals, attitude")  # fmt: skip


def peers_markdown(rows: Sequence[Row]) -> str:
    """The tables of the documentation, and below them what could not be measured."""
    lines, told, faults = [], [], []
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
                _number(row["attitude_deg"], 2),
                _number(row["attitude_to_ours_deg"], 2),
                f"{100.0 * row['coverage']:.0f}{few}",
                _number(row["cpu_ms"], 0),
                _number(row["ms_p99"], 0),
                _number(row["ms_max"], 0),
                "yes" if row["covariance"] else "no",
            ]
        )
        if row["nees_position"] is not None:
            told.append([row["recording"], row["system"], *_consistency_cells(row)])
    parts = [markdown_table(_HEAD, lines)] if lines else []
    if told:
        parts += ["Whether a covariance says how far off its pose is:", markdown_table(_TOLD, told)]
    return "\n\n".join([*parts, *(["Not measured:", "\n".join(faults)] if faults else [])])


def _consistency_cells(row: Row) -> list[str]:
    """NEES and error over sd as told, and the latter where pixels err as their residuals do."""
    keys = ("position", "attitude")
    over = [row[f"over_sd_{key}"] for key in keys]
    px = row["residual_px"]
    return [
        *(_number(row[f"nees_{key}"], 1) for key in keys),
        *(_number(value, 2) for value in over),
        *("-" if px is None else _number(value / px, 2) for value in over),
    ]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
