"""The views of a recording, asked one by one: images of Cs on a path that a run of the filter gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from collabslam.checks.matching import LEAST_MATCHES, Points, describe, match_points
from collabslam.checks.mistakes import MirroredCamera
from collabslam.checks.samples import spread
from collabslam.checks.worn_bias.fit import AskedView, BiasFit, Later, fit_bias
from collabslam.checks.worn_bias.seen import Triplets, inverse_depths, seen_pose
from collabslam.datasets.persons import check_alone
from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.wrapped import Together
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse
from collabslam.runs.runner import run
from collabslam.types import Array, Mask, Recording

VIEWS = 150
"""Most views that are asked."""
MARGIN = 0.15
"""Seconds that the path has to reach beyond a view on both sides."""
_PARTNERS = 20
"""Most frames between the two images of Cs of a view."""
_BASELINE, _LEAST_BASELINE = 0.5, 0.05
"""Wanted, and least, baseline between them, as a share of that to Cf."""
_TURN = 0.5
"""Most that Cs turns between them, radians."""


def asked_views(recording: Recording, poses: Array, valid: Mask) -> list[AskedView]:
    """What the images of views, spread over a recording, say of where Cf is.

    Parameters
    ----------
    recording : Recording
        With a worn camera; only views within 10 ms of their frame are asked.
    poses : (N, 4, 4) array
        T_WC of its frames, in any unit.
    valid : (N,) array of bool
        Which of them may be used.
    """
    recording = Together(recording)
    times, usable = recording.times, np.flatnonzero(valid)
    if not len(usable):
        return []
    first, last = times[usable[0]] + MARGIN, times[usable[-1]] - MARGIN
    inside = [int(i) for i in usable if first <= times[i] <= last]
    there = spread([i for i in inside if recording.frame(i).views], VIEWS)
    images = _Images(recording)
    asked = (images.ask(i, poses, valid) for i in there)
    return [view for view in asked if view is not None]


class _Images:
    """The images of a recording, each described once."""

    def __init__(self, recording: Recording) -> None:
        assert recording.worn_camera is not None, "only recordings with Cf are asked"
        self._recording = recording
        self._models = MirroredCamera(recording.camera), MirroredCamera(recording.worn_camera)
        self._points: dict[int, Points] = {}

    def ask(self, i: int, poses: Array, valid: Mask) -> AskedView | None:
        """What the view of frame ``i`` says; None where it shares too little with Cs."""
        worn = self._recording.frame(i).views[0]  # frames with a view are asked
        matches = match_points(self._of_robot(i), describe(worn.image))
        if len(matches.uv_a) < LEAST_MATCHES:
            return None
        robot, person = self._models
        rays = robot.rays(matches.uv_a), person.rays(matches.uv_b)
        rho = rho_sd = np.full(len(rays[0]), np.nan)
        j = _partner(i, poses, valid, float(np.linalg.norm(worn.t_cf[:3, 3])))
        if j is not None:
            rho, rho_sd = inverse_depths(
                rays[0], self._again(i, j, matches.uv_a), pose_inverse(poses[i]) @ poses[j], robot.focal
            )
        good = np.isfinite(rays[0]).all(axis=1) & np.isfinite(rays[1]).all(axis=1)
        triplets = Triplets(rays[0][good], rays[1][good], rho[good], rho_sd[good])
        seen = seen_pose(triplets, worn.t_cf, worn.covariance, (robot.focal, person.focal))
        if seen is None:
            return None
        white = worn.covariance if worn.bias is None else worn.covariance - worn.bias
        return AskedView(float(self._recording.times[i]), worn.t_cf, white, seen)

    def _of_robot(self, k: int) -> Points:
        if k not in self._points:
            self._points[k] = describe(self._recording.image(k))
        return self._points[k]

    def _again(self, i: int, j: int, uv: Array) -> Array:
        """Rays (M, 3) in frame ``j`` of points of frame ``i``, NaN where it does not show them."""
        matches = match_points(self._of_robot(i), self._of_robot(j))
        rays = self._models[0].rays(matches.uv_b)
        where = {tuple(point): ray for point, ray in zip(matches.uv_a.tolist(), rays, strict=True)}
        unseen = np.full(3, np.nan)
        return np.array([where.get(tuple(point), unseen) for point in uv.tolist()])


def along_path(times: Array, poses: Array, valid: Mask) -> Later:
    """The motion of Cs along a path, between its frames, too."""
    known_times, known = times[valid], poses[valid]

    def later(t: float, offset: float) -> Array:
        offset = float(np.clip(offset, -MARGIN, MARGIN))
        here, there = interpolate_track(known_times, known, np.array([t, t + offset]), widest=1.0)
        return np.asarray(pose_inverse(here) @ there)

    return later


def _partner(i: int, poses: Array, valid: Mask, baseline: float) -> int | None:
    """The frame near frame ``i`` whose baseline from it is nearest to what is wanted, if any will do."""
    near = [
        k for k in range(max(i - _PARTNERS, 0), min(i + _PARTNERS + 1, len(poses))) if valid[k] and k != i
    ]
    best, least = None, np.inf
    for k in near:
        between = pose_inverse(poses[i]) @ poses[k]
        length = float(np.linalg.norm(between[:3, 3])) / baseline
        turn = float(np.arccos(np.clip((np.trace(between[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
        off = abs(np.log(max(length, 1e-9) / _BASELINE))
        if length >= _LEAST_BASELINE and turn < _TURN and off < least:
            best, least = k, off
    return best


class TimeCorrelatedError(NamedTuple):
    """What a recording says of T_CF's time-correlated error.

    Attributes
    ----------
    fit : BiasFit
    metric : bool
        Whether true poses of Cs were the path; otherwise a run of the filter was, whose unit rests on T_CF.
    baseline : (3,) float64
        Mean position of Cf in C, metres.
    """

    fit: BiasFit
    metric: bool
    baseline: Array


def time_correlated_error(recording: Recording) -> TimeCorrelatedError | None:
    """The error of T_CF that all views share, and their clock's; None where no view says anything.

    Parameters
    ----------
    recording : Recording
        With a worn camera.  Cs is where its true poses say, if there are any; where a run of the filter with
        its defaults says, if not.

    Raises
    ------
    DataError
        If there is no worn camera.
    SettingsError
        If there are several.
    """
    check_alone(recording)
    if recording.worn_camera is None:
        raise DataError(f"{recording.name} has no worn camera whose T_CF could be corrected; see --worn.")
    metric = recording.truth is not None
    if recording.truth is not None:
        poses = np.asarray(recording.truth)
        valid = np.asarray(np.isfinite(poses).all(axis=(1, 2)), bool)
    else:
        record = run(recording).record
        poses, valid = record.poses, np.asarray(record.valid, bool)
        # Frames whose stamps go back are not in a run; such a recording has no path for its views.
        if len(poses) != len(recording):
            raise DataError(f"Stamps of {recording.name} repeat or go back; set them right first (--times).")
    views = asked_views(recording, poses, valid)
    if not views:
        return None
    fit = fit_bias(views, along_path(np.asarray(recording.times), poses, valid), metric=metric)
    baseline = np.mean([view.measured[:3, 3] for view in views], axis=0)
    return TimeCorrelatedError(fit, metric, baseline)
