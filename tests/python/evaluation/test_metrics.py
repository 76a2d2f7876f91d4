"""Metrics against hand-made cases and, where it is there, scipy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.stand_ins import step_result

from collabslam import geometry as g
from collabslam._core import chi2_quantile
from collabslam.errors import InputError
from collabslam.evaluation import consistency, metrics, overlap, scoring
from collabslam.evaluation.alignment import umeyama
from collabslam.evaluation.record import RunRecord
from collabslam.types import Status


def walk(frames: int = 60, step: float = 0.1) -> np.ndarray:
    """A winding path of poses (N, 4, 4), which starts at the origin."""
    return np.array(
        [g.se3_exp([0.3 * np.sin(0.2 * k), 0.05 * k % 0.3, step * k, 0, 0.02 * k, 0]) for k in range(frames)]
    )


def record_of(poses: np.ndarray, covariance: np.ndarray | None = None, **diagnostics: list) -> RunRecord:
    """A record in which every frame is OK, 10 Hz."""
    record = RunRecord()
    p = np.eye(6) * 1e-2 if covariance is None else covariance
    for k, pose in enumerate(poses):
        extra = {key: values[k] for key, values in diagnostics.items()}
        record.append(step_result(5.0 + 0.1 * k, pose, p, extra), worn=False, seconds=0.01)
    return record


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(4))


def test_umeyama_finds_a_known_similarity(rng: np.random.Generator) -> None:
    points = rng.normal(size=(40, 3))
    known = g.se3_exp([1.0, -2.0, 0.5, 0.4, -0.9, 1.3])
    target = 1.7 * points @ known[:3, :3].T + known[:3, 3]
    found = umeyama(points, target, with_scale=True)
    np.testing.assert_allclose(found.rotation, known[:3, :3], atol=1e-12)
    np.testing.assert_allclose(found.translation, known[:3, 3], atol=1e-12)
    assert found.scale == pytest.approx(1.7)
    assert metrics.scale_error(points, target) == pytest.approx(0.7)
    assert umeyama(points, target, with_scale=False).scale == 1.0


def test_umeyama_never_mirrors(rng: np.random.Generator) -> None:
    flat = rng.normal(size=(20, 3)) * [1.0, 1.0, 0.0]
    mirrored = rng.normal(size=(20, 3))
    for target in (flat, mirrored * [1.0, 1.0, -1.0]):
        rotation = umeyama(mirrored, target, with_scale=False).rotation
        assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_ate_is_blind_to_the_frame_and_sees_scale() -> None:
    truth = walk()[:, :3, 3]
    moved = g.se3_exp([3.0, 1.0, 2.0, 0.5, 0.1, -0.7])
    assert metrics.ate_rmse(truth @ moved[:3, :3].T + moved[:3, 3], truth) == pytest.approx(0.0, abs=1e-12)
    line = np.zeros((3, 3))
    line[:, 2] = [-1.0, 0.0, 1.0]
    assert metrics.ate_rmse(1.3 * line, line) == pytest.approx(0.3 * math.sqrt(2.0 / 3.0))


def test_position_errors_equations_15_and_16() -> None:
    truth = np.zeros((4, 3))
    estimate = np.array([[0, 0, 0], [3, 4, 0], [0, 0, 1], [0, 2, 0]], float)
    assert metrics.accumulated_position_error(estimate, truth) == pytest.approx(8.0)
    assert metrics.average_position_error(estimate, truth) == pytest.approx(2.0)


def test_rpe_of_a_scaled_path_and_of_a_constant_turn() -> None:
    truth = np.tile(np.eye(4), (6, 1, 1))
    truth[:, 2, 3] = np.arange(6.0)
    estimate = truth.copy()
    estimate[:, 2, 3] *= 1.1
    assert metrics.rpe(estimate, truth) == pytest.approx((0.1, 0.0))
    assert metrics.rpe(estimate, truth, step=3) == pytest.approx((0.3, 0.0))
    turning = np.array([g.se3_exp([0, 0, 0, 0, 0.01 * k, 0]) for k in range(6)])
    still = np.tile(np.eye(4), (6, 1, 1))
    assert metrics.rpe(turning, still, step=2)[1] == pytest.approx(0.02)
    estimate[1] = np.nan
    assert metrics.rpe(estimate, truth) == pytest.approx((0.1, 0.0))


def test_heading_wraps_and_orientation_is_an_angle() -> None:
    a = g.se3_exp([0, 0, 0, 0, np.pi - 0.01, 0])[None]
    b = g.se3_exp([0, 0, 0, 0, -np.pi + 0.02, 0])[None]
    assert metrics.heading_errors(a, b)[0] == pytest.approx(-0.03)
    assert metrics.orientation_errors(a, b)[0] == pytest.approx(0.03)
    assert metrics.rotation_angles(g.se3_exp([0, 0, 0, 1e-9, 0, 0])[None, :3, :3])[0] == pytest.approx(1e-9)


def test_overlap_metrics_equations_17_to_19() -> None:
    on = np.array([1, 1, 0, 0, 0, 1, 1, 1, 1, 0], bool)
    eta, mu = overlap.overlap_intervals(0.5 * np.arange(10), on)
    np.testing.assert_allclose(eta, [1.0, 2.0])
    np.testing.assert_allclose(mu, [1.5, 0.5])
    assert overlap.overlap_ratio(0.5 * np.arange(10), on) == pytest.approx(0.6)
    assert overlap.overlap_regularity(eta) == pytest.approx(2.0 * (0.5 + 0.5))
    assert overlap.non_overlap_deviation(mu) == pytest.approx(0.25)
    assert math.isnan(overlap.overlap_regularity([1.0]))
    assert overlap.overhead_return([1.0, 2.0], 10.0, 3.0) == pytest.approx(1.5)
    assert math.isnan(overlap.overhead_return([1.0], 0.0, 3.0))


def test_chi2_quantiles_match_the_tables() -> None:
    assert chi2_quantile(0.95, 1) == pytest.approx(3.841458820694124)
    assert chi2_quantile(0.975, 6) == pytest.approx(14.44937533544792)
    assert consistency.sigma_gate(5.0, 1) == pytest.approx(25.0)
    assert consistency.sigma_gate(5.0, 6) == pytest.approx(39.4914, abs=1e-3)
    assert consistency.nees_band(2, 200) == pytest.approx((1.73, 2.29), abs=0.01)


@pytest.mark.slow
def test_chi2_agrees_with_scipy() -> None:
    stats = pytest.importorskip("scipy.stats")
    for dof in (1, 2, 3, 6, 120, 6000):
        for p in (1e-6, 0.025, 0.5, 0.975, 0.9999):
            assert chi2_quantile(p, dof) == pytest.approx(stats.chi2.ppf(p, dof), rel=1e-9)


def test_nees_of_gaussian_errors_lies_in_its_band(rng: np.random.Generator) -> None:
    runs = 300
    root = rng.normal(size=(6, 6)) * 0.05
    covariance = root @ root.T
    errors = rng.normal(size=(runs, 6)) @ root.T
    truth = walk(runs)
    estimate = np.array([t @ g.pose_inverse(g.se3_exp(e)) for t, e in zip(truth, errors, strict=True)])
    found = consistency.pose_tangent_error(estimate, truth)
    np.testing.assert_allclose(found, errors, atol=1e-9)
    low, high = consistency.nees_band(6, runs)
    covariances = np.tile(covariance, (runs, 1, 1))
    assert low < consistency.nees(found, covariances).mean() < high
    assert consistency.nees(found, covariances / 4.0).mean() > high


def test_nees_of_a_certain_pose_is_no_division_by_zero() -> None:
    zero = np.zeros((1, 6, 6))
    assert consistency.nees(np.zeros((1, 6)), zero)[0] == 0.0
    assert consistency.nees(np.full((1, 6), 0.1), zero)[0] > 1e6


def test_score_of_a_perfect_run_in_another_world() -> None:
    truth = walk()
    other_world = g.se3_exp([5.0, 6.0, 7.0, 1.0, 0.2, 0.3]) @ truth
    scores = scoring.score(record_of(truth), other_world)
    assert scores["ate_rmse_m"] == pytest.approx(0.0, abs=1e-9)
    assert scores["avg_position_error_m"] == pytest.approx(0.0, abs=1e-9)
    assert scores["final_error_pct"] == pytest.approx(0.0, abs=1e-9)
    assert scores["scale_error"] == pytest.approx(0.0, abs=1e-9)
    assert scores["nees_mean"] == pytest.approx(0.0, abs=1e-9)
    assert scores["path_length_m"] == pytest.approx(metrics.path_length(truth[:, :3, 3]))
    assert scores["frames_ok"] == 60


def test_score_of_a_path_that_is_too_long() -> None:
    truth = walk()
    estimate = truth.copy()
    estimate[:, :3, 3] *= 1.25
    scores = scoring.score(record_of(estimate), truth)
    assert scores["scale_error"] == pytest.approx(1.0 / 1.25 - 1.0)
    assert scores["final_position_error_m"] == pytest.approx(0.25 * np.linalg.norm(truth[-1, :3, 3]))


def test_an_ok_frame_more_than_five_sigma_off_is_not_ok() -> None:
    truth = walk()
    estimate = truth.copy()
    estimate[-3:, 0, 3] += 0.64  # 6.4 standard deviations of 0.1 m: beyond the square root of 39.5
    estimate[-5:-3, 0, 3] += 0.6
    scores = scoring.score(record_of(estimate), truth)
    assert (scores["frames_ok"], scores["frames_ok_reported"], scores["frames_false_ok"]) == (57, 60, 3)
    assert scores["false_ok_share"] == pytest.approx(3 / 60)
    assert scores["ok_share"] == pytest.approx(57 / 60)


def test_scores_skip_missing_truth_late_starts_and_invalid_poses() -> None:
    truth = walk()
    estimate = truth.copy()
    record = record_of(estimate)
    for k in range(10):
        record.steps[k] = replace(record.steps[k], started=False, valid=False, status=Status.COASTING)
    record.steps[40] = replace(record.steps[40], valid=False, pose=estimate[40] + 9.0)
    partial = truth.copy()
    partial[12:15] = np.nan
    scores = scoring.score(record, partial)
    assert scores["start_frame"] == 10
    assert scores["frames_scored"] == 50 - 3 - 1
    assert scores["avg_position_error_m"] < 1e-9 < scores["avg_position_error_all_m"]
    assert scores["final_position_error_m"] < 1e-9


def lost_from(frame: int, poses: np.ndarray) -> RunRecord:
    """A record whose camera is lost from a frame on, and says so."""
    record = record_of(poses)
    record.steps[frame:] = [replace(step, valid=False, status=Status.LOST) for step in record.steps[frame:]]
    return record


def test_a_lost_run_is_scored_over_all_frames() -> None:
    truth = walk()
    stuck = truth.copy()
    stuck[15:] = stuck[14]
    scores = scoring.score(lost_from(15, stuck), truth)
    assert scores["ate_pct"] == pytest.approx(0.0, abs=1e-9)  # which looks perfect by itself
    assert scores["coverage"] == scores["ok_share"] == pytest.approx(0.25)
    expected = metrics.ate_rmse(stuck[:, :3, 3], truth[:, :3, 3]) / metrics.path_length(truth[:, :3, 3])
    assert scores["ate_pct_all_frames"] == pytest.approx(100.0 * expected)
    assert scores["ate_pct_all_frames"] > 15.0
    assert scores["ate_alignment"] == "SE(3)"
    # a prediction that is not finite counts as the last one that was; one that never started, as the origin
    stuck[15:] = np.nan
    assert scoring.score(lost_from(15, stuck), truth)["ate_pct_all_frames"] == pytest.approx(100.0 * expected)
    nowhere = lost_from(0, np.full_like(truth, np.nan))
    spread = np.sqrt(((truth[:, :3, 3] - truth[:, :3, 3].mean(axis=0)) ** 2).sum(axis=1).mean())
    assert scoring.score(nowhere, truth)["ate_pct_all_frames"] == pytest.approx(
        100.0 * spread / metrics.path_length(truth[:, :3, 3])
    )


def test_an_arbitrary_scale_has_no_lengths_of_errors() -> None:
    truth = walk()
    estimate = truth.copy()
    estimate[:, :3, 3] *= 7.0
    scores = scoring.score(record_of(estimate), truth, metric=False)
    assert all(scores[name] is None for name in scoring.METRIC_SCORES)
    assert scores["ate_alignment"] == "Sim(3)"
    assert scores["ate_pct_all_frames"] == pytest.approx(0.0, abs=1e-9)
    assert scores["ate_sim3_pct"] == pytest.approx(0.0, abs=1e-9)
    assert scores["path_length_m"] == pytest.approx(metrics.path_length(truth[:, :3, 3]))
    assert scoring.score(record_of(estimate), None, metric=False)["path_length_m"] is None
    # the truth that is drawn and written is in the estimate's unit
    aligned = scoring.align_truth(record_of(estimate), truth, metric=False)
    assert aligned is not None
    np.testing.assert_allclose(aligned.poses, estimate, atol=1e-9)
    # half the path twice as long: what is off after the fit is in metres of the truth
    estimate[30:, :3, 3] += estimate[30:, :3, 3] - estimate[30, :3, 3]
    bent = scoring.score(record_of(estimate), truth, metric=False)
    expected = metrics.ate_rmse(estimate[:, :3, 3], truth[:, :3, 3], with_scale=True)
    assert bent["ate_sim3_m"] == pytest.approx(expected)


def test_the_truth_starts_where_the_filter_did() -> None:
    # A view that came 0.3 s late started it from frame 0: W is that frame, which is of no record.
    truth = walk()
    estimate = np.linalg.inv(truth[0]) @ truth
    estimate[3] = estimate[3] @ g.se3_exp([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])
    ago: list[float | None] = [None] * len(truth)
    ago[3] = 0.3
    record = record_of(estimate, start_ago_s=ago)
    for k in range(3):
        record.steps[k] = replace(record.steps[k], started=False, valid=False)
    aligned = scoring.align_truth(record, truth)
    assert aligned is not None
    assert (aligned.start, int(aligned.known.sum())) == (3, len(truth) - 3)
    np.testing.assert_allclose(aligned.poses[4:], estimate[4:], atol=1e-9)
    truth[0] = np.nan  # nobody knows where W is: the first pose that both know tells
    aligned = scoring.align_truth(record, truth)
    assert aligned is not None
    np.testing.assert_allclose(aligned.poses[3], estimate[3], atol=1e-9)


def test_consistency_is_told_apart_from_inflation(rng: np.random.Generator) -> None:
    sd = np.array([0.1, 0.2, 0.3])
    errors = rng.normal(size=(20_000, 3)) * sd
    consistent = np.tile(np.diag(sd**2), (len(errors), 1, 1))
    assert consistency.sharpness(errors, consistent) == pytest.approx(1.0, abs=0.02)
    assert consistency.sharpness(errors, 4.0 * consistent) == pytest.approx(0.5, abs=0.01)
    # overconfident in half of the poses, far too cautious in the others: the mean NEES is 3, this is not 1
    mixed = consistent.copy()
    mixed[::2] *= 0.5
    mixed[1::2] *= 100.0
    assert consistency.nees(errors, mixed).mean() == pytest.approx(3.0, abs=0.1)
    assert consistency.sharpness(errors, mixed) < 0.2
    assert math.isnan(consistency.sharpness(np.full((1, 3), np.nan), consistent[:1]))


def test_a_bound_is_five_sigma_of_the_worst_axis() -> None:
    covariance = np.diag([0.01, 0.04, 0.01, 1e-4, 1e-4, 4e-4])
    result = step_result(0.0, np.eye(4), covariance, {})
    assert result.bound == pytest.approx((1.0, 0.1))
    assert replace(result, covariance=1e6 * covariance).bound == pytest.approx((1000.0, np.pi))
    for other in (replace(result, status=Status.DEGRADED), replace(result, metric=False)):
        assert other.bound is None


def test_a_covariance_as_wide_as_the_errors_scores_best(rng: np.random.Generator) -> None:
    errors = rng.standard_t(4.0, (20_000, 3)) * math.sqrt(0.5)  # of unit variance
    told = [np.tile(np.eye(3) * sd**2, (20_000, 1, 1)) for sd in (0.5, 1.0, 2.0)]
    narrow, right, wide = (consistency.log_score(errors, covariance) for covariance in told)
    assert right > max(narrow, wide) + 0.1
    assert math.isnan(consistency.log_score(np.full((1, 3), np.nan), np.eye(3)[None]))


def test_who_exceeds_a_bound_is_counted() -> None:
    covariance = np.tile(np.diag([0.01] * 3 + [1e-4] * 3), (4, 1, 1))
    errors = np.zeros((4, 6))
    errors[0, 0], errors[1, 4], errors[2, :2] = 0.6, 0.06, 0.4  # the last one together, not along an axis
    errors[3] = np.nan
    exceeded, position, attitude = consistency.bound_kept(errors, covariance)
    assert exceeded == 1.0
    assert position == pytest.approx(0.5 / math.sqrt((0.6**2 + 2 * 0.4**2) / 3))
    assert attitude == pytest.approx(0.05 / math.sqrt(0.06**2 / 3))
    assert consistency.bound_kept(errors[:1], 2.0 * covariance[:1])[0] == 0.0
    assert all(math.isnan(n) for n in consistency.bound_kept(errors[3:], covariance[3:]))


def test_the_slowest_frames() -> None:
    record = record_of(walk(50))
    record.seconds = [0.001 * k for k in range(50)]
    scores = scoring.score(record, None)
    assert (scores["ms_p99"], scores["ms_max"]) == pytest.approx((49.0, 49.0))
    record = record_of(walk(200))
    record.seconds = [0.01] * 199 + [1.0]
    scores = scoring.score(record, None)
    assert (scores["ms_p99"], scores["ms_max"]) == pytest.approx((10.0, 1000.0))


def test_scores_without_truth_and_without_a_start() -> None:
    scores = scoring.score(record_of(walk(), overlap=[1] * 30 + [0] * 30, depth_rows=[2] * 60), None)
    assert scores["ate_rmse_m"] is None
    assert scores["path_length_of"] == "estimate"
    assert scores["overlap_ratio"] == pytest.approx(0.5)
    assert scores["depth_measurements"] == 120
    never = record_of(walk(3))
    never.steps = [replace(step, started=False) for step in never.steps]
    assert scoring.score(never, walk(3))["frames_ok"] == 0
    assert scoring.score(RunRecord(), walk(3))["frames"] == 0


def test_a_pose_that_is_not_finite_is_reported_and_left_out() -> None:
    record = record_of(walk())
    record.steps[20] = replace(record.steps[20], pose=np.full((4, 4), np.nan))
    scores = scoring.score(record, walk())
    assert scores["all_finite"] is False
    assert scores["ate_rmse_m"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "call",
    [
        lambda: metrics.ate_rmse(np.zeros((3, 3)), np.zeros((4, 3))),
        lambda: metrics.ate_rmse(np.full((3, 3), np.nan), np.zeros((3, 3))),
        lambda: metrics.scale_error(np.zeros((3, 3)), np.zeros((3, 3))),
        lambda: metrics.rpe(np.zeros((3, 4)), np.zeros((3, 4))),
        lambda: consistency.nees(np.zeros((2, 6)), np.zeros((2, 3, 3))),
        lambda: overlap.overlap_intervals([0.0, 1.0], [True]),
    ],
)
def test_arrays_that_do_not_fit_are_refused(call) -> None:
    with pytest.raises(InputError):
        call()
