"""Bags whose tables hold what no recorder writes there."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")
from rosbags.rosbag2 import StoragePlugin, Writer

from collabslam import DataError
from collabslam.datasets.ros import bag as bags
from collabslam.datasets.ros.bag import Bag, BagImages
from collabslam.live import messages

GREY = np.zeros((48, 64), np.uint8)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """A bag of two images, as its database."""
    with Writer(tmp_path / "bag", version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topic = bag.add_connection("/image", messages.IMAGE, typestore=messages.store())
        for k in (1, 2):
            bag.write(topic, k, messages.raw_image(float(k), "cs", GREY))
    (path,) = (tmp_path / "bag").glob("*.db3")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    return path


def alter(path: Path, statement: str, *values: object) -> None:
    with sqlite3.connect(path) as base:
        base.execute(statement, values)
    base.close()


@pytest.mark.parametrize("time", ["x", "1", 1.5, b"\0"])
def test_a_time_that_is_none_is_told(written: Path, time: object) -> None:
    alter(written, "UPDATE messages SET timestamp = ? WHERE id = 2", time)
    try:
        stamps = BagImages(Bag(written), "/image").stamps
    except DataError:
        return
    assert all(isinstance(stamp, int) for stamp in stamps)


@pytest.mark.parametrize("qos", ["- " * 2_000_000, "{" * 1_000_000, "&a [" * 100_000, "\0"])
def test_how_topics_were_offered_is_not_asked(written: Path, qos: str) -> None:
    """Megabytes of YAML, which a parser takes minutes for."""
    alter(written, "UPDATE topics SET offered_qos_profiles = ?", qos)
    assert len(BagImages(Bag(written), "/image").stamps) == 2


def test_metadata_of_megabytes_is_told(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (written.parent / "metadata.yaml").write_text("- " * (bags._LARGEST_METADATA // 2 + 1))
    with pytest.raises(DataError, match="which no bag needs"):
        Bag(written.parent)
