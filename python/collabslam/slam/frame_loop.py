"""The frame loop: METHOD section 7 in order, a line or two for each of its steps.

What a step does inside lives in ``frontend`` (images), in the folders beside this file and in the Rust core
(the filter).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from collabslam._core import Prediction, UpdateReport
from collabslam.frontend.detect import Corners, Hidden, hidden_by_any
from collabslam.frontend.flow import FlowImage
from collabslam.frontend.patch import SIZE
from collabslam.frontend.wearer_mask import Outline
from collabslam.results import FrameFeatures, StepResult, WornPose
from collabslam.slam.consistency_monitor import GYRO, NOTHING
from collabslam.slam.frame_outcome import FrameOutcome
from collabslam.slam.map_change import MapChange
from collabslam.slam.parts import Parts
from collabslam.slam.stage_times import StageTimes
from collabslam.slam.tracking.blank_image import FROZEN
from collabslam.slam.tracking.depth_input import Depths
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.slam.worn.late_views import Views
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.slam.worn.tags import overlaps
from collabslam.slam.worn.view_planning import counts as view_counts
from collabslam.types import Array, Image, Status

_LastImage = tuple[float, FlowImage] | None
_Followed = tuple[float, Array, Array]

_FEW = 0.75
"""Share of `map.in_view` below which what was found may be on somebody who fills the view."""


class _Seen(NamedTuple):
    """What a frame shows of what was expected, and what the filter made of it."""

    expected: Prediction
    found: TrackingResult
    overlap: Overlaps
    depths: Depths
    report: UpdateReport


class FrameLoop:
    """Takes the frames, one after the other.

    Parameters
    ----------
    parts : Parts
    """

    def __init__(self, parts: Parts) -> None:
        self._parts, self._filter, self._options = parts, parts.filter, parts.options

    def step(self, t: float, image: Image, worn: Views) -> StepResult:
        """One frame with the views of Cf that came with it; see `Slam.step`."""
        blank = self._parts.blank.judge(image)
        began = None
        for frame in self._parts.late.frames(t, image, worn):
            before = self._filter.started
            result = self._frame(*frame, blank if frame[0] == t else "")
            if self._filter.started and not before:
                began = frame[0]
        if began is not None and began < t:
            result.diagnostics["start_ago_s"] = t - began  # W is where Cs was then
        level = self._parts.level
        level.frame(t, result.pose, result.covariance, usable=result.valid)
        return replace(result, level=level.level())

    def _frame(self, t: float, image: Image, worn: Views, blank: str) -> StepResult:
        """One frame, its image judged by `BlankImageDetector` and its views of Cf due."""
        core, parts, times = self._filter, self._parts, StageTimes()
        parts.worn_rates.begin()
        for one in worn:
            parts.view_planner.saw(parts.worn.number(one.who), one)
        core.predict(t)
        followed = core.followed_odometry
        parts.gyro.predicted()
        if blank:
            return self._coast(t, blank, times, followed=followed)
        parts.usual_speed.expect(t)
        view = parts.worn_rates.believed(self._view(t, image, worn))
        last, tracked = parts.tracks.last_image, parts.tracks.attributes()
        expected = parts.search.expected(view)
        times.done("predict")
        expected, found, slipped = parts.search.search(view, expected, followed=followed)
        times.done("search")
        overlap = self._overlap(view, found)
        parts.seen_through.ask_map(view, found)
        times.done("cf")
        seen = self._measure(view, last, expected, found, overlap)
        followed_image, turned = (False, False) if seen.report.accepted else self._turn(view, last)
        if followed_image and not view.lost:
            seen = self._measure_again(view, tracked) or seen
        parts.depth.forget()
        expected, found, overlap, depths, report = seen
        parts.worn_rates.take(overlap, report)
        turned = turned and not report.accepted
        carried = not report.accepted and core.followed_gyro
        times.done("update")
        recovered = parts.recovery.attempt(view, report, followed=followed)
        times.done("relocalise")
        if recovered is not None:
            change = recovered.begun or MapChange()
        elif turned or (report.accepted and not view.lost):
            change = parts.map.grow(view, found, overlap, depths, report)
        else:
            change = parts.map.hold(view, found)
        if report.too_fast and recovered is None:
            change = parts.map.forget(found.ids, change)
        elif recovered is not None and recovered.contradicted:
            change = parts.map.forget(found.searched, change)
        parts.tracks.adopt(view, core.pose, change, core.candidates, recovered)
        parts.fixed.adopt(change.fixed)
        parts.relocaliser.forget(change.deleted)
        if recovered is None:
            parts.size.take(overlap, core.pose)
        outcome = FrameOutcome(
            view,
            expected,
            found,
            overlap,
            report,
            recovered,
            change,
            followed=followed,
            slipped=slipped,
            turned=turned or carried,
        )
        parts.late.keep(view, found, outcome.seen, change)
        residual = {"target_residual_px": parts.start.residual(image, core.pose)}
        others = {**parts.printed.counts(), **parts.wearers.counts(view.wearers)}
        counts = {**outcome.counts(), **others, **residual}
        status, judged = parts.verdict.of(outcome)
        lost, trusted = status is Status.LOST, status is Status.OK
        parts.usual_speed.take(t, accepted=report.accepted, lost=lost, trusted=trusted)
        times.done("map")
        features = outcome.features
        where = overlap.poses(core, report, view) if recovered is None else {}
        return self._result(t, status, counts | judged, features, times, where)

    def _view(self, t: float, image: Image, views: Views) -> View:
        """The frame as the parts see it: what is hidden, where corners are, how the camera stood before."""
        started, lost = self._filter.started, self._parts.monitor.lost
        worn = self._parts.late.place(t, views, lost=lost)
        level = self._parts.level.level()
        up = None if level is None else level.up
        wearers = self._parts.wearers.look(t, worn, lost=lost, up=up)

        def seen() -> View:
            hidden = self._hidden(wearers)
            corners = Corners(image, self._options.detect, SIZE, hidden=hidden)
            return View(t, image, worn, hidden, corners, started, lost, wearers)

        view, nobody = seen(), self._parts.wearers.nobody
        self._parts.seen_through.ask_worn(view)
        return view if self._parts.wearers.nobody == nobody else seen()

    def _hidden(self, wearers: Mapping[str, Outline]) -> Hidden | None:
        """Which pixels of Cs show no landmark: masked, of who wears a Cf, or fixed to the camera."""
        hiding = [self._parts.mask, *self._parts.wearers.hidden(wearers)]
        if self._parts.fixed.is_there:
            hiding.append(self._parts.fixed.hides)
        return hidden_by_any(hiding)

    def _overlap(self, view: View, found: TrackingResult) -> Overlaps:
        """What the worn cameras see of the frame (METHOD 7.4)."""
        if view.lost:
            return Overlaps()
        parts = self._parts
        return overlaps(parts.late, parts.worn, parts.printed, view, found, parts.map.missing(found))

    def _measure(
        self, view: View, last: _LastImage, expected: Prediction, found: TrackingResult, overlap: Overlaps
    ) -> _Seen:
        """The batch test and the update (METHOD 7.5 to 7.7); once more where the image shows another turn."""
        parts = self._parts
        missing = 0 if view.lost else parts.map.missing(found)
        depths = parts.depth.take(view, found, overlap.ids, missing)
        points = self._points(view, last, found)

        def update(followed: _Followed | None) -> UpdateReport:
            return self._filter.update(
                found.searched,
                found.ids,
                found.uv,
                views=overlap.views,
                depths=depths.observation,
                min_inliers=parts.monitor.min_inliers(len(found.searched)),
                max_speed=parts.usual_speed.most(view.t),
                followed=followed,
            )

        report = update(points)
        if points is not None and report.turn_excluded and self._filter.predict_again(*points):
            report = update(None)
        return _Seen(expected, found, overlap, depths, report)

    def _measure_again(self, view: View, tracked: Mapping[str, Any]) -> _Seen | None:
        """The frame searched and measured from where the image has turned to (METHOD 27).

        None where it is refused from there, too; then the tracks are as they were.  ``tracked`` are those of
        before the frame.
        """
        parts, before = self._parts, self._parts.tracks.attributes()
        parts.tracks.go_back(tracked)
        expected, found = parts.search.again(view)
        if len(found.ids) >= parts.monitor.min_inliers(len(found.searched)):
            seen = self._measure(view, None, expected, found, self._overlap(view, found))
            if seen.report.accepted:
                return seen
        parts.tracks.go_back(before)
        return None

    def _points(self, view: View, last: _LastImage, found: TrackingResult) -> _Followed | None:
        """Points that show the turn of the image as a whole, where what was found may move (METHOD 27)."""
        parts, now = self._parts, self._parts.tracks.last_image
        told = self._filter.followed_gyro or self._filter.followed_odometry
        if told or not view.started or view.lost or last is None or now is None:
            return None
        few = len(found.ids) < _FEW * parts.settings.filter.map.in_view
        if not few or parts.consistency_monitor.standing() != NOTHING:
            return None
        return last[0], *parts.gyro.followed(view, last, now)

    def _told_rates(self) -> dict[str, int]:
        """Of the diagnostics: what came of the gyroscopes of Cs and of the worn cameras."""
        return {**self._parts.gyro.counts(), **self._parts.worn_rates.counts()}

    def _turn(self, view: View, last: _LastImage) -> tuple[bool, bool]:
        """Follows the turn that the last two images show, where the map tells nothing (METHOD 27).

        Not asked where the map is inconsistent: what moves would pass for the scene.  Returns whether it is
        in the prediction now, as where no gyroscope told the same one; and whether the frame is as good as
        one that was used: after one that failed, as after a cut, or lost, only prediction follows.
        """
        parts, now = self._parts, self._parts.tracks.last_image
        if not view.started or last is None or now is None:
            return False, False
        told = self._filter.followed_gyro
        if told and view.lost:
            return False, False
        if told and (agrees := parts.gyro.agrees(view, last, now)) is not False:
            return False, agrees is True
        if told and not parts.gyro.contradicted_again:
            return False, False
        standing = parts.consistency_monitor.standing()
        if standing not in (NOTHING, GYRO):
            return False, False
        shown = self._filter.predict_again(last[0], *parts.gyro.followed(view, last, now))
        if not shown and told:
            shown = self._filter.predict_again(last[0], *parts.gyro.followed(view, last, now, still=True))
        return shown, shown and parts.monitor.unbroken

    def _coast(self, t: float, blank: str, times: StageTimes, *, followed: bool) -> StepResult:
        """A frame that was predicted and shows nothing; depths given for it are gone."""
        self._parts.depth.forget()
        times.done("predict")
        status = self._parts.verdict.unseen(t, frozen=blank == FROZEN, followed=followed)
        counts = {"accepted": 0, "relocalised": 0, "loops": 0, "unseen": 1, "slipped": 0, "turned": 0}
        features = FrameFeatures.unsearched(self._filter.predict_pixels())
        return self._result(t, status, counts, features, times, {})

    def _result(
        self,
        t: float,
        status: Status,
        counts: Mapping[str, Any],
        features: FrameFeatures,
        times: StageTimes,
        worn: Mapping[str, WornPose],
    ) -> StepResult:
        core, metric, scale_sd = self._filter, self._parts.start.metric, self._filter.scale_sd
        plan = {}
        if self._options.worn.next_best_view:
            plan = view_counts(self._parts.view_planner.ask(0))
            times.done("view_planning")
        pose_map, covariance_map = self._parts.submaps.place()
        doubt = {"t_cf_length_doubt": self._parts.size.doubt}
        sizes = {"map_size": core.map_size, "candidates": core.candidate_count}
        return StepResult(
            t=t,
            pose=core.pose,
            covariance=core.pose_covariance,
            status=status,
            valid=core.started and status is not Status.LOST,
            started=core.started,
            metric=metric,
            scale_sd=scale_sd if metric and scale_sd is not None else math.inf,
            pose_map=pose_map,
            covariance_map=covariance_map,
            diagnostics={**counts, **plan, **doubt, **sizes, **self._told_rates(), **times.all()},
            worn=worn,
            features=features,
            gyro=self._parts.gyro.estimate(),
        )
