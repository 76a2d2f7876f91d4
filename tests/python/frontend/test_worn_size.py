"""Whether points of the map are as far as it says, in a view that matched them without it."""

from __future__ import annotations

import numpy as np

from collabslam.frontend.worn_size import LEAST, ask_size, contradicted_length, contradicted_size

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


def lengths(
    told: float, lasting: float, seed: int, off: float = 0.0, views: int = 30, of_map: float = 0.0
) -> np.ndarray:
    """Errors of |t_CF| of views, of which a share of the variance lasts, as an update finds them."""
    rng = np.random.default_rng(seed)
    error = np.sqrt(lasting) * rng.standard_normal() + np.sqrt(1 - lasting) * rng.standard_normal(views)
    error = np.sqrt(told) * (error + off) + np.sqrt(of_map) * rng.standard_normal()
    return np.column_stack([error, *(np.full(views, share) for share in (told, of_map, lasting))])


def test_lengths_within_their_covariance_contradict_nothing() -> None:
    for told, lasting in ((1.0, 0.0), (0.4, 0.0), (0.8, 0.9), (0.8, 1.0)):
        assert not any(contradicted_length(lengths(told, lasting, seed)) for seed in range(300))
    assert not any(contradicted_length(lengths(0.8, 0.0, seed, of_map=0.4)) for seed in range(300))


def test_lengths_that_are_all_off_the_same_way_do() -> None:
    """By 1.5 sigma in each of thirty views, where no error lasts; by what no lasting one is, where all do."""
    assert all(contradicted_length(lengths(0.8, 0.0, seed, off=1.5)) for seed in range(50))
    assert all(contradicted_length(lengths(0.8, 0.0, seed, off=-1.5)) for seed in range(50))
    assert not any(contradicted_length(lengths(0.8, 0.9, seed, off=1.0)) for seed in range(50))
    assert all(contradicted_length(lengths(0.8, 0.9, seed, off=8.0)) for seed in range(50))


def test_a_length_that_no_view_tells_says_nothing() -> None:
    assert not contradicted_length(np.empty((0, 4)))
    assert not contradicted_length(np.array([[9.0, 0.9, 0.0, 0.0]] * 6))
    assert not contradicted_length(np.zeros((30, 4)))
