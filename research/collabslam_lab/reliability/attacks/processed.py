"""Images that the camera itself has changed before it gives them out: zoomed, or stabilised."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np

from collabslam.types import Array, Frame, Image, Recording
from collabslam_lab.reliability.faults import FaultyRecording, Rng


def zoom(factor: Callable[[int], float]) -> Callable[[Image, Rng, int], Image]:
    """The middle of the image, larger by a factor that depends on the number of the frame."""

    def show(image: Image, _: Rng, i: int) -> Image:
        height, width = image.shape
        by = factor(i)
        about = np.array([[by, 0.0, (1.0 - by) * width / 2], [0.0, by, (1.0 - by) * height / 2]])
        return np.asarray(cv2.warpAffine(image, about, (width, height), borderMode=cv2.BORDER_REPLICATE))

    return show


def stabilised(crop: float, half: int) -> Callable[[Recording, Rng], Recording]:
    """The images of a camera that turns as the mean over so many frames before and after does.

    ``crop`` is by how much they are enlarged, so that no border shows; 1 shows the border.
    """

    def make(recording: Recording, _: Rng) -> Recording:
        truth = recording.truth
        if truth is None:
            raise ValueError("a recording without a truth does not say how the camera turns")
        turns = truth[:, :3, :3]
        fx, fy, cx, cy = recording.camera.intrinsics[:4]
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        larger = np.array([[crop, 0.0, (1.0 - crop) * cx], [0.0, crop, (1.0 - crop) * cy], [0.0, 0.0, 1.0]])

        def change(i: int, frame: Frame) -> Frame:
            calm = _mean(turns[max(0, i - half) : i + half + 1])
            warp = larger @ matrix @ calm.T @ turns[i] @ np.linalg.inv(matrix)
            size = frame.image.shape[::-1]
            image = cv2.warpPerspective(frame.image, warp, size, borderMode=cv2.BORDER_REPLICATE)
            return dataclasses.replace(frame, image=np.asarray(image))

        return FaultyRecording(recording, change=change)

    return make


def _mean(turns: Array) -> Array:
    """The rotation nearest to the mean of some that are alike."""
    u, _, vt = np.linalg.svd(turns.mean(axis=0))
    return np.asarray(u @ vt)
