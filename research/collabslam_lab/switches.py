"""The one door to the product's switches, which take a step of the method away to see what it is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from collabslam.settings.table import Settings, checked, schema, switches


def with_switches(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """The settings with changes, of settings or of switches, by full dotted keys.

    Raises
    ------
    SettingsError
        Naming every unknown key, wrong type and value out of range.
    """
    known = switches()
    changed = checked(changes, {**schema(), **known})
    own = {key: value for key, value in changed.items() if key in known}
    moved = {**settings.switches, **own}
    moved = {key: value for key, value in moved.items() if value != known[key].default}
    others = {key: value for key, value in changed.items() if key not in known}
    return replace(settings, values={**settings.values, **others}, switches=moved)
