"""What evidence was made of: commit, versions, machine."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

import collabslam
from collabslam.version import version

SOURCE = Path(collabslam.__file__).parents[2]
"""The source tree, where the package runs from it."""
UNKNOWN = "unknown"


def commit() -> str:
    """Of the source tree, ``+changes`` after it where files differ; `UNKNOWN` without a tree or git."""
    known = _git("rev-parse", "--short=9", "HEAD")
    if known is None:
        return UNKNOWN
    return known + ("+changes" if _git("status", "--porcelain") else "")


def made_of() -> dict[str, Any]:
    """Commit, versions of all packages and of Python, and the machine, without its name."""
    return {
        "commit": commit(),
        "version": version(),
        "python": platform.python_version(),
        "packages": dict(sorted((d.metadata["Name"], d.version) for d in metadata.distributions())),
        "machine": {
            "system": platform.system(),
            "architecture": platform.machine(),
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
    }


def _git(*words: str) -> str | None:
    git = shutil.which("git")
    if git is None or not (SOURCE / ".git").exists():
        return None
    done = subprocess.run([git, "-C", str(SOURCE), *words], check=False, capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), UNKNOWN)
