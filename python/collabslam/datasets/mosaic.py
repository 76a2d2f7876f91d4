"""Whether grey pictures are Bayer mosaics that do not say so, as raw pictures of many cameras are."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

LOOKED_AT = 8
"""Pictures of a recording that are looked at, or of a stream's beginning."""
_ROUGHER = 1.25
"""Times by which neighbours in a mosaic differ more than pixels two apart, along rows and columns.

In a picture pixels two apart differ more than neighbours, so it has less than 1; noise alone has 1.
"""
_LEAST = 1.0
"""Grey levels by which neighbours differ at least: a picture that is blank tells nothing."""
MOSAIC_TOLD = "a Bayer mosaic, by how neighbours differ; made grey as such"
_GREEN_FIRST, _GREEN_SECOND = cv2.COLOR_BayerGB2GRAY, cv2.COLOR_BayerBG2GRAY
"""Of grbg and gbrg, whose first pixel is green, and of rggb and bggr; in grey each is nearly the other."""


def mosaic_of(pictures: Iterable[np.ndarray]) -> int | None:
    """OpenCV's conversion to grey of the mosaic that most of the pictures are; None if they are none.

    Parameters
    ----------
    pictures : iterable of (H, W) arrays
        Those that are blank tell nothing.
    """
    seen = RunningMosaic()
    for picture in pictures:
        seen.of(picture)
    return seen.conversion


class RunningMosaic:
    """What most of the first `LOOKED_AT` pictures of a stream that are not blank are, as far as it has come.

    Attributes
    ----------
    conversion : int or None
        OpenCV's, to grey, of the mosaic that they are; None if they are none.
    """

    def __init__(self) -> None:
        self._green_first: list[bool | None] = []
        self.conversion: int | None = None

    @property
    def asks(self) -> bool:
        """Whether more pictures can change it."""
        return len(self._green_first) < LOOKED_AT

    def of(self, picture: np.ndarray | None) -> int | None:
        """``conversion`` after one more picture, (H, W); None for one that says what it is."""
        if picture is None or not self.asks or _is_blank(picture):
            return self.conversion
        self._green_first.append(_green_is_first(picture))
        first = [green for green in self._green_first if green is not None]
        if 2 * len(first) <= len(self._green_first):
            self.conversion = None
        else:
            self.conversion = _GREEN_FIRST if 2 * sum(first) > len(first) else _GREEN_SECOND
        return self.conversion


def _is_blank(picture: np.ndarray) -> bool:
    """Whether neighbours hardly differ."""
    values = picture.astype(np.float32)
    return all(x.shape[1] < 2 or float(np.abs(np.diff(x)).mean()) < _LEAST for x in (values, values.T))


def _green_is_first(picture: np.ndarray) -> bool | None:
    """Whether the first pixel of a mosaic is a green one; None of any other picture."""
    values = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2].astype(np.float32)
    if min(values.shape) < 4:
        return None
    for along in (values, values.T):
        near, far = (float(np.abs(along[:, k:] - along[:, :-k]).mean()) for k in (1, 2))
        if near <= _ROUGHER * far:
            return None
    main = np.abs(values[::2, ::2] - values[1::2, 1::2]).mean()
    other = np.abs(values[::2, 1::2] - values[1::2, ::2]).mean()
    return bool(main < other)
