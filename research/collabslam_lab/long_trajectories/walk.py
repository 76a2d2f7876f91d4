"""One long trajectory through the engine, and what is measured of it."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam.batch.processes import use_one_thread
from collabslam.geometry import pose_inverse, se3_log
from collabslam.results import Loop
from collabslam.slam.engine import Slam
from collabslam.types import Array
from collabslam_lab.worlds.catalogue import Recipe
from collabslam_lab.worlds.recording import WorldRecording

FARTHEST, WIDEST = 1.0, 30.0
"""Metres and degrees by which a loop's pose may differ from the truth; one beyond them is false."""


@dataclass(frozen=True)
class Walked:
    """What came of a trajectory.

    Attributes
    ----------
    name : str
    ms : (N,) float64
        CPU time of each frame's own thread, without rendering it; the graph has another.
    odometry, corrected : (N,) float64
        Error of the position, of ``pose`` and of ``pose_map``, metres.
    first_loop : int or None
        Frame in which the first loop was found.
    loops, false : int
    nees_mid, nees_end, nees_between : float
        Squared error over covariance, of six numbers: of the submap half way through the first loop, of the
        last frame's ``pose_map``, and between the two submaps of the last loop.  NaN where there is no loop.
    saved_bytes : int
        Size of what the engine saves at the end.
    save_s, load_s : float
        Seconds that it takes to save that, and to load it.
    trajectory, submaps : (N, 3), (M, 3) float64
        Positions of the odometry and of the corrected submaps.
    pairs : list of (int, int)
        Submaps that loops join.
    truth : (N, 3) float64
    """

    name: str
    ms: Array
    odometry: Array
    corrected: Array
    first_loop: int | None
    loops: int
    false: int
    nees_mid: float
    nees_end: float
    nees_between: float
    saved_bytes: int
    save_s: float
    load_s: float
    trajectory: Array
    submaps: Array
    pairs: list[tuple[int, int]]
    truth: Array


def walk(recipe: Recipe, seed: int, frames: int | None = None) -> Walked:
    """Runs a trajectory; `frames` of it, or all."""
    use_one_thread()
    world = WorldRecording(recipe, seed, keep=frames is not None)  # draws share a scene
    slam = Slam(world.camera, world.worn_camera)
    count = len(world.times) if frames is None else min(frames, len(world.times))
    truth = [pose_inverse(world.truth[0]) @ world.truth[i] for i in range(count)]
    ms, trajectory, errors, first = [], [], [], None
    for i in range(count):
        frame = world.frame(i)
        began = time.thread_time()
        step = slam.step(frame.t, frame.image, frame.views)
        ms.append(1e3 * (time.thread_time() - began))
        trajectory.append(step.pose[:3, 3])
        off = [np.linalg.norm(p[:3, 3] - truth[i][:3, 3]) for p in (step.pose, step.pose_map)]
        errors.append(off)
        if first is None and step.diagnostics["loops"]:
            first = i
    submaps = slam.submaps()
    at = {round(float(t), 6): i for i, t in enumerate(world.times[:count])}
    ends = [at[round(float(t), 6)] for t in submaps.times]
    false = sum(_is_false(slam, loop, [truth[i] for i in ends]) for loop in submaps.loops)
    mid = end = between = float("nan")
    if submaps.loops:
        middle = (submaps.loops[0].first + submaps.loops[0].second) // 2
        mid = _nees(*slam.between_submaps(0, middle), pose_inverse(truth[ends[0]]) @ truth[ends[middle]])
        end = _nees(step.pose_map, step.covariance_map, truth[-1])
        loop = submaps.loops[-1]
        exact = pose_inverse(truth[ends[loop.first]]) @ truth[ends[loop.second]]
        between = _nees(*slam.between_submaps(loop.first, loop.second), exact)
    odometry, corrected = np.array(errors).T
    return Walked(
        recipe.name,
        np.array(ms),
        odometry,
        corrected,
        first,
        len(submaps.loops),
        int(false),
        mid,
        end,
        between,
        *_saved(slam),
        np.array(trajectory),
        submaps.poses[:, :3, 3],
        [(loop.first, loop.second) for loop in submaps.loops],
        np.array([t[:3, 3] for t in truth]),
    )


def _nees(pose: Array, covariance: Array, truth: Array) -> float:
    error = se3_log(pose_inverse(pose) @ truth)
    return float(error @ np.linalg.solve(covariance, error))


def _is_false(slam: Slam, loop: Loop, truth: list[Array]) -> bool:
    """Whether the graph, which believes a loop, has the two submaps elsewhere than they are."""
    pose, _ = slam.between_submaps(loop.first, loop.second)
    off = pose_inverse(pose) @ pose_inverse(truth[loop.first]) @ truth[loop.second]
    angle = np.degrees(np.arccos(np.clip(0.5 * (np.trace(off[:3, :3]) - 1.0), -1.0, 1.0)))
    return bool(np.linalg.norm(off[:3, 3]) > FARTHEST or angle > WIDEST)


def _saved(slam: Slam) -> tuple[int, float, float]:
    """Size of what the engine saves; seconds to save and to load it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "engine"
        began = time.perf_counter()
        slam.save(path)
        saved = time.perf_counter()
        Slam.load(path)
        return path.stat().st_size, saved - began, time.perf_counter() - saved
