"""All attacks, and the table of what became of them."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from collabslam.runs.progress import Progress
from collabslam_lab.reliability.attacks import (
    bags,
    calls,
    forged_bags,
    gyroscope,
    headers,
    image_bombs,
    image_files,
    live_calls,
    live_folders,
    places,
    records,
    result_folders,
    stores,
    streams,
    text_files,
    videos,
    words,
)
from collabslam_lab.reliability.attacks.attack import Attack, Result
from collabslam_lab.reliability.attacks.perform import perform
from collabslam_lab.reliability.attacks.scene import Ground
from collabslam_lab.report import markdown_table

ATTACKS: tuple[Attack, ...] = (
    *image_files.ATTACKS,
    *image_bombs.ATTACKS,
    *videos.ATTACKS,
    *text_files.ATTACKS,
    *gyroscope.ATTACKS,
    *bags.ATTACKS,
    *forged_bags.ATTACKS,
    *stores.ATTACKS,
    *headers.ATTACKS,
    *words.ATTACKS,
    *places.ATTACKS,
    *calls.ATTACKS,
    *live_calls.ATTACKS,
    *live_folders.ATTACKS,
    *records.ATTACKS,
    *result_folders.ATTACKS,
    *streams.ATTACKS,
)


def measure_attacks(
    attacks: Sequence[Attack] = ATTACKS, *, jobs: int = 1, progress: bool = False
) -> list[Result]:
    """Performs attacks, so many at a time, in their order.

    Parameters
    ----------
    attacks : sequence of Attack
    jobs : int
    progress : bool
        Whether to show on standard error how far it is.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # children would ignore it, too
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # under nohup; what is handled is not inherited
        signal.signal(signal.SIGHUP, lambda *_: None)
    with (
        tempfile.TemporaryDirectory(prefix="collabslam-attacks-") as folder,
        Progress(len(attacks), "attacks", enabled=progress) as bar,
        ThreadPoolExecutor(jobs) as pool,
    ):
        ground = Ground(Path(folder).resolve())
        results = []
        for result in pool.map(lambda attack: perform(attack, ground), attacks):
            results.append(result)
            bar.update()
    return results


def attacks_markdown(results: Iterable[Result]) -> str:
    """The table of the documentation."""
    rows = [
        (
            result.attack.group,
            f"`{result.attack.name}`",
            result.attack.what,
            _shown(result),
        )
        for result in results
    ]
    return markdown_table(("group", "attack", "what is done", "what became of it"), rows)


def _shown(result: Result) -> str:
    """What became of an attack, in bold where it succeeded."""
    if result.beyond:
        return f"{result.outcome.value}: no image tells"
    return f"**{result.outcome.value}**" if result.succeeded else result.outcome.value
