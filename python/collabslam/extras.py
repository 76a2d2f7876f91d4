"""Libraries that only some commands need, and how to get them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from collabslam.errors import DataError

_LIBRARIES = {"ros": "rosbags", "viz": "rerun-sdk", "plot": "matplotlib"}


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Around the imports of an extra: what is missing becomes a DataError that says how to get it."""
    try:
        yield
    except ImportError as error:
        raise DataError(
            f"This needs {_LIBRARIES[extra]} ({error}); install it with: pip install 'collabslam[{extra}]'."
        ) from error
