"""What a worn camera and Cs see together in one frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from collabslam._core import Filter, MeasurementOutcomes, WornMeasurement
from collabslam.frontend.patch import Patch, capture
from collabslam.frontend.worn_match import WornMatches
from collabslam.slam.map_change import ImagePoints
from collabslam.types import Array, Ids, Image, WornView


@dataclass(frozen=True)
class Overlap:
    """A worn camera's view at a frame of Cs: what both show, ready for the filter.

    Attributes
    ----------
    number : int
        Of the worn camera.
    given : WornView
        The view as it was taken.
    worn : WornView
        The same with T_CF as it is for the frame; `given` itself if it was taken with the frame.
    at : float
        Time of the frame, seconds.
    image : (H, W) uint8 or None
        Its image, where it is an earlier one than that which the engine is at.
    measured : bool
        Whether there is something to measure: there is overlap, and the view was not refused.
    ids : (M,) int64
        Feature of each pair, -1 for a new point.
    candidates : (M,) int64
        Candidate that the new point was until now, -1 for none.
    uv, uv_f : (M, 2) float64
        Pixels in Cs and Cf; NaN in Cs for corners of tags.
    matches : WornMatches or None
    against : float
        How much the view contradicts T_CF, above 1 beyond its covariance: the images do (`Verdict`), or the
        map does; NaN where neither says anything.
    size : float
        How much it contradicts the map's size, above 1 beyond all covariances (`ask_size`); NaN where it
        says nothing.
    refused : bool
        The view contradicts T_CF or the map, or the map's size: it is not used.
    baseline : float
        |t_CF|, metres; NaN without overlap.
    tag_corners : int
        How many of the pairs, the last ones, are corners of the map's printed tags, read off in Cf.
    """

    number: int
    given: WornView
    worn: WornView
    at: float
    image: Image | None = None
    measured: bool = False
    ids: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    candidates: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    uv: Array = field(default_factory=lambda: np.empty((0, 2)))
    uv_f: Array = field(default_factory=lambda: np.empty((0, 2)))
    matches: WornMatches | None = None
    points: int = 0
    against: float = float("nan")
    size: float = float("nan")
    refused: bool = False
    baseline: float = float("nan")
    tag_corners: int = 0

    @property
    def pixels(self) -> Array:
        """(K, 4) float64: pixels in Cs and in Cf of what both see."""
        both = len(self.ids) - self.tag_corners
        return np.hstack([self.uv[:both], self.uv_f[:both]])

    @property
    def taken(self) -> float:
        """When the view was taken, seconds by the clock of Cs: with the frame, if it does not say."""
        return self.at if self.given is self.worn or self.given.t is None else self.given.t

    @property
    def observation(self) -> WornMeasurement:
        """As `Filter.update` takes it, with its matches; `Filter.worn_pose` needs none."""
        given = self.given
        with_frame = given is self.worn or given.t is None
        measured = WornMeasurement(
            given.t_cf,
            given.covariance,
            self.ids,
            self.uv,
            self.uv_f,
            bias=given.bias,
            capture=None if with_frame else (self.taken, self.at),
            who=self.number,
        )
        return measured if given.rate is None else measured.with_rate(given.rate)

    def lasting(self, bias_share: float) -> float:
        """Share of T_CF's covariance that lasts: ``bias_share`` where the view does not say."""
        covariance, bias = self.given.covariance, self.given.bias
        return bias_share if bias is None else float(np.mean(np.diag(bias) / np.diag(covariance)))

    def moved(self, error: Array, of_map: Array, bias_share: float) -> tuple[float, float]:
        """Square of an ``error`` (6,) of T_CF in units of its covariance, and the share of that which lasts.

        What the map's own errors put into it, of the covariance ``of_map`` (6, 6), is in both; the share of
        T_CF's is ``bias_share`` where the view does not say.
        """
        whole = self.given.covariance + of_map
        maps = float(np.mean(np.diag(of_map) / np.diag(whole)))
        return float(error @ np.linalg.solve(whole, error)), maps + (1.0 - maps) * self.lasting(bias_share)

    def length(self, error: Array, left: Array, of_map: Array, bias_share: float) -> Array:
        """What the view says of |t_CF|, (6,) as `collabslam.frontend.worn_size.changed_length` takes it.

        By an ``error`` (6,) of T_CF, the covariance ``left`` (6, 6) of what that may still be off by, and the
        one ``of_map`` (6, 6) of what the map's own errors put into it.
        """
        t_cf = self.given.t_cf
        along = t_cf[:3, :3].T @ t_cf[:3, 3]  # the error is along the axes of F
        covariances = (self.given.covariance, left, of_map)
        stated, is_left, maps = (float(along @ c[:3, :3] @ along) for c in covariances)
        if stated <= 0.0:  # no baseline
            return np.zeros(6)
        sd = np.sqrt(stated)
        told, of_map_told = max(1.0 - is_left / stated, 0.0), max(maps / stated, 0.0)  # but for rounding
        off = float(along @ error[:3]) / sd
        return np.array([off, told, of_map_told, self.lasting(bias_share), sd / (along @ along), self.taken])

    def births(self, outcomes: MeasurementOutcomes, t: float) -> tuple[ImagePoints, Ids]:
        """Features born from pairs of the frame at ``t``, and the candidates (C,) that births use up."""
        used = self.candidates[outcomes.born >= 0]
        born = ImagePoints.born(outcomes.born, self.uv) if self.at == t else ImagePoints()
        return born, used[used >= 0]

    def earlier_births(self, outcomes: MeasurementOutcomes, core: Filter, t: float) -> dict[int, Patch]:
        """Features born from pairs of a frame before the one at ``t``, with their patches from there."""
        if self.image is None or self.at == t:
            return {}
        born = ImagePoints.born(outcomes.born, self.uv)
        patches = capture(self.image, born.uv, core.kept_pose(self.at))
        return dict(zip(born.ids.tolist(), patches, strict=True))

    def counts(self, outcomes: MeasurementOutcomes | None) -> dict[str, Any]:
        """Diagnostics of the worn camera; None is what was not measured."""
        rejected = self.matches.rejected if self.matches else {}
        verdict = self.matches.verdict if self.matches else None
        correction = np.full(6, np.nan) if verdict is None else verdict.correction
        return {
            "overlap": int(self.measured and not np.isnan(self.baseline)),
            "baseline_m": self.baseline,
            "cf_refused": int(self.refused),
            "t_cf_correction_m": float(np.linalg.norm(correction[:3])),
            "t_cf_correction_deg": float(np.degrees(np.linalg.norm(correction[3:]))),
            "t_cf_against": self.against,
            "size_against": self.size,
            "cf_points": self.points,
            "cf_matches": len(self.ids),
            "cf_tag_corners": self.tag_corners,
            "cf_rejected_region": rejected.get("region", 0),
            "cf_rejected_ratio": rejected.get("ratio", 0) + rejected.get("mutual", 0),
            "cf_rejected_epipolar": rejected.get("epipolar", 0) + rejected.get("consensus", 0),
            "cf_rejected_low_score": rejected.get("score", 0),
            "cf_rejected_chi2": outcomes.rejected_gate if outcomes else 0,
            "cf_rejected_hohct": outcomes.rejected_batch if outcomes else 0,
            "cf_rejected_conditional": outcomes.rejected_conditional if outcomes else 0,
            "cf_too_uncertain": outcomes.too_uncertain if outcomes else 0,
            "depth_rows": outcomes.depth_rows if outcomes else 0,
            "cf_pixel_rows": outcomes.pixel_rows if outcomes else 0,
        }
