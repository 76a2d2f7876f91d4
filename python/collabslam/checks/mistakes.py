"""The usual mistakes in poses and cameras, each with what undoes it.

A check undoes one after the other and asks the images.  `undo` maps a pose as it was given to the pose that
was meant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.poses import BODY_FROM_OPTICAL, OPENGL_FROM_OPTICAL
from collabslam.geometry import pose, pose_inverse, quaternion_wxyz, rotation_from_quaternion
from collabslam.types import Array, Image

OPTICAL_FROM_BODY = BODY_FROM_OPTICAL.T


class PoseMistake(NamedTuple):
    """``fault`` is what is wrong with the poses and ``remedy`` what to do, both parts of a sentence."""

    fault: str
    remedy: str
    undo: Callable[[Array], Array]


def undone(mistake: PoseMistake | None, t: Array) -> Array:
    """The (4, 4) pose that was meant by the one that was given, if a mistake was made."""
    return t if mistake is None else mistake.undo(t)


def _reordered(order: tuple[int, ...]) -> Callable[[Array], Array]:
    def undo(t: Array) -> Array:
        quaternion = quaternion_wxyz(t[:3, :3])[list(order)]
        return pose(rotation_from_quaternion(quaternion), t[:3, 3])

    return undo


QUATERNIONS = (
    PoseMistake(
        "the quaternions were written w x y z where x y z w is read",
        "write them as x y z w",
        _reordered((1, 2, 3, 0)),
    ),
    PoseMistake(
        "the quaternions were written x y z w where w x y z is read",
        "write them as w x y z",
        _reordered((3, 0, 1, 2)),
    ),
)

WORN_POSE_MISTAKES = (
    PoseMistake("T_CF is inverted: it maps from Cs to Cf", "give its inverse, from Cf to Cs", pose_inverse),
    PoseMistake(
        "T_CF is along ROS body axes (x forward, y left, z up)",
        "give --t-cf-axes ros, or turn its frames to optical axes (x right, y down, z forward)",
        lambda t: OPTICAL_FROM_BODY @ t @ BODY_FROM_OPTICAL,
    ),
    PoseMistake(
        "T_CF was turned to optical axes although it had them",
        "give it as it is measured between the optical frames",
        lambda t: BODY_FROM_OPTICAL @ t @ OPTICAL_FROM_BODY,
    ),
    PoseMistake(
        "T_CF leads into Cs's body axes (x forward, y left, z up)",
        "turn its robot side to optical axes (x right, y down, z forward)",
        lambda t: OPTICAL_FROM_BODY @ t,
    ),
    PoseMistake(
        "T_CF starts from Cf's body axes (x forward, y left, z up)",
        "turn its worn side to optical axes (x right, y down, z forward)",
        lambda t: t @ BODY_FROM_OPTICAL,
    ),
    PoseMistake(
        "the robot side of T_CF was turned to optical axes although it had them",
        "leave it as it is measured",
        lambda t: BODY_FROM_OPTICAL @ t,
    ),
    PoseMistake(
        "the worn side of T_CF was turned to optical axes although it had them",
        "leave it as it is measured",
        lambda t: t @ OPTICAL_FROM_BODY,
    ),
    PoseMistake(
        "T_CF is along OpenGL's axes (x right, y up, z back) of both cameras",
        "give --t-cf-axes opengl",
        lambda t: OPENGL_FROM_OPTICAL @ t @ OPENGL_FROM_OPTICAL,
    ),
    *QUATERNIONS,
)

TRUE_POSE_MISTAKES = (
    PoseMistake(
        "the true poses are inverted: they map from the world to the camera", "give T_WC", pose_inverse
    ),
    PoseMistake(
        "the true poses are of ROS body axes (x forward, y left, z up)",
        "give --poses-axes ros, or those of the camera's optical frame (x right, y down, z forward)",
        lambda t: t @ BODY_FROM_OPTICAL,
    ),
    PoseMistake(
        "the true poses are of OpenGL's axes (x right, y up, z back)",
        "give --poses-axes opengl",
        lambda t: t @ OPENGL_FROM_OPTICAL,
    ),
    PoseMistake(
        "the true poses were turned to optical axes although they had them",
        "give them as they were measured",
        lambda t: t @ OPTICAL_FROM_BODY,
    ),
    *QUATERNIONS,
)


_HALF_TURN_X, _HALF_TURN_Z = np.diag([1.0, -1.0, -1.0, 1.0]), np.diag([-1.0, -1.0, 1.0, 1.0])

MOUNT_MISTAKES = (
    PoseMistake(
        "the odometry's T_BC is inverted: it maps from its frame B to Cs",
        "give its inverse, from Cs to B (with tf: exchange the two frames)",
        pose_inverse,
    ),
    PoseMistake(
        "the odometry's T_BC is that of Cs's body axes (x forward, y left, z up)",
        "give that of its optical frame (x right, y down, z forward)",
        lambda t: t @ BODY_FROM_OPTICAL,
    ),
    PoseMistake(
        "the odometry's T_BC is inverted, and of Cs's body axes (x forward, y left, z up)",
        "give where the optical frame of Cs (x right, y down, z forward) is in B",
        lambda t: pose_inverse(t) @ BODY_FROM_OPTICAL,
    ),
    PoseMistake(
        "the odometry's T_BC was turned to optical axes although it had them",
        "give it as it is measured",
        lambda t: t @ OPTICAL_FROM_BODY,
    ),
    PoseMistake(
        "the odometry's T_BC is of OpenGL's axes of Cs (x right, y up, z back)",
        "give that of its optical frame (x right, y down, z forward)",
        lambda t: t @ OPENGL_FROM_OPTICAL,
    ),
    PoseMistake(
        "the odometry's twists are along optical axes (x right, y down, z forward)",
        "write them along x forward, y left, z up, or turn T_BC into their axes",
        lambda t: OPTICAL_FROM_BODY @ t,
    ),
    PoseMistake(
        "the odometry's twists are along x forward, y right, z down: it turns positive to the right",
        "negate vy, vz, wy and wz, or tell that Cs hangs upside down (a roll of 180 degrees)",
        lambda t: _HALF_TURN_X @ t,
    ),
    PoseMistake(
        "the odometry's x points back where Cs looks ahead",
        "negate vx, vy, wx and wy, or tell that Cs looks back (a yaw of 180 degrees)",
        lambda t: _HALF_TURN_Z @ t,
    ),
)


def body_mistakes(t_bs: Array | None) -> tuple[PoseMistake, ...]:
    """Of true poses that were a body's and became the camera's by ``T_BS`` (4, 4); none without one."""
    if t_bs is None:
        return ()
    back = pose_inverse(t_bs)
    return (
        PoseMistake(
            "T_BS of Cs is inverted: it maps from the body to the camera",
            "give its inverse",
            lambda t: t @ back @ back,
        ),
        PoseMistake(
            "the true poses are those of the camera, not of the body",
            "give T_BS as the identity",
            lambda t: t @ back,
        ),
    )


def rig_mistakes(t_bs: Array | None) -> tuple[PoseMistake, ...]:
    """Of T_CF by the ``T_BS`` (4, 4) of both cameras, of which that of Cs is given; none without one."""
    if t_bs is None:
        return ()
    fault = "T_BS of both cameras are inverted: they map from the body to the camera"
    return (PoseMistake(fault, "give their inverses", lambda t: t_bs @ pose_inverse(t) @ pose_inverse(t_bs)),)


@dataclass(frozen=True)
class MirroredCamera:
    """A camera together with how its images have to be turned before its calibration holds.

    Attributes
    ----------
    camera : Camera
    across, down : bool
        Whether the images are mirrored left to right, and upside down.
    """

    camera: Camera
    across: bool = False
    down: bool = False

    def points(self, uv: Array) -> Array:
        """(N, 2) px of the images as they are, where the calibration has them."""
        out = np.array(uv)
        if self.across:
            out[:, 0] = self.camera.width - 1 - out[:, 0]
        if self.down:
            out[:, 1] = self.camera.height - 1 - out[:, 1]
        return out

    def rays(self, uv: Array) -> Array:
        """(N, 3) rays with z = 1 of image points; NaN where there is none in front of the camera."""
        rays = self.camera.unproject(self.points(uv))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(rays[:, 2:] > 0.0, rays / rays[:, 2:], np.nan))

    @property
    def focal(self) -> float:
        """Mean focal length, px."""
        return float(np.sqrt(self.camera.intrinsics[0] * self.camera.intrinsics[1]))

    def with_focal(self, factor: float) -> MirroredCamera:
        """Another focal length about the same centre."""
        fx, fy, cx, cy = self.camera.intrinsics
        return self._with(factor * fx, factor * fy, cx, cy)

    def scaled(self, factor: float) -> MirroredCamera:
        """The calibration carried to images of another size: focal length and centre."""
        fx, fy, cx, cy = self.camera.intrinsics
        return self._with(factor * fx, factor * fy, factor * (cx + 0.5) - 0.5, factor * (cy + 0.5) - 0.5)

    def _with(self, *intrinsics: float) -> MirroredCamera:
        c = self.camera
        changed = Camera(c.model, c.width, c.height, intrinsics, c.distortion)
        return replace(self, camera=changed)


class CameraMistake(NamedTuple):
    """As `PoseMistake`, for the images of one camera; ``{camera}`` stands for its name."""

    fault: str
    remedy: str
    undo: Callable[[MirroredCamera], MirroredCamera]


MIRRORS = (
    CameraMistake(
        "the images of {camera} are mirrored left to right",
        "store them as the camera sees them",
        lambda model: replace(model, across=not model.across),
    ),
    CameraMistake(
        "the images of {camera} are mirrored upside down, or its poses are left-handed (Unity's, y up)",
        "store them as the camera sees them, or negate y of the positions and x and z of the quaternions",
        lambda model: replace(model, down=not model.down),
    ),
    CameraMistake(
        "the images of {camera} are upside down",
        "turn them by 180 degrees, or calibrate the camera as it hangs",
        lambda model: replace(model, across=not model.across, down=not model.down),
    ),
)
SIZES = np.array([0.25, 1 / 3, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 3.0, 4.0])
"""Factors by which images are usually resized."""
FOCALS = np.linspace(0.7, 1.4, 29)
"""Factors on the focal length that are tried."""


def mirrored(image: Image, across: bool, down: bool) -> Image:
    """The image as an `MirroredCamera` with these flags takes it."""
    return np.ascontiguousarray(image[:: -1 if down else 1, :: -1 if across else 1])
