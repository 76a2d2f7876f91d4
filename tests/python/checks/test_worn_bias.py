"""The time-correlated error of T_CF and Cf's clock: found where motion tells them, else left alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collabslam import geometry as g
from collabslam.checks import calibration as calibration_check
from collabslam.checks.calibration import CalibrationReport
from collabslam.checks.worn_bias import recorded
from collabslam.checks.worn_bias.fit import STRETCH, AskedView, BiasFit, Later, fit_bias
from collabslam.checks.worn_bias.report import believed, rows, sentences
from collabslam.checks.worn_bias.seen import SeenPose, Triplets, inverse_depths, seen_pose
from collabslam.cli import main as cli
from collabslam.datasets.source import STATE, Source, WornSpec
from collabslam.datasets.worn_calibration import CalibratedWorn, WornCalibration, corrected
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError
from collabslam.simulation import corridor_recording
from collabslam.types import Array, Frame, WornView

Motion = Callable[[float], Array]

BIAS = np.array([0.02, -0.015, 0.017, 0.01, -0.012, 0.008])
CLOCK = 0.05
WHITE = np.diag(np.array([0.03, 0.03, 0.03, 0.009, 0.017, 0.009]) ** 2)


def lively(t: float) -> Array:
    shift = [0.5 * np.sin(2.0 * t), 0.3 * np.sin(3.0 * t), t + 0.2 * np.sin(4.0 * t)]
    return g.pose(g.rotation_exp(0.4 * np.sin(np.array([1.3, 2.1, 1.7]) * t)), shift)


def straight(t: float) -> Array:
    return g.pose(np.eye(3), [0.3 * t, 0.0, t])


def walking(t: float) -> Array:
    shift = [0.7, -0.4, 0.5] + 0.3 * np.sin(np.array([1.5, 2.2, 1.2]) * t)
    return g.pose(g.rotation_exp(0.3 * np.sin(np.array([1.1, 1.9, 2.3]) * t)), shift)


def still(t: float) -> Array:
    return walking(0.0)


def views_of(
    robot: Motion, person: Motion, *, unit: float = 1.0, seed: int = 0, count: int = 60
) -> tuple[list[AskedView], Later]:
    """Views taken `CLOCK` late with `BIAS` in every pose, and the motion of Cs in the unit of its path."""
    draw = np.random.default_rng(seed)
    of_images = np.diag([0.01, 0.01, 0.01, 0.002, 0.002, 0.002])
    views = []
    for t in np.linspace(0.2, 6.0, count):
        true = person(t)
        measured = corrected(true, -BIAS) @ g.se3_exp(np.sqrt(np.diag(WHITE)) * draw.standard_normal(6))
        seen = g.pose_inverse(robot(t)) @ robot(t + CLOCK) @ true
        seen[:3, 3] *= unit
        noise = of_images @ draw.standard_normal(6)
        told = of_images**2
        views.append(
            AskedView(float(t), measured, WHITE, SeenPose(seen @ g.se3_exp(noise), told, told, 30, 20))
        )

    def later(t: float, offset: float) -> Array:
        moved = g.pose_inverse(robot(t)) @ robot(t + offset)
        moved[:3, 3] *= unit
        return moved

    return views, later


def off(fit: BiasFit) -> Array:
    """Errors of the seven in their standard deviations."""
    found = np.append(fit.calibration.correction, fit.calibration.clock)
    return (found - np.append(BIAS, CLOCK)) / fit.sd


def test_where_both_move_freely_all_is_found() -> None:
    fits = [fit_bias(*views_of(lively, walking, unit=1.1, seed=seed)) for seed in range(4)]
    errors = np.array([off(fit) for fit in fits])
    assert all(not fit.untold for fit in fits)
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.5
    assert np.abs(errors).max() < 4.0
    # Far better than what was thought possible, 6 cm, 1.4 degrees and 100 ms.
    assert all(np.all(fit.sd < [0.02] * 3 + [0.006] * 3 + [0.01]) for fit in fits)
    assert all(
        abs(fit.units[0] - 1.1) < 0.05 and 0.6 < fit.reduced_chi2 < 1.5 and believed(fit) for fit in fits
    )
    assert rows(fits[0])[6] == [
        "clock of Cf",
        f"{1e3 * fits[0].calibration.clock:+.2f} +- {1e3 * fits[0].sd[6]:.2f} ms",
    ]


def test_a_path_whose_unit_drifts_is_no_error_of_t_cf() -> None:
    first, later = views_of(lively, walking)
    longer = [view._replace(t=view.t + STRETCH) for view in views_of(lively, walking, unit=1.15, seed=1)[0]]

    def both(t: float, offset: float) -> Array:
        moved = later(t if t < STRETCH else t - STRETCH, offset)
        moved[:3, 3] *= 1.0 if t < STRETCH else 1.15
        return moved

    fit = fit_bias(first + longer, both)
    np.testing.assert_allclose(fit.units, [1.0, 1.15], atol=0.06)
    assert np.abs(off(fit)).max() < 4.0
    assert not fit.untold


def test_even_motion_leaves_clock_and_length_alone_and_says_so() -> None:
    views, later = views_of(straight, still)
    fit = fit_bias(views, later)
    baseline = still(0.0)[:3, 3]
    assert len(fit.untold) == 2
    told = " ".join(sentences(fit, baseline))
    assert "Left as it is" in told
    assert "a clock that is off" in told
    # What is not told is not corrected: the correction has no part along it.
    possible = np.array([0.06] * 3 + [0.0] * 4)
    possible[3:6] = 2.0 * np.sqrt(np.diag(WHITE)[3:].mean())
    possible[6] = 0.1
    found = np.append(fit.calibration.correction, fit.calibration.clock) / possible
    assert all(abs(direction @ found) < 1e-9 for direction in fit.untold)
    # Attitude is told all the same.
    assert np.abs(fit.calibration.correction[3:] - BIAS[3:]).max() < 4.0 * fit.sd[3:6].max() < 0.02


def test_the_length_of_a_fixed_baseline_is_the_scale_unless_a_length_is_known() -> None:
    views, later = views_of(lively, still)
    fit = fit_bias(views, later)
    baseline = still(0.0)[:3, 3]
    assert len(fit.untold) == 1
    assert abs(fit.untold[0][:3] @ baseline) > 0.95 * np.linalg.norm(baseline)
    assert "length of T_CF" in sentences(fit, baseline)[0]
    known = fit_bias(views, later, metric=True)
    assert not known.untold
    assert np.abs(off(known)).max() < 3.5


def test_a_clock_that_is_right_is_left_alone() -> None:
    views, later = views_of(lively, walking)
    still_clock = [view._replace(seen=view.seen._replace(t_cf=walking(view.t))) for view in views]
    assert fit_bias(still_clock, later).calibration.clock == 0.0


def test_views_that_share_no_error_are_not_believed() -> None:
    views, later = views_of(lively, walking)
    draw = np.random.default_rng(1)
    wild = [v._replace(measured=v.measured @ g.se3_exp(0.3 * draw.standard_normal(6))) for v in views]
    fit = fit_bias(wild, later)
    assert not believed(fit)
    assert "No time-correlated error explains" in sentences(fit, np.ones(3))[-1]


def triplets(wrong: int, path_unit: float = 1.0) -> tuple[Triplets, Array]:
    draw = np.random.default_rng(3)
    points = draw.uniform([-2.0, -1.5, 3.0], [2.0, 1.5, 8.0], (80, 3))
    t_cf, t_ab = walking(1.0), g.pose(g.rotation_exp([0.0, 0.05, 0.0]), [0.3, 0.0, 0.2])

    def rays(pose: Array) -> Array:
        inside = (points - pose[:3, 3]) @ pose[:3, :3]
        seen = inside / inside[:, 2:]
        seen[:, :2] += 0.5 / 500.0 * draw.standard_normal((len(seen), 2))
        return seen

    first, second, person = rays(np.eye(4)), rays(t_ab), rays(t_cf)
    person[:wrong] = np.roll(person[:wrong], 1, axis=0)
    t_ab[:3, 3] *= path_unit
    second[60:] = np.nan
    return Triplets(first, person, *inverse_depths(first, second, t_ab, 500.0)), t_cf


@pytest.mark.parametrize("unit", [1.0, 1.3])
def test_a_view_tells_where_cf_is_in_the_unit_of_the_path(unit: float) -> None:
    given, true = triplets(wrong=15, path_unit=unit)
    assert np.isfinite(given.rho).sum() > 40
    measured = true @ g.se3_exp([0.03, -0.02, 0.03, 0.01, 0.015, -0.01])
    found = seen_pose(given, measured, WHITE, (500.0, 500.0))
    assert found is not None
    expected = true.copy()
    expected[:3, 3] *= unit
    xi = g.se3_log(g.pose_inverse(expected) @ found.t_cf)
    assert xi @ np.linalg.solve(found.covariance, xi) < 16.8
    assert np.linalg.norm(xi[:3]) < 0.05
    assert found.matches > 40


def test_a_view_without_depth_tells_no_length() -> None:
    given, true = triplets(wrong=0)
    blind = given._replace(rho=np.full(80, np.nan), rho_sd=np.full(80, np.nan))
    found = seen_pose(blind, true, WHITE, (500.0, 500.0))
    assert found is not None
    along = true[:3, :3].T @ true[:3, 3] / np.linalg.norm(true[:3, 3])
    assert along @ found.covariance[:3, :3] @ along > 0.5
    assert np.linalg.eigvalsh(found.covariance[:3, :3])[:2].max() < 0.01
    assert seen_pose(Triplets(*(part[:5] for part in given)), true, WHITE, (500.0, 500.0)) is None


class Off(WrappedRecording):
    """The demo's recording with an error that all of its T_CF share."""

    def frame(self, i: int) -> Frame:
        frame = self._base.frame(i)
        views = (replace(view, t_cf=corrected(view.t_cf, -BIAS)) for view in frame.views)
        return replace(frame, views=tuple(views))


