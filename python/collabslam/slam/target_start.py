"""Start from a known target (METHOD 10), and a check of the pose against it afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import cv2
import numpy as np

from collabslam._core import Camera, DepthMeasurement, Filter
from collabslam.errors import DataError
from collabslam.formats.schema import Check, array, items
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.patch import SIZE, Patch, capture, warp_templates
from collabslam.frontend.search import FOUND, active_search
from collabslam.frontend.target import RADIUS, SIGMA, find_target
from collabslam.geometry import pose_inverse, skew
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.state import PATCH, PersistentState
from collabslam.types import Array, Image, Mask, Target

_PLANE_SD = 0.03  # of the range of a corner that is taken to lie on the target's plane, as a share of it
_ELSEWHERE_SD = 0.5  # of all others, which start at the target's depth, as a share of it


class TargetStart(PersistentState):
    """Known points as first features, with one shared error of the target's pose.

    Parameters
    ----------
    core : Filter
    camera : Camera
    target : Target
    options : FrontendSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {"_points_w": array("<f8", None, 3), "_patches": items(PATCH)}

    def __init__(self, core: Filter, camera: Camera, target: Target, options: FrontendSettings) -> None:
        self._core, self._camera, self._target, self._options = core, camera, target, options
        self._points_w = np.empty((0, 3))
        self._patches: list[Patch] = []

    def start(self, image: Image, count: int) -> ImagePoints:
        """Starts the filter; all features born, the target's points first.

        Where the target is not found nothing is born, and the next frame is tried.
        """
        try:
            fix = find_target(image, self._camera, self._target, self._options.search)
        except DataError:
            return ImagePoints()
        t_ct = pose_inverse(fix.t_tc)
        known = self._target.points[fix.index] @ t_ct[:3, :3].T + t_ct[:3, 3]
        options = self._options
        corners = detect_corners(image, fix.uv, count, options.detect, SIZE)
        on_plane, points = self._on_target_plane(corners, fix.t_tc)
        all_points = np.concatenate([known, points[on_plane]])
        rays = all_points / np.linalg.norm(all_points, axis=1, keepdims=True)
        pixel = (SIGMA / self._camera.intrinsics[0]) ** 2
        ranges2 = (all_points**2).sum(axis=1)
        relative = np.concatenate([np.full(len(known), 1e-4), np.full(on_plane.sum(), _PLANE_SD)])
        outer = rays[:, :, None] * rays[:, None, :]
        noise = ranges2[:, None, None] * (pixel * np.eye(3) + (relative**2)[:, None, None] * outer)
        # p_C = Exp(xi)^-1 p_hat, so d p_C / d(v, w) = [-I, [p_C]x]
        shared = np.stack([np.concatenate([-np.eye(3), skew(p)], axis=1) for p in all_points])
        ids = self._core.start_from_points(all_points, noise, shared, fix.covariance)
        elsewhere = corners[~on_plane]
        depth = np.full(len(elsewhere), known[:, 2].mean())
        none = np.empty(0, np.int64)
        new = np.full(len(elsewhere), -1)
        depths = DepthMeasurement(new, elsewhere, depth, _ELSEWHERE_SD * depth)
        features = self._core.update(none, none, np.empty((0, 2)), depths=depths).depths.born
        born = features >= 0
        self._points_w, self._patches = known, capture(image, fix.uv, np.eye(4))
        uv = np.concatenate([fix.uv, corners[on_plane], elsewhere[born]])
        if options.target.withhold:
            self._core.remove_features(ids[: len(known)])
            ids, uv = ids[len(known) :], uv[len(known) :]
        return ImagePoints(np.concatenate([ids, features[born]]), uv)

    def _on_target_plane(self, uv: Array, t_tc: Array) -> tuple[Mask, Array]:
        """Which corners look at the plane near the target, and where they meet it, in C."""
        directions = self._camera.unproject(uv) @ t_tc[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = -t_tc[2, 3] / directions[:, 2]
        on_plane = t_tc[:3, 3] + directions * scale[:, None]
        outline = self._target.points[:, :2]
        middle = outline.mean(axis=0)
        hull = cv2.convexHull(
            (middle + self._options.target.plane_reach * (outline - middle)).astype(np.float32)
        )
        flat = np.ptp(self._target.points[:, 2]) < 1e-6
        inside = np.array(
            [
                flat and s > 0.0 and cv2.pointPolygonTest(hull, (float(p[0]), float(p[1])), False) >= 0.0
                for p, s in zip(on_plane, scale, strict=True)
            ],
            dtype=np.bool_,
        )
        t_ct = pose_inverse(t_tc)
        return inside, on_plane @ t_ct[:3, :3].T + t_ct[:3, 3]

    def residual(self, image: Image, pose: Array) -> float:
        """Largest distance, px, between a target point as the pose predicts it and as the image shows it.

        NaN where none is visible. The images are searched around the prediction, independently of the filter.
        """
        if not self._patches:
            return float("nan")
        seen = (self._points_w - pose[:3, 3]) @ pose[:3, :3]
        expected = self._camera.project(np.ascontiguousarray(seen))
        uv = expected.uv
        warped = warp_templates(self._camera, self._patches, pose, self._points_w, self._options.patch)
        spread = np.broadcast_to((RADIUS / 3.0) ** 2 * np.eye(2), (len(uv), 2, 2))
        found = active_search(image, warped.templates, uv, spread, None, self._options.search)
        hit = expected.visible & warped.ok & (found.code == FOUND)
        return float(np.linalg.norm(found.uv - uv, axis=1)[hit].max()) if hit.any() else float("nan")
