"""How a recording is opened, as one value: files, what is given beside them, worn camera, number of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from collabslam.datasets.emulated.pose_noise import PoseNoise
from collabslam.datasets.emulated.worn import WornRecording, attach_worn
from collabslam.datasets.imu.beside import GyroGiven, WornGyroGiven
from collabslam.datasets.masks import WithWornMasks
from collabslam.datasets.odometry import OdometryGiven
from collabslam.datasets.opening import open_given
from collabslam.datasets.overrides import Given
from collabslam.datasets.rig import with_rig
from collabslam.datasets.worn_calibration import CalibratedWorn, WornCalibration
from collabslam.datasets.wrapped import FirstFrames
from collabslam.formats.schema import fields, flag, items, number, optional, table, text, whole
from collabslam.types import Recording


@dataclass(frozen=True)
class WornSpec:
    """The options of `collabslam.attach_worn`, which says what they mean."""

    spec: str
    available: float = 1.0
    period: float = 5.0
    intervals: Sequence[tuple[float, float]] | None = None
    noise: PoseNoise | Sequence[float] | None = None
    seed: int = 0
    bias_per_block: bool = False

    def attach(self, recording: Recording) -> WornRecording:
        """The recording with the worn camera's views; raises as `attach_worn` does."""
        return attach_worn(recording, **vars(self))


@dataclass(frozen=True)
class Source:
    """How a recording is opened, now or when a run goes on.

    Attributes
    ----------
    path : Path
        Folder or file.
    given : Given
        Files in place of the recording's own.
    worn : WornSpec or None
        The worn camera; what the recording holds if it is None, or the second camera of its rig.
    frames : int or None
        Only so many frames from the first one on.
    worn_calibrations : mapping
        Files of `WornCalibration` that correct the worn cameras' views, by the name of whoever wears one.
    worn_masks : mapping
        Images of what is never scene in those of the worn cameras, in the same way.
    """

    path: Path
    given: Given = field(default_factory=Given)
    worn: WornSpec | None = None
    frames: int | None = None
    worn_calibrations: Mapping[str, Path] = field(default_factory=dict)
    worn_masks: Mapping[str, Path] = field(default_factory=dict)

    def open(self) -> Recording:
        """The recording.

        Raises
        ------
        DataError
            If it cannot be opened, or lacks what the worn camera needs.
        SettingsError
            If an option is not allowed.
        """
        recording: Recording = open_given(self.path, self.given)
        if self.worn is None or self.worn.spec == "recorded":
            recording = with_rig(recording)
        if self.worn is not None:
            recording = self.worn.attach(recording)
        for name, file in self.worn_calibrations.items():
            recording = CalibratedWorn(recording, WornCalibration.load(file), name)
        if self.worn_masks:
            recording = WithWornMasks(recording, self.worn_masks)
        return recording if self.frames is None else FirstFrames(recording, self.frames)

    def moved(self, path: Path) -> Source:
        """The same recording, which lies elsewhere now."""
        return dataclasses.replace(self, path=path)

    def state(self) -> dict[str, Any]:
        """In plain values with absolute paths, for a checkpoint."""
        given = {k: _absolute(v) if isinstance(v, Path) else v for k, v in vars(self.given).items()}
        return {
            "path": _absolute(self.path),
            "given": given
            | {
                "topics": dict(self.given.topics),
                "axes": dict(self.given.axes),
                "odometry": _odometry_state(self.given),
                "gyro": _gyro_state(self.given.gyro),
                "worn_gyro": _gyro_state(self.given.worn_gyro),
            },
            "worn": None if self.worn is None else self._worn_state(self.worn),
            "frames": self.frames,
            "worn_calibrations": {name: _absolute(file) for name, file in self.worn_calibrations.items()},
            "worn_masks": {name: _absolute(file) for name, file in self.worn_masks.items()},
        }

    def _worn_state(self, worn: WornSpec) -> dict[str, Any]:
        noise = dataclasses.astuple(worn.noise) if isinstance(worn.noise, PoseNoise) else worn.noise
        return {
            **vars(worn),
            "intervals": None if worn.intervals is None else [list(pair) for pair in worn.intervals],
            "noise": None if noise is None else list(noise),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Source:
        """The source of a `state` that passes `STATE`."""
        given, worn = state["given"], state["worn"]
        files = {
            k: None if given[k] is None else Path(given[k]) for k in ("camera", "times", "poses", "mask")
        }
        return cls(
            Path(state["path"]),
            Given(**{**given, **files, **_sensors_of(given)}),
            None if worn is None else WornSpec(**worn),
            state["frames"],
            {name: Path(file) for name, file in state["worn_calibrations"].items()},
            {name: Path(file) for name, file in state["worn_masks"].items()},
        )


_GYRO = optional(fields(source=optional(text()), imu=optional(text())))
STATE = fields(
    path=text(),
    given=fields(
        camera=optional(text()),
        times=optional(text()),
        poses=optional(text()),
        mask=optional(text()),
        topics=table(str, text()),
        depth_scale=optional(number(0.0)),
        axes=table(str, text()),
        gyro=_GYRO,
        worn_gyro=_GYRO,
        odometry=optional(
            fields(
                source=text(),
                mount=items(number()),
                sd=optional(items(number(0.0), 2)),
                frames=optional(items(text(), 2)),
            ),
        ),
    ),
    worn=optional(
        fields(
            spec=text(),
            available=number(0.0, 1.0),
            period=number(0.0),
            intervals=optional(items(items(number(), 2))),
            noise=optional(items(number(0.0), 4)),
            seed=whole(0),
            bias_per_block=flag,
        )
    ),
    frames=optional(whole(1)),
    worn_calibrations=table(str, text()),
    worn_masks=table(str, text()),
)
"""What `Source.state` may hold."""


def _absolute(path: Path) -> str:
    return str(path.resolve())


def _odometry_state(given: Given) -> dict[str, Any] | None:
    """In plain values; a file by its absolute path."""
    odometry = given.odometry
    if odometry is None:
        return None
    file = Path(odometry.source)
    source = _absolute(file) if file.is_file() else odometry.source
    sd = None if odometry.sd is None else list(odometry.sd)
    frames = None if odometry.frames is None else list(odometry.frames)
    return {"source": source, "mount": list(odometry.mount), "sd": sd, "frames": frames}


def _gyro_state(gyro: GyroGiven | None) -> dict[str, Any] | None:
    """In plain values; files by their absolute paths."""
    if gyro is None:
        return None
    return {k: _absolute(Path(v)) if v and Path(v).is_file() else v for k, v in vars(gyro).items()}


def _sensors_of(given: Mapping[str, Any]) -> dict[str, Any]:
    gyro = None if given["gyro"] is None else GyroGiven(**given["gyro"])
    worn_gyro = None if given["worn_gyro"] is None else WornGyroGiven(**given["worn_gyro"])
    return {"odometry": _odometry_of(given["odometry"]), "gyro": gyro, "worn_gyro": worn_gyro}


def _odometry_of(state: Mapping[str, Any] | None) -> OdometryGiven | None:
    if state is None:
        return None
    sd = None if state["sd"] is None else (float(state["sd"][0]), float(state["sd"][1]))
    frames = None if state["frames"] is None else (state["frames"][0], state["frames"][1])
    return OdometryGiven(state["source"], tuple(state["mount"]), sd, frames)
