"""A bad network for the robot and the worn camera: two namespaces where they are permitted, else loopback."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import loopback as lo
import wire as w


@dataclass(frozen=True)
class Network:
    """Where both ends are, and what is between them.

    Attributes
    ----------
    hosts : dict of str
        HOST:PORT at which the robot listens, and to which the worn camera connects.
    inside : dict of list of str
        What is put before a command of either end.
    relay : Popen
        Its output is `wire.Counts` as JSON.
    """

    hosts: dict[str, str]
    inside: dict[str, list[str]]
    relay: subprocess.Popen[str]


def network(wire: w.Wire) -> AbstractContextManager[Network]:
    """The better of both kinds."""
    return loopback(wire) if w.possible() else namespaces(wire)


@contextmanager
def namespaces(wire: w.Wire) -> Iterator[Network]:
    """Packets are lost, overtake each other and wait."""
    with w.namespaces() as names, _relay(w.__file__, *names, wire=wire) as relay:
        inside = {
            role: ["ip", "netns", "exec", name] for role, name in zip(("robot", "worn"), names, strict=True)
        }
        yield Network(dict.fromkeys(inside, f"{w.ADDRESSES[0]}:7447"), inside, relay)


@contextmanager
def loopback(wire: w.Wire) -> Iterator[Network]:
    """A stream waits."""
    ports = []
    with socket.socket() as one, socket.socket() as other:
        for free in (one, other):
            free.bind(("127.0.0.1", 0))
            ports.append(str(free.getsockname()[1]))
    with _relay(lo.__file__, *reversed(ports), wire=wire) as relay:
        hosts = {role: f"127.0.0.1:{port}" for role, port in zip(("robot", "worn"), ports, strict=True)}
        yield Network(hosts, {"robot": [], "worn": []}, relay)


@contextmanager
def _relay(program: str, *ends: str, wire: w.Wire) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, program, *ends, "180", json.dumps(asdict(wire))]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(program).parent)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        yield process
    finally:
        process.terminate()
        process.wait()
