"""Recordings of a plan that names the poses of its frames and of the views of Cf."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam.datasets import attach_worn
from collabslam.errors import DataError
from collabslam_lab.benchmark.opening import open_folder, views_of, worn_of
from collabslam_lab.benchmark.plan import parse_plan

PLAN = """
recordings:
  flight: {worn: "views:keys", truth: given/frames.txt, view_poses: given/keys.txt}
  alone: {folder: flight, worn: "lag:0.1"}
"""
START_NS = 1_403_715_285_262_142_976
SENSOR = """
T_BS: {data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
resolution: [32, 24]
camera_model: pinhole
intrinsics: [20, 20, 15.5, 11.5]
distortion_model: none
"""


def line(stamp: int, x: float) -> str:
    return f"{stamp} {x} 0 0 0 0 0 1"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Twelve frames of a camera that stands still; two stereo keyframes, one of them beside it."""
    flight = tmp_path / "flight"
    images, keys, given = flight / "mav0" / "cam0" / "data", flight / "keys", flight / "given"
    for folder in (images, keys, given):
        folder.mkdir(parents=True)
    (images.parent / "sensor.yaml").write_text(SENSOR)
    stamps = [START_NS + 50_000_000 * k for k in range(12)]
    for stamp in stamps:
        cv2.imwrite(str(images / f"{stamp}.png"), np.zeros((24, 32), np.uint8))
    (given / "frames.txt").write_text("\n".join(line(stamp, 0.0) for stamp in stamps))
    before = [START_NS - 2 * 10**9, START_NS - 10**9]
    for k, stamp in enumerate(before):
        cv2.imwrite(str(keys / f"{stamp}_0.png"), np.full((24, 32), k, np.uint8))
        cv2.imwrite(str(keys / f"{stamp}_1.png"), np.full((24, 32), 200, np.uint8))
    (given / "keys.txt").write_text("\n".join(line(s, x) for s, x in zip(before, (30.0, 0.5), strict=True)))
    return tmp_path


def test_the_plan_names_the_poses(data: Path) -> None:
    flight, alone = parse_plan(PLAN).recordings
    assert open_folder(alone, data).truth is None
    recording = open_folder(flight, data)
    assert recording.truth is not None
    np.testing.assert_allclose(recording.truth, np.broadcast_to(np.eye(4), (12, 4, 4)))
    views = views_of(flight, recording)
    assert [path.stem[-2:] for path in views.paths] == ["_0", "_0"]
    assert views.stamps is not None
    np.testing.assert_allclose(views.stamps, START_NS / 10**9 - np.array([2.0, 1.0]))
    (view,) = attach_worn(recording, worn_of(flight, recording), noise=(0.0, 0.0, 0.0, 0.0)).frame(0).views
    assert view.image[0, 0] == 1
    np.testing.assert_allclose(view.t_cf[:3, 3], [0.5, 0.0, 0.0])


def test_poses_that_are_not_there_are_named(data: Path) -> None:
    flight, _ = parse_plan(PLAN).recordings
    (data / "flight" / "given" / "frames.txt").unlink()
    with pytest.raises(DataError, match=r"frames\.txt"):
        open_folder(flight, data)
