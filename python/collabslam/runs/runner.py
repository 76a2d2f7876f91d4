"""One recording through the filter, from the first frame to the result folder."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from collabslam.errors import DataError, SettingsError
from collabslam.evaluation.record import Landmarks, RunRecord, Step, status_name
from collabslam.evaluation.scoring import AlignedTruth, align_truth, score
from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.runs.checkpoint import Checkpoint, Interval, fingerprint
from collabslam.runs.progress import Progress
from collabslam.runs.results import ResultWriter, jsonable
from collabslam.runs.stamps import usable_frames
from collabslam.settings.modes import STARTS
from collabslam.settings.table import Settings
from collabslam.types import Frame, Image, Recording, WornView
from collabslam.version import version

if TYPE_CHECKING:
    from collabslam.slam.saved_map import SavedMap

MODE_KEY = "filter.estimator.mode"
LEAST_OK_SHARE = 0.5
"""A run with a smaller share of OK frames counts as having lost the camera."""

Summary = dict[str, Any]


class SlamLike(Protocol):
    """What a run asks of the engine."""

    def step(self, t: float, image: Image, worn: WornView | None = None) -> Step: ...
    def landmarks(self) -> Landmarks: ...


@runtime_checkable
class MapKeeper(Protocol):
    """An engine whose map can be saved."""

    def saved_map(self) -> SavedMap: ...


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
    """

    summary: Summary
    record: RunRecord
    truth: AlignedTruth | None
    landmarks: Landmarks


def run(
    source: Recording | str | Path,
    *,
    worn: str | None = None,
    available: float = 1.0,
    mode: str | None = None,
    start: str | None = None,
    settings: Settings | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    max_frames: int | None = None,
    progress: bool = False,
    options: Mapping[str, Any] | None = None,
    slam: SlamLike | None = None,
    watch: Watch | None = None,
    checkpoint_every: int | str | None = None,
    reopen: Mapping[str, Any] | None = None,
    map: SavedMap | str | Path | None = None,
    save_map: str | Path | None = None,
) -> RunResult:
    """Run a recording through the filter and score it.

    Ctrl-C ends the run early; what was done until then is scored and written, and marked ``interrupted``.
    With ``checkpoint_every`` a run that was stopped, whatever stopped it, goes on with `resume`.
    Frames whose time stamps repeat or go back are left out and counted as ``frames_out_of_order``; a clock
    that was set back is set forward again (see `collabslam.runs.stamps.usable_frames`).

    Parameters
    ----------
    source : Recording, str or Path
        A recording, or where one lies; see `collabslam.open_recording`.
    worn : str, optional
        Where the worn camera's views come from, and ``available``, the share of time that it is there: see
        `collabslam.attach_worn`, which knows more options.  What the recording holds if left out.
    mode : str, optional
        One of `collabslam.settings.modes.MODES`; the settings' ``filter.estimator.mode`` if left out,
        or ``mono`` if there is no worn camera.
    start : str, optional
        One of `collabslam.settings.modes.STARTS`; the first of them that the recording allows if left out.
    settings : Settings, optional
        The defaults if left out.
    out : str or Path, optional
        Result folder; nothing is written if left out.
    seed : int
        Of the worn camera's noise.
    max_frames : int, optional
        Stop after so many frames.
    progress : bool
        Whether to show progress on standard error.
    options : mapping, optional
        Further facts for the summary, such as how the worn camera was emulated.
    slam : SlamLike, optional
        An engine of one's own in place of `collabslam.slam.engine.Slam`.
    watch : callable, optional
        Is given each frame, the engine's answer and the engine, as `viz.rerun_log.RerunLog.frame` is.
    checkpoint_every : int or str, optional
        Write a checkpoint into ``out`` before the first frame and after so many (``100``), or seconds of the
        clock (``"30s"``).
    reopen : mapping, optional
        Kept in the checkpoint for whoever opens the recording again; how ``source`` is opened if left out.
    map : SavedMap, str or Path, optional
        A map of an earlier run, or its file: the run starts in it, ``start`` is ``map``.
    save_map : str or Path, optional
        File for the map at the end of the run, to start in later.

    Raises
    ------
    DataError
        If the recording or the map cannot be read, the recording breaks off, or ``out`` cannot be used.
    InputError
        If there is no map to save.
    SettingsError
        If an option is not allowed.
    """
    if reopen is None and isinstance(source, str | Path):
        path = str(Path(source).resolve())
        reopen = {"source": path, "worn": worn, "available": available, "seed": seed}
    recording = _recording(source, worn, available, seed)
    settings = settings or Settings.default()
    mode = mode or default_mode(recording, settings)
    map = map_to_start_in(map, start)
    start = start or ("map" if map is not None else default_start(recording))
    settings = settings.replace({MODE_KEY: mode})
    metric = start != "scale-free" if map is None else map.metric
    plan = {
        "mode": mode,
        "start": start,
        "metric": metric,
        "settings": dict(settings.values),
        "frames": _frame_count(len(recording), max_frames),
        "seed": seed,
        "options": jsonable(options or {}),
        "every": None if checkpoint_every is None else str(checkpoint_every),
        "save_map": None if save_map is None else str(Path(save_map).resolve()),
    }
    engine = slam or make_engine(recording, mode=mode, start=start, settings=settings, map=map)
    if checkpoint_every is not None and (out is None or slam is not None):
        raise SettingsError(
            "A checkpoint needs a result folder, and an engine of collabslam's own; give --out."
        )
    folder = None if out is None else Path(out)
    stopped = _Stopped(plan, dict(reopen or {}), engine, RunRecord())
    return _go(recording, stopped, folder, resumed=False, progress=progress, watch=watch)


