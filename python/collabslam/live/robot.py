"""The robot's end: its camera and what devices send go into the filter, poses and files come out."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam._core import Camera
from collabslam.datasets.ros.sensors import WornSensors
from collabslam.errors import CollabslamError, DataError
from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.live import link, messages, names
from collabslam.live.cameras import PlayedRecording
from collabslam.live.core import Event, LivePose
from collabslam.live.downlink import Downlink
from collabslam.live.printed import make_slam
from collabslam.live.record import EventWriter, LivePlan
from collabslam.live.results import ENGINE, LiveResults
from collabslam.live.shots import LiveCamera
from collabslam.live.slam import LiveSlam
from collabslam.live.uplink import Uplink
from collabslam.runs.folder import claim, locked
from collabslam.runs.plan import MODE_KEY
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.types import Board, Tag


@dataclass(frozen=True)
class RobotOptions:
    """What a live run is asked for.

    Attributes
    ----------
    out : Path
        Result folder.
    settings : Settings
    mode : str or None
        The settings' if None.
    start : str
        ``worn``, ``target``, ``odometry`` or ``scale-free``.
    targets : sequence of Tag and Board
        Printed targets in the scene.
    sensors : WornSensors or None
        What tells T_CF of views that come without it, instead of targets.
    worn_camera : Camera or None
        Calibration of Cf; the one that the first device tells if None.
    record : Path or None
        New folder for all that reaches the filter.
    checkpoint_every : int
        Frames.
    overwrite, resume : bool
        Take the result folder of an earlier run anew, or go on with that run.
    """

    out: Path
    settings: Settings
    mode: str | None = None
    start: str = "worn"
    targets: Sequence[Tag | Board] = ()
    sensors: WornSensors | None = None
    worn_camera: Camera | None = None
    record: Path | None = None
    checkpoint_every: int = 50
    overwrite: bool = False
    resume: bool = False


class RobotNode:
    """One live run.

    Parameters
    ----------
    session
        An open Zenoh session.
    camera : LiveCamera
    options : RobotOptions
    """

    def __init__(self, session: Any, camera: LiveCamera, options: RobotOptions) -> None:
        self._zenoh, self._camera, self._options = session, camera, options
        self._live: LiveSlam | None = None
        sensors = options.sensors
        self.uplink = Uplink(
            self._push,
            lambda: camera.clock.now(),
            unposed=bool(options.targets) and sensors is None,
            sensors=None if sensors is None else sensors.config,
        )
        self._downlink = Downlink(session)

    def run(self) -> dict[str, Any]:
        """Until the camera ends or Ctrl-C; returns the summary.

        Raises
        ------
        DataError
            If the camera breaks off, or a file cannot be written; everything before is written.
        FilterError
            If the filter meets a numerical state from which it cannot go on; likewise.
        """
        options = self._options
        with contextlib.ExitStack() as stack:
            folder = _folder(options, stack)
            heard = link.subscriber(self._zenoh, f"{names.WORN}/**", self.uplink.take)
            stack.callback(heard.undeclare)
            worn_camera = options.worn_camera or self._calibration()
            if worn_camera is not None:
                self.uplink.use(worn_camera)
            slam = self._engine(folder, worn_camera)
            unit = ARBITRARY if options.start == "scale-free" else METRES
            results = LiveResults(
                folder, options.settings, unit, every=options.checkpoint_every, resumed=options.resume
            )
            stack.callback(results.close)
            recorder = self._recorder(worn_camera)
            stack.callback(recorder.close)
            if options.sensors is not None and self.uplink.sensing is not None:
                self._camera.hear(options.sensors.only("robot"), self.uplink.sensing)
            self._camera.begin()
            live = LiveSlam(
                slam,
                targets=options.targets,
                on_pose=lambda pose: self._done(pose, slam, results),
                on_event=lambda event: recorder.write(event, self._camera.clock.now()),
            )
            self._live = live
            self._camera.drive(live.push_odometry)
            clock = self._zenoh.declare_queryable(names.CLOCK, self._tell_time)
            stack.callback(clock.undeclare)
            error, interrupted = self._drive(live)
            facts = {**self._counts(), "interrupted": interrupted, "folder": str(folder)}
            results.finish(slam, facts)
        if error is not None:
            raise error
        return {**results.facts, **facts}

    def _drive(self, live: LiveSlam) -> tuple[CollabslamError | None, bool]:
        """Images until there are no more; what ended them, and whether that was Ctrl-C."""
        error, interrupted = None, False
        try:
            for shot in self._camera.shots(lambda: False):
                live.push_robot(shot.t, shot.image)
        except KeyboardInterrupt:
            interrupted = True
        except CollabslamError as fault:
            error = fault
        try:
            live.close()
        except CollabslamError as fault:
            error = error or fault
        return error, interrupted

    def _push(self, event: Event) -> None:
        if self._live is not None:
            self._live.push(event)

    def _tell_time(self, query: Any) -> None:
        """Answers a device that asks for the robot's time."""
        received = self._camera.clock.now()
        query.reply(names.CLOCK, messages.times("robot", [received, self._camera.clock.now()]))

    def _done(self, pose: LivePose, slam: Slam, results: LiveResults) -> None:
        """A frame is done: publish first, then write."""
        facts = self._counts() | self.uplink.said()
        self._downlink.frame(pose, slam, facts, self.uplink.reports())
        results.frame(pose)
        results.checkpoint(slam)

    def _counts(self) -> dict[str, Any]:
        """Everything that was dropped, by reason."""
        before = {f"dropped {k}": v for k, v in self.uplink.counts().items()}
        live = {} if self._live is None else self._live.dropped
        unposed = {f"no pose: {k}": v for k, v in self.uplink.unposed().items()}
        return {**before, **{f"dropped {k}": v for k, v in live.items()}, **unposed}

    def _calibration(self) -> Camera | None:
        """Cf's calibration: the recording's own, or that of the first device that tells one.

        None where no worn camera is used.
        """
        if isinstance(self._camera, PlayedRecording) and self._camera.recording.worn_camera is not None:
            return self._camera.recording.worn_camera
        if _mode(self._options).startswith("mono") and self._options.start != "worn":
            return None
        _say("waiting for a worn camera, which tells its calibration (--worn-camera FILE does without)")
        while (camera := self.uplink.calibration(0.2)) is None:
            pass
        return camera

    def _engine(self, folder: Path, worn_camera: Camera | None) -> Slam:
        options = self._options
        if options.resume:
            return Slam.load(folder / ENGINE)
        return make_slam(
            self._camera.camera,
            worn_camera,
            options.targets,
            settings=options.settings,
            mode=_mode(options),
            start=options.start,
            t_bc=self._camera.t_bc,
        )

    def _recorder(self, worn_camera: Camera | None) -> EventWriter | NoRecord:
        options = self._options
        if options.record is None:
            return NoRecord()
        tags = [str(t) for t in options.targets if isinstance(t, Tag)]
        boards = [str(t) for t in options.targets if isinstance(t, Board)]
        t_bc = None if self._camera.t_bc is None else self._camera.t_bc.ravel().tolist()
        plan = LivePlan(_mode(options), options.start, dict(options.settings.values), tags, boards, t_bc)
        return EventWriter(options.record, plan, self._camera.camera, worn_camera)


class NoRecord:
    """In the place of a record, where none is wanted."""

    def write(self, event: Event, now: float) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


def _mode(options: RobotOptions) -> str:
    return options.mode or str(options.settings[MODE_KEY])


def _folder(options: RobotOptions, stack: contextlib.ExitStack) -> Path:
    if not options.resume:
        return claim(options.out, stack, overwrite=options.overwrite)
    if not (options.out / ENGINE).is_file():
        raise DataError(f"The folder {options.out} holds no live run to go on with; leave --resume out.")
    stack.enter_context(locked(options.out))
    return options.out


def _say(text: str) -> None:
    print(f"collabslam: {text}", file=sys.stderr, flush=True)
