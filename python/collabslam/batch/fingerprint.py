"""Whether what a run read is still what it was."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path


@cache
def files_hash(folder: Path) -> str:
    """Of the names, sizes and times of a recording's files."""
    digest = hashlib.sha256()
    for line in _listing(folder):
        digest.update(line.encode())
    return digest.hexdigest()


def _listing(folder: Path) -> Iterator[str]:
    for path in sorted(folder.rglob("*") if folder.is_dir() else [folder]):
        if path.is_file():
            facts = path.stat()
            yield f"{path.relative_to(folder).as_posix()} {facts.st_size} {facts.st_mtime_ns}\n"
