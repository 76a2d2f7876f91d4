"""The robot's end: its camera and what devices send go into the filter, poses and files come out."""

from __future__ import annotations

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.sensors import WornSensors
from collabslam.errors import CollabslamError, DataError, SettingsError
from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.live import link, messages, names
from collabslam.live.cameras import RecordingPlayback
from collabslam.live.core import Event, LivePose
from collabslam.live.downlink import SILENT, Downlink
from collabslam.live.frame_source import LiveCamera
from collabslam.live.pictures import Pictures
from collabslam.live.plan import LivePlan, imu_state
from collabslam.live.printed import make_slam
from collabslam.live.record import EventWriter
from collabslam.live.results import ENGINE, LiveResults
from collabslam.live.slam import LiveSlam
from collabslam.live.status_line import WITH, StatusLine
from collabslam.live.uplink import Uplink
from collabslam.runs.folder import claim, locked
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.targets.kinds import Board, Tag
from collabslam.types import worn_cameras


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
    persons : sequence of str
        Names of the devices of several persons; if none, those of ``worn_cameras``, those of a played
        recording, or a single worn camera, which any device may be.
    worn_cameras : mapping
        Calibrations of Cf by name, "" for a single one; of others the one that the device tells.
    record : Path or None
        New folder for all that reaches the filter.
    devices : sequence of str, optional
        Who may speak, as the keys have it; without keys anybody, at most `uplink.STRANGERS`.
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
    persons: Sequence[str] = ()
    worn_cameras: Mapping[str, Camera] = field(default_factory=dict)
    record: Path | None = None
    devices: Sequence[str] | None = None
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
        self._unwritten: dict[str, DataError] = {}
        self._line = StatusLine()
        sensors = options.sensors
        self.uplink = Uplink(
            self._push,
            self._now,
            unposed=bool(options.targets) and sensors is None,
            sensors=None if sensors is None else sensors.config,
            devices=options.devices,
            awaited=options.persons,
        )
        self._downlink = Downlink(session)

    def run(self) -> dict[str, Any]:
        """Until the camera ends or Ctrl-C; returns the summary.

        Raises
        ------
        DataError
            If the camera breaks off, or a file cannot be written; everything before is written.  Where a
            file cannot, the poses go out all the same until the camera ends.
        FilterError
            If the filter meets a numerical state from which it cannot go on; likewise.
        """
        options = self._options
        with contextlib.ExitStack() as stack:
            folder = _folder(options, stack)
            heard = link.subscriber(self._zenoh, names.ALL_WORN, self.uplink.take)
            stack.callback(heard.undeclare)
            waits = partial(self._downlink.waits, self._now)
            worn = worn_calibrations(options, self._camera, self.uplink, waits)
            self.uplink.use(worn)
            pictures = Pictures(worn, self.uplink.give, self.uplink.drop)
            stack.callback(pictures.close)
            slam = self._engine(folder, worn)
            unit = ARBITRARY if options.start == "scale-free" else METRES
            results = LiveResults(
                folder,
                options.settings,
                unit,
                persons=list(slam.worn_cameras),
                every=options.checkpoint_every,
                resumed=options.resume,
            )
            stack.callback(results.close)
            if not options.resume:
                slam.save(folder / ENGINE)  # a robot that is killed may go on from its first frame
            recorder = self._recorder(worn)
            stack.callback(recorder.close)
            if options.sensors is not None and self.uplink.sensing is not None:
                self._camera.hear(options.sensors.only("robot"), self.uplink.sensing)
            with self._downlink.waiting(self._now, "its own start"):
                pictures.wait()
                self.uplink.pictures = pictures
                self._camera.begin()
            live = LiveSlam(
                slam,
                targets=options.targets,
                on_pose=lambda pose: self._done(pose, slam, results),
                on_event=lambda event: self._keep("record", lambda: recorder.write(event, self._now())),
            )
            self._live = live
            self._camera.drive(live.push_odometry)
            self._camera.turn(live.push)
            clock = self._zenoh.declare_queryable(names.CLOCK, self._tell_time)
            stack.callback(clock.undeclare)
            error, interrupted = self._drive(live)
            self._line.end()
            self._keep("record", recorder.close)
            facts = {
                **self._counts(),
                "mode": _mode(options),
                "interrupted": interrupted,
                "folder": str(folder),
            }
            error = error or next(iter(self._unwritten.values()), None)
            try:
                results.finish(slam, facts)
            except DataError as fault:
                error = error or fault
        if error is not None:
            raise error
        return {**results.facts, **facts}

    def _now(self) -> float:
        return self._camera.clock.now()

    def _drive(self, live: LiveSlam) -> tuple[CollabslamError | None, bool]:
        """Images until there are no more; what ended them, and whether that was Ctrl-C."""
        error, interrupted = None, False
        try:
            for captured in self._camera.images(lambda: False):
                live.push_robot(captured.t, captured.image)
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
        received = self._now()
        query.reply(names.CLOCK, messages.times("robot", [received, self._now()]))

    def _done(self, pose: LivePose, slam: Slam, results: LiveResults) -> None:
        """A frame is done: publish first, then write."""
        facts = self._counts() | self.uplink.said()
        views = {} if self._live is None else self._live.views
        devices = {name: merged(of, views.get(name, {})) for name, of in self.uplink.reports().items()}
        self._downlink.frame(pose, slam, facts, devices)
        self._line.show(status_text(pose, results.frames, facts, devices))
        self._keep("results", lambda: results.frame(pose))
        self._keep("checkpoint", lambda: results.checkpoint(slam))

    def _keep(self, what: str, write: Callable[[], None]) -> None:
        """Writes; a disk that is full ends this file, never the pose, and is told now and at the end."""
        if what in self._unwritten:
            return
        try:
            write()
        except DataError as error:
            self._unwritten[what] = error
            _say(f"the {what} ends here, the robot goes on: {error}")

    def _counts(self) -> dict[str, Any]:
        """Everything that was dropped, by reason."""
        dropped = Counter(self.uplink.counts())
        dropped.update({} if self._live is None else self._live.dropped)
        unposed = {f"no pose: {k}": v for k, v in self.uplink.unposed().items()}
        lost = {"not written": ", ".join(self._unwritten)} if self._unwritten else {}
        return {**{f"dropped {k}": v for k, v in dropped.items()}, **unposed, **lost}

    def _engine(self, folder: Path, worn: Mapping[str, Camera]) -> Slam:
        options = self._options
        if options.resume:
            slam = Slam.load(folder / ENGINE)
            check_cameras(slam, self._camera.camera, worn, folder)
            return slam
        return make_slam(
            self._camera.camera,
            worn,
            options.targets,
            settings=options.settings,
            mode=_mode(options),
            start=options.start,
            t_bc=self._camera.t_bc,
            imu=self._camera.imu,
        )

    def _recorder(self, worn: Mapping[str, Camera]) -> EventWriter | NoRecord:
        options = self._options
        if options.record is None:
            return NoRecord()
        tags = [str(t) for t in options.targets if isinstance(t, Tag)]
        boards = [str(t) for t in options.targets if isinstance(t, Board)]
        t_bc = None if self._camera.t_bc is None else self._camera.t_bc.ravel().tolist()
        persons = [name for name in worn if name]
        asked = _mode(options), options.start, options.settings.values
        plan = LivePlan(*asked, tags, boards, t_bc, persons, imu_state(self._camera.imu))
        return EventWriter(options.record, plan, self._camera.camera, worn)


