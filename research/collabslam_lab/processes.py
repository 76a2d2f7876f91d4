"""Work spread over cores: child processes of one thread each."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from multiprocessing.context import SpawnContext

import cv2

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
"""Variables by which libraries of a new process use one thread."""
_ORPHAN_SECONDS = 1.0


def spawning() -> SpawnContext:
    """What starts processes whose libraries use one thread; each of them calls `use_one_thread` itself."""
    os.environ.update(ONE_THREAD)
    return multiprocessing.get_context("spawn")


def use_one_thread() -> None:
    """OpenCV works in this process's thread from now on, whatever the number of cores."""
    cv2.setNumThreads(1)


def end_with_parent(parent: int | None = None) -> None:
    """This process ends when its parent (or the one of that number) is gone: nobody waits for its work."""
    number = os.getppid() if parent is None else parent
    threading.Thread(target=_watch, args=(number,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_ORPHAN_SECONDS)
    os._exit(1)