def resume(
    out: str | Path,
    recording: Recording | None = None,
    *,
    checkpoint_every: int | str | None = None,
    progress: bool = False,
    watch: Watch | None = None,
) -> RunResult:
    """Go on with a run that was stopped, from its last checkpoint; the results are those of one that was not.

    Parameters
    ----------
    out : str or Path
        Its result folder.
    recording : Recording, optional
        The same recording; opened as `run` did if left out.
    checkpoint_every : int or str, optional
        As for `run`; as before if left out.
    progress, watch
        As for `run`.

    Raises
    ------
    DataError
        If there is no checkpoint, it is cut short, altered or of another version, or the recording is
        another.
    """
    folder = Path(out)
    checkpoint = Checkpoint.read(folder)
    plan = checkpoint.plan | ({} if checkpoint_every is None else {"every": str(checkpoint_every)})
    if recording is None:
        if set(checkpoint.reopen) != {"source", "worn", "available", "seed"}:
            raise DataError("The run does not know how its recording was opened; give the recording.")
        recording = _recording(**checkpoint.reopen)
    checkpoint.check_recording(recording)
    from collabslam.slam.engine import Slam

    engine, record = Slam.from_state(checkpoint.engine), RunRecord.from_state(checkpoint.record)
    stopped = _Stopped(plan, checkpoint.reopen, engine, record)
    return _go(recording, stopped, folder, resumed=True, progress=progress, watch=watch)


@dataclass
class _Stopped:
    """A run between two frames."""

    plan: dict[str, Any]
    reopen: dict[str, Any]
    engine: Any
    record: RunRecord

    def checkpoint(self, recording: Recording) -> Checkpoint:
        return Checkpoint(
            program=version(),
            recording=fingerprint(recording),
            plan=self.plan,
            reopen=self.reopen,
            record=self.record.state(),
            engine=self.engine.state(),
        )


def _go(
    recording: Recording,
    run: _Stopped,
    out: Path | None,
    *,
    resumed: bool,
    progress: bool,
    watch: Watch | None,
) -> RunResult:
    """From where the run stands to its end."""
    plan, engine, record = run.plan, run.engine, run.record
    mode, start, frames = plan["mode"], plan["start"], plan["frames"]
    settings = Settings.from_flat(plan["settings"])
    every = None if plan["every"] is None else Interval.parse(plan["every"])
    usable, times = usable_frames(recording.times[:frames])
    truth_of_usable = None if recording.truth is None else recording.truth[usable]
    unit, interrupted = METRES if plan["metric"] else ARBITRARY, False
    title = f"as used by {recording.name}, mode {mode}"
    with contextlib.ExitStack() as stack:
        writer = None
        if out:
            config = settings.dump(title=title)
            writer = stack.enter_context(ResultWriter(out, config, unit, record if resumed else None))
        saver = _Saver(writer, every, run, recording) if writer and every else None
        label = f"{recording.name} {mode}"
        bar = stack.enter_context(Progress(len(usable), label, enabled=progress, done=len(record)))
        try:
            if saver and not resumed:
                saver.save()
            left = slice(len(record), None)
            for i, t in zip(usable[left].tolist(), times[left].tolist(), strict=True):
                frame = recording.frame(i)
                began = time.perf_counter()
                step = engine.step(t, frame.image, frame.worn)
                record.append(step, worn=frame.worn is not None, seconds=time.perf_counter() - began)
                if writer:
                    writer.frame(record)
                if saver:
                    saver.frame()
                if watch is not None:
                    watch(frame, step, engine)
                bar.update(_note(step))
        except KeyboardInterrupt:
            interrupted = True
        truth, landmarks = align_truth(record, truth_of_usable), engine.landmarks()
        summary: Summary = {
            **score(record, truth_of_usable, metric=unit == METRES),
            **_timing(record),
            "mode": mode,
            "start": start,
            "unit": unit,
            "recording": recording.name,
            "source": recording.source,
            "seed": plan["seed"],
            "version": version(),
            "interrupted": interrupted,
            "frames_available": len(recording),
            "frames_out_of_order": frames - len(usable),
            "frames_unseen": int(np.nansum(record.diagnostic("unseen"))),
            "map_size_final": len(landmarks.ids),
            "settings_hash": settings.hash(),
            "options": plan["options"],
        }
        result = RunResult(summary, record, truth, landmarks)
        if writer:
            writer.finish(record, landmarks, None if truth is None else truth.poses, summary)
            if not interrupted:
                writer.complete()
    if plan["save_map"] is not None and isinstance(engine, MapKeeper):
        engine.saved_map().save(plan["save_map"])
    return result


