"""Faults that a stream of frames can have, put into any recording, seeded.

Each fault says what should become of it; `faults_table` measures what does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError
from collabslam.geometry import se3_exp
from collabslam.types import Array, Frame, Image, Indices, Recording, WornView

Rng = np.random.Generator
Change = Callable[[int, Frame], Frame]

GAP, SHORT_GAP = 2.0, 0.5
"""Seconds that most faults last."""
CALIBRATION_ERROR = 1.02
COVARIANCE_FACTOR = 3.0


class FaultyRecording(WrappedRecording):
    """Frames of another recording, in another order, with other stamps, each of them changed.

    Parameters
    ----------
    base : Recording
    rows : (N,) int64, optional
        Frame of ``base`` that each frame is.
    times : (N,) float64, optional
        Time stamps, seconds, which need not increase.
    change : callable, optional
        Is given the frame's position and the frame.
    camera : Camera, optional
        In place of the calibration of Cs.
    """

    def __init__(
        self,
        base: Recording,
        *,
        rows: Indices | None = None,
        times: Array | None = None,
        change: Change | None = None,
        camera: Camera | None = None,
    ) -> None:
        super().__init__(base)
        self._rows = np.arange(len(base)) if rows is None else rows
        self.times = base.times[self._rows] if times is None else times
        self.truth = None if base.truth is None else base.truth[self._rows]
        self.camera = camera or base.camera
        self._change = change

    def __len__(self) -> int:
        return len(self._rows)

    def frame(self, i: int) -> Frame:
        """Frame ``i``, with its fault."""
        frame = self._base.frame(int(self._rows[i]))
        frame = dataclasses.replace(frame, index=i, t=float(self.times[i]))
        return frame if self._change is None else self._change(i, frame)

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        return self.frame(i).image


@dataclass(frozen=True)
class Fault:
    """A fault and its answer.

    Attributes
    ----------
    name : str
    what : str
        What happens to the stream.
    answer : str
        What collabslam does.
    make : callable
        From a recording and a random generator to the faulty recording.
    stops : bool
        Whether the answer is an error that ends the run.
    """

    name: str
    what: str
    answer: str
    make: Callable[[Recording, Rng], Recording]
    stops: bool = False


def _window(recording: Recording, rng: Rng, seconds: float) -> Indices:
    """Frames of a stretch of so many seconds, somewhere in the middle half of the recording."""
    times = recording.times
    length = times[-1] - times[0]
    begin = times[0] + rng.uniform(0.25 * length, max(0.26 * length, 0.75 * length - seconds))
    return np.flatnonzero((times >= begin) & (times < begin + seconds))


def _dropped(recording: Recording, rng: Rng) -> Recording:
    rows = np.setdiff1d(np.arange(len(recording)), _window(recording, rng, GAP))
    return FaultyRecording(recording, rows=rows)


def _dropped_half_second(recording: Recording, rng: Rng) -> Recording:
    rows = np.setdiff1d(np.arange(len(recording)), _window(recording, rng, SHORT_GAP))
    return FaultyRecording(recording, rows=rows)


def _dropped_singly(recording: Recording, rng: Rng) -> Recording:
    keep = rng.random(len(recording)) >= 0.1
    keep[:2] = True
    return FaultyRecording(recording, rows=np.flatnonzero(keep))


def _repeated(recording: Recording, rng: Rng) -> Recording:
    twice = 1 + (rng.random(len(recording)) < 0.1)
    return FaultyRecording(recording, rows=np.repeat(np.arange(len(recording)), twice))


def _out_of_order(recording: Recording, rng: Rng) -> Recording:
    """A tenth of the frames comes after the one that follows it."""
    rows = np.arange(len(recording))
    for i in np.flatnonzero(rng.random(len(rows) - 1) < 0.1):
        rows[i], rows[i + 1] = rows[i + 1], rows[i]
    return FaultyRecording(recording, rows=rows)


def _one_stamp_ahead(recording: Recording, rng: Rng) -> Recording:
    times = recording.times.copy()
    times[_window(recording, rng, SHORT_GAP)[0]] += 1000.0
    return FaultyRecording(recording, times=times)


def _clock_forward(recording: Recording, rng: Rng) -> Recording:
    times = recording.times.copy()
    times[_window(recording, rng, SHORT_GAP)[0] :] += 1.0
    return FaultyRecording(recording, times=times)


def _clock_back(recording: Recording, rng: Rng) -> Recording:
    times = recording.times.copy()
    times[_window(recording, rng, SHORT_GAP)[0] :] -= 0.5
    return FaultyRecording(recording, times=times)


def _shifted_cf(recording: Recording, by: int, begin: float) -> Recording:
    """From this share of the time on each view of Cf stands with the frame ``by`` places after its own."""
    first = round(begin * len(recording))

    def change(i: int, frame: Frame) -> Frame:
        if i < first:
            return frame
        k = i - by
        views = recording.frame(k).views if first <= k < len(recording) else ()
        return dataclasses.replace(frame, views=views)

    return FaultyRecording(recording, change=change)


def _cf_late(recording: Recording, _: Rng) -> Recording:
    return _shifted_cf(recording, 3, 0.3)


def _cf_early(recording: Recording, _: Rng) -> Recording:
    return _shifted_cf(recording, -3, 0.3)


def _cf_clock(recording: Recording, _: Rng) -> Recording:
    return _shifted_cf(recording, 1, 0.0)


def _cf_missing(recording: Recording, _: Rng) -> Recording:
    last = recording.times[0] + 0.3 * (recording.times[-1] - recording.times[0])

    def change(_: int, frame: Frame) -> Frame:
        return dataclasses.replace(frame, views=()) if frame.t > last else frame

    return FaultyRecording(recording, change=change)


def _with_worn(change: Callable[[int, WornView], WornView]) -> Callable[[Recording, Rng], Recording]:
    def make(recording: Recording, _: Rng) -> Recording:
        def of_frame(i: int, frame: Frame) -> Frame:
            return dataclasses.replace(frame, views=tuple(change(i, view) for view in frame.views))

        return FaultyRecording(recording, change=of_frame)

    return make


def _t_cf_gross(recording: Recording, rng: Rng) -> Recording:
    """A tenth of the views, but not the first: off by 1 to 5 m, or by 20 to 90 degrees, or both."""
    wrong: dict[int, Array] = {}
    for i in range(5, len(recording)):
        if rng.random() < 0.1:
            move, turn = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
            move, turn = move * rng.uniform(1.0, 5.0), turn * np.deg2rad(rng.uniform(20.0, 90.0))
            which = rng.integers(3)
            wrong[i] = se3_exp(np.concatenate([move * (which != 1), turn * (which != 0)]))

    def change(i: int, worn: WornView) -> WornView:
        return dataclasses.replace(worn, t_cf=worn.t_cf @ wrong[i]) if i in wrong else worn

    return _with_worn(change)(recording, rng)


def _scaled_covariance(by: float) -> Callable[[Recording, Rng], Recording]:
    return _with_worn(lambda _, worn: dataclasses.replace(worn, covariance=worn.covariance * by))


def _in_window(
    seconds: float, change: Callable[[Image, int], Image]
) -> Callable[[Recording, Rng], Recording]:
    """Changes the images of Cs in a stretch; ``change`` is given the image and its place in the stretch."""

    def make(recording: Recording, rng: Rng) -> Recording:
        places = {int(i): k for k, i in enumerate(_window(recording, rng, seconds))}

        def of_frame(i: int, frame: Frame) -> Frame:
            if i not in places:
                return frame
            return dataclasses.replace(frame, image=change(frame.image, places[i]))

        return FaultyRecording(recording, change=of_frame)

    return make


def _frozen(recording: Recording, rng: Rng) -> Recording:
    window = _window(recording, rng, SHORT_GAP)
    stuck = recording.image(int(window[0]))

    def change(i: int, frame: Frame) -> Frame:
        return dataclasses.replace(frame, image=stuck) if i in window else frame

    return FaultyRecording(recording, change=change)


def _torn(image: Image, place: int) -> Image:
    """Every other image lacks its lower half, which decoders fill with grey."""
    torn: Image = image.copy()
    if place % 2 == 0:
        torn[image.shape[0] // 2 :] = 128
    return torn


def _file_cut_off(recording: Recording, rng: Rng) -> Recording:
    at = int(_window(recording, rng, SHORT_GAP)[0])

    def change(i: int, frame: Frame) -> Frame:
        if i == at:
            raise DataError(f"The image {i}.png is empty, cut short or not an image; copy it again.")
        return frame

    return FaultyRecording(recording, change=change)


def _other_size(recording: Recording, rng: Rng) -> Recording:
    at = int(_window(recording, rng, SHORT_GAP)[0])

    def change(i: int, frame: Frame) -> Frame:
        half = np.ascontiguousarray(frame.image[::2, ::2])
        return dataclasses.replace(frame, image=half) if i == at else frame

    return FaultyRecording(recording, change=change)


def _walking(recording: Recording, rng: Rng) -> Recording:
    """Somebody in patterned clothes walks through, a fifth of the image wide, from left to right in 2 s."""
    window = {int(i): k for k, i in enumerate(_window(recording, rng, GAP))}
    height, width = recording.camera.height, recording.camera.width
    size = (int(0.8 * height), width // 5)
    pattern = rng.integers(30, 220, (size[0] // 8 + 1, size[1] // 8 + 1)).astype(np.uint8)
    cloth = cv2.resize(pattern, size[::-1], interpolation=cv2.INTER_CUBIC)

    def change(i: int, frame: Frame) -> Frame:
        if i not in window:
            return frame
        image = frame.image.copy()
        left = round((window[i] + 0.5) / len(window) * (width + size[1])) - size[1]
        u0, u1 = max(0, left), min(width, left + size[1])
        if u1 > u0:
            image[height - size[0] :, u0:u1] = cloth[:, u0 - left : u1 - left]
        return dataclasses.replace(frame, image=image)

    return FaultyRecording(recording, change=change)


def _exposure(recording: Recording, rng: Rng) -> Recording:
    """The exposure jumps about once a second, by up to a factor of 1.8 either way."""
    gains, gain = [], 1.0
    for _ in range(len(recording)):
        if rng.random() < 0.1:
            gain = float(np.exp(rng.uniform(-1.0, 1.0) * np.log(1.8)))
        gains.append(gain)

    def change(i: int, frame: Frame) -> Frame:
        image = np.clip(np.rint(frame.image * np.float32(gains[i])), 0, 255).astype(np.uint8)
        return dataclasses.replace(frame, image=image)

    return FaultyRecording(recording, change=change)


def _calibration(recording: Recording, _: Rng) -> Recording:
    camera = recording.camera
    fx, fy, cx, cy = camera.intrinsics
    intrinsics = (CALIBRATION_ERROR * fx, CALIBRATION_ERROR * fy, cx, cy)
    wrong = Camera(camera.model, camera.width, camera.height, intrinsics, camera.distortion)
    return FaultyRecording(recording, camera=wrong)


_PREDICTED = "predicted over the gap, the covariance grows with it; OK again with the next matches"
_LEFT_OUT = (
    "left out, counted in `frames_out_of_order`, warned of; `Slam.step` raises `InputError`, state kept"
)
_UNSEEN = "not searched: predicted, counted in `frames_unseen`, warned of; the map keeps its features"
_CONTRADICTS = "a view that contradicts the map or its own matches is not used"
_SHIFTED = f"{_CONTRADICTS}; others pull the estimate: pair by stamps, see `check-calib`"
_STOP = "error that names the file, exit 2; the frames before are written"

FAULTS: Sequence[Fault] = (
    Fault("dropped-singly", "10 % of the frames missing", _PREDICTED, _dropped_singly),
    Fault("dropped-0.5s", "0.5 s of frames missing", _PREDICTED, _dropped_half_second),
    Fault("dropped-2s", "2 s of frames missing", f"{_PREDICTED}, else LOST", _dropped),
    Fault("stamps-repeated", "10 % of the frames come twice", _LEFT_OUT, _repeated),
    Fault("stamps-out-of-order", "10 % of the frames come after the next", _LEFT_OUT, _out_of_order),
    Fault("stamp-ahead", "one stamp 1000 s ahead", _LEFT_OUT, _one_stamp_ahead),
    Fault("clock-forward", "the clock jumps 1 s forward", f"a gap: {_PREDICTED}", _clock_forward),
    Fault(
        "clock-back",
        "the clock jumps 0.5 s back",
        "set forward again; `Slam.step` raises `InputError`",
        _clock_back,
    ),
    Fault("cf-late", "views of Cf 3 frames late after 30 % of the time", _SHIFTED, _cf_late),
    Fault("cf-early", "views of Cf 3 frames early after 30 % of the time", _SHIFTED, _cf_early),
    Fault(
        "cf-clock",
        "Cf's clock off by one frame from the start",
        "nothing contradicts it: the scale suffers; `check-calib` and `doctor` show it",
        _cf_clock,
    ),
    Fault("cf-missing", "no Cf after 30 % of the time", "goes on as `mono` does", _cf_missing),
    Fault(
        "t-cf-gross",
        "10 % of `T_CF` off by 1-5 m or 20-90 degrees",
        _CONTRADICTS,
        _t_cf_gross,
    ),
    Fault(
        "t-cf-covariance-large",
        "covariance of `T_CF` 3 times too large",
        "weighs Cf less",
        _scaled_covariance(COVARIANCE_FACTOR),
    ),
    Fault(
        "t-cf-covariance-small",
        "covariance of `T_CF` 3 times too small",
        "believes Cf too much",
        _scaled_covariance(1.0 / COVARIANCE_FACTOR),
    ),
    Fault("black", "0.5 s of black images", _UNSEEN, _in_window(SHORT_GAP, lambda im, _: np.zeros_like(im))),
    Fault(
        "white", "0.5 s of white images", _UNSEEN, _in_window(SHORT_GAP, lambda im, _: np.full_like(im, 255))
    ),
    Fault("frozen", "the image stands still for 0.5 s", _UNSEEN, _frozen),
    Fault(
        "torn",
        "lower half grey, every other image for 2 s",
        "matches there fail; the others do",
        _in_window(GAP, _torn),
    ),
    Fault("file-cut-off", "an image file is cut off", _STOP, _file_cut_off, stops=True),
    Fault("other-size", "an image of another size", _STOP, _other_size, stops=True),
    Fault("walking-through", "somebody walks through the view", "the batch test rejects them", _walking),
    Fault("exposure", "exposure jumps by up to 1.8 either way", "the correlation is normalised", _exposure),
    Fault(
        "calibration", "focal length 2 % too long", "`check-calib` shows it; the scale suffers", _calibration
    ),
)
"""Every fault, in the order of the table."""


def inject(recording: Recording, fault: Fault, seed: int = 0) -> Recording:
    """The recording with a fault in it.

    Parameters
    ----------
    recording : Recording
    fault : Fault
    seed : int
        Of everything about the fault that is random.
    """
    number = [f.name for f in FAULTS].index(fault.name)
    return fault.make(recording, np.random.Generator(np.random.PCG64((seed, number))))