def status_text(
    pose: LivePose, frames: int, facts: Mapping[str, Any], devices: Mapping[str, Mapping[str, float]]
) -> str:
    """How a live run goes, in a line."""
    step = pose.step
    sd = float(np.sqrt(max(np.trace(step.covariance[:3, :3]), 0.0)))
    where = f"position to {sd:.3f} {'m' if step.metric else 'units'}" if step.valid else "no pose yet"
    heard = {name: of for name, of in devices.items() if "age_median_ms" in of}
    gone = {name: of["last_image_s"] for name, of in heard.items() if of["last_image_s"] >= SILENT}
    ages = [f"{name} {of['age_median_ms']:.0f} ms" for name, of in heard.items() if name not in gone]
    dropped = sum(int(n) for what, n in facts.items() if what.startswith("dropped "))
    images = f", images of {', '.join(ages)} old" if ages else ""
    images += "".join(f", none of {name} for {seconds:.0f} s" for name, seconds in gone.items())
    return f"frame {frames}: {step.status.value}, {WITH[pose.link]}, {where}{images}, {dropped} dropped"


def merged(report: Mapping[str, float], counts: Mapping[str, int]) -> dict[str, float]:
    """A device's report and what became of its views, which are dropped for one reason in two places."""
    return {name: report.get(name, 0) + counts.get(name, 0) for name in (*report, *counts)}


