"""Libraries that only some commands need, and how to get them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from collabslam.errors import DataError

_LIBRARIES = {
    "ros": "rosbags",
    "viz": "rerun-sdk",
    "plot": "matplotlib",
    "live": "eclipse-zenoh, cryptography, rosbags and websockets",
}


def how_to_get(extra: str) -> str:
    """How an extra is installed; no registry has the package itself."""
    return f"in the folder of the sources: pip install '.[{extra}]'"


def drawing() -> bool:
    """Whether pictures can be drawn; says on standard error how to get them where they cannot."""
    if find_spec("matplotlib") is not None:
        return True
    print(f"no pictures: matplotlib is missing; {how_to_get('plot')}", file=sys.stderr)
    return False


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Around the imports of an extra: what is missing becomes a DataError that says how to get it."""
    try:
        yield
    except ImportError as error:
        raise DataError(f"This needs {_LIBRARIES[extra]} ({error}); {how_to_get(extra)}.") from error
