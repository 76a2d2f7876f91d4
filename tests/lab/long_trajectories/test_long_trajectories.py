"""The study of long trajectories: what its numbers say of trajectories that went one way or the other."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collabslam.batch.engines import LOCAL
from collabslam.types import Array
from collabslam_lab.long_trajectories.drawing import plan_view
from collabslam_lab.long_trajectories.keeping import Trajectory, go
from collabslam_lab.long_trajectories.study import summary, trajectories
from collabslam_lab.long_trajectories.walk import Walked
from collabslam_lab.worlds.route import CELL, Route


def _walked(name: str = "ring", loops: int = 1) -> Walked:
    ms = np.full(100, 10.0)
    ms[90:] = 12.0
    ms[15] = 30.0
    odometry: Array = np.linspace(0.0, 1.0, 100)
    corrected = np.where(np.arange(100) >= 50, odometry / 4.0, odometry)
    trajectory = np.column_stack([np.arange(100.0), np.zeros(100), np.ones(100)])
    return Walked(
        name,
        ms,
        odometry,
        corrected,
        50 if loops else None,
        loops,
        0,
        5.0 if loops else math.nan,
        7.0 if loops else math.nan,
        6.0 if loops else math.nan,
        1000,
        0.25,
        0.5,
        trajectory,
        trajectory[::10],
        [(0, 5)] if loops else [],
        trajectory,
    )


def test_the_numbers_are_of_the_ways_that_closed_a_loop() -> None:
    wrong = replace(_walked(), false=1, nees_mid=9.0)
    alike = replace(_walked("alike"), false=2, nees_mid=90.0)
    numbers = summary([_walked(), wrong, _walked(loops=0), alike])
    assert numbers["trajectories"] == 4
    assert numbers["frames"] == 100
    assert numbers["loops"] == 3
    assert numbers["false_loops"] == 3
    assert abs(numbers["error_before_over_after"] - 4.0) < 1e-9
    assert numbers["nees_mid"] == 7.0
    assert (numbers["nees_end"], numbers["nees_between"]) == (7.0, 6.0)
    assert abs(numbers["ms_median_ratio_last_over_second_tenth"] - 1.2) < 1e-9
    assert numbers["ms_p99_ratio_last_over_second_tenth"] < 1.0
    assert numbers["bytes_a_submap"] == 100.0


def test_without_a_loop_there_is_nothing_to_say_of_its_gain() -> None:
    numbers = summary([_walked(loops=0)])
    assert math.isnan(numbers["error_before_over_after"])
    assert numbers["loops"] == numbers["false_loops"] == 0


def test_the_times_and_the_saving_are_of_the_longest_trajectory() -> None:
    longer = replace(_walked(), ms=np.full(200, 3.0), load_s=4.0)
    numbers = summary([_walked(), longer, _walked()])
    assert (numbers["frames"], numbers["ms_max"], numbers["map_load_s"]) == (200, 3.0, 4.0)
    assert numbers["ms_median_ratio_last_over_second_tenth"] == 1.0


def test_the_ways_go_round_and_one_is_ten_thousand_frames_long() -> None:
    all_of_them = trajectories(None, quick=False)
    for trajectory, laps in ((all_of_them[0], 34), (all_of_them[1], 2), (all_of_them[-1], 2)):
        route = Route(trajectory.recipe.route)
        place, _ = route.along(np.array([1.0, 1.0 + route.length / laps]))
        assert np.linalg.norm(place[1] - place[0]) < 0.1 * CELL
    assert Route(all_of_them[0].recipe.route).length / all_of_them[0].recipe.speed * 10.0 > 9800
    assert len({trajectory.seed for trajectory in all_of_them[1:] if trajectory.recipe.name == "ring"}) == 50


def test_a_hundred_buildings_have_walls_that_repeat() -> None:
    alike = [w for w in trajectories([3], quick=False) if w.recipe.style.walls == "repeated"]
    assert len({w.recipe.seed for w in alike}) == len({w.recipe.name for w in alike}) == 100
    assert [w.recipe.style.walls for w in trajectories(None, quick=True)] == ["mixed", "repeated"]


def test_what_came_of_a_way_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trajectory = Trajectory(trajectories([3], quick=True)[0].recipe, 3, 4)
    (first,) = go([trajectory], tmp_path, jobs=1, engine=LOCAL)
    (kept,) = tmp_path.iterdir()
    assert (first.name, len(first.ms), first.trajectory.shape) == ("ring", 4, (4, 3))
    (again,) = go([trajectory], tmp_path, jobs=1, engine=LOCAL)
    assert "1 of 1 runs are there already" in capsys.readouterr().out
    for field in dataclasses.fields(first):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(first, field.name))
    kept.write_text("[1, 2")
    (anew,) = go([trajectory], tmp_path, jobs=1, engine=LOCAL)
    assert anew.trajectory.tobytes() == first.trajectory.tobytes()
    for count, other in ((2, replace(trajectory, frames=5)), (3, replace(trajectory, seed=4, frames=5))):
        go([other], tmp_path, jobs=1, engine=LOCAL)
        assert len(list(tmp_path.iterdir())) == count


def test_the_plan_view_is_a_picture() -> None:
    assert plan_view(_walked())[:8] == b"\x89PNG\r\n\x1a\n"
