"""A node of ROS 2 without ROS: tests call what it subscribed with, and see what it published."""

from __future__ import annotations

import sys
import types
from typing import Any

import pytest

from collabslam.live import ros_out, ros_types


class Node:
    """Of rclpy, without ROS."""

    def __init__(self) -> None:
        self.takes: dict[str, Any] = {}
        self.sent: dict[str, list[bytes]] = {}
        self.services: dict[str, Any] = {}
        self.said: list[str] = []
        self.look: Any = None

    def create_subscription(self, kind: Any, topic: str, take: Any, qos: Any, *, raw: bool) -> None:
        self.takes[topic] = take

    def create_service(self, kind: Any, name: str, answer: Any) -> None:
        self.services[name] = answer

    def create_timer(self, seconds: float, look: Any) -> None:
        self.look = look

    def get_logger(self) -> Any:
        return types.SimpleNamespace(info=self.said.append, warning=self.said.append)

    def get_clock(self) -> Any:
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=5_000_000_000))

    def ask(self, name: str) -> tuple[bool, str]:
        """Success and message of a service."""
        response = self.services[name](None, types.SimpleNamespace(success=False, message=""))
        return response.success, response.message

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
        sent = self.sent.setdefault(topic, [])
        return types.SimpleNamespace(publish=sent.append)


def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Puts what a `RosNode` needs of rclpy in its place."""
    qos = types.ModuleType("rclpy.qos")
    vars(qos).update(
        qos_profile_sensor_data=0,
        QoSProfile=lambda **_: 1,
        DurabilityPolicy=types.SimpleNamespace(TRANSIENT_LOCAL=2),
    )
    monkeypatch.setitem(sys.modules, "rclpy", types.ModuleType("rclpy"))
    monkeypatch.setitem(sys.modules, "rclpy.qos", qos)
    std_srvs = types.ModuleType("std_srvs.srv")
    vars(std_srvs).update(Trigger="std_srvs/srv/Trigger")
    monkeypatch.setitem(sys.modules, "std_srvs.srv", std_srvs)
    for module in (ros_out, ros_types):
        monkeypatch.setattr(module, "message_class", lambda kind: kind)
