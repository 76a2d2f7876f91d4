"""Names of the modes and of the ways to start (METHOD sections 5, 6 and 10)."""

from __future__ import annotations

from collabslam._core import settings_schema

MODES: tuple[str, ...] = next(row[6] for row in settings_schema() if row[0] == "estimator.mode")
"""`mono`: delayed births only.  `mono-undelayed`: Civera's births.  `collab-init`: Cf gives births only.
`collab`: Cf gives births and points with depth (the paper).  `collab-tight`: Cf's pixels are measured, with
T_CF in the state."""

STARTS = ("worn", "target", "depth", "odometry", "scale-free")
"""Where the scale comes from: the first overlap with Cf, a known target, another sensor's depths, odometry,
nowhere."""

SLAM_STARTS = (*STARTS, "map")
"""The same for `collabslam.Slam`, which may also be given a map to find itself in."""
