"""A gyroscope through a run: its samples reach the filter, the results say its bias, and a run goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.gyro import R_CI, Turned, of_clip

from collabslam import Slam, run
from collabslam.checks import doctor
from collabslam.checks.doctor import Frames, diagnose
from collabslam.datasets import write_recording
from collabslam.runs.plan import Output
from collabslam.runs.report import DEGRADED_BY, summary_text
from collabslam.runs.run_folder import RunFolder
from collabslam.runs.runner import resume
from collabslam.runs.sensors import give_gyro
from collabslam.slam.consistency_monitor import GYRO
from collabslam.types import Imu


class Heard:
    """An engine that keeps the rates it is given."""

    def __init__(self, clock: tuple[float, float] | None = (0.0, 0.0)) -> None:
        self.filter, self.gyro_clock, self.gyro_time, self.times = self, clock, None, list[float]()

    def add_gyro(self, t: float, rate: np.ndarray) -> None:
        assert rate.shape == (3,)
        self.gyro_time = t
        self.times.append(t)


def test_each_frame_is_given_the_samples_that_it_needs(clip: Clip) -> None:
    log = of_clip(clip)
    heard = Heard()
    give_gyro(heard, log, 0.5)  # type: ignore[arg-type]
    before = len(heard.times)
    np.testing.assert_array_equal(heard.times, log.times[:before])
    assert heard.times[-2] < 0.5 <= heard.times[-1]
    give_gyro(heard, log, 0.6)  # type: ignore[arg-type]
    np.testing.assert_array_equal(heard.times, log.times[: len(heard.times)])
    assert 0.6 <= heard.times[-1] < 0.606
    # By its own clock, which is 0.1 s ahead and known to 10 ms.
    ahead = Heard((-0.1, 0.01))
    give_gyro(ahead, log, 0.5)  # type: ignore[arg-type]
    assert 0.629 < ahead.times[-1] < 0.636
    # Not what is long over before the first frame, and nothing where there is no sensor.
    late = Heard()
    give_gyro(late, log, log.times[0] + 2.5)  # type: ignore[arg-type]
    assert not late.times or late.times[0] >= log.times[0] + 0.5
    none = Heard(None)
    give_gyro(none, log, 0.5)  # type: ignore[arg-type]
    assert none.times == []


def test_a_run_takes_it_and_says_what_came_out(clip: Clip, tmp_path: Path) -> None:
    write_recording(Turned(clip, of_clip(clip)), tmp_path / "walk")
    result = run(tmp_path / "walk", out=tmp_path / "out")
    gyro = result.summary["gyro"]
    assert gyro["samples"] == len(of_clip(clip))
    assert gyro["left_out"] == 0
    assert len(gyro["bias_rad_s"]) == len(gyro["bias_sd_rad_s"]) == 3
    assert gyro["clock_offset_sd_s"] >= 0.0
    assert "gyroscope" in summary_text(result.summary)
    assert any("gyroscope" in sentence.lower() for sentence in diagnose(RunFolder(tmp_path / "out")))
    without = run(Turned(clip, None), out=tmp_path / "none").summary
    assert without["gyro"] is None
    assert "gyroscope" not in summary_text(without)
    assert not any("gyroscope" in sentence.lower() for sentence in diagnose(RunFolder(tmp_path / "none")))


def test_an_engine_made_without_one_is_given_nothing(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    result = run(Turned(clip, of_clip(clip)), slam=slam)
    assert result.summary["gyro"] is None
    assert slam.filter.gyro_time is None


@pytest.mark.slow
def test_a_run_that_stopped_goes_on_bit_for_bit(clip: Clip, tmp_path: Path) -> None:
    sensor = Imu(R_CI, time_offset=-0.02, time_offset_sd=0.004)
    recording = Turned(clip, of_clip(clip, late=0.02, sensor=sensor))
    whole = run(recording, out=tmp_path / "whole")

    class Stops(Turned):
        def frame(self, i: int):
            if i == 8:
                raise KeyboardInterrupt
            return super().frame(i)

    broken = Stops(clip, recording.imu)
    run(broken, out=Output(tmp_path / "stopped", checkpoint_every=3))
    again = resume(tmp_path / "stopped", recording)
    np.testing.assert_array_equal(again.record.poses, whole.record.poses)
    np.testing.assert_array_equal(again.record.covariances, whole.record.covariances)
    assert again.summary["gyro"] == whole.summary["gyro"]


def test_the_doctor_says_what_it_was_worth() -> None:
    assert GYRO in DEGRADED_BY
    assert GYRO in doctor._REMEDIES
    rows = [
        {"started": "1", "accepted": str(a), "gyro_used": str(u)}
        for a, u in ((30, 1), (2, 1), (40, 0), (9, 1))
    ]
    numbers = {
        "bias_rad_s": [0.01, 0.0, -0.02],
        "bias_sd_rad_s": [0.001, 0.001, 0.002],
        "contradicted": 0,
        "followed": True,
    }
    said = list(doctor._gyro(Frames(rows), {"gyro": numbers}))
    assert "in 3 of 4 frames, and alone in 1 in which" in said[0]
    assert "0.0100 0.0000 -0.0200 rad/s (sd 0.0020)" in said[0]
    assert "1 frames were predicted without it" in said[1]
    left = list(doctor._gyro(Frames(rows), {"gyro": numbers | {"followed": False, "contradicted": 7}}))
    assert "images of 7 frames contradict it" in left[0]
    unused = list(doctor._gyro(Frames([{**row, "gyro_used": "0"} for row in rows]), {"gyro": numbers}))
    assert "turned no frame" in unused[0]
    assert list(doctor._gyro(Frames(rows), {"gyro": None})) == []
