"""A bad network where no namespaces are permitted: a relay of TCP on this machine that delays and stalls.

A stream loses nothing: where a packet is lost, what follows waits until it comes again.  So does a packet's
worth of bytes here, for a round trip and a little more.

    python loopback.py PORT ROBOT'S-PORT SECONDS '{"loss": 0.02, "delay_ms": 5}'

SIGUSR1 lets nothing pass until the next one comes; SIGINT ends it with the counts.
"""

from __future__ import annotations

import json
import queue
import random
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from dataclasses import asdict

from wire import Counts, Loss, Wire

PACKET = 1448
"""Bytes of a packet."""
AGAIN = 0.02
"""Seconds beyond a round trip after which a lost packet comes again."""


class Relay:
    """Passes streams on between the worn camera (side 1) and the robot (side 0)."""

    def __init__(self, wire: Wire) -> None:
        self.counts = Counts()
        self.light = threading.Event()
        self.light.set()
        self._wire, self._losses = wire, [Loss(wire), Loss(wire)]
        self._free = [0.0, 0.0]
        self._lock = threading.Lock()

    def join(self, worn: socket.socket, robot: socket.socket) -> None:
        """Two streams become one, in both directions."""
        for one in (worn, robot):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for side, (source, sink) in enumerate(((robot, worn), (worn, robot))):
            waiting: queue.Queue[tuple[float, bytes]] = queue.Queue(200)
            for work, end in ((self._read, source), (self._write, sink)):
                threading.Thread(target=work, args=(end, waiting, side), daemon=True).start()

    def _read(self, source: socket.socket, waiting: queue.Queue[tuple[float, bytes]], side: int) -> None:
        due, data = 0.0, b" "
        while data:
            try:
                data = source.recv(PACKET)
            except OSError:
                data = b""
            due = max(due, self._due(side, len(data)))
            waiting.put((due, data))

    def _due(self, side: int, size: int) -> float:
        """When a packet comes out at the other end."""
        wire, now = self._wire, time.monotonic()
        with self._lock:
            self.counts.packets += 1
            self.counts.sent[side] += size
            if wire.rate_mbit:
                self._free[side] = now = max(self._free[side], now) + size * 8e-6 / wire.rate_mbit
            late = wire.delay_ms + abs(random.gauss(0.0, wire.jitter_ms))
            while self._losses[side].next():
                self.counts.lost += 1
                late += 2.0 * wire.delay_ms + 1e3 * AGAIN
        return now + late / 1e3

    def _write(self, sink: socket.socket, waiting: queue.Queue[tuple[float, bytes]], side: int) -> None:
        data = b" "
        with suppress(OSError):
            while data:
                due, data = waiting.get()
                time.sleep(max(0.0, due - time.monotonic()))
                self.light.wait()
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)


def main(port: int, robot_port: int, seconds: float, wire: Wire) -> Counts:
    """Relay for so long, or until SIGINT."""
    random.seed(0)
    relay = Relay(wire)
    signal.signal(
        signal.SIGUSR1, lambda *_: relay.light.clear() if relay.light.is_set() else relay.light.set()
    )
    until = time.monotonic() + seconds
    with suppress(KeyboardInterrupt), socket.create_server(("127.0.0.1", port)) as server:
        print("up", flush=True)
        server.settimeout(0.2)
        while time.monotonic() < until:
            with suppress(TimeoutError, ConnectionRefusedError):
                worn, _ = server.accept()
                relay.join(worn, socket.create_connection(("127.0.0.1", robot_port)))
    return relay.counts


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    found = main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), Wire(**json.loads(sys.argv[4])))
    print(json.dumps(asdict(found)), flush=True)