def calibration(clock: float = 0.0) -> WornCalibration:
    half = np.random.default_rng(0).normal(size=(6, 6))
    return WornCalibration(BIAS, 1e-5 * half @ half.T, clock, 0.004)


def test_a_file_reads_back_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "worn.yaml"
    calibration(CLOCK).save(file)
    again = WornCalibration.load(file)
    np.testing.assert_array_equal(again.correction, BIAS)
    np.testing.assert_allclose(again.covariance, calibration().covariance, rtol=1e-15)
    assert (again.clock, again.clock_sd) == (CLOCK, 0.004)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("collabslam-worn-calibration", "other", "check-calib --write"),
        ("clock_s: 0.05", "clock_s: [1, 2]", "key 'clock_s'"),
        ("clock_s: 0.05", "clock_s: 99.0", "more than 10 m"),
        ("- 0.02", "- .nan", "key 'shift_m'"),
        ("clock_sd_s: 0.004", "clock_sd_s: -1.0", "not positive semidefinite"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    file = tmp_path / "worn.yaml"
    calibration(CLOCK).save(file)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(DataError, match=said):
        WornCalibration.load(file)


def test_a_view_is_corrected_and_says_what_is_left() -> None:
    t_cf = corrected(walking(1.0), -BIAS)
    image = np.zeros((4, 4), np.uint8)
    seen = calibration().view(WornView(image, t_cf, WHITE))
    np.testing.assert_allclose(seen.t_cf, walking(1.0), atol=1e-12)
    turn = np.kron(np.eye(2), seen.t_cf[:3, :3])
    assert seen.bias is None
    left = seen.covariance - WHITE
    np.testing.assert_allclose(turn @ left @ turn.T, calibration().covariance, atol=1e-12)
    # A bias that was stated shrinks to what is left of it, and stays where nothing was told.
    stated = calibration().view(WornView(image, t_cf, 2.0 * WHITE, WHITE))
    assert stated.bias is not None
    assert np.linalg.eigvalsh(WHITE - stated.bias)[0] > -1e-12
    assert np.trace(stated.bias) < np.trace(WHITE)
    nothing = WornCalibration(np.zeros(6), np.zeros((6, 6)))
    unchanged = nothing.view(WornView(image, t_cf, 2.0 * WHITE, WHITE)).bias
    assert unchanged is not None
    np.testing.assert_allclose(unchanged, WHITE, atol=1e-12)


@pytest.mark.parametrize("clock", [0.05, -0.05, 0.13])
def test_views_come_when_they_were_taken(clock: float) -> None:
    recording = corridor_recording(length_m=1.0)  # ten a second
    moved = CalibratedWorn(recording, calibration(clock))
    came = {}
    for i in range(len(recording)):
        for worn in moved.frame(i).views:
            assert worn.t is not None
            assert recording.times[i] - 0.1 < worn.t <= recording.times[i] + 1e-9
            came[i] = round((worn.t - clock) * 10)
    assert came == {i: i - int(np.ceil(clock * 10)) for i in came}
    assert len(came) == len(recording) - max(int(np.ceil(clock * 10)), 0)
    assert CalibratedWorn(recording, calibration()).frame(0).views[0].t is None


def test_a_source_keeps_its_calibration(tmp_path: Path) -> None:
    file = tmp_path / "worn.yaml"
    source = Source(tmp_path, worn=WornSpec("recorded"), worn_calibrations={"": file})
    STATE(source.state(), "source")
    assert Source.from_state(source.state()).worn_calibrations == {"": file}


def test_check_calib_writes_what_mends_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(recorded, "VIEWS", 8)
    base = Off(corridor_recording(length_m=2.1))
    monkeypatch.setattr(Source, "open", lambda self: base)
    monkeypatch.setattr(calibration_check, "check_calibration", lambda *_, **__: CalibrationReport({1: 0.3}))
    file = tmp_path / "worn.yaml"
    assert cli.main(["check-calib", "walk", "--write", str(file)]) == 0
    said = capsys.readouterr().out
    assert f"--worn-calibration {file}" in said
    assert "T_CF, turn about down" in said
    found = WornCalibration.load(file)
    # Eight views of one degree of noise, along a straight way: attitude to a third of a degree or so.
    assert np.abs(found.correction[3:] - BIAS[3:]).max() < np.radians(1.0)
    assert np.linalg.norm(found.correction[3:]) > np.radians(0.4)


def test_without_a_worn_camera_there_is_nothing_to_find() -> None:
    alone = WrappedRecording(corridor_recording(length_m=1.0))
    alone.worn_camera = None
    with pytest.raises(DataError, match="no worn camera"):
        recorded.time_correlated_error(alone)
