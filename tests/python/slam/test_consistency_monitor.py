"""A run that goes wrong says so: what adds up over frames though no single one shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from collabslam._core import FilterSettings
from collabslam.geometry import pose
from collabslam.slam.consistency_monitor import CAUSES, NOTHING, ConsistencyMonitor
from collabslam.slam.map.size import MapSize
from collabslam.slam.map_change import MapChange
from collabslam.slam.usual_speed import UsualSpeed
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import WornView

FRAMES, FOUND = 40, 30
VIEW = WornView(np.zeros((4, 4), np.uint8), np.eye(4), np.diag([9e-4] * 3 + [1e-4] * 3))


def map_size(speed: float = 1.0, known: int = 0) -> tuple[MapSize, Any]:
    """What is known of a map, and the camera in it, which has gone at a speed (m/s) for many frames."""
    velocity = np.array([0.0, 0.0, speed])
    twist = np.concatenate([velocity, np.zeros(3)])
    core: Any = SimpleNamespace(followed_gyro=False, velocity=velocity, twist=twist, doubted=[])
    core.doubt_length = lambda number, sd: core.doubted.append((number, sd))
    usual = UsualSpeed(core)
    for k in range(known):
        usual.take(0.1 * k, accepted=True, lost=False, trusted=True)
    return MapSize(core, usual, bias_time=10.0), core


def monitor() -> ConsistencyMonitor:
    return ConsistencyMonitor(FilterSettings(), map_size()[0])


def outcomes(refused: int) -> Any:
    return SimpleNamespace(rejected_gate=0, rejected_batch=refused, rejected_conditional=0)


def report(
    *,
    refused: int = 0,
    worn: int = 0,
    nis: float = 30.0,
    accepted: bool = True,
    error: Any = np.zeros(6),  # noqa: B008 (never written to)
    told: float = 0.5,
    of_map: float = 0.0,
) -> Any:
    """Of an update with thirty bearings, which took a share ``told`` of T_CF's variance away.

    Errors of the map that last may have moved it by another ``of_map`` of that variance.
    """
    return SimpleNamespace(
        accepted=accepted,
        bearings=outcomes(refused),
        views=[outcomes(worn)],
        nis=nis,
        dof=2 * FOUND,
        worn_error=error,
        worn_error_covariance=(1.0 - told) * VIEW.covariance,
        worn_error_of_map=of_map * VIEW.covariance,
    )


def seen(*against: float, size: float = float("nan")) -> Overlaps:
    """Twenty matches with each Cf, and how much they contradict T_CF, and the map's size."""
    each = [
        Overlap(k, VIEW, VIEW, 0.0, ids=np.arange(20), points=60, against=a, size=size)
        for k, a in enumerate(against)
    ]
    refused = [max(a, size) > 1.0 for a in against]
    return Overlaps(
        tuple(replace(o, refused=no, measured=not no) for o, no in zip(each, refused, strict=True))
    )


def born(off_arc: int = 0, by: float = 1.0) -> MapChange:
    """Five candidates became features, others are off their arc by so many times what is allowed."""
    return MapChange(delayed={k: k for k in range(5)}, off_arc=np.full(off_arc, by))


def verdict(frame: Callable[[int], tuple[Any, Overlaps, MapChange]]) -> str:
    """What is said after many frames, each a report, what Cf saw and what was born."""
    judge, said = monitor(), NOTHING
    for k in range(FRAMES):
        update, overlap, change = frame(k)
        said = judge.judge(update, FOUND, overlap, change)
    return said


def test_a_good_run_is_never_degraded() -> None:
    rng, judge = np.random.default_rng(4), monitor()
    for k in range(300):
        frame = report(
            refused=int(rng.poisson(0.03 * FOUND)),
            worn=int(rng.poisson(0.4)),
            nis=float(rng.chisquare(2 * FOUND)),
        )
        against = 1.5 if k % 5 == 0 else float(rng.uniform(0.0, 0.9))  # a view in five says otherwise
        overlap = seen(against) if k % 3 else Overlaps()
        assert judge.judge(frame, FOUND, overlap, born(int(rng.random() < 0.005))) == NOTHING, k


