"""What there is to know of one setting, and whether a value is allowed for it."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from collabslam.errors import SettingsError

Value = bool | int | float | str


@dataclass(frozen=True)
class Setting:
    """One setting, or one switch of the lab.

    Attributes
    ----------
    key : str
        Dotted key.
    kind : str
        ``float``, ``int``, ``bool`` or ``enum``.
    default : bool, int, float or str
    low, high : float or None
        Range, both ends allowed.
    unit : str
    choices : tuple of str
        Of an ``enum``.
    doc : str
        What it is.
    when : str
        The case in which to change it, in a sentence; empty for a switch of the lab.
    """

    key: str
    kind: str
    default: Value
    low: float | None
    high: float | None
    unit: str
    choices: tuple[str, ...]
    doc: str
    when: str = ""

    def allowed(self) -> str:
        """The range or the choices, in words."""
        if self.kind == "bool":
            return "true or false"
        if self.choices:
            return " | ".join(self.choices)
        if self.low is not None and self.high is not None:
            return f"{self.low:g} to {self.high:g}"
        if self.low is not None:
            return f"{self.low:g} or more"
        return f"{self.high:g} or less" if self.high is not None else "any number"

    def checked(self, value: Any) -> Value:
        """``value`` as this setting's type.

        Raises
        ------
        SettingsError
            If the type is wrong or the value is not allowed.
        """
        accepted = self.accepted(value)
        if accepted is None:
            raise SettingsError(self.fault(value))
        return accepted

    def fault(self, value: Any) -> str:
        """Why a value is not allowed, in a sentence."""
        unit = f" {self.unit}" if self.unit and self.kind in ("int", "float") else ""
        wanted = {"int": "a whole number, ", "float": "a number, ", "enum": "one of "}.get(self.kind, "")
        return f"'{self.key}' is {shown(value)}; it must be {wanted}{self.allowed()}{unit}."

    def read(self, value: Any) -> Any:
        """``value``; where a number is wanted also a written one, as YAML 1.1 takes 1e-5 for a text."""
        return _number(value) if self.kind in ("int", "float") else value

    def accepted(self, value: Any) -> Value | None:
        """``value`` as this setting's type, None if it is not allowed."""
        value = self.read(value)
        if self.kind == "bool":
            return value if isinstance(value, bool) else None
        if self.kind == "enum":
            return value if isinstance(value, str) and value in self.choices else None
        if value is None or not math.isfinite(value):
            return None
        if (self.low is not None and value < self.low) or (self.high is not None and value > self.high):
            return None
        if self.kind == "float":
            return float(value)
        return int(value) if value.is_integer() else None


def unknown(known: Mapping[str, Setting], key: str) -> str:
    """That there is no setting of this key, in a sentence with the nearest name."""
    near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.5)
    if not near:  # the section, or the groups, may have been left out
        last = str(key).rsplit(".", 1)[-1]
        near = [k for k in known if k.rsplit(".", 1)[-1] == last][:1]
    hint = f"did you mean '{near[0]}'?" if near else "'collabslam settings show' lists them all."
    return f"There is no setting '{key}'; {hint}"


def shown(value: Any) -> str:
    """A value as a message quotes it."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"'{value}'" if isinstance(value, str) else repr(value)


def _number(value: Any) -> float | None:
    """A number, also a written one; None if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except (ValueError, OverflowError):
        return None
