"""Scores of one run: what it did, and how far from the truth it was (METHOD section 12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam.evaluation import headline, metrics, overlap
from collabslam.evaluation.consistency import (
    bound_kept,
    log_score,
    nees,
    nees_band,
    pose_tangent_error,
    sharpness,
    sigma_gate,
)
from collabslam.evaluation.record import RunRecord
from collabslam.types import Array, Mask

Scores = dict[str, Any]

OK_SIGMAS = 5.0
"""An OK frame further off than this counts as not OK; see `sigma_gate` for six dimensions."""
RPE_SECONDS = 1.0
TRUTH_SCORES = (
    "ate_pct_all_frames",
    "ate_alignment",
    "ate_sim3_m",
    "ate_sim3_pct",
    "rpe_rotation_deg",
    "orientation_error_avg_deg",
    "orientation_error_final_deg",
    "heading_error_final_deg",
)
"""Numbers that need a truth."""
METRIC_SCORES = (
    "ate_rmse_m",
    "ate_pct",
    "scale_error",
    "avg_position_error_m",
    "avg_position_error_all_m",
    "avg_error_pct",
    "sum_position_error_m",
    "final_position_error_m",
    "final_error_pct",
    "rpe_translation_m",
    "false_ok_share",
    "nees_mean",
    "nees_position",
    "nees_attitude",
    "nees_inside_share",
    "sharpness_position",
    "sharpness_attitude",
    "log_score",
    "bound_exceeded_share",
    "bound_over_error_position",
    "bound_over_error_attitude",
    "overhead_u",
    "overhead_u_per_path",
)
"""Numbers that need a truth and an estimate in metres: of an arbitrary scale they would say nothing."""


@dataclass(frozen=True)
class AlignedTruth:
    """Truth in W, sharing the estimate's pose at ``start``; at the frame before it whose pose is W, where the
    filter starts from one.

    Attributes
    ----------
    poses : (N, 4, 4) float64
        ``T_WC``; NaN where the truth is missing.  In the estimate's unit, if that is not metres.
    start : int
        First frame with both a valid estimate and a truth.
    known : (N,) bool
        Frames from ``start`` on that have a truth and a finite estimate.
    scale : float
        Metres in one unit of ``poses``.
    """

    poses: Array
    start: int
    known: Mask
    scale: float = 1.0


def align_truth(record: RunRecord, truth: Array | None, *, metric: bool = True) -> AlignedTruth | None:
    """The truth of a run's frames moved into W, or None if there is none to compare with.

    Parameters
    ----------
    record : RunRecord
        Of N frames.
    truth : (N or more, 4, 4) array or None
        ``T_WC`` in the data set's own world, NaN where it is missing.
    metric : bool
        Whether the estimate is in metres; if not, the truth's lengths are scaled to its unit, by the scale
        that fits the paths best.
    """
    if truth is None or not len(record):
        return None
    given = np.asarray(truth, np.float64)[: len(record)]
    known = np.isfinite(given).all(axis=(1, 2)) & record.finite
    both = np.flatnonzero(known & record.valid)
    if not len(both):
        return None
    start = int(both[0])
    at, estimated = start, record.poses[start]
    first = record.origin(start)
    if first is not None and np.isfinite(given[first]).all():
        at, estimated = first, np.eye(4)
    moved, scale = metrics.first_poses_aligned(given, given[at], estimated), 1.0
    if not metric:
        estimate, true = record.poses[both, :3, 3], given[both, :3, 3]
        if metrics.path_length(estimate) > 0.0 and metrics.path_length(true) > 0.0:
            scale = 1.0 + metrics.scale_error(estimate, true)
            origin = moved[start, :3, 3].copy()
            moved[:, :3, 3] = origin + (moved[:, :3, 3] - origin) / scale
    return AlignedTruth(moved, start, known & (np.arange(len(record)) >= start), scale)


def score(record: RunRecord, truth: Array | None, *, metric: bool = True) -> Scores:
    """Every number of ``summary.json`` that follows from the frames and the truth.

    ``ate_pct_all_frames`` is over all frames, as described in `collabslam.evaluation.headline`.  The other
    ATE, scale error, Eq. 15 and 16, RPE, NEES and sharpness are over the valid poses that have a truth, and
    mean nothing without ``coverage``, their share; ``avg_position_error_all_m`` and the final errors are over
    all poses from the start on, valid or not.  NEES and sharpness leave out the start, whose error is zero by
    construction.

    Parameters
    ----------
    record : RunRecord
    truth : (N or more, 4, 4) array or None
    metric : bool
        Whether the poses are in metres.  If not, there are no lengths of errors but after a Sim(3) alignment,
        no NEES, and no frame is held against the truth to count as OK.

    Returns
    -------
    dict
        Numbers, or None where one cannot be had.
    """
    aligned = align_truth(record, truth, metric=metric)
    out = _activity(record, aligned, metric)
    out.update(_overlap(record))
    out.update(dict.fromkeys((*TRUTH_SCORES, *METRIC_SCORES)))
    out.update(headline.frame_times(record.seconds))
    if truth is not None:
        out.update(headline.all_frames(record, truth, metric=metric))
    if aligned is None:
        positions = record.poses[record.valid, :3, 3]
        out["path_length_m"] = metrics.path_length(positions) if metric else None
        out["path_length_of"] = "estimate"
        return _plain(out)
    path = metrics.path_length(np.asarray(truth)[: len(record)][aligned.known, :3, 3])
    out["path_length_m"], out["path_length_of"] = path, "truth"
    scores = _position_scores(record, aligned, path) | _orientation_scores(record, aligned)
    scores |= _consistency_scores(record, aligned) | _overhead(record, aligned, path)
    scores["false_ok_share"] = out["frames_false_ok"] / out["frames"]
    out.update({k: v for k, v in scores.items() if metric or k not in METRIC_SCORES})
    return _plain(out)


def pose_nees(record: RunRecord, aligned: AlignedTruth) -> Array:
    """NEES of each pose, six degrees of freedom, (N,); NaN where there is no truth."""
    return nees(pose_tangent_error(*_pair(record, aligned)), record.covariances)


def _pair(record: RunRecord, aligned: AlignedTruth) -> tuple[Array, Array]:
    """Estimate and truth, (N, 4, 4) each, NaN in both where they cannot be compared."""
    hidden = ~aligned.known[:, None, None]
    return np.where(hidden, np.nan, record.poses), np.where(hidden, np.nan, aligned.poses)


def _activity(record: RunRecord, aligned: AlignedTruth | None, metric: bool) -> Scores:
    """Frames by status, features, depth measurements, innovation statistics."""
    statuses = np.array(record.statuses, dtype=object)
    ok = statuses == "OK"
    far = np.zeros(len(record), bool)
    if aligned is not None and metric:
        with np.errstate(invalid="ignore"):
            far = aligned.known & (pose_nees(record, aligned) > sigma_gate(OK_SIGMAS, 6))
    frames = len(record)
    good = int((ok & ~far & record.started).sum())
    nis, dof = record.diagnostic("nis"), record.diagnostic("nis_dof")
    used = np.isfinite(nis) & (dof > 0)
    return {
        "frames": frames,
        "frames_ok": good,
        "frames_ok_reported": int(ok.sum()),
        "frames_false_ok": int((ok & far).sum()),
        "frames_degraded": int((statuses == "DEGRADED").sum()),
        "frames_coasting": int((statuses == "COASTING").sum()),
        "frames_lost": int((statuses == "LOST").sum()),
        "frames_valid": int(record.valid.sum()),
        "frames_scored": 0 if aligned is None else int((aligned.known & record.valid).sum()),
        "frames_worn": int(np.sum(record.worn)),
        "duration_s": float(record.times[-1] - record.times[0]) if frames else 0.0,
        "position_sd_final_m": _position_sd(record) if metric else None,
        "coverage": headline.coverage(record),
        "ok_share": good / frames if frames else None,
        "status_final": str(statuses[-1]) if frames else None,
        "start_frame": record.start,
        "all_finite": bool(record.finite.all()),
        "features_per_frame": _mean(record.diagnostic("accepted")),
        "target_residual_max_px": _largest(record.diagnostic("target_residual_px")),
        "map_size_mean": _mean(record.diagnostic("map_size")),
        "depth_measurements": _total(record, "depth_rows") + _total(record, "cf_pixel_rows"),
        "births_instant": _total(record, "births_instant"),
        "nis_per_dof": float(nis[used].sum() / dof[used].sum()) if used.any() else None,
    }


def _position_sd(record: RunRecord) -> float | None:
    """Standard deviation of the last position that may be used, over all axes."""
    valid = np.flatnonzero(record.valid)
    return float(np.sqrt(np.trace(record.covariances[valid[-1], :3, :3]))) if len(valid) else None


def _largest(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else None


def _overlap(record: RunRecord) -> Scores:
    flags = np.nan_to_num(record.diagnostic("overlap")) > 0.0
    eta, mu = overlap.overlap_intervals(record.times, flags)
    return {
        "overlap_ratio": overlap.overlap_ratio(record.times, flags),
        "overlap_intervals": len(eta),
        "overlap_seconds": float(eta.sum()),
        "overlap_tau_s": overlap.overlap_regularity(eta),
        "overlap_kappa_s2": overlap.non_overlap_deviation(mu),
    }


def _position_scores(record: RunRecord, aligned: AlignedTruth, path: float) -> Scores:
    estimate, truth = record.poses[:, :3, 3], aligned.poses[:, :3, 3]
    use = aligned.known & record.valid
    every = np.flatnonzero(aligned.known)
    ate = metrics.ate_rmse(estimate[use], truth[use])
    average = metrics.average_position_error(estimate[use], truth[use])
    last = int(every[-1])
    final = float(np.linalg.norm(estimate[last] - truth[last]))
    moves = metrics.path_length(estimate[use]) > 0.0
    scaled = aligned.scale * metrics.ate_rmse(estimate[use], truth[use], with_scale=True) if moves else None
    step = _frames_in(record.times, RPE_SECONDS)
    gaps = np.where(use[:, None, None], record.poses, np.nan)
    relative = metrics.rpe(gaps, aligned.poses, step=step) if step < len(record) else (None, None)
    return {
        "ate_rmse_m": ate,
        "ate_pct": _percent(ate, path),
        "ate_sim3_m": scaled,
        "ate_sim3_pct": None if scaled is None else _percent(scaled, path),
        "scale_error": metrics.scale_error(estimate[use], truth[use]) if moves else None,
        "sum_position_error_m": metrics.accumulated_position_error(estimate[use], truth[use]),
        "avg_position_error_m": average,
        "avg_position_error_all_m": metrics.average_position_error(estimate[every], truth[every]),
        "avg_error_pct": _percent(average, path),
        "final_position_error_m": final,
        "final_error_pct": _percent(final, path),
        "rpe_seconds": RPE_SECONDS,
        "rpe_translation_m": relative[0],
        "rpe_rotation_deg": None if relative[1] is None else float(np.degrees(relative[1])),
    }


def _orientation_scores(record: RunRecord, aligned: AlignedTruth) -> Scores:
    estimate, truth = _pair(record, aligned)
    angle = np.degrees(metrics.orientation_errors(estimate, truth))
    heading = np.degrees(metrics.heading_errors(estimate, truth))
    last = int(np.flatnonzero(aligned.known)[-1])
    return {
        "orientation_error_avg_deg": float(angle[aligned.known & record.valid].mean()),
        "orientation_error_final_deg": float(angle[last]),
        "heading_error_final_deg": float(heading[last]),
    }


def _consistency_scores(record: RunRecord, aligned: AlignedTruth) -> Scores:
    use = aligned.known & record.valid
    use[aligned.start] = False
    every = pose_tangent_error(*_pair(record, aligned))
    errors, covariances = every[use], record.covariances[use]
    ok = use & (np.array(record.statuses, dtype=object) == "OK")
    exceeded, wider_position, wider_attitude = bound_kept(every[ok], record.covariances[ok])
    whole = nees(errors, covariances)
    low, high = nees_band(6)
    position, attitude = ((errors[:, p], covariances[:, p, p]) for p in (slice(3), slice(3, 6)))
    return {
        "nees_mean": _mean(whole),
        "nees_position": _mean(nees(*position)),
        "nees_attitude": _mean(nees(*attitude)),
        "sharpness_position": sharpness(*position),
        "sharpness_attitude": sharpness(*attitude),
        "log_score": log_score(*position) + log_score(*attitude),
        "bound_exceeded_share": exceeded,
        "bound_over_error_position": wider_position,
        "bound_over_error_attitude": wider_attitude,
        "nees_band_95": [low, high],
        "nees_inside_share": float(((whole >= low) & (whole <= high)).mean()) if len(whole) else None,
    }


def _overhead(record: RunRecord, aligned: AlignedTruth, path: float) -> Scores:
    """Eq. 19, with the paper's normaliser and with the path length."""
    use = aligned.known & record.valid
    truth = aligned.poses[use, :3, 3]
    errors = metrics.position_errors(record.poses[use, :3, 3], truth)
    flags = np.nan_to_num(record.diagnostic("overlap")) > 0.0
    eta_total = float(overlap.overlap_intervals(record.times, flags)[0].sum())
    distance = float(np.linalg.norm(truth[-1] - truth[0]))
    return {
        "overhead_u": overlap.overhead_return(errors, distance, eta_total),
        "overhead_u_per_path": overlap.overhead_return(errors, path, eta_total),
    }


def _total(record: RunRecord, key: str) -> int:
    return int(np.nansum(record.diagnostic(key)))


def _frames_in(times: Array, seconds: float) -> int:
    """Frames in a stretch of time, 1 or more."""
    if len(times) < 2:
        return 1
    return max(1, round(seconds / float(np.median(np.diff(times)))))


def _percent(part: float, whole: float) -> float | None:
    return 100.0 * part / whole if whole > 0.0 else None


def _mean(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else None


def _plain(scores: Scores) -> Scores:
    """Numbers that are not finite become None."""
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in scores.items()}
