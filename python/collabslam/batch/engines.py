"""Where work is done: in processes of this machine, or on the workers of a Dask cluster.

Whatever is asked runs in a child process of its own under a time limit (`isolated`), here or on a worker:
what kills or hangs that child fails alone, and a worker that dies takes nothing along that is not done again
elsewhere.  Workers see the same files as the machine that asks, and have the same program.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from collabslam.batch.isolated import Stop, asking, one
from collabslam.errors import DataError, SettingsError
from collabslam.extras import how_to_get

ENGINES = ("local", "dask")
T = TypeVar("T")
TRIES = 10
"""Workers that may die under a task before it is blamed; Dask's own 3 blame innocent ones sooner."""
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
        Limit of each piece of work.
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
            with asking(jobs) as (threads, stop):
                yield _Isolating(threads.submit, self.seconds, stop)
            return
        with self.workers(jobs) as workers:
            yield _Isolating(workers.submit, self.seconds)

    def each(
        self,
        function: Callable[..., Any],
        pieces: Sequence[tuple[Any, ...]],
        jobs: int,
        hear: Callable[[int, Callable[[], Any]], None],
    ) -> None:
        """Calls a function with each of the pieces; one job of this machine is this process itself.

        Parameters
        ----------
        function, jobs
            As of `pool`.
        pieces : sequence of tuple
            Arguments of each call.
        hear : callable
            Is given, as the pieces come in, the place of each, and what returns its result or raises what has
            become of it. Where this raises, nobody waits for the others.

        Raises
        ------
        DataError
            As `pool`.
        """
        if jobs == 1 and self.is_local:
            for k, piece in enumerate(pieces):
                hear(k, partial(function, *piece))
            return
        with self.pool(jobs) as pool:
            places = {pool.submit(function, *piece): k for k, piece in enumerate(pieces)}
            for future in as_completed(places):
                hear(places[future], future.result)

    def in_order(
        self,
        function: Callable[..., T],
        pieces: Sequence[tuple[Any, ...]],
        jobs: int,
        told: Callable[[], None],
    ) -> list[T]:
        """What the function returns for each of the pieces, in their order; ``told`` is called for each.

        The rest is as with `each`; raises what a piece raises, without the others.
        """
        results: dict[int, T] = {}

        def hear(k: int, result: Callable[[], T]) -> None:
            results[k] = result()
            told()

        self.each(function, pieces, jobs, hear)
        return [results[k] for k in range(len(pieces))]

    @contextlib.contextmanager
    def workers(self, jobs: int) -> Iterator[Workers]:
        """What sends a call to a worker, where it runs in the worker itself; raises as `pool` does."""
        try:
            import dask
            from distributed import Client, KilledWorker, LocalCluster
        except ImportError as error:
            raise DataError(f"This needs distributed ({error}); {how_to_get('cluster')}.") from error
        with contextlib.ExitStack() as stack:
            stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": TRIES}))
            address = self.scheduler
            if address is None:
                address = stack.enter_context(
                    # A free port for its page: another cluster may be at work here.
                    LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address="127.0.0.1:0")
                )
            try:
                client = stack.enter_context(Client(address))
            except (OSError, ValueError) as error:
                raise DataError(f"No scheduler answers at {address} ({error}); start one there.") from error
            executor = client.get_executor(pure=False)
            stack.callback(executor.shutdown, wait=False)  # whoever stops does not wait for what is under way
            yield Workers(_BlamedAlone(executor.submit, KilledWorker).submit, KilledWorker)


LOCAL = Engine()


class _BlamedAlone:
    """Sends calls to workers; one whose workers die is tried once more when no other call is under way.

    A scheduler hands a worker several calls at a time and counts its death against all of them, so that one
    which is waiting behind the one that kills is blamed with it, by chance.

    Parameters
    ----------
    submit : callable
        Sends a call to a worker, and returns its future.
    killed : type of exception
        What that raises when too many workers died under the call.
    """

    def __init__(self, submit: Callable[..., Future[Any]], killed: type[Exception]) -> None:
        self._submit, self._killed = submit, killed
        self._lock = threading.Lock()
        self._under_way = 0
        self._suspects: deque[Callable[[], None]] = deque()

    def submit(self, *call: Any) -> Future[Any]:
        """The future of a function with its arguments, as of an executor."""
        told: Future[Any] = Future()
        self._send(call, told, alone=False)
        return told

    def _send(self, call: tuple[Any, ...], told: Future[Any], *, alone: bool) -> None:
        with self._lock:
            self._under_way += 1
        try:
            future = self._submit(*call)
        except Exception as error:  # nobody hears of it where this is called when another call is done
            future = Future()
            future.set_exception(error)
        future.add_done_callback(partial(self._came, call, told, alone))

    def _came(self, call: tuple[Any, ...], told: Future[Any], alone: bool, future: Future[Any]) -> None:
        error = None if future.cancelled() else future.exception()
        suspect = isinstance(error, self._killed) and not alone
        with self._lock:
            self._under_way -= 1
            if suspect:
                self._suspects.append(partial(self._send, call, told, alone=True))
            follows = self._suspects.popleft() if self._suspects and not self._under_way else None
        if follows is not None:
            follows()
        if suspect:
            return
        if future.cancelled():
            told.cancel()
            told.set_running_or_notify_cancel()
        elif error is not None:
            told.set_exception(error)
        else:
            told.set_result(future.result())


class _Isolating(Executor):
    """Sends calls to threads or workers, and from there each into a child process."""

    def __init__(self, submit: Callable[..., Future[Any]], seconds: float, stop: Stop | None = None) -> None:
        self._submit, self._seconds, self._stop = submit, seconds, stop

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        """As of any executor; positional arguments alone."""
        return self._submit(one, function, arguments, self._seconds, self._stop)
