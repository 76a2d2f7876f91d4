"""Runs of a rendered world, with a gyroscope or without one, and what came of them."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from collabslam import Settings, Slam, run
from collabslam.datasets.wrapped import FirstFrames, WrappedRecording
from collabslam.results import StepResult
from collabslam.types import Frame, ImuLog, Recording, Status
from collabslam_lab.gyro.simulated import KINDS, SimulatedGyro, simulated_gyro
from collabslam_lab.worlds import world_recording

_SEED = 29


@dataclass(frozen=True)
class Piece:
    """What to run.

    Attributes
    ----------
    world : str
    seed : int
        Of all noise.
    mode : str
    kind : str
        Of the gyroscope, one of `KINDS`; "" for none.
    frames : int or None
        The first ones only; None for all.
    """

    world: str
    seed: int
    mode: str
    kind: str
    frames: int | None

    @property
    def stem(self) -> str:
        """What it is called."""
        return f"{self.world}-{self.mode}-{self.kind or 'none'}-{self.seed}"


@dataclass(frozen=True)
class OfWorld:
    """All runs of a world: one process does them, so that it is rendered once.

    Attributes
    ----------
    pieces : tuple of Piece
        At least one.
    """

    pieces: tuple[Piece, ...]

    @property
    def stem(self) -> str:
        """Begins the name of its file."""
        return self.pieces[0].world


@dataclass(frozen=True)
class Score:
    """What came of a run.

    Attributes
    ----------
    end_pct : float
        Error of the position at the end, % of the way.
    heading_deg : float
        Error of the heading at the end.
    mean_pct : float
        Mean error of the position in all frames, % of the way.
    ok, false_ok, posed, lost_at_end : float
        Shares of the frames that are OK, that are OK and wrong, and that have a pose; 1 if it ends LOST.
    nees : float
        Mean of the pose's, of six degrees of freedom.
    bias_inside : float
        Share of the frames since the start in which the bias is within three sd of the true one, each axis.
    dropped : float
        1 if the gyroscope was dropped.
    ms_predict, us_sample : float
        Median milliseconds of a frame's prediction, microseconds of taking a sample.
    """

    end_pct: float
    heading_deg: float
    mean_pct: float
    ok: float
    false_ok: float
    posed: float
    lost_at_end: float
    nees: float
    bias_inside: float
    dropped: float
    ms_predict: float
    us_sample: float


class WithGyro(WrappedRecording):
    """A recording with a gyroscope, or without one.

    Parameters
    ----------
    base : Recording
    log : ImuLog or None
    """

    def __init__(self, base: Recording, log: ImuLog | None) -> None:
        super().__init__(base)
        self.imu = log


class _Timed(Slam):
    """An engine that counts what taking samples costs."""

    seconds, samples = 0.0, 0

    def add_gyro(self, t: float, rate: ArrayLike) -> None:
        """As of `Slam`."""
        began = time.perf_counter()
        super().add_gyro(t, rate)
        self.seconds += time.perf_counter() - began
        self.samples += 1


def ran(group: OfWorld) -> str:
    """The work of a child process: a list of `Score` as JSON."""
    return json.dumps([asdict(_score(piece)) for piece in group.pieces])


def _score(piece: Piece) -> Score:
    world = world_recording(piece.world, piece.seed, keep=True)
    gyro = None
    if piece.kind:
        noise = np.random.default_rng([_SEED, world.recipe.seed, piece.seed])
        gyro = simulated_gyro(world.robot, world.times, KINDS[piece.kind], noise)
    recording = WithGyro(world, None if gyro is None else gyro.log)
    if piece.frames is not None:
        recording = FirstFrames(recording, piece.frames)  # type: ignore[assignment]
    settings = Settings.default()
    imu = None if gyro is None else gyro.log.sensor
    slam = _Timed(recording.camera, recording.worn_cameras, settings=settings, mode=piece.mode, imu=imu)
    watch = _Watch(gyro)
    result = run(recording, mode=piece.mode, start="worn", settings=settings, slam=slam, watch=watch.frame)
    summary, record = result.summary, result.record
    path = float(summary["path_length_m"])
    return Score(
        end_pct=100.0 * float(summary["final_position_error_m"]) / path,
        heading_deg=abs(float(summary["heading_error_final_deg"])),
        mean_pct=100.0 * float(summary["avg_position_error_all_m"]) / path,
        ok=float(summary["ok_share"]),
        false_ok=float(summary["false_ok_share"]),
        posed=float(np.mean(record.valid)),
        lost_at_end=float(record.statuses[-1] == Status.LOST),
        nees=float(summary["nees_mean"] or np.nan),
        bias_inside=float(np.mean(watch.inside)) if watch.inside else np.nan,
        dropped=float(watch.dropped),
        ms_predict=float(np.median(record.diagnostic("ms_predict"))),
        us_sample=1e6 * slam.seconds / max(slam.samples, 1),
    )


def parsed(group: OfWorld, content: Any) -> list[Score]:
    """The `Score` of each piece, of their JSON."""
    scores = [Score(**{f.name: float(one[f.name]) for f in fields(Score)}) for one in content]
    if len(scores) != len(group.pieces):
        raise ValueError(f"{len(scores)} scores of {len(group.pieces)} runs")
    return scores


class _Watch:
    """Looks at the bias after each frame."""

    def __init__(self, gyro: SimulatedGyro | None) -> None:
        self._gyro = gyro
        self.inside: list[bool] = []
        self.dropped = False

    def frame(self, frame: Frame, result: StepResult, _: Any) -> None:
        """A frame with the engine's answer."""
        if self._gyro is None or result.gyro is None or not result.started:
            return
        off = np.abs(result.gyro.bias - self._gyro.bias(frame.t))
        self.inside.append(bool((off <= 3.0 * result.gyro.bias_sd).all()))
        self.dropped |= not result.gyro.followed
