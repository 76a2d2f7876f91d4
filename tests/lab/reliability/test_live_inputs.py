"""What devices and pages send, altered: nothing is found, and what would be found is."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from helpers.rosless import Node, stand_in

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("rosbags", reason="the extra live is not installed")

from collabslam import Camera
from collabslam.live import messages, names, web
from collabslam.live.ros import RosNode, RosTopics
from collabslam.live.ros_worn import WornTopics
from collabslam.live.uplink import Uplink
from collabslam.settings.table import Settings
from collabslam_lab.reliability.live_inputs import fuzz_live, good_messages
from collabslam_lab.reliability.readers import damaged


def test_good_messages_are_good() -> None:
    up = Uplink(lambda event: None, lambda: 7.0)
    for part, payload in good_messages().items():
        up.take(names.key("anna", part), payload)
    assert "malformed" not in up.counts()
    assert set(good_messages()) == set(names.PARTS)


def test_nothing_is_found() -> None:
    found = fuzz_live(1500, 3)
    assert found.findings == []
    assert found.executions == 3000
    assert 0 < found.refused < found.executions


def test_what_raises_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "_is_time", lambda value: float(value) < 1e11)
    assert any("page" in finding for finding in fuzz_live(300, 0).findings)


def test_altered_messages_of_ros_cost_only_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is taken, or counted as refused; what it raises otherwise would end the node."""
    stand_in(monkeypatch)
    rng, grey = np.random.default_rng(5), np.zeros((24, 32), np.uint8)
    camera = Camera("pinhole", 32, 24, (30.0, 30.0, 16.0, 12.0))
    node: Any = Node()
    worn = {"": WornTopics("/cf/compressed", "/cf_info", "/tf", (0.03, 1.0))}
    running = RosNode(node, RosTopics("/cs", "/cs_info", worn), Settings.default())
    good = {
        "/cs": messages.raw_image(1.0, "cs", grey),
        "/cs_info": messages.camera_info(1.0, "cs", camera),
        "/cf/compressed": messages.compressed_image(1.0, "cf", cv2.imencode(".png", grey)[1].tobytes()),
        "/cf_info": messages.camera_info(1.0, "cf", camera),
        "/tf": messages.transforms(1.0, ("cs", "cf", np.eye(4)), ("base", "cs", np.eye(4))),
        "/tf_static": messages.transforms(1.0, ("base", "cs", np.eye(4))),
    }
    assert set(good) == set(node.takes)
    for k in range(900):
        topic = str(rng.choice(list(good)))
        node.takes[topic](good[topic] if k % 9 == 0 else damaged(good[topic], rng))
    assert 300 < running._refused < 900
    running.close()
