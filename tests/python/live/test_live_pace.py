"""How much a worn camera sends: less when images come late, more when they are fresh."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.clip import Clip

from collabslam.live.pace import (
    AGAIN,
    COURAGE,
    JUDGED,
    LEVELS,
    PATIENCE,
    PROMPT,
    SCALES,
    TRIED,
    Encoder,
    Pace,
    Transport,
)


def report(pace: Pace, age: float, times: int) -> None:
    for _ in range(times):
        pace.report(age, pace._images + 1)


def test_old_images_cost_size_first_and_then_rate() -> None:
    pace = Pace()
    seen = [pace.level]
    for _ in LEVELS:
        report(pace, 0.5, PATIENCE)
        seen.append(pace.level)
    assert tuple(dict.fromkeys(seen)) == LEVELS
    sizes, rates = [level.size for level in LEVELS], [level.rate for level in LEVELS]
    assert sizes == sorted(sizes, reverse=True)
    assert rates == sorted(rates, reverse=True)
    assert rates[sizes.index(min(sizes))] == max(rates)


def test_fresh_images_bring_it_back_and_one_report_changes_nothing() -> None:
    pace = Pace()
    report(pace, 0.5, PATIENCE)
    report(pace, 0.01, COURAGE - 1)
    assert pace.level == LEVELS[1]
    report(pace, 0.01, 1)
    assert pace.level == LEVELS[0]
    for _ in range(10):
        report(pace, 0.5, PATIENCE - 1)
        report(pace, 0.1, 1)
    assert pace.level == LEVELS[0]


def test_a_report_that_is_said_again_counts_once() -> None:
    pace = Pace()
    for _ in range(100):
        pace.report(0.5, 7.0)
    assert pace.level == LEVELS[0]


@pytest.mark.parametrize("size", [5_000, 10_000])
def test_images_have_about_the_wanted_size(clip: Clip, size: int) -> None:
    encoder, sizes = Encoder(), []
    for _ in range(4):
        for frame in clip.frames[:13]:
            assert frame.views
            data = encoder.encode(frame.views[0].image, size)
            sizes.append(len(data))
    assert 0.7 * size < np.median(sizes[-13:]) < 1.3 * size
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image.ndim == 2
    assert image.shape[1] / 720 in SCALES


def test_plain_images_go_out_whole() -> None:
    encoder = Encoder()
    plain = np.full((480, 720), 90, np.uint8)
    for _ in range(5):
        data = encoder.encode(plain, 10_000)
    assert len(data) < 10_000
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED).shape == (480, 720)


def told(
    transport: Transport, reports: int, share: float, *, every: float = 0.5, t: float = 0.0
) -> tuple[int, float]:
    """Reports of a robot that gets a share of what goes as datagrams, and all else; what was sent, when."""
    sent = received = 0
    for _ in range(reports):
        for _ in range(5):
            received += transport.datagrams(sent) is False or (sent * share) % 1.0 + share >= 1.0
            sent += 1
        t += every
        transport.report(t, sent, received)
    return sent, t


def test_datagrams_are_used_while_most_of_them_arrive() -> None:
    transport = Transport()
    sent, _ = told(transport, 100, 0.7)
    assert transport.datagrams(sent)


def test_a_network_that_loses_every_datagram_is_given_up_and_tried_again() -> None:
    transport = Transport()
    assert transport.datagrams(0)
    sent, _ = told(transport, 1 + TRIED // 5, 0.0)
    assert not transport.datagrams(sent)
    assert not transport.datagrams(sent + AGAIN - 6)
    assert transport.datagrams(sent + AGAIN)


def test_a_burst_that_takes_most_of_ten_images_does_not_end_datagrams() -> None:
    transport = Transport()
    sent = received = 0
    for k in range(80):  # of every 20 images 3 of the first ten and 9 of the others
        received += k % 20 in (0, 4, 8) or k % 20 > 10
        sent += 1
        if sent % 5 == 0:
            transport.report(0.1 * sent, sent, received)
    assert transport.datagrams(sent)


def test_a_network_that_loses_most_datagrams_is_given_up() -> None:
    transport = Transport()
    sent, _ = told(transport, 2 + JUDGED // 5, 0.25)
    assert not transport.datagrams(sent)


def test_what_was_sent_into_the_dark_says_nothing() -> None:
    transport = Transport()
    sent, _ = told(transport, 20, 0.0, every=PROMPT + 0.1)
    assert transport.datagrams(sent)
    transport.report(1000.0, 500, 0)
    transport.report(1000.4, 502, 1)  # a robot that was started anew counts from the beginning
    assert transport.datagrams(502)
