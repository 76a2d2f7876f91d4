"""What attacks through Python do, in a process of its own; ends with the exit status of the command line.

python -m collabslam_lab.reliability.attacks.child call|live|stream NAME WALK OUT
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from collabslam.batch.processes import use_one_thread
from collabslam.cli import BAD_INPUT, NOT_TRUSTED, OK
from collabslam.datasets import open_recording
from collabslam.errors import CollabslamError
from collabslam.runs.runner import run
from collabslam.runs.summary import is_trusted
from collabslam.slam.engine import Slam
from collabslam.types import Recording
from collabslam_lab.reliability.attacks.perform import CHANGED

BEFORE = 6
"""Frames before a call."""


def call(name: str, walk: Path) -> int:
    """Make a call; after a refusal the engine goes on as one that was not called."""
    from collabslam_lab.reliability.attacks.calls import CALLS, Moment

    act = {row[0]: row[2] for row in CALLS}[name]
    recording = open_recording(walk)
    slam = _played(recording)
    twin = Slam.from_state(slam.state())
    frame = recording.frame(BEFORE)
    try:
        act(Moment(slam, frame))
    except CollabslamError as error:
        print(f"error: {error}", file=sys.stderr)
        same = [engine.step(frame.t, frame.image, frame.views) for engine in (slam, twin)]
        return BAD_INPUT if np.array_equal(same[0].covariance, same[1].covariance) else CHANGED
    return OK


def _played(recording: Recording) -> Slam:
    slam = Slam(recording.camera, recording.worn_camera)
    for i in range(BEFORE):
        frame = recording.frame(i)
        slam.step(frame.t, frame.image, frame.views)
    return slam


def live(name: str, walk: Path) -> int:
    """Make a call of LiveSlam, which takes a frame after it as if nothing had been."""
    from collabslam.live.slam import LiveSlam
    from collabslam_lab.reliability.attacks.live_calls import WRONG

    recording = open_recording(walk)
    done: list[object] = []
    status = OK
    engine = Slam(recording.camera, recording.worn_camera)
    with LiveSlam(engine, on_pose=done.append, same_clock=True) as running:
        try:
            WRONG[name](running)
        except CollabslamError as error:
            print(f"error: {error}", file=sys.stderr)
            status = BAD_INPUT
        running.push_robot(recording.frame(0).t, recording.frame(0).image)
    return status if len(done) == 1 else CHANGED


def stream(name: str, walk: Path, out: Path) -> int:
    """Run a recording that is wrong; the exit status is that of ``collabslam run``."""
    from collabslam_lab.reliability.attacks.streams import BY_NAME

    recording = open_recording(walk)
    wrong = BY_NAME[name](recording, np.random.Generator(np.random.PCG64(0)))
    try:
        return OK if is_trusted(run(wrong, out=out).summary) else NOT_TRUSTED
    except CollabslamError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT


def main(words: list[str]) -> int:
    """Do one of them."""
    kind, name, walk, out = words
    use_one_thread()
    if kind == "stream":
        return stream(name, Path(walk), Path(out))
    return call(name, Path(walk)) if kind == "call" else live(name, Path(walk))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
