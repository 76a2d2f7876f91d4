"""What a caller may get wrong, and when a program may end: neither ends the filter badly."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest
from helpers.clip import Clip
from helpers.waiting import until

from collabslam import InputError, Slam
from collabslam.live.core import Event, LivePose, RobotFrame
from collabslam.live.refusals import MOST, OTHERS, Refusals
from collabslam.live.slam import BOUNDS, LiveSlam
from collabslam_lab.reliability.attacks.live_calls import GREY, WRONG


def engine(clip: Clip) -> Slam:
    return Slam(clip.recording.camera, clip.recording.worn_camera)


@pytest.mark.parametrize("name", list(WRONG))
def test_wrong_arguments_are_refused_at_the_call(clip: Clip, name: str) -> None:
    poses: list[LivePose] = []
    with LiveSlam(engine(clip), on_pose=poses.append, same_clock=True) as live:
        with pytest.raises(InputError):
            WRONG[name](live)
        for frame in clip.frames[:2]:
            live.push_robot(frame.t, frame.image)
    assert len(poses) == 2


def test_a_callback_may_close(clip: Clip) -> None:
    frame = clip.frames[0]
    live = LiveSlam(engine(clip), on_pose=lambda pose: live.close(), same_clock=True)
    live.push_robot(frame.t, frame.image)
    live._worker.join()
    assert live.callback_error is None
    live.close()
    with pytest.raises(InputError, match="closed"):
        live.push_robot(frame.t + 1.0, frame.image)


def test_frames_do_not_wait_for_views(clip: Clip) -> None:
    """A filter that is as slow as can be with views: no frame is lost because of those before it."""
    frame = clip.frames[0]
    go, done = threading.Semaphore(0), list[str]()
    with LiveSlam(engine(clip), same_clock=True) as live:

        def handle(event: Event) -> None:
            go.acquire()
            done.append(type(event).__name__)

        live._core.handle = handle  # type: ignore[method-assign]
        live.push_worn(0.0, GREY, session="anna/1")
        assert until(lambda: not live._events)  # it is being worked on
        for k in range(40):
            for n in range(3):
                live.push_worn(0.1 * k + 0.01 * n, GREY, session="anna/1")
            live.push_robot(0.1 * k, frame.image)
        go.release(1000)
    assert done[:2] == ["LiveView", "RobotFrame"]
    assert done.count("RobotFrame") == BOUNDS[RobotFrame]
    lost = live.dropped
    assert lost["frames"] == 40 - BOUNDS[RobotFrame]
    assert lost["crowded"] == 121 - done.count("LiveView")


def test_a_name_that_is_none_makes_no_engine(clip: Clip) -> None:
    for name in ("../anna", "anna\n", "a b", "-a", "x" * 33):
        with pytest.raises(InputError, match="called"):
            Slam(clip.recording.camera, {name: clip.recording.camera})


def test_reasons_are_counted_and_bounded() -> None:
    refused = Refusals()
    for k in range(1000):
        refused.add(InputError(f"The time {0.1 * k} s is before {k}e-3."))
    assert refused == {"The time 0.0 s is before 0e-3.": 1000}
    for k in range(1000):
        refused.add(InputError("x" * k))
    assert len(refused) == MOST + 1
    assert refused[OTHERS] == 1000 - MOST + 1
    assert sum(refused.values()) == 2000


OPEN = """
import sys, threading
import numpy as np
from collabslam import Camera, Slam
from collabslam.live.slam import BOUNDS, LiveSlam
camera = Camera("pinhole", 640, 480, (400.0, 400.0, 320.0, 240.0))
live = LiveSlam(Slam(camera, mode="mono", start="scale-free"))
noise = np.random.default_rng(0)
image = noise.integers(0, 255, (480, 640)).astype(np.uint8)
for k in range(int(sys.argv[1])):
    live.push_robot(0.1 * k, np.roll(image, k, axis=1))
def feed():
    k = 100
    while True:
        live.push_robot(0.1 * k, np.roll(image, k, axis=1))
        k += 1
if sys.argv[2] == "fed":
    threading.Thread(target=feed, daemon=True).start()
"""


@pytest.mark.parametrize("frames", [0, 1, 4])
@pytest.mark.parametrize("how", ["left", "fed"])
def test_the_interpreter_may_end_while_it_is_open(frames: int, how: str) -> None:
    done = subprocess.run([sys.executable, "-c", OPEN, str(frames), how], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
