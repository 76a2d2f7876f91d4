"""Items on the workers of an engine; they see the same folders and have the same program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace

from collabslam.batch.engines import Engine
from collabslam.batch.isolated import isolated
from collabslam_lab.benchmark.replay import timed_item
from collabslam_lab.benchmark.store import Item, Row


def run_remotely(
    items: Sequence[Item],
    groups: list[list[int]],
    *,
    jobs: int,
    engine: Engine,
    hear: Callable[[int, Row], None],
    again: bool,
) -> None:
    """Run groups on the workers of an engine, each item under its time limit.

    A group whose workers die too often is run once more item by item, so that one of them alone is blamed.

    Parameters
    ----------
    items : sequence of Item
    groups : list of list of int
        Places of items that share a recording.
    jobs, engine
        As of `run_items`.
    hear : callable
        Is given the place of each item and its row.
    again : bool
        Whether what an earlier try has left is run once more.
    """
    with engine.workers(jobs) as workers:

        def submit(group: list[int]) -> Future[list[Row]]:
            return workers.submit(replay, [_absolute(items[k]) for k in group], engine.seconds, again)

        waiting = {submit(group): group for group in groups}
        while waiting:
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                group = waiting.pop(future)
                try:
                    found = future.result()
                except workers.killed as error:
                    if len(group) > 1:
                        waiting |= {submit([k]): [k] for k in group}
                        continue
                    found = [items[group[0]].failed(f"it killed its workers ({error})")]
                for k, row in zip(group, found, strict=True):
                    hear(k, row)


def replay(items: Sequence[Item], seconds: float, again: bool) -> list[Row]:
    """The work of a worker: items one after the other in a child process; a row for each."""
    answers = isolated(replay_item, [(item, again) for item in items], seconds)
    return [item.row_of(answer) for item, answer in zip(items, answers, strict=True)]


def replay_item(item: Item, again: bool) -> Row:
    """The work of the child: what another worker has done before it died stays done."""
    row = None if again else item.done()
    return timed_item(item) if row is None else row


def _absolute(item: Item) -> Item:
    """The item for a process that works in another folder."""
    return replace(item, data=item.data.resolve(), out=item.out.resolve())
