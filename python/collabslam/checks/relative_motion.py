"""How a camera turned between two images, and which way it went: the best essential matrix taken apart."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from collabslam.checks.matching import LEAST_MATCHES, Matches, sampson
from collabslam.checks.mistakes import MirroredCamera
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.geometry import nearest_rotation, pose, pose_inverse, se3_exp
from collabslam.types import Array

STEPS = 6
FINE_PX = 0.3
"""Residual of a right match, px, below which nothing is gained."""
CAP_PX = 3.0
"""Residual, px, from which on a match counts as wrong."""
_SPREAD = 4
"""Iterations of the rotation that moves all rays, each match weighted by what it leaves."""


class Motion(NamedTuple):
    """``t_ab`` (4, 4), maps points of the second image's camera into the first's; the way has length 1.

    ``parallax`` is the median angle, rad, that the way moved the points by beside the turn.  Where it is
    small any way explains as much, and the turn is known all the same.
    """

    t_ab: Array
    parallax: float


def relative_motion(matches: Matches, model: MirroredCamera) -> Motion | None:
    """How one camera moved between the images of a pair; None where too few matches agree."""
    a, b = model.rays(matches.uv_a), model.rays(matches.uv_b)
    usable = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    a, b = a[usable], b[usable]
    if len(a) < LEAST_MATCHES:
        return None
    cv2.setRNGSeed(0)
    essential, _ = cv2.findEssentialMat(a[:, :2], b[:, :2], np.eye(3), cv2.LMEDS, 0.999, 1.0, 300)
    if essential is None or essential.shape != (3, 3):
        return None
    first, second, along = cv2.decomposeEssentialMat(essential)
    turns = [min(first, second, key=lambda turn: -float(np.trace(turn))), _common_turn(b, a)]
    tried = [refined(a, b, pose(turn, along.ravel()), model.focal) for turn in turns]
    t_ba, left = min(tried, key=lambda found: float(np.sum(np.minimum(np.abs(found[1]), CAP_PX))))
    agree = np.abs(left) < CAP_PX
    if int(np.sum(agree)) < LEAST_MATCHES:
        return None
    t_ab, a, b = pose_inverse(t_ba), a[agree], b[agree]
    t_ab[:3, 3] *= _sense(a, b, t_ab)
    turned = b @ t_ab[:3, :3].T
    sines = np.linalg.norm(np.cross(a, turned), axis=1)
    angles = np.arctan2(sines, np.sum(a * turned, axis=1))
    return Motion(t_ab, float(np.median(angles)))


def _sense(a: Array, b: Array, t_ab: Array) -> float:
    """1 or -1: the sign of the way by which more points lie in front of both; lines alone do not tell it."""
    ranges = inverse_ranges(a, b, t_ab), inverse_ranges(b, a, pose_inverse(t_ab))
    return 1.0 if float(np.sum(np.sign(ranges))) >= 0.0 else -1.0


def _common_turn(b: Array, a: Array) -> Array:
    """R_ba that moves rays of a (N, 3) nearest to those of b, few far ones not counted."""
    a, b = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (a, b))
    weight = np.ones(len(a))
    turn = np.eye(3)
    for _ in range(_SPREAD):
        turn = nearest_rotation((weight[:, None] * b).T @ a)
        weight = 1.0 / np.maximum(np.linalg.norm(b - a @ turn.T, axis=1), 1e-3)
    return turn


def refined(a: Array, b: Array, t_ba: Array, pixels: float) -> tuple[Array, Array]:
    """The motion between rays with z = 1 (N, 3) that leaves least, and the residuals (N,), px."""

    def residuals(t: Array) -> Array:
        return np.asarray(pixels * sampson(b, a, t))

    step, now = 1e-6, residuals(t_ba)
    for _ in range(STEPS):
        jacobian = np.column_stack(
            [(residuals(t_ba @ se3_exp(step * axis)) - now) / step for axis in np.eye(6)]
        )
        weight = 1.0 / np.maximum(np.abs(now), FINE_PX)
        normal = jacobian.T @ (weight[:, None] * jacobian)
        damped = normal + 1e-6 * np.trace(normal) * np.eye(6)
        moved = t_ba @ se3_exp(-np.linalg.solve(damped, jacobian.T @ (weight * now)))
        moved[:3, 3] /= max(float(np.linalg.norm(moved[:3, 3])), 1e-12)
        changed = residuals(moved)
        if np.sum(np.minimum(np.abs(changed), CAP_PX)) >= np.sum(np.minimum(np.abs(now), CAP_PX)):
            break
        t_ba, now = moved, changed
    return t_ba, now
