"""The noise of an image sensor: how large it is in an image, and an image with noise of its own."""

from __future__ import annotations

import cv2
import numpy as np

from collabslam.types import Array, Image

LEAST_SD, MOST_SD = 1.0, 2.0
"""Bounds of the noise that is taken to be real, grey levels: compression hides it, texture looks like it."""
_NEIGHBOURS: Array = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float64)
_GAIN = 6.0  # standard deviation of that difference, for noise of standard deviation 1
_MEDIAN = 0.6745  # median of the magnitude of such a number


def noise_sd(image: Image) -> float:
    """Standard deviation of an image's noise, grey levels, from `LEAST_SD` to `MOST_SD`.

    From the median of second differences, which edges and shading hardly touch (Immerkaer, CVIU 1996).
    """
    response = cv2.filter2D(image, cv2.CV_64F, _NEIGHBOURS)[1:-1, 1:-1]
    found = float(np.median(np.abs(response))) / (_MEDIAN * _GAIN) if response.size else 0.0
    return min(max(found, LEAST_SD), MOST_SD)


def exposed_again(image: Image, random: np.random.Generator) -> Image:
    """The image as another exposure of the same view would be.

    What is added has twice the variance of the sensor's noise, so that the two differ as two exposures do,
    of which each has noise of its own.
    """
    noise = np.sqrt(2.0) * noise_sd(image) * random.standard_normal(image.shape)
    again: Image = np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)
    return again
