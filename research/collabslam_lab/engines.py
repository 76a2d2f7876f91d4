"""Where work is done: in processes of this machine, or on the workers of a Dask cluster.

Whatever goes to a worker runs there in a child process of its own under a time limit (`isolated`): what kills
or hangs that child fails alone, and a worker that dies takes nothing along that is not done again elsewhere.
Workers see the same files as the machine that asks, and have the same program.
"""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

from collabslam.errors import DataError, SettingsError
from collabslam_lab.isolated import one
from collabslam_lab.processes import end_with_parent, spawning

ENGINES = ("local", "dask")
TRIES = 10
"""Workers that may die under a task before it is said to have failed; Dask's own 3 blame innocent ones."""
SECONDS = 3600.0


@dataclass(frozen=True)
class Workers:
    """Of a cluster.

    Attributes
    ----------
    submit : callable
        Sends a function and its arguments to a worker.
    killed : type of exception
        What a call raises whose workers died too often.
    """

    submit: Callable[..., Future[Any]]
    killed: type[Exception]


@dataclass(frozen=True)
class Engine:
    """Where work is done.

    Attributes
    ----------
    kind : str
        Of `ENGINES`.
    scheduler : str or None
        Address of a Dask scheduler; None for workers of this machine.
    seconds : float
        Limit of each piece of work on a worker.
    """

    kind: str = "local"
    scheduler: str | None = None
    seconds: float = SECONDS

    def __post_init__(self) -> None:
        if self.kind not in ENGINES:
            raise SettingsError(f"There is no engine '{self.kind}'; there are {', '.join(ENGINES)}.")
        if self.scheduler is not None and self.kind != "dask":
            raise SettingsError("A scheduler is for --engine dask; give that, or leave --scheduler out.")
        if not self.seconds > 0.0:
            raise SettingsError(f"The limit of a replay is {self.seconds} s; give a positive number.")

    @property
    def is_local(self) -> bool:
        """Whether work stays in processes of this machine, without a scheduler."""
        return self.kind == "local"

    @contextlib.contextmanager
    def pool(self, jobs: int) -> Iterator[Executor]:
        """An executor: ``submit(function, *arguments)`` with what a module has by name.

        Parameters
        ----------
        jobs : int
            Processes of this machine; of a cluster elsewhere it is not asked.

        Raises
        ------
        DataError
            If Dask is not installed, or nothing answers at the scheduler's address.
        """
        if self.is_local:
            with ProcessPoolExecutor(jobs, mp_context=spawning(), initializer=end_with_parent) as pool:
                try:
                    yield pool
                except BaseException:  # nobody waits for what is under way
                    pool.shutdown(wait=False, cancel_futures=True)
                    for child in multiprocessing.active_children():
                        child.terminate()
                    raise
            return
        with self.workers(jobs) as workers:
            yield _Isolating(workers.submit, self.seconds)

    @contextlib.contextmanager
    def workers(self, jobs: int) -> Iterator[Workers]:
        """What sends a call to a worker, where it runs in the worker itself; raises as `pool` does."""
        try:
            import dask
            from distributed import Client, KilledWorker, LocalCluster
        except ImportError as error:
            raise DataError(
                f"This needs distributed ({error}): .venv/bin/pip install './research[cluster]'."
            ) from error
        with contextlib.ExitStack() as stack:
            stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": TRIES}))
            address = self.scheduler
            if address is None:
                address = stack.enter_context(
                    LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
                )
            try:
                client = stack.enter_context(Client(address))
            except (OSError, ValueError) as error:
                raise DataError(f"No scheduler answers at {address} ({error}); start one there.") from error
            executor = client.get_executor(pure=False)
            stack.callback(executor.shutdown, wait=False)  # whoever stops does not wait for what is under way
            yield Workers(executor.submit, KilledWorker)


LOCAL = Engine()


class _Isolating(Executor):
    """Sends calls to workers, each into a child process."""

    def __init__(self, submit: Callable[..., Future[Any]], seconds: float) -> None:
        self._submit, self._seconds = submit, seconds

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        """As of any executor; positional arguments alone."""
        return self._submit(one, function, arguments, self._seconds)
