"""Recordings that are wrong throughout or for a while: nothing of them may be OK beside a wrong pose.

The demo's corridor with its truth; every fault of the stream is one of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.geometry import se3_exp
from collabslam.types import Array, Frame, Image, Indices, Recording, WornView
from collabslam_lab.reliability.attacks.attack import HELD_OR_TOLD, READ_OR_REFUSED, Attack
from collabslam_lab.reliability.attacks.physical import PHYSICAL
from collabslam_lab.reliability.attacks.processed import stabilised, zoom
from collabslam_lab.reliability.faults import FAULTS, FaultyRecording, Rng

Make = Callable[[Recording, Rng], Recording]
Show = Callable[[Image, Rng, int], Image]
ANY = (*HELD_OR_TOLD, *READ_OR_REFUSED)


def _shown(cs: Show | None, cf: Show | None = None) -> Make:
    """Other images of Cs, of Cf, or of both; each has its own random numbers."""

    def make(recording: Recording, rng: Rng) -> Recording:
        seed = int(rng.integers(1 << 30))

        def change(i: int, frame: Frame) -> Frame:
            own = np.random.Generator(np.random.PCG64((seed, i)))
            if cs is not None:
                frame = dataclasses.replace(frame, image=cs(frame.image, own, i))
            if cf is not None:
                views = (dataclasses.replace(v, image=cf(v.image, own, i)) for v in frame.views)
                frame = dataclasses.replace(frame, views=tuple(views))
            return frame

        return FaultyRecording(recording, change=change)

    return make


def _measured(change: Callable[[WornView], WornView]) -> Make:
    def of_frame(_: int, frame: Frame) -> Frame:
        return dataclasses.replace(frame, views=tuple(map(change, frame.views)))

    return lambda recording, _: FaultyRecording(recording, change=of_frame)


def _pose(change: Callable[[Array], Array]) -> Make:
    return _measured(lambda worn: dataclasses.replace(worn, t_cf=change(worn.t_cf)))


def _moved(metres: float) -> Make:
    """T_CF off by so much to the side, all of them alike, the stated deviation being a centimetre."""
    sure = np.diag([1e-4] * 3 + [np.deg2rad(0.5) ** 2] * 3)

    def change(worn: WornView) -> WornView:
        t_cf = worn.t_cf.copy()
        t_cf[0, 3] += metres
        return dataclasses.replace(worn, t_cf=t_cf, covariance=sure)

    return _measured(change)


def _scaled(factor: float) -> Callable[[Array], Array]:
    def change(t_cf: Array) -> Array:
        out: Array = t_cf.copy()
        out[:3, 3] *= factor
        return out

    return change


def _unturned(t_cf: Array) -> Array:
    out: Array = t_cf.copy()
    out[:3, :3] = out[:3, :3].T
    return out


def _calibrated(change: Callable[[list[float], list[float]], None], *, both: bool = False) -> Make:
    """Another calibration of Cs, or of both cameras: changes intrinsics and distortion in place."""

    def other(camera: Camera) -> Camera:
        intrinsics, distortion = list(camera.intrinsics), list(camera.distortion)
        change(intrinsics, distortion)
        return Camera(camera.model, camera.width, camera.height, tuple(intrinsics), tuple(distortion))

    def make(recording: Recording, _: Rng) -> Recording:
        wrong = FaultyRecording(recording, camera=other(recording.camera))
        if both and recording.worn_camera is not None:
            wrong.worn_camera = other(recording.worn_camera)
        return wrong

    return make


def _focal(factor: float) -> Callable[[list[float], list[float]], None]:
    def change(intrinsics: list[float], _: list[float]) -> None:
        intrinsics[:2] = [factor * f for f in intrinsics[:2]]

    return change


def _set(which: int, to: Callable[[float], float], *, distortion: bool = False) -> Callable[..., None]:
    def change(intrinsics: list[float], distorted: list[float]) -> None:
        values = distorted if distortion else intrinsics
        values[which] = to(values[which])

    return change


def _patch(share: float, *, speed: float, seed: int = 4) -> Show:
    """A textured patch over a share of the image, which moves by so many pixels a frame."""

    def show(image: Image, _: Rng, i: int) -> Image:
        height, width = image.shape
        size = round(height * share**0.5), round(width * share**0.5)
        coarse = np.random.default_rng(seed).integers(20, 235, (size[0] // 8 + 1, size[1] // 8 + 1))
        cloth = cv2.resize(coarse.astype(np.uint8), size[::-1], interpolation=cv2.INTER_CUBIC)
        room = width - size[1]
        at = abs((round(speed * i) + room) % (2 * room) - room) if speed else room // 2
        top = (height - size[0]) // 2
        out: Image = image.copy()
        out[top : top + size[0], at : at + size[1]] = cloth
        return out

    return show


def _from(first: int, show: Show) -> Show:
    """From a frame on."""
    return lambda image, rng, i: show(image, rng, i) if i >= first else image


def _hood(image: Image, rng: Rng, _: int) -> Image:
    """The robot's own hood over the lower third, with the sensor's noise."""
    height, width = image.shape
    top = height - height // 3
    coarse = np.random.default_rng(5).integers(20, 235, (height // 24 + 1, width // 8 + 1)).astype(np.uint8)
    hood = cv2.resize(coarse, (width, height - top), interpolation=cv2.INTER_CUBIC)
    out: Image = image.copy()
    out[top:] = np.clip(hood + rng.normal(0.0, 2.0, hood.shape), 0, 255)
    return out


def _dark(image: Image, *_: object) -> Image:
    return np.zeros_like(image)


def _noise(image: Image, rng: Rng, _: int) -> Image:
    return rng.integers(0, 256, image.shape).astype(np.uint8)


def _pepper(image: Image, rng: Rng, _: int) -> Image:
    out: Image = image.copy()
    out[rng.random(image.shape) < 0.05] = 255
    return out


def _grainy(image: Image, rng: Rng, _: int) -> Image:
    return np.clip(image + rng.normal(0.0, 40.0, image.shape), 0, 255).astype(np.uint8)


def _blurred(image: Image, *_: object) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 8.0), np.uint8)


def _coarse(image: Image, *_: object) -> Image:
    height, width = image.shape
    small = cv2.resize(image, (width // 8, height // 8), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)


def _dim(image: Image, *_: object) -> Image:
    return (image // 16).astype(np.uint8)


def _two_tones(image: Image, *_: object) -> Image:
    return np.where(image > image.mean(), 255, 0).astype(np.uint8)


def _squeezed(image: Image, *_: object) -> Image:
    """As a phone stores a video whose picture it scaled: the middle nine tenths, at the old size."""
    height, width = image.shape
    part = image[height // 20 : height - height // 20, width // 20 : width - width // 20]
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)


def _rows(pick: Callable[[int, Rng], Indices]) -> Make:
    def make(recording: Recording, rng: Rng) -> Recording:
        order = pick(len(recording), rng)
        return FaultyRecording(recording, rows=order, times=recording.times[: len(order)])

    return make


def _images_only(pick: Callable[[int, Rng], Indices]) -> Make:
    """Images of Cs of other frames; stamps, truth and Cf stay."""

    def make(recording: Recording, rng: Rng) -> Recording:
        order = pick(len(recording), rng)

        def change(i: int, frame: Frame) -> Frame:
            return dataclasses.replace(frame, image=recording.image(int(order[i])))

        return FaultyRecording(recording, change=change)

    return make


def _views_of(shift: int) -> Make:
    """Cf shows what it showed so many frames away."""

    def make(recording: Recording, _: Rng) -> Recording:
        def change(i: int, frame: Frame) -> Frame:
            other = recording.frame((i + shift) % len(recording)).views
            if not frame.views or not other:
                return dataclasses.replace(frame, views=()) if i else frame
            return dataclasses.replace(
                frame, views=(dataclasses.replace(frame.views[0], image=other[0].image),)
            )

        return FaultyRecording(recording, change=change)

    return make


def _swapped(recording: Recording, _: Rng) -> Recording:
    def change(_: int, frame: Frame) -> Frame:
        if not frame.views:
            return frame
        view = dataclasses.replace(frame.views[0], image=frame.image)
        return dataclasses.replace(frame, image=frame.views[0].image, views=(view,))

    return FaultyRecording(recording, change=change)


def _clock(factor: float) -> Make:
    return lambda recording, _: FaultyRecording(recording, times=recording.times * factor)


def _jitter(recording: Recording, rng: Rng) -> Recording:
    return FaultyRecording(recording, times=recording.times + rng.uniform(0.0, 0.09, len(recording)))


def _mirrored(image: Image, *_: object) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


def _upside_down(image: Image, *_: object) -> Image:
    return np.ascontiguousarray(image[::-1, ::-1])


def _negative(image: Image, *_: object) -> Image:
    return (255 - image).astype(np.uint8)


FEET, AXES = 1.0 / 0.3048, se3_exp([0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0])
STREAMS: tuple[tuple[str, str, Make], ...] = (
    ("t-cf-30cm", "T_CF 30 cm to the side throughout, stated to a centimetre", _moved(0.3)),
    ("t-cf-10cm", "T_CF 10 cm to the side throughout, stated to a centimetre", _moved(0.1)),
    ("t-cf-1m", "T_CF 1 m to the side throughout, stated to a centimetre", _moved(1.0)),
    ("t-cf-inverted", "T_CF the wrong way round", _pose(lambda t_cf: np.asarray(np.linalg.inv(t_cf)))),
    ("t-cf-millimetres", "T_CF in millimetres", _pose(_scaled(1000.0))),
    ("t-cf-feet", "T_CF in feet", _pose(_scaled(FEET))),
    ("t-cf-turn", "T_CF with its rotation the wrong way round", _pose(_unturned)),
    ("t-cf-axes", "T_CF about other axes", _pose(lambda t_cf: t_cf @ AXES)),
    ("t-cf-none", "T_CF of two cameras in one place", _pose(lambda t_cf: np.eye(4))),
    ("focal-long", "focal length of Cs 10 % too long", _calibrated(_focal(1.1))),
    ("focal-short", "focal length of Cs 10 % too short", _calibrated(_focal(0.9))),
    ("focal-both", "both focal lengths 10 % too long", _calibrated(_focal(1.1), both=True)),
    ("focal-double", "focal length of Cs twice too long", _calibrated(_focal(2.0))),
    ("aspect", "pixels of Cs 10 % too wide", _calibrated(_set(0, lambda f: 1.1 * f))),
    ("centre", "principal point of Cs 50 px off", _calibrated(_set(2, lambda c: c + 50.0))),
    ("distortion", "distortion of Cs of the wrong sign", _calibrated(_set(0, lambda k: -k, distortion=True))),
    ("scaled", "images of Cs cropped and scaled by 10/9", _shown(_squeezed)),
    ("mirrored", "mirrored images of Cs", _shown(_mirrored)),
    ("mirrored-both", "mirrored images of both cameras", _shown(_mirrored, _mirrored)),
    ("mirrored-cf", "mirrored images of Cf", _shown(None, _mirrored)),
    ("upside-down", "images of Cs upside down", _shown(_upside_down)),
    ("negative", "negatives of Cs", _shown(_negative)),
    ("negative-cf", "negatives of Cf", _shown(None, _negative)),
    ("swapped", "the cameras' images swapped", _swapped),
    ("patch-moving", "a moving patch over 30 % of the image", _shown(_patch(0.3, speed=5.0))),
    ("patch-fast", "a fast patch over 30 % of the image", _shown(_patch(0.3, speed=25.0))),
    ("patch-large", "a moving patch over 60 % of the image", _shown(_patch(0.6, speed=3.0))),
    ("patch-small", "a moving patch over 10 % of the image", _shown(_patch(0.1, speed=5.0))),
    ("patch-still", "a sticker over 30 % of the lens", _shown(_patch(0.3, speed=0.0))),
    ("patch-still-large", "a sticker over 60 % of the lens", _shown(_patch(0.6, speed=0.0))),
    ("patch-still-small", "a sticker over 10 % of the lens", _shown(_patch(0.1, speed=0.0))),
    ("hood", "the robot's own hood in the lower third of the image", _shown(_hood)),
    ("patch-slow", "a slow patch over 30 % of the image", _shown(_patch(0.3, speed=2.0))),
    ("patch-slower", "a patch over 30 % of the image at 1 px a frame", _shown(_patch(0.3, speed=1.0))),
    ("patch-crawling", "a patch over 30 % of the image at 0.5 px a frame", _shown(_patch(0.3, speed=0.5))),
    ("patch-walking", "a patch over 30 % of the image at 3 px a frame", _shown(_patch(0.3, speed=3.0))),
    ("patch-fifth", "a patch over 20 % of the image at 1 px a frame", _shown(_patch(0.2, speed=1.0))),
    ("patch-sixth", "a patch over 15 % of the image at 1 px a frame", _shown(_patch(0.15, speed=1.0))),
    ("put-on-straight", "a sticker over 30 % of the lens, put on before the camera turns",
     _shown(_from(10, _patch(0.3, speed=0.0)))),
    ("put-on-turning", "a sticker over 30 % of the lens, put on while the camera turns",
     _shown(_from(30, _patch(0.3, speed=0.0)))),
    ("put-on-small", "a sticker over 15 % of the lens, put on while the camera turns",
     _shown(_from(30, _patch(0.15, speed=0.0)))),
    ("zoom-creeping", "a camera that zooms by 0.2 % a frame", _shown(zoom(lambda i: 1.0 + 0.002 * i))),
    ("zoom-glide", "a camera that zooms by 20 % within two seconds",
     _shown(zoom(lambda i: 1.0 + 0.2 * min(max((i - 40) / 20.0, 0.0), 1.0)))),
    ("zoom-jump", "a camera that zooms by 15 % at once", _shown(zoom(lambda i: 1.15 if i >= 50 else 1.0))),
    ("stabilised", "images that the camera stabilises and enlarges by 10 %", stabilised(1.1, 10)),
    ("stabilised-whole", "images that the camera stabilises and does not enlarge", stabilised(1.0, 10)),
    ("patch-cf", "a moving patch over 30 % of Cf's image", _shown(None, _patch(0.3, speed=5.0))),
    ("dark", "black images throughout", _shown(_dark, _dark)),
    ("dark-cs", "black images of Cs throughout", _shown(_dark)),
    ("dark-cf", "black images of Cf throughout", _shown(None, _dark)),
    ("noise", "noise in place of images", _shown(_noise, _noise)),
    ("noise-cf", "noise in place of Cf's images", _shown(None, _noise)),
    ("grain", "noise of 40 grey levels on all images", _shown(_grainy, _grainy)),
    ("pepper", "5 % of the pixels white", _shown(_pepper, _pepper)),
    ("blurred", "images out of focus by 8 px", _shown(_blurred, _blurred)),
    ("coarse", "images of 90 x 60 pixels, enlarged", _shown(_coarse, _coarse)),
    ("dim", "16 grey levels in all", _shown(_dim, _dim)),
    ("two-tones", "black and white alone", _shown(_two_tones, _two_tones)),
    ("standing", "one image for all frames", _images_only(lambda n, _: np.zeros(n, np.int64))),
    ("shuffled", "the images of Cs in any order", _images_only(lambda n, rng: rng.permutation(n))),
    ("backwards", "the images of Cs backwards", _images_only(lambda n, _: np.arange(n)[::-1])),
    ("looped", "the first ten frames for ever", _images_only(lambda n, _: np.arange(n) % 10)),
    ("cut", "a jump to another place after half of the way",
     _rows(lambda n, _: np.concatenate([np.arange(n // 3), np.arange(2 * n // 3, n)]))),
    ("cf-elsewhere", "Cf shows another place", _views_of(40)),
    ("cf-second-late", "Cf shows what it saw a second before", _views_of(-10)),
    ("slow-clock", "a clock ten times too slow", _clock(0.1)),
    ("fast-clock", "a clock ten times too fast", _clock(10.0)),
    ("jitter", "stamps off by up to 90 ms", _jitter),
    *PHYSICAL,
    *((fault.name, fault.what, fault.make) for fault in FAULTS if not fault.stops),
)  # fmt: skip
BY_NAME = {name: make for name, _, make in STREAMS}

BEYOND = ("t-cf-feet", "focal-both", "stabilised-whole", "sway-5", "sway-10", "sway-15")
"""What no image tells: `tests/lab/reliability/test_attacks.py` holds the figures."""

ATTACKS = tuple(
    Attack(
        "stream",
        name,
        what,
        lambda scene, name=name: scene.child("stream", name),  # type: ignore[misc]
        ANY,
        beyond=name in BEYOND,
    )
    for name, what, _ in STREAMS
)
