"""The simulated gyroscope, and what the lab makes of its runs."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from collabslam.geometry import rotation_exp
from collabslam_lab.gyro.pieces import OfWorld, Piece, Score, parsed
from collabslam_lab.gyro.simulated import KINDS, R_CI, simulated_gyro, true_rates
from collabslam_lab.gyro.study import summary, table, trajectories_table, worlds_of

TIMES = np.arange(0.0, 3.0, 0.1)


def _robot(t: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation_exp([0.4 * np.sin(2.0 * t), 0.7 * t, 0.2 * np.cos(3.0 * t)])
    pose[:3, 3] = [t, 0.0, 0.3 * t]
    return pose


def test_true_rates_add_up_to_the_turn():
    moments = np.arange(0.0, 1.0, 1e-3) + 5e-4
    turned = np.eye(3)
    for rate in true_rates(_robot, moments):
        turned = turned @ rotation_exp(rate * 1e-3)
    np.testing.assert_allclose(turned, _robot(0.0)[:3, :3].T @ _robot(1.0)[:3, :3], atol=1e-5)


def test_a_sensor_errs_by_what_it_says():
    kind = KINDS["phone"]
    gyros = [simulated_gyro(_robot, TIMES, kind, np.random.default_rng(seed)) for seed in range(40)]
    biases = np.stack([gyro.bias(1.5) for gyro in gyros])
    assert 0.7 < biases.std() / kind.bias_sd < 1.4
    assert 0.6 < np.std([gyro.offset for gyro in gyros]) / kind.clock_sd < 1.5
    gyro = gyros[0]
    assert gyro.log.times[0] < TIMES[0] < TIMES[-1] < gyro.log.times[-1]
    true = true_rates(_robot, gyro.log.times + gyro.offset)
    left = (gyro.log.rates - gyro.biases) @ R_CI.T - true
    # White noise at 200 Hz, and of scale and mounting some parts of a hundred of the rate.
    assert np.abs(left.mean(axis=0)).max() < 0.05
    assert 0.9 < np.diff(left, axis=0).std() / (kind.noise * np.sqrt(200.0) * np.sqrt(2.0)) < 1.1
    again = simulated_gyro(_robot, TIMES, kind, np.random.default_rng(0))
    np.testing.assert_array_equal(again.log.rates, gyro.log.rates)


def test_the_summary_is_of_the_runs_that_it_names():
    groups = worlds_of(quick=True)
    base = Score(9.0, 9.0, 1.0, 0.9, 0.3, 1.0, 0.0, 6.0, np.nan, 0.0, 3.0, 0.0)
    told = replace(
        base, end_pct=2.0, heading_deg=1.5, false_ok=0.01, bias_inside=0.99, ms_predict=3.2, us_sample=5.0
    )
    rows = [
        (Piece(world, seed, mode, kind, None), told if kind and mode == "collab-tight" else base)
        for worlds in groups.values()
        for world in worlds
        for seed in (0, 1)
        for mode in ("collab-tight", "mono")
        for kind in ("", "phone")
    ]
    rows[1] = (rows[1][0], replace(told, end_pct=4.0))
    numbers = summary(groups, rows, "phone")
    assert (numbers["end_pct_mean"], numbers["end_pct_worst"]) == (3.0, 4.0)
    assert (numbers["heading_deg_mean"], numbers["heading_deg_worst"]) == (1.5, 1.5)
    shares = numbers["false_ok_share"], numbers["bias_within_3_sigma"]
    np.testing.assert_allclose(shares, (0.01, 0.99))
    np.testing.assert_allclose(numbers["ms_per_frame"], 0.2 + 20 * 0.005)
    assert len(numbers["runs"]) == len(rows)
    lines = table(groups, rows).splitlines()
    assert len(lines) == 2 + 3 * 4
    assert "phone" in lines[3]
    assert " - " in lines[2]
    way = groups["trajectories"][0]
    lines = trajectories_table(groups["trajectories"], rows).splitlines()
    assert len(lines) == 2 + 1 + 1
    assert lines[2].startswith(f"| {way} | 3.0, 4.0 |")


def test_a_worlds_scores_are_read_only_if_all_are_there():
    scores = [Score(*np.arange(12.0)), Score(*np.arange(1.0, 13.0))]
    pieces = tuple(Piece("d-life", seed, "mono", "", None) for seed in (0, 1))
    content = json.loads(json.dumps([asdict(score) for score in scores]))
    assert parsed(OfWorld(pieces), content) == scores
    with pytest.raises(ValueError, match="1 scores of 2 runs"):
        parsed(OfWorld(pieces), content[:1])
