"""Checkpoints and maps whose header promises what the file does not hold; the checksum is right."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from collabslam.formats import container
from collabslam.runs.results import CHECKPOINT
from collabslam_lab.reliability.attacks.attack import REFUSED, Attack, Deed
from collabslam_lab.reliability.attacks.scene import Scene

_HEAD = struct.Struct("<8sIQ")
Change = Callable[[dict[str, Any]], Any]


def _resealed(data: bytes, change: Change) -> bytes:
    """The file with another header; what a change gives as bytes stands as it is."""
    magic, version, length = _HEAD.unpack_from(data)
    header = change(json.loads(data[_HEAD.size : _HEAD.size + length]))
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return container.seal(_HEAD.pack(magic, version, len(text)) + text + data[_HEAD.size + length :])


def _arrays(*rows: Any) -> Change:
    return lambda header: {**header, "arrays": [*rows, *header["arrays"]]}


def _tree(tree: Any) -> Change:
    return lambda header: {**header, "tree": tree}


def _copies(header: dict[str, Any]) -> dict[str, Any]:
    """The longest array of the file, as bytes, as often as 200 000 words name it."""
    longest = int(np.argmax([np.prod([float(n) for n in shape]) for _, shape in header["arrays"]]))
    return {**header, "tree": [{"bytes": longest}] * 200_000}


HEADERS: dict[str, tuple[str, Change]] = {
    "list": ("a list", lambda _: []),
    "null": ("nothing", lambda _: None),
    "deep": ("lists 100 000 deep", lambda _: b"[" * 100_000),
    "digits": ("a number of 100 000 digits", lambda _: b'{"kind": ' + b"9" * 100_000 + b"}"),
    "no-text": ("no text", lambda _: b"\xff\xfe\xfd"),
    "kind": ("a kind that is a list", lambda header: {**header, "kind": [header["kind"]]}),
    "no-arrays": ("arrays that are a word", lambda header: {**header, "arrays": "none"}),
    "no-shape": ("a shape that is a number", _arrays(["<f8", 3])),
    "sides": ("an array of 100 sides", _arrays(["<f8", [1] * 100])),
    "sides-none": ("an array of 2^70 times nothing", _arrays(["<f8", [0, 1 << 70]])),
    "sides-long": ("an array of 4000 sides of 4000 digits", _arrays(["<f8", [10**3999] * 4000])),
    "negative": ("a negative side", _arrays(["<f8", [-1, -8]])),
    "objects": ("an array of objects", _arrays(["|O", [1]])),
    "texts": ("an array of texts", _arrays(["<U999999999", [1]])),
    "copies": ("one array 200 000 times", _copies),
    "class": ("a class that there is not", _tree({"class": "Popen", "fields": {}})),
    "class-fields": ("a class whose fields are a list", _tree({"class": "Camera", "fields": []})),
    "class-module": ("a class that is a list", _tree({"class": ["os"], "fields": {}})),
    "index": ("an array of the number -1", _tree({"array": -1})),
    "index-word": ("an array of a word for a number", _tree({"array": "0"})),
    "pairs": ("a mapping of one", _tree({"dict": [[1]]})),
    "keys": ("a mapping by lists", _tree({"dict": [[[1], 2]]})),
    "infinite": ("numbers without end", _tree({"dict": [["engine", float("inf")], ["plan", float("nan")]]})),
}


def _made(change: Change, *, of_map: bool) -> Callable[[Scene], Deed]:
    def make(scene: Scene) -> Deed:
        if of_map:
            path = scene.copy("map")
            path.write_bytes(_resealed(path.read_bytes(), change))
            return scene.run("--map", path, "--mode", "mono")
        out = scene.copy("stopped")
        path = out / CHECKPOINT
        path.write_bytes(_resealed(path.read_bytes(), change))
        return scene.command("run", "--resume", out)

    return make


def _attack(name: str, what: str, change: Change, *, of_map: bool) -> Attack:
    group, words = ("map", "a map") if of_map else ("checkpoint", "a checkpoint")
    said = f"{words}: its header is or holds {what}"
    return Attack(group, f"header-{name}", said, _made(change, of_map=of_map), REFUSED)


ATTACKS = tuple(
    _attack(name, what, change, of_map=of_map)
    for of_map in (False, True)
    for name, (what, change) in HEADERS.items()
)
