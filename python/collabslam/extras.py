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


def drawing() -> bool:
    """Whether pictures can be drawn; says on standard error how to get them where they cannot."""
    if find_spec("matplotlib") is not None:
        return True
    print("no pictures: matplotlib is missing; pip install 'collabslam[plot]'", file=sys.stderr)
    return False


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Around the imports of an extra: what is missing becomes a DataError that says how to get it."""
    try:
        yield
    except ImportError as error:
        raise DataError(
            f"This needs {_LIBRARIES[extra]} ({error}); install it with: pip install 'collabslam[{extra}]'."
        ) from error
