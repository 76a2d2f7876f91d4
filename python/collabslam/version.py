"""The version of the installed package."""

from __future__ import annotations

from importlib import metadata


def version() -> str:
    """Version as installed; ``0+source`` where the package runs from its sources, not installed."""
    try:
        return metadata.version("collabslam")
    except metadata.PackageNotFoundError:
        return "0+source"
