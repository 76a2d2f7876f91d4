"""A live system whose filter is stuck in its first frame, so that what is pushed has to wait."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from helpers.waiting import LONGEST

from collabslam import Slam
from collabslam.live.core import LivePose, RobotFrame
from collabslam.live.slam import LiveSlam


@contextmanager
def busy(engine: Slam, first: RobotFrame) -> Iterator[LiveSlam]:
    """Stuck until the block ends; what then waits is dropped."""
    free, entered = threading.Event(), threading.Event()

    def stuck(pose: LivePose) -> None:
        entered.set()
        free.wait(LONGEST)

    live = LiveSlam(engine, on_pose=stuck, same_clock=True)
    live.push(first)
    assert entered.wait(LONGEST)
    try:
        yield live
    finally:
        free.set()
        live.close(flush=False)
