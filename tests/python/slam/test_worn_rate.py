"""A worn camera's own gyroscope: births from a shutter that rolls while its wearer turns (METHOD 6)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.rolling_worn import FAST, WRONG, View

import collabslam
from collabslam import InputError, Settings, Slam
from collabslam.results import StepResult
from collabslam.simulation import corridor_recording
from collabslam.types import Array

SEEDS = 12


def measured(
    rate: Array | None, count: int = 40, turn: Array = FAST, **changes: float
) -> list[tuple[str, float, float]]:
    return [View(seed, turn, count).measured(rate, **changes) for seed in range(SEEDS)]


def rms(found: list[tuple[str, float, float]]) -> float:
    return math.sqrt(np.mean([wrong**2 for _, wrong, _ in found]))


def squares(found: list[tuple[str, float, float]]) -> float:
    return float(np.mean([square for _, _, square in found]))


@pytest.mark.parametrize(("count", "least"), [(40, 0.65), (12, 0.5)])
def test_with_the_rate_births_from_a_fast_turn_err_less_and_as_much_as_they_say(
    count: int, least: float
) -> None:
    with_rate, without = measured(FAST, count), measured(None, count)
    assert rms(with_rate) < least * rms(without)
    assert {outcome for outcome, *_ in with_rate} == {"rate"}
    assert squares(with_rate) < 1.3


def test_it_helps_where_nothing_is_told_of_the_readout_too() -> None:
    untold = {"readout": 0.0192, "readout_sd": 0.0096}
    with_rate, without = measured(FAST, **untold), measured(None, **untold)
    assert rms(with_rate) < 0.8 * rms(without)
    assert squares(with_rate) < 1.3


@pytest.mark.parametrize(
    "name", ["degrees for radians", "axes exchanged", "signs turned round", "stuck at zero"]
)
def test_a_rate_that_the_matches_contradict_is_refused_and_changes_nothing(name: str) -> None:
    got, without = measured(WRONG[name]), measured(None)
    assert all(outcome.startswith("rejected") for outcome, *_ in got)
    assert rms(got) < 1.02 * rms(without)
    assert squares(got) < 1.3


@pytest.mark.parametrize("wrong", [FAST[[1, 2, 0]], -FAST, np.zeros(3)])
def test_where_few_matches_cannot_contradict_it_a_wrong_rate_does_not_make_them_surer_than_right(
    wrong: Array,
) -> None:
    slow = 0.3 * FAST
    assert squares(measured(0.3 * wrong, 12, slow)) < 1.3


def test_without_a_rate_nothing_changes() -> None:
    view = View(0)
    assert view.measured(None) == view.measured(None, readout_sd=0.0, rate_sd=1.0)


@pytest.mark.parametrize("rate", [[0.0, math.nan, 0.0], [1e3, 0.0, 0.0], [0.0, 0.0]])
def test_rates_that_none_can_be_are_refused(rate: list[float]) -> None:
    with pytest.raises(InputError):
        View(0).measured(np.array(rate))


@cache
def corridor() -> Any:
    return corridor_recording(length_m=3.0)


def run(
    rates: dict[int, Array], count: int = 9, slam: Slam | None = None, first: int = 0
) -> tuple[Slam, list[StepResult]]:
    """The demo, whose shutters take all rows at once whatever is told, with rates of Cf in these frames."""
    told = Settings.default().replace({"filter.worn.readout": 0.02, "filter.worn.readout_sd": 0.002})
    slam = slam or Slam(corridor().camera, corridor().worn_camera, settings=told)
    steps = []
    for i in range(first, count):
        frame = corridor().frame(i)
        views = [replace(view, rate=rates.get(i)) for view in frame.views]
        steps.append(slam.step(frame.t, frame.image, views))
    return slam, steps


def test_one_that_is_contradicted_four_times_is_not_asked_any_more() -> None:
    wrong = {i: np.array([1.5, -2.0, 1.0]) for i in range(9)}
    _, with_rate = run(wrong)
    told = [step.diagnostics.get("cf_rate_contradicted", 0) for step in with_rate]
    assert sum(told) == 4
    assert sum(step.diagnostics.get("cf_rate_used", 0) for step in with_rate) <= 1  # before there is a turn
    assert told[-1] == 0  # left out
    _, without = run({})
    assert all("cf_rate_used" not in step.diagnostics for step in without)
    assert [step.status for step in with_rate] == [step.status for step in without]
    truth = corridor().truth
    for a, b, true in zip(with_rate[1:], without[1:], truth[1:], strict=False):
        moved = np.linalg.norm((truth[0, :3, :3].T @ (true[:3, 3] - truth[0, :3, 3])) - a.pose[:3, 3])
        assert moved < 0.05 + np.linalg.norm(a.pose[:3, 3] - b.pose[:3, 3])


def test_one_that_is_right_is_used_and_a_checkpoint_knows_what_was_said(tmp_path: Path) -> None:
    still = {i: np.zeros(3) for i in range(9)}
    _, steps = run(still)
    assert sum(step.diagnostics.get("cf_rate_used", 0) for step in steps) >= 3
    wrong = {i: np.array([1.5, -2.0, 1.0]) for i in range(9)}
    slam, _ = run(wrong, 5)
    slam.save(tmp_path / "engine")
    _, again = run(wrong, 9, collabslam.Slam.load(tmp_path / "engine"), 5)
    _, whole = run(wrong)
    for a, b in zip(again, whole[5:], strict=True):
        np.testing.assert_array_equal(a.pose, b.pose)
        assert a.diagnostics.get("cf_rate_contradicted") == b.diagnostics.get("cf_rate_contradicted")


def test_a_rate_that_none_can_be_refuses_the_view() -> None:
    frame = corridor().frame(0)
    for rate in ([0.0, 0.0, math.nan], [0.0, 0.0], [0.0, 0.0, 200.0]):
        slam = Slam(corridor().camera, corridor().worn_camera)
        with pytest.raises(InputError):
            slam.step(frame.t, frame.image, [replace(frame.views[0], rate=np.array(rate))])