@pytest.mark.parametrize(
    ("cause", "frame"),
    [
        ("matches", (report(refused=5), Overlaps(), born())),
        ("noise", (report(nis=90.0), Overlaps(), born())),
        ("moving", (report(), Overlaps(), born(off_arc=1))),
        ("cf_matches", (report(worn=4), seen(0.1), born())),
        ("t_cf", (report(), seen(1.1), born())),
    ],
)
def test_what_adds_up_over_frames_is_named(cause: str, frame: tuple[Any, Overlaps, MapChange]) -> None:
    assert cause in CAUSES
    assert verdict(lambda k: frame) == cause


@pytest.mark.parametrize(("lasting", "least", "most"), [(0.0, 1.0, 1.6), (0.9, 1.8, 4.0)])
def test_a_map_that_moves_t_cf_too_far_names_it(lasting: float, least: float, most: float) -> None:
    """So many sigma in all directions: white errors never are, those that last may be by chance."""
    sd = np.sqrt(np.diag(VIEW.covariance))

    def said(sigmas: float) -> str:
        view = replace(VIEW, bias=lasting * VIEW.covariance)
        shown = replace(seen(0.1).each[0], given=view, worn=view)
        update = report(error=sigmas * sd)
        return verdict(lambda k: (update, Overlaps((shown,)), born()))

    assert said(least) == NOTHING
    assert said(most) == "t_cf"


def test_what_one_view_refuses_has_one_cause() -> None:
    """Some views with an error of their own lose half of their matches; most of a wrong map's lose some."""

    def said(refused: list[int]) -> list[str]:
        judge = monitor()
        return [judge.judge(report(worn=r), FOUND, seen(0.1), born()) for r in refused]

    some = [2, 0, 2, 11, 9, 5, 1, 2, 0, 2, 3, 0, 0, 0, 1] * 2
    assert sum(some) > 0.12 * 20 * len(some), "by far more than one in twenty"
    assert set(said(some)) == {NOTHING}
    assert said([3, 2] * 15)[-1] == "cf_matches"
    judge = monitor()
    assert {judge.judge(report(refused=r), FOUND, Overlaps(), born()) for r in some} == {NOTHING}


def test_who_strays_far_at_once_says_less_than_who_strays_slowly() -> None:
    """Somebody who walks by leaves no landmarks; what moves slowly along its epipolar lines does."""
    said = {}
    for by in (1.1, 4.0):
        judge = monitor()
        for _ in range(60):
            judge.judge(report(), FOUND, Overlaps(), born())
        said[by] = [judge.judge(report(), FOUND, Overlaps(), born(off_arc=4, by=by)) for _ in range(12)][-1]
    assert said == {1.1: "moving", 4.0: NOTHING}


def test_who_passes_by_degrades_frames_where_many_new_points_are_on_them() -> None:
    """Five candidates end in each frame; of those of a hundred frames a twentieth may move."""
    judge, said = monitor(), []
    for k in range(190):
        passing = 60 <= k < 72
        said.append(judge.judge(report(), FOUND, Overlaps(), born(off_arc=4 * passing, by=1.1)))
    assert said[71:160] == ["moving"] * 89
    assert said[172:] == [NOTHING] * 18
    judge, said = monitor(), []
    for k in range(190):
        passing = 60 <= k < 66  # more than wrong matches explain, but outvoted
        said.append(judge.judge(report(), FOUND, Overlaps(), born(off_arc=4 * passing, by=1.1)))
    assert said[101:] == [NOTHING] * 89


def test_what_cf_showed_is_forgotten_where_it_shows_nothing_any_more() -> None:
    judge = monitor()
    said = [judge.judge(report(), FOUND, seen(2.0) if k < 10 else Overlaps(), born()) for k in range(50)]
    assert said[9] == said[39] == "t_cf"
    assert said[40:] == [NOTHING] * 10
    judge = monitor()
    for k in range(80):  # it comes back: what was said of T_CF still counts
        judge.judge(report(), FOUND, seen(0.2 if k < 30 else 2.0) if k < 30 or k > 77 else Overlaps(), born())
    assert judge.judge(report(), FOUND, seen(2.0), born()) == NOTHING


