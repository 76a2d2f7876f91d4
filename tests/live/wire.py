"""A network that loses, delays, reorders and chokes packets: two network namespaces and a relay between them.

Each namespace has one network device (a TUN device) that this process reads and writes, packet by packet.
Needs root, network namespaces and ``/dev/net/tun``.  SIGUSR1 lets nothing pass until the next one comes;
SIGINT ends it with the counts.

    python wire.py NAMESPACE NAMESPACE SECONDS '{"loss": 0.02, "delay_ms": 5}'
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field

ADDRESSES = ("10.77.0.1", "10.77.0.2")
"""Of the first namespace and of the second."""
_NEW_NETWORK, _TUN, _NO_INFORMATION, _SET_DEVICE = 0x40000000, 0x0001, 0x1000, 0x400454CA
_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Wire:
    """How bad the network is, in both directions alike.

    Attributes
    ----------
    loss : float
        Share of packets that are lost.
    burst : float
        Packets that are lost in a row on average.
    delay_ms, jitter_ms : float
        Of each packet; jitter lets packets overtake each other.
    rate_mbit : float
        Bits per second, in millions; 0 for no limit.
    queue_ms : float
        What waits for that rate at most.
    """

    loss: float = 0.0
    burst: float = 1.0
    delay_ms: float = 5.0
    jitter_ms: float = 0.0
    rate_mbit: float = 0.0
    queue_ms: float = 200.0


@dataclass
class Counts:
    """What passed: packets, lost packets, bytes from the first namespace and from the second."""

    packets: int = 0
    lost: int = 0
    sent: list[int] = field(default_factory=lambda: [0, 0])


def possible() -> str:
    """Why there can be no such network on this machine; empty if there can be."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "network namespaces need root on Linux"
    if not os.path.exists("/dev/net/tun"):
        return "there is no /dev/net/tun"
    try:
        with namespaces():
            return ""
    except (OSError, subprocess.CalledProcessError) as error:
        return f"no network namespace can be made ({error})"


@contextmanager
def namespaces() -> Iterator[tuple[str, str]]:
    """Two namespaces, removed afterwards."""
    names = tuple(f"collabslam-{os.getpid()}-{k}" for k in (1, 2))
    made = []
    try:
        for name in names:
            subprocess.run(["ip", "netns", "add", name], check=True, capture_output=True)
            made.append(name)
        yield names[0], names[1]
    finally:
        for name in made:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


def main(first: str, second: str, seconds: float, wire: Wire) -> Counts:
    """Relay for so long, whatever else the machine does: a network does not slow down with its computers."""
    os.nice(-15)
    ends = [_device(first, ADDRESSES[0]), _device(second, ADDRESSES[1])]
    print("up", flush=True)
    return _relay(ends, wire, time.monotonic() + seconds)


def _device(namespace: str, address: str) -> int:
    """A device in a namespace, held from here."""
    home = os.open("/proc/self/ns/net", os.O_RDONLY)
    there = os.open(f"/var/run/netns/{namespace}", os.O_RDONLY)
    _enter(there)
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _SET_DEVICE, struct.pack("16sH14x", b"wire", _TUN | _NO_INFORMATION))
    for command in (
        f"ip addr add {address}/24 dev wire",
        "ip link set wire mtu 1500 up",
        "ip link set lo up",
    ):
        subprocess.run(command.split(), check=True)
    _enter(home)
    return device


def _enter(namespace: int) -> None:
    if _libc.setns(namespace, _NEW_NETWORK) != 0:
        raise OSError(ctypes.get_errno(), "setns")


class Loss:
    """Packets that are lost, in bursts (Gilbert)."""

    def __init__(self, wire: Wire) -> None:
        self._end = 1.0 / wire.burst
        self._begin = self._end * wire.loss / (1.0 - wire.loss)
        self._bad = False

    def next(self) -> bool:
        self._bad = random.random() >= self._end if self._bad else random.random() < self._begin
        return self._bad


def _relay(ends: list[int], wire: Wire, until: float) -> Counts:
    """Until a time, or until SIGINT."""
    counts = Counts()
    with suppress(KeyboardInterrupt):
        _pass(ends, wire, until, counts)
    return counts


def _pass(ends: list[int], wire: Wire, until: float, counts: Counts) -> None:
    random.seed(0)
    dark = [False]
    signal.signal(signal.SIGUSR1, lambda *_: dark.append(not dark.pop()))
    losses, free = [Loss(wire), Loss(wire)], [0.0, 0.0]
    waiting: list[tuple[float, int, int, bytes]] = []
    while (now := time.monotonic()) < until:
        due = min(until, waiting[0][0] if waiting else until)
        ready, _, _ = select.select(ends, [], [], max(0.0, due - now))
        now = time.monotonic()
        for end in ready:
            side = ends.index(end)
            for packet in _packets(end):
                counts.packets += 1
                counts.sent[side] += len(packet)
                if losses[side].next() or dark[0]:
                    counts.lost += 1
                    continue
                at = now
                if wire.rate_mbit:
                    free[side] = max(free[side], now)
                    if free[side] - now > wire.queue_ms / 1e3:
                        counts.lost += 1
                        continue
                    free[side] += len(packet) * 8e-6 / wire.rate_mbit
                    at = free[side]
                at += (wire.delay_ms + abs(random.gauss(0.0, wire.jitter_ms))) / 1e3
                heapq.heappush(waiting, (at, counts.packets, 1 - side, packet))
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, _, side, packet = heapq.heappop(waiting)
            _write(ends[side], packet)


def _packets(end: int) -> Iterator[bytes]:
    with suppress(BlockingIOError):
        for _ in range(64):
            yield os.read(end, 65536)


def _write(end: int, packet: bytes) -> None:
    with suppress(OSError):  # the other side's queue is full: lost, as in any network
        os.write(end, packet)


if __name__ == "__main__":
    asked = json.loads(sys.argv[4])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    found = main(sys.argv[1], sys.argv[2], float(sys.argv[3]), Wire(**asked))
    print(json.dumps(asdict(found)), flush=True)
