"""What became of each feature in one frame, for those who want to look."""

from __future__ import annotations

import numpy as np

from collabslam._core import Prediction, UpdateReport
from collabslam.frontend.search import AMBIGUOUS, FOUND, LOW_SCORE
from collabslam.results import FrameFeatures
from collabslam.slam.tracking.tracks import Found
from collabslam.slam.worn.overlaps import Overlaps


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
