"""Headers of containers that promise what is not there: told, at once, and in little memory."""

from __future__ import annotations

import json
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from collabslam.errors import DataError
from collabslam.formats import container

HEAD = struct.Struct("<8sIQ")


def written(path: Path, **changed: Any) -> Path:
    """A container of one array of a megabyte, whose header says something else."""
    container.write_container(path, "test", 1, np.zeros(1 << 20, np.uint8))
    data = path.read_bytes()
    magic, version, length = HEAD.unpack_from(data)
    header = json.loads(data[HEAD.size : HEAD.size + length]) | changed
    text = json.dumps(header).encode()
    path.write_bytes(container.seal(HEAD.pack(magic, version, len(text)) + text + data[HEAD.size + length :]))
    return path


def test_an_array_that_is_named_often_is_kept_once(tmp_path: Path) -> None:
    path = written(tmp_path / "box", tree=[{"bytes": 0}] * 1000)
    tracemalloc.start()
    found = container.read_container(path, "test", 1)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [len(part) for part in found] == [1 << 20] * 1000
    assert most < 10 << 20


@pytest.mark.parametrize(
    "changed",
    [
        {"arrays": [["<f8", [10**3999] * 4000]]},
        {"arrays": [["<f8", [0, 1 << 70]]]},
        {"arrays": [["|u1", [1] * 33]]},
        {"tree": {"class": "Camera", "fields": []}},
    ],
)
def test_what_no_array_and_no_class_is_is_told(tmp_path: Path, changed: dict[str, Any]) -> None:
    """Sides of 4000 digits were multiplied: that took longer than anybody waits."""
    with pytest.raises(DataError, match="take an earlier one"):
        container.read_container(written(tmp_path / "box", **changed), "test", 1)
