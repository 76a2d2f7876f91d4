"""The settings file: one YAML with a section for each part, every value known by its dotted key.

The parts own their settings: the filter lists its own through the extension, the front end in
``frontend/settings.py``.  Here they are read, checked, written and hashed.  A full key is
``section.key``, as in ``filter.process.acceleration_density``.
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

from collabslam.errors import SettingsError
from collabslam.formats.yaml_text import load_yaml
from collabslam.settings.setting import Entry, Value, find, shown

Flat = dict[str, Value]

SECTIONS = ("filter", "frontend")
_WIDTH = 108


@cache
def schema() -> dict[str, Entry]:
    """Every setting by its full key, in the order of the file."""
    from collabslam import _core
    from collabslam.settings.frontend import FRONTEND

    lists = {"filter": [_entry(item) for item in _core.settings_schema()], "frontend": FRONTEND}
    return {
        f"{section}.{entry.key}": replace(entry, key=f"{section}.{entry.key}")
        for section in SECTIONS
        for entry in lists[section]
    }


def _entry(item: Mapping[str, Any]) -> Entry:
    """An entry of the filter's own list."""
    choices = tuple(item["choices"] or ())
    kind = "enum" if choices else item["type"]
    return Entry(
        item["key"], kind, item["default"], item["min"], item["max"], item["unit"], choices, item["doc"]
    )


@dataclass(frozen=True)
class Settings:
    """All settings of a run: checked, complete, and not to be changed in place.

    Attributes
    ----------
    values : dict
        Every setting by its full key.
    """

    values: Mapping[str, Value]

    @classmethod
    def default(cls) -> Settings:
        """Every setting at its default."""
        return cls.from_flat({})

    @classmethod
    def load(cls, path: str | Path) -> Settings:
        """Settings of a YAML file; what it leaves out keeps its default.

        Raises
        ------
        SettingsError
            If the file cannot be read, is no YAML, or has faults; all faults are named at once.
        """
        try:
            tree = load_yaml(Path(path).read_text(encoding="utf-8-sig"))
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
            Naming every unknown key, wrong type and value out of range.
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
            Naming every unknown key, wrong type and value out of range.
        """
        known = schema()
        values: Flat = {key: entry.default for key, entry in known.items()}
        faults = [fault for key, value in changes.items() if (fault := _fault(key, value))]
        if faults:
            raise SettingsError(" ".join(faults))
        return cls(values | {key: known[key].checked(value) for key, value in changes.items()})

    def replace(self, changes: Mapping[str, Any]) -> Settings:
        """The same settings with some values changed, by full dotted keys; raises as `from_flat` does."""
        return Settings.from_flat({**self.values, **changes})

    def __getitem__(self, key: str) -> Value:
        """A value by its full key; SettingsError with the nearest name if there is none."""
        return self.values[find(schema(), key).key]

    def section(self, name: str) -> Flat:
        """The values of one section, by keys without the section's name."""
        prefix = name + "."
        return {k.removeprefix(prefix): v for k, v in self.values.items() if k.startswith(prefix)}

    def hash(self) -> str:
        """First 12 hex digits of the SHA-256 of the values as canonical JSON."""
        text = json.dumps(dict(self.values), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def dump(self, *, title: str = "all values") -> str:
        """The settings as commented YAML, which `load` reads back."""
        lines = [f"# collabslam settings: {title}", f"# hash {self.hash()}"]
        groups: tuple[str, ...] = ()
        for key, entry in schema().items():
            *path, name = key.split(".")
            shared = _shared(groups, path)
            for depth in range(shared, len(path)):
                lines += [""] if depth == shared else []
                lines.append("  " * depth + path[depth] + ":")
            groups = tuple(path)
            lines += _comment(entry, "  " * len(path))
            lines.append("  " * len(path) + f"{name}: {_yaml(self.values[key])}")
        return "\n".join(lines) + "\n"


def markdown() -> str:
    """Every setting as a page of Markdown: a table for each group, made from the settings' own lists."""
    lines = ["# Settings", "", "Every setting with its default, unit, range and effect."]
    group = ""
    for key, entry in schema().items():
        head, _, name = key.rpartition(".")
        if head != group:
            group = head
            lines += ["", f"## `{head}`", "", "| setting | default | unit | allowed | effect |"]
            lines += ["| --- | --- | --- | --- | --- |"]
        allowed = entry.allowed().replace("|", "or")
        lines.append(f"| `{name}` | {_yaml(entry.default)} | {entry.unit or '-'} | {allowed} | {entry.doc} |")
    return "\n".join(lines) + "\n"


def parse_assignments(texts: list[str]) -> dict[str, Any]:
    """Changes given as ``key=value``, values read as YAML.

    Raises
    ------
    SettingsError
        If one has no ``=`` or no readable value.
    """
    out = {}
    for text in texts:
        key, sign, value = text.partition("=")
        if not sign or not key.strip():
            raise SettingsError(
                f"'{text}' is no setting; write key=value, as in filter.process.acceleration_density=0.5."
            )
        try:
            out[key.strip()] = load_yaml(value)
        except yaml.YAMLError as error:
            raise SettingsError(
                f"The value in '{text}' cannot be read; write a number, a name, true or false."
            ) from error
    return out


def _fault(key: str, value: Any) -> str:
    """What is wrong with a value, in a sentence; empty if nothing is."""
    try:
        find(schema(), key).checked(value)
    except SettingsError as error:
        return str(error)
    return ""


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


def _comment(entry: Entry, indent: str) -> list[str]:
    unit = f" {entry.unit}" if entry.unit else ""
    text = f"{entry.doc} [{entry.allowed()}{unit}; default {_yaml(entry.default)}]"
    return textwrap.wrap(text, _WIDTH, initial_indent=indent + "# ", subsequent_indent=indent + "# ")


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
