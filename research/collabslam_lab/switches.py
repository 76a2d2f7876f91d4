"""The one door to the product's switches, which take a step of the method away to see what it is worth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from collabslam.settings.table import Settings, schema, switches


def with_switches(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """The settings with changes, of settings or of switches, by full dotted keys.

    Raises
    ------
    SettingsError
        Naming every unknown key, wrong type and value out of range.
    """
    return settings.changed(changes, {**schema(), **switches()})
