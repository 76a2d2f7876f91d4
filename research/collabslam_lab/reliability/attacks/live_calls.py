"""Calls of `LiveSlam` that no program should make: each is refused at the call, and the filter goes on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from collabslam.live.clock import Exchange
from collabslam.live.core import RobotFrame
from collabslam.live.slam import LiveSlam
from collabslam.live.views import LiveView
from collabslam_lab.reliability.attacks.attack import REFUSED, Attack

GREY = np.zeros((48, 64), np.uint8)
NONE = np.full((4, 4), "x")

WRONG: dict[str, Callable[[LiveSlam], None]] = {
    "session-none": lambda live: live.push_worn(0.0, GREY, session=None),  # type: ignore[arg-type]
    "session-line": lambda live: live.push_worn(0.0, GREY, session="anna/1\nben"),
    "session-path": lambda live: live.push_worn(0.0, GREY, session="../../anna"),
    "session-long": lambda live: live.push_worn(0.0, GREY, session="a" * 33),
    "session-comma": lambda live: live.push_worn(0.0, GREY, session="anna,1"),
    "time-word": lambda live: live.push_worn("now", GREY),  # type: ignore[arg-type]
    "time-nan": lambda live: live.push_robot(float("nan"), GREY),
    "time-none": lambda live: live.push_robot(None, GREY),  # type: ignore[arg-type]
    "time-endless": lambda live: live.push_odometry(float("inf"), np.zeros(6), np.eye(6)),
    "time-nanoseconds": lambda live: live.push_robot(1.7e18, GREY),
    "image-none": lambda live: live.push_robot(0.0, None),  # type: ignore[arg-type]
    "image-word": lambda live: live.push_worn(0.0, "0.png"),  # type: ignore[arg-type]
    "image-long": lambda live: live.push_worn(0.0, bytes((1 << 24) + 1)),
    "pose-words": lambda live: live.push_worn(0.0, GREY, NONE, np.eye(6)),
    "pose-alone": lambda live: live.push_worn(0.0, GREY, np.eye(4)),
    "pose-small": lambda live: live.push_worn(0.0, GREY, np.eye(3), np.eye(6)),
    "bias-small": lambda live: live.push_worn(0.0, GREY, np.eye(4), np.eye(6), bias=np.eye(3)),
    "twist-none": lambda live: live.push_odometry(0.0, None, np.eye(6)),  # type: ignore[arg-type]
    "twist-short": lambda live: live.push_odometry(0.0, np.zeros(3), np.eye(6)),
    "clock-none": lambda live: live.push_clock("anna/1", None),  # type: ignore[arg-type]
    "clock-words": lambda live: live.push_clock("anna/1", Exchange("a", 0.0, 0.0, 0.0)),  # type: ignore[arg-type]
    "clock-nobody": lambda live: live.push_clock(7, Exchange(0.0, 0.0, 0.0, 0.0)),  # type: ignore[arg-type]
    "event-none": lambda live: live.push(None),  # type: ignore[arg-type]
    "event-view": lambda live: live.push(LiveView(None, 0.0, GREY)),  # type: ignore[arg-type]
    "event-own": lambda live: live.push(LiveView("anna/1", 0.0, GREY, own=7)),  # type: ignore[arg-type]
    "event-frame": lambda live: live.push(RobotFrame("now", GREY)),  # type: ignore[arg-type]
}

ATTACKS = tuple(
    Attack(
        "live call",
        name,
        f"a call of LiveSlam: {name.replace('-', ', ')}",
        lambda scene, name=name: scene.child("live", name),  # type: ignore[misc]
        REFUSED,
    )
    for name in WRONG
)
