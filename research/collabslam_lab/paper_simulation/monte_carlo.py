"""Many runs on all cores: what is asked for, done once, and kept for the next figure."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import ExitStack
from dataclasses import fields
from types import TracebackType
from typing import Any

import numpy as np

from collabslam.batch.engines import LOCAL, Engine
from collabslam.errors import SettingsError
from collabslam.runs.progress import Progress
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings

MODELS = {
    "wall": ("wall_run", "run_wall", 50),
    "core": ("wall_core", "run_wall_core", 10),
    "cloud": ("cloud", "run_cloud", 4),
    "worn": ("worn_run", "run_worn", 2),
}
"""Module, function and runs per task of each simulation."""


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
    engine : Engine
        Where they run.
    progress : bool
    """

    def __init__(
        self,
        settings: SimulationSettings,
        *,
        runs: int,
        seed: int,
        jobs: int,
        engine: Engine = LOCAL,
        progress: bool = True,
    ) -> None:
        if runs < 2 or jobs < 1 or seed < 0:
            raise SettingsError(
                f"runs {runs}, jobs {jobs}, seed {seed}: give 2 runs or more, 1 job, seed 0 or more."
            )
        self.settings, self.runs, self.seed = settings, runs, seed
        self._jobs, self._progress = jobs, progress
        self._done: dict[Case, Any] = {}
        self._engine = engine
        self._open = ExitStack()
        self._pool: Executor | None = None

    def __enter__(self) -> Study:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    def gather(self, cases: Iterable[Case], label: str) -> dict[Case, Any]:
        """Outcomes over all runs, in the order of the runs; what an earlier figure asked for is not run
        again."""
        wanted = list(dict.fromkeys(cases))
        tasks = [
            (case, chunk)
            for case in wanted
            if case not in self._done
            for chunk in _chunks(self._count(case), MODELS[case.model][2])
        ]
        parts: dict[Case, dict[int, Any]] = {case: {} for case, _ in tasks}
        total = sum(len(chunk) for _, chunk in tasks)
        with Progress(total, label, enabled=self._progress and total > 0, unit="run") as bar:
            for case, chunk, outcome in self._results(tasks):
                parts[case][chunk[0]] = outcome
                for _ in chunk:
                    bar.update()
        for case, done in parts.items():
            self._done[case] = _joined([done[first] for first in sorted(done)])
        return {case: self._done[case] for case in wanted}

    def _count(self, case: Case) -> int:
        own = {"cloud": self.settings.cloud_runs, "worn": self.settings.worn_runs}
        return int(own.get(case.model, self.runs))

    def _results(self, tasks: list[tuple[Case, range]]) -> Iterable[tuple[Case, range, Any]]:
        arguments = [(case, self.settings.values, self.seed, chunk) for case, chunk in tasks]
        if self._jobs == 1 and self._engine.is_local:
            for (case, chunk), argument in zip(tasks, arguments, strict=True):
                yield case, chunk, run_task(*argument)
            return
        if self._pool is None and tasks:
            self._pool = self._open.enter_context(self._engine.pool(self._jobs))
        if self._pool is not None:
            futures = {self._pool.submit(run_task, *a): t for a, t in zip(arguments, tasks, strict=True)}
            for future in as_completed(futures):
                case, chunk = futures[future]
                yield case, chunk, future.result()


def run_task(case: Case, values: dict[str, Any], seed: int, runs: Sequence[int]) -> Any:
    """Some runs of a case; also the work of a child process."""
    module, function, _ = MODELS[case.model]
    run = getattr(importlib.import_module(f"collabslam_lab.paper_simulation.{module}"), function)
    settings = SimulationSettings(values)
    with np.errstate(all="ignore"):  # an estimator may diverge; its runs are counted as such
        return run(settings, case, seed, runs)


def _chunks(count: int, size: int) -> list[range]:
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def _joined(parts: list[Any]) -> Any:
    """Outcomes of several tasks as one, run after run."""
    kind = type(parts[0])
    return kind(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(kind)})
