"""A view's image as the filter takes it, whatever a sender calls one."""

from __future__ import annotations

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.image_header import read_header
from collabslam.datasets.images import decode
from collabslam.errors import DataError
from collabslam.images import check_grey
from collabslam.types import Image

PASSES = 16
"""Over the picture of a view, at most; a progressive JPEG has about ten."""
SMALLEST = 8
"""Of the calibration's width and height, the least share of them that an image may have is one eighth."""


def view_image(image: Image | bytes, camera: Camera) -> Image:
    """The (H, W) uint8 image of a view, in its calibration's size.

    Senders scale images down to save bandwidth; the image is scaled up again, so that one calibration holds
    for all sizes.  An image that states another size is refused before it is decoded.

    Raises
    ------
    DataError
        If it is not an image, or not the calibration's, scaled.
    InputError
        For an array of another type or size.
    """
    if not isinstance(image, bytes):
        return check_grey(image, camera, "worn image")
    header = read_header(image)
    if header is None or header.kind not in ("JPEG", "PNG") or header.passes > PASSES:
        raise DataError(f"The view is not a whole JPEG of at most {PASSES} scans, and not a whole PNG.")
    if not _scaled(header.width, header.height, camera):
        raise DataError("The view is not an image of the calibration's size, or of a smaller one.")
    grey = decode(image, "of a view")
    if grey.shape == (camera.height, camera.width):
        return grey
    size = (camera.width, camera.height)
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def _scaled(width: int, height: int, camera: Camera) -> bool:
    """Whether a size is the camera's, or scaled down from it to whole pixels."""
    scale = width / camera.width
    return 1.0 / SMALLEST <= scale <= 1.0 and abs(height - scale * camera.height) <= 1.0 and height > 0
