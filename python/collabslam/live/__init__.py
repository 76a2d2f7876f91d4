"""Live: a robot's camera and a worn camera on a network, and the pose while the robot drives.

:class:`collabslam.live.slam.LiveSlam` takes what both cameras send, in any order and from any thread;
`robot` and `worn` are its two ends on a network, `keys` says who may send what, `record` writes down all that
reached the filter, so that it can be run again.
"""

from __future__ import annotations
