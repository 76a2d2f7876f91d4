"""A bag's laser scans and AHRS readings, and the YAML file that says where those sensors sit."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from collabslam._core import Camera
from collabslam.datasets.gate import Keys, read_keys
from collabslam.datasets.ros.bag import Bag
from collabslam.errors import DataError, InputError
from collabslam.formats.files import write_text
from collabslam.types import Array
from collabslam.worn_pose import (
    AhrsErrors,
    AhrsReading,
    LaserScan,
    Person,
    WornPoseConfig,
    WornPoseEstimate,
    WornPoseEstimator,
    ahrs_readings,
    estimates_at,
    laser_scans,
    scanner_pose,
)
from collabslam.worn_pose.readings import Wearer

ESTIMATED = "sensors:"
"""What the role ``t_cf`` begins with where its poses are estimated; the file follows."""

_WHERE: tuple[Wearer, ...] = ("robot", "worn")
_ROTATIONS: dict[Wearer, str] = {"robot": "r_c_ahrs", "worn": "r_f_ahrs"}
_PLACED = ("ahead", "left", "up", "heading_deg")
_DEGREES = {f"{f.name}_deg": f.name for f in fields(AhrsErrors) if f.name.endswith("_sd")}
_OWN = {"scanners", "r_c_ahrs", "r_f_ahrs", "person", "ahrs", "start"}
_NUMBERS = {f.name for f in fields(WornPoseConfig)} - _OWN


class WornSensors(NamedTuple):
    """What a sensors file says.

    Attributes
    ----------
    config : WornPoseConfig
    scans : dict
        Topic of each scanner by its name.
    ahrs : dict
        Topic of the AHRS of the ``robot`` and of the ``worn`` camera.
    """

    config: WornPoseConfig
    scans: dict[str, str]
    ahrs: dict[Wearer, str]

    def only(self, *whose: Wearer) -> WornSensors:
        """The same with some of the topics: those of the ``worn`` AHRS, or of the ``robot``, scanners too."""
        ahrs = {where: topic for where, topic in self.ahrs.items() if where in whose}
        return self._replace(scans=self.scans if "robot" in whose else {}, ahrs=ahrs)


class EstimatedPoses(NamedTuple):
    """``T_CF`` estimated from scans and attitudes, with the attributes of ``bag_worn.WornPoses``."""

    config: WornPoseConfig
    scans: list[LaserScan]
    readings: list[AhrsReading]
    shift: float = 0.0
    camera: Camera | None = None

    def estimates(self, times: Array) -> list[WornPoseEstimate]:
        """One at each of increasing times."""
        return estimates_at(times.tolist(), WornPoseEstimator(self.config), self.scans, self.readings)

    def at(self, times: Array) -> tuple[Array, Array, list[Array | None]]:
        """(M, 4, 4) poses at increasing times, NaN where the person is not known, (M, 6, 6) covariances, and
        what of them lasts."""
        estimates = self.estimates(times)
        poses, covariances = np.full((len(times), 4, 4), np.nan), np.full((len(times), 6, 6), np.nan)
        for k, e in enumerate(estimates):
            if e.t_cf is not None and e.covariance is not None:
                poses[k], covariances[k] = e.t_cf, e.covariance
        return poses, covariances, [e.bias for e in estimates]


def bag_sensors(bag: Bag, sensors: WornSensors) -> EstimatedPoses:
    """The scans and attitudes of a bag.

    Raises
    ------
    DataError
        If a topic is missing, empty or of another type, or a message is not usable.
    """
    scans: list[LaserScan] = []
    readings: list[AhrsReading] = []
    try:
        for name, topic in sensors.scans.items():
            found = bag.scans(topic)
            step = float(found.angles[1] - found.angles[0]) if len(found.angles) > 1 else 0.0
            first = float(found.angles[0]) if len(found.angles) else 0.0
            scans += laser_scans(
                found.times,
                found.ranges,
                first,
                step,
                scanner=name,
                range_max=found.range_max,
                time_increment=found.time_increment,
            )
        for where, topic in sensors.ahrs.items():
            imu = bag.imu(topic)
            known = np.isfinite(imu.orientation).all(axis=1)
            if not known.any():
                raise DataError(f"The Imu messages of {topic} in {bag.path} hold no orientation.")
            readings += ahrs_readings(imu.times[known], imu.orientation[known][:, [1, 2, 3, 0]], where)
    except InputError as error:
        raise DataError(f"The sensors in {bag.path} are not usable: {error}") from error
    return EstimatedPoses(sensors.config, scans, readings)


def read_sensors(path: Path) -> WornSensors:
    """A sensors file; see the page on the worn camera for an example.

    Raises
    ------
    DataError
        If it cannot be read, a key is missing or unknown, or a value is not possible.
    """
    try:
        with read_keys(path) as keys:
            return _sensors(keys)
    except (InputError, ArithmeticError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise DataError(f"The sensors file {path} is not usable: {error}") from error


def _sensors(keys: Keys) -> WornSensors:
    scanners, scans = {}, {}
    ahrs: dict[Wearer, str] = {}
    more: dict[str, Any] = {name: keys.number(name) for name in sorted(_NUMBERS) if keys.has(name)}
    with keys.inside("scanners") as parts:
        for name in parts:
            with parts.inside(name) as part:
                scans[name], scanners[name] = str(part.need("topic")), _scanner(part)
    with keys.inside("ahrs") as parts:
        for where in _WHERE:
            with parts.inside(where) as part:
                ahrs[where] = str(part.need("topic"))
                if part.has("rotation"):
                    more[_ROTATIONS[where]] = np.asarray(part.take("rotation"), np.float64)
    with keys.inside("person") as part:
        person = {f.name: _numbers(part.take(f.name)) for f in fields(Person) if part.has(f.name)}
    with keys.inside("ahrs_errors") as part:
        drift = {name: math.radians(part.number(key)) for key, name in _DEGREES.items() if part.has(key)}
        if part.has("drift_time"):
            drift["drift_time"] = part.number("drift_time")
    start = keys.take("start")
    config = WornPoseConfig(
        scanners=scanners,
        person=Person(**person),
        ahrs=AhrsErrors(**drift),
        start=None if start is None else (float(start[0]), float(start[1])),
        **more,
    )
    return WornSensors(config, scans, ahrs)


def _numbers(value: Any) -> Any:
    return tuple(float(u) for u in value) if isinstance(value, list) else value


def write_sensors(path: Path, sensors: WornSensors) -> None:
    """A sensors file of which `read_sensors` makes the same; what is as usual is left out."""
    config = sensors.config
    mounts: dict[Wearer, Array] = {"robot": config.r_c_ahrs, "worn": config.r_f_ahrs}
    told, usual = asdict(config), asdict(WornPoseConfig())
    content: dict[str, Any] = {
        "scanners": {
            name: {"topic": sensors.scans[name], "t_c_scanner": np.asarray(pose).tolist()}
            for name, pose in config.scanners.items()
        },
        "ahrs": {
            where: {"topic": topic, "rotation": np.asarray(mounts[where]).tolist()}
            for where, topic in sensors.ahrs.items()
        },
        **{k: told[k] for k in sorted(_NUMBERS) if told[k] != usual[k]},
        "camera_height": config.camera_height,
    }
    own = {k: v for k, v in told["person"].items() if v != usual["person"][k]}
    if own:
        content["person"] = {k: list(v) if isinstance(v, tuple) else v for k, v in own.items()}
    if config.ahrs != AhrsErrors():
        turned = {key: math.degrees(told["ahrs"][name]) for key, name in _DEGREES.items()}
        content["ahrs_errors"] = {**turned, "drift_time": config.ahrs.drift_time}
    if config.start is not None:
        content["start"] = list(config.start)
    write_text(path, yaml.safe_dump(content, sort_keys=False))


def _scanner(part: Keys) -> Array:
    if part.has("t_c_scanner"):
        return np.asarray(part.numbers("t_c_scanner", count=(16,))).reshape(4, 4)
    ahead, left, up, heading = (part.number(key) if part.has(key) else 0.0 for key in _PLACED)
    return scanner_pose(ahead, left, up, math.radians(heading))
