"""A recording in which printed targets hang: painted into its images by ray casting."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from helpers.clip import Clip

from collabslam import Board, Camera, Frame, Tag, WornView
from collabslam.datasets.wrapped import FirstFrames, WrappedRecording
from collabslam.geometry import pose, pose_inverse, rotation_exp
from collabslam.targets.kinds import FAMILIES
from collabslam.types import Array, Image, Recording

CELLS = 40
"""Pixels of a cell of the texture."""


@lru_cache(maxsize=8)
def sheet(target: Tag | Board) -> tuple[Image, float, Array]:
    """Texture with a white margin, pixels a metre, and its pixel where the target's frame begins."""
    if isinstance(target, Tag):
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[target.family]))
        cells = markers.markerSize + 2
        black = cv2.aruco.generateImageMarker(markers, target.number, cells * CELLS)
        per_metre = cells * CELLS / target.side
        middle = np.array(black.shape[::-1]) / 2.0 + CELLS
    else:
        squares = (1 + np.indices((target.rows + 1, target.columns + 1)).sum(axis=0)) % 2 * 255
        black = np.kron(squares, np.ones((CELLS, CELLS))).astype(np.uint8)
        per_metre = CELLS / target.square
        middle = np.array([2.0 * CELLS, 2.0 * CELLS])
    paper = cv2.copyMakeBorder(black, CELLS, CELLS, CELLS, CELLS, cv2.BORDER_CONSTANT, value=255)
    return paper, per_metre, middle - 0.5


def paint(image: Image, camera: Camera, t_wc: Array, target: Tag | Board, t_wt: Array) -> Image:
    """The image with the target at T_WT, each pixel the mean of nine rays, softened as a lens does."""
    paper, per_metre, origin = sheet(target)
    t_tc = pose_inverse(t_wt) @ t_wc
    window = _window(camera, t_tc, paper, per_metre, origin)
    if window is None:
        return image
    far = float(np.linalg.norm(t_tc[:3, 3]))
    blurred = cv2.GaussianBlur(paper, (0, 0), max(0.3, 0.35 * per_metre * far / camera.intrinsics[0]))
    rows, columns = window
    v, u = np.mgrid[rows, columns].astype(np.float64)
    total, weight = np.zeros(u.shape), np.zeros(u.shape)
    for du in (-1 / 3, 0.0, 1 / 3):
        for dv in (-1 / 3, 0.0, 1 / 3):
            rays = camera.unproject(np.stack([u.ravel() + du, v.ravel() + dv], axis=1)) @ t_tc[:3, :3].T
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = -t_tc[2, 3] / rays[:, 2]
                at = (t_tc[:2, 3] + rays[:, :2] * reach[:, None]) * per_metre + origin
            at = np.where((reach > 0.0)[:, None], at, -1e4).reshape(*u.shape, 2).astype(np.float32)
            colour = cv2.remap(blurred, at, None, cv2.INTER_LINEAR, borderValue=0)
            inside = cv2.remap(np.full_like(paper, 255), at, None, cv2.INTER_LINEAR, borderValue=0) / 255.0
            total += colour * (inside > 0.99)
            weight += inside > 0.99
    share = weight / 9.0
    lit = 25.0 + 0.75 * total / np.maximum(weight, 1.0)
    out = image.copy()
    out[rows, columns] = np.clip(out[rows, columns] * (1.0 - share) + lit * share + 0.5, 0, 255)
    return out


def _window(
    camera: Camera, t_tc: Array, paper: Image, per_metre: float, origin: Array
) -> tuple[slice, slice] | None:
    """Rows and columns of the image that the sheet may cover; None where it is not in view."""
    edge = np.array(
        [[x, y] for x in np.linspace(0, paper.shape[1], 9) for y in np.linspace(0, paper.shape[0], 9)]
    )
    points = np.column_stack([(edge - origin) / per_metre, np.zeros(len(edge))])
    seen = (points - t_tc[:3, 3]) @ t_tc[:3, :3]
    if (seen[:, 2] < 0.05).any():
        return None
    uv = camera.project(seen).uv
    (left, top), (right, bottom) = uv.min(axis=0).astype(int) - 3, uv.max(axis=0).astype(int) + 4
    left, top = max(left, 0), max(top, 0)
    right, bottom = min(right, camera.width), min(bottom, camera.height)
    return (slice(top, bottom), slice(left, right)) if left < right and top < bottom else None


class Posted(WrappedRecording):
    """A rendered recording with targets at T_WT in its world; of the worn camera where its pose is known.

    Parameters
    ----------
    base : Recording
    posts : list of (target, T_WT)
    alone : bool
        Without the worn camera.
    """

    def __init__(
        self, base: Recording, posts: list[tuple[Tag | Board, Array]], *, alone: bool = False
    ) -> None:
        super().__init__(base)
        self._posts, self._alone = posts, alone
        self._frame = lru_cache(maxsize=256)(self._made)
        if alone:
            self.worn_camera = None

    def image(self, i: int) -> Image:
        return self.frame(i).image

    def frame(self, i: int) -> Frame:
        return self._frame(i)

    def _made(self, i: int) -> Frame:
        frame = self._base.frame(i)
        t_wc = self._base.truth[i]  # type: ignore[index]
        image = frame.image
        for target, t_wt in self._posts:
            image = paint(image, self.camera, t_wc, target, t_wt)
        views = []
        for view in () if self._alone else frame.views:
            picture, t_wf = view.image, t_wc @ self._base.true_t_cf(i)  # type: ignore[attr-defined]
            for target, t_wt in self._posts:
                picture = paint(picture, self.worn_camera, t_wf, target, t_wt)  # type: ignore[arg-type]
            views.append(WornView(picture, view.t_cf, view.covariance))
        return Frame(i, frame.t, image, tuple(views))


TAG = Tag("36h11", 3, 0.16)
AHEAD = pose(rotation_exp([0.1, 0.5, 0.05]), [0.15, 0.0, 2.3])
"""A target beside the corridor's way, seen from where Cs starts, in view for the first seconds."""


def walk_past(clip: Clip, target: Tag | Board, frames: int, *, alone: bool = True) -> FirstFrames:
    """The first frames of the demo with a target ahead."""
    recording = clip.recording
    return FirstFrames(Posted(recording, [(target, recording.truth[0] @ AHEAD)], alone=alone), frames)
