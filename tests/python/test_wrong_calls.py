"""What no file can be called, and arguments that are something else, are refused at the call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import collabslam
from collabslam import (
    Board,
    Camera,
    DataError,
    Imu,
    InputError,
    Output,
    SavedMap,
    SettingsError,
    Slam,
    WornView,
)
from collabslam.simulation import corridor_recording

CAMERA = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
IMAGE = np.zeros((48, 64), np.uint8)
IMPOSSIBLE = ["a\0b", "a\ud800b", "a" * 5000]


@pytest.mark.parametrize("name", IMPOSSIBLE, ids=["zero byte", "half a character", "too long"])
@pytest.mark.parametrize(
    "call",
    [
        collabslam.open_recording,
        collabslam.run,
        collabslam.resume,
        Slam.load,
        SavedMap.load,
        lambda name: Slam(CAMERA, mode="mono", start="scale-free").save(name),
    ],
    ids=["open", "run", "resume", "load", "load a map", "save"],
)
def test_a_name_that_no_file_can_have(call: Callable[[str], Any], name: str) -> None:
    with pytest.raises(DataError, match="No file can be called"):
        call(name)


@pytest.mark.parametrize("name", IMPOSSIBLE, ids=["zero byte", "half a character", "too long"])
def test_results_where_no_folder_can_be(name: str, tmp_path: Path) -> None:
    recording = corridor_recording(length_m=0.5)
    with pytest.raises(DataError, match="No file can be called"):
        collabslam.run(recording, mode="mono", start="scale-free", out=Output(tmp_path / name))


def test_links_that_lead_to_each_other(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(DataError, match="No file can be called"):
        collabslam.open_recording(tmp_path / "a")


def worn(**other: Any) -> WornView:
    return WornView(**{"image": IMAGE, "t_cf": np.eye(4), "covariance": 1e-4 * np.eye(6), **other})


@pytest.mark.parametrize("views", [[None], [{}], "ab", [worn(who=[])], [worn(t="now")], [worn(t=1j)]])
def test_views_that_are_none(views: Any) -> None:
    slam = Slam(CAMERA, worn_camera=CAMERA)
    with pytest.raises(InputError):
        slam.step(0.0, IMAGE, views)
    slam.step(0.0, IMAGE)


@pytest.mark.parametrize(
    "call",
    [
        lambda: collabslam.run(None),  # type: ignore[arg-type]
        lambda: Slam(CAMERA, imu=3, mode="mono", start="scale-free"),  # type: ignore[arg-type]
        lambda: Slam(CAMERA, imu=Imu(gyro_noise="a"), mode="mono", start="scale-free"),  # type: ignore[arg-type]
        lambda: Slam(CAMERA, settings={}, mode="mono"),  # type: ignore[arg-type]
        lambda: collabslam.run(corridor_recording(length_m=0.5), settings={}),  # type: ignore[arg-type]
        lambda: collabslam.open_recording(".", topics=3),  # type: ignore[arg-type]
        lambda: collabslam.open_recording(".", sensors=3),  # type: ignore[arg-type]
        lambda: collabslam.open_recording(".", sensors=[3]),  # type: ignore[list-item]
        lambda: collabslam.open_recording(".", axes={"poss": "ros"}),
        lambda: Board("a", 4, 0.1),  # type: ignore[arg-type]
        lambda: Board(3.5, 4, 0.1),  # type: ignore[arg-type]
    ],
    ids=[
        "run",
        "imu",
        "noise",
        "settings",
        "settings of a run",
        "topics",
        "sensors",
        "a sensor",
        "axes",
        "board of letters",
        "board of halves",
    ],
)
def test_arguments_of_another_kind(call: Callable[[], Any]) -> None:
    with pytest.raises((InputError, SettingsError)):
        call()
