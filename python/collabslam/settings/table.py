"""All settings of a run in one frozen object, and the file that they are kept in.

The parts own their settings and say what they may be: the filter in Rust (`collabslam._core.FilterSettings`),
the front end in ``settings/frontend.py``.  An attribute of `Settings` is the value with its own type; files,
command lines and messages name it by the same path, as in ``filter.process.acceleration_density``.

Each part also has switches: they take a step of the method away, or put another in its place, so that the lab
can tell what the step is worth.  Files, command lines and documentation do not know them.
"""

from __future__ import annotations

import hashlib
import json
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from collabslam._core import FilterSettings, settings_schema
from collabslam.errors import SettingsError
from collabslam.formats.files import read_text
from collabslam.formats.schema import any_of, fields, flag, number, table, text, whole
from collabslam.formats.yaml_text import load_yaml
from collabslam.settings.frontend import FRONTEND, FrontendSettings
from collabslam.settings.setting import Setting, Value, shown, unknown

Flat = dict[str, Value]

SECTIONS = ("filter", "frontend")
_WIDTH = 108
MOST_FAULTS = 10
"""Faults of settings that one message names."""
_VALUES = table(str, any_of(flag, whole(-(10**9), 10**9), number(), text()))
STATE = fields(values=_VALUES, switches=_VALUES)
"""What `Settings.state` may hold; `Settings.from_state` asks for the ranges."""


@cache
def schema() -> dict[str, Setting]:
    """Every setting by its full key, in the order of the file."""
    return {key: setting for key, setting in _all().items() if setting.when}


@cache
def switches() -> dict[str, Setting]:
    """Every switch of the lab by its full key."""
    return {key: setting for key, setting in _all().items() if not setting.when}


@cache
def _all() -> dict[str, Setting]:
    lists = {"filter": [Setting(*row) for row in settings_schema()], "frontend": FRONTEND}
    return {
        f"{section}.{setting.key}": replace(setting, key=f"{section}.{setting.key}")
        for section in SECTIONS
        for setting in lists[section]
    }


