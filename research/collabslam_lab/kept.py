"""Pieces of work in processes of their own or on a cluster; what came of each is kept in a file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from collabslam.batch.engines import Engine
from collabslam.batch.isolated import why
from collabslam.errors import DataError
from collabslam.formats.files import write_text
from collabslam.runs.progress import Progress
from collabslam.settings.table import Settings
from collabslam_lab.program import made_by


class Piece(Protocol):
    """A dataclass that prints all its result depends on, but for program, settings and files it reads."""

    @property
    def stem(self) -> str:
        """Begins the name of its file."""
        ...


P = TypeVar("P", bound=Piece)
R = TypeVar("R")
_NAMED = 5
"""Pieces that an error names."""


@dataclass(frozen=True)
class Task(Generic[P, R]):
    """What is done with each piece.

    Attributes
    ----------
    work : callable
        Of a module, so that a child process finds it by name: a piece to its result as JSON.
    parsed : callable
        A piece and its loaded JSON to the result; raises ValueError, KeyError or TypeError if it is none.
    said : callable
        A piece and its result to what the progress line says of it.
    title, unit : str
        Of the progress line.
    """

    work: Callable[[P], str]
    parsed: Callable[[P, Any], R]
    said: Callable[[P, R], str]
    title: str
    unit: str


def kept(
    task: Task[P, R], pieces: Sequence[P], folder: Path, *, jobs: int, engine: Engine, progress: bool
) -> list[R]:
    """Results of the pieces, in their order; those that `folder` already holds are not worked on again.

    Raises
    ------
    DataError
        When all others are done, if some raised, died or took longer than the engine allows.
    """
    done = [_read(task, piece, folder) for piece in pieces]
    waiting = [k for k, result in enumerate(done) if result is None]
    if progress and len(waiting) < len(pieces):
        there = len(pieces) - len(waiting)
        print(f"{there} of {len(pieces)} {task.unit}s are there already", flush=True)
    failed: dict[int, Exception] = {}
    shown = progress and bool(waiting)
    with Progress(len(waiting), task.title, enabled=shown, unit=task.unit) as bar:

        def hear(at: int, text_of: Callable[[], str]) -> None:
            k = waiting[at]
            try:
                text = text_of()
            except Exception as error:
                failed[k] = error
                bar.update(f"{pieces[k].stem} failed")
                return
            write_text(_path(task, pieces[k], folder), text)
            result = done[k] = task.parsed(pieces[k], json.loads(text))
            bar.update(task.said(pieces[k], result))

        engine.each(task.work, [(pieces[k],) for k in waiting], jobs, hear)
    if failed:
        told = [f"{pieces[k].stem} ({why(error)})" for k, error in sorted(failed.items())]
        more = f" and {len(told) - _NAMED} more" if len(told) > _NAMED else ""
        raise DataError(
            f"{len(failed)} of {len(pieces)} {task.unit}s failed: {', '.join(told[:_NAMED])}{more}. "
            f"The others are in {folder}; the same command does what is missing."
        ) from next(iter(failed.values()))
    return [result for result in done if result is not None]


def _path(task: Task[P, R], piece: P, folder: Path) -> Path:
    text = f"{piece!r} {made_by(task.work)} {Settings.default().hash()}"
    return folder / f"{piece.stem}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.json"


def _read(task: Task[P, R], piece: P, folder: Path) -> R | None:
    try:
        return task.parsed(piece, json.loads(_path(task, piece, folder).read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError):
        return None
