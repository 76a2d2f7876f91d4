"""A run that was stopped, in one file: the engine, what was reported, and of which recording."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.datasets.source import STATE as SOURCE_STATE
from collabslam.datasets.source import Source
from collabslam.errors import CollabslamError, DataError
from collabslam.evaluation.record import RunRecord
from collabslam.formats import schema
from collabslam.formats.container import read_container, write_container
from collabslam.runs.plan import PLAN_STATE, Plan
from collabslam.runs.results import CHECKPOINT, SUMMARY
from collabslam.slam.consistency_monitor import CAUSES, NOTHING
from collabslam.slam.engine import Slam
from collabslam.slam.saving import CLASSES
from collabslam.types import Array, Recording, Status, worn_cameras
from collabslam.version import version

KIND, VERSION = "run checkpoint", 17
"""The version counts the changes of what a checkpoint holds; the engine's own state has another one."""

_COLUMN = schema.any_of(
    schema.array("<f8", None, nan=True),
    schema.array("<i8", None),
    schema.items(
        schema.optional(schema.any_of(schema.flag, schema.number(nan=True), schema.text((NOTHING, *CAUSES))))
    ),
)
_RECORD = schema.fields(
    times=schema.array("<f8", None),
    poses=schema.array("<f8", None, 4, 4, nan=True),
    covariances=schema.array("<f8", None, 6, 6, nan=True),
    statuses=schema.items(schema.text([s.value for s in Status])),
    usable=schema.array("|b1", None),
    started=schema.array("|b1", None),
    metric=schema.array("|b1", None),
    scale_sds=schema.array("<f8", None, nan=True),
    poses_map=schema.array("<f8", None, 4, 4, nan=True),
    covariances_map=schema.array("<f8", None, 6, 6, nan=True),
    worn=schema.array("|b1", None),
    seconds=schema.array("<f8", None),
    diagnostics=schema.table(str, _COLUMN),
    places=schema.table(
        str,
        schema.fields(
            frames=schema.array("<i8", None),
            times=schema.array("<f8", None),
            poses=schema.array("<f8", None, 4, 4),
            covariances=schema.array("<f8", None, 6, 6),
            measured=schema.array("|b1", None),
            matches=schema.array("<i8", None),
            clocks=schema.array("<f8", None, 2, nan=True),
        ),
    ),
)


def _check_record(value: Any, where: str) -> None:
    """State of a `RunRecord`: rows of one length, stamps that increase, proper poses and covariances."""
    _RECORD(value, where)
    count = len(value["times"])
    if {len(column) for column in (*value["diagnostics"].values(), *_columns(value))} - {count}:
        schema.refuse(where, f"a record of {count} frames")
    if not (np.diff(value["times"]) > 0.0).all():
        schema.refuse(f"{where}.times", "an increasing series")
    for name in ("poses", "poses_map"):
        for pose in value[name][np.isfinite(value[name]).all(axis=(1, 2))]:
            schema.pose(pose, f"{where}.{name}")
    for name in ("covariances", "covariances_map"):
        _check_covariances(value[name], f"{where}.{name}")
    for name, places in value["places"].items():
        _check_places(places, count, f"{where}.places.{name}")


def _check_covariances(value: Array, where: str) -> None:
    """(N, 6, 6) of which the finite ones are covariances."""
    known = value[np.isfinite(value).all(axis=(1, 2))]
    for covariance in known:
        schema.covariance(6)(covariance, where)
    variances = np.linalg.eigvalsh(known)
    if (variances[:, 0] < -1e-6 * variances[:, -1]).any():
        schema.refuse(where, "a covariance")


def _check_places(places: dict[str, Any], count: int, where: str) -> None:
    """Where a worn camera was: rows of one length, each of a later frame, proper poses and covariances."""
    frames = places["frames"]
    if len({len(column) for column in places.values()}) != 1:
        schema.refuse(where, "columns of one length")
    if not (np.diff(frames) > 0).all() or (len(frames) and not 0 <= frames[0] <= frames[-1] < count):
        schema.refuse(f"{where}.frames", "frames of the record in their order")
    for pose, covariance in zip(places["poses"], places["covariances"], strict=True):
        schema.pose(pose, f"{where}.poses")
        schema.covariance(6)(covariance, f"{where}.covariances")


