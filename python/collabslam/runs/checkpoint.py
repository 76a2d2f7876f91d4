"""A run that was stopped, in one file: the engine, what was reported, and of which recording."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.errors import DataError, SettingsError
from collabslam.formats.container import read_container, write_container
from collabslam.runs.results import CHECKPOINT, SUMMARY
from collabslam.slam import engine
from collabslam.types import Recording
from collabslam.version import version

KIND, VERSION = "run checkpoint", 1
"""The version counts the changes of what a checkpoint holds; the engine's own state has another one."""


@dataclass(frozen=True)
class Checkpoint:
    """Everything that a run needs to go on.

    Attributes
    ----------
    program : str
        Version of collabslam.
    recording : dict
        What tells the recording from others; see `fingerprint`.
    plan : dict
        Mode, start, settings and whatever else the run was asked for.
    reopen : dict
        How the recording is opened again; empty if only the caller knows.
    record : dict
        State of the `RunRecord`; its length is the number of frames that are done.
    engine : dict
        State of the `Slam`.
    """

    program: str
    recording: dict[str, Any]
    plan: dict[str, Any]
    reopen: dict[str, Any]
    record: dict[str, Any]
    engine: dict[str, Any]

    def write(self, path: Path) -> None:
        """Write it in one piece; raises DataError if the file cannot be written."""
        content = {f.name: getattr(self, f.name) for f in fields(self)}
        write_container(path, KIND, VERSION, content, engine.CLASSES)

    @classmethod
    def read(cls, folder: Path) -> Checkpoint:
        """The checkpoint of a result folder.

        Raises
        ------
        DataError
            If there is none, or it is cut short, altered, or of another version.
        """
        path = folder / CHECKPOINT
        if not path.is_file():
            done = "its run is finished" if (folder / SUMMARY).is_file() else "run it with --checkpoint-every"
            raise DataError(f"The folder {folder} holds no checkpoint to go on from; {done}.")
        content = read_container(path, KIND, VERSION, engine.CLASSES)
        try:
            checkpoint = cls(**content)
        except TypeError as error:
            raise DataError(f"The file {path} holds no checkpoint; start the run again.") from error
        if checkpoint.program != version():
            raise DataError(
                f"The file {path} is of collabslam {checkpoint.program}, this is {version()}; results would "
                "not be those of one program. Go on with that one, or start the run again."
            )
        return checkpoint

    def check_recording(self, recording: Recording) -> None:
        """Raises DataError if this is another recording than the run's."""
        now = fingerprint(recording)
        for name, what in _WHAT.items():
            if not _equal(now[name], self.recording.get(name)):
                raise DataError(
                    f"The recording {recording.source} has other {what} than the run that is to go on; give "
                    "the same recording."
                )


_WHAT = {"times": "time stamps", "camera": "calibration of Cs", "worn_camera": "calibration of Cf"}


def fingerprint(recording: Recording) -> dict[str, Any]:
    """Time stamps and calibrations, by which a recording is known again wherever it lies."""
    worn = recording.worn_camera
    return {
        "times": np.asarray(recording.times, np.float64),
        "camera": repr(recording.camera),
        "worn_camera": None if worn is None else repr(worn),
    }


def _equal(a: Any, b: Any) -> bool:
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else bool(a == b)


@dataclass(frozen=True)
class Interval:
    """How often a checkpoint is written: every so many frames, or seconds of the clock."""

    frames: int | None = None
    seconds: float | None = None

    @classmethod
    def parse(cls, value: int | str | Interval) -> Interval:
        """``100`` or ``"100"``: frames; ``"30s"``: seconds.

        Raises
        ------
        SettingsError
            If it is none of them, or not above zero.
        """
        if isinstance(value, Interval):
            return value
        text = str(value).strip()
        try:
            if text.endswith("s"):
                seconds = float(text[:-1])
                if 0.0 < seconds < float("inf"):
                    return cls(seconds=seconds)
            elif int(text) > 0:
                return cls(frames=int(text))
        except ValueError:
            pass
        raise SettingsError(f"A checkpoint every '{value}' is not understood; give frames as 100, or 30s.")

    def is_over(self, frames: int, seconds: float) -> bool:
        """Whether it is time, so many frames and seconds after the last checkpoint."""
        if self.frames is not None:
            return frames >= self.frames
        return self.seconds is not None and seconds >= self.seconds
