"""Work spread over cores: child processes of one thread each."""

from __future__ import annotations

import os
import threading
import time

import cv2

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
"""Variables by which libraries of a new process use one thread."""
_ORPHAN_SECONDS = 1.0


def use_one_thread() -> None:
    """OpenCV works in this process's thread from now on, whatever the number of cores."""
    cv2.setNumThreads(1)


def end_with_parent(parent: int) -> None:
    """This process ends when its parent, which has that number, is gone: nobody waits for its work."""
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_ORPHAN_SECONDS)
    os._exit(1)