def test_a_map_of_another_size_is_degraded_until_views_confirm_it() -> None:
    size, _ = map_size()
    judge = ConsistencyMonitor(FilterSettings(), size)
    views = [seen(0.1, size=0.1)] * 10 + [seen(0.1, size=3.0)] * 10 + [Overlaps()] * 50
    said = []
    for k, view in enumerate([*views, *[seen(0.1, size=0.1)] * 9]):
        size.take(view, pose(np.eye(3), [0.1 * k, 0.0, 0.0]))
        said.append(judge.judge(report(), FOUND, view, born()))
    assert said == [NOTHING] * 13 + ["size"] * 60 + [NOTHING] * 6


def test_a_way_that_bends_may_be_wrong_along_each_leg() -> None:
    """Wherever on it the size was lost: three times the mean over the places on it."""
    size, _ = map_size()
    at = np.array([5.0, 1.0, -2.0])
    size.take(seen(0.1, size=0.1), pose(np.eye(3), at))
    np.testing.assert_array_equal(size.gone(pose(np.eye(3), at)), np.zeros((3, 3)))
    legs = np.repeat([[0.02, 0.0, 0.0], [0.0, 0.0, 0.01]], 100, axis=0)  # 2 m, then 1 m
    places = at + np.cumsum(legs, axis=0)
    for k, place in enumerate(places):
        if k % 7 == 0:
            size.take(Overlaps(), pose(np.eye(3), place))  # standing adds nothing
        size.take(Overlaps(), pose(np.eye(3), place))
    ways = np.array([place - places[-1] for place in places])
    weights = np.linalg.norm(legs, axis=1)
    expected = 3.0 * (ways.T * weights) @ ways / weights.sum()
    square = size.gone(pose(np.eye(3), places[-1]))
    np.testing.assert_allclose(square, expected, atol=0.06)
    assert np.linalg.eigvalsh(square)[1:].min() > 0.4  # along both legs
    size.take(seen(0.1, size=0.1), pose(np.eye(3), places[-1]))
    np.testing.assert_array_equal(size.gone(pose(np.eye(3), places[-1])), np.zeros((3, 3)))


def test_a_map_begun_by_cf_alone_stays_degraded_until_the_camera_is_in_another() -> None:
    size, _ = map_size()
    for k in range(20):
        size.take(seen(0.1, size=0.1 if k < 10 else 3.0), pose(np.eye(3), [0.1 * k, 0.0, 0.0]))
    # Confirmed last at 0.9 m, at 1.9 m now.
    square = size.gone(pose(np.eye(3), [1.9, 0.0, 0.0]))
    np.testing.assert_allclose(square, np.diag([1.0, 0.0, 0.0]), rtol=1e-2, atol=1e-12)
    assert size.contradicted
    size.leave(contradicted=True, speed=1.0)
    assert size.inconsistent
    assert not size.contradicted
    for _ in range(20):
        size.take(seen(0.1, size=0.1), np.eye(4))
    assert size.inconsistent
    size.leave(contradicted=False, speed=1.0)
    assert not size.inconsistent


@pytest.mark.parametrize(
    ("before", "after", "known", "trusted"),
    [
        (1.5, 1.0, 100, True),  # the old map had grown, and T_CF is right
        (1.0, 1.3, 100, False),  # T_CF has grown
        (1.5, 1.3, 100, False),  # both
        (1.5, 1.0, 20, False),  # how fast it goes is not known
    ],
)
def test_the_speed_tells_which_of_two_maps_has_the_right_size(
    before: float, after: float, known: int, trusted: bool
) -> None:
    size, core = map_size(1.0, known)
    size.leave(contradicted=True, speed=before)
    core.velocity *= after
    said = []
    for _ in range(25):
        size.take(Overlaps(), np.eye(4))
        said.append(size.inconsistent)
    assert said == [True] * 19 + [not trusted] * 6


