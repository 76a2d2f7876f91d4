"""Messages of the link say what was put into them, to the last bit where a replay needs it."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from collabslam import Camera, DataError
from collabslam.geometry import pose, rotation_exp
from collabslam.live import messages
from collabslam.live.clock import Exchange
from collabslam.live.monotonic_clock import nanoseconds, seconds
from collabslam.live.ros_types import ImageTopic


def some_pose(seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    root = generator.normal(0.0, 0.05, (6, 6))
    return (
        pose(rotation_exp(generator.normal(0.0, 1.0, 3)), generator.normal(0.0, 3.0, 3)),
        root @ root.T + 1e-6 * np.eye(6),
    )


def deep_image(k: int, values: np.ndarray) -> bytes:
    """Image ``k`` of a camera that puts its bits into pixels of 16."""
    raw = messages.raw_image(float(k), "cam", np.zeros(values.shape, np.uint8))
    message = messages.decoded(messages.IMAGE, raw)
    message.encoding, message.step = "mono16", 2 * values.shape[1]
    message.data = np.frombuffer(values.astype("<u2").tobytes(), np.uint8)
    return messages.encoded(messages.IMAGE, message)


def test_deep_images_of_a_live_topic_have_one_range() -> None:
    ramp = np.linspace(0, 4000, 64 * 48).reshape(48, 64).astype(np.uint16)
    topic = ImageTopic("/cam/image_raw")
    for k, image in enumerate((ramp, ramp // 8, ramp, *[ramp // 8] * 9)):
        np.testing.assert_array_equal(topic.stamped(deep_image(k, image))[1], image >> 4)
    broken = ramp.copy()
    broken[3, 5] = 65535
    for k, image in enumerate((broken, ramp), 20):
        t, seen, frame = topic.stamped(deep_image(k, image))
        np.testing.assert_array_equal(seen, np.minimum(image >> 4, 255))
        assert (t, frame) == (float(k), "cam")


@pytest.mark.parametrize("t", [0.0, 0.1, 1795311423.5234127, -1.25, 2.0**31 - 1.0])
def test_stamps_come_back_to_the_last_bit(t: float) -> None:
    assert seconds(nanoseconds(t)) == t


def test_a_pose_that_was_read_is_written_as_it_was() -> None:
    """A record of what came over the link must give the filter the same bits again."""
    for seed in range(300):
        first = messages.pose_from(messages.pose(1.0, "cs", *some_pose(seed)), "test")
        second = messages.pose_from(messages.pose(first[0], "cs", *first[1:]), "test")
        assert first[0] == second[0]
        assert first[1].tobytes() == second[1].tobytes()
        assert first[2].tobytes() == second[2].tobytes()
        assert np.abs(first[1] - some_pose(seed)[0]).max() < 1e-12


def test_exchanges_cameras_clouds_and_status() -> None:
    exchange = Exchange(1795311423.25, 12.5, 12.75, 1795311424.0)
    assert messages.exchange_from(messages.exchange("anna/1", exchange)) == ("anna/1", exchange)
    camera = Camera("fisheye", 640, 480, (300.0, 301.0, 320.5, 240.5), (0.1, 0.01, -0.02, 0.003))
    assert repr(messages.camera_from(messages.camera_info(0.0, "cs", camera), "test")) == repr(camera)
    points = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25]])
    sd = messages.point_sd(np.array([np.diag([0.01, 0.04, 0.01]), np.diag([0.25, 0.0, 0.0])]))
    np.testing.assert_allclose(sd, [0.2, 0.5])
    there, sd_there = messages.cloud_from(messages.cloud(1.0, points, sd, "map"))
    np.testing.assert_array_equal(there, points)
    np.testing.assert_allclose(sd_there, sd, rtol=1e-6)
    assert (
        len(messages.cloud_from(messages.cloud(1.0, points[:0], messages.point_sd(np.empty((0, 3, 3)))))[0])
        == 0
    )
    told = messages.status_from(messages.status(1.0, {"robot": ("LOST", "LOST", {"map_size": 3})}))
    assert told == {"robot": {"message": "LOST", "map_size": "3"}}


def test_the_transforms_lead_from_the_map_to_the_camera() -> None:
    (t_mw, _), (t_wc, _) = some_pose(1), some_pose(0)
    sent = messages.transforms(2.5, ("map", "odom", t_mw), ("odom", "base_link", t_wc))
    links = messages.decoded(messages.TRANSFORMS, sent).transforms
    assert [(k.header.frame_id, k.child_frame_id) for k in links] == [("map", "odom"), ("odom", "base_link")]
    for link, there in zip(links, (t_mw, t_wc), strict=True):
        assert messages.stamp_of(link) == 2.5
        assert (link.transform.translation.x, link.transform.translation.z) == (there[0, 3], there[2, 3])


def test_other_messages_are_refused() -> None:
    with pytest.raises(DataError, match="stamps"):
        messages.times_from(messages.times("x", [1.0]), 2)
    with pytest.raises(DataError, match="Int64MultiArray"):
        messages.times_from(b"\x00\x01\x00\x00\xff", 2)
    with pytest.raises(DataError, match="no name in ROS"):
        messages.camera_info(0.0, "cs", Camera("wideangle", 320, 240, (195.0, 195.0, 162.0, 125.0), (0.1,)))
