"""Which values of a recording's deep images are black and white: one range for all of them.

Cameras store 10 or 12 bits in pixels of 16 and do not say so; thermal ones store counts or temperatures of
which the darkest is far from zero.  All images are taken alike, so that a place keeps its brightness.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from collabslam.types import Image

DEPTHS = (8, 10, 12, 14, 16)
"""Bits that cameras deliver."""
SAMPLED = 64
"""Deep images whose values are looked at, spread over a recording."""
_BRIGHTER = 50
"""One image in so many may lie beyond the range: what one broken pixel costs is one image."""
_PIXELS = 4096
"""Of an image that are looked at for its extent."""
_TAIL = 0.01
"""Share of an image's pixels that may lie beyond its extent, at either end."""


class Extent(NamedTuple):
    """``largest`` value of a deep image, and the ``low`` and ``high`` ones between which most are."""

    largest: int
    low: int
    high: int


class Range(NamedTuple):
    """Values from ``low`` on, and the ``bits`` above it that are used, become 0 to 255."""

    low: int
    bits: int

    def grey(self, image: np.ndarray) -> Image:
        """An image of 8 bits as it is; a deeper one as uint8, black below the range and white above."""
        if image.dtype == np.uint8:
            return np.asarray(image, dtype=np.uint8)
        above = image if self.low == 0 else np.maximum(image, self.low) - np.uint16(self.low)
        return np.asarray(np.minimum(above >> max(self.bits - 8, 0), 255), dtype=np.uint8)

    def holds(self, low: int, high: int) -> bool:
        """Whether both values lie in it."""
        return self.low <= low and high < self.low + (1 << self.bits)

    def __str__(self) -> str:
        return f"{self.bits} bits" + (f" above {self.low}" if self.low else "")


def extent_of(samples: np.ndarray) -> Extent:
    """The extent of a deep image's samples."""
    flat = samples.ravel()
    some = np.sort(flat[:: max(1, flat.size // _PIXELS)])
    if not some.size:
        return Extent(0, 0, 0)
    tail = int(_TAIL * some.size)
    return Extent(int(flat.max()), int(some[tail]), int(some[-1 - tail]))


def common_range(extents: Iterable[Extent]) -> Range:
    """The range of all images but one in `_BRIGHTER`.

    It is the least of `DEPTHS` that holds the largest values.  Where even the darkest pixels have more than
    half of what the brightest have, as in thermal images, it begins below them instead.
    """
    some = [extent for extent in extents if extent.largest]
    if not some:
        return Range(0, depth_of(0))
    spare = len(some) // _BRIGHTER
    largest, high = (
        sorted(column)[-1 - spare] for column in ([e.largest for e in some], [e.high for e in some])
    )
    low = sorted(e.low for e in some)[spare]
    return _within(low, high) if 2 * low > high else Range(0, depth_of(largest))


def _within(low: int, high: int) -> Range:
    """The narrowest range with values between two of them in its middle, and room beside them."""
    bits = max(8, (5 * (high - low) // 4).bit_length())
    return Range(max(0, (low + high) // 2 - (1 << (bits - 1))), bits)


def depth_of(largest: int) -> int:
    """The least of `DEPTHS` that holds a value."""
    return next(bits for bits in DEPTHS if largest >> bits == 0)


class RunningRange:
    """The range of a stream of images, as far as it has come: it changes only when it no longer holds them.

    From the tenth image on the one that lies farthest out does not count, so that a broken pixel costs no
    more than its image.
    """

    _MANY = 10

    def __init__(self) -> None:
        self._count = 0
        self._largest: list[int] = []
        self._low: list[int] = []
        self._high: list[int] = []
        self._range: Range | None = None

    def of(self, extent: Extent) -> Range:
        """The range after one more image."""
        if not extent.largest:
            return self._range or Range(0, depth_of(0))
        self._count += 1
        self._largest = sorted([*self._largest, extent.largest])[-2:]
        self._high = sorted([*self._high, extent.high])[-2:]
        self._low = sorted([*self._low, extent.low])[:2]
        one_out = self._count >= self._MANY
        low, high = self._low[1 if one_out else 0], self._high[0 if one_out else -1]
        if 2 * low <= high:
            self._range = Range(0, depth_of(self._largest[0 if one_out else -1]))
        elif self._range is None or not self._range.low or not self._range.holds(low, high):
            self._range = _within(low, high)
        return self._range
