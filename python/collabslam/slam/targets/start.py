"""Start from a known target (METHOD 10), and a check of the pose against it afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import cv2
import numpy as np

from collabslam._core import Camera, DepthMeasurement, Filter
from collabslam.errors import DataError
from collabslam.formats.schema import Check, array, covariance, instance, items, optional, pose
from collabslam.frontend.detect import Hidden, detect_corners
from collabslam.frontend.patch import SIZE, Patch, capture, warp_templates
from collabslam.frontend.search import FOUND, active_search
from collabslam.geometry import pose_inverse
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.start import Start
from collabslam.slam.state import PATCH
from collabslam.slam.targets.in_map import PrintedTargets, by_pose_error, known_points
from collabslam.slam.targets.patches import RADIUS, SIGMA, find_target
from collabslam.slam.view import View
from collabslam.targets.printed import Sighting
from collabslam.types import Array, Image, Mask, Target

_PLANE_SD = 0.03  # of the range of a corner that is taken to lie on the target's plane, as a share of it
_ELSEWHERE = 1.0, 0.5
"""Depth of all others as a share of the target's, and its sd as a share of that: on a desk, say."""
_BEYOND = 2.0, 1.0
"""The same about a printed target, which is put where it is near: anything from its half to infinity."""
_LEAST_KNOWN = 4
"""Points that tell how the camera moves."""


def _check_target(value: Any, where: str) -> None:
    """A `Target` with a patch of each point."""
    instance(Target, points=array("<f8", None, 3), t_tc=pose, covariance=covariance(6))(value, where)
    items(array("|u1", None, None), len(value.points))(value.patches, f"{where}.patches")


class TargetStart(Start):
    """Known points as first features, with one shared error of the target's pose.

    Parameters
    ----------
    core : Filter
    camera : Camera
    target : Target or None
        None to start from a printed one.
    printed : PrintedTargets
    options : FrontendSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_target": optional(_check_target),
        "_points_w": array("<f8", None, 3),
        "_patches": items(PATCH),
        "_elsewhere": array("<f8", 2),
    }

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        target: Target | None,
        printed: PrintedTargets,
        options: FrontendSettings,
    ) -> None:
        super().__init__("target")
        self._core, self._camera, self._options = core, camera, options
        self._target, self._printed = target, printed
        self._points_w = np.empty((0, 3))
        self._patches: list[Patch] = []
        self._elsewhere = np.zeros(2)  # depth of all others and its sd, metres; zero where they are born

    def begin(self, view: View, born: ImagePoints, count: int) -> MapChange:
        """As `Start.begin`: the features born on the target's plane, its points first.

        Where no target is found nothing is born, and the next frame is tried.
        """
        return MapChange(self._started(view.image, count, view.hidden))

    def _started(self, image: Image, count: int, hidden: Hidden | None) -> ImagePoints:
        seen = self._seen(image)
        if seen is None:
            return ImagePoints()
        known, noise, shared = known_points(seen)
        if seen.target is None:
            noise = self._own_noise(known, 1e-4)
        options = self._options
        corners = detect_corners(image, seen.uv, count, options.detect, SIZE, hidden=hidden)
        on_plane, points = self._on_target_plane(corners, seen)
        flat = points[on_plane]
        ids = self._core.add_points(
            np.concatenate([known, flat]),
            np.concatenate([noise, self._own_noise(flat, _PLANE_SD)]),
            np.concatenate([shared, by_pose_error(flat)]),
            seen.covariance,
        )
        share, sd = _ELSEWHERE if seen.target is None else _BEYOND
        self._elsewhere = share * known[:, 2].mean() * np.array([1.0, sd])
        self._points_w, self._patches = known, capture(image, seen.uv, np.eye(4))
        uv = np.concatenate([seen.uv, corners[on_plane]])
        if options.target.withhold:
            self._core.remove_features(ids[: len(known)])
            ids, uv = ids[len(known) :], uv[len(known) :]
        elif seen.target is not None:
            self._printed.adopt(seen, ids[: len(known)])
        return ImagePoints(ids, uv)

    def others(self, view: View, taken: Array, missing: int, known: int) -> ImagePoints:
        """Features where the view has none, of about the target's depth, once its points told how Cs moves.

        Before that the prediction is that Cs stands still, and there nothing that a pixel moves by is put
        down to a wrong depth: all would be taken for the way that goes with the depths as they are supposed.

        Parameters
        ----------
        view : View
        taken : (N, 2) float64
            Pixels of what there is.
        missing : int
            How many features the view lacks.
        known : int
            Points measured in this frame.
        """
        depth, sd = self._elsewhere
        if depth == 0.0 or known < _LEAST_KNOWN:
            return ImagePoints()
        self._elsewhere = np.zeros(2)
        uv = view.corners.pick(taken, max(0, missing))
        none, new = np.empty(0, np.int64), np.ones(len(uv))
        depths = DepthMeasurement(np.full(len(uv), -1), uv, depth * new, sd * new)
        born = self._core.update(none, none, np.empty((0, 2)), depths=depths).depths.born
        return ImagePoints.born(born, uv)

    def _seen(self, image: Image) -> Sighting | None:
        """The target in this frame; None where it is not found."""
        if self._target is None:
            return self._printed.best()
        try:
            return find_target(image, self._camera, self._target, self._options.search)
        except DataError:
            return None

    def _own_noise(self, points: Array, relative: float) -> Array:
        """(N, 3, 3) covariance of points in C by themselves: a pixel, and a share of their range."""
        rays = points / np.linalg.norm(points, axis=1, keepdims=True)
        pixel = (SIGMA / self._camera.intrinsics[0]) ** 2
        outer = rays[:, :, None] * rays[:, None, :]
        ranges2 = (points**2).sum(axis=1)
        return np.asarray(ranges2[:, None, None] * (pixel * np.eye(3) + relative**2 * outer))

    def _on_target_plane(self, uv: Array, seen: Sighting) -> tuple[Mask, Array]:
        """Which corners look at the plane near the target, and where they meet it, in C."""
        t_tc = seen.t_tc
        directions = self._camera.unproject(uv) @ t_tc[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = -t_tc[2, 3] / directions[:, 2]
        on_plane = t_tc[:3, 3] + directions * scale[:, None]
        outline = seen.points[:, :2]
        middle = outline.mean(axis=0)
        # What is printed is flat; a sheet may stand free.
        reach = self._options.target.plane_reach if seen.target is None else 1.0
        hull = cv2.convexHull((middle + reach * (outline - middle)).astype(np.float32))
        flat = np.ptp(seen.points[:, 2]) < 1e-6
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
