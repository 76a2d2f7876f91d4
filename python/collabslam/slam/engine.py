"""The frame loop: images in, pose with covariance out, one frame at a time.

:meth:`Slam.step` is METHOD section 7 in order, a line or two for each of its steps; what a step does inside
lives in ``frontend`` (images), in the other files of this folder and in the Rust core (the filter).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from collabslam._core import Camera, Filter, Prediction, UpdateReport
from collabslam.frontend.detect import Corners, Hidden, hidden_by_any
from collabslam.frontend.flow import FlowImage
from collabslam.frontend.followed import followed_points
from collabslam.frontend.patch import SIZE
from collabslam.images import check_grey
from collabslam.results import FrameFeatures, Landmarks, PlacedCamera, StepResult, SubmapPoses
from collabslam.settings.table import Settings
from collabslam.slam.diagnostics import StageTimes
from collabslam.slam.doubts import NOTHING
from collabslam.slam.engine_inputs import EngineInputs, stamp
from collabslam.slam.feature_states import frame_features, unsearched_features
from collabslam.slam.guard import all_or_nothing, alone
from collabslam.slam.map.saved_map import SavedMap
from collabslam.slam.map_change import MapChange
from collabslam.slam.outcome import Outcome
from collabslam.slam.recovery.relocalise import searchable
from collabslam.slam.starts import check_start
from collabslam.slam.submaps.whole_map import whole_way
from collabslam.slam.tracking.blank_image import FROZEN
from collabslam.slam.tracking.depth_input import Depths
from collabslam.slam.tracking.tracks import Found
from collabslam.slam.view import PlacedViews, View
from collabslam.slam.worn.late_views import Views
from collabslam.slam.worn.looking import counts as look_counts
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.slam.worn.tags import overlaps
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Array, Image, Status, Target, WornView


class Slam(EngineInputs):
    """Collaborative monocular SLAM, frame by frame.

    Parameters
    ----------
    camera : Camera
        Cs, the robot's camera.
    worn_camera : Camera or dict of Camera, optional
        Cf, the worn camera; of several persons each one's by a name, which `WornView.who` tells.
    settings : Settings, optional
        The defaults if left out.
    mode : str, optional
        One of ``modes.MODES``; the settings' ``filter.estimator.mode`` if left out.
    start : {"worn", "target", "scale-free", "depth", "odometry", "map"}
        Where the scale comes from: the first overlap, a known target, nowhere (then it is arbitrary), the
        first depths given with `add_depth`, what `add_odometry` says of the way, or a map of an earlier run.
        In a map the camera is LOST until it has found itself; W is the earlier run's.
    target : Target, Tag or Board, optional
        Needed with ``start="target"``; `add_tag` and `add_board` announce further printed ones.
    map : SavedMap, optional
        Needed with ``start="map"``.  Another camera may have made it.
    t_bc : (4, 4) array, optional
        Where Cs sits in the frame B of `add_odometry`: maps points of C into B, metres; B is C if left out.

    Raises
    ------
    SettingsError
        If the mode or the start does not exist or lacks what it needs.
    InputError
        If ``t_bc`` is no pose.
    """

    def __init__(
        self,
        camera: Camera,
        worn_camera: Camera | Mapping[str, Camera] | None = None,
        *,
        settings: Settings | None = None,
        mode: str | None = None,
        start: str = "worn",
        target: Target | Tag | Board | None = None,
        map: SavedMap | None = None,
        t_bc: ArrayLike | None = None,
    ) -> None:
        check_start(start, mode=mode, worn_camera=worn_camera, target=target, map=map)
        settings = settings or Settings.default()
        if mode is not None:
            settings = settings.replace({"filter.estimator.mode": mode})
        if map is not None:  # room for as many new landmarks as without it
            map = map.seen_by(camera)
            room = min(int(settings["filter.map.max_features"]) + len(map.landmarks), 10000)
            settings = settings.replace({"filter.map.max_features": room})
        worn_cameras = _by_name(worn_camera)
        core = Filter(
            camera,
            list(worn_cameras.values()),
            settings=settings.section("filter"),
            switches=settings.section_switches("filter"),
        )
        if t_bc is not None:
            core.set_odometry_frame(t_bc)
        metric = start != "scale-free" if map is None else map.metric
        patches = target if isinstance(target, Target) else None
        self._assemble(core, camera, worn_cameras, settings, start, patches, metric)
        if isinstance(target, Tag | Board):
            self.announce(target)
        if map is not None:
            ids = core.start_from_map(map.landmarks, map.covariance, map.place)
            self._relocaliser.adopt(ids, map.views)
            self._known.begin(map.submaps.renamed(dict(enumerate(ids.tolist()))))
            self._printed.begin(map.targets, ids)

    @all_or_nothing
    def step(self, t: float, image: Image, views: Sequence[WornView] = ()) -> StepResult:
        """Takes one frame (METHOD section 7).

        An image without contrast, or one that repeats the last to the bit, measures nothing: the frame is
        only predicted, and the diagnostic ``unseen`` is 1.

        Parameters
        ----------
        t : float
            Time stamp, seconds; must follow the last one.
        image : (H, W) uint8
            Grey image of Cs; `collabslam.to_grey` makes one of any other.
        views : sequence of WornView, optional
            At most one of each worn camera, at the same instant or, with its time, of before.  See also
            `add_worn`.

        Raises
        ------
        InputError
            For an image of the wrong type or size, a time stamp that does not follow, or an impossible T_CF.
        BusyError
            If another thread is at work in this engine.

        Whatever is raised, KeyboardInterrupt included, the engine is what it was before the call.
        """
        t, image = stamp(t), check_grey(image, self._camera, "image")
        blank = self._blank.judge(image)
        began = None
        for frame in self._late.frames(t, image, self._worn.checked(views)):
            before = self.filter.started
            result = self._frame(*frame, blank if frame[0] == t else "")
            if self.filter.started and not before:
                began = frame[0]
        if began is not None and began < t:
            result.diagnostics["start_ago_s"] = t - began  # W is where Cs was then
        return result

    def _frame(self, t: float, image: Image, worn: Views, blank: str) -> StepResult:
        """One frame, its image judged by `BlankImageDetector` and its views of Cf due."""
        times = StageTimes()
        for one in worn:
            self._looking.saw(self._worn.number(one.who), one)
        self.filter.predict(t)
        followed = self.filter.followed_odometry
        if blank:
            return self._coast(t, blank, times, followed=followed)
        view = self._view(t, image, worn)
        last = self._tracks.last_image
        expected = self._expected(view)
        times.done("predict")
        expected, found, slipped = self._search(view, expected, followed=followed)
        times.done("search")
        missing = 0 if view.lost else self._map.missing(found)
        parts = self._late, self._worn, self._printed
        overlap = Overlaps() if view.lost else overlaps(*parts, view, found, missing)
        times.done("cf")
        depths = self._depth.take(view, found, overlap.ids, missing)
        report = self._update(found, overlap, depths)
        turned = not report.accepted and self._turn(view, last)
        times.done("update")
        recovered = self._recovery.attempt(view, report, followed=followed)
        times.done("relocalise")
        if recovered is not None:
            change = recovered.begun or MapChange()
        elif turned or (report.accepted and not view.lost):
            change = self._map.grow(view, found, overlap, depths, report)
        else:
            change = self._map.hold(view, found)
        self._tracks.adopt(view, self.filter.pose, change, self.filter.candidates, recovered)
        self._fixed.adopt(change.fixed)
        self._relocaliser.forget(change.deleted)
        if recovered is None:
            self._size.take(overlap, self.filter.pose)
        outcome = Outcome(
            view,
            expected,
            found,
            overlap,
            report,
            recovered,
            change,
            followed=followed,
            slipped=slipped,
            turned=turned,
        )
        self._late.keep(view, found, outcome.seen, change)
        counts = {
            **outcome.counts(),
            **self._printed.counts(),
            "target_residual_px": self._target_residual(image),
        }
        status = self._verdict(outcome, counts)
        times.done("map")
        features = frame_features(expected, found, report, overlap)
        where = overlap.poses(self.filter, report, view) if recovered is None else {}
        return self._result(t, status, counts, features, times, where)

    @alone
    def submaps(self) -> SubmapPoses:
        """The submaps of the way so far, as the loops correct them, the loops, and all landmarks (METHOD 25).

        Raises
        ------
        FilterError
            If rounding has spoilt a covariance.
        """
        return whole_way(self._submaps.chain())

    @alone
    def between_submaps(self, first: int, second: int) -> tuple[Array, Array]:
        """Pose of one submap from another with what is known of it.

        Returns
        -------
        pose : (4, 4) float64
            Metres.
        covariance : (6, 6) float64
            Over (translation, rotation), tangent on the right, m^2 and rad^2.

        Raises
        ------
        InputError
            If there is no such submap.
        """
        return self._submaps.chain().graph.relative(first, second)

    @alone
    def landmarks(self) -> Landmarks:
        """The map with its uncertainty."""
        found = self.filter.landmarks()
        return Landmarks(found.ids, found.points, found.covariance)

    def _view(self, t: float, image: Image, views: Views) -> View:
        """The frame as the parts see it: what is hidden, where corners are, how the camera stood before."""
        started, lost = self.filter.started, self._monitor.lost
        worn = self._late.place(t, views, lost=lost)
        hidden = self._hidden(worn)
        corners = Corners(image, self._options.detect, SIZE, hidden=hidden)
        return View(t, image, worn, hidden, corners, started, lost)

    def _hidden(self, worn: PlacedViews) -> Hidden | None:
        """Which pixels of Cs show no landmark: whoever wears a Cf, or what is fixed to the camera."""
        wearers = (self._worn.hidden(placed.worn) for _, placed in worn)
        hiding = [hides for hides in wearers if hides is not None]
        if self._fixed.is_there:
            hiding.append(self._fixed.hides)
        return hidden_by_any(hiding)

    def _expected(self, view: View) -> Prediction:
        """Features to search, with their predicted pixels (METHOD 7.2)."""
        expected = self.filter.predict_pixels()
        if view.hidden is not None:
            expected = expected.subset(~view.hidden(expected.uv))
        return searchable(expected, self._options.search) if view.lost else expected

    def _search(self, view: View, expected: Prediction, *, followed: bool) -> tuple[Prediction, Found, bool]:
        """What was expected, what the image shows of it (METHOD 7.3), and whether the wheels have slipped."""
        found = self._look(view, expected)
        least = self._monitor.min_inliers(len(found.searched))
        if followed and not view.lost and self.filter.contradicts_odometry(found.ids, found.uv, least):
            return self._after_slip(view, expected, found)
        return expected, found, False

    def _look(self, view: View, expected: Prediction) -> Found:
        """Features, candidates and printed targets in the image."""
        found = self._tracks.search(view, self.filter.pose, expected, self.filter.predict_conditional)
        return self._printed.place(view, expected, found)

    def _after_slip(self, view: View, expected: Prediction, found: Found) -> tuple[Prediction, Found, bool]:
        """The search as if the wheels may have slipped, if it explains the image; else the one before."""
        self.filter.distrust_odometry()
        wider = self._expected(view)
        again = self._look(view, wider)
        least = self._monitor.min_inliers(len(again.searched))
        if len(again.ids) >= max(least, len(found.ids) // 2, 1):
            return wider, again, True
        self.filter.trust_odometry()
        return expected, found, False

    def _update(self, found: Found, overlap: Overlaps, depths: Depths) -> UpdateReport:
        """The batch test and the update (METHOD 7.5 to 7.7)."""
        return self.filter.update(
            found.searched,
            found.ids,
            found.uv,
            worn=overlap.observation,
            further=overlap.further,
            depths=depths.observation,
            min_inliers=self._monitor.min_inliers(len(found.searched)),
        )

    def _turn(self, view: View, last: tuple[float, FlowImage] | None) -> bool:
        """The turn that the last two images show, where the map tells nothing of the frame (METHOD 27).

        Not after a frame that failed, as after a cut, nor where the map is doubted: what moves would pass for
        the scene.
        """
        now = self._tracks.last_image
        trusted = self._monitor.unbroken and self._doubts.standing() == NOTHING
        if not (view.started and trusted) or last is None or now is None:
            return False
        turn = self.filter.angular_velocity * (view.t - last[0])
        images = last[1], now[1]
        pairs = followed_points(images, self._camera, turn, self._options.flow, view.hidden)
        return self.filter.predict_again(last[0], *pairs)

    def _verdict(self, outcome: Outcome, counts: dict[str, Any]) -> Status:
        """What is said of the frame (METHOD 22); a place that is trusted is kept.  Counts doubt and loops."""
        view, change = outcome.view, outcome.change
        status = self._judge(
            view.t,
            outcome.inliers,
            accepted=outcome.accepted,
            followed=outcome.followed,
            identified=outcome.recovered is not None and outcome.recovered.identified,
        )
        if view.lost:  # a map that was in doubt is no better where a lost camera finds itself in it again
            doubt = self._doubts.standing()
        else:
            measured = outcome.report, len(outcome.found.ids), outcome.overlap, change
            doubt = self._doubts.judge(*measured, jumped=outcome.jumped)
        trusted = status is Status.OK and not outcome.found_again
        if trusted:
            self._relocaliser.remember(view, self.filter.pose, outcome.seen)
        follows = trusted and doubt == NOTHING
        counts["doubt"] = doubt
        counts["loops"] = self._submaps.follow(view, outcome.seen.without(change.deleted)) if follows else 0
        return Status.DOUBTFUL if status is Status.OK and doubt != NOTHING else status

    def _judge(
        self, t: float, inliers: int, *, accepted: bool, followed: bool, identified: bool = False
    ) -> Status:
        """Status of the frame; before the start nothing can be said of a pose."""
        if not self.filter.started:
            return Status.COASTING
        return self._monitor.update(t, inliers, accepted=accepted, followed=followed, identified=identified)

    def _target_residual(self, image: Image) -> float:
        """Pixels by which the pose misplaces the target; NaN where none is known or seen."""
        if self._target_start is None:
            return float("nan")
        return self._target_start.residual(image, self.filter.pose)

    def _coast(self, t: float, blank: str, times: StageTimes, *, followed: bool) -> StepResult:
        """A frame that was predicted and shows nothing; depths given for it are gone.

        A blank image says that the camera sees nothing; a frozen one says nothing of the camera.  Neither
        says anything against odometry that was followed.
        """
        self._depth.forget()
        times.done("predict")
        frozen = blank == FROZEN
        if frozen and self.filter.started and self._monitor.is_fresh(t):
            status = Status.OK
        else:
            status = self._judge(t, 0, accepted=frozen or followed, followed=followed)
        counts = {"accepted": 0, "relocalised": 0, "loops": 0, "unseen": 1, "slipped": 0, "turned": 0}
        return self._result(t, status, counts, unsearched_features(self.filter.predict_pixels()), times)

    def _result(
        self,
        t: float,
        status: Status,
        counts: dict[str, Any],
        features: FrameFeatures,
        times: StageTimes,
        worn: Mapping[str, PlacedCamera] | None = None,
    ) -> StepResult:
        scale_sd = self.filter.scale_sd
        if self._options.worn.where_to_look:
            counts = {**counts, **look_counts(self._next_look())}
            times.done("look")
        pose_map, covariance_map = self._submaps.place()
        sizes = {"map_size": self.filter.map_size, "candidates": self.filter.candidate_count}
        return StepResult(
            t=t,
            pose=self.filter.pose,
            covariance=self.filter.pose_covariance,
            status=status,
            valid=self.filter.started and status is not Status.LOST,
            started=self.filter.started,
            diagnostics={**counts, **sizes, **times.all()},
            features=features,
            metric=self._metric,
            scale_sd=scale_sd if self._metric and scale_sd is not None else math.inf,
            pose_map=pose_map,
            covariance_map=covariance_map,
            worn=worn or {},
        )


def _by_name(worn_camera: Camera | Mapping[str, Camera] | None) -> dict[str, Camera]:
    """The worn cameras by their names."""
    if worn_camera is None:
        return {}
    return {"": worn_camera} if isinstance(worn_camera, Camera) else dict(worn_camera)
