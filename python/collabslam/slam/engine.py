"""collabslam's engine: images in, poses with covariance out, one frame at a time.

What happens in a frame is in `frame_loop`; the parts that a frame goes through are made in `parts`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, SupportsIndex, TypeVar

from numpy.typing import ArrayLike

from collabslam._core import Camera, Filter
from collabslam.errors import InputError
from collabslam.formats.container import read_container, write_container
from collabslam.images import check_grey, check_masks
from collabslam.results import Landmarks, StepResult, SubmapPoses
from collabslam.settings.table import Settings, schema
from collabslam.slam import saving
from collabslam.slam.frame_loop import FrameLoop
from collabslam.slam.guard import Guard, all_or_nothing, alone
from collabslam.slam.map.saved_map import SavedMap
from collabslam.slam.parts import Parts
from collabslam.slam.starts import check_start
from collabslam.slam.state import persistent_parts
from collabslam.slam.submaps.whole_map import submap_poses
from collabslam.slam.worn.view_planning import ViewPlan
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Array, Image, Imu, Mask, Target, WornView

Engine = TypeVar("Engine", bound="Slam")


class Slam:
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
    imu : Imu, optional
        Needed for `add_gyro` and `add_acceleration`: how the sensor sits, and how good it is.
    mask : (H, W) array of bool or uint8, optional
        What is never scene in the images of Cs, such as the robot's own arm: 0 there, another value
        elsewhere. No corner, patch or match is taken there.
    worn_mask : array or dict of array, optional
        The same for Cf; of several persons each one's by name, of those who have one.

    Attributes
    ----------
    filter : Filter
        Its state, to look at.

    Raises
    ------
    SettingsError
        If the mode or the start does not exist or lacks what it needs.
    InputError
        If ``t_bc`` is not a pose, or a mask not one of its camera's images.
    """

    def __init__(  # noqa: PLR0913 (each is an input of its own)
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
        imu: Imu | None = None,
        mask: Mask | Image | None = None,
        worn_mask: Mask | Image | Mapping[str, Mask | Image] | None = None,
    ) -> None:
        check_start(start, mode=mode, worn_camera=worn_camera, target=target, map=map)
        settings = Settings.or_default(settings)
        if mode is not None:
            settings = settings.replace({"filter.estimator.mode": mode})
        if imu is not None:
            if not isinstance(imu, Imu):
                raise InputError(f"A {type(imu).__name__} is no gyroscope; give Imu.")
            settings = settings.replace(imu.sizes)
        if map is not None:  # room for as many new landmarks as without it
            map = map.seen_by(camera)
            room, key = settings.filter.map.max_features + len(map.landmarks), "filter.map.max_features"
            settings = settings.replace({key: min(room, schema()[key].high or room)})
        named = {"": worn_camera} if isinstance(worn_camera, Camera) else dict(worn_camera or {})
        masks = check_masks(camera, named, mask, worn_mask)
        core = Filter(camera, list(named.values()), settings=settings.filter)
        if t_bc is not None:
            core.set_odometry_frame(t_bc)
        if imu is not None:
            core.set_imu(imu.r_ci, imu.time_offset)
            if not settings.frontend.gyro.follow:
                core.drop_gyro()
        metric = start != "scale-free" if map is None else map.metric
        known = target if isinstance(target, Target) else None
        self._use(Parts(core, camera, named, settings, start, metric=metric, target=known, masks=masks))
        if imu is not None:
            self._parts.level.sits(imu)
        if isinstance(target, Tag | Board):
            self.announce(target)
        if map is not None:
            saving.begin_in(self._parts, map)

    def _use(self, parts: Parts) -> None:
        """New parts, or those of a file."""
        self.filter, self._parts, self._loop = parts.filter, parts, FrameLoop(parts)
        self._guard = Guard(parts.filter, list(persistent_parts(parts).values()))

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
        t, image = _stamp(t), check_grey(image, self.camera, "image")
        return self._loop.step(t, image, self._parts.worn.checked(views))

    @alone
    def announce(self, target: Tag | Board) -> None:
        """Announces a printed target, as `add_tag` and `add_board` do."""
        if not self._parts.start.metric:
            raise InputError(
                f"Lengths are in an arbitrary unit here and the target {target} is in metres; start with "
                "start='target'."
            )
        self._parts.printed.add(target)

    def add_tag(self, family: str, number: int, side: float) -> None:
        """Announces a printed tag: its corners, where Cs sees them, are points of known distances.

        Parameters
        ----------
        family : str
            AprilTag's ``36h11``, ``25h9``, ``16h5`` or ``36h10``, or ArUco's, as ``4x4_50``.
        number : int
        side : float
            Of its black square, metres.

        Raises
        ------
        InputError
            If there is no such tag, it is known with another side, or lengths are in an arbitrary unit.
        """
        self.announce(Tag(family, number, side))

    def add_board(self, columns: int, rows: int, square: float) -> None:
        """Announces a checkerboard, as `add_tag` does a tag.

        Parameters
        ----------
        columns, rows : int
            Inner corners along and across.
        square : float
            Side of a square, metres.

        Raises
        ------
        InputError
            As for `add_tag`.
        """
        self.announce(Board(columns, rows, square))

    @alone
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
        self._parts.depth.add(uv, depth, sigma)

    @alone
    def add_odometry(self, t: float, twist: ArrayLike, covariance: ArrayLike) -> None:
        """Gives odometry, which the frames that follow use in place of constant velocity (METHOD section 23).

        All samples up to a frame, and best the one after it, should be given before its `step`.  Of a silence
        of more than a second a sample says nothing; there the velocity is constant again.

        Parameters
        ----------
        t : float
            Stamp, seconds, by the clock of the frames; later than the last sample's.
        twist : (6,) array
            Mean velocity and angular velocity of the odometry's frame B since the last sample, along the axes
            of B: vx, vy, vz, m/s, and wx, wy, wz, rad/s.
        covariance : (6, 6) array
            Of ``twist``, as independent from sample to sample, (m/s)^2 and (rad/s)^2.  Positive definite: an
            axis along which wheels cannot move has its small variance, too, one that was not measured a
            large one.

        Raises
        ------
        InputError
            For wrong shapes, NaN, a covariance that is none, a stamp that does not follow, if thousands of
            samples wait for a frame, or lengths are in an arbitrary unit; nothing is kept then.
        BusyError
            If another thread is at work in this engine.
        """
        if not self._parts.start.metric:
            raise InputError(
                "Lengths are in an arbitrary unit here and odometry is in metres; take start='odometry'."
            )
        self.filter.add_odometry(_stamp(t), twist, covariance)

    @alone
    def add_gyro(self, t: float, rate: ArrayLike) -> None:
        """Gives a rate of the gyroscope, by which the frames that follow turn (METHOD section 28).

        All samples up to a frame, and best the one after it, should be given before its `step`.  Where they
        are more than 0.1 s apart the angular velocity is constant in between.

        Parameters
        ----------
        t : float
            Stamp, seconds, by the sensor's clock; later than the last sample's.
        rate : (3,) array
            Along the axes of the sensor, rad/s.

        Raises
        ------
        InputError
            For a wrong shape, NaN, an impossible rate, a stamp that does not follow, if thousands of samples
            wait for a frame, or without an `Imu`; nothing is kept then.
        BusyError
            If another thread is at work in this engine.
        """
        t = _stamp(t)
        self.filter.add_gyro(t, rate)
        self._parts.level.add_rate(t, rate)

    @alone
    def add_acceleration(self, t: float, acceleration: ArrayLike) -> None:
        """Gives what an accelerometer beside the gyroscope measures, which tells which way is down: see
        `StepResult.level`.

        All samples up to a frame should be given before its `step`.  Poses do not depend on them.  At rest,
        which the rates of `add_gyro` tell, too, a second of them is enough; on the way five.

        Parameters
        ----------
        t : float
            Stamp, seconds, by the sensor's clock; later than the last acceleration's.
        acceleration : (3,) array
            Specific force along the axes of the sensor, m/s^2: at rest it points up with 9.8.

        Raises
        ------
        InputError
            For a wrong shape, NaN, an impossible acceleration, a stamp that does not follow, if thousands of
            samples wait for a frame, or without an `Imu`; nothing is kept then.
        BusyError
            If another thread is at work in this engine.
        """
        self._parts.level.add_acceleration(_stamp(t), acceleration)

    def add_worn(self, worn: WornView) -> None:
        """Hands in a view of Cf between frames, from any thread, also while another one is at work in `step`.

        It waits for the first frame at or after its time ``t`` and may then be as old as ``worn.late``: it is
        used exactly (METHOD section 21).  Each frame uses the newest of those that wait; what was not used is
        counted by reason in `worn_dropped`.  At most 32 views wait.

        Raises
        ------
        InputError
            If it has no time, does not fit its calibration, or its T_CF is impossible.
        """
        self._parts.late.add(worn)

    @property
    def camera(self) -> Camera:
        """Cs."""
        return self._parts.camera

    @property
    def worn_cameras(self) -> dict[str, Camera]:
        """Each Cf by its name; that of a single one is empty."""
        return dict(self._parts.worn_cameras)

    @property
    def worn_late(self) -> float:
        """How late a view of Cf may come, seconds: the setting ``filter.worn.late``."""
        return self._parts.settings.filter.worn.late

    @property
    def views_used(self) -> tuple[WornView, ...]:
        """The views of Cf that the last `step` used, as they were given, with their times; at most one of
        each worn camera."""
        return self._parts.late.used

    @property
    def worn_dropped(self) -> dict[str, int]:
        """How many views of Cf were not used, by reason: ``stale``, ``future``, ``repeated``, ``superseded``
        (by a newer one for the same frame), ``crowded`` (too many waited)."""
        return dict(self._parts.late.dropped)

    @alone
    def next_best_view(self, who: str | None = None) -> ViewPlan | None:
        """Where the person who wears Cf should look next, as far as pose and scale are concerned (METHOD 24).

        Cf is taken to be where its last view was taken from, relative to Cs.  It takes a millisecond or two
        and changes nothing.  With the setting ``frontend.worn.next_best_view`` the diagnostics of each frame
        have it.

        Parameters
        ----------
        who : str, optional
            Whose Cf, by its name; the first one's if left out.

        Returns
        -------
        ViewPlan or None
            None before the start, while LOST, before the first view of Cf, and where no view would help.

        Raises
        ------
        InputError
            If there is no such worn camera.
        """
        if who is not None and who not in self._parts.worn_cameras:
            raise InputError(f"There is no worn camera {who!r}; take one of worn_cameras.")
        return self._parts.view_planner.ask(0 if who is None else self._parts.worn.number(who))

    @alone
    def landmarks(self) -> Landmarks:
        """The map with its uncertainty."""
        found = self.filter.landmarks()
        return Landmarks(found.ids, found.points, found.covariance)

    @alone
    def submaps(self) -> SubmapPoses:
        """The submaps of the way so far, as the loops correct them, the loops, and all landmarks (METHOD 25).

        Raises
        ------
        FilterError
            If rounding has spoilt a covariance.
        """
        return submap_poses(self._parts.submaps.chain())

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
        try:
            return self._parts.submaps.chain().graph.relative(first, second)
        except (IndexError, OverflowError, TypeError) as error:
            raise InputError(
                f"There is no submap {first!r}, or none {second!r}; give numbers of `submaps`."
            ) from error

    @alone
    def saved_map(self) -> SavedMap:
        """The map with all its uncertainty, to be kept in a file and started in later.

        Raises
        ------
        InputError
            If there is no map yet.
        """
        return saving.map_of(self._parts)

    def save(self, path: str | Path) -> None:
        """Writes all that the engine knows into one file, for `load`: map, covariance, patches, settings.

        Raises
        ------
        DataError
            If the file cannot be written.
        """
        write_container(Path(path), saving.KIND, saving.VERSION, self.state(), saving.CLASSES)

    @classmethod
    def load(cls: type[Engine], path: str | Path) -> Engine:
        """The engine that `save` wrote, which goes on bit for bit as that one would have.

        Raises
        ------
        DataError
            If the file cannot be read, is cut short, altered, or of another version.
        """
        return cls.from_state(read_container(Path(path), saving.KIND, saving.VERSION, saving.CLASSES))

    @alone
    def state(self) -> dict[str, Any]:
        """What `save` writes, to be written before the next frame."""
        return saving.state_of(self._parts)

    @classmethod
    def from_state(cls: type[Engine], state: Mapping[str, Any]) -> Engine:
        """The engine of a `state`; raises DataError if it is none."""
        engine = cls.__new__(cls)
        engine._use(saving.parts_of(state))
        return engine

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise InputError(
            f"A {type(self).__name__} cannot be copied or pickled; write it with save(path) and read it with "
            f"{type(self).__name__}.load(path)."
        )


def _stamp(t: Any) -> float:
    """A time stamp as a float; raises InputError if it is not a number."""
    try:
        return float(t)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"The time stamp is {t!r}; give seconds, a number.") from error
