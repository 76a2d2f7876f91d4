"""The frames of REP 105: map, odom, base_link; what the filter says of Cs as ROS has it of the robot.

The filter's world W is Cs at the start, with optical axes.  Here the world is the robot's base at the start,
x ahead, y left, z up: ``T_OB = T_BC T_WC T_CB``, and so is the map.  Right tangents go through the adjoint.
If it is to be level, it is turned about that origin: z against gravity, x where the base looked, seen from
above.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collabslam.datasets.odometry import mounted
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.geometry import adjoint, pose, pose_inverse
from collabslam.level import Level
from collabslam.types import Array

TF_ALL, TF_MAP, _ = TF_CHOICES = ("all", "map", "none")
"""Which links go to tf: map -> odom -> base; map -> odom alone, where wheels tell odom -> base; none."""


@dataclass(frozen=True)
class RosFrames:
    """Names of frames, and where Cs sits on the base.

    Attributes
    ----------
    map, odom, base : str
    mount : tuple of float, tuple of two str, or None
        Place of Cs in the base's frame as `collabslam.datasets.odometry.mounted` has it; or two frames that
        fixed links of tf join, the base and Cs's images; None where the wheels tell it, or Cs sits in the
        base and looks ahead.
    tf : str
        Of `TF_CHOICES`.
    """

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    mount: tuple[float, ...] | tuple[str, str] | None = None
    tf: str = TF_ALL

    @property
    def asks_tf(self) -> bool:
        """Whether fixed links of tf must tell where Cs sits."""
        return self.mount is not None and isinstance(self.mount[0], str)

    @property
    def world(self) -> str:
        """The frame in which the filter's pose never jumps; ``odom`` unless that is somebody else's."""
        return f"collabslam_{self.odom}" if self.tf == TF_MAP else self.odom

    def t_bc(self, tree: TransformTree, wheels: Array | None) -> Array | None:
        """T_BC (4, 4), maps points of Cs into the base's frame, metres; None until tf tells.

        Parameters
        ----------
        tree : TransformTree
            Of tf's fixed links.
        wheels : (4, 4) array or None
            Where Cs sits in the frame of the wheels.
        """
        if self.mount is None:
            return mounted((0.0, 0.0, 0.0)) if wheels is None else wheels
        if isinstance(self.mount[0], str):
            return tree.between(str(self.mount[0]), str(self.mount[1]), 0.0)
        return mounted([float(x) for x in self.mount])


class Base:
    """The robot's base.

    Parameters
    ----------
    t_bc : (4, 4) array
        Where Cs sits in it.
    level : Level, optional
        Which way is down in W; with it the world is level, and what is not known of that is in covariances.
    """

    def __init__(self, t_bc: Array, level: Level | None = None) -> None:
        self.t_bc, self._back = t_bc, np.asarray(pose_inverse(t_bc))
        self._adjoint = np.asarray(adjoint(t_bc))
        self._world, self._level = t_bc, level
        if level is not None:
            optical = mounted((0.0, 0.0, 0.0))[:3, :3]
            self._level = replace(level, up=optical.T @ t_bc[:3, :3] @ level.up)
            self._world = pose(self._level.r_lw @ optical.T, np.zeros(3)) @ t_bc

    def pose(self, t_wc: Array) -> Array:
        """T_OB (4, 4) of a T_WC."""
        return np.asarray(self._world @ t_wc @ self._back)

    def placed(self, t_wc: Array, covariance: Array) -> tuple[Array, Array]:
        """T_OB (4, 4) of a T_WC and its covariance (6, 6) of that of Cs; right tangents."""
        found = self.pose(t_wc)
        return found, self.covariance(covariance) + self._of_level(found)

    def seen(self, t_wf: Array, covariance: Array) -> tuple[Array, Array]:
        """T_OF (4, 4) of a T_WF and its covariance (6, 6): F's own axes stay what they are."""
        found = np.asarray(self._world @ t_wf)
        return found, covariance + self._of_level(found)

    def between(self, t_ww: Array) -> Array:
        """A pose (4, 4) between two worlds W as one between two such worlds."""
        return np.asarray(self._world @ t_ww @ pose_inverse(self._world))

    def tangent(self, value: Array) -> Array:
        """A twist (6,) of Cs along its own axes as that of the base along its own."""
        return np.asarray(self._adjoint @ value)

    def covariance(self, value: Array) -> Array:
        """A covariance (6, 6) of a pose of Cs, right tangent, or of its twist, as that of the base."""
        return np.asarray(self._adjoint @ value @ self._adjoint.T)

    def points(self, value: Array) -> Array:
        """Points (N, 3) of W in the world of the base."""
        return np.asarray(value @ self._world[:3, :3].T + self._world[:3, 3])

    def spread(self, points: Array, covariances: Array) -> Array:
        """Covariances (N, 3, 3) of points (N, 3) of the world of the base, of those that they have in W."""
        turn, level = self._world[:3, :3], self._level
        turned = np.asarray(turn @ covariances @ turn.T)
        if level is None:
            return turned
        return np.asarray(turned + np.reshape([level.of_point(point) for point in points], (-1, 3, 3)))

    def _of_level(self, found: Array) -> Array:
        return np.zeros((6, 6)) if self._level is None else self._level.of_pose(found)