def test_lengths_of_t_cf_that_have_changed_are_in_doubt_by_as_much() -> None:
    """Ten views off by 1.5 sigma along the baseline, which turns no epipolar line, then good ones."""
    size, core = map_size()
    judge = ConsistencyMonitor(FilterSettings(), size)
    t_cf = pose(np.eye(3)[[1, 2, 0]], [0.0, 0.0, -2.0])
    view = replace(VIEW, t_cf=t_cf, bias=0.0 * VIEW.covariance)
    along = 0.03 * np.concatenate([t_cf[:3, :3].T @ t_cf[:3, 3] / 2.0, np.zeros(3)])
    at = iter(0.25 * np.arange(200))

    def doubted(
        sigmas: float, views: int = 1, told: float = 0.5, of_map: float = 0.0
    ) -> list[tuple[int, float]]:
        core.doubted.clear()
        for _ in range(views):
            shown = replace(seen(0.1).each[0], given=view, worn=view, at=next(at))
            judge.judge(
                report(error=sigmas * along, told=told, of_map=of_map), FOUND, Overlaps((shown,)), born()
            )
        return list(core.doubted)

    assert doubted(0.1, 20) == []
    assert doubted(1.5, 20, of_map=0.5) == [], "the map itself may be off by as much"
    size.leave(contradicted=False, speed=1.0)
    assert doubted(0.1, 20) == []
    assert doubted(1.5, 4) == []
    changed = doubted(1.5, 10)
    assert {number for number, _ in changed} == {0}
    # 1.5 sigma of 3 cm in 2 m, of which the update found a half
    assert 0.03 < max(sd for _, sd in changed) < 0.05
    size.leave(contradicted=False, speed=1.0)
    assert doubted(3.0, 10, told=0.03) == [], "views that say next to nothing"


def test_what_rounding_leaves_of_a_map_without_errors_is_none_of_a_length() -> None:
    """A root of less than nothing would let every length pass."""
    view = replace(VIEW, t_cf=pose(np.eye(3), [0.0, 0.0, -1.0]))
    seen_so = replace(seen(0.1).each[0], given=view, worn=view)
    assert seen_so.length(np.ones(6), 0.5 * VIEW.covariance, -1e-18 * np.eye(6), 0.9)[2] == 0.0


def test_a_calibration_that_goes_wrong_on_the_way_is_degraded() -> None:
    judge = monitor()
    said = [judge.judge(report(), FOUND, seen(0.2 if k < 40 else 2.0), born()) for k in range(50)]
    assert said == [NOTHING] * 43 + ["t_cf"] * 7


def test_a_jump_is_degraded_for_thirty_frames() -> None:
    judge = monitor()
    said = [judge.judge(report(), FOUND, Overlaps(), born(), jumped=k == 5) for k in range(40)]
    assert [k for k, cause in enumerate(said) if cause == "jump"] == list(range(5, 35))


def test_what_was_contradicted_stands_while_the_camera_is_lost() -> None:
    judge = monitor()
    for _ in range(10):
        judge.judge(report(), FOUND, seen(2.0), born())
    before = judge.state()
    assert judge.standing() == "t_cf"
    assert judge.state() == before, "it takes nothing in"
    assert monitor().standing() == NOTHING


def test_four_frames_are_too_few() -> None:
    judge, loud = monitor(), report(refused=2 * FOUND // 3, nis=900.0)
    said = [judge.judge(loud, FOUND, Overlaps(), born()) for _ in range(5)]
    assert said[:4] == [NOTHING] * 4
    assert said[4] == "matches"


def test_three_views_are_asked_at_least_and_most_of_them_must_say_so() -> None:
    judge = monitor()
    against = [2.0, 2.0, float("nan"), 2.0, 0.5, 0.5, 0.5]
    said = [judge.judge(report(), FOUND, seen(a), born()) for a in against]
    assert said == [NOTHING, NOTHING, NOTHING, "t_cf", "t_cf", "t_cf", NOTHING]


def test_frames_that_were_not_used_say_nothing() -> None:
    assert verdict(lambda k: (report(refused=FOUND, accepted=False), Overlaps(), born(3))) == NOTHING


def test_it_goes_on_where_it_was() -> None:
    first, second = monitor(), monitor()
    for _ in range(20):
        first.judge(report(refused=5), FOUND, seen(0.2), born())
    second.restore(first.state())
    for judge in (first, second):
        assert judge.judge(report(), FOUND, Overlaps(), born()) == "matches"
