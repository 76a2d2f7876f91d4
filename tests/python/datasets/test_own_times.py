"""Views of Cf that carry a time of their own: which frame they come with, written and read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from collabslam import InputError, RecordingWriter, open_recording
from collabslam.datasets import write_recording
from collabslam.datasets.readers.stamped import own_time, views_of_frames
from collabslam.datasets.ros.writer import write_bag
from collabslam.datasets.wrapped import FirstFrames
from collabslam.simulation import corridor_recording
from collabslam.types import Recording
from collabslam_lab.hardware.free_running import FreeRunning, WornClock

MS = 1_000_000


@pytest.fixture(scope="module")
def walk() -> Recording:
    recording = corridor_recording(length_m=6.0)
    return FirstFrames(FreeRunning(recording, recording.worn_at, WornClock(10.0, 0.04)), 6)


def test_a_view_comes_with_the_first_frame_from_its_time_on() -> None:
    frames = [0, 100 * MS, 200 * MS, 5000 * MS]
    views = [-40 * MS, 30 * MS, 60 * MS, 103 * MS, 190 * MS, 250 * MS, 4500 * MS, 6000 * MS]
    # Of two for one frame the nearer; 103 is within 5 ms of its frame; 6000 has none.
    assert views_of_frames(frames, views, 5 * MS) == {0: 0, 1: 3, 2: 4, 3: 6}
    assert views_of_frames(frames, views, 0) == {0: 0, 1: 2, 2: 4, 3: 6}
    assert views_of_frames(frames, [-6000 * MS, -5900 * MS, 6000 * MS], 5 * MS) == {}  # another clock
    assert own_time(5 * MS, 5 * MS) is None
    assert own_time(5 * MS, 6 * MS) == 0.005


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["folder", "bag"])
def test_times_of_views_are_written_and_read(walk: Recording, kind: str, tmp_path: Path) -> None:
    if kind == "folder":
        again = open_recording(write_recording(walk, tmp_path / "walk"))
    else:
        write_bag(walk, tmp_path / "walk")
        topics = {"cs": "/cs/image_raw", "cf": "/cf/image_raw"}
        again = open_recording(tmp_path / "walk", topics=topics)
    for i in range(6):
        views = walk.frame(i).views, again.frame(i).views
        assert [len(some) for some in views] == [i > 0] * 2  # nothing was taken before the first frame
        for one, two in zip(*views, strict=True):
            assert two.t == pytest.approx(one.t, abs=1e-6)
            assert two.t == pytest.approx(again.times[i] - 0.06, abs=1e-6)
            np.testing.assert_allclose(two.t_cf, one.t_cf, atol=1e-9)
            np.testing.assert_array_equal(two.image, one.image)


def test_a_view_is_written_once(walk: Recording, tmp_path: Path) -> None:
    first, second = walk.frame(1), walk.frame(2)
    with RecordingWriter(tmp_path / "walk", walk.camera, walk.worn_camera) as writer:
        writer.add(first.t, first.image, first.views)
        with pytest.raises(InputError, match=r"worn view of 0.04 s already"):
            writer.add(second.t, second.image, first.views)
        writer.add(second.t, second.image, second.views)
    assert len(list((tmp_path / "walk" / "cam1" / "data").iterdir())) == 2
