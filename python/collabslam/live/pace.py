"""How much a worn camera sends: small grey JPEGs, smaller and then fewer when the robot gets them late."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from collabslam.types import Image

OLD, FRESH = 0.150, 0.075
"""Seconds: images that reach the robot older than the first are too much for the link; all is well below the
second."""
PATIENCE, COURAGE = 2, 20
"""Reports of old images running after which less is sent, and of fresh ones after which more is."""


TRIED, JUDGED, WORTH, AGAIN = 10, 40, 0.4, 600
"""Images of which one has to arrive as datagrams; images of which a share has to, and that share; images that
go in order before datagrams are tried once more."""
PROMPT = 1.0
"""Seconds between two reports that follow each other."""


@dataclass(frozen=True)
class Level:
    """Bytes of an image, and images per second."""

    size: int
    rate: float


LEVELS = (Level(10_000, 10.0), Level(7_000, 10.0), Level(5_000, 10.0), Level(5_000, 5.0), Level(5_000, 2.5))
"""From what is sent at first to the least."""
SCALES = (1.0, 0.75, 0.5, 0.375, 0.25)
LOWEST, HIGHEST = 20.0, 90.0
"""JPEG quality; below the first a smaller image shows more."""


class Pace:
    """Chooses size and rate by what the robot reports."""

    def __init__(self) -> None:
        self._level = 0
        self._run = 0
        self._images = 0.0

    @property
    def level(self) -> Level:
        """What is to be sent now."""
        return LEVELS[self._level]

    def report(self, age: float, images: float) -> None:
        """The robot has so many images, and got the last ones so many seconds after they were taken.

        A report without a new image says nothing new.
        """
        if images == self._images:
            return
        self._images = images
        if age > OLD:
            self._run = min(self._run, 0) - 1
        elif age < FRESH:
            self._run = max(self._run, 0) + 1
        else:
            self._run = 0
        if self._run <= -PATIENCE:
            self._level, self._run = min(self._level + 1, len(LEVELS) - 1), 0
        elif self._run >= COURAGE:
            self._level, self._run = max(self._level - 1, 0), 0


class Transport:
    """Whether images go as datagrams or in order; as datagrams while most of them arrive.

    Where ten percent of the packets are lost in bursts, two images of three arrive as datagrams, all at once;
    in order, one in ten waits for half a second.  But a network that lets packets overtake each other loses
    every image of more than one packet, which a few images tell; a share takes more: of ten images that a
    burst hits, few may arrive where most do.
    """

    def __init__(self) -> None:
        self._sent = self._received = 0
        self._reported = -float("inf")
        self._counted = [0, 0]  # sent and received as datagrams
        self._until = 0

    def datagrams(self, sent: int) -> bool:
        """Whether the next image is to go as datagrams, after so many."""
        return sent >= self._until

    def report(self, t: float, sent: int, received: int) -> None:
        """At ``t`` seconds the robot has so many of the images that were sent.

        What was sent while nothing was reported for longer than `PROMPT` says nothing: the link was away.
        """
        prompt = t - self._reported <= PROMPT and received >= self._received
        if prompt and self.datagrams(self._sent):
            self._counted[0] += sent - self._sent
            self._counted[1] += received - self._received
        self._reported, self._sent, self._received = t, sent, received
        tried, arrived = self._counted
        if tried >= JUDGED or (tried >= TRIED and arrived == 0):
            if arrived < WORTH * tried:
                self._until = sent + AGAIN
            self._counted = [0, 0]


class Encoder:
    """Makes JPEGs of about a size: quality first, then scale."""

    def __init__(self) -> None:
        self._quality, self._scale = 50.0, 0

    def encode(self, image: Image, size: int) -> bytes:
        """A (H, W) uint8 grey image as a JPEG of about ``size`` bytes, learned from those before."""
        scale = SCALES[self._scale]
        if scale < 1.0:
            image = np.asarray(
                cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
            )
        data = bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, round(self._quality)])[1])
        self._quality *= (size / len(data)) ** 0.7
        if self._quality < LOWEST and self._scale < len(SCALES) - 1:
            self._scale, self._quality = self._scale + 1, 50.0
        elif self._quality > HIGHEST and self._scale > 0:
            self._scale, self._quality = self._scale - 1, 50.0
        self._quality = min(max(self._quality, LOWEST), HIGHEST)
        return data
