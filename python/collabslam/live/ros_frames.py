"""The frames of REP 105: map, odom, base_link; what the filter says of Cs as ROS has it of the robot.

The filter's world W is Cs at the start, with optical axes.  Here the world is the robot's base at the start,
x ahead, y left, z up: ``T_OB = T_BC T_WC T_CB``, and so is the map.  Right tangents go through the adjoint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.datasets.odometry import mounted
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.geometry import adjoint, pose_inverse
from collabslam.types import Array

TF_ALL, TF_MAP, TF_NONE = TF_CHOICES = ("all", "map", "none")
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
    """The robot's base; ``t_bc`` (4, 4) says where Cs sits in it."""

    def __init__(self, t_bc: Array) -> None:
        self.t_bc, self._back = t_bc, np.asarray(pose_inverse(t_bc))
        self._adjoint = np.asarray(adjoint(t_bc))

    def pose(self, t_wc: Array) -> Array:
        """T_OB (4, 4) of a T_WC; of any pose between two such worlds, too."""
        return np.asarray(self.t_bc @ t_wc @ self._back)

    def tangent(self, value: Array) -> Array:
        """A twist (6,) of Cs along its own axes as that of the base along its own."""
        return np.asarray(self._adjoint @ value)

    def covariance(self, value: Array) -> Array:
        """A covariance (6, 6) of a pose of Cs, right tangent, or of its twist, as that of the base."""
        return np.asarray(self._adjoint @ value @ self._adjoint.T)

    def points(self, value: Array) -> Array:
        """Points (N, 3) of W in the world of the base."""
        return np.asarray(value @ self.t_bc[:3, :3].T + self.t_bc[:3, 3])
