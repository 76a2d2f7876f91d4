"""One recording through the filter, from the first frame to the result folder."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from collabslam.datasets.source import Source
from collabslam.datasets.stamps import usable_frames
from collabslam.errors import CollabslamError, DataError, FilterError, InputError, SettingsError, Terminated
from collabslam.evaluation.record import RunRecord
from collabslam.evaluation.scoring import AlignedTruth, align_truth
from collabslam.formats.files import check_name, try_place
from collabslam.level import Level
from collabslam.results import Landmarks, StepResult, SubmapPoses
from collabslam.runs.checkpoint import Checkpoint, fingerprint
from collabslam.runs.folder import claim, locked
from collabslam.runs.interrupts import Interrupts
from collabslam.runs.level import LEVEL, WORLD_NOTE, measured_level, parse_world
from collabslam.runs.plan import MODE_KEY, Interval, Output, Plan
from collabslam.runs.progress import Progress
from collabslam.runs.rate_poses import RATE_NOTE, rate_poses, write_rate_poses
from collabslam.runs.report import brief_text
from collabslam.runs.results import RATE_POSES, ResultWriter, jsonable
from collabslam.runs.sensors import give_sensors, gyro_numbers, worn_gyro_numbers
from collabslam.runs.summary import INTERRUPTED, TERMINATED, Summary, summarise
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.slam.map.saved_map import SavedMap
from collabslam.targets.kinds import Board, Tag
from collabslam.types import (
    Array,
    Frame,
    Image,
    Indices,
    Recording,
    WornView,
    masks_of,
    worn_cameras,
)
from collabslam.version import version


class SlamLike(Protocol):
    """What a run asks of the engine."""

    def step(self, t: float, image: Image, views: Sequence[WornView] = ()) -> StepResult: ...
    def landmarks(self) -> Landmarks: ...


Watch = Callable[[Frame, Any, Any], None]


@dataclass(frozen=True)
class RunResult:
    """A finished run.

    Attributes
    ----------
    summary : dict
        As in ``summary.json``.
    record : RunRecord
    truth : AlignedTruth or None
        The truth in W, where there is one.
    landmarks : Landmarks
        The map at the end.
    folder : Path or None
        Where the results are.
    submaps : SubmapPoses or None
        The submaps of the way and the loops between them, of an engine that has any.
    level : Level or None
        Which way is down, where anything tells it.
    """

    summary: Summary
    record: RunRecord
    truth: AlignedTruth | None
    landmarks: Landmarks
    folder: Path | None = None
    submaps: SubmapPoses | None = None
    level: Level | None = None

    def __repr__(self) -> str:
        where = f"\n  results are in {self.folder}" if self.folder is not None else ""
        return brief_text(self.summary) + where


def run(
    source: Recording | Source | str | Path,
    *,
    mode: str | None = None,
    start: str | SavedMap | Path | None = None,
    settings: Settings | None = None,
    out: str | Path | Output | None = None,
    printed: Sequence[Tag | Board] = (),
    slam: SlamLike | None = None,
    watch: Watch | None = None,
) -> RunResult:
    """Run a recording through the filter and score it.

    Ctrl-C ends the run after the frame that it is at: what was done until then is scored and written, and
    marked ``interrupted``.  So does an error in the middle (a broken image, a full disk), which is raised
    afterwards with the result as its attribute ``result``.  Such a run leaves a checkpoint, too; with
    ``Output.checkpoint_every`` one that was killed does.  `resume` goes on from it.

    Frames whose time stamps repeat or go back are left out and counted as ``frames_out_of_order``; a clock
    that was set back is set forward again (see `collabslam.datasets.stamps.usable_frames`).

    Parameters
    ----------
    source : Recording, Source, str or Path
        A recording, how one is opened, or just where one lies; see `collabslam.open_recording`.
    mode : str, optional
        One of `collabslam.settings.modes.MODES`; the settings' ``filter.estimator.mode`` if left out,
        or ``mono`` if there is no worn camera.
    start : str, SavedMap or Path, optional
        One of `collabslam.settings.modes.STARTS`; the first of them that the recording allows if left out.
        Or a map of an earlier run, or its file: the camera then finds itself in it.
    settings : Settings, optional
        The defaults if left out.
    out : str, Path or Output, optional
        Result folder, or that and more: a checkpoint, a saved map, progress.  An earlier run's results are
        kept: `RunResult.folder` says where these are.  Nothing is written if left out.
    printed : sequence of Tag and Board, optional
        Printed targets in the scene: ``start="target"`` starts from one of them, and all are points of known
        distances wherever Cs sees them (see `Slam.add_tag`).
    slam : SlamLike, optional
        An engine of one's own in place of `collabslam.Slam`.
    watch : callable, optional
        Is given each frame, the engine's answer and the engine, as `viz.rerun_log.RerunLog.frame` is.

    Raises
    ------
    DataError
        If the recording cannot be read, breaks off, or ``out`` cannot be used.
    SettingsError
        If an option is not allowed.
    FilterError
        If the filter meets a numerical state from which it cannot go on.
    """
    if not isinstance(source, str | Path | Source) and not hasattr(source, "frame"):
        raise InputError(f"A {type(source).__name__} cannot be run; give a recording, a Source or a path.")
    output = out if isinstance(out, Output) else Output(out)
    if isinstance(source, str | Path):
        source = Source(Path(source))
    recording, reopen = (source.open(), source) if isinstance(source, Source) else (source, output.reopen)
    settings = Settings.or_default(settings)
    mode = mode or default_mode(recording, settings)
    start = SavedMap.load(start) if isinstance(start, Path) else start or default_start(recording, printed)
    plan = Plan(
        mode,
        start if isinstance(start, str) else "map",
        start != "scale-free" if isinstance(start, str) else start.metric,
        settings.replace({MODE_KEY: mode}),
        jsonable({**output.notes, **_printed_note(printed), **_asked(output, recording)}),
        None if output.checkpoint_every is None else Interval.parse(output.checkpoint_every),
    )
    if plan.every is not None and (output.folder is None or slam is not None):
        raise SettingsError(
            "A checkpoint needs a result folder, and an engine of collabslam's own; give --out."
        )
    engine = slam or make_engine(recording, plan, start if isinstance(start, SavedMap) else None, printed)
    with contextlib.ExitStack() as stack:
        folder = None
        if output.folder is not None:
            wanted = Path(output.folder)
            folder = claim(wanted, stack, overwrite=output.overwrite, latest=output.latest)
        work = _Run(recording, plan, engine, RunRecord(), folder, reopen)
        return work.finish(output, watch)


def resume(
    folder: str | Path,
    recording: Recording | None = None,
    *,
    checkpoint_every: int | str | None = None,
    save_map: str | Path | None = None,
    progress: bool = False,
    watch: Watch | None = None,
) -> RunResult:
    """Go on with a run that was stopped, from its last checkpoint; the results are those of one that was not.

    Parameters
    ----------
    folder : str or Path
        Its result folder, which is where the results go.
    recording : Recording, optional
        The same recording; opened as `run` did if left out.
    checkpoint_every : int or str, optional
        As for `Output`; as before if left out.
    save_map, progress, watch
        As for `Output` and `run`: a checkpoint names no file that is written to.

    Raises
    ------
    DataError
        If there is no checkpoint, it is cut short, altered or of another version, the recording is another,
        or another run is writing into the folder.
    """
    folder = Path(folder)
    check_name(folder)
    with contextlib.ExitStack() as stack:
        if folder.is_dir():
            stack.enter_context(locked(folder))
        checkpoint = Checkpoint.read(folder)
        reopen = None if checkpoint.reopen is None else checkpoint.source()
        recording = recording or checkpoint.source().open()
        plan, engine, record = checkpoint.restored(recording)
        if checkpoint_every is not None:
            plan = replace(plan, every=Interval.parse(checkpoint_every))
        work = _Run(recording, plan, engine, record, folder, reopen, resumed=True)
        return work.finish(Output(folder, save_map=save_map, progress=progress), watch)


def default_mode(recording: Recording, settings: Settings) -> str:
    """The mode that the settings name, or ``mono`` if it needs a worn camera and there is none."""
    mode = settings.filter.estimator.mode
    return "mono" if recording.worn_camera is None and mode.startswith("collab") else mode


def default_start(recording: Recording, printed: Sequence[Tag | Board] = ()) -> str:
    """The first way to start that the recording allows."""
    if recording.worn_camera is not None:
        return "worn"
    if printed or recording.target is not None:
        return "target"
    if getattr(recording, "has_depth", False):
        return "depth"
    return "scale-free" if getattr(recording, "odometry", None) is None else "odometry"


def _printed_note(printed: Sequence[Tag | Board]) -> dict[str, list[str]]:
    """The printed targets, for the summary."""
    return {"printed": [str(target) for target in printed]} if printed else {}


def _asked(output: Output, recording: Recording) -> dict[str, Any]:
    """Further files that are asked for, for the summary; raises SettingsError if nothing can tell them."""
    log = getattr(recording, "imu", None)
    if output.rate_poses and log is None:
        raise SettingsError(
            f"{recording.name} has no gyroscope at whose rate poses could be written; give --gyro FILE|TOPIC."
        )
    asked: dict[str, Any] = {RATE_NOTE: True} if output.rate_poses else {}
    world = output.world
    if world is None:
        return asked
    if parse_world(world) is None and (log is None or log.accelerations is None):
        raise SettingsError(
            f"{recording.name} has no accelerometer that tells which way is down; give --gyro FILE with ax, "
            "ay, az, or --world level:ROLL,PITCH (degrees, of Cs at the start)."
        )
    return asked | {WORLD_NOTE: world}


def make_engine(
    recording: Recording, plan: Plan, map: SavedMap | None = None, printed: Sequence[Tag | Board] = ()
) -> SlamLike:
    """The engine for a recording; raises SettingsError where mode or start do not fit it."""
    if plan.start == "depth" and not getattr(recording, "has_depth", False):
        raise SettingsError(
            f"The start 'depth' needs depth images and {recording.name} has none; give --depth "
            "TOPIC (of a bag), or take another start."
        )
    odometry = getattr(recording, "odometry", None)
    if plan.start == "odometry" and odometry is None:
        raise SettingsError(
            f"The start 'odometry' needs odometry and {recording.name} has none; give --odometry FILE|TOPIC, "
            "or take another start."
        )
    log = getattr(recording, "imu", None)
    slam = Slam(
        recording.camera,
        worn_cameras(recording),
        settings=plan.settings,
        mode=plan.mode,
        start=plan.start,
        target=next(iter(printed), recording.target) if plan.start == "target" else None,
        map=map,
        t_bc=None if odometry is None else odometry.t_bc,
        imu=None if log is None else log.sensor,
        mask=masks_of(recording).robot,
        worn_mask=masks_of(recording).worn,
    )
    for target in printed:
        slam.announce(target)
    return slam


@dataclass
class _Run:
    """A run between two frames, and what brings it to its end."""

    recording: Recording
    plan: Plan
    engine: Any
    record: RunRecord
    folder: Path | None
    reopen: Source | None
    resumed: bool = False

    def finish(self, output: Output, watch: Watch | None) -> RunResult:
        """The frames that are left, then scores and files; raises the error that ended it, if one did."""
        save_map = None if output.save_map is None else Path(output.save_map)
        if save_map is not None:
            if not isinstance(self.engine, Slam):
                raise SettingsError("A map to save needs an engine of collabslam's own.")
            try_place(save_map)
        usable, times = usable_frames(self.recording.times)
        with contextlib.ExitStack() as stack:
            writer = None if self.folder is None else stack.enter_context(self._writer(self.folder))
            error = self._frames(usable, times, writer, output, watch)
            result = self._result(usable, error)
            try:
                self._write(result, writer, save_map)
            except CollabslamError as fault:
                raise (error if isinstance(error, CollabslamError) else fault) from fault
        if isinstance(error, CollabslamError):
            error.result = result
            raise error
        return result

    def _writer(self, folder: Path) -> ResultWriter:
        title = f"as used by {self.recording.name}, mode {self.plan.mode}"
        config = self.plan.settings.dump(title=title)
        persons = list(worn_cameras(self.recording))
        return ResultWriter(folder, config, self.plan.unit, persons, self.record if self.resumed else None)

    def _frames(
        self, usable: Indices, times: Array, writer: ResultWriter | None, output: Output, watch: Watch | None
    ) -> CollabslamError | KeyboardInterrupt | None:
        """The frames that are left; returns what ended them before the last one."""
        saver = _Saver(self, writer) if writer is not None and isinstance(self.engine, Slam) else None
        label, done = f"{self.recording.name} {self.plan.mode}", len(self.record)
        whole = True  # whether engine and record stand between the same two frames
        with Progress(len(usable), label, enabled=output.progress, done=done) as bar:
            try:
                if saver and not self.resumed:
                    saver.begin()
                with Interrupts() as interrupts:
                    for i, t in zip(usable[done:].tolist(), times[done:].tolist(), strict=True):
                        frame = self.recording.frame(i)
                        whole = False
                        step = self._step(t, frame)
                        whole = True
                        if writer:
                            writer.frame(self.record)
                        if saver:
                            saver.frame()
                        if watch is not None:
                            watch(frame, step, self.engine)
                        bar.update(_note(step))
                        interrupts.let_through()
            except (CollabslamError, KeyboardInterrupt) as error:
                if saver and (whole or isinstance(error, InputError)):  # which changes nothing
                    with contextlib.suppress(DataError):  # a full disk: the one before is there
                        saver.save()
                return error
        return None

    def _step(self, t: float, frame: Frame) -> StepResult:
        began = time.perf_counter()
        if isinstance(self.engine, Slam):
            give_sensors(self.engine, self.recording, t, metric=self.plan.metric)
        if frame.depth is not None and isinstance(self.engine, Slam):
            self.engine.add_depth(frame.depth.uv, frame.depth.depth, frame.depth.sigma)
        step: StepResult = self.engine.step(t, frame.image, frame.views)
        self.record.append(step, worn=bool(frame.views), seconds=time.perf_counter() - began)
        return step

    def _result(self, usable: Indices, error: BaseException | None) -> RunResult:
        ended_by = None if error is None else str(error)
        if isinstance(error, KeyboardInterrupt):
            ended_by = TERMINATED if isinstance(error, Terminated) else INTERRUPTED
        truth = None if self.recording.truth is None else self.recording.truth[usable]
        landmarks = self.engine.landmarks()
        summary = summarise(
            self.plan, self.recording, self.record, truth=truth, landmarks=landmarks, ended_by=ended_by
        )
        aligned = align_truth(self.record, truth, metric=self.plan.metric)
        before = getattr(self.recording, "left_out", 0)
        summary["frames_out_of_order"] = before + len(self.recording) - len(usable)
        summary["gyro"] = gyro_numbers(self.engine, self.recording, self.record)
        summary["worn_gyro"] = worn_gyro_numbers(self.record)
        level = self._level()
        summary["level"] = None if level is None else level.numbers()
        submaps = _submaps(self.engine)
        summary["submaps"] = 0 if submaps is None else len(submaps.times)
        summary["loops"] = [] if submaps is None else [asdict(loop) for loop in submaps.loops]
        return RunResult(summary, self.record, aligned, landmarks, self.folder, submaps, level)

    def _write_rate_poses(self, writer: ResultWriter) -> None:
        """Poses between frames, if they were asked for."""
        log, engine = getattr(self.recording, "imu", None), self.engine
        if RATE_NOTE not in self.plan.notes or log is None or not isinstance(engine, Slam):
            return
        bias, clock = engine.filter.gyro_bias, engine.filter.gyro_clock
        if bias is not None and clock is not None:
            found = rate_poses(self.record, log, self.plan.settings, bias[0], clock[0])
            write_rate_poses(writer.folder / RATE_POSES, found, self.plan.unit)

    def _level(self) -> Level | None:
        """Which way is down: as it was told, or as the accelerometer has it."""
        told = parse_world(self.plan.notes.get(WORLD_NOTE, LEVEL))
        log = getattr(self.recording, "imu", None)
        return told or measured_level(self.record, log, self.plan.settings, metric=self.plan.metric)

    def _write(self, result: RunResult, writer: ResultWriter | None, save_map: Path | None) -> None:
        """What needs the whole run; the checkpoint goes last, when nothing else can fail."""
        if writer:
            poses = None if result.truth is None else result.truth.poses
            if result.level is not None and WORLD_NOTE in self.plan.notes:
                writer.level(self.record, result.landmarks, result.level)
            self._write_rate_poses(writer)
            writer.finish(self.record, result.landmarks, poses, result.summary, result.submaps)
        if save_map is not None and len(result.landmarks.ids):
            self.engine.saved_map().save(save_map)
        if writer and not result.summary["interrupted"]:
            writer.complete()


def _submaps(engine: SlamLike) -> SubmapPoses | None:
    """Those of an engine that has any, and can say where they are."""
    with contextlib.suppress(FilterError):
        return engine.submaps() if isinstance(engine, Slam) else None
    return None


class _Saver:
    """Writes a run's checkpoint when it is time."""

    def __init__(self, run: _Run, writer: ResultWriter) -> None:
        self._run, self._writer = run, writer
        self._count()

    def _count(self) -> None:
        self._frames, self._time = len(self._run.record), time.monotonic()

    def begin(self) -> None:
        """Before the first frame: one, if there are to be any on the way."""
        if self._run.plan.every is not None:
            self.save()

    def frame(self) -> None:
        """A frame is done."""
        every, done = self._run.plan.every, len(self._run.record) - self._frames
        if every is not None and every.is_over(done, time.monotonic() - self._time):
            self.save()

    def save(self) -> None:
        """Write a checkpoint now; raises DataError if it cannot be written."""
        run = self._run
        checkpoint = Checkpoint(
            program=version(),
            recording=fingerprint(run.recording),
            plan=run.plan.state(),
            reopen=None if run.reopen is None else run.reopen.state(),
            record=run.record.state(),
            engine=run.engine.state(),
        )
        self._writer.checkpoint(checkpoint.write)
        self._count()


def _note(step: StepResult) -> str:
    text = step.status.value
    accepted = step.diagnostics.get("accepted")
    return text if accepted is None else f"{text}, {int(accepted)} features"
