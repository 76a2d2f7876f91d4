"""An environment of its own for each system, so that nothing of it gets into this one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from collabslam.errors import DataError
from collabslam_lab.peers.systems import Peer

_DONE = "installed.txt"
_SECONDS = 900.0


def default_folder() -> Path:
    """Where environments are kept: in the user's cache."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "collabslam-lab" / "peers"


def interpreter(peer: Peer, folder: Path) -> Path | None:
    """The interpreter of a system's environment, or None if there is none that is complete."""
    place = folder / peer.requirement.replace("==", "-")
    python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    try:
        whole = (place / _DONE).read_text(encoding="utf-8").strip() == peer.requirement
    except OSError:
        return None
    return python.absolute() if whole and python.exists() else None


def install(peer: Peer, folder: Path) -> Path:
    """The interpreter of a system's environment, which is made if it is not there.

    Parameters
    ----------
    peer : Peer
    folder : Path
        Holds an environment for each requirement.

    Raises
    ------
    DataError
        If it cannot be made, with what pip said.
    """
    python = interpreter(peer, folder)
    if python is not None:
        return python
    place = folder / peer.requirement.replace("==", "-")
    shutil.rmtree(place, ignore_errors=True)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _call(sys.executable, "-m", "venv", place)
        python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        _call(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary",
              ":all:", peer.requirement)  # fmt: skip
        (place / _DONE).write_text(peer.requirement + "\n", encoding="utf-8")
    except OSError as error:
        raise DataError(f"The environment {place} cannot be made ({error}); give another --envs.") from error
    return python.absolute()


def _call(*words: str | Path) -> None:
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired as error:
        raise DataError(f"It could not be installed within {_SECONDS:g} s.") from error
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines() or ["it said nothing"]
        why = next((line for line in said if line.startswith("ERROR")), said[-1])
        raise DataError(f"It could not be installed: {why}")
