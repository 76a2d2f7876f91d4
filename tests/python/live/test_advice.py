"""What a phone's wearer is told of the phone's images."""

from __future__ import annotations

import pytest

from collabslam.live.advice import _MEANS, REPORTS, OwnImages
from collabslam.live.uplink import CALIBRATION, FLOOD, MALFORMED, UNPAIRED
from collabslam.live.views import REASONS


def said(*reports: dict[str, int]) -> tuple[str, bool]:
    own = OwnImages()
    return [own.report({name: f"{value}" for name, value in report.items()}) for report in reports][-1]


def test_images_that_are_used_are_well() -> None:
    text, good = said({"images": 0}, {"images": 5, "used": 2})
    assert good
    assert "uses your images" in text


def test_a_phone_whose_images_are_all_dropped_is_told_what_to_do() -> None:
    """It is not enough that they are sent."""
    text, good = said({"images": 0, "dropped no pose": 0}, {"images": 20, "dropped no pose": 12})
    assert not good
    assert "show the tag to both cameras" in text


@pytest.mark.parametrize("reason", [*REASONS, UNPAIRED, MALFORMED, FLOOD, CALIBRATION])
def test_each_reason_has_words(reason: str) -> None:
    text, good = said({"images": 0}, {"images": 20, f"dropped {reason}": 12, "dropped stale": 3})
    assert not good
    assert text == _MEANS[reason]


def test_what_is_over_is_not_said_any_more() -> None:
    dropped = [{"images": 10 * k, "dropped no pose": 10 * k} for k in range(3)]
    used = [{"images": 20 + 10 * k, "dropped no pose": 20, "used": k} for k in range(REPORTS + 1)]
    assert said(*dropped, *used)[1]
    again = [{"images": 80 + 10 * k, "dropped no pose": 20 + 10 * k, "used": 6} for k in range(REPORTS + 1)]
    assert not said(*dropped, *used, *again)[1]


def test_images_that_do_not_arrive_and_robots_that_begin_anew() -> None:
    assert "No image" in said({"images": 7}, {"images": 7})[0]
    assert "has not said yet" in said({"images": 7})[0]
    assert "has not said yet" in said({"images": 7}, {"images": 2})[0]
    assert "Look at what the robot sees" in said({"images": 7}, {"images": 12})[0]
