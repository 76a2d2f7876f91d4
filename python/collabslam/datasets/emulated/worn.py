"""A worn camera made out of other views of the same recording, for data sets that have none.

In a static scene a posed image from another time, or the other camera of a rig, is what a worn camera would
see: ``T_CF(k) = T_WC(k)^-1 T_WF(j)``, with noise drawn from a stated covariance with a stated seed.  The
truth serves this and scoring, never the filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.emulated.pixel_noise import exposed_again
from collabslam.datasets.emulated.pose_noise import RIG_NOISE, SENSOR_NOISE, PoseNoise
from collabslam.datasets.emulated.views import PosedViews, choose_views, load_views
from collabslam.datasets.images import read_grey
from collabslam.datasets.recording import Rig
from collabslam.datasets.wrapped import OnlyPersons, WrappedRecording
from collabslam.errors import DataError, SettingsError
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.types import Array, Frame, Image, Mask, Recording, WornView, worn_cameras

SPECS = "recorded, none, lag:SECONDS, rig, views:FOLDER, recorded:NAME (of several persons)"
_EDGE = 1e-9
_PER_FRAME, _PER_BLOCK, _PIXELS = 0, 1, 2
"""Streams of random numbers of a seed."""


@dataclass(frozen=True)
class _Sample:
    """A view without noise: how to read its image, and its true ``T_CF``."""

    read: Callable[[], Image]
    t_cf: Array


@dataclass(frozen=True)
class PoseErrors:
    """Draws the error of ``T_CF``; each frame (or block) has its own generator, so order does not matter."""

    noise: PoseNoise
    seed: int
    per_block: bool

    def measured(self, t_cf: Array, frame: int, block: int) -> Array:
        """``T_meas`` with ``T_true = T_meas Exp(e)``, e drawn from the covariance."""
        stream = (_PER_BLOCK, block) if self.per_block else (_PER_FRAME, frame)
        generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, *stream])))
        e = self.noise.deviations * generator.standard_normal(6)
        return t_cf @ pose_inverse(se3_exp(e))


@dataclass(frozen=True)
class _Availability:
    """When the worn camera is there, in seconds from the first stamp."""

    share: float
    period: float
    intervals: tuple[tuple[float, float], ...] | None

    def block(self, t: float) -> int | None:
        """Number of the block of availability that holds ``t``, or None."""
        if self.intervals is not None:
            inside = (k for k, (a, b) in enumerate(self.intervals) if a - _EDGE <= t < b - _EDGE)
            return next(inside, None)
        if self.share >= 1.0:
            return 0
        number = int(np.floor((t + _EDGE) / self.period))
        return number if t - number * self.period < self.share * self.period - _EDGE else None


class WornRecording(WrappedRecording):
    """A recording whose frames carry the views of an emulated, or a masked, worn camera."""

    def __init__(
        self,
        base: Recording,
        worn_cameras: dict[str, Camera],
        samples: Mapping[int, _Sample],
        blocks: Sequence[int | None],
        noise: PoseErrors | None,
    ) -> None:
        super().__init__(base)
        self.worn_cameras, self.worn_imu = worn_cameras, {}
        self.masks = replace(self.masks, worn=self._masks(emulated=noise is not None))
        self._samples = samples
        self._blocks = blocks
        self._noise = noise

    def _masks(self, *, emulated: bool) -> dict[str, Mask]:
        """Masks of the worn cameras: their own, or that of Cs where its images are Cf's at another time."""
        if not emulated:
            return {name: mask for name, mask in self.masks.worn.items() if name in self.worn_cameras}
        robot, lags = self.masks.robot, self.worn_cameras[""] is self.camera
        return {"": robot} if lags and robot is not None else {}

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the worn view; the same for each call, in any order."""
        block = self._blocks[i] if 0 <= i < len(self._blocks) else None
        if self._noise is None:
            frame = self._base.frame(i)
            return frame if block is not None else replace(frame, views=())
        views: tuple[WornView, ...] = ()
        if block is not None and i in self._samples:
            sample = self._samples[i]
            t_cf = self._noise.measured(sample.t_cf, i, block)
            views = (WornView(sample.read(), t_cf, self._noise.noise.covariance, body=False),)
        return replace(self._base.frame(i), views=views)


def _parse(spec: str) -> tuple[str, str]:
    kind, colon, value = spec.strip().partition(":")
    with_value = kind in ("lag", "views") or (kind == "recorded" and bool(colon))
    if (
        kind not in ("recorded", "none", "lag", "rig", "views")
        or with_value != bool(colon)
        or with_value != bool(value)
    ):
        raise SettingsError(f"The worn camera '{spec}' is not understood; give one of: {SPECS}.")
    return kind, value


def _truth(recording: Recording, spec: str) -> Array:
    if recording.truth is None:
        raise DataError(
            f"The worn camera '{spec}' needs true poses and {recording.name} has none; give them with "
            "--poses."
        )
    return recording.truth


def _lag_samples(
    recording: Recording, value: str, blocks: Sequence[int | None], seed: int
) -> dict[int, _Sample]:
    """Images of the same recording ``value`` seconds later, nearest by time within half a frame period.

    Cs takes the same images in its turn: fresh noise makes them two exposures of one view.
    """
    try:
        lag = float(value)
    except ValueError:
        lag = 0.0
    if not np.isfinite(lag) or lag == 0.0:
        raise SettingsError(
            f"The worn camera 'lag:{value}' needs a lag in seconds other than zero, such as lag:2.0."
        )
    truth, times = _truth(recording, f"lag:{value}"), recording.times
    half = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    known = np.all(np.isfinite(truth), axis=(1, 2))
    out: dict[int, _Sample] = {}
    for i, block in enumerate(blocks):
        wanted = times[i] + lag
        j = int(np.argmin(np.abs(times - wanted)))
        if block is not None and known[i] and known[j] and j != i and abs(times[j] - wanted) <= half + _EDGE:
            stream = np.random.SeedSequence([seed, _PIXELS, i])
            out[i] = _Sample(partial(_exposed_again, recording, j, stream), pose_inverse(truth[i]) @ truth[j])
    return out


def _exposed_again(recording: Recording, j: int, stream: np.random.SeedSequence) -> Image:
    return exposed_again(recording.image(j), np.random.Generator(np.random.PCG64(stream)))


def _rig_samples(recording: Recording) -> tuple[Camera, dict[int, _Sample]]:
    rig = getattr(recording, "rig", None)
    if not isinstance(rig, Rig) or not rig.paths:
        raise DataError(
            f"The worn camera 'rig' needs the images of a second camera and {recording.name} has none; "
            f"give one of: {SPECS}."
        )
    return rig.camera, {
        i: _Sample(partial(read_grey, path, rig.camera), rig.t_cf) for i, path in rig.paths.items()
    }


def _view_samples(
    recording: Recording, given: str | PosedViews, blocks: Sequence[int | None]
) -> tuple[Camera, dict[int, _Sample]]:
    _truth(recording, "views")
    views = load_views(recording, given) if isinstance(given, str) else given
    chosen = choose_views(recording, views, [b is not None for b in blocks])
    return views.camera, {
        i: _Sample(partial(read_grey, views.paths[j], views.camera), t_cf) for i, (j, t_cf) in chosen.items()
    }


def _availability(
    available: float, period: float, intervals: Sequence[tuple[float, float]] | None
) -> _Availability:
    if not (np.isfinite(available) and 0.0 <= available <= 1.0):
        raise SettingsError(f"The availability {available} is not allowed; give a share from 0 to 1.")
    if not (np.isfinite(period) and period > 0.0):
        raise SettingsError(f"The period {period} of availability is not allowed; give seconds above zero.")
    if intervals is None:
        return _Availability(available, period, None)
    if available != 1.0:
        raise SettingsError("Both a share and intervals of availability are given; give only one of them.")
    ordered = tuple((float(a), float(b)) for a, b in intervals)
    if not all(np.isfinite(a) and np.isfinite(b) and a < b for a, b in ordered):
        raise SettingsError(
            f"The intervals {list(ordered)} are not allowed; give (start, end) seconds, start < end."
        )
    return _Availability(1.0, period, ordered)


def attach_worn(
    recording: Recording,
    spec: str | PosedViews,
    *,
    available: float = 1.0,
    period: float = 5.0,
    intervals: Sequence[tuple[float, float]] | None = None,
    noise: PoseNoise | Sequence[float] | None = None,
    seed: int = 0,
    bias_per_block: bool = False,
) -> WornRecording:
    """Give a recording the views of a worn camera.

    Parameters
    ----------
    recording
        Any recording.
    spec
        ``recorded``: the views the recording holds, as they are; ``recorded:anna,ben``: those of these
        persons.  ``none``: no views.  ``lag:SECONDS``: the recording's own images that much later, as if the
        worn camera walked ahead (a negative lag: behind).
        Their pixels get fresh noise (`collabslam.datasets.emulated.pixel_noise`).
        ``rig``: the second camera of the rig.  ``views:FOLDER``: posed views of the same place, the one with
        the largest overlap each time (:func:`collabslam.datasets.emulated.views.choose_views`).  Or these
        views themselves.
    available
        Share of each period, from the first stamp, during which the worn camera is there; it is there first.
    period
        Seconds.
    intervals
        Instead of a share: (start, end) in seconds from the first stamp.
    noise
        Standard deviations (position m, roll deg, pitch deg, yaw deg) of the measured ``T_CF``, the angles
        about F's z, x and y axes; by default 3 cm and 0.5, 0.5, 1 degrees, for a rig 2 mm and 0.05 degrees.
        ``T_true = T_meas Exp(e)``, e ~ N(0, covariance of the view).
    seed
        Of the noise, of ``T_CF`` and of pixels; each frame draws from its own generator.
    bias_per_block
        Draw e once for each block of availability instead of for each frame.

    Raises
    ------
    SettingsError
        If an option is not understood or not allowed, or there is no such person.
    DataError
        If the recording lacks what ``spec`` needs: true poses, a rig, posed views.
    """
    kind, value = _parse(spec) if isinstance(spec, str) else ("views", "")
    mask = _availability(available, period, intervals)
    if seed < 0:
        raise SettingsError(f"The seed {seed} is not allowed; give a whole number that is zero or more.")
    blocks = [mask.block(float(t - recording.times[0])) for t in recording.times]
    if kind in ("recorded", "none"):
        if noise is not None or bias_per_block:
            raise SettingsError(f"The worn camera '{kind}' takes no noise; leave out the noise options.")
        if kind == "none":
            return WornRecording(recording, {}, {}, [None] * len(recording), None)
        if value:
            recording = OnlyPersons(recording, value.split(","))
        return WornRecording(recording, worn_cameras(recording), {}, blocks, None)
    if kind == "lag":
        camera, samples = recording.camera, _lag_samples(recording, value, blocks, seed)
    elif kind == "rig":
        camera, samples = _rig_samples(recording)
    else:
        camera, samples = _view_samples(recording, value if isinstance(spec, str) else spec, blocks)
    return WornRecording(
        recording, {"": camera}, samples, blocks, PoseErrors(_pose_noise(noise, kind), seed, bias_per_block)
    )


def _pose_noise(noise: PoseNoise | Sequence[float] | None, kind: str) -> PoseNoise:
    if noise is None:
        return RIG_NOISE if kind == "rig" else SENSOR_NOISE
    if isinstance(noise, PoseNoise):
        return noise
    if len(noise) != 4:
        raise SettingsError(
            f"The noise has {len(noise)} numbers; give four: position m, roll, pitch and yaw degrees."
        )
    return PoseNoise(*(float(x) for x in noise))
