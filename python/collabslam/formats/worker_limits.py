"""The end of a helper process: it answers what it is asked, under limits of memory and of processor time.

Questions come on standard input, each after its length (4 bytes, the highest first); answers go likewise.
Whatever a decoder does with somebody else's bytes ends only this process.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from typing import Any, BinaryIO

try:
    import resource
except ImportError:  # a system without such limits
    resource = None  # type: ignore[assignment]

LENGTH = struct.Struct(">I")


def serve(answer: Callable[[bytes], bytes]) -> None:
    """Answer until standard input ends."""
    taken, given = sys.stdin.buffer, sys.stdout.buffer
    while (data := _read(taken)) is not None:
        told = answer(data)
        given.write(LENGTH.pack(len(told)) + told)
        given.flush()


def _read(stream: BinaryIO) -> bytes | None:
    head = stream.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    data = stream.read(length)
    return data if len(data) == length else None


def limit_memory(room: int) -> None:
    """So many bytes beyond what is in use now; neither files nor processes are made from here on."""
    if resource is None:
        return
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        _set(resource.RLIMIT_AS, used + room)
    except OSError:
        pass  # a system that does not tell: its other limits hold
    _set(resource.RLIMIT_FSIZE, 0)
    _set(resource.RLIMIT_CORE, 0)


def limit_time(seconds: int) -> None:
    """Of the processor, for what comes next; a whole second less is sure."""
    if resource is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        _set(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + seconds, soft=True)


def _set(what: Any, value: int, *, soft: bool = False) -> None:
    hard = resource.getrlimit(what)[1]
    within = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(what, (within, hard if soft else within))
