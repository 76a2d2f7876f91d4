"""How a worn camera turned, beside its images: over the link, into a record, and into the filter."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("rosbags", reason="the extra live is not installed")

from collabslam import DataError, InputError, Settings, Slam
from collabslam.live import messages, names
from collabslam.live.clock import Exchange
from collabslam.live.core import Event
from collabslam.live.device_rates import DeviceRates
from collabslam.live.plan import LivePlan
from collabslam.live.record import EventReader, EventWriter
from collabslam.live.replay import replay
from collabslam.live.slam import LiveSlam
from collabslam.live.uplink import Uplink
from collabslam.live.views import LiveView
from collabslam.types import Array

JPEG = b"\xff\xd8\xff\xe0 and so on"
RATE = np.array([0.3, -1.2, 0.1])


def told(*samples: tuple[float, float], session: str = "anna/1") -> DeviceRates:
    rates = DeviceRates()
    for t, size in samples:
        rates.add(session, t, RATE * size)
    return rates


@pytest.mark.parametrize(
    ("t", "size"), [(7.0, 1.0), (7.005, 1.5), (7.01, 2.0), (7.025, 2.0), (7.035, None), (6.99, None)]
)
def test_a_rate_is_between_two_samples_or_just_after_the_last(t: float, size: float | None) -> None:
    found = told((7.0, 1.0), (7.01, 2.0)).at("anna/1", t)
    assert (found is None) == (size is None)
    if size is not None:
        np.testing.assert_allclose(found, RATE * size)


def test_a_gap_and_another_session_tell_nothing() -> None:
    rates = told((7.0, 1.0), (7.2, 2.0))
    assert rates.at("anna/1", 7.1) is None
    assert rates.at("anna/2", 7.2) is None
    rates.add("anna/2", 1.0, RATE)  # another clock
    assert rates.at("anna/1", 7.2) is None
    np.testing.assert_array_equal(rates.at("anna/2", 1.0), RATE)


@pytest.mark.parametrize(
    ("t", "rate"),
    [(7.0, RATE), (6.0, RATE), (8.0, RATE * math.nan), (8.0, RATE * math.inf), (8.0, np.degrees(RATE) * 2.0)],
)
def test_what_is_none_is_refused(t: float, rate: Array) -> None:
    rates = told((7.0, 1.0))
    with pytest.raises(DataError):
        rates.add("anna/1", t, rate)
    np.testing.assert_array_equal(rates.at("anna/1", 7.0), RATE)


def listening(*, unposed: bool = False) -> tuple[Uplink, list[Event]]:
    events: list[Event] = []
    return Uplink(events.append, lambda: 7.0, unposed=unposed), events


def view_of(up: Uplink, name: str, t: float = 7.0) -> None:
    up.take(names.key(name, names.T_CF), messages.pose(t, "cs", np.eye(4), np.eye(6)))
    up.take(names.key(name, names.IMAGE), messages.compressed_image(t, f"{name}/1", JPEG))


@pytest.mark.parametrize("unposed", [False, True])
def test_an_image_has_what_its_own_device_said(*, unposed: bool) -> None:
    up, events = listening(unposed=unposed)
    up.take(names.key("anna", names.RATE), messages.rate(7.0, RATE, frame="anna/1"))
    up.take(
        names.key("eve", names.RATE), messages.rate(7.0, -RATE, frame="anna/1")
    )  # of eve, whatever it says
    for name in ("anna", "eve", "ben"):
        view_of(up, name)
    rates = {e.session: e.rate for e in events if isinstance(e, LiveView)}
    np.testing.assert_array_equal(rates["anna/1"], RATE)
    np.testing.assert_array_equal(rates["eve/1"], -RATE)
    assert rates["ben/1"] is None
    assert up.counts() == {}


def test_bad_rates_cost_only_themselves_and_too_many_are_not_heard() -> None:
    up, events = listening()
    none = messages.attitude(7.1, "anna/1", np.array([0.0, 0.0, 0.0, 1.0]))  # no angular velocity
    for payload in (
        messages.rate(7.0, RATE, frame="anna/1"),
        messages.rate(7.0, RATE, frame="anna/1"),
        messages.rate(7.1, RATE * math.nan, frame="anna/1"),
        messages.rate(7.1, RATE, frame="anna/a b"),
        none,
    ):
        up.take(names.key("anna", names.RATE), payload)
    assert up.counts() == {"malformed": 4}
    view_of(up, "anna")
    (view,) = [e for e in events if isinstance(e, LiveView)]
    np.testing.assert_array_equal(view.rate, RATE)
    for k in range(1000):
        up.take(names.key("anna", names.RATE), messages.rate(8.0 + k / 1000.0, RATE, frame="anna/1"))
    assert up.counts()["too many"] > 500


def test_a_record_keeps_it_and_a_replay_is_the_same(clip: Clip, tmp_path: Path) -> None:
    source = clip.recording
    plan = LivePlan("collab-tight", "worn", dict(Settings.default().values), [], [])
    rates: list[Array | None] = []
    with EventWriter(tmp_path / "record", plan, source.camera, {"": source.worn_camera}) as record:
        slam = Slam(source.camera, source.worn_camera)
        with LiveSlam(slam, on_event=lambda e: record.write(e, 0.0)) as live:
            live.push_clock("worn", Exchange(0.0, 0.0, 0.0, 0.0))
            for k, frame in enumerate(clip.frames[:4]):
                for view in frame.views:
                    png = bytes(cv2.imencode(".png", view.image)[1])
                    rate = None if k == 1 else np.array([0.01, 0.02 * k, -0.03])
                    rates.append(rate)
                    live.push_worn(frame.t, png, view.t_cf, view.covariance, rate=rate)
                live.push_robot(frame.t, frame.image)
            with pytest.raises(InputError, match="rate of Cf has the shape"):
                live.push_worn(9.0, b"", rate=[1.0])
    assert not live.refused
    found = [e.rate for e in EventReader(tmp_path / "record").events() if isinstance(e, LiveView)]
    assert len(found) == len(rates) >= 2
    for got, sent in zip(found, rates, strict=True):
        assert (got is None) == (sent is None)
        if sent is not None:
            np.testing.assert_array_equal(got, sent)
    replay(tmp_path / "record", tmp_path / "again")
    last = (tmp_path / "again" / "trajectory.tum").read_text().splitlines()[-1].split()
    assert float(last[0]) == pytest.approx(clip.frames[3].t)
    np.testing.assert_allclose([float(x) for x in last[1:4]], slam.filter.pose[:3, 3], atol=1e-6)


def test_a_rate_that_none_can_be_is_a_view_that_is_refused(clip: Clip) -> None:
    source, frame = clip.recording, clip.frames[0]
    view = frame.views[0]
    slam = Slam(source.camera, source.worn_camera)
    with LiveSlam(slam, same_clock=True) as live:
        live.push_worn(frame.t, view.image, view.t_cf, view.covariance, rate=[0.0, 0.0, 1e3])
        live.push_robot(frame.t, frame.image)
    assert live.dropped == {"refused": 1}
