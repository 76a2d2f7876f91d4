"""The pieces of the reproduced simulation: formulas, ranks, truth, filter."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from collabslam.errors import SettingsError
from collabslam_lab.paper_simulation import planar_rows, wall_models
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.estimators import ESTIMATORS, GAUGE, PLAIN
from collabslam_lab.paper_simulation.rank import exact_rank, numeric_nullity
from collabslam_lab.paper_simulation.simulation_settings import SIMULATION, SimulationSettings
from collabslam_lab.paper_simulation.wall import simulate
from collabslam_lab.paper_simulation.wall_run import run_wall

RNG = np.random.default_rng(3)
CAMERA = np.stack([RNG.normal(size=8), RNG.normal(size=8), 1.5 + 0.1 * RNG.normal(size=8)], axis=1)
FEATURE = np.stack(
    [RNG.normal(size=8), RNG.normal(size=8), 1.5 + 0.2 * RNG.normal(size=8), RNG.uniform(0.1, 0.5, 8)], axis=1
)
SHORT = {"duration": 10.0, "path": 14.0 / 3.0, "second_window_start": 9.5, "second_window_end": 9.9}


def _numeric(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float = 1e-5) -> np.ndarray:
    moves = step * np.eye(x.shape[-1])
    return np.stack([(f(x + m) - f(x - m)) / (2.0 * step) for m in moves], axis=-1)


@pytest.mark.parametrize("model", [wall_models.bearing, wall_models.distance])
def test_jacobians_agree_with_differences(model: Callable[..., tuple[np.ndarray, ...]]) -> None:
    _, by_camera, by_feature = model(CAMERA, FEATURE)
    assert np.allclose(by_camera, _numeric(lambda x: model(x, FEATURE)[0], CAMERA), rtol=1e-6, atol=1e-8)
    assert np.allclose(by_feature, _numeric(lambda x: model(CAMERA, x)[0], FEATURE), rtol=1e-6, atol=1e-8)


def test_jacobians_can_be_frozen_elsewhere() -> None:
    frozen = FEATURE + 0.05
    value, by_camera, by_feature = wall_models.bearing(CAMERA, FEATURE, frozen)
    assert np.allclose(value, wall_models.bearing(CAMERA, FEATURE)[0])
    assert np.allclose(by_camera, wall_models.bearing(CAMERA, frozen)[1])
    assert np.allclose(by_feature, wall_models.bearing(CAMERA, frozen)[2])


def test_two_rays_meet_at_the_point() -> None:
    point, first, now = np.array([0.4, 4.0]), np.array([-1.0, 0.2]), np.array([0.7, -0.1])
    rays = [[*at, np.arctan2(*(point - at)[::-1])] for at in (now, first)]
    now_ray, first_ray = (np.array([ray]) for ray in rays)
    rho, by_now, by_first = wall_models.two_view_rho(now_ray, first_ray)
    assert rho[0] == pytest.approx(1.0 / np.hypot(*(point - now)))
    assert np.allclose(
        by_now, _numeric(lambda x: wall_models.two_view_rho(x, first_ray)[0], now_ray), rtol=1e-6
    )
    assert np.allclose(
        by_first, _numeric(lambda x: wall_models.two_view_rho(now_ray, x)[0], first_ray), rtol=1e-6
    )


def _state(slots: int = 5) -> tuple[np.ndarray, np.ndarray]:
    x = np.concatenate([RNG.normal(size=6), np.tile(FEATURE[0], slots) + 0.1 * RNG.normal(size=4 * slots)])
    return x[None], np.ones((1, slots), bool)


def test_the_gauge_is_what_bearings_do_not_see() -> None:
    x, filled = _state()
    n = wall_models.gauge_directions(x, filled)
    slots = x[:, 6:].reshape(1, 5, 4)
    moves = n[:, 6:].reshape(1, 5, 4, 2)
    for model, seen in ((wall_models.bearing, [0.0, 0.0]), (wall_models.distance, [0.0, 1.0])):
        value, by_camera, by_feature = model(x[:, None, :3], slots)
        change = np.einsum("bkc,bcg->bkg", by_camera, n[:, :3]) + np.einsum(
            "bkf,bkfg->bkg", by_feature, moves
        )
        expected = np.array(seen) * value[..., None] if seen[1] else np.zeros_like(change)
        assert np.allclose(change, expected, atol=1e-9)
    product = wall_models.gauge_coordinates(x, filled) @ n
    assert np.allclose(product, np.eye(2), atol=1e-12)


def test_the_transport_is_a_congruence_that_carries_the_gauge() -> None:
    x, filled = _state()
    a = RNG.normal(size=(1, x.shape[1], 40))
    p = a @ np.swapaxes(a, 1, 2)
    after = x + 0.1 * RNG.normal(size=x.shape)
    b = wall_models.gauge_coordinates(x, filled)
    before_n, after_n = (wall_models.gauge_directions(v, filled) for v in (x, after))
    t = np.eye(x.shape[1]) + (after_n - before_n) @ b
    assert np.allclose(t @ before_n, after_n, atol=1e-10)
    expected = t @ p @ np.swapaxes(t, 1, 2)
    wall_models.transport(x, after, p, filled, filled)
    assert np.allclose(p, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_exact_rank_agrees_with_numpy() -> None:
    for rank in range(1, 6):
        a = RNG.integers(-3, 4, (7, rank)) @ RNG.integers(-3, 4, (rank, 6))
        rows = [[Fraction(int(v), 7) for v in row] for row in a]
        assert exact_rank(rows) == np.linalg.matrix_rank(a)
    assert exact_rank([]) == 0


def test_nullity_does_not_depend_on_units() -> None:
    a = RNG.normal(size=(9, 4)) @ RNG.normal(size=(4, 6))
    assert numeric_nullity(a) == numeric_nullity(a * np.array([1e-6, 1.0, 1e3, 1.0, 1e-3, 10.0])) == 2


def test_rational_gradients_agree_with_differences() -> None:
    anchor = planar_rows.Anchor(
        (Fraction(1, 3), Fraction(-1, 2)), planar_rows.direction(Fraction(3, 5)), Fraction(1, 3)
    )
    camera, velocity = (Fraction(1, 5), Fraction(1, 7)), (Fraction(1, 2), Fraction(-1, 4))
    point = np.array([float(v) for v in anchor.point])
    at, v = np.array([float(c) for c in camera]), np.array([float(c) for c in velocity])

    def bearing(p: np.ndarray) -> np.ndarray:
        return np.arctan2(p[1] - at[1], p[0] - at[0])

    def rate(p: np.ndarray) -> np.ndarray:
        d = p - at
        return -(d[0] * v[1] - d[1] * v[0]) / (d @ d)

    for exact, f in (
        (planar_rows.bearing_by_point(camera, anchor.point), bearing),
        (planar_rows.bearing_rate_by_point(camera, velocity, anchor.point), rate),
    ):
        assert np.allclose([float(g) for g in exact], _numeric(f, point), rtol=1e-6)


def test_a_run_is_the_same_in_any_batch() -> None:
    s = SimulationSettings(SHORT)
    for estimator in (PLAIN, GAUGE):
        many = run_wall(s, Case("wall", estimator, "independent"), 4, range(3))
        one = run_wall(s, Case("wall", estimator, "independent"), 4, [1])
        assert np.allclose(many.error[1], one.error[0], rtol=1e-7, atol=1e-9)
        assert np.allclose(many.nees[1], one.nees[0], rtol=1e-5, equal_nan=True)


def test_truth_and_draws_do_not_depend_on_sigmas() -> None:
    a = simulate(SimulationSettings(SHORT), 5, [2])
    b = simulate(SimulationSettings({**SHORT, "range_sigma": 1.0, "bearing_sigma": 0.1}), 5, [2])
    assert np.array_equal(a.states, b.states)
    assert np.array_equal(a.stereo_draws, b.stereo_draws)
    s = SimulationSettings(SHORT)
    ranges, _ = a.stereo(s, 85, shared=True, range_sigma=0.5)
    off = ranges - a.true_ranges[:, 85]
    assert np.ptp(off) < 1e-12
    assert np.ptp(a.stereo(s, 85, shared=False, range_sigma=0.5)[0] - a.true_ranges[:, 85]) > 0.1


def test_without_noise_the_filter_follows_the_truth() -> None:
    tiny = {
        "bearing_sigma": 1e-3,
        "known_sigma": 1e-4,
        "start_velocity_sigma": 1e-3,
        "start_turn_sigma": 1e-3,
    }
    for estimator in ESTIMATORS:
        outcome = run_wall(
            SimulationSettings({**SHORT, **tiny}), Case("wall", estimator, "mono"), 6, range(2)
        )
        assert outcome.error.max() < 0.02, estimator.name


def test_a_run_that_diverges_is_counted_and_not_an_error() -> None:
    s = SimulationSettings({"bearing_sigma": 6.0, "min_parallax": 1.0, "duration": 15.0, "path": 7.0,
                            "second_window_start": 12.0, "second_window_end": 13.0})  # fmt: skip
    fej = next(e for e in ESTIMATORS if e.name == "fej")
    with np.errstate(all="ignore"):
        outcome = run_wall(s, Case("wall", fej, "independent"), 0, range(12))
    dead = ~np.isfinite(outcome.error[:, -1])
    assert outcome.error.shape == (12, s.frames)
    for run in np.flatnonzero(dead):
        first = int(np.flatnonzero(~np.isfinite(outcome.error[run]))[0])
        assert not np.isfinite(outcome.error[run, first:]).any()


def test_settings_are_checked() -> None:
    with pytest.raises(SettingsError, match="did you mean 'range_sigma'"):
        SimulationSettings({"range_sigm": 1.0})
    with pytest.raises(SettingsError, match="range_sigma"):
        SimulationSettings({"range_sigma": -1.0})
    with pytest.raises(SettingsError, match="out of order"):
        SimulationSettings({"first_window_end": 18.0})
    assert all(entry.doc for entry in SIMULATION.values())
    s = SimulationSettings()
    assert (s.window_at(79), s.window_at(80), s.window_at(89), s.window_at(90)) == (-1, 0, 0, -1)
