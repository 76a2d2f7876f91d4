"""Views of a map's landmarks: windows of images, by which a place is recognised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.frontend.patch import Patch, affine_maps
from collabslam.types import Array, Indices


@dataclass(frozen=True)
class MapViews:
    """Landmarks and the views of them, landmark after landmark.

    Attributes
    ----------
    points : (L, 3) float64
        Landmarks in W, metres.
    patches : list of V Patch
    owner : (V,) int64
        Landmark of each view, by its place in the list: increasing, each with at least one view.
    """

    points: Array
    patches: list[Patch]
    owner: Indices

    @classmethod
    def of(cls, points: Array, by_landmark: Sequence[Sequence[Patch]]) -> MapViews:
        """From the views of each landmark."""
        return cls(points, *in_one_list(by_landmark))

    def nearest(self, pose: Array) -> list[Patch]:
        """Each landmark's view that is most like that from ``pose`` (T_WC), in direction and distance."""
        centres = np.stack([p.t_wc[:3, 3] for p in self.patches])
        then, now = self.points[self.owner] - centres, self.points[self.owner] - pose[:3, 3]
        ranges = (
            np.maximum(np.linalg.norm(then, axis=1), 1e-9),
            np.maximum(np.linalg.norm(now, axis=1), 1e-9),
        )
        cosine = np.clip((then * now).sum(axis=1) / (ranges[0] * ranges[1]), -1.0, 1.0)
        unlike = np.arccos(cosine) + np.abs(np.log(ranges[0] / ranges[1]))
        order = np.lexsort((unlike, self.owner))
        first = np.r_[True, self.owner[order][1:] != self.owner[order][:-1]]
        return [self.patches[i] for i in order[first]]


def in_one_list(by_landmark: Sequence[Sequence[Patch]]) -> tuple[list[Patch], Indices]:
    """All views, landmark after landmark, and the landmark (V,) int64 of each, by its place in the list."""
    owner = np.repeat(np.arange(len(by_landmark)), [len(some) for some in by_landmark])
    return [view for some in by_landmark for view in some], owner


def in_other_camera(patches: Sequence[Patch], camera: Camera, other: Camera) -> list[Patch | None]:
    """The patches as another camera would have captured them from the same poses.

    Parameters
    ----------
    patches : sequence of N Patch
        Of one size.
    camera, other : Camera
        The camera that captured them, and the other one.

    Returns
    -------
    list of N Patch or None
        None where the other camera's model does not reach.
    """
    if not patches:
        return []
    side = patches[0].pixels.shape[0]
    middle = (side - 1) / 2.0
    uv_ref = np.stack([patch.uv_ref for patch in patches])
    maps = affine_maps(camera, uv_ref, other, np.eye(4), np.zeros(len(patches)))
    taken: list[Patch | None] = []
    for patch, there, map_, reached in zip(patches, maps.uv, maps.affine, maps.ok, strict=True):
        if not reached:
            taken.append(None)
            continue
        local = patch.uv_ref - np.rint(patch.uv_ref) + middle
        back = np.linalg.inv(map_)
        step = float(np.linalg.norm(back, 2))
        source = patch.pixels if step < 1.3 else cv2.GaussianBlur(patch.pixels, (0, 0), 0.4 * step)
        pixels = cv2.warpAffine(
            source,
            np.column_stack([back, local - back @ np.full(2, middle)]),
            (side, side),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        # Both cameras are upright: what is inside stays a rectangle but for the skew of the lens.
        scale = np.tile(np.diag(map_), 2)
        inside = np.clip(middle + scale * (patch.inside - np.tile(local, 2)), 0.0, side - 1.0)
        taken.append(Patch(np.asarray(pixels, dtype=np.uint8), np.rint(there), patch.t_wc, inside))
    return taken
