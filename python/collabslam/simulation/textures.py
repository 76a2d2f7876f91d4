"""Procedural grey textures of the scenes.

Every function draws one picture (H, W) uint8 from the generator it is given, so a scene is fixed by its seed.
The pictures rest on 1/f noise, whose spectrum is that of natural images, and carry what a corridor carries:
plaster with marks, bricks and tiles that repeat, doors, posters, notice boards, lamps, cardboard, leaves.

Sizes are given in metres and turned into texels at `DENSITY` texels per metre.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]
Shade = npt.NDArray[np.float32]
Rng = np.random.Generator

DENSITY = 320.0
"""Texels per metre."""

_TILE = 1024
_WORDS = (
    "EXIT",
    "ROOM",
    "LAB",
    "ROBOT",
    "NOTICE",
    "STAIRS",
    "2016",
    "MAP",
    "LIFT",
    "PLAN",
    "B-104",
    "OPEN DAY",
    "SAFETY",
    "COFFEE",
    "SEMINAR",
    "VISION",
    "LIBRARY",
    "FIRE",
    "FLOOR 3",
    "A-27",
    "TALK",
    "HALL",
    "MUSIC",
    "LOST CAT",
)
_FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
)


def texels(metres: float) -> int:
    """Number of texels along `metres`, at least one."""
    return max(1, round(metres * DENSITY))


@lru_cache(maxsize=1)
def _noise_tile() -> Shade:
    """A periodic (1024, 1024) tile of 1/f noise, zero mean, unit standard deviation."""
    rng = np.random.Generator(np.random.PCG64(20160275))
    fy, fx = np.fft.fftfreq(_TILE), np.fft.rfftfreq(_TILE)
    f = np.hypot(fy[:, None], fx[None, :])
    f[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((_TILE, _TILE))) / np.maximum(f, 4.0 / _TILE)
    tile = np.fft.irfft2(spectrum, s=(_TILE, _TILE))
    return np.asarray((tile - tile.mean()) / tile.std(), dtype=np.float32)


def grain(rng: Rng, h: int, w: int) -> Shade:
    """1/f noise (h, w), about zero mean and unit standard deviation: a window of one periodic tile."""
    rows = (int(rng.integers(_TILE)) + np.arange(h) * int(rng.choice([-1, 1]))) % _TILE
    cols = (int(rng.integers(_TILE)) + np.arange(w) * int(rng.choice([-1, 1]))) % _TILE
    return np.ascontiguousarray(_noise_tile()[np.ix_(rows, cols)])


def grey(shade: npt.NDArray[Any]) -> Grey:
    """Rounded and limited to 0 .. 255."""
    return np.asarray(np.clip(np.rint(shade), 0, 255), dtype=np.uint8, order="C")


def _marks(rng: Rng, image: Grey, per_m2: float, contrast: float = 35.0) -> None:
    """Scatter small stains, chips and scratches over `image`, in place."""
    h, w = image.shape
    for _ in range(rng.poisson(per_m2 * h * w / DENSITY**2)):
        x, y = int(rng.integers(w)), int(rng.integers(h))
        level = min(max(float(image[y, x]) + rng.normal(0.0, contrast), 0.0), 255.0)
        if rng.random() < 0.75:
            axes = (int(rng.integers(1, 9)), int(rng.integers(1, 6)))
            cv2.ellipse(image, (x, y), axes, float(rng.uniform(0, 180)), 0, 360, level, -1, cv2.LINE_AA)
        else:
            dx, dy = rng.integers(-45, 46, 2)
            cv2.line(image, (x, y), (x + int(dx), y + int(dy)), level, int(rng.integers(1, 4)), cv2.LINE_AA)


def plaster(rng: Rng, width: float, height: float, level: float = 165.0, marks: float = 60.0) -> Grey:
    """Painted plaster of `width` x `height` metres with 1/f mottling and `marks` marks per square metre."""
    h, w = texels(height), texels(width)
    image = grey(level + 9.0 * grain(rng, h, w) + 3.0 * rng.standard_normal((h, w), dtype=np.float32))
    _marks(rng, image, marks)
    return image


def blocks(
    rng: Rng,
    width: float,
    height: float,
    *,
    block: tuple[float, float],
    level: float,
    spread: float,
    bond: bool,
) -> Grey:
    """Repeated blocks (bricks, tiles) of `block` = (width, height) metres; `bond` shifts every other row."""
    h, w = texels(height), texels(width)
    bw, bh = texels(block[0]), texels(block[1])
    y, x = np.arange(h), np.arange(w)
    row = y // bh
    xs = x[None, :] + (row % 2 * (bw // 2) if bond else np.zeros_like(row))[:, None]
    tones = rng.normal(level, spread, (h // bh + 1, w // bw + 2))
    shade = tones[np.broadcast_to(row[:, None], xs.shape), xs // bw]
    shade = shade + 10.0 * grain(rng, h, w)
    joint = (xs % bw < 4) | (y % bh < 4)[:, None]
    image = grey(np.where(joint, 0.55 * level + 6.0 * grain(rng, h, w), shade))
    _marks(rng, image, 40.0)
    return image


def _write(rng: Rng, image: Grey, x: int, y: int, height: int, ink: float, text: str | None = None) -> int:
    """Put one line of text of letter height `height` texels at (x, y); return its width in texels."""
    words = text or str(rng.choice(_WORDS))
    font = int(rng.choice(_FONTS))
    thick = max(1, height // 9)
    scale = cv2.getFontScaleFromHeight(font, height, thick)
    cv2.putText(image, words, (x, y), font, scale, ink, thick, cv2.LINE_AA)
    return int(cv2.getTextSize(words, font, scale, thick)[0][0])


def _shape(rng: Rng, image: Grey, size: int) -> None:
    """Draw one filled shape of about `size` texels somewhere on `image`."""
    h, w = image.shape
    x, y = int(rng.integers(w)), int(rng.integers(h))
    level, kind = float(rng.integers(10, 250)), int(rng.integers(4))
    if kind == 0:
        cv2.circle(image, (x, y), size // 2, level, -1, cv2.LINE_AA)
    elif kind == 1:
        corners = np.array([x, y]) + rng.integers(-size, size + 1, (3, 2))
        cv2.fillConvexPoly(image, corners.astype(np.int32), level, cv2.LINE_AA)
    elif kind == 2:
        box = cv2.boxPoints(((float(x), float(y)), (float(size), 0.6 * size), float(rng.uniform(0, 90))))
        cv2.fillConvexPoly(image, np.rint(box).astype(np.int32), level, cv2.LINE_AA)
    else:
        cv2.ellipse(
            image, (x, y), (size, size // 3), float(rng.uniform(0, 180)), 0, 300, level, max(2, size // 8)
        )


def poster(rng: Rng, width: float, height: float) -> Grey:
    """A poster: border, shapes from large to small, a title and lines of small print."""
    h, w = texels(height), texels(width)
    image = grey(float(rng.integers(60, 220)) + 12.0 * grain(rng, h, w))
    for size in np.geomspace(0.5 * min(h, w), 10, 22):
        _shape(rng, image, int(size))
    band = h // 5
    paper = float(rng.choice([35, 230]))
    image[:band] = grey(paper + 3.0 * grain(rng, band, w))
    _write(rng, image, w // 14, int(0.72 * band), band // 2, 255.0 - paper)
    for k in range(int(rng.integers(2, 6))):
        _write(rng, image, int(rng.integers(w // 2)), h - 8 - 26 * k, 15, float(rng.choice([20, 240])))
    cv2.rectangle(image, (0, 0), (w - 1, h - 1), float(rng.choice([25, 245])), 7)
    return image


def page(rng: Rng, width: float, height: float) -> Grey:
    """A sheet of paper: a heading, ragged lines of print and sometimes a picture."""
    h, w = texels(height), texels(width)
    image = grey(float(rng.integers(195, 245)) + 3.0 * grain(rng, h, w))
    _write(rng, image, 6, 24, 15, 30.0)
    for y in range(36, h - 6, 9):
        image[y : y + 3, 7 : int(rng.uniform(0.5, 0.95) * w)] = int(rng.integers(60, 130))
    if rng.random() < 0.6:
        ph, pw = h // 3, w // 2
        y0, x0 = int(rng.integers(30, h - ph)), int(rng.integers(4, w - pw))
        picture = image[y0 : y0 + ph, x0 : x0 + pw]
        picture[:] = grey(110.0 + 30.0 * grain(rng, ph, pw))
        for size in (30, 22, 14, 10):
            _shape(rng, picture, size)
    return image


def notice_board(rng: Rng, width: float, height: float) -> Grey:
    """A cork board in a frame with sheets pinned to it."""
    h, w = texels(height), texels(width)
    image = grey(115.0 + 14.0 * grain(rng, h, w) + 7.0 * rng.standard_normal((h, w), dtype=np.float32))
    for _ in range(round(14 * width * height)):
        place(
            image,
            page(rng, rng.uniform(0.14, 0.26), rng.uniform(0.18, 0.3)),
            rng.uniform(0, width - 0.26),
            rng.uniform(0, height - 0.3),
        )
    cv2.rectangle(image, (0, 0), (w - 1, h - 1), 60.0, 14)
    return image


def door(rng: Rng, width: float = 0.95, height: float = 2.08) -> Grey:
    """A door in its frame with panels, handle, number plate and sometimes a notice."""
    h, w = texels(height), texels(width)
    level = float(rng.choice([85, 110, 190]))
    rows = np.repeat(grain(rng, 1, w), h, axis=0)
    image = grey(level + 7.0 * rows + 5.0 * grain(rng, h, w))
    for y0, y1 in ((0.08, 0.4), (0.5, 0.93)):
        for x0, x1 in ((0.16, 0.46), (0.54, 0.84)):
            a, b = (int(x0 * w), int(y0 * h)), (int(x1 * w), int(y1 * h))
            cv2.rectangle(image, a, b, level - 35, 5)
            cv2.rectangle(image, (a[0] + 7, a[1] + 7), (b[0] - 7, b[1] - 7), level + 30, 2)
    cv2.rectangle(image, (0, 0), (w - 1, h + 40), float(rng.choice([50, 225])), 2 * texels(0.05))
    cv2.rectangle(image, (int(0.83 * w), int(0.46 * h)), (int(0.89 * w), int(0.55 * h)), 215.0, -1)
    cv2.line(image, (int(0.86 * w), int(0.49 * h)), (int(0.74 * w), int(0.49 * h)), 30.0, 9, cv2.LINE_AA)
    plate = np.full((texels(0.14), texels(0.3)), 235, np.uint8)
    _write(rng, plate, 8, 32, 20, 20.0, f"{rng.choice(list('ABCD'))}-{rng.integers(100, 400)}")
    place(image, plate, 0.3 * width, 0.2)
    if rng.random() < 0.6:
        place(image, page(rng, 0.2, 0.28), rng.uniform(0.2, 0.6) * width, rng.uniform(0.5, 1.0))
    _marks(rng, image, 40.0)
    return image


def cardboard(rng: Rng, width: float, height: float) -> Grey:
    """One face of a cardboard box: tape, a label, print and scuffs, with darker edges."""
    h, w = texels(height), texels(width)
    level = float(rng.integers(120, 215))
    image = grey(level + 7.0 * grain(rng, h, w))
    tape = slice(int(0.42 * w), int(0.58 * w))
    image[:, tape] = grey(image[:, tape] + 30.0)
    _write(rng, image, w // 12, int(0.35 * h), min(h, w) // 7, 35.0)
    _write(rng, image, w // 3, int(0.92 * h), min(h, w) // 10, 35.0)
    place(image, page(rng, 0.12, 0.16), rng.uniform(0.05, 0.7) * width, rng.uniform(0.4, 0.6) * height)
    for size in (30, 22, 16):
        _shape(rng, image, size)
    _marks(rng, image, 90.0)
    cv2.rectangle(image, (0, 0), (w - 1, h - 1), 0.5 * level, 5)
    return image


def leaf(rng: Rng, width: float, height: float) -> Grey:
    """A leaf with its veins, filling the rectangle."""
    h, w = texels(height), texels(width)
    level = float(rng.integers(60, 120))
    image = grey(level + 10.0 * grain(rng, h, w))
    cv2.line(image, (w // 2, 0), (w // 2, h), level + 60, 3, cv2.LINE_AA)
    for y in range(0, h, max(8, h // 6)):
        cv2.line(image, (w // 2, y), (0, y - w // 2), level + 40, 2, cv2.LINE_AA)
        cv2.line(image, (w // 2, y), (w, y - w // 2), level + 40, 2, cv2.LINE_AA)
    return image


def checkerboard(columns: int, rows: int, square: float) -> Grey:
    """A board of so many inner corners, a white margin of half a square about it."""
    side = texels(square)
    y, x = np.mgrid[: (rows + 1) * side, : (columns + 1) * side] // side
    return np.pad(np.where((x + y) % 2 == 0, 25, 230).astype(np.uint8), side // 2, constant_values=230)


def ceiling(rng: Rng, width: float, height: float) -> Grey:
    """Ceiling tiles of 0.65 x 0.5 m with a lamp in the middle."""
    image = blocks(rng, width, height, block=(0.65, 0.5), level=170.0, spread=4.0, bond=False)
    h, w = image.shape
    a, b = (int(0.38 * w), int(0.3 * h)), (int(0.62 * w), int(0.7 * h))
    cv2.rectangle(image, a, b, 245.0, -1)
    for x in np.linspace(a[0], b[0], 5):
        cv2.line(image, (int(x), a[1]), (int(x), b[1]), 150.0, 4)
    return image


def place(image: Grey, patch: Grey, x: float, y: float) -> None:
    """Paste `patch` into `image`, its top left corner at (x, y) metres; what sticks out is cut off."""
    h, w = image.shape
    j, i = max(0, round(x * DENSITY)), max(0, round(y * DENSITY))
    part = patch[: h - i, : w - j]
    if part.size:
        image[i : i + part.shape[0], j : j + part.shape[1]] = part


def faded(image: Grey, contrast: float) -> Grey:
    """With a share ``contrast`` of its differences of brightness, about the mean."""
    if contrast == 1.0:
        return image
    return grey(image.mean() + contrast * (image - image.mean()))


def repeating(image: Grey, block: tuple[float, float], share: float) -> Grey:
    """A texture of blocks of ``block`` metres, its first one mixed into all by ``share``."""
    if share == 0.0:
        return image
    h, w = image.shape
    one = image[: texels(block[1]), : texels(block[0])]
    same = np.tile(one, (h // one.shape[0] + 1, w // one.shape[1] + 1))[:h, :w]
    return grey(image + share * (same - image.astype(np.float32)))
