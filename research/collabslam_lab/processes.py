"""Work spread over cores: child processes of one thread each."""

from __future__ import annotations

import multiprocessing
import os
from multiprocessing.context import SpawnContext

import cv2

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
"""Variables by which libraries of a new process use one thread."""


def spawning() -> SpawnContext:
    """What starts processes whose libraries use one thread; each of them calls `use_one_thread` itself."""
    os.environ.update(ONE_THREAD)
    return multiprocessing.get_context("spawn")


def use_one_thread() -> None:
    """OpenCV works in this process's thread from now on, whatever the number of cores."""
    cv2.setNumThreads(1)
