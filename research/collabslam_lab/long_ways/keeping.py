"""Goes ways in processes of their own or on a cluster; what came of each is kept in a file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.formats.files import write_text
from collabslam.runs.progress import Progress
from collabslam.settings.table import Settings
from collabslam.types import Array
from collabslam.version import version
from collabslam_lab.engines import Engine
from collabslam_lab.long_ways.walk import Walked, walk
from collabslam_lab.worlds.catalogue import Recipe

_POSITIONS = ("way", "submaps", "truth")


@dataclass(frozen=True)
class Way:
    """One way to go.

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

    def key(self) -> str:
        """Changes with everything that the result depends on."""
        text = f"{self!r} {version()} {Settings.default().hash()}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def go(ways: Sequence[Way], folder: Path, *, jobs: int, engine: Engine) -> list[Walked]:
    """What came of the ways, in their order; those that `folder` already holds are not gone again."""
    done = {way: walked for way in ways if (walked := _read(_path(folder, way))) is not None}
    waiting = [way for way in ways if way not in done]
    if done:
        print(f"{len(done)} of {len(ways)} ways are there already", flush=True)
    with engine.pool(jobs) as pool, Progress(len(waiting), "loops", enabled=bool(waiting), unit="way") as bar:
        futures = {pool.submit(_gone, way): way for way in waiting}
        for future in as_completed(futures):
            way, text = futures[future], future.result()
            write_text(_path(folder, way), text)
            done[way] = _parsed(text)
            bar.update(f"{way.recipe.name}, {done[way].loops} loops")
    return [done[way] for way in ways]


def _gone(way: Way) -> str:
    """The work of a child process: goes a way."""
    walked = walk(way.recipe, way.seed, way.frames)
    return json.dumps({f.name: _plain(getattr(walked, f.name)) for f in fields(Walked)})


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _path(folder: Path, way: Way) -> Path:
    return folder / f"{way.recipe.name}-{way.seed}-{way.key()}.json"


def _read(path: Path) -> Walked | None:
    try:
        return _parsed(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _parsed(text: str) -> Walked:
    content = json.loads(text)
    arrays: dict[str, Array] = {
        name: np.array(content[name], dtype=np.float64) for name in ("ms", "odometry", "corrected")
    }
    arrays |= {name: np.array(content[name], dtype=np.float64).reshape(-1, 3) for name in _POSITIONS}
    return Walked(**{**content, **arrays, "pairs": [(int(a), int(b)) for a, b in content["pairs"]]})
