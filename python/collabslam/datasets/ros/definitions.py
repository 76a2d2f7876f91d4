"""Message types as a bag itself defines them: bounded, and with the fields that ROS has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import import_module
from typing import Any, ClassVar

from collabslam.errors import DataError

LONGEST, MOST = 1 << 16, 1 << 20
"""Letters of a type's definition, and of all different ones of a bag, without comments: the longest that is
read has a fiftieth, and a thousand types have half of that."""


@cache
def bound_definitions() -> None:
    """rosbags makes a program of each definition: of one of 4 MB in minutes, with gigabytes."""
    module = import_module("rosbags.highlevel.anyreader")
    for name, comment in (("get_types_from_msg", "#"), ("get_types_from_idl", "//")):
        vars(module)[name] = _Bounded(vars(module)[name], comment)
    opened = module.AnyReader._open

    def anew(reader: Any) -> None:
        _Bounded.known, _Bounded.letters = {}, 0
        opened(reader)

    module.AnyReader._open = anew


class _Bounded:
    """A parser that stops, and parses no text twice, of the bag that is being opened."""

    known: ClassVar[dict[tuple[str, ...], Any]] = {}
    letters: ClassVar[int] = 0

    def __init__(self, parse: Callable[..., Any], comment: str) -> None:
        self._parse, self._comment = parse, comment

    def __call__(self, definition: str, *name: str) -> Any:
        texts = (_without_comments(definition, self._comment), *name)
        if texts not in self.known:
            _Bounded.letters += len(texts[0])
            if len(texts[0]) > LONGEST or self.letters > MOST:
                raise DataError("it defines types longer than any message of ROS")
            self.known[texts] = self._parse(*texts)
        return self.known[texts]


def _without_comments(definition: str, comment: str) -> str:
    """The lines that say something: rosbags parses a comment as slowly as a field."""
    return "".join(
        line
        for line in definition.splitlines(keepends=True)
        if line.strip() and not line.lstrip().startswith(comment)
    )


def check_fields(defined: Mapping[str, Any], ours: Mapping[str, Any], types: Iterable[str]) -> None:
    """Raises DataError if a bag defines one of ``types``, or what is in it, otherwise than ROS does.

    Parameters
    ----------
    defined, ours : mapping
        Of each type its constants and fields, as rosbags has them: of the bag, and of ROS.
    types : iterable of str
        Those that are read; a bag may define more fields than ROS does.
    """
    left, seen = list(types), set[str]()
    while left:
        name = left.pop()
        if name in seen or name not in ours or name not in defined:
            continue
        seen.add(name)
        there = dict(defined[name][1])
        for field, kind in ours[name][1]:
            if there.get(field) != kind:
                raise DataError(f"it defines {field} of {name} otherwise than ROS does")
            left += _named(kind)


def _named(kind: Any) -> list[str]:
    """Types that a field's kind names, in whatever list."""
    if isinstance(kind, str):
        return [kind]
    return [name for part in kind for name in _named(part)] if isinstance(kind, tuple) else []
