"""A trajectory down the demo's corridor on which the person looks where a policy says, once a second.

Cf is beside Cs all the time and its pose is always measured; its picture is taken ahead until the map has
started, and then at the looks only.  All policies meet the same noise: that of a look is drawn by trajectory
and frame.  The errors of T_CF of six trajectories together are six vectors at right angles, so that they
have their stated size in every direction: else what few free draws happen to be decides what a look is worth.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from collabslam._core import CandidateViews
from collabslam.batch.processes import use_one_thread
from collabslam.geometry import pose_inverse, rotation_exp
from collabslam.simulation.recording import SimulatedRecording, pose_with_error
from collabslam.simulation.renderer import Renderer
from collabslam.simulation.trajectory import CorridorWalk
from collabslam.simulation.world import corridor
from collabslam.slam.engine import Slam
from collabslam.types import Array, Image, WornView

RATE, SPEED = 10.0, 1.5
FIRST, EVERY = 5, 10
"""Frames from the start to the first look, and from one look to the next."""
STARTS = (0.0, 1.5, 3.0, 4.5, 6.0, 7.5)
"""Times of the walk at which the trajectories begin in turn, seconds."""
LEAST = 8
"""The setting ``frontend.worn.min_matches``."""
KNOWN = 1e-4
"""As in the core's ``look``: what is known better counts as known."""
POLICIES = ("never", "anywhere", "random", "ahead", "cue", "best")
DRAWS = 2
"""Trajectories of the policies ``anywhere`` and ``random``, each with other directions."""
BEST = 6
"""The best choice is asked for on so many trajectories: it takes as long as all the others."""


@dataclass
class PlannedViews:
    """What one trajectory gave.

    Attributes
    ----------
    error, sd : float
        Of the position from the first look on, RMS over the frames, metres: the real one, and what the
        filter says.
    foretold, gained : list of float
        Of each view that was tried, nats.
    expected, matched : list of float
        Its matches of landmarks.
    ms : list of float
        Of each answer.
    """

    error: float = float("nan")
    sd: float = float("nan")
    foretold: list[float] = field(default_factory=list)
    gained: list[float] = field(default_factory=list)
    expected: list[float] = field(default_factory=list)
    matched: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)


Choice = Callable[["Trajectory", int, Slam, CandidateViews], Array | None]
"""The attitude (3, 3) in C of the look in a frame, of the views that are offered; None does not look."""


class Trajectory:
    """One trajectory: the pictures of Cs, and what Cf sees wherever it looks.

    Parameters
    ----------
    number : int
        Each has noise of its own; where it begins is `STARTS` in turn.
    frames : int
    seed : int
    """

    def __init__(self, number: int, frames: int, seed: int) -> None:
        self._seed = (seed, number)
        own = int(np.random.SeedSequence(self._seed).generate_state(1)[0])
        length = SPEED * (STARTS[-1] + 0.1 * frames) + 1.0
        times = STARTS[number % len(STARTS)] + np.arange(frames) / RATE
        renderer, walk = Renderer(corridor(length)), CorridorWalk(SPEED)
        self.recording = SimulatedRecording(renderer, walk, times, f"trajectory-{number}", own)
        self.pictures: list[Image] = [self.recording.image(i) for i in range(frames)]
        self.result = PlannedViews()

    def measured(self, i: int) -> tuple[Array, Array]:
        """Measured T_CF of frame ``i`` for a Cf that looks as Cs does, and its covariance."""
        return pose_with_error(self._true(i), t_cf_error(*self._seed, i))

    def view(self, i: int, attitude: Array) -> WornView:
        """Cf's view in frame ``i``, looking along ``attitude`` (3, 3) in C."""
        true = self._true(i)
        true[:3, :3] = attitude
        generator = np.random.Generator(np.random.PCG64((*self._seed, i)))
        picture = self.recording.worn_picture_at(self.recording.truth[i] @ true, generator)
        return self.recording.view(picture, pose_with_error(true, t_cf_error(*self._seed, i)))

    def _true(self, i: int) -> Array:
        true = np.eye(4)
        true[:3, 3] = self.recording.true_t_cf(i)[:3, 3]
        return true

    def go(self, choice: Choice) -> PlannedViews:
        """The whole trajectory, looking where ``choice`` says."""
        recording, self.result = self.recording, PlannedViews()
        slam = Slam(recording.camera, recording.worn_camera)
        errors: list[Array] = []
        variances: list[float] = []
        for i, picture in enumerate(self.pictures):
            views = [] if slam.filter.started else [self.view(i, np.eye(3))]
            since = len(errors)
            if since >= FIRST and (since - FIRST) % EVERY == 0:
                t_cf, covariance = self.measured(i)
                began = time.perf_counter()
                here, _ = slam.filter.next_best_view(t_cf, covariance, least=LEAST)
                self.result.ms.append(1e3 * (time.perf_counter() - began))
                attitude = choice(self, i, slam, here)
                views = [] if attitude is None else [self.view(i, attitude)]
            step = slam.step(float(recording.times[i]), picture, views)
            if not slam.filter.started:
                continue
            if not errors:
                origin = pose_inverse(recording.truth[i])
            errors.append(step.pose[:3, 3] - (origin @ recording.truth[i])[:3, 3])
            variances.append(float(np.trace(step.covariance[:3, :3])))
        self.result.error = float(np.sqrt(np.mean(np.sum(np.square(errors[FIRST:]), axis=1))))
        self.result.sd = float(np.sqrt(np.mean(variances[FIRST:])))
        return self.result

    def landmarks_in(self, i: int, slam: Slam, attitudes: Array) -> Array:
        """How many landmarks that Cs sees are in Cf's image in frame ``i``, for each attitude (N, 3, 3)."""
        points = slam.landmarks().points - slam.filter.pose[:3, 3]
        points = points @ slam.filter.pose[:3, :3]
        points = points[self.recording.camera.project(points).visible]
        away = points - self.measured(i)[0][:3, 3]
        camera = self.recording.worn_camera
        return np.array([camera.project(away @ attitude).visible.sum() for attitude in attitudes])

    def gains(self, i: int, slam: Slam, here: CandidateViews) -> Array:
        """What each view would really gain in frame ``i``: all are taken, each by a copy of the engine."""
        state, t = slam.state(), float(self.recording.times[i])
        without = Slam.from_state(state)
        without.step(t, self.pictures[i])
        before, gains = log_det(without), np.zeros(len(here.gain))
        for k, view in enumerate(here.t_cf):
            copy = Slam.from_state(state)
            result = copy.step(t, self.pictures[i], [self.view(i, view[:3, :3])])
            gains[k] = before - log_det(copy)
            self.result.matched.append(float(result.diagnostics["cf_pixel_rows"]))
        self.result.foretold += here.gain.tolist()
        self.result.expected += here.matches.tolist()
        self.result.gained += gains.tolist()
        return gains


