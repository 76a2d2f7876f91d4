"""One file for values of any shape: numbers, texts, arrays and trees of them, with version and checksum.

::

    magic "CLABBOX\\n" | version u32 | length of header u64 | header | arrays | SHA-256 of all before

All little endian.  The header is JSON: what the file is, the tree, and type and shape of every array; the
arrays follow as raw numbers.  Reading checks every size against the file's before it takes memory, and runs
no code: nothing but the types below comes out.  A file is written beside its place, flushed and moved.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collabslam.errors import DataError
from collabslam.formats.files import read_bytes, write_bytes

MAGIC = b"CLABBOX\n"
VERSION = 1
_HEAD = struct.Struct("<8sIQ")
_CHECKSUM = 32
_LARGEST = 1 << 32
"""Bytes of a file: a checkpoint has about a kilobyte for each frame that was done."""
_SIDES = 32
"""Of an array, at most."""
_DTYPES = ("|b1", "|u1", "<i4", "<i8", "<f4", "<f8")
_ARRAY, _BYTES, _TUPLE, _DICT, _CLASS = "array", "bytes", "tuple", "dict", "class"


def write_container(path: Path, kind: str, version: int, content: Any, classes: Sequence[type] = ()) -> None:
    """Write a tree into one file.

    Parameters
    ----------
    path : Path
    kind, version
        What the file is, and which version of it; the reader must ask for both.
    content
        None, bool, int, float, str, bytes, arrays of numbers, and lists, tuples and dicts (keys str or int)
        of such; instances of ``classes`` too.
    classes
        Dataclasses that may be in it.

    Raises
    ------
    DataError
        If the file cannot be written.
    TypeError
        If the content has something else in it.
    """
    arrays = _Arrays(classes)
    tree = arrays.encode(content)
    shapes = [[a.dtype.str, list(a.shape)] for a in arrays.kept]
    header = json.dumps({"kind": kind, "version": version, "arrays": shapes, "tree": tree}).encode()
    parts = [_HEAD.pack(MAGIC, VERSION, len(header)), header, *(a.tobytes() for a in arrays.kept)]
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    write_bytes(path, b"".join([*parts, digest.digest()]), durable=True)


def read_container(path: Path, kind: str, version: int, classes: Sequence[type] = ()) -> Any:
    """The content of a file that `write_container` wrote; arrays are read-only.

    Raises
    ------
    DataError
        If the file cannot be read, is cut short, altered, of another kind or version.
    """
    try:
        data = read_bytes(path, _LARGEST)
    except OSError as error:
        raise DataError(f"The file {path} cannot be read ({error.strerror}); give another one.") from error
    try:
        return _decode(data, kind, version, classes)
    except DataError as error:
        raise DataError(f"The file {path} {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise DataError(f"The file {path} does not hold what its kind says; take an earlier one.") from error


def seal(data: bytes) -> bytes:
    """A file's bytes with the checksum that belongs to the rest: what gets altered content past it."""
    body = data[:-_CHECKSUM]
    return body + hashlib.sha256(body).digest()


def _decode(data: bytes, kind: str, version: int, classes: Sequence[type]) -> Any:
    if len(data) < _HEAD.size + _CHECKSUM:
        raise DataError(
            "is cut short; take an earlier one." if MAGIC.startswith(data[:8]) else _foreign(kind)
        )
    magic, container, length = _HEAD.unpack_from(data)
    if magic != MAGIC:
        raise DataError(_foreign(kind))
    if container != VERSION:
        raise DataError(_newer(container, VERSION))
    end = len(data) - _CHECKSUM
    if length > end - _HEAD.size:
        raise DataError("is cut short; take an earlier one.")
    body = memoryview(data)
    if hashlib.sha256(body[:end]).digest() != data[end:]:
        raise DataError("was altered or cut short, its checksum is wrong; take an earlier one.")
    header = json.loads(data[_HEAD.size : _HEAD.size + length])
    if header["kind"] != kind:
        raise DataError(_foreign(kind))
    if header["version"] != version:
        raise DataError(_newer(header["version"], version))
    arrays, at = [], _HEAD.size + length
    for dtype, shape in header["arrays"]:
        sides = len(shape) <= _SIDES and all(isinstance(n, int) and 0 <= n <= _LARGEST for n in shape)
        if dtype not in _DTYPES or not sides:
            raise DataError("holds an array of an unknown type; take an earlier one.")
        count = math.prod(shape)
        size = count * np.dtype(dtype).itemsize
        if size > end - at:
            raise DataError("is smaller than its header says; take an earlier one.")
        arrays.append(np.frombuffer(data, dtype, count, at).reshape(shape))
        at += size
    if at != end:
        raise DataError("is larger than its header says; take an earlier one.")
    return _Trees(arrays, classes).decode(header["tree"])