@dataclass(frozen=True)
class Settings:
    """All settings of a run: checked, complete, and not to be changed in place.

    Attributes
    ----------
    filter : FilterSettings
    frontend : FrontendSettings
    """

    filter: FilterSettings
    frontend: FrontendSettings

    @classmethod
    def default(cls) -> Settings:
        """Every setting at its default."""
        return cls(FilterSettings(), FrontendSettings())

    @classmethod
    def or_default(cls, settings: Settings | None) -> Settings:
        """Those given, or every one at its default; raises SettingsError if they are something else."""
        if settings is None:
            return cls.default()
        if not isinstance(settings, cls):
            raise SettingsError(
                f"The settings are a {type(settings).__name__}; give Settings.from_dict(...), "
                "Settings.load(FILE) or None."
            )
        return settings

    @classmethod
    def load(cls, path: str | Path) -> Settings:
        """Settings of a YAML file; what it leaves out keeps its default.

        Raises
        ------
        SettingsError
            If the file cannot be read, is no YAML, or has faults; all faults are named at once.
        """
        try:
            tree = load_yaml(read_text(Path(path)))
        except (OSError, UnicodeDecodeError) as error:
            raise SettingsError(f"The settings file {path} cannot be read: {error}.") from error
        except yaml.YAMLError as error:
            raise SettingsError(
                f"The settings file {path} is not valid YAML: {' '.join(str(error).split())}."
            ) from error
        try:
            return cls.from_dict({} if tree is None else tree)
        except SettingsError as error:
            raise SettingsError(f"The settings file {path} has faults. {error}") from error

    @classmethod
    def from_dict(cls, tree: Any) -> Settings:
        """Settings of a nested mapping (section, then groups by the dots of the keys).

        Raises
        ------
        SettingsError
            Naming the unknown keys, wrong types and values out of range, the first `MOST_FAULTS` of them.
        """
        if not isinstance(tree, Mapping):
            raise SettingsError(
                f"Settings are {shown(tree)}; give a mapping with the sections {', '.join(SECTIONS)}."
            )
        return cls.from_flat(dict(flatten(tree)))

    @classmethod
    def from_flat(cls, changes: Mapping[str, Any]) -> Settings:
        """Settings of full dotted keys; those not given keep their default.

        Raises
        ------
        SettingsError
            Naming the unknown keys, wrong types and values out of range, the first `MOST_FAULTS` of them.
        """
        return cls.default().replace(changes)

    @classmethod
    def from_state(cls, state: Mapping[str, Mapping[str, Any]]) -> Settings:
        """Settings of a `state`; SettingsError if they are not this program's."""
        missing = next((key for key in schema() if key not in state["values"]), None)
        if missing:
            raise SettingsError(f"The setting '{missing}' is missing.")
        return cls.from_flat(state["values"]).changed(state["switches"], switches())

    def state(self) -> dict[str, Flat]:
        """Settings and switches as a checkpoint keeps them, for `from_state`."""
        return {"values": self.values, "switches": self.switches}

    def replace(self, changes: Mapping[str, Any]) -> Settings:
        """The same settings with some values changed, by full dotted keys; raises as `from_flat` does."""
        return self.changed(changes, schema())

    def changed(self, changes: Mapping[str, Any], known: Mapping[str, Setting]) -> Settings:
        """The same settings with some of the known ones changed, by full dotted keys.

        Raises
        ------
        SettingsError
            Naming the unknown keys, wrong types and values out of range, the first `MOST_FAULTS` of them.
        """
        parts: dict[str, Any] = {"filter": self.filter, "frontend": self.frontend}
        faults: list[str] = []
        for name, value in changes.items():
            if len(faults) == MOST_FAULTS:
                faults.append("There are more.")
                break
            setting = known.get(name)
            if setting is None:
                faults.append(unknown(known, name))
                continue
            section, key = name.split(".", 1)
            changed = parts[section].changed(key, setting.read(value))
            if changed is None:
                faults.append(setting.fault(value))
            else:
                parts[section] = changed
        if faults:
            raise SettingsError(" ".join(faults))
        return Settings(**parts)

    def __getitem__(self, key: str) -> Value:
        """A value by its full key, a switch's too; SettingsError with the nearest name if there is none."""
        if key not in _all():
            raise SettingsError(unknown(_all(), key))
        return self._all[key]

    @property
    def values(self) -> Flat:
        """Every setting by its full key, without the switches of the lab."""
        everything = self._all
        return {key: everything[key] for key in schema()}

    @property
    def switches(self) -> Flat:
        """The lab's switches that are not at their defaults, by their full keys."""
        everything = self._all
        return {key: everything[key] for key, s in switches().items() if everything[key] != s.default}

    @property
    def _all(self) -> Flat:
        own = {"filter": self.filter.values(), "frontend": self.frontend.values()}
        return {f"{section}.{key}": value for section in SECTIONS for key, value in own[section].items()}

    def hash(self) -> str:
        """First 12 hex digits of the SHA-256 of values and switches as canonical JSON."""
        text = json.dumps({**self.values, **self.switches}, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def dump(self, *, title: str = "all values") -> str:
        """The settings as commented YAML, which `load` reads back; switches of the lab are comments."""
        lines = [f"# collabslam settings: {title}", f"# hash {self.hash()}"]
        lines += [
            f"# switched for a comparison: {key}: {_yaml(value)}" for key, value in self.switches.items()
        ]
        groups: tuple[str, ...] = ()
        values = self.values
        for key in schema():
            *path, name = key.split(".")
            shared = _shared(groups, path)
            for depth in range(shared, len(path)):
                lines += [""] if depth == shared else []
                lines.append("  " * depth + path[depth] + ":")
            groups = tuple(path)
            lines += _comment(key)
            lines.append("  " * len(path) + f"{name}: {_yaml(values[key])}")
        return "\n".join(lines) + "\n"


def markdown() -> str:
    """Every setting as a page of Markdown: a table for each group, made from the settings' own lists."""
    lines = ["# Settings", "", "Every setting with its default, unit and range, and when to change it."]
    group = ""
    for key, setting in schema().items():
        head, _, name = key.rpartition(".")
        if head != group:
            group = head
            lines += [
                "",
                f"## `{head}`",
                "",
                "| setting | default | unit | allowed | what it is | when to change it |",
            ]
            lines += ["| --- | --- | --- | --- | --- | --- |"]
        allowed = setting.allowed().replace("|", "or")
        facts = [f"`{name}`", _yaml(setting.default), setting.unit or "-", allowed, setting.doc, setting.when]
        lines.append(f"| {' | '.join(facts)} |")
    return "\n".join(lines) + "\n"


def parse_assignments(texts: list[str]) -> dict[str, Any]:
    """Changes given as ``key=value``, values read as YAML.

    Raises
    ------
    SettingsError
        If one has no ``=`` or no readable value.
    """
    out = {}
    for assignment in texts:
        key, sign, value = assignment.partition("=")
        if not sign or not key.strip():
            raise SettingsError(
                f"'{assignment}' is not a setting; write key=value, as in "
                "filter.process.acceleration_density=0.5."
            )
        try:
            out[key.strip()] = load_yaml(value)
        except yaml.YAMLError as error:
            raise SettingsError(
                f"The value in '{assignment}' cannot be read; write a number, a name, true or false."
            ) from error
    return out


def flatten(tree: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Full dotted keys and values of a nested mapping; an empty group is left out."""
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from flatten(value, name + ".")
        elif value is not None or name in schema() or not any(k.startswith(name + ".") for k in schema()):
            yield name, value


def _shared(a: tuple[str, ...], b: list[str]) -> int:
    count = 0
    while count < min(len(a), len(b)) and a[count] == b[count]:
        count += 1
    return count


@cache
def _comment(key: str) -> tuple[str, ...]:
    setting, indent = schema()[key], "  " * key.count(".")
    unit = f" {setting.unit}" if setting.unit else ""
    text = f"{setting.doc} {setting.when} [{setting.allowed()}{unit}; default {_yaml(setting.default)}]"
    return tuple(textwrap.wrap(text, _WIDTH, initial_indent=indent + "# ", subsequent_indent=indent + "# "))


def _yaml(value: Any) -> str:
    """A value as YAML that reads back as itself."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value if yaml.safe_load(value) == value else f'"{value}"'
    text = repr(value)
    if isinstance(value, float) and "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text
