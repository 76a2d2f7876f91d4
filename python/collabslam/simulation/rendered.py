"""What recordings share whose pictures are rendered when they are asked for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Frame, Image, WornView

PIXEL_NOISE = 2.5
"""Standard deviation of the pictures' noise, grey levels, where a sensor has no other."""
NOTHING_LASTS: Array = np.zeros((6, 6))
"""What lasts of T_CF's error: each view has one of its own."""
VIGNETTING = 0.18
"""Share of the light that is lost in the corners."""


@dataclass(frozen=True)
class Sensor:
    """The noise of a camera's pictures.

    Attributes
    ----------
    noise : float
        Standard deviation of what every pixel has whatever the light (reading out, rounding), grey levels.
    electrons : float
        That light sets free in a pixel of level 255. A pixel of level g so has a noise of light of its own,
        sqrt(255 g / electrons) grey levels. The less light and the more gain, the fewer: some 10000 by day,
        some hundreds in a dim corridor; infinite for no such noise.
    """

    noise: float = PIXEL_NOISE
    electrons: float = float("inf")


class RenderedRecording(ABC):
    """A `Recording` of two cameras whose motion is known; the last pictures and frames are kept.

    Parameters
    ----------
    name, source : str
    camera, worn_camera : Camera
    times : (N,) float64
        Time stamps, seconds.
    truth : (N, 4, 4) float64
        T_WC.
    sensor : Sensor, optional
        Of both cameras.

    Attributes
    ----------
    body : bool
        Whether the pictures show who wears Cf (`collabslam.types.WornView`).
    """

    body: ClassVar[bool]

    def __init__(
        self,
        name: str,
        source: str,
        camera: Camera,
        worn_camera: Camera,
        times: Array,
        truth: Array,
        sensor: Sensor | None = None,
    ) -> None:
        self.name, self.source, self.target = name, source, None
        self.camera, self.worn_camera = camera, worn_camera
        self.times, self.truth = times, truth
        self._sensor = sensor or Sensor()
        self._gains = [vignette(camera), vignette(worn_camera)]
        self._robot_image = lru_cache(maxsize=8)(self._take_robot_image)
        self._frame = lru_cache(maxsize=8)(self._take_frame)

    def __len__(self) -> int:
        return len(self.times)

    def image(self, i: int) -> Image:
        """The picture (H, W) uint8 of Cs in frame `i`; raises InputError if there is none such."""
        return self._robot_image(self._check(i))

    def frame(self, i: int) -> Frame:
        """Frame `i`, with Cf's view if there is one then; raises InputError if there is none such."""
        return self._frame(self._check(i))

    def true_t_cf(self, i: int) -> Array:
        """True T_CF (4, 4) of frame `i`, with or without Cf's view. For scoring, never for the filter."""
        i = self._check(i)
        return np.asarray(pose_inverse(self.truth[i]) @ self.person(float(self.times[i])))

    def view(
        self, image: Image, measured: tuple[Array, Array], t: float | None = None, who: str = ""
    ) -> WornView:
        """What Cf gives: a picture, T_CF with its covariance, whose errors do not last, and its own time."""
        return WornView(image, *measured, NOTHING_LASTS, t, who, self.body)

    @abstractmethod
    def person(self, t: float) -> Array:
        """True T_WF (4, 4) at the stamp `t`, seconds."""

    @abstractmethod
    def _take_robot_image(self, i: int) -> Image: ...

    @abstractmethod
    def _take_frame(self, i: int) -> Frame: ...

    def _check(self, i: int) -> int:
        if not 0 <= i < len(self):
            raise InputError(f"There is no frame {i}; this recording has the frames 0 to {len(self) - 1}.")
        return int(i)

    def _sensed(self, clean: Image, which: int, light: float, generator: np.random.Generator) -> Image:
        """What the sensor of Cs (0) or Cf (1) makes of a clean picture: vignetting, exposure, noise."""
        noise = generator.standard_normal(clean.shape, dtype=np.float32)
        lit = clean * (self._gains[which] * np.float32(light))
        sensor = self._sensor
        if np.isfinite(sensor.electrons):
            noise *= np.sqrt(lit * np.float32(255.0 / sensor.electrons) + np.float32(sensor.noise**2))
        else:
            noise *= np.float32(sensor.noise)
        noise += lit
        return np.clip(np.rint(noise, out=noise), 0, 255, out=noise).astype(np.uint8)


def vignette(camera: Camera) -> npt.NDArray[np.float32]:
    """Gain (H, W) that falls with the square of the distance from the principal point."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    r2 = (u - camera.intrinsics[2]) ** 2 + (v - camera.intrinsics[3]) ** 2
    return np.asarray(1.0 - VIGNETTING * r2 / r2.max(), dtype=np.float32)
