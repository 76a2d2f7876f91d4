"""rosbags with decompressors that stop: its own unpack whatever a chunk of a few bytes asks for.

`bound_decompression` puts them in the place of its own, for the whole process; `bound_databases` has SQLite
compute nothing that a file of a few bytes asks for, and `leave_qos_alone` lets it not parse what nobody asks:
how topics were offered, which may be megabytes of YAML.
"""

from __future__ import annotations

import bz2
from collections.abc import Callable
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from collabslam.errors import DataError

ALWAYS, RATIO = 1 << 28, 100
"""Bytes that any compressed piece may hold, and so many more for each of its own bytes."""
_COMPUTED = (
    "SELECT 1 FROM sqlite_master m, pragma_table_xinfo(m.name) c WHERE m.type = 'table' AND c.hidden > 1"
)


def decompressed(data: bytes, make: Callable[[], Any]) -> bytes:
    """The content of a compressed piece, which may be several frames one after the other.

    Parameters
    ----------
    data : bytes
    make : callable
        A new decompressor, as those of `bz2`.

    Raises
    ------
    DataError
        If it holds more than `ALWAYS` and `RATIO` allow, or is cut short.
    """
    most, parts, total = most_bytes(len(data)), [], 0
    rest = data
    while rest:
        machine = make()
        piece = machine.decompress(rest, max_length=most - total + 1)
        while True:
            parts.append(piece)
            total += len(piece)
            if total > most:
                raise too_much(len(data))
            if machine.eof:
                break
            if not piece and machine.needs_input:
                raise DataError("a compressed piece is cut short")
            piece = machine.decompress(b"", max_length=most - total + 1)
        rest = machine.unused_data or b""
    return b"".join(parts)


def most_bytes(compressed: int) -> int:
    """Bytes that so many compressed ones may hold."""
    return ALWAYS + RATIO * compressed


def too_much(compressed: int) -> DataError:
    """The error for a piece that holds more."""
    return DataError(
        f"{compressed} compressed bytes hold more than {most_bytes(compressed) >> 20} MB; record it without "
        "compression"
    )


class _Limited:
    """A file being decompressed that stops; a context manager as the one it reads from."""

    def __init__(self, file: Any, compressed: int) -> None:
        self._file, self._compressed, self._total = file, compressed, 0

    def __enter__(self) -> _Limited:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, size: int = -1) -> bytes:
        if size < 0:
            size = most_bytes(self._compressed) + 1
        data = bytes(self._file.read(size))
        self._total += len(data)
        if self._total > most_bytes(self._compressed):
            raise too_much(self._compressed)
        return data


@cache
def bound_decompression() -> None:
    """Replace rosbags's decompressors; once is enough."""
    ros1, ros2, mcap, lz4 = (
        import_module(name)
        for name in (
            "rosbags.rosbag1.reader",
            "rosbags.rosbag2.reader",
            "rosbags.rosbag2.storage_mcap",
            "lz4.frame",
        )
    )
    zstd = ros2.zstd

    class Zstd:
        """What rosbags uses of the module of that name."""

        @staticmethod
        def decompress(data: bytes) -> bytes:
            return decompressed(data, zstd.ZstdDecompressor)

        @staticmethod
        def open(file: Any, mode: str) -> _Limited:
            compressed = file.seek(0, 2)
            file.seek(0)
            return _Limited(zstd.open(file, mode), compressed)

    vars(ros2)["zstd"] = Zstd
    lz4_machine = lz4.LZ4FrameDecompressor
    mcap.DECOMPRESSORS["zstd"] = lambda data, _: Zstd.decompress(data)
    mcap.DECOMPRESSORS["lz4"] = lambda data, _: decompressed(data, lz4_machine)
    ros1.decompressors["bz2"] = lambda data: decompressed(data, bz2.BZ2Decompressor)
    ros1.decompressors["lz4"] = lambda data: decompressed(data, lz4_machine)


@cache
def leave_qos_alone() -> None:
    """Readers learn nothing of how topics were offered."""
    for name in ("reader", "storage_mcap", "storage_sqlite3"):
        module = import_module(f"rosbags.rosbag2.{name}")
        module.parse_qos = lambda _: []  # type: ignore[attr-defined]


@cache
def bound_databases() -> None:
    """No value of a SQLite bag is longer than `ALWAYS`, or computed: what a view gives may be endless."""
    storage = import_module("rosbags.rosbag2.storage_sqlite3")
    apsw = import_module("apsw")

    def allowed(action: int, _: str | None, __: str | None, ___: str | None, by: str | None) -> int:
        computed = by is not None or action == apsw.SQLITE_RECURSIVE
        return int(apsw.SQLITE_DENY if computed else apsw.SQLITE_OK)

    def connection(*words: Any, **options: Any) -> Any:
        opened = apsw.Connection(*words, **options)
        opened.limit(apsw.SQLITE_LIMIT_LENGTH, ALWAYS)
        if opened.execute(_COMPUTED).fetchall():
            raise apsw.SQLError("its tables hold what is computed; export them as they are")
        opened.authorizer = allowed
        return opened

    vars(storage)["apsw"] = SimpleNamespace(**{**vars(apsw), "Connection": connection})
