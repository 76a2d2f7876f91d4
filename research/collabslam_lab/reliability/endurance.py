"""A long session: frames without end, looped forth and back, through one engine."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collabslam import Camera
from collabslam.simulation.recording import corridor_recording
from collabslam.slam.engine import Slam
from collabslam.types import Frame, Recording

RATE = 10.0
"""Frames a second."""
FORTH = 40
"""Frames of the walk that is gone forth and back."""
SOUND = -1e-10
"""METHOD 3: what the least eigenvalue of the scaled P must lie above."""


@dataclass(frozen=True)
class Endurance:
    """What a long session showed.

    Attributes
    ----------
    frames : int
    memory_mb : float
        Resident memory at the end, of a process that renders nothing; NaN where the system does not tell.
    memory_growth_mb : float
        The same less that after a fifth of the frames.
    time_ratio : float
        Median processor time of a frame in the last fifth over that in the second.
    ok_share : float
        Share of the frames that are OK.
    least_eigenvalue : float
        Least eigenvalue of the scaled P that was met.
    sound : bool
        Whether P was sound whenever it was looked at.
    """

    frames: int
    memory_mb: float
    memory_growth_mb: float
    time_ratio: float
    ok_share: float
    least_eigenvalue: float
    sound: bool

    def jsonable(self) -> dict[str, Any]:
        """As in ``reliability.json``."""
        return asdict(self)


def resident_mb() -> float:
    """Memory of this process, megabytes; NaN where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6
    except (OSError, IndexError, ValueError):
        return float("nan")


def looped(frames: list[Frame], k: int) -> Frame:
    """Frame ``k`` of a walk that goes forth and back for ever; motion is continuous, stamps go on."""
    period = 2 * (len(frames) - 1)
    place = k % period
    return frames[place if place < len(frames) else period - place]


@dataclass(frozen=True)
class _Played:
    """Frames of a walk, and the cameras that took them."""

    camera: Camera
    worn_camera: Camera | None
    frames: list[Frame]

    @classmethod
    def of(cls, recording: Recording) -> _Played:
        """The first `FORTH` of a recording."""
        frames = [recording.frame(i) for i in range(min(FORTH, len(recording)))]
        return cls(recording.camera, recording.worn_camera, frames)

    @classmethod
    def rendered(cls, seed: int) -> _Played:
        """Those of the demo."""
        return cls.of(corridor_recording(seed))

    @classmethod
    def rendered_elsewhere(cls, seed: int) -> _Played:
        """The same; another process has rendered them, whose memory is its own."""
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            return pool.submit(cls.rendered, seed).result()


def endure_session(seconds: float, seed: int = 0, recording: Recording | None = None) -> Endurance:
    """Replays frames for so long a time of the recording's clock, at 10 frames a second.

    Parameters
    ----------
    seconds : float
    seed : int
        Of the demo's noise, and of the noise laid over each picture: no two of them are equal.
    recording : Recording, optional
        The demo if left out; its first `FORTH` frames are gone forth and back.
    """
    played = _Played.rendered_elsewhere(seed) if recording is None else _Played.of(recording)
    frames = played.frames
    noise = np.random.Generator(np.random.PCG64((seed, 1)))
    slam = Slam(played.camera, played.worn_camera, mode="collab", start="worn")
    count = max(10, round(seconds * RATE))
    cpu, ok, least, early = np.zeros(count), 0, np.inf, float("nan")
    for k in range(count):
        frame = looped(frames, k)
        image = frame.image.copy()
        rows = noise.integers(0, image.shape[0], 64)
        image[rows, noise.integers(0, image.shape[1], 64)] ^= 16
        began = time.process_time()
        result = slam.step(k / RATE, image, frame.views)
        cpu[k] = time.process_time() - began
        ok += result.status.value == "OK"
        if k % 100 == 99 or k + 1 == count:
            least = min(least, slam.filter.soundness())
        if k == count // 5:
            early = resident_mb()
    fifth, late = count // 5, resident_mb()
    return Endurance(
        frames=count,
        memory_mb=late,
        memory_growth_mb=late - early,
        time_ratio=float(np.median(cpu[-fifth:]) / np.median(cpu[fifth : 2 * fifth])),
        ok_share=ok / count,
        least_eigenvalue=float(least),
        sound=bool(least > SOUND),
    )


def many_dropped(count: int = 100, frames: int = 3) -> float:
    """Megabytes by which memory grows while engines are made, used and dropped."""
    recording = corridor_recording(0)
    seen = [recording.frame(i) for i in range(frames)]

    def one() -> None:
        slam = Slam(recording.camera, recording.worn_camera, mode="collab", start="worn")
        for frame in seen:
            slam.step(frame.t, frame.image, frame.views)

    for _ in range(max(1, count // 5)):
        one()
    before = resident_mb()
    for _ in range(count):
        one()
    return resident_mb() - before
