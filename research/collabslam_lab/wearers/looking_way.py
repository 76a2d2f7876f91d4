"""A way down the demo's corridor on which the person looks where a policy says, once a second.

Cf is beside Cs all the time and its pose is always measured; its picture is taken in the first frame and at
the looks only.  All policies meet the same noise: that of a look is drawn by way and frame.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from collabslam._core import CandidateViews
from collabslam.demo.recording import DemoRecording, measured_pose
from collabslam.demo.renderer import Renderer
from collabslam.demo.walk import CorridorWalk
from collabslam.demo.world import corridor
from collabslam.geometry import pose_inverse
from collabslam.slam.engine import Slam
from collabslam.types import Array, Image, WornView
from collabslam_lab.processes import use_one_thread

RATE, SPEED = 10.0, 1.5
FIRST, EVERY = 5, 10
"""Frame of the first look, and frames from one to the next."""
STARTS = (0.0, 1.5, 3.0, 4.5, 6.0, 7.5)
"""Times of the walk at which the ways begin, seconds."""
LEAST = 8
"""The setting ``frontend.worn.min_matches``."""
KNOWN = 1e-4
"""As in the core's ``look``: what is known better counts as known."""
POLICIES = ("never", "ahead", "random", "cue", "best")
DRAWS = 3
"""Ways of the policy ``random``, each with other directions."""


@dataclass
class Looked:
    """What one way gave.

    Attributes
    ----------
    error : float
        Mean error of the position, metres.
    foretold, gained : list of float
        Of each view that was tried, nats.
    expected, matched : list of float
        Its matches of landmarks.
    ms : list of float
        Of each answer.
    """

    error: float = float("nan")
    foretold: list[float] = field(default_factory=list)
    gained: list[float] = field(default_factory=list)
    expected: list[float] = field(default_factory=list)
    matched: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)


Choice = Callable[["Way", int, Slam, CandidateViews], int | None]


class Way:
    """One way: the pictures of Cs, and what Cf sees wherever it looks.

    Parameters
    ----------
    number : int
        Of `STARTS`.
    frames : int
    seed : int
    """

    def __init__(self, number: int, frames: int, seed: int) -> None:
        self._seed = (seed, number)
        length = SPEED * (STARTS[-1] + 0.1 * frames) + 1.0
        times = STARTS[number] + np.arange(frames) / RATE
        renderer, walk = Renderer(corridor(length)), CorridorWalk(SPEED)
        self.recording = DemoRecording(renderer, walk, times, f"way-{number}", seed)
        self.pictures: list[Image] = [self.recording.image(i) for i in range(frames)]
        self.result = Looked()

    def measured(self, i: int) -> tuple[Array, Array]:
        """Measured T_CF of frame ``i`` for a Cf that looks as Cs does, and its covariance."""
        return measured_pose(self._true(i), np.random.Generator(np.random.PCG64((*self._seed, i))))

    def view(self, i: int, attitude: Array) -> WornView:
        """Cf's view in frame ``i``, looking along ``attitude`` (3, 3) in C."""
        true = self._true(i)
        true[:3, :3] = attitude
        generator = np.random.Generator(np.random.PCG64((*self._seed, i)))
        t_cf, covariance = measured_pose(true, generator)
        picture = self.recording.worn_picture_at(self.recording.truth[i] @ true, generator)
        return WornView(picture, t_cf, covariance)

    def _true(self, i: int) -> Array:
        true = np.eye(4)
        true[:3, 3] = self.recording.true_t_cf(i)[:3, 3]
        return true

    def go(self, choice: Choice) -> Looked:
        """The whole way, looking where ``choice`` says."""
        recording, self.result = self.recording, Looked()
        slam = Slam(recording.camera, recording.worn_camera)
        errors = []
        for i, picture in enumerate(self.pictures):
            worn = self.view(i, np.eye(3)) if i == 0 else None
            if i >= FIRST and (i - FIRST) % EVERY == 0:
                t_cf, covariance = self.measured(i)
                began = time.perf_counter()
                here, _ = slam.filter.where_to_look(t_cf, covariance, least=LEAST)
                self.result.ms.append(1e3 * (time.perf_counter() - began))
                chosen = choice(self, i, slam, here)
                worn = None if chosen is None else self.view(i, here.t_cf[chosen][:3, :3])
            pose = slam.step(float(recording.times[i]), picture, worn).pose
            true = pose_inverse(recording.truth[0]) @ recording.truth[i]
            errors.append(float(np.linalg.norm(pose[:3, 3] - true[:3, 3])))
        self.result.error = float(np.mean(errors[FIRST:]))
        return self.result

    def gains(self, i: int, slam: Slam, here: CandidateViews) -> Array:
        """What each view would really gain in frame ``i``: all are taken, each by a copy of the engine."""
        state, t = slam.state(), float(self.recording.times[i])
        without = Slam.from_state(state)
        without.step(t, self.pictures[i])
        before, gains = log_det(without), np.zeros(len(here.gain))
        for k, view in enumerate(here.t_cf):
            copy = Slam.from_state(state)
            result = copy.step(t, self.pictures[i], self.view(i, view[:3, :3]))
            gains[k] = before - log_det(copy)
            self.result.matched.append(float(result.diagnostics["cf_pixel_rows"]))
        self.result.foretold += here.gain.tolist()
        self.result.expected += here.matches.tolist()
        self.result.gained += gains.tolist()
        return gains


def log_det(slam: Slam) -> float:
    """``ln det / 2`` of the covariance of pose and scale."""
    covariance = slam.filter.pose_and_scale_covariance
    assert covariance is not None, "the engine has started"
    return 0.5 * float(np.linalg.slogdet(covariance + KNOWN**2 * np.eye(len(covariance)))[1])


def _never(way: Way, i: int, slam: Slam, here: CandidateViews) -> int | None:
    return None


def _ahead(way: Way, i: int, slam: Slam, here: CandidateViews) -> int | None:
    turns = np.abs(here.t_cf[:, :3, :3] - np.eye(3)).sum(axis=(1, 2))
    return int(np.argmin(turns)) if len(turns) else None


def _cue(way: Way, i: int, slam: Slam, here: CandidateViews) -> int | None:
    return here.best


def _best(way: Way, i: int, slam: Slam, here: CandidateViews) -> int | None:
    gains = way.gains(i, slam, here)
    return int(np.argmax(gains)) if len(gains) else None


def _random(generator: np.random.Generator) -> Choice:
    def choose(way: Way, i: int, slam: Slam, here: CandidateViews) -> int | None:
        return int(generator.integers(len(here.gain))) if len(here.gain) else None

    return choose


def look_along(number: int, frames: int, seed: int) -> dict[str, list[Looked]]:
    """All policies on one way; also the work of a child process."""
    use_one_thread()
    way = Way(number, frames, seed)
    draws = [np.random.Generator(np.random.PCG64((seed, number, 7, draw))) for draw in range(DRAWS)]
    choices: dict[str, list[Choice]] = {
        "never": [_never],
        "ahead": [_ahead],
        "random": [_random(draw) for draw in draws],
        "cue": [_cue],
        "best": [_best],
    }
    return {policy: [way.go(choice) for choice in choices[policy]] for policy in POLICIES}
