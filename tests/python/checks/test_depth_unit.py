"""Depths in another unit than the poses are named, with the factor that mends them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from collabslam._core import Camera
from collabslam.checks import depth
from collabslam.checks.matching import Matches
from collabslam.checks.mistakes import MirroredCamera
from collabslam.checks.robot import RobotReport
from collabslam.types import DepthPoints

CAMERA = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
COUNT = 24


@pytest.mark.parametrize(
    ("factor", "said"), [(1.0, ""), (0.2, "--depth-scale is to be 0.2 times"), (5.0, "5 times as long")]
)
def test_depths_in_another_unit_are_named(monkeypatch: pytest.MonkeyPatch, factor: float, said: str) -> None:
    points = np.random.default_rng(0).uniform((-1, -1, 3), (1, 1, 6), (200, 3))
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, 0, 3] = 0.05 * np.arange(COUNT)
    uvs = [CAMERA.project(points - pose[:3, 3]).uv for pose in poses]

    def frame_of(i: int) -> Any:
        return SimpleNamespace(image=i, depth=DepthPoints(uvs[i] + 1.0, factor * points[:, 2], points[:, 2]))

    class Stub:
        has_depth = True
        frame = staticmethod(frame_of)
        image = staticmethod(lambda i: i)

        def __len__(self) -> int:
            return COUNT

    recording: Any = Stub()
    monkeypatch.setattr(depth, "describe", lambda image: image)
    monkeypatch.setattr(depth, "match_points", lambda a, b: Matches(uvs[a], uvs[b]))
    found = depth.check_depth(recording, RobotReport(MirroredCamera(CAMERA), {1: 0.1}, poses=poses))
    assert (said in found[0]) if said else found == []
    assert depth.check_depth(recording, RobotReport(MirroredCamera(CAMERA))) == []
