"""A camera's calibration from pictures of a checkerboard, by OpenCV, and how far it can be trusted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.targets.kinds import Board
from collabslam.targets.printed import any_board, board_corners
from collabslam.types import Array, Image

MOST_LOOKED_AT = 150
"""Pictures of a recording in which the board is looked for, spread over it."""
MOST_USED = 30
"""Views that are fitted: those that differ most."""
LEAST_USED = 8
_SURE_OF_NONE = 20
"""Pictures spread over a recording, none with the board in it, after which another board is looked for."""
_OUTLIER = 2.5  # a view that fits so much worse than the median is left out
_FLAGS = cv2.CALIB_FIX_K3
GOOD_RMS, GOOD_FOCAL, GOOD_COVER = 0.5, 0.005, 0.5
"""What a good calibration has: pixels at most, standard deviation of the focal length at most, share of the
image that the boards cover at least."""


@dataclass(frozen=True)
class Calibration:
    """A camera as fitted.

    Attributes
    ----------
    camera : Camera
    used, seen, looked_at : int
        Views fitted, pictures that show the board whole, pictures that were looked at.
    rms : float
        Of the corners about where the fit has them, pixels.
    focal_sd : float
        Standard deviation of the focal length, as a share of it.
    halves : float
        Share by which the focal lengths of two halves of the views differ.
    covered : float
        Share of the image's area within the outline of all corners.
    """

    camera: Camera
    used: int
    seen: int
    looked_at: int
    rms: float
    focal_sd: float
    halves: float
    covered: float

    def faults(self) -> list[str]:
        """What is wrong with it, and what helps; none if it is good."""
        out = []
        if self.rms > GOOD_RMS:
            out.append("the corners scatter: hold the board still and flat, in good light, or lock the focus")
        if max(self.focal_sd, self.halves / 2.0) > GOOD_FOCAL:
            out.append("the focal length is not sure: tilt the board more, up to 45 degrees, and come nearer")
        if self.covered < GOOD_COVER:
            out.append("much of the image never shows the board: move it into the corners as well")
        return out


def calibrate_camera(
    count: int,
    read: Callable[[int], Image],
    board: Board,
    progress: Callable[[int], None] = lambda seen: None,
) -> Calibration:
    """The camera that took pictures of a board.

    Parameters
    ----------
    count : int
        How many pictures there are.
    read : callable
        The (H, W) uint8 picture of a number, all of one size.
    board : Board
    progress : callable
        Is told after each picture in how many the board was.

    Raises
    ------
    DataError
        If fewer than `LEAST_USED` pictures show the board whole, sizes differ, or nothing fits them.
    """
    wanted = np.unique(np.linspace(0, count - 1, min(count, MOST_LOOKED_AT)).round().astype(int)).tolist()
    corners, size = _find(wanted, read, board, progress)
    views = [corners[k] for k in _diverse(np.asarray(corners), MOST_USED)]
    fit = _fit(views, size, board)
    kept = [
        v for v, error in zip(views, fit.errors, strict=True) if error <= _OUTLIER * np.median(fit.errors)
    ]
    if LEAST_USED <= len(kept) < len(views):
        views, fit = kept, _fit(kept, size, board)
    halves = [_fit(views[k::2], size, board).k[0, 0] for k in (0, 1)]
    outline = cv2.convexHull(np.concatenate(corners).astype(np.float32))
    k, height, width = fit.k, *size
    try:
        camera = Camera(
            "radtan", width, height, (k[0, 0], k[1, 1], k[0, 2], k[1, 2]), fit.distortion.tolist()
        )
    except ValueError as error:
        raise DataError(
            f"No camera fits the pictures ({error}); take others, with the board tilted."
        ) from error
    return Calibration(
        camera=camera,
        used=len(views),
        seen=len(corners),
        looked_at=len(wanted),
        rms=fit.rms,
        focal_sd=fit.focal_sd,
        halves=abs(halves[0] - halves[1]) / k[0, 0],
        covered=float(cv2.contourArea(outline)) / (width * height),
    )


def _find(
    wanted: list[int], read: Callable[[int], Image], board: Board, progress: Callable[[int], None]
) -> tuple[list[Array], tuple[int, ...]]:
    """Corners of the board in the pictures that show it, in their order, and the size of the pictures.

    The pictures are looked at in several rounds over the recording, so that a board of another size is told
    before all have been.
    """
    step = max(1, len(wanted) // _SURE_OF_NONE)
    found: dict[int, Array] = {}
    size: tuple[int, ...] | None = None
    others: Counter[tuple[int, int]] = Counter()
    for done, i in enumerate((i for first in range(step) for i in wanted[first::step]), start=1):
        image = read(i)
        if size is not None and image.shape != size:
            raise DataError(
                f"The pictures are of different sizes, {size} and {image.shape}; give one camera's."
            )
        size = image.shape
        corners = board_corners(image, board)
        if corners is not None:
            found[i] = corners
        elif not found and done <= _SURE_OF_NONE and (other := any_board(image)) is not None:
            others[other] += 1
        progress(len(found))
        if done == min(_SURE_OF_NONE, len(wanted)) and not found:
            _check_other(board, done, others)
    if size is None or len(found) < LEAST_USED:
        raise DataError(
            f"Only {len(found)} of {len(wanted)} pictures show a board of {board.columns} x {board.rows} "
            f"inner corners whole, {LEAST_USED} are needed; count the inner corners, show all of the board."
        )
    return [found[i] for i in sorted(found)], size


def _check_other(board: Board, looked_at: int, others: Counter[tuple[int, int]]) -> None:
    """Raises DataError if it is another board that the pictures show; a part of one has any size."""
    (columns, rows), times = others.most_common(1)[0] if others else ((0, 0), 0)
    if times >= 3 and times > 0.5 * others.total():
        size = f"{columns}x{rows}"
        raise DataError(
            f"None of {looked_at} pictures shows a board of {board.columns} x {board.rows} inner corners, "
            f"but a {size} board is in view in {times}; give --board {size}:{board.square:g}."
        )


@dataclass(frozen=True)
class _Fit:
    """``k`` (3, 3), ``distortion`` (4,), ``rms`` px, relative ``focal_sd``, ``errors`` (N,) px of views."""

    k: Array
    distortion: Array
    rms: float
    focal_sd: float
    errors: Array


def _fit(views: list[Array], size: tuple[int, ...], board: Board) -> _Fit:
    points = [board.corners().astype(np.float32)] * len(views)
    pixels = [v.astype(np.float32).reshape(-1, 1, 2) for v in views]
    try:
        rms, k, distortion, _, _, spread, _, errors = cv2.calibrateCameraExtended(
            points, pixels, (size[1], size[0]), np.eye(3), np.zeros(5), flags=_FLAGS
        )
    except cv2.error as error:
        raise DataError("No camera fits the pictures; take others, with the board tilted.") from error
    focal_sd = float(np.ravel(spread)[0]) / float(k[0, 0])
    if not (np.isfinite([rms, focal_sd]).all() and np.isfinite(k).all()):
        raise DataError("No camera fits the pictures; take others, with the board tilted.")
    lens = np.asarray(distortion, np.float64).ravel()[:4]
    return _Fit(np.asarray(k, np.float64), lens, float(rms), focal_sd, np.asarray(errors, np.float64).ravel())


def _diverse(views: Array, most: int) -> list[int]:
    """Views (N, K, 2) that differ most in where their corners are, in order; all of them if they are few."""
    chosen = [0]
    distance = np.full(len(views), np.inf)
    while len(chosen) < min(most, len(views)):
        distance = np.minimum(distance, np.linalg.norm(views - views[chosen[-1]], axis=2).mean(axis=1))
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance)))
    return sorted(chosen)