def worn_calibrations(
    options: RobotOptions, camera: LiveCamera, uplink: Uplink, waits: Callable[[str], None] = lambda _: None
) -> dict[str, Camera]:
    """Each Cf's calibration by name: one that was given, the recording's own, or that which its device tells.

    None where no worn camera is used.  ``waits`` is told again and again what is waited for.

    Raises
    ------
    SettingsError
        If sensors are to tell T_CF of several persons, or a calibration is given of somebody else.
    """
    played = worn_cameras(camera.recording) if isinstance(camera, RecordingPlayback) else {}
    known = {**played, **options.worn_cameras}
    if not known and not options.persons and _is_alone(options):
        return {}
    names = tuple(options.persons or options.worn_cameras or played or ("",))
    strangers = [name for name in options.worn_cameras if name not in names]
    if strangers:
        there, absent = (", ".join(map(repr, some)) for some in (names, strangers))
        raise SettingsError(
            f"--worn-camera tells of {absent}, --persons of {there}; give both the same names."
        )
    if options.sensors is not None and len(names) > 1:
        raise SettingsError("Scans and attitudes tell T_CF of one person alone; leave --sensors out.")
    waited = [name for name in names if name not in known]
    if waited:
        whose = f"the worn cameras of {', '.join(waited)}" if any(waited) else "a worn camera"
        _say(f"waiting for {whose}, to tell the calibration (--worn-camera FILE does without)")
    while missing := [name for name in waited if name not in known]:
        known |= uplink.calibrations(missing, 0.2)
        waits("the worn camera" if missing == [""] else ", ".join(missing))
    return {name: known[name] for name in names}


def check_cameras(slam: Slam, camera: Camera, worn: Mapping[str, Camera], folder: Path) -> None:
    """Raises DataError if a run that goes on was begun with other cameras."""
    then, now = (
        {f"Cf {name}".rstrip(): lens for name, lens in of.items()} for of in (slam.worn_cameras, worn)
    )
    then["Cs"], now["Cs"] = slam.camera, camera
    other = sorted(name for name in then.keys() | now.keys() if not _same(then.get(name), now.get(name)))
    if other:
        whose = ", ".join(other)
        raise DataError(
            f"The run in {folder} was begun with other calibrations ({whose}); give those, or leave --resume "
            "out."
        )


def _same(a: Camera | None, b: Camera | None) -> bool:
    return a is not None and b is not None and a.__getnewargs__() == b.__getnewargs__()


class NoRecord:
    """In the place of a record, where none is wanted."""

    def write(self, event: Event, now: float) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


def _is_alone(options: RobotOptions) -> bool:
    """Whether the run is of Cs alone."""
    return _mode(options).startswith("mono") and options.start != "worn"


def _mode(options: RobotOptions) -> str:
    return options.mode or options.settings.filter.estimator.mode


def _folder(options: RobotOptions, stack: contextlib.ExitStack) -> Path:
    if not options.resume:
        return claim(options.out, stack, overwrite=options.overwrite)
    if not (options.out / ENGINE).is_file():
        raise DataError(f"The folder {options.out} holds no live run to go on with; leave --resume out.")
    stack.enter_context(locked(options.out))
    return options.out


def _say(text: str) -> None:
    print(f"collabslam: {text}", file=sys.stderr, flush=True)