def t_cf_error(seed: int, number: int, i: int) -> Array:
    """Error (6,) of T_CF in a frame of a trajectory, in standard deviations: a row of a random rotation."""
    together, row = divmod(number, 6)
    generator = np.random.Generator(np.random.PCG64((seed, together, i, 6)))
    q, r = np.linalg.qr(generator.standard_normal((6, 6)))
    error: Array = np.sqrt(6.0) * (q * np.sign(np.diag(r)))[row]
    return error


def log_det(slam: Slam) -> float:
    """``ln det / 2`` of the covariance of pose and scale."""
    covariance = slam.filter.pose_and_scale_covariance
    assert covariance is not None, "the engine has started"
    return 0.5 * float(np.linalg.slogdet(covariance + KNOWN**2 * np.eye(len(covariance)))[1])


def directions() -> Array:
    """Attitudes (N, 3, 3) in C every 15 degrees around and up to 60 degrees up and down, level with C."""
    turns = np.deg2rad([(up, right) for up in range(-60, 61, 15) for right in range(0, 360, 15)])
    return np.array([rotation_exp([0.0, right, 0.0]) @ rotation_exp([up, 0.0, 0.0]) for up, right in turns])


def _never(trajectory: Trajectory, i: int, slam: Slam, here: CandidateViews) -> Array | None:
    return None


def _ahead(trajectory: Trajectory, i: int, slam: Slam, here: CandidateViews) -> Array | None:
    return np.eye(3)


def _cue(trajectory: Trajectory, i: int, slam: Slam, here: CandidateViews) -> Array | None:
    return None if here.best is None else here.t_cf[here.best][:3, :3]


def _best(trajectory: Trajectory, i: int, slam: Slam, here: CandidateViews) -> Array | None:
    gains = trajectory.gains(i, slam, here)
    return here.t_cf[int(np.argmax(gains))][:3, :3] if len(gains) else None


def _anywhere(generator: np.random.Generator) -> Choice:
    def choose(trajectory: Trajectory, i: int, slam: Slam, here: CandidateViews) -> Array | None:
        return np.array(generator.choice(directions()))

    return choose


def _random(generator: np.random.Generator) -> Choice:
    def choose(trajectory: Trajectory, i: int, slam: Slam, here: CandidateViews) -> Array | None:
        attitudes = directions()
        attitudes = attitudes[trajectory.landmarks_in(i, slam, attitudes) > 0]
        return np.array(generator.choice(attitudes)) if len(attitudes) else None

    return choose


def plan_along(number: int, frames: int, seed: int) -> dict[str, list[PlannedViews]]:
    """All policies on one trajectory, the best choice on the first `BEST` only; also a child's work."""
    use_one_thread()
    trajectory = Trajectory(number, frames, seed)

    def drawn(kind: int) -> list[np.random.Generator]:
        return [np.random.Generator(np.random.PCG64((seed, number, kind, draw))) for draw in range(DRAWS)]

    choices: dict[str, list[Choice]] = {
        "never": [_never],
        "anywhere": [_anywhere(generator) for generator in drawn(8)],
        "random": [_random(generator) for generator in drawn(7)],
        "ahead": [_ahead],
        "cue": [_cue],
        "best": [_best] if number < BEST else [],
    }
    return {policy: [trajectory.go(choice) for choice in choices[policy]] for policy in POLICIES}
