"""Trajectories down the demo's corridor with up to three persons around the robot, who look where it goes.

Each begins elsewhere and has pictures of its own, and is run twelve times.  The errors of T_CF of a
person in each six of them are six vectors at right angles, as on those of `planned_views`: so that who helps
is decided by what the persons see, not by what few free draws happen to be.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from collabslam.batch.processes import use_one_thread
from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.geometry import pose_inverse, rotation_exp
from collabslam.simulation.recording import SimulatedRecording, pose_with_error
from collabslam.simulation.renderer import Renderer
from collabslam.simulation.trajectory import CorridorWalk
from collabslam.simulation.world import corridor
from collabslam.slam.engine import Slam
from collabslam.types import Array, Image, WornView
from collabslam_lab.worn_cameras.planned_views import RATE, SPEED, t_cf_error

NAMES = ("left", "right", "behind")
PLACES = ((-0.65, -0.7, 0.1), (0.55, -0.65, 0.3), (-0.15, -0.8, -0.6))
"""Of the persons' Cf in C, metres: on both sides of the robot and behind it, at a head's height."""
TURNS = (3.0, -4.0, 0.0)
"""About the axis y of C, degrees: a little towards each other."""
EVERY = 5
"""Frames from one view of each person to the next."""
DRAWS = 12
STEP = 0.6
"""Seconds of the walk from where one trajectory begins to where the next one does."""


@dataclass(frozen=True)
class Went:
    """What one trajectory gave with some persons.

    Attributes
    ----------
    error : float
        Of the position, RMS over the frames, metres.
    pose, position : float
        NEES of the pose (6 degrees of freedom) and of the position (3), mean over the frames.
    worn : list of float
        NEES of the poses of the worn cameras (6), of each person the mean over the views that were measured.
    ms : float
        Median time of a frame with views, milliseconds.
    matches : float
        Mean number of matches of all persons in such a frame.
    errors : (N, 3) float64
        Of the position in each frame after the start, along the axes of Cs, metres.
    """

    error: float
    pose: float
    position: float
    worn: list[float]
    ms: float
    matches: float
    errors: Array


class PersonsTrajectory:
    """The pictures of one trajectory, made once.

    Parameters
    ----------
    number : int
    frames : int
    seed : int
    """

    def __init__(self, number: int, frames: int, seed: int) -> None:
        self._number, self._seed = number, seed
        own = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
        times = STEP * number + np.arange(frames) / RATE
        renderer = Renderer(corridor(SPEED * float(times[-1]) + 3.0))
        self.recording = SimulatedRecording(renderer, CorridorWalk(SPEED), times, f"trajectory-{number}", own)
        self.pictures: list[Image] = [self.recording.image(i) for i in range(frames)]
        self._views = {
            (i, who): self._picture(i, who) for i in range(0, frames, EVERY) for who in range(len(NAMES))
        }

    def _picture(self, i: int, who: int) -> Image:
        generator = np.random.Generator(np.random.PCG64((self._seed, self._number, i, who)))
        return self.recording.worn_picture_at(self.recording.truth[i] @ t_cf(who), generator)

    def views(self, i: int, persons: Iterable[int], draw: int) -> list[WornView]:
        """What the persons give for frame ``i``, each with its own error."""
        out = []
        for who in persons:
            if (i, who) in self._views:
                error = t_cf_error(len(NAMES) * self._seed + who, DRAWS * self._number + draw, i)
                stated = pose_with_error(t_cf(who), error)
                out.append(self.recording.view(self._views[i, who], stated, who=NAMES[who]))
        return out

    def go(self, persons: tuple[int, ...], draw: int) -> Went:
        """The whole trajectory with some of the persons."""
        recording = self.recording
        slam = Slam(recording.camera, {NAMES[who]: recording.worn_camera for who in persons})
        poses: list[Array] = []
        covariances: list[Array] = []
        truth: list[Array] = []
        ms: list[float] = []
        matches: list[float] = []
        placed: dict[str, list[tuple[Array, Array, Array]]] = {NAMES[who]: [] for who in persons}
        origin = np.eye(4)
        for i, picture in enumerate(self.pictures):
            views = self.views(i, persons, draw)
            step = slam.step(float(recording.times[i]), picture, views)
            if not step.started:
                continue
            if not truth:
                origin = pose_inverse(recording.truth[i])
            truth.append(origin @ recording.truth[i])
            poses.append(step.pose)
            covariances.append(step.covariance)
            if views and len(truth) > 1:
                ms.append(float(step.diagnostics["ms_total"]))
                matches.append(float(step.diagnostics["cf_matches"]))
            for name, found in step.worn.items():
                if found.measured and len(truth) > 1:
                    true = truth[-1] @ t_cf(NAMES.index(name))
                    placed[name].append((found.pose, true, found.covariance))
        e, p = pose_tangent_error(np.array(poses), np.array(truth)), np.array(covariances)
        return Went(
            error=float(np.sqrt(np.mean(np.sum(np.square(e[1:, :3]), axis=1)))),
            pose=float(np.mean(nees(e[1:], p[1:]))),
            position=float(np.mean(nees(e[1:, :3], p[1:, :3, :3]))),
            worn=[_nees_of(found) for found in placed.values()],
            ms=float(np.median(ms)),
            matches=float(np.mean(matches)),
            errors=e[1:, :3],
        )


def t_cf(who: int) -> Array:
    """True T_CF (4, 4) of a person."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_exp([0.0, np.radians(TURNS[who]), 0.0]), PLACES[who]
    return pose


def _nees_of(found: list[tuple[Array, Array, Array]]) -> float:
    if not found:
        return float("nan")
    estimate, true, covariance = (np.array(part) for part in zip(*found, strict=True))
    return float(np.mean(nees(pose_tangent_error(estimate, true), covariance)))


GROUPS = ((0,), (0, 1), (0, 1, 2), (1,))
"""Who goes along: the first alone, two, three, and the second alone."""


def go_along(number: int, frames: int, draws: int, seed: int) -> dict[tuple[int, ...], list[Went]]:
    """One trajectory with each group of persons, as often as there are draws; also a child process's work."""
    use_one_thread()
    trajectory = PersonsTrajectory(number, frames, seed)
    return {group: [trajectory.go(group, draw) for draw in range(draws)] for group in GROUPS}
