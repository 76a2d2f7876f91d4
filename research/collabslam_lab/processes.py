"""Work spread over cores: child processes of one thread each."""

from __future__ import annotations

import multiprocessing
import os
from multiprocessing.context import SpawnContext

import cv2

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS")


def spawning() -> SpawnContext:
    """What starts processes whose libraries use one thread; each of them calls `use_one_thread` itself."""
    for variable in _THREAD_VARIABLES:
        os.environ[variable] = "1"
    return multiprocessing.get_context("spawn")


def use_one_thread() -> None:
    """OpenCV works in this process's thread from now on, whatever the number of cores."""
    cv2.setNumThreads(1)
