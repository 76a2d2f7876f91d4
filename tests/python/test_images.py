"""Images of any camera become grey ones, or are refused with the line that converts them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import InputError, Slam, to_grey
from collabslam.types import Image


@pytest.fixture(scope="module")
def grey() -> Image:
    return np.random.default_rng(0).integers(0, 256, (12, 17)).astype(np.uint8)


def test_what_is_grey_stays_as_it_is(grey: Image) -> None:
    assert to_grey(grey) is grey
    by_column = to_grey(np.asfortranarray(grey))
    assert by_column.flags.c_contiguous
    np.testing.assert_array_equal(by_column, grey)
    np.testing.assert_array_equal(to_grey(grey[:, :, None]), grey)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_16_bits_keep_their_brightness(grey: Image, bits: int) -> None:
    deep = (grey * (((1 << bits) - 1) / 255.0)).round().astype(np.uint16)
    np.testing.assert_array_equal(to_grey(deep, bits=bits), grey)
    np.testing.assert_array_equal(to_grey(deep.astype(">u2"), bits=bits), grey)  # as PNM files have it
    dark = deep // 4  # no image is stretched to its own range
    assert to_grey(dark, bits=bits).max() <= 64


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_floats_are_from_0_to_1(grey: Image, kind: Any) -> None:
    np.testing.assert_array_equal(to_grey((grey / 255.0).astype(kind)), grey)


@pytest.mark.parametrize("channels", [3, 4])
def test_colours_are_weighted_as_opencv_does(channels: int) -> None:
    colour = np.random.default_rng(1).integers(0, 256, (9, 11, channels)).astype(np.uint8)
    rgb = np.ascontiguousarray(colour[..., :3])
    np.testing.assert_array_equal(to_grey(colour), cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
    np.testing.assert_array_equal(to_grey(colour, order="bgr"), cv2.cvtColor(rgb, cv2.COLOR_BGR2GRAY))
    near = to_grey(colour.astype(np.float64) / 255.0)
    np.testing.assert_array_equal(near, to_grey(colour))


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.zeros((4, 5), np.uint16), {}, "bits=12"),
        (np.zeros((4, 5), ">u2"), {}, "bits=12"),
        (np.zeros((4, 5), np.uint16), {"bits": 20}, "8 to 16"),
        (np.zeros((4, 5), np.uint16), {"bits": "12"}, "8 to 16"),
        (np.full((4, 5), 5000, np.uint16), {"bits": 12}, "more than 12 bits"),
        (np.zeros((4, 5), np.uint8), {"bits": 12}, "leave bits out"),
        (np.full((4, 5), 255.0), {}, "from 0 to 1"),
        (np.full((4, 5), -0.1), {}, "from 0 to 1"),
        (np.full((4, 5), np.nan), {}, "from 0 to 1"),
        (np.zeros((4, 5), np.int32), {}, "int32"),
        (np.zeros((4, 5), bool), {}, "bool"),
        (np.zeros((4, 5, 2), np.uint8), {}, "shape"),
        (np.zeros(20, np.uint8), {}, "shape"),
        (np.zeros((0, 5), np.uint8), {}, "shape"),
        (np.zeros((4, 5, 3), np.uint8), {"order": "yuv"}, "rgb, bgr"),
    ],
)
def test_what_cannot_be_told_is_refused(image: Any, options: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        to_grey(image, **options)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda i: np.dstack([i, i, i]), r"collabslam\.to_grey\(image\)"),
        (lambda i: i[:, :, None], r"collabslam\.to_grey\(image\)"),
        (lambda i: i.astype(np.uint16), r"collabslam\.to_grey\(image, bits=12\)"),
        (lambda i: i / 255.0, r"collabslam\.to_grey\(image\)"),
    ],
)
def test_a_step_shows_the_line_that_converts_an_image(clip: Clip, change: Any, line: str) -> None:
    slam = Slam(clip.recording.camera, start="scale-free")
    frame = clip.frames[0]
    with pytest.raises(InputError, match=line):
        slam.step(frame.t, change(frame.image))
    options = {"bits": 8} if change(frame.image).dtype == np.uint16 else {}
    assert slam.step(frame.t, to_grey(change(frame.image), **options)).diagnostics["unseen"] == 0


def test_a_driver_may_write_its_next_image_over_the_last(clip: Clip) -> None:
    from collabslam import Camera

    camera = Camera("pinhole", 360, 240, (300.0, 300.0, 179.5, 119.5))
    images = [np.ascontiguousarray(f.image[::2, ::2]) for f in clip.frames[:5]]
    buffer = images[0].copy()
    own, shared = (Slam(camera, start="scale-free") for _ in range(2))
    for k, image in enumerate(images):
        buffer[:] = image
        a, b = own.step(0.1 * k, image), shared.step(0.1 * k, buffer)
    assert a.started
    assert a.pose.tobytes() == b.pose.tobytes()
    assert a.covariance.tobytes() == b.covariance.tobytes()
