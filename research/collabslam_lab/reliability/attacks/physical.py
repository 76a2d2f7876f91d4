"""Lies of the world: what sensors, lenses and trackers do while a recording goes on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np

from collabslam.geometry import se3_exp
from collabslam.types import Array, Frame, Image, Recording, WornView
from collabslam_lab.reliability.faults import FaultyRecording, Rng

Make = Callable[[Recording, Rng], Recording]


def _views(change: Callable[[int, WornView], WornView]) -> Make:
    """Views of Cf, changed by the number of their frame."""

    def of_frame(i: int, frame: Frame) -> Frame:
        return dataclasses.replace(frame, views=tuple(change(i, view) for view in frame.views))

    return lambda recording, _: FaultyRecording(recording, change=of_frame)


def _images(change: Callable[[int, Image], Image]) -> Make:
    """Images of Cs, changed by their number."""

    def of_frame(i: int, frame: Frame) -> Frame:
        return dataclasses.replace(frame, image=change(i, frame.image))

    return lambda recording, _: FaultyRecording(recording, change=of_frame)


def _sure(variance: float) -> Make:
    return _views(lambda _, view: dataclasses.replace(view, covariance=variance * np.eye(6)))


def longer(factor: Callable[[int], float]) -> Make:
    """T_CF as many times as long as the number of its frame says."""

    def change(i: int, view: WornView) -> WornView:
        t_cf: Array = view.t_cf.copy()
        t_cf[:3, 3] *= factor(i)
        return dataclasses.replace(view, t_cf=t_cf)

    return _views(change)


def _turning(degrees: float) -> Make:
    """T_CF turned by so much more in each frame, as by an AHRS whose gyroscope is biased."""

    def change(i: int, view: WornView) -> WornView:
        turn = se3_exp([0.0, 0.0, 0.0, 0.0, np.deg2rad(degrees) * i, 0.0])
        return dataclasses.replace(view, t_cf=view.t_cf @ turn)

    return _views(change)


def untold(make: Make) -> Make:
    """Nothing is said of what lasts of T_CF's error, so that most of it does (``filter.worn.bias_share``)."""
    silent = _views(lambda _, view: dataclasses.replace(view, bias=None))
    return lambda recording, rng: silent(make(recording, rng), rng)


def _lost(i: int, view: WornView) -> WornView:
    """From the 40th frame on T_CF is of another place: a tracker that begins anew elsewhere."""
    away = se3_exp([0.7, 0.2, 0.3, 0.1, 0.5, 0.0])
    return dataclasses.replace(view, t_cf=view.t_cf @ away) if i >= 40 else view


def _stale(recording: Recording, rng: Rng) -> Recording:
    """From the 20th frame on T_CF is the one of before: a tracker that hangs."""
    last = next(recording.frame(i).views[0] for i in range(20, -1, -1) if recording.frame(i).views)
    return _views(lambda i, view: view if i < 20 else dataclasses.replace(view, t_cf=last.t_cf))(
        recording, rng
    )


def _repeated(recording: Recording, _: Rng) -> Recording:
    """Each image three times, as a camera of a third of the rate is read."""

    def change(i: int, frame: Frame) -> Frame:
        return dataclasses.replace(frame, image=recording.image(i - i % 3))

    return FaultyRecording(recording, change=change)


def _warped(i: int, image: Image) -> Image:
    """Rows that slide by up to 10 px either way, other ones in each frame: a lens that rattles."""
    height, width = image.shape
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    slid = u + np.float32(20.0 * np.sin(2.1 * i)) * (v / height - 0.5)
    return np.asarray(cv2.remap(image, slid, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT), np.uint8)


def _breathing(i: int, image: Image) -> Image:
    """An autofocus that hunts: the picture grows and shrinks by 2 %."""
    height, width = image.shape
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), 0.0, 1.0 + 0.02 * np.sin(i / 6.0))
    out = cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REFLECT)
    return np.asarray(out, np.uint8)


def _misted(i: int, image: Image) -> Image:
    """A lens that mists over within nine seconds."""
    clear = max(0.0, 1.0 - i / 90.0)
    return np.asarray(clear * image + (1.0 - clear) * 180.0, np.uint8)


def _swaying(pixels: float, period: float) -> Make:
    """The whole picture moves to and fro, as an optical stabilisation moves the lens."""

    def change(i: int, image: Image) -> Image:
        shift = pixels * np.array([np.sin(2 * np.pi * i / period), np.cos(2 * np.pi * i / (1.3 * period))])
        matrix = np.hstack([np.eye(2), shift[:, None]])
        size = image.shape[1], image.shape[0]
        return np.asarray(cv2.warpAffine(image, matrix, size, borderMode=cv2.BORDER_REFLECT), np.uint8)

    return _images(change)