def _columns(record: dict[str, Any]) -> list[Any]:
    return [column for name, column in record.items() if name not in ("diagnostics", "places")]


CONTENT = schema.fields(
    program=schema.text(),
    recording=schema.fields(
        times=schema.array("<f8", None, nan=True),
        camera=schema.text(),
        worn_cameras=schema.table(str, schema.text()),
    ),
    plan=PLAN_STATE,
    reopen=schema.optional(SOURCE_STATE),
    record=_check_record,
    engine=schema.table(str, lambda value, where: None),  # the engine asks by itself
)
"""What a checkpoint may hold."""


@dataclass(frozen=True)
class Checkpoint:
    """Everything that a run needs to go on; it names no file that is written to.

    Attributes
    ----------
    program : str
        Version of collabslam.
    recording : dict
        What tells the recording from others; see `fingerprint`.
    plan : dict
        State of the `Plan`.
    reopen : dict or None
        State of the `Source`; None if only the caller knows how the recording is opened.
    record : dict
        State of the `RunRecord`; its length is the number of frames that are done.
    engine : dict
        State of the `Slam`.
    """

    program: str
    recording: dict[str, Any]
    plan: dict[str, Any]
    reopen: dict[str, Any] | None
    record: dict[str, Any]
    engine: dict[str, Any]

    def write(self, path: Path) -> None:
        """Write it in one piece; raises DataError if the file cannot be written."""
        content = {f.name: getattr(self, f.name) for f in fields(self)}
        write_container(path, KIND, VERSION, content, CLASSES)

    @classmethod
    def read(cls, folder: Path) -> Checkpoint:
        """The checkpoint of a result folder.

        Raises
        ------
        DataError
            If there is none, or it is cut short, altered, or of another version.
        """
        path = folder / CHECKPOINT
        if not path.exists():
            done = "its run is finished" if (folder / SUMMARY).is_file() else "run it with --checkpoint-every"
            raise DataError(f"The folder {folder} holds no checkpoint to go on from; {done}.")
        content = read_container(path, KIND, VERSION, CLASSES)
        try:
            CONTENT(content, "checkpoint")
        except DataError as error:
            raise DataError(f"The file {path} holds no checkpoint. {error}") from error
        checkpoint = cls(**content)
        if checkpoint.program != version():
            raise DataError(
                f"The file {path} is of collabslam {checkpoint.program}, this is {version()}; results would "
                "not be those of one program. Go on with that one, or start the run again."
            )
        return checkpoint

    def source(self) -> Source:
        """How the recording is opened again; raises DataError if only who started the run knows."""
        if self.reopen is None:
            raise DataError("The run does not know how its recording was opened; give the recording.")
        return Source.from_state(self.reopen)

    def restored(self, recording: Recording) -> tuple[Plan, Slam, RunRecord]:
        """The run as it stood.

        Raises
        ------
        DataError
            If the recording is another than the run's, or parts of the checkpoint do not fit together.
        """
        self._check_recording(recording)
        try:
            plan = Plan.from_state(self.plan)
            record = RunRecord.from_state(self.record)
            return plan, Slam.from_state(self.engine), record
        except CollabslamError as error:
            raise DataError(f"The checkpoint cannot be used. {error}") from error

    def _check_recording(self, recording: Recording) -> None:
        now = fingerprint(recording)
        for name, what in _WHAT.items():
            if not _equal(now[name], self.recording[name]):
                raise DataError(
                    f"The recording {recording.source} has other {what} than the run that is to go on; give "
                    "the same recording."
                )


_WHAT = {"times": "time stamps", "camera": "calibration of Cs", "worn_cameras": "calibration of Cf"}


def fingerprint(recording: Recording) -> dict[str, Any]:
    """Time stamps and calibrations, by which a recording is known again wherever it lies."""
    return {
        "times": np.asarray(recording.times, np.float64),
        "camera": repr(recording.camera),
        "worn_cameras": {name: repr(worn) for name, worn in worn_cameras(recording).items()},
    }


def _equal(a: Any, b: Any) -> bool:
    return np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else bool(a == b)
