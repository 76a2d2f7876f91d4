"""Which program a result was made by: a hash of its files."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import collabslam
from collabslam.version import version

_LOOKS_ONLY = {"cli", "checks", "viz"}
_WORLDS = ("worlds", "worn_sensors")


@cache
def code_hash() -> str:
    """Of everything in the package that a result depends on, the compiled core included."""
    return _hash(Path(collabslam.__file__).parent, _LOOKS_ONLY)


@cache
def made_by(work: Callable[..., Any]) -> str:
    """Changes when version or package do, the lab's worlds and people, or a function's folder."""
    root = Path(__file__).parent
    parts = [_hash(root / part, set()) for part in _WORLDS]
    around = _hash(Path(inspect.getfile(work)).parent, set())
    return " ".join([version(), code_hash(), *parts, around])


@cache
def everything_hash() -> str:
    """Of the package and all of the lab."""
    return hashlib.sha256((code_hash() + _hash(Path(__file__).parent, set())).encode()).hexdigest()


def _hash(root: Path, without: set[str]) -> str:
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        part = path.relative_to(root)
        if path.suffix in (".py", ".so", ".pyd") and part.parts[0] not in without:
            digest.update(part.as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
