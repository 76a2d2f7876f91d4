"""A run that goes wrong says so: what adds up over frames though no single one shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from collabslam.settings.table import Settings
from collabslam.slam.doubts import CAUSES, NOTHING, Doubts
from collabslam.slam.worn_frame import Overlap
from collabslam.types import Array, WornView

FRAMES, FOUND = 40, 30


def doubts() -> Doubts:
    return Doubts(Settings.default().section("filter"))


def outcomes(refused: int) -> Any:
    return SimpleNamespace(rejected_gate=0, rejected_batch=refused, rejected_conditional=0)


def report(*, refused: int = 0, worn: int = 0, nis: float = 30.0, accepted: bool = True) -> Any:
    """Of an update with thirty bearings."""
    return SimpleNamespace(
        accepted=accepted, bearings=outcomes(refused), pairs=outcomes(worn), nis=nis, dof=2 * FOUND
    )


def seen(correction: Array, *, refused: bool = False) -> Overlap:
    """Twenty matches with Cf, whose T_CF is stated to 3 cm and 0.01 rad."""
    covariance = np.diag([9e-4] * 3 + [1e-4] * 3)
    view = WornView(np.zeros((4, 4), np.uint8), np.eye(4), covariance)
    overlap = Overlap(ids=np.arange(20), points=60, correction=correction, refused=refused)
    return overlap if refused else replace(overlap, worn=view)


def verdict(frame: Callable[[int], tuple[Any, Overlap]]) -> str:
    """What is said after many frames, each a report and what Cf saw."""
    judge, said = doubts(), NOTHING
    for k in range(FRAMES):
        said = judge.judge(frame(k)[0], FOUND, frame(k)[1])
    return said


def test_a_good_run_is_never_doubted() -> None:
    rng, judge = np.random.default_rng(4), doubts()
    shared = np.array([0.03, -0.03, 0.03, 0.01, -0.01, 0.01])  # one error of T_CF in all views
    for k in range(300):
        frame = report(
            refused=int(rng.poisson(0.03 * FOUND)),
            worn=int(rng.poisson(0.4)),
            nis=float(rng.chisquare(2 * FOUND)),
        )
        assert judge.judge(frame, FOUND, seen(shared) if k % 3 else Overlap()) == NOTHING, k


@pytest.mark.parametrize(
    ("cause", "frame"),
    [
        ("matches", (report(refused=5), Overlap())),
        ("noise", (report(nis=90.0), Overlap())),
        ("cf_matches", (report(worn=4), seen(np.zeros(6)))),
        ("t_cf", (report(), seen(np.array([0.09, -0.09, 0.09, 0.03, 0.0, 0.0])))),
        ("t_cf", (report(), seen(np.full(6, np.nan), refused=True))),
    ],
)
def test_what_adds_up_over_frames_is_named(cause: str, frame: tuple[Any, Overlap]) -> None:
    assert cause in CAUSES
    assert verdict(lambda k: frame) == cause


def test_what_cf_showed_is_forgotten_where_it_shows_nothing_any_more() -> None:
    judge, shifted = doubts(), seen(np.array([0.09, -0.09, 0.09, 0.03, 0.0, 0.0]))
    said = [judge.judge(report(), FOUND, shifted if k < 10 else Overlap()) for k in range(50)]
    assert said[9] == said[39] == "t_cf"
    assert said[40:] == [NOTHING] * 10


def test_four_frames_are_too_few() -> None:
    judge = doubts()
    said = [judge.judge(report(refused=FOUND // 2, nis=900.0), FOUND, Overlap()) for _ in range(5)]
    assert said[:4] == [NOTHING] * 4
    assert said[4] == "matches"


def test_corrections_that_cancel_are_noise() -> None:
    sds = np.array([0.03] * 3 + [0.01] * 3)
    assert verdict(lambda k: (report(), seen(2.4 * sds * (-1.0) ** k))) == NOTHING


def test_frames_that_were_not_used_say_nothing() -> None:
    assert verdict(lambda k: (report(refused=FOUND, accepted=False), Overlap())) == NOTHING


def test_it_goes_on_where_it_was() -> None:
    first, second = doubts(), doubts()
    for _ in range(20):
        first.judge(report(refused=5), FOUND, seen(np.zeros(6)))
    second.restore(first.state())
    assert second.judge(report(), FOUND, Overlap()) == first.judge(report(), FOUND, Overlap()) == "matches"
