"""Where a bag's ``T_CF`` comes from: a topic that measures it, tf, or a rig's calibration."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import load_rig
from collabslam.datasets.emulated.pose_noise import RIG_NOISE, PoseNoise
from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.printed_pose import PRINTED_ROLE
from collabslam.datasets.ros.bag import IMU_TYPE, POSE_TYPES, SCAN_TYPE, Bag
from collabslam.datasets.ros.sensors import ESTIMATED, EstimatedPoses, bag_sensors, read_sensors
from collabslam.errors import DataError, SettingsError
from collabslam.types import Array

T_CF_ROLE = (
    "pose of Cf in Cs: a PoseWithCovarianceStamped, or tf:CS:CF:METRES:DEGREES (two frames and the standard "
    "deviations that tf does not carry), or rig (by the Kalibr camchain given with --camera), or "
    "sensors:FILE (estimated from laser scans and AHRSs, where FILE says how they are mounted), or "
    f"{PRINTED_ROLE}"
)


class WornPoses(NamedTuple):
    """``T_CF`` over time.

    Attributes
    ----------
    times : (N,) seconds
        Empty if the pose is fixed.
    poses : (N, 4, 4)
        Map points of Cf into Cs; one alone if fixed.
    covariances : (N, 6, 6)
        On the right tangent; one alone if it is always the same.
    shift : float
        Seconds to add to the stamps of Cf's images.
    camera : Camera or None
        Of Cf, where the source holds it.
    """

    times: Array
    poses: Array
    covariances: Array
    shift: float = 0.0
    camera: Camera | None = None

    def at(self, times: Array) -> tuple[Array, Array, list[Array | None]]:
        """(M, 4, 4) poses, NaN outside of those measured, (M, 6, 6) covariances of the nearest ones, and None
        for what of them lasts: a bag does not say."""
        unknown: list[Array | None] = [None] * len(times)
        if not len(self.times):
            poses, covariances = (np.repeat(a, len(times), axis=0) for a in (self.poses, self.covariances))
            return poses, covariances, unknown
        nearest = np.argmin(np.abs(self.times - times[:, None]), axis=1)
        rows = nearest if len(self.covariances) > 1 else np.zeros_like(nearest)
        poses = interpolate_track(self.times, self.poses, times)
        exact = self.times[nearest] == times  # then not even the rounding of an interpolation
        poses[exact] = self.poses[nearest[exact]]
        return poses, self.covariances[rows], unknown


def worn_poses(
    bag: Bag, source: str | None, calibration: Path | None, topics: tuple[str, str]
) -> WornPoses | EstimatedPoses:
    """``T_CF`` of a bag.

    Parameters
    ----------
    bag
    source
        As `T_CF_ROLE` says; the only topic of poses with covariance if left out.
    calibration
        The file of ``--camera``.
    topics : (str, str)
        Of the images of Cs and of Cf.

    Raises
    ------
    DataError
        If the source is missing, empty, or not as described.
    SettingsError
        If the standard deviations are not allowed.
    """
    if source is not None and source.startswith(ESTIMATED):
        return bag_sensors(bag, read_sensors(Path(source.removeprefix(ESTIMATED))))
    if source == "rig":
        if calibration is None:
            raise DataError("t_cf=rig needs the Kalibr camchain of both cameras; give it with --camera FILE.")
        camera, t_cf, shift = load_rig(calibration, topics)
        return WornPoses(np.empty(0), t_cf[None], RIG_NOISE.covariance[None], shift, camera)
    if source is not None and source.startswith("tf:"):
        parent, child, noise = _tf(source)
        return WornPoses(*bag.transforms(parent, child), noise.covariance[None])
    return WornPoses(*bag.poses(source or _only_poses(bag)))


def _tf(source: str) -> tuple[str, str, PoseNoise]:
    parts = source.split(":")
    try:
        _, parent, child, metres, degrees = parts
        sd = (float(metres), *[float(degrees)] * 3)
    except ValueError:
        raise SettingsError(
            f"The pose '{source}' is not understood; give tf:CS:CF:METRES:DEGREES, such as "
            "tf:cs_optical:cf_optical:0.03:1.0."
        ) from None
    if not min(sd) > 0.0:
        raise SettingsError(f"The standard deviations of '{source}' must be above zero.")
    return parent, child, PoseNoise(*sd)


def _only_poses(bag: Bag) -> str:
    found = [t.name for t in bag.of_type(*POSE_TYPES)]
    if len(found) != 1:
        raise DataError(
            f"The bag {bag.path} has {len(found)} topics of poses with covariance; say which measures the "
            f"worn camera with --topics t_cf=TOPIC, or take it from tf{_sensors(bag)}: "
            f"{', '.join(found) or 'none'}."
        )
    return found[0]


def _sensors(bag: Bag) -> str:
    there = bag.of_type(SCAN_TYPE) and bag.of_type(IMU_TYPE)
    return ", or estimate it from its laser scans and AHRSs with t_cf=sensors:FILE" if there else ""
