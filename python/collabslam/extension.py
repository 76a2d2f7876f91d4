"""Whether the compiled part of the package is there, and is that of these sources.

New sources without a new build, as ``git pull`` leaves them, would end somewhere in the middle, in an error
that says nothing of that.  What the stub describes is compared with what there is: two milliseconds, once.
"""

from __future__ import annotations

import re
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

from collabslam.errors import DataError

STUB = Path(__file__).with_name("_core.pyi")
_BUILD = "build it: 'pip install .' in the folder of the sources ('make .venv/.core' where make installed it)"
_DEFINED = re.compile(r"^(?:class (\w+):|( *)def (\w+)\((.*?)\) ->)", re.MULTILINE | re.DOTALL)
_SIGNATURE = "__text_signature__"
_BRACKETS = re.compile(r"\[[^\[\]]*\]")
_PARAMETER = re.compile(r"(?:^|,)\s*\$?(\*{0,2}\w+)")


@lru_cache(maxsize=1)
def check_extension() -> None:
    """Raises DataError, which says what to do, if ``collabslam._core`` is not there, or is another one."""
    try:
        core = import_module("collabslam._core")
    except ImportError as error:
        raise DataError(f"The compiled part of collabslam is not there ({error}); {_BUILD}.") from error
    lacks = first_difference(core, STUB.read_text(encoding="utf-8")) if STUB.is_file() else None
    if lacks is not None:
        raise DataError(
            f"The compiled part of collabslam is of other sources than its Python part ('{lacks}' differs), "
            f"as after 'git pull'; {_BUILD}."
        )


def first_difference(core: Any, stub: str) -> str | None:
    """The first name that a stub describes and a module lacks, or has with other parameters; None if none."""
    owner, name = core, ""
    found: list[tuple[str, str, str, str]] = _DEFINED.findall(stub)
    for of_class, indent, function, parameters in found:
        if of_class:
            name, owner = of_class, getattr(core, of_class, None)
            if owner is None:
                return name
            continue
        where = owner if indent else core
        told = f"{name}.{function}" if indent else function
        if not hasattr(where, function):
            return told
        if function.startswith("__") and function != "__new__":
            continue
        signature = getattr(where if function == "__new__" else getattr(where, function), _SIGNATURE, None)
        if signature and _names(signature[1:-1]) != _names(parameters):
            return told
    return None


def _names(parameters: str) -> list[str]:
    while (shorter := _BRACKETS.sub("", parameters)) != parameters:
        parameters = shorter
    return [name for name in _PARAMETER.findall(parameters) if name not in ("self", "cls")]
