"""What the worn cameras see of a frame: what both see, and the map's printed tags, which Cf may see alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collabslam.slam.map_change import ImagePoints
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.slam.worn.late_views import LateViews
from collabslam.slam.worn.matcher import WornMatcher
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.overlaps import Overlaps


def overlaps(
    late: LateViews,
    matcher: WornMatcher,
    printed: PrintedTargets,
    view: View,
    found: TrackingResult,
    missing: int,
) -> Overlaps:
    """What each worn camera sees of a frame, or of the one nearest to its view (METHOD 7.4 and 10).

    Parameters
    ----------
    late, matcher, printed
        Parts of the engine.
    view : View
    found : TrackingResult
        What the frame's search has found.
    missing : int
        Features that the frame lacks.
    """
    each: list[Overlap] = []
    for given in view.worn:
        overlap = matcher.match(*late.beside(view, given, found), missing, each)
        if matcher.measures_pixels and view.started and not overlap.refused:
            overlap = _with_tags(overlap, printed.in_worn(overlap.worn.image))
        each.append(overlap)
    return Overlaps(tuple(each))


def _with_tags(overlap: Overlap, corners: ImagePoints) -> Overlap:
    """The overlap with corners of tags, features and their pixels in Cf, whatever Cs sees of them."""
    count = len(corners)
    if not count:
        return overlap
    others = ~np.isin(overlap.ids, corners.ids)  # read off is better than found by similarity
    return replace(
        overlap,
        ids=np.concatenate([overlap.ids[others], corners.ids]),
        candidates=np.concatenate([overlap.candidates[others], np.full(count, -1)]),
        uv=np.concatenate([overlap.uv[others], np.full((count, 2), np.nan)]),
        uv_f=np.concatenate([overlap.uv_f[others], corners.uv]),
        measured=True,
        tag_corners=count,
    )
