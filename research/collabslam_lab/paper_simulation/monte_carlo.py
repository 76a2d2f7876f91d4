"""Many runs on all cores: what is asked for, done once, and kept for the next figure."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, fields
from types import TracebackType
from typing import Any

import numpy as np

from collabslam.errors import SettingsError
from collabslam.runs.progress import Progress
from collabslam_lab.paper_simulation.estimators import Estimator
from collabslam_lab.paper_simulation.settings import SimulationSettings
from collabslam_lab.processes import spawning

MODELS = {
    "wall": ("wall_run", "run_wall", 50),
    "core": ("wall_core", "run_wall_core", 10),
    "cloud": ("cloud", "run_cloud", 4),
    "worn": ("worn_run", "run_worn", 2),
}
"""Module, function and runs per task of each simulation."""


@dataclass(frozen=True)
class Request:
    """A Monte Carlo: a model of `MODELS`, the estimator, how Cf helps, and the sigma of its range, metres
    (None:
    the setting's)."""

    model: str
    estimator: Estimator
    collaboration: str
    range_sigma: float | None = None


class Study:
    """Settings, seed and processes of one call; a context manager.

    Parameters
    ----------
    settings : SimulationSettings
    runs : int
    seed : int
        Run ``r`` draws from the generator seeded by (seed, r), whatever else is computed.
    jobs : int
        Processes.
    progress : bool
    """

    def __init__(
        self, settings: SimulationSettings, *, runs: int, seed: int, jobs: int, progress: bool = True
    ) -> None:
        if runs < 2 or jobs < 1 or seed < 0:
            raise SettingsError(
                f"runs {runs}, jobs {jobs}, seed {seed}: give 2 runs or more, 1 job, seed 0 or more."
            )
        self.settings, self.runs, self.seed = settings, runs, seed
        self._jobs, self._progress = jobs, progress
        self._done: dict[Request, Any] = {}
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Study:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def gather(self, requests: Iterable[Request], label: str) -> dict[Request, Any]:
        """Outcomes over all runs, in the order of the runs; what an earlier figure asked for is not run
        again."""
        wanted = list(dict.fromkeys(requests))
        tasks = [
            (request, chunk)
            for request in wanted
            if request not in self._done
            for chunk in _chunks(self._count(request), MODELS[request.model][2])
        ]
        parts: dict[Request, dict[int, Any]] = {request: {} for request, _ in tasks}
        total = sum(len(chunk) for _, chunk in tasks)
        with Progress(total, label, enabled=self._progress and total > 0, unit="run") as bar:
            for request, chunk, outcome in self._results(tasks):
                parts[request][chunk[0]] = outcome
                for _ in chunk:
                    bar.update()
        for request, done in parts.items():
            self._done[request] = _joined([done[first] for first in sorted(done)])
        return {request: self._done[request] for request in wanted}

    def _count(self, request: Request) -> int:
        own = {"cloud": self.settings.cloud_runs, "worn": self.settings.worn_runs}
        return int(own.get(request.model, self.runs))

    def _results(self, tasks: list[tuple[Request, range]]) -> Iterable[tuple[Request, range, Any]]:
        arguments = [(request, self.settings.values, self.seed, chunk) for request, chunk in tasks]
        if self._jobs == 1:
            for (request, chunk), argument in zip(tasks, arguments, strict=True):
                yield request, chunk, run_task(*argument)
            return
        if self._pool is None and tasks:
            self._pool = ProcessPoolExecutor(self._jobs, mp_context=spawning())
        if self._pool is not None:
            futures = {self._pool.submit(run_task, *a): t for a, t in zip(arguments, tasks, strict=True)}
            for future in as_completed(futures):
                request, chunk = futures[future]
                yield request, chunk, future.result()


def run_task(request: Request, values: dict[str, Any], seed: int, runs: Sequence[int]) -> Any:
    """Some runs of a request; also the work of a child process."""
    module, function, _ = MODELS[request.model]
    run = getattr(importlib.import_module(f"collabslam_lab.paper_simulation.{module}"), function)
    settings = SimulationSettings(values)
    with np.errstate(all="ignore"):  # an estimator may diverge; its runs are counted as such
        return run(settings, request.estimator, request.collaboration, seed, runs, request.range_sigma)


def _chunks(count: int, size: int) -> list[range]:
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def _joined(parts: list[Any]) -> Any:
    """Outcomes of several tasks as one, run after run."""
    kind = type(parts[0])
    return kind(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(kind)})
