"""The plan of a batch: recordings, how each is opened, in which modes it is run, with which settings."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from collabslam.datasets.overrides import Given
from collabslam.datasets.source import Source, WornSpec
from collabslam.errors import SettingsError
from collabslam.formats.files import read_text
from collabslam.formats.yaml_text import load_yaml
from collabslam.settings.modes import MODES, STARTS
from collabslam.settings.table import Settings, flatten

NAME = r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}"
"""What an entry may be called: its result folder is called so, too."""
_FILES = ("camera", "times", "poses")
_TEXTS = ("source", "worn", "start", *_FILES)
KEYS = (*_TEXTS, "modes", "seed", "max_frames", "settings")


@dataclass(frozen=True)
class Entry:
    """A recording of a plan.

    Attributes
    ----------
    name : str
    source : Source
    modes : tuple of str or None
        None is the one that a run takes by itself.
    start : str or None
        As of `collabslam.run`.
    settings : mapping
        Changes of the defaults, by full dotted keys.
    """

    name: str
    source: Source
    modes: tuple[str | None, ...] = (None,)
    start: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)


def read_plan(path: Path) -> tuple[Entry, ...]:
    """The entries of a plan: YAML with ``recordings``, names and their `KEYS`, and ``defaults`` of these.

    Paths are relative to the plan's folder; the ``source`` is the name where none is given.

    Raises
    ------
    SettingsError
        Naming the entry and what is wrong with it.
    """
    try:
        tree = load_yaml(read_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"The plan {path} cannot be read: {error}.") from error
    except yaml.YAMLError as error:
        raise SettingsError(f"{path} is not valid YAML: {' '.join(str(error).split())}.") from error
    top = mapping_of(tree, str(path), ("defaults", "recordings"))
    shared = mapping_of(top.get("defaults") or {}, f"{path}, defaults", KEYS)
    recordings = mapping_of(top.get("recordings") or {}, f"{path}, recordings", None)
    if not recordings:
        raise SettingsError(f"{path} names no recordings; list them under 'recordings'.")
    entries = []
    for name, given in recordings.items():
        where = f"{path}, {name}"
        if not re.fullmatch(NAME, str(name)):
            raise SettingsError(f"{where}: nothing can be called so; take letters, digits, _, . and -.")
        own = mapping_of(given or {}, where, KEYS)
        entries.append(_entry(str(name), {**shared, **own}, path.parent, where))
    return tuple(entries)


def _entry(name: str, given: Mapping[str, Any], folder: Path, where: str) -> Entry:
    for key in _TEXTS:
        if given.get(key) is not None and not isinstance(given[key], str):
            raise SettingsError(f"{where}, {key} is {given[key]!r}; give a text.")
    files = {key: folder / given[key] for key in _FILES if given.get(key)}
    start = given.get("start")
    if start is not None and start not in STARTS:
        raise SettingsError(f"{where}, start is {start!r}; give one of {', '.join(STARTS)}.")
    seed = _count(given.get("seed", 0), f"{where}, seed", 0)
    worn = None if given.get("worn") is None else WornSpec(given["worn"], seed=seed)
    most = given.get("max_frames")
    frames = None if most is None else _count(most, f"{where}, max_frames", 1)
    source = Source(folder / (given.get("source") or name), Given(**files), worn, frames)
    return Entry(
        name, source, _modes(given.get("modes"), where), start, _settings(given.get("settings"), where)
    )


def _modes(value: Any, where: str) -> tuple[str | None, ...]:
    if value is None:
        return (None,)
    modes = [value] if isinstance(value, str) else value
    if not isinstance(modes, list) or not modes or not all(mode in MODES for mode in modes):
        raise SettingsError(f"{where}, modes is {value!r}; give a list of {', '.join(MODES)}.")
    return tuple(dict.fromkeys(modes))


def _settings(value: Any, where: str) -> dict[str, Any]:
    try:
        changes = dict(flatten(value or {}))
        settings = Settings.default().replace(changes)
    except (SettingsError, AttributeError) as error:
        raise SettingsError(f"{where}, settings: {error}") from error
    return {key: settings[key] for key in changes}


def _count(value: Any, where: str, least: int) -> int:
    if type(value) is not int or value < least:
        raise SettingsError(f"{where} is {value!r}; give a whole number from {least} on.")
    return value


def mapping_of(value: Any, where: str, known: Sequence[str] | None) -> Mapping[str, Any]:
    """A mapping of a plan; raises SettingsError if it is none, or has a name that is not ``known``."""
    if not isinstance(value, Mapping):
        raise SettingsError(f"{where} is not a mapping of names to values.")
    for key in value:
        if known is not None and key not in known:
            near = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"it takes {', '.join(known)}."
            raise SettingsError(f"{where} has no option '{key}'; {hint}")
    return value