def _banded(i: int, image: Image) -> Image:
    """Light that flickers, read row by row."""
    rows = np.arange(len(image))[:, None]
    lit = np.clip(image * (1.0 + 0.25 * np.sin(0.05 * rows + 1.7 * i)), 0, 255)
    return np.asarray(lit, np.uint8)


def _dirty(_: int, image: Image) -> Image:
    """Drops on the lens: twelve soft grey blobs that never move."""
    rng, out = np.random.default_rng(3), image.astype(np.float32)
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    for _ in range(12):
        v, u = rng.uniform(0, image.shape)
        weight = np.exp(-((rows - v) ** 2 + (columns - u) ** 2) / (2 * rng.uniform(12, 30) ** 2))
        out += 0.8 * weight * (128.0 - out)
    return np.asarray(np.clip(out, 0, 255), np.uint8)


def _raining(i: int, image: Image) -> Image:
    """Bright streaks elsewhere in each frame."""
    rng = np.random.default_rng(i)
    out: Image = image.copy()
    for _ in range(150):
        u, v = int(rng.integers(image.shape[1])), int(rng.integers(image.shape[0]))
        cv2.line(out, (u, v), (u + 3, v + 18), 220, 1)
    return out


def _smeared(i: int, image: Image) -> Image:
    """Every third frame blurred along its rows, as by a pothole."""
    return image if i % 3 else np.asarray(cv2.blur(image, (21, 1)), np.uint8)


def _hot(_: int, image: Image) -> Image:
    """Two hundred pixels that are always white."""
    out: Image = image.copy()
    out.ravel()[np.random.default_rng(2).integers(0, image.size, 200)] = 255
    return out


PHYSICAL: tuple[tuple[str, str, Make], ...] = (
    ("t-cf-placeholder", "T_CF whose covariance is a placeholder of 1e-9", _sure(1e-9)),
    ("t-cf-exact", "T_CF whose covariance is 1e-14", _sure(1e-14)),
    ("t-cf-scale-jump", "T_CF 30 % longer from the 40th frame on", longer(lambda i: 1.3 if i >= 40 else 1.0)),
    ("t-cf-scale-step", "T_CF 5 % longer from the 40th frame on", longer(lambda i: 1.05 if i >= 40 else 1.0)),
    ("t-cf-scale-creep", "T_CF longer by 0.1 % a frame", longer(lambda i: 1.001**i)),
    ("t-cf-scale-fall", "T_CF shorter by 0.3 % a frame", longer(lambda i: 0.997**i)),
    ("t-cf-untold-step", "T_CF 5 % longer at once, nothing said of what lasts",
     untold(longer(lambda i: 1.05 if i >= 40 else 1.0))),
    ("t-cf-untold-creep", "T_CF longer by 0.1 % a frame, nothing said of what lasts",
     untold(longer(lambda i: 1.001**i))),
    ("t-cf-untold-jump", "T_CF 30 % longer at once, nothing said of what lasts",
     untold(longer(lambda i: 1.3 if i >= 40 else 1.0))),
    ("t-cf-lost", "T_CF of another place from the 40th frame on", _views(_lost)),
    ("t-cf-stale", "T_CF that stands still from the 20th frame on", _stale),
    ("t-cf-turning", "T_CF turned by 0.1 degrees more in each frame", _turning(0.1)),
    ("sway-5", "a picture that sways by 5 px", _swaying(5.0, 9.0)),
    ("sway-10", "a picture that sways by 10 px", _swaying(10.0, 14.0)),
    ("sway-15", "a picture that sways by 15 px", _swaying(15.0, 23.0)),
    ("rattle", "rows that slide by up to 10 px, other ones in each frame", _images(_warped)),
    ("hunting", "an autofocus that hunts: 2 % larger and smaller", _images(_breathing)),
    ("mist", "a lens that mists over", _images(_misted)),
    ("thrice", "each image three times", _repeated),
    ("mirrored-late", "mirrored images from the 40th frame on",
     _images(lambda i, image: np.ascontiguousarray(image[:, ::-1]) if i >= 40 else image)),
    ("banding", "light that flickers by 25 %, read row by row", _images(_banded)),
    ("drops", "twelve drops on the lens", _images(_dirty)),
    ("rain", "rain: 150 bright streaks, elsewhere in each frame", _images(_raining)),
    ("potholes", "every third frame blurred over 21 px", _images(_smeared)),
    ("hot-pixels", "two hundred pixels that are always white", _images(_hot)),
)  # fmt: skip
