"""One frame at a time: images in, pose with covariance out.

:meth:`Slam.step` is METHOD section 7 in order; what a step does inside lives in ``frontend`` (images),
``tracks`` (patches), ``overlap`` (the worn camera) and the Rust core (the filter).
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from collabslam import _core
from collabslam._core import Camera, UpdateReport
from collabslam.errors import CollabslamError, DataError, InputError
from collabslam.formats.container import read_container, write_container
from collabslam.frontend.detect import Corners
from collabslam.frontend.patch import Patch
from collabslam.frontend.search import SearchCode
from collabslam.settings.frontend import FrontendSettings
from collabslam.settings.modes import SLAM_STARTS
from collabslam.settings.table import Settings
from collabslam.slam.births import BIRTHS, Births
from collabslam.slam.blank_image import FROZEN, BlankImageDetector
from collabslam.slam.depth_input import DepthInput
from collabslam.slam.feature_states import FrameFeatures, frame_features, unsearched_features
from collabslam.slam.relocalise import MapAside, Relocaliser, searchable
from collabslam.slam.saved_map import SavedMap
from collabslam.slam.starts import check_start
from collabslam.slam.state import persistent_parts
from collabslam.slam.status import StatusMonitor
from collabslam.slam.target_start import TargetStart
from collabslam.slam.tracks import Found, Tracks, chosen
from collabslam.slam.worn_frame import Overlap, WornLook
from collabslam.types import Array, Ids, Image, Status, Target, WornView

KIND, VERSION = "engine state", 2
"""Of the file that `Slam.save` writes; the version counts the changes of what is in it."""
CLASSES = (MapAside, Patch, Target)
"""Dataclasses that are in it."""


@dataclass(frozen=True)
class StepResult:
    """What is known after a frame.

    Attributes
    ----------
    t : float
        Time stamp, seconds.
    pose : (4, 4) float64
        T_WC: maps points of Cs into W (Cs's optical frame at the start), metres.
    covariance : (6, 6) float64
        Of the pose over (translation, rotation), tangent on the right, m^2 and rad^2.
    status : Status
        OK, COASTING or LOST.
    valid : bool
        Whether the pose may be used: the filter has started and is not LOST.
    started : bool
        Whether there is a map to localise in.
    diagnostics : dict
        Counts, reasons of rejection, milliseconds per stage.
    features : FrameFeatures
        What became of each feature that should be visible.
    """

    t: float
    pose: Array
    covariance: Array
    status: Status
    valid: bool
    started: bool
    diagnostics: dict[str, Any]
    features: FrameFeatures


@dataclass(frozen=True)
class Landmarks:
    """The map: ``ids`` (N,) int64, ``points`` (N, 3) metres in W, ``covariance`` (N, 3, 3) m^2."""

    ids: Ids
    points: Array
    covariance: Array


@dataclass
class _Stages:
    """Milliseconds per stage of one frame."""

    began: float = field(default_factory=time.perf_counter)
    ms: dict[str, float] = field(default_factory=dict)
    last: float = 0.0

    def __post_init__(self) -> None:
        self.last = self.began

    def done(self, stage: str) -> None:
        now = time.perf_counter()
        self.ms[f"ms_{stage}"] = self.ms.get(f"ms_{stage}", 0.0) + 1e3 * (now - self.last)
        self.last = now

    def all(self) -> dict[str, float]:
        return {**self.ms, "ms_total": 1e3 * (self.last - self.began)}


class Slam:
    """Collaborative monocular SLAM, frame by frame.

    Parameters
    ----------
    camera : Camera
        Cs, the robot's camera.
    worn_camera : Camera, optional
        Cf, the worn camera.
    settings : Settings, optional
        The defaults if left out.
    mode : str, optional
        One of ``modes.MODES``; the settings' ``filter.estimator.mode`` if left out.
    start : {"worn", "target", "scale-free", "depth", "map"}
        Where the scale comes from: the first overlap, a known target, nowhere (then it is arbitrary), the
        first depths given with `add_depth`, or a map of an earlier run.  In a map the camera is LOST until it
        has found itself; W is the earlier run's.
    target : Target, optional
        Needed with ``start="target"``.
    map : SavedMap, optional
        Needed with ``start="map"``.  Another camera may have made it.

    Raises
    ------
    SettingsError
        If the mode or the start does not exist or lacks what it needs.
    """

    PERSISTENT: ClassVar[tuple[str, ...]] = ()
    """Attributes of its own that frames change; its parts have theirs (see `keeping.PersistentState`)."""

    def __init__(
        self,
        camera: Camera,
        worn_camera: Camera | None = None,
        *,
        settings: Settings | None = None,
        mode: str | None = None,
        start: str = "worn",
        target: Target | None = None,
        map: SavedMap | None = None,
    ) -> None:
        check_start(start, mode=mode, worn_camera=worn_camera, target=target, map=map)
        settings = settings or Settings.default()
        if mode is not None:
            settings = settings.replace({"filter.estimator.mode": mode})
        if map is not None:  # room for as many new landmarks as without it
            map = map.seen_by(camera)
            room = min(int(settings["filter.map.max_features"]) + len(map.landmarks), 10000)
            settings = settings.replace({"filter.map.max_features": room})
        core = _core.Filter(camera, worn_camera, settings=dict(settings.section("filter")))
        self._assemble(core, camera, worn_camera, settings, start, target)
        self._metric = start != "scale-free"
        if map is not None:
            self._metric = map.metric
            self._monitor.lost = True
            ids = self.filter.start_from_map(map.landmarks, map.covariance, map.drift)
            self._relocaliser.adopt(ids, map.views)

    def _assemble(
        self,
        core: _core.Filter,
        camera: Camera,
        worn_camera: Camera | None,
        settings: Settings,
        start: str,
        target: Target | None,
    ) -> None:
        """Puts the parts around a filter, new or restored."""
        self.filter = core
        self._camera, self._worn_camera, self._settings = camera, worn_camera, settings
        self._start, self._target = start, target
        self._options = FrontendSettings.from_flat(settings.section("frontend"))
        self._tracks = Tracks(camera, self._options)
        self._corners = Corners(self._options.detect, self._options.patch.size)
        self._births = Births(
            self.filter, self._tracks, self._corners, settings, scale_free=start == "scale-free"
        )
        self._look = WornLook(self.filter, camera, worn_camera, settings, self._options, self._corners)
        self._target_start: TargetStart | None = None
        if start == "target" and target is not None:
            self._target_start = TargetStart(self.filter, camera, target, self._options)
        self._depth = DepthInput(self._corners)
        self._sight = BlankImageDetector(self._options.sight)
        self._relocaliser = Relocaliser(self.filter, camera, self._tracks, self._options)
        self._monitor = StatusMonitor(settings.section("filter"))

    def add_depth(self, uv: ArrayLike, depth: ArrayLike, sigma: ArrayLike) -> None:
        """Gives depths of another sensor (a range finder, a depth camera) for the frame of the next `step`.

        A depth holds for the tracked features within 4 pixels, and for corners there that could become some:
        they are measured, or start, as points with depth (METHOD section 6).

        Parameters
        ----------
        uv : (N, 2) array
            Pixels of Cs, where the sensor's beams hit the scene.
        depth : (N,) array or float
            Along the optical axis of Cs, metres.
        sigma : (N,) array or float
            Their standard deviations, metres.

        Raises
        ------
        InputError
            For wrong shapes, or numbers that are not finite or not above zero; nothing is kept then.
        """
        self._depth.add(uv, depth, sigma)

    def step(self, t: float, image: Image, worn: WornView | None = None) -> StepResult:
        """Takes one frame (METHOD section 7).

        An image without contrast, or one that repeats the last to the bit, measures nothing: the frame is
        only predicted, and the diagnostic ``unseen`` is 1.

        Parameters
        ----------
        t : float
            Time stamp, seconds; must follow the last one.
        image : (H, W) uint8
            Grey image of Cs.
        worn : WornView, optional
            The worn camera's view at the same instant.

        Raises
        ------
        InputError
            For an image of the wrong type or size, a time stamp that does not follow, or an impossible T_CF;
            the state of the filter stays as it was.
        """
        _check_image(image, self._camera, "image")
        self._look.check(worn)
        stages = _Stages()
        was_started = self.filter.started
        self.filter.predict(t)  # 1
        if sight := self._sight.judge(image):
            return self._coast(t, sight, stages)
        hidden = self._look.hidden(worn)
        self._corners.look_at(image, hidden)
        was_lost = self._monitor.lost
        expected = self.filter.predict_pixels()  # 2
        if hidden is not None:
            expected = chosen(expected, ~hidden(expected["uv"]))
        if was_lost:
            expected = searchable(expected, self._options.search)
        stages.done("predict")
        found = self._tracks.search(  # 3
            image, self.filter.pose, expected, self.filter.predict_given, hidden
        )
        stages.done("search")
        missing = 0 if was_lost else self._births.missing(found)
        overlap = self._look.match(image, None if was_lost else worn, found, missing)  # 4
        stages.done("cf")
        depths = self._depth.take(found, overlap.ids, missing)
        report = self.filter.update(  # 5, 6, 7
            found.searched,
            found.ids,
            found.uv,
            worn=overlap.observation,
            worn_bias=overlap.bias,
            depths=depths.observation,
            least=self._monitor.least(len(found.searched)),
        )
        stages.done("update")
        tracked = np.array([o in ("pixel", "replaced") for o in report.bearings], dtype=np.bool_)
        again, anew, of_cf = None, None, report
        if was_started and report.believed:
            again = self._relocaliser.look_back(t, image)
        elif was_started:
            again = self._relocaliser.attempt(image)
            if again is None and was_lost:
                anew = self._restart(image, worn)
        stages.done("relocalise")
        deleted = np.empty(0, np.int64)
        if anew is not None:
            overlap, of_cf, births = anew
        elif report.believed and again is None and not was_lost:
            births = self._births.with_depth(image, found, overlap, depths, report)  # 8
            deleted = self.filter.manage_map()
            self._tracks.forget_features(deleted)
            self._relocaliser.forget(deleted)
            self._tracks.keep_candidates(self.filter.candidates)
            births["births_undelayed"] = self._births.vague(int(tracked.sum()) + sum(births.values()))
            births["births_undelayed"] += self._births.start_others(image)
            births["births_instant"] += self._start_from_target(image)
        else:  # the map stays as it is while the camera does not know where it is
            births = dict.fromkeys(BIRTHS, 0)
            moved = was_lost or again is not None
            self.filter.drop_candidates(self.filter.candidates if moved else found.lost)
            self._tracks.keep_candidates(self.filter.candidates)
        target_residual = self._target_residual(image)
        accepted = int(tracked.sum()) if again is None else len(again[0])
        accepted += births["births_instant"] + births["births_depth"]
        if not was_started:
            accepted += births["births_undelayed"]
        status = Status.COASTING
        if self.filter.started:
            believed = report.believed or again is not None or anew is not None
            status = self._monitor.update(t, accepted, believed=believed)
        if status is Status.OK and again is None:
            self._relocaliser.remember(t, image, self.filter.pose, found.ids[tracked], found.uv[tracked])
        stages.done("map")
        counts = {
            **_search_counts(expected["ids"], found, report),
            **overlap.counts(of_cf),
            **births,
            "accepted": accepted,
            "refused": int(report.refused is not None),
            "unseen": 0,
            "relocalised": int(again is not None),
            "restarted": int(anew is not None),
            "target_residual_px": target_residual,
            "deleted": len(deleted),
        }
        return self._result(t, status, counts, frame_features(expected, found, report), stages)

    def _restart(
        self, image: Image, worn: WornView | None
    ) -> tuple[Overlap, UpdateReport, dict[str, int]] | None:
        """A new map from Cf where prediction puts a lost camera (METHOD 19), and its births; None if too few.

        A camera that has never known where it is has nothing to tie a map to, and to a map of arbitrary unit
        none in metres can be tied.
        """
        if not (self._metric and self._monitor.found):
            return None
        overlap = self._look.match(image, worn, Tracks.nothing(), self._births.in_view)
        if overlap.observation is None:
            return None
        old = self._relocaliser.map_in_use()
        report = self.filter.restart(overlap.observation, overlap.bias)
        if not report.believed:
            return None
        self._relocaliser.put_aside(old)
        self._tracks.leave_map()
        return overlap, report, self._births.first(image, overlap, report)

    def _coast(self, t: float, sight: str, stages: _Stages) -> StepResult:
        """A frame that was predicted and shows nothing; depths given for it are gone.

        A blank image says that the camera sees nothing; a frozen one says nothing of the camera.
        """
        self._depth.forget()
        stages.done("predict")
        status = Status.COASTING
        if self.filter.started:
            frozen = sight == FROZEN
            fresh = frozen and self._monitor.is_fresh(t)
            status = Status.OK if fresh else self._monitor.update(t, 0, believed=frozen)
        counts = {"accepted": 0, "relocalised": 0, "unseen": 1}
        return self._result(t, status, counts, unsearched_features(self.filter.predict_pixels()), stages)

    def _result(
        self, t: float, status: Status, counts: dict[str, Any], features: FrameFeatures, stages: _Stages
    ) -> StepResult:
        sizes = {"map_size": self.filter.map_size, "candidates": self.filter.candidate_count}
        return StepResult(
            t=t,
            pose=self.filter.pose,
            covariance=self.filter.pose_covariance,
            status=status,
            valid=self.filter.started and status is not Status.LOST,
            started=self.filter.started,
            diagnostics={**counts, **sizes, **stages.all()},
            features=features,
        )

    def landmarks(self) -> Landmarks:
        """The map with its uncertainty."""
        found = self.filter.landmarks()
        return Landmarks(found["ids"], found["points"], found["covariance"])

    def save(self, path: str | Path) -> None:
        """Writes all that the engine knows into one file, for `load`: map, covariance, patches, settings.

        Raises
        ------
        DataError
            If the file cannot be written.
        """
        write_container(Path(path), KIND, VERSION, self.state(), CLASSES)

    @classmethod
    def load(cls, path: str | Path) -> Slam:
        """The engine that `save` wrote, which goes on bit for bit as that one would have.

        Raises
        ------
        DataError
            If the file cannot be read, is cut short, altered, or of another version.
        """
        return cls.from_state(read_container(Path(path), KIND, VERSION, CLASSES))

    def state(self) -> dict[str, Any]:
        """What `save` writes, to be written before the next frame."""
        return {
            "camera": self._camera.__getnewargs__(),
            "worn_camera": None if self._worn_camera is None else self._worn_camera.__getnewargs__(),
            "settings": dict(self._settings.values),
            "start": self._start,
            "metric": self._metric,
            "target": self._target,
            "filter": self.filter.snapshot(),
            "own": {name: getattr(self, name) for name in self.PERSISTENT},
            "parts": {name: part.state() for name, part in persistent_parts(self).items()},
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Slam:
        """The engine of a `state`; raises DataError if it is none."""
        try:
            worn = state["worn_camera"]
            if state["start"] not in SLAM_STARTS:
                raise DataError(f"There is no start '{state['start']}'.")
            slam = cls.__new__(cls)
            slam._assemble(
                _core.Filter.restore(state["filter"]),
                Camera(*state["camera"]),
                None if worn is None else Camera(*worn),
                Settings.from_flat(state["settings"]),
                state["start"],
                state["target"],
            )
            slam._metric = bool(state["metric"])
            parts = persistent_parts(slam)
            if set(state["parts"]) != set(parts):
                raise DataError("The file holds other parts of an engine; take an earlier one.")
            for name, part in parts.items():
                part.restore(state["parts"][name])
            for name in cls.PERSISTENT:
                setattr(slam, name, state["own"][name])
            features = [i for i, kind, _, _ in slam.filter.blocks if kind == "Feature"]
            if not slam._tracks.knows(np.array(features, np.int64)):
                raise DataError("The file lacks a feature's patch; take an earlier one.")
        except CollabslamError as error:
            raise DataError(f"The state cannot be used. {error}") from error
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError("The file holds no state of an engine; take an earlier one.") from error
        return slam

    def saved_map(self) -> SavedMap:
        """The map with all its uncertainty, to be kept in a file and started in later.

        Raises
        ------
        InputError
            If there is no map yet.
        """
        known = self.filter.known_map()
        if not len(known["ids"]):
            raise InputError("There is no map to save yet; run on until the filter has started.")
        return SavedMap(
            self._camera,
            self._metric,
            known["landmarks"],
            known["covariance"],
            known["drift"],
            self._relocaliser.views(known["ids"]),
        )

    def _start_from_target(self, image: Image) -> int:
        """First features from the known target (METHOD 10); returns their number."""
        if self._target_start is None or self.filter.started:
            return 0
        ids, uv = self._target_start.start(image, self._births.in_view)
        self._tracks.add_features(image, self.filter.pose, ids, uv)
        return len(ids)

    def _target_residual(self, image: Image) -> float:
        """Pixels by which the pose misplaces the target; NaN where none is known or seen."""
        if self._target_start is None:
            return float("nan")
        return self._target_start.residual(image, self.filter.pose)


def _search_counts(predicted: Ids, found: Found, report: UpdateReport) -> dict[str, Any]:
    codes = found.result.code
    outcomes = report.bearings
    return {
        "predicted": len(predicted),
        "searched": len(found.searched),
        "found": len(found.ids),
        "rejected_low_score": int(np.sum(codes == SearchCode.LOW_SCORE)),
        "rejected_ambiguous": int(np.sum(codes == SearchCode.AMBIGUOUS)),
        "rejected_outside": int(np.sum(codes == SearchCode.OUTSIDE)),
        "rejected_chi2": outcomes.count("rejected-gate"),
        "rejected_hohct": outcomes.count("rejected-batch"),
        "rejected_conditional": outcomes.count("rejected-conditional"),
        "nis": report.nis,
        "nis_dof": report.dof,
        "hohct_order": report.order,
        "hohct_exact": int(report.exact),
        "iterations": report.iterations,
    }


def _check_image(image: Image, camera: Camera, what: str) -> None:
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
        raise InputError(f"{what} must be a (H, W) uint8 grey image; convert it first.")
    if image.shape != (camera.height, camera.width):
        raise InputError(
            f"{what} is {image.shape[1]} x {image.shape[0]} pixels, its calibration is for "
            f"{camera.width} x {camera.height}; scale the calibration or the images."
        )
