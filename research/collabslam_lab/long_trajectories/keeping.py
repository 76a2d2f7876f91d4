"""Runs trajectories in processes of their own or on a cluster; what came of each is kept in a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.batch.engines import Engine
from collabslam.types import Array
from collabslam_lab.kept import Task, kept
from collabslam_lab.long_trajectories.walk import Walked, walk
from collabslam_lab.worlds.catalogue import Recipe

_POSITIONS = ("trajectory", "submaps", "truth")


@dataclass(frozen=True)
class Trajectory:
    """One trajectory to run.

    Attributes
    ----------
    recipe : Recipe
    seed : int
        Of the draw of the noise.
    frames : int or None
        The first ones only; None for all.
    """

    recipe: Recipe
    seed: int
    frames: int | None

    @property
    def stem(self) -> str:
        """Begins the name of its file."""
        return f"{self.recipe.name}-{self.seed}"


def go(trajectories: Sequence[Trajectory], folder: Path, *, jobs: int, engine: Engine) -> list[Walked]:
    """What came of the trajectories, in their order; those that `folder` already holds are not run again."""
    task = Task(
        _gone,
        _parsed,
        lambda trajectory, done: f"{trajectory.recipe.name}, {done.loops} loops",
        "loops",
        "run",
    )
    return kept(task, trajectories, folder, jobs=jobs, engine=engine, progress=True)


def _gone(trajectory: Trajectory) -> str:
    """The work of a child process: runs a trajectory."""
    walked = walk(trajectory.recipe, trajectory.seed, trajectory.frames)
    return json.dumps({f.name: _plain(getattr(walked, f.name)) for f in fields(Walked)})


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _parsed(_: Trajectory, content: Any) -> Walked:
    arrays: dict[str, Array] = {
        name: np.array(content[name], dtype=np.float64) for name in ("ms", "odometry", "corrected")
    }
    arrays |= {name: np.array(content[name], dtype=np.float64).reshape(-1, 3) for name in _POSITIONS}
    return Walked(**{**content, **arrays, "pairs": [(int(a), int(b)) for a, b in content["pairs"]]})
