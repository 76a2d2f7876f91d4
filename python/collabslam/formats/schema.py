"""What a tree read from a file may hold: checks of types, shapes and ranges, put together like the tree.

A check is called with a value and the name by which an error speaks of it.  It returns nothing, or raises
`DataError`.  A checksum says that a file is whole, not that whoever wrote it meant well: everything that
`formats.container` reads passes such a check before it is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import Any, NoReturn

import numpy as np

from collabslam.errors import DataError

Check = Callable[[Any, str], None]

LARGEST = 1e15
"""Numbers beyond this are refused wherever no other bound is given: no time, length or count comes near."""


def refuse(where: str, wanted: str) -> NoReturn:
    """Raises DataError: ``where`` is not what is ``wanted``."""
    raise DataError(f"The file's {where} is not {wanted}; take an earlier file.")


def flag(value: Any, where: str) -> None:
    """True or False."""
    if not isinstance(value, bool):
        refuse(where, "true or false")


def data(value: Any, where: str) -> None:
    """Bytes."""
    if not isinstance(value, bytes):
        refuse(where, "bytes")


def whole(low: int, high: int = int(LARGEST)) -> Check:
    """A whole number from ``low`` to ``high``."""

    def check(value: Any, where: str) -> None:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            refuse(where, f"a whole number from {low} to {high}")

    return check


def number(low: float = -LARGEST, high: float = LARGEST, *, nan: bool = False) -> Check:
    """A number from ``low`` to ``high``; one that is missing (NaN) only with ``nan``."""

    def check(value: Any, where: str) -> None:
        real = isinstance(value, int | float) and not isinstance(value, bool)
        if not real or not (low <= value <= high or (nan and math.isnan(value))):
            refuse(where, f"a number from {low:g} to {high:g}")

    return check


def text(choices: Collection[str] | None = None) -> Check:
    """A text, one of ``choices`` where they are given."""

    def check(value: Any, where: str) -> None:
        if not isinstance(value, str) or "\0" in value:
            refuse(where, "a text")
        if choices is not None and value not in choices:
            refuse(where, f"one of {', '.join(choices)}")

    return check


def optional(check: Check) -> Check:
    """None, or what ``check`` lets pass."""
    return lambda value, where: None if value is None else check(value, where)


def array(dtype: str, *shape: int | None, nan: bool = False) -> Check:
    """An array of that type and shape, None where a side may have any length; finite unless ``nan``."""
    sides = "x".join("any" if n is None else str(n) for n in shape)
    wanted, kind = f"a {sides} array of {dtype}", np.dtype(dtype)

    def check(value: Any, where: str) -> None:
        if not isinstance(value, np.ndarray) or value.dtype != kind or value.ndim != len(shape):
            refuse(where, wanted)
        if any(n is not None and n != m for n, m in zip(shape, value.shape, strict=True)):
            refuse(where, wanted)
        if value.dtype.kind == "f" and not nan and not bool((np.abs(value) <= LARGEST).all()):
            refuse(where, f"{wanted} without numbers beyond all bounds")

    return check


def items(check: Check, length: int | None = None) -> Check:
    """A list or tuple, each item of which passes ``check``."""

    def check_all(value: Any, where: str) -> None:
        if not isinstance(value, list | tuple) or (length is not None and len(value) != length):
            refuse(where, "a list" if length is None else f"a list of {length}")
        for k, item in enumerate(value):
            check(item, f"{where}[{k}]")

    return check_all


def table(key: type, check: Check) -> Check:
    """A dictionary from keys of one type to values that pass ``check``."""

    def check_all(value: Any, where: str) -> None:
        if not isinstance(value, dict) or not all(type(k) is key for k in value):
            refuse(where, f"a table by {key.__name__}")
        for k, item in value.items():
            check(item, f"{where}[{k!r}]")

    return check_all


def pose(value: Any, where: str) -> None:
    """A (4, 4) rigid transform, not farther than 1e9 m."""
    _transform(value, where)
    turned = value[:3, :3] @ value[:3, :3].T
    rigid = np.abs(turned - np.eye(3)).max() < 1e-6 and np.linalg.det(value[:3, :3]) > 0.0
    if not rigid or np.abs(value[:3, 3]).max() > 1e9 or not np.array_equal(value[3], [0.0, 0.0, 0.0, 1.0]):
        refuse(where, "a pose")


_transform = array("<f8", 4, 4)


def covariance(size: int | None) -> Check:
    """A symmetric matrix with a diagonal that is not negative, of that size or any."""
    square = array("<f8", size, size)

    def check(value: Any, where: str) -> None:
        square(value, where)
        if (
            value.shape[0] != value.shape[1]
            or (np.diag(value) < 0.0).any()
            or not np.allclose(value, value.T)
        ):
            refuse(where, "a covariance")

    return check


def instance(kind: type, **checks: Check) -> Check:
    """An instance of a dataclass whose attributes pass the checks."""

    def check_all(value: Any, where: str) -> None:
        if type(value) is not kind:
            refuse(where, f"a {kind.__name__}")
        for name, check in checks.items():
            check(getattr(value, name), f"{where}.{name}")

    return check_all


def fields(**checks: Check) -> Check:
    """A dictionary with these keys and no others."""

    def check_all(value: Any, where: str) -> None:
        if not isinstance(value, dict) or set(value) != set(checks):
            refuse(where, f"a record of {', '.join(checks)}")
        for name, check in checks.items():
            check(value[name], f"{where}.{name}")

    return check_all


def any_of(*checks: Check) -> Check:
    """What at least one of the checks lets pass."""

    def check(value: Any, where: str) -> None:
        if not any(_passes(one, value) for one in checks):
            refuse(where, "of a kind that can stand there")

    return check


def _passes(check: Check, value: Any) -> bool:
    try:
        check(value, "")
    except DataError:
        return False
    return True


PLAIN_VALUE = any_of(optional(flag), whole(-int(LARGEST)), number(nan=True), text())
"""None, a flag, a number or a text."""


def plain(value: Any, where: str) -> None:
    """Values of JSON, nested at will."""
    if isinstance(value, dict):
        table(str, plain)(value, where)
    elif isinstance(value, list | tuple):
        items(plain)(value, where)
    else:
        PLAIN_VALUE(value, where)