def _foreign(kind: str) -> str:
    return f"is not {'an' if kind[0] in 'aeiou' else 'a'} {kind} of collabslam; give one."


def _newer(found: Any, known: int) -> str:
    return f"has version {found}, this program reads version {known}; use the collabslam that wrote it."


class _Arrays:
    """Turns a tree into JSON and a list of arrays; an array that is met twice is kept once."""

    def __init__(self, classes: Sequence[type]) -> None:
        self._classes = {c.__name__: c for c in classes}
        self._places: dict[int, int] = {}
        self._held: list[Any] = []
        self.kept: list[NDArray[Any]] = []

    def encode(self, value: Any) -> Any:
        if value is None or isinstance(value, bool | str):
            return value
        if isinstance(value, np.bool_ | np.integer | np.floating):
            return value.item()
        if isinstance(value, int | float):
            return value
        if isinstance(value, list):
            return [self.encode(v) for v in value]
        if isinstance(value, tuple):
            return {_TUPLE: [self.encode(v) for v in value]}
        if isinstance(value, Mapping):
            return {_DICT: [[_key(k), self.encode(v)] for k, v in value.items()]}
        if isinstance(value, np.ndarray):
            return {_ARRAY: self._place(value, value)}
        if isinstance(value, bytes):
            return {_BYTES: self._place(value, np.frombuffer(value, np.uint8))}
        name = type(value).__name__
        if self._classes.get(name) is type(value) and dataclasses.is_dataclass(value):
            fields = {f.name: self.encode(getattr(value, f.name)) for f in dataclasses.fields(value)}
            return {_CLASS: name, "fields": fields}
        raise TypeError(f"a {name} cannot be kept in a file")

    def _place(self, owner: Any, array: NDArray[Any]) -> int:
        if id(owner) not in self._places:
            little = array.dtype.newbyteorder("<") if array.dtype.byteorder == ">" else array.dtype
            if little.str not in _DTYPES:
                raise TypeError(f"an array of {array.dtype} cannot be kept in a file")
            self._places[id(owner)] = len(self.kept)
            self._held.append(owner)  # lest another one gets its id
            self.kept.append(np.ascontiguousarray(array, little).reshape(array.shape))
        return self._places[id(owner)]


class _Trees:
    """The other way round."""

    def __init__(self, arrays: Sequence[NDArray[Any]], classes: Sequence[type]) -> None:
        self._arrays = arrays
        self._bytes: dict[int, bytes] = {}
        self._classes = {c.__name__: c for c in classes}

    def decode(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self.decode(v) for v in value]
        if not isinstance(value, dict):
            return value
        if _ARRAY in value:
            return self._array(value[_ARRAY])
        if _BYTES in value:
            return self._raw(value[_BYTES])
        if _TUPLE in value:
            return tuple(self.decode(v) for v in value[_TUPLE])
        if _DICT in value:
            return {_key(k): self.decode(v) for k, v in value[_DICT]}
        fields = {k: self.decode(v) for k, v in value["fields"].items()}
        return self._classes[value[_CLASS]](**fields)

    def _raw(self, index: int) -> bytes:
        """The bytes of an array, which a tree may name as often as it likes."""
        if index not in self._bytes:
            self._bytes[index] = self._array(index).tobytes()
        return self._bytes[index]

    def _array(self, index: int) -> NDArray[Any]:
        if not 0 <= index < len(self._arrays):
            raise DataError("names an array that it does not hold; take an earlier one.")
        return self._arrays[index]


def _key(key: Any) -> Any:
    if not isinstance(key, str | int) or isinstance(key, bool):
        raise TypeError(f"a key of the type {type(key).__name__} cannot be kept in a file")
    return key
