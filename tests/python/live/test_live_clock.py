"""Another device's clock in the robot's time."""

from __future__ import annotations

import numpy as np
import pytest

from collabslam.live.clock import ClockEstimator, Exchange

OFFSET, DRIFT = 3.7, 50e-6


def device(t: float) -> float:
    """What the device's clock shows at the robot's time."""
    return t + OFFSET + DRIFT * t


def exchange(t: float, there: float, back: float) -> Exchange:
    received = t + there
    return Exchange(device(t), received, received + 1e-4, device(received + 1e-4 + back))


def busy_link(generator: np.random.Generator, count: int, every: float = 0.5) -> list[Exchange]:
    """One way waits behind images, up to 0.2 s."""
    waits = generator.exponential(0.03, count)
    return [exchange(k * every, 0.005 + wait, 0.005) for k, wait in enumerate(waits)]


def test_offset_and_drift_are_found_on_a_busy_link() -> None:
    errors, sigmas = [], []
    for seed in range(20):
        clock, generator = ClockEstimator(), np.random.default_rng(seed)
        for e in busy_link(generator, 80):
            assert clock.add(e)
        for t in (30.0, 40.0, 41.0):
            found = clock.robot_time(device(t))
            assert found is not None
            errors.append(found[0] - t)
            sigmas.append((found[0] - t) / found[1])
    assert np.abs(errors).max() < 0.005
    assert 0.2 < np.sqrt(np.mean(np.square(sigmas))) < 1.6


def test_nothing_is_said_before_the_first_exchange() -> None:
    clock = ClockEstimator()
    assert clock.robot_time(1.0) is None
    clock.add(exchange(0.0, 0.005, 0.005))
    early = clock.robot_time(device(0.1))
    assert early is not None
    assert early[0] == pytest.approx(0.1, abs=2e-4)
    late = clock.robot_time(device(100.0))
    assert late is not None
    assert late[1] > 0.009  # 100 ppm for 100 s


@pytest.mark.parametrize(
    "impossible",
    [
        Exchange(float("nan"), 1.0, 1.0, 1.0),
        Exchange(0.0, 5.0, 5.0, -1.0),
        Exchange(0.0, 5.0, 4.0, 1.0),
        Exchange(0.0, float("inf"), float("inf"), 1.0),
    ],
)
def test_what_cannot_have_been_is_refused(impossible: Exchange) -> None:
    clock = ClockEstimator()
    assert not clock.add(impossible)
    assert clock.robot_time(0.0) is None


def test_a_clock_that_is_set_is_followed() -> None:
    clock = ClockEstimator()
    for k in range(20):
        clock.add(exchange(0.5 * k, 0.005, 0.005))
    jumped = [
        Exchange(e.sent - 60.0, e.received, e.answered, e.returned - 60.0)
        for e in (exchange(10.0 + 0.5 * k, 0.005, 0.005) for k in range(3))
    ]
    assert [clock.add(e) for e in jumped] == [False, False, True]
    found = clock.robot_time(device(12.0) - 60.0)
    assert found is not None
    assert found[0] == pytest.approx(12.0, abs=1e-3)


def test_one_wrong_exchange_changes_nothing() -> None:
    clock = ClockEstimator()
    for k in range(20):
        clock.add(exchange(0.5 * k, 0.005, 0.005))
    before = clock.robot_time(device(10.0))
    assert not clock.add(Exchange(device(10.0), 500.0, 500.0, device(10.1)))
    assert clock.robot_time(device(10.0)) == before
