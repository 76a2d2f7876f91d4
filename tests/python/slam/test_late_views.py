"""Views of Cf between two frames, late, repeated and out of order, on the demo (METHOD section 21)."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import GLOBAL_SHUTTER

import collabslam
from collabslam import InputError, Settings, Slam
from collabslam.simulation import corridor_recording
from collabslam.types import WornView


@cache
def corridor() -> Any:
    return corridor_recording(length_m=6.0)


@cache
def worn(t: float) -> WornView:
    view = corridor().worn_at(t, round(1000 * t))
    assert view is not None
    return view


@cache
def frame(i: int) -> Any:
    return corridor().frame(i)


def started(count: int = 6, settings: Settings | None = None) -> Slam:
    """An engine after some frames with a view of each one's instant."""
    slam = Slam(corridor().camera, corridor().worn_camera, settings=settings)
    for i in range(count):
        slam.step(frame(i).t, frame(i).image, frame(i).views)
    return slam


def step(slam: Slam, i: int, *views: WornView) -> Any:
    return slam.step(frame(i).t, frame(i).image, views)


def rows(result: Any) -> int:
    return int(result.diagnostics.get("cf_pixel_rows", 0))


@pytest.mark.slow
def test_a_view_between_two_frames_is_used_and_so_is_one_of_half_a_second_ago() -> None:
    slam = started()
    step(slam, 6, worn(0.57))  # from here on poses are kept
    assert rows(step(slam, 7, worn(0.66))) > 5
    for i in range(8, 12):
        step(slam, i)
    result = step(slam, 12, worn(0.73))
    assert rows(result) > 5
    assert not slam.worn_dropped.keys() - {"stale"}  # the very first one, before which no pose was kept
    assert result.status is collabslam.Status.OK


def test_what_is_handed_in_from_other_threads_is_used_by_its_time() -> None:
    one, two = started(), started()
    views = [worn(0.57), worn(0.66), worn(0.75)]
    for slam, order in ((one, views), (two, views[::-1])):
        threads = [threading.Thread(target=slam.add_worn, args=(view,)) for view in order]
        for thread in threads:
            thread.start()
            thread.join()
    for i in range(6, 10):
        a, b = step(one, i), step(two, i)
        assert np.array_equal(a.pose, b.pose)
        assert np.array_equal(a.covariance, b.covariance)
    assert one.worn_dropped == two.worn_dropped


@pytest.mark.slow
def test_what_is_not_used_is_counted_by_its_reason() -> None:
    slam = started()
    step(slam, 6, worn(0.57))
    step(slam, 7, worn(0.66))
    before = slam.worn_dropped
    for view in (worn(0.66), worn(0.75), worn(0.77)):  # measured already, then two for one frame
        slam.add_worn(view)
    assert rows(step(slam, 8)) > 5
    slam.add_worn(replace(worn(0.75), t=60.0))
    for i in range(9, 22):
        step(slam, i)
    step(slam, 22, worn(0.9))
    reasons = {r: n - before.get(r, 0) for r, n in slam.worn_dropped.items() if n != before.get(r, 0)}
    assert reasons == {"repeated": 1, "superseded": 1, "future": 1, "stale": 1}


def test_a_step_that_breaks_off_loses_no_view() -> None:
    slam, again = started(), started()
    for engine in (slam, again):
        step(engine, 6, worn(0.57))
        engine.add_worn(worn(0.66))
    with pytest.raises(InputError, match="does not follow"):
        step(slam, 3)
    a, b = step(slam, 7), step(again, 7)
    assert rows(a) > 5
    assert np.array_equal(a.pose, b.pose)


def test_an_engine_that_keeps_poses_goes_on_from_its_file(tmp_path: Path) -> None:
    slam = started()
    step(slam, 6, worn(0.57))
    step(slam, 7, worn(0.66))
    slam.add_worn(worn(0.93))
    slam.save(tmp_path / "engine")
    again = Slam.load(tmp_path / "engine")
    for i in range(8, 12):
        a, b = step(slam, i), step(again, i)
        assert np.array_equal(a.pose, b.pose)
        assert np.array_equal(a.covariance, b.covariance)
    assert slam.worn_dropped == again.worn_dropped


def test_a_view_of_the_frames_own_time_is_as_one_without_a_time() -> None:
    plain, timed = started(), Slam(corridor().camera, corridor().worn_camera)
    for i in range(6):
        (view,) = frame(i).views
        timed.step(frame(i).t, frame(i).image, [replace(view, t=frame(i).t)])
    assert plain.filter.snapshot() == timed.filter.snapshot()


def test_an_uncertain_clock_makes_every_view_less_certain() -> None:
    exact = Settings.default().replace({**GLOBAL_SHUTTER, "filter.worn.length_sd": 0.0})
    vague = started(settings=exact.replace({"filter.worn.clock_sd": 0.05}))
    # At 1.5 m/s 50 ms are 7.5 cm, where T_CF is known to 3 cm, but mostly across the baseline.
    assert vague.filter.scale_sd > 1.1 * started(settings=exact).filter.scale_sd
    assert vague.filter.worn_clock() == pytest.approx((0.0, 0.05))


def test_the_tolerance_says_which_views_count_as_taken_with_a_frame() -> None:
    jitter = Settings.default().replace({"filter.worn.tolerance": 0.01})
    strict, tolerant = started(), Slam(corridor().camera, corridor().worn_camera, settings=jitter)
    for i in range(6):
        step(tolerant, i, frame(i).views[0])
    after = worn(0.604)
    assert rows(step(strict, 6, after)) == 0  # it waits for the frame after it
    assert rows(step(tolerant, 6, after)) > 5
    before = np.trace(after.covariance)
    _, spread = tolerant.filter.carry_worn(after.t_cf, after.covariance, 0.606, 0.6, who=0)
    assert np.trace(spread) > before  # by the motion in 6 ms


def test_a_view_that_is_handed_in_needs_its_time() -> None:
    with pytest.raises(InputError, match="needs its time"):
        started(1).add_worn(frame(0).views[0])
    with pytest.raises(InputError, match="seconds"):
        started(1).add_worn(replace(frame(0).views[0], t=float("nan")))


def test_a_filter_starts_from_a_view_that_comes_late() -> None:
    slam = Slam(corridor().camera, corridor().worn_camera)
    for i in range(6):
        assert not step(slam, i).started
    result = step(slam, 6, worn(0.04))
    assert result.started
    assert result.status is collabslam.Status.OK
    # W is where Cs was in the frame nearest to the view, and the result says so, once.
    assert result.diagnostics["start_ago_s"] == pytest.approx(0.6)
    assert "start_ago_s" not in step(slam, 7).diagnostics
    true = np.linalg.inv(corridor().truth[0]) @ corridor().truth[6]
    off = result.pose[:3, 3] - true[:3, 3]
    assert np.linalg.norm(off) < 0.25 * np.linalg.norm(true[:3, 3])
