"""What is handed to the engine beside the frames: printed targets, depths, odometry, views of Cf."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.slam.guard import alone
from collabslam.slam.parts import EngineParts
from collabslam.targets.kinds import Board, Tag
from collabslam.types import WornView


class EngineInputs(EngineParts):
    """The parts of an engine, with what they are given."""

    @alone
    def announce(self, target: Tag | Board) -> None:
        """Announces a printed target, as `add_tag` and `add_board` do."""
        if not self._metric:
            raise InputError(
                f"Lengths are in an arbitrary unit here and the target {target} is in metres; start with "
                "start='target'."
            )
        self._printed.add(target)

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
        self._depth.add(uv, depth, sigma)

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
        if not self._metric:
            raise InputError(
                "Lengths are in an arbitrary unit here and odometry is in metres; take start='odometry'."
            )
        self.filter.add_odometry(stamp(t), twist, covariance)

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
        self._late.add(worn)

    @property
    def camera(self) -> Camera:
        """Cs."""
        return self._camera

    @property
    def worn_cameras(self) -> dict[str, Camera]:
        """Each Cf by its name; that of a single one is empty."""
        return dict(self._worn_cameras)

    @property
    def worn_late(self) -> float:
        """How late a view of Cf may come, seconds: the setting ``filter.worn.late``."""
        return float(self._settings["filter.worn.late"])

    @property
    def views_used(self) -> tuple[WornView, ...]:
        """The views of Cf that the last `step` used, as they were given, with their times; at most one of
        each worn camera."""
        return self._late.used

    @property
    def worn_dropped(self) -> dict[str, int]:
        """How many views of Cf were not used, by reason: ``stale``, ``future``, ``repeated``, ``superseded``
        (by a newer one for the same frame), ``crowded`` (too many waited)."""
        return dict(self._late.dropped)


def stamp(t: Any) -> float:
    """A time stamp as a float; raises InputError if it is no number."""
    try:
        return float(t)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"The time stamp is {t!r}; give seconds, a number.") from error
