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

    def t_of(i: int, j: int) -> Any:
        return np.linalg.inv(poses[i]) @ poses[j]

    class Stub:
        has_depth, worn_camera = True, CAMERA
        frame = staticmethod(frame_of)
        image = staticmethod(lambda i: i)
        view = staticmethod(lambda i: SimpleNamespace(image=(i + 5) % COUNT, t_cf=t_of(i, (i + 5) % COUNT)))
        moved = staticmethod(lambda i: np.eye(4))

        def __len__(self) -> int:
            return COUNT

    recording: Any = Stub()
    monkeypatch.setattr(depth, "describe", lambda image: image)
    monkeypatch.setattr(depth, "match_points", lambda a, b: Matches(uvs[a], uvs[b]))
    by_truth = RobotReport(MirroredCamera(CAMERA), {1: 0.1}, poses=poses)
    by_t_cf = RobotReport(MirroredCamera(CAMERA))
    for report, source in ((by_truth, "the true poses tell"), (by_t_cf, "T_CF tells")):
        found = depth.check_depth(recording, report, None)
        assert (said in found[0] and source in found[0]) if said else found == []
    Stub.view = staticmethod(lambda i: None)
    assert depth.check_depth(recording, by_t_cf, None) == []
