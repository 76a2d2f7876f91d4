"""Depth images, registered to the images of Cs, as depths for `collabslam.Slam.add_depth`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.gate import tell
from collabslam.datasets.images import decode_deep
from collabslam.errors import DataError
from collabslam.types import Array, DepthPoints

STEP = 6
"""Pixels from one depth that is taken to the next: each holds for corners within 4."""
FARTHEST, NEAREST = 12.0, 0.2
"""Metres beyond which, and below which, no depth camera is believed."""
SIGMA, SIGMA_AT_1M = 0.003, 0.004
"""Standard deviation of a depth camera, metres: the first, and the second times the squared depth (structured
light has 0.002 there, small stereo cameras 0.004)."""
SPEED = 1.0
"""Metres a second by which a depth of another instant is less certain."""
MILLIMETRES, TUM = 1000.0, 5000.0
"""Counts at one metre of most depth cameras, and of the TUM RGB-D benchmark."""
LEAST_SCALE = 50.0
"""Counts at one metre below which a depth image of 16 bits tells nothing."""
_EDGE = 0.03  # of the depth between neighbours: more is the edge of something


@dataclass(frozen=True)
class DepthImage:
    """A depth image on disk.

    Attributes
    ----------
    path : Path
    per_metre : float
        Its value at one metre.
    gap : float
        Seconds between it and the frame it is used in.
    """

    path: Path
    per_metre: float
    gap: float

    def points(self, camera: Camera) -> DepthPoints:
        """Its depths; raises DataError if the file is missing, broken, of another size, or not of 16 bits."""
        return depth_points(decode_deep(self.path, camera) / self.per_metre, self.gap)


def depth_scale(given: float | None, stated: float | None, usual: float, where: str) -> float:
    """Counts of a depth image at one metre: as given, as the calibration states, or as usual.

    Raises
    ------
    DataError
        If there are too few.
    """
    scale = given or stated or usual
    source = (
        "--depth-scale" if given else "the calibration" if stated else "as usual; --depth-scale says others"
    )
    tell("depth", f"{scale:g} counts a metre ({source})", where)
    if scale < LEAST_SCALE:
        raise DataError(f"The depth of {where} has {scale:g} counts a metre; give those of 16-bit images.")
    return scale


def depth_points(metres: Array, gap: float = 0.0) -> DepthPoints:
    """The depths of a depth image (H, W), metres, on a grid; nothing where it has none, or an edge.

    Parameters
    ----------
    metres : (H, W) array
        Zero or NaN where nothing was measured.
    gap : float
        Seconds from the frame that they are used in.
    """
    rows, columns = (np.arange(STEP // 2 + 1, n - 1, STEP) for n in metres.shape)
    v, u = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    around = np.stack([metres[v + dv, u + du] for dv in (-1, 0, 1) for du in (-1, 0, 1)])
    with np.errstate(invalid="ignore"):
        flat = np.ptp(around, axis=0) <= _EDGE * around[4]
        good = flat & (around.min(axis=0) >= NEAREST) & (around.max(axis=0) <= FARTHEST)
    depth = np.asarray(around[4][good], dtype=np.float64)
    sigma = SIGMA + SIGMA_AT_1M * depth**2 + SPEED * abs(gap)
    return DepthPoints(np.stack([u[good], v[good]], axis=1).astype(np.float64), depth, sigma)