class _Saver:
    """Writes a run's checkpoint when it is time."""

    def __init__(self, writer: ResultWriter, every: Interval, run: _Stopped, recording: Recording) -> None:
        self._writer, self._every, self._run, self._recording = writer, every, run, recording
        self._begin()

    def _begin(self) -> None:
        self._frames, self._time = len(self._run.record), time.monotonic()

    def frame(self) -> None:
        """A frame is done."""
        if self._every.is_over(len(self._run.record) - self._frames, time.monotonic() - self._time):
            self.save()

    def save(self) -> None:
        """Write a checkpoint now."""
        self._writer.checkpoint(self._run.checkpoint(self._recording).write)
        self._begin()


def default_mode(recording: Recording, settings: Settings) -> str:
    """The mode that the settings name, or ``mono`` if it needs a worn camera and there is none."""
    mode = str(settings[MODE_KEY])
    return "mono" if recording.worn_camera is None and mode.startswith("collab") else mode


def default_start(recording: Recording) -> str:
    """The first way to start that the recording allows."""
    if recording.worn_camera is not None:
        return "worn"
    return "scale-free" if recording.target is None else "target"


def map_to_start_in(map: SavedMap | str | Path | None, start: str | None) -> SavedMap | None:
    """The map that a run starts in, read if need be; SettingsError if it goes with another start."""
    if (map is None) != (start != "map") and not (map is not None and start is None):
        raise SettingsError(
            "The start 'map' needs a map; give one with --map."
            if map is None
            else f"A map was given but the start is '{start}'; leave the start out."
        )
    if not isinstance(map, str | Path):
        return map
    from collabslam.slam.saved_map import SavedMap

    return SavedMap.load(map)


def _recording(source: Recording | str | Path, worn: str | None, available: float, seed: int) -> Recording:
    if not isinstance(source, str | Path) and worn is None:
        return source
    from collabslam.datasets import attach_worn, open_recording

    recording = open_recording(source) if isinstance(source, str | Path) else source
    return recording if worn is None else attach_worn(recording, worn, available=available, seed=seed)


def make_engine(
    recording: Recording, *, mode: str, start: str, settings: Settings, map: SavedMap | None = None
) -> SlamLike:
    """The engine for a recording; raises SettingsError where mode or start do not fit the recording."""
    if start not in STARTS and map is None:
        raise SettingsError(f"The start '{start}' does not exist; give one of: {', '.join(STARTS)}.")
    if recording.worn_camera is None and (start == "worn" or mode.startswith("collab")):
        what = "start 'worn'" if start == "worn" else f"mode '{mode}'"
        raise SettingsError(
            f"The {what} needs a worn camera and {recording.name} has none; emulate one with --worn, "
            "or give --mode mono with --start scale-free or target."
        )
    if start == "target" and recording.target is None:
        raise SettingsError(
            f"The start 'target' needs a known target and {recording.name} has none; give another --start."
        )
    from collabslam.slam.engine import Slam

    slam: SlamLike = Slam(
        recording.camera,
        recording.worn_camera,
        settings=settings,
        mode=mode,
        start=start,
        target=recording.target if start == "target" else None,
        map=map,
    )
    return slam


def exit_status(summary: Summary) -> int:
    """0 for a good run, 1 if the camera was lost at the end or for more than half of the frames."""
    share = summary["ok_share"]
    lost = summary["status_final"] == "LOST" or share is None or share < LEAST_OK_SHARE
    return int(lost)


def _frame_count(available: int, max_frames: int | None) -> int:
    if max_frames is not None and max_frames < 1:
        raise SettingsError(f"The largest number of frames is {max_frames}; give 1 or more.")
    return available if max_frames is None else min(available, max_frames)


def _note(step: Step) -> str:
    text = status_name(step.status) if step.started else "not started"
    accepted = step.diagnostics.get("accepted")
    return text if accepted is None else f"{text}, {int(accepted)} features"


def _timing(record: RunRecord) -> Summary:
    """Mean milliseconds per stage, and frames per second without reading or rendering images."""
    stages = sorted({k for s in record.steps for k in s.diagnostics if k.startswith("ms_")})
    means = {}
    for key in stages:
        values = record.diagnostic(key)
        if np.isfinite(values).any():
            means[key.removeprefix("ms_")] = float(np.nanmean(values))
    total = float(np.sum(record.seconds))
    if len(record):
        means["step"] = 1e3 * total / len(record)
    return {"ms_per_frame": means, "fps": len(record) / total if total > 0.0 else None}
