"""What became of each feature in one frame, for those who want to look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam._core import Prediction, UpdateReport
from collabslam.frontend.search import AMBIGUOUS, FOUND, LOW_SCORE
from collabslam.slam.tracking.tracks import Found
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import Array, Ids

STATES = ("accepted", "rejected", "unlike", "ambiguous", "outside", "not searched")
"""Used by the filter; found but refused; patch not found; found twice; outside the image; not looked for."""


@dataclass(frozen=True)
class FrameFeatures:
    """The features that should be visible in a frame.

    Attributes
    ----------
    ids : (N,) int64
    predicted : (N, 2) float64
        Pixels where they are expected.
    s : (N, 2, 2) float64
        Innovation covariance of those, px^2.
    found : (N, 2) float64
        Pixels where they were found; NaN elsewhere.
    states : (N,) of str
        One of `STATES` each.
    pairs : (M, 4) float64
        What both cameras see: pixels in Cs, when Cf took its view, and in Cf; of several worn cameras one
        after the other.
    pair_names : list of str
        Whose worn camera each pair is of.
    """

    ids: Ids
    predicted: Array
    s: Array
    found: Array
    states: list[str]
    pairs: Array
    pair_names: list[str]

    def pairs_of(self, name: str) -> Array:
        """(K, 4) the pairs of one worn camera."""
        return np.asarray(self.pairs[np.array([whose == name for whose in self.pair_names], bool)])


def frame_features(
    expected: Prediction, found: Found, report: UpdateReport, overlap: Overlaps
) -> FrameFeatures:
    """Puts prediction, search, update and overlap of a frame together."""
    ids = expected.ids
    names = {FOUND: "rejected", LOW_SCORE: "unlike", AMBIGUOUS: "ambiguous"}
    codes = found.result.code.tolist()
    states = {i: names.get(c, "outside") for i, c in zip(found.searched.tolist(), codes, strict=True)}
    states.update(dict.fromkeys(found.ids[report.bearings.accepted].tolist(), "accepted"))
    row = {i: k for k, i in enumerate(ids.tolist())}
    place = np.full((len(ids), 2), np.nan)
    place[[row[i] for i in found.ids.tolist()]] = found.uv
    return FrameFeatures(
        ids,
        expected.uv,
        expected.s,
        place,
        [states.get(i, "not searched") for i in ids.tolist()],
        overlap.pixels,
        overlap.names,
    )


def unsearched_features(expected: Prediction) -> FrameFeatures:
    """The features of a frame in which none was searched."""
    count = len(expected.ids)
    return FrameFeatures(
        expected.ids,
        expected.uv,
        expected.s,
        np.full((count, 2), np.nan),
        ["not searched"] * count,
        np.empty((0, 4)),
        [],
    )
