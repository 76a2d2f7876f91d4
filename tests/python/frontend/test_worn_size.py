"""Whether points of the map are as far as it says, in a view that matched them without it."""

from __future__ import annotations

import numpy as np

from collabslam.frontend.worn_size import LEAST, ask_size, changed_length, contradicted_size

SD = np.full(12, 0.05)


def noise(seed: int, count: int = 12) -> np.ndarray:
    return 0.05 * np.random.default_rng(seed).standard_normal(count)


def test_a_map_that_is_right_is_confirmed_and_one_of_another_size_is_not() -> None:
    for seed in range(20):
        assert ask_size(noise(seed), SD) < 0.2
        assert ask_size(noise(seed) + 0.9, SD) > 2.0
        assert ask_size(noise(seed) - 0.9, SD) > 2.0


def test_wrong_matches_say_nothing_together() -> None:
    wrong = [ask_size(np.random.default_rng(k).uniform(-2.5, 2.5, 12), SD) for k in range(200)]
    assert np.mean([one > 1.0 for one in wrong]) < 0.02  # NaN is not a contradiction
    mixed = [
        ask_size(np.concatenate([noise(k, 6), np.random.default_rng(k).uniform(-2.5, 2.5, 6)]), SD)
        for k in range(200)
    ]
    assert max(mixed) < 1.0


def test_few_points_say_nothing() -> None:
    few = LEAST - 1
    assert np.isnan(ask_size(noise(0, few) + 0.9, SD[:few]))
    assert np.isnan(ask_size(np.empty(0), np.empty(0)))


def test_a_run_is_degraded_by_most_of_its_last_views() -> None:
    right, wrong, silent = 0.1, 3.0, float("nan")
    said = {
        (wrong,) * 2: False,
        (wrong,) * 3: True,
        (right,) * 30 + (wrong,) * 3: False,
        (right,) * 30 + (wrong,) * 4: True,
        (right,) * 30 + (wrong, silent, silent) * 4: True,
        (wrong,) * 30 + (right,) * 4: False,
        (silent,) * 9: False,
    }
    for views, degraded in said.items():
        assert contradicted_size(np.array(views)) is degraded, views


TIME, SD_OF_LOG = 10.0, 0.03
"""How long what lasts of T_CF's error does, seconds, and the standard deviation of a length's logarithm."""


def lengths(
    told: float,
    lasting: float,
    seed: int,
    off: float = 0.0,
    views: int = 45,
    of_map: float = 0.0,
    since: int = 0,
) -> np.ndarray:
    """Errors of |t_CF| of four views a second, a share of whose variance lasts, as an update finds them.

    From the view ``since`` on they are ``off`` by so many standard deviations.
    """
    rng = np.random.default_rng(seed)
    error = np.sqrt(lasting) * rng.standard_normal() + np.sqrt(1 - lasting) * rng.standard_normal(views)
    error = error + off * (np.arange(views) >= since)
    error = np.sqrt(told) * error + np.sqrt(of_map) * rng.standard_normal()
    shares = (np.full(views, share) for share in (told, of_map, lasting, SD_OF_LOG))
    return np.column_stack([error, *shares, 0.25 * np.arange(views)])


def changes(count: int, *args: float, **kwargs: float) -> np.ndarray:
    """By how much lengths are found to have changed, of many draws."""
    return np.array([changed_length(lengths(*args, seed, **kwargs), TIME) for seed in range(count)])  # type: ignore[arg-type]


def test_lengths_within_their_covariance_have_not_changed() -> None:
    for told, lasting in ((1.0, 0.0), (0.4, 0.0), (0.8, 0.9), (0.8, 1.0)):
        assert not changes(300, told, lasting).any()
    assert not changes(300, 0.8, 0.0, of_map=0.4).any()


def test_lengths_that_are_all_off_the_same_way_have() -> None:
    """By 1.5 sigma in each of thirty views, where no error lasts; by what no lasting one is, where all do."""
    for off in (1.5, -1.5):
        told = changes(50, 0.8, 0.0, off=off)
        assert told.all()
        # The gain of an update is the share of the variance that it takes away.
        np.testing.assert_allclose(np.median(told), 1.5 * SD_OF_LOG / np.sqrt(0.8), rtol=0.3)
    assert not changes(50, 0.8, 0.9, off=1.0).any()
    assert changes(50, 0.8, 0.9, off=8.0).all()


def test_lengths_that_jump_have_within_a_few_views_whatever_lasts() -> None:
    for lasting in (0.0, 0.9):
        assert changes(50, 0.5, lasting, off=10.0, views=42, since=40).all()
        assert not changes(50, 0.5, lasting, off=10.0, views=42, since=42).any()


def test_a_length_that_no_view_tells_has_not_changed() -> None:
    assert changed_length(np.empty((0, 6)), TIME) == 0.0
    assert changed_length(np.array([[9.0, 0.9, 0.0, 0.0, 0.03, 0.0]] * 6), TIME) == 0.0
