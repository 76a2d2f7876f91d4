"""What a frame does to the map: worked out by the parts, adopted once, at the end of the frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from collabslam.frontend.patch import Patch
from collabslam.types import Array, Ids


@dataclass(frozen=True)
class ImagePoints:
    """Features or candidates in an image: their ``ids`` (N,) int64 and pixels ``uv`` (N, 2) float64."""

    ids: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    uv: Array = field(default_factory=lambda: np.empty((0, 2)))

    def __len__(self) -> int:
        return len(self.ids)

    def with_more(self, others: ImagePoints) -> ImagePoints:
        """These and others."""
        return ImagePoints(np.concatenate([self.ids, others.ids]), np.concatenate([self.uv, others.uv]))

    def without(self, ids: Ids) -> ImagePoints:
        """Those that are not among ``ids``."""
        kept = ~np.isin(self.ids, ids)
        return ImagePoints(self.ids[kept], self.uv[kept])

    @classmethod
    def born(cls, ids: Ids, uv: Array) -> ImagePoints:
        """Those of the pixels that gave a feature; ``ids`` is -1 for the others."""
        given = ids >= 0
        return cls(ids[given], uv[given])


@dataclass(frozen=True)
class MapChange:
    """Births and deletions of one frame (METHOD 5, and 7.8).

    Attributes
    ----------
    instant : ImagePoints
        Features born with the depth that Cf or a known target gives.
    measured : ImagePoints
        Features born with the depth of another sensor.
    undelayed : ImagePoints
        Features born with a weak prior on their depth.
    delayed, promoted : dict
        Feature by the candidate that it was until now: one whose parallax suffices, and one that waits no
        longer and gets a weak prior.
    candidates : ImagePoints
        Candidates that begin.
    earlier : dict
        First patch of each feature that was born with depth of a frame before this one.
    deleted : (D,) int64
        Features that the filter has deleted.
    off_arc : (S,) float64
        Of each candidate given up as it is where no point at rest would be: by how many times as much as
        noise and the poses allow, more than 1.
    fixed : (F, 2) float64
        Pixels of candidates given up as they are fixed to the camera.
    """

    instant: ImagePoints = field(default_factory=ImagePoints)
    measured: ImagePoints = field(default_factory=ImagePoints)
    undelayed: ImagePoints = field(default_factory=ImagePoints)
    delayed: Mapping[int, int] = field(default_factory=dict)
    promoted: Mapping[int, int] = field(default_factory=dict)
    candidates: ImagePoints = field(default_factory=ImagePoints)
    earlier: Mapping[int, Patch] = field(default_factory=dict)
    deleted: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    off_arc: Array = field(default_factory=lambda: np.empty(0))
    fixed: Array = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def born(self) -> ImagePoints:
        """Features whose patch is taken from this frame."""
        kinds = (self.instant, self.measured, self.undelayed)
        return ImagePoints(np.concatenate([k.ids for k in kinds]), np.concatenate([k.uv for k in kinds]))

    @property
    def with_depth(self) -> int:
        """Number of features born with depth: measurements of this frame as good as matches."""
        return len(self.instant) + len(self.measured)

    def counts(self) -> dict[str, int]:
        """Diagnostics: births by kind, and deletions."""
        return {
            "births_instant": len(self.instant) + len(self.earlier),
            "births_depth": len(self.measured),
            "births_delayed": len(self.delayed),
            "births_undelayed": len(self.undelayed) + len(self.promoted),
            "candidates_off_arc": len(self.off_arc),
            "candidates_fixed": len(self.fixed),
            "deleted": len(self.deleted),
        }


@dataclass(frozen=True)
class Recovered:
    """How a camera was found that was not where prediction put it.

    Attributes
    ----------
    seen : ImagePoints
        Landmarks that the pose rests on; none where a map begins.
    other_map : dict or None
        First patch of each feature of the map that the camera is in now, but for those that are born in this
        frame; None if that is still the same map.
    begun : MapChange or None
        Births of a map that begins; None where the camera was found in one that there was.
    counts : dict
        Diagnostics of the overlap with Cf that the map begins from.
    identified : bool
        Whether it rests on points that say themselves which they are, of which few are enough.
    contradicted : bool
        Whether it and the frames before it rest on such points alone, so that the rest of the map in view is
        wrong.
    jumped : bool
        Whether prediction excludes where it was found, whatever is not known of the map.
    targets : dict
        Features of the corners (N,) int64 of the printed targets in another map, by the target's name; -1
        where one is gone.
    """

    seen: ImagePoints = field(default_factory=ImagePoints)
    other_map: Mapping[int, Patch] | None = None
    begun: MapChange | None = None
    counts: Mapping[str, Any] = field(default_factory=dict)
    identified: bool = False
    contradicted: bool = False
    jumped: bool = False
    targets: Mapping[str, Ids] = field(default_factory=dict)
