"""Files of inertial samples: rows of stamp, rate and maybe acceleration, and the logs that phones write.

Without a header the columns are ``stamp, wx, wy, wz`` (rad/s) and maybe ``ax, ay, az`` (m/s^2).  A header
names them: EuRoC's, Sensor Logger's ``Gyroscope.csv``, phyphox's, MARS logger's, and what is like them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam.datasets.gate import data_lines, is_number, tell, text_of
from collabslam.datasets.units import as_seconds, read_stamps
from collabslam.errors import DataError
from collabslam.types import Array

_RATES = re.compile(r"(?:w|wrss|rate|omega|gyr|gyro|gyroscope|angularvelocity|angvel|rotationrate)([xyz])")
_FORCES = re.compile(
    r"(?:a|arss|acc|accel|accelerometer|acceleration|linearacceleration|totalacceleration)([xyz])"
)
_PLAIN = re.compile(r"g?([xyz])")
"""Columns of a file of rates alone: Sensor Logger's, MARS logger's."""
_STAMPS = ("timestamp", "stamp", "time", "t", "ts", "unixtime", "secondselapsed")
"""Columns of stamps, the best first."""
_UNITS = {"ns": "nanoseconds", "nanosec": "nanoseconds", "us": "microseconds", "ms": "milliseconds"} | {
    "s": "seconds"
}
_DEGREES = re.compile(r"deg|\u00b0|\bdps\b", re.IGNORECASE)
_LONGEST = 0.2
"""Seconds between samples of a gyroscope, see `units.read_stamps`."""
_FEW = 20
"""One line in so many may be broken."""
_SHOULD = "give a CSV of stamp, wx, wy, wz (rad/s) and maybe ax, ay, az (m/s^2)"


@dataclass(frozen=True)
class Table:
    """What a file holds, unchecked.

    Attributes
    ----------
    clocks : list of (N,) arrays
        Stamps, seconds, by each clock that the file tells, the best first.
    rates : (N, 3) float64
    accelerations : (N, 3) float64 or None
    phone : bool
        Whether it is a phone's log, along the phone's own axes.
    """

    clocks: list[Array]
    rates: Array
    accelerations: Array | None
    phone: bool = False


@dataclass(frozen=True)
class _Columns:
    """Where in a line what stands: columns of clocks with their units, of rates, of accelerations."""

    stamps: list[tuple[int, str | None]]
    rates: list[int]
    forces: list[int]
    phone: bool = False

    @property
    def least(self) -> int:
        return max([k for k, _ in self.stamps] + self.rates + self.forces) + 1


def read_table(path: Path, usual: str | None = None) -> Table:
    """The samples of a text file; ``usual`` is the unit of its stamps, see `units.read_stamps`.

    Single lines that are broken, such as the last one of a program that was killed, are left out and told.

    Raises
    ------
    DataError
        If the file cannot be read, holds something else, or its header says degrees.
    """
    text = text_of(path)
    _refuse_others(text, path)
    header = _header(text)
    lines = data_lines(path)
    if not lines:
        raise DataError(f"The file {path} holds no samples of a gyroscope; {_SHOULD}.")
    columns = _by_count(lines[0][1], path, usual) if header is None else _by_names(header, path)
    whole, broken, first = [], 0, 0
    for number, fields in lines:
        if len(fields) < columns.least or not all(map(is_number, fields[: columns.least])):
            broken += 1
            first = number if broken == 1 else first
        else:
            whole.append((number, fields))
    if broken * _FEW > len(lines) or not whole:
        raise DataError(
            f"Line {first} of {path} has not the numbers of its columns ({columns.least} are needed), and so "
            f"have {broken} of {len(lines)}; {_SHOULD}."
        )
    if broken:
        tell("passed over", f"{broken} lines (broken)", path)
    numbers = [n for n, _ in whole]
    table = np.array([[float(x) for x in fields[: columns.least]] for _, fields in whole])
    clocks = []
    for k, unit in columns.stamps:
        texts = [fields[k] for _, fields in whole]
        stamps = read_stamps(texts, str(path), lines=numbers, usual=unit, longest=_LONGEST)
        clocks.append(as_seconds(stamps))
    forces = table[:, columns.forces] if columns.forces else None
    return Table(clocks, table[:, columns.rates], forces, columns.phone)


def _header(text: str) -> list[str] | None:
    """The names of the columns that the first line tells; None if it tells none."""
    first = next((line for line in text.splitlines() if line.strip(" #\t")), "")
    split = re.split(r"[;\t]" if re.search(r"[;\t]", first) else ",", first.strip().lstrip("#"))
    names = [name.strip().strip("\"'") for name in split]
    if len(names) < 4:
        names = first.strip().lstrip("#").split()
    return names if len(names) >= 4 and not any(map(is_number, names)) else None


def _by_count(fields: list[str], path: Path, usual: str | None) -> _Columns:
    if len(fields) not in (4, 7):
        raise DataError(
            f"{path} has {len(fields)} columns and no header that names them; 4 are needed (stamp, wx, wy, "
            "wz, rad/s), or 7 with ax, ay, az (m/s^2)."
        )
    return _Columns([(0, usual)], [1, 2, 3], [4, 5, 6] if len(fields) == 7 else [])


def _by_names(names: list[str], path: Path) -> _Columns:
    """The columns that a header names; raises DataError if a needed one is missing, or in degrees."""
    stamps: dict[str, tuple[int, str | None]] = {}
    rates: dict[str, int] = {}
    forces: dict[str, int] = {}
    plain: dict[str, int] = {}
    for k, name in enumerate(names):
        bare, unit = _parted(name)
        if bare in _STAMPS:
            stamps.setdefault(bare, (k, _UNITS.get(unit)))
        elif found := _RATES.fullmatch(bare):
            _refuse_degrees(name, path)
            rates.setdefault(found[1], k)
        elif found := _FORCES.fullmatch(bare):
            forces.setdefault(found[1], k)
        elif found := _PLAIN.fullmatch(bare):
            _refuse_degrees(name, path)
            plain.setdefault(found[1], k)
    if not rates:
        if re.search(r"acc|grav|orient|magn", path.stem, re.IGNORECASE):
            raise DataError(f"{path} is by its name no log of a gyroscope; give Gyroscope.csv.")
        rates = plain
    if set(rates) != set("xyz") or not stamps:
        known = ", ".join(names)
        raise DataError(f"The header of {path} ({known}) names no stamp with wx, wy and wz; {_SHOULD}.")
    used = {k for k, _ in stamps.values()} | set(rates.values()) | set(forces.values())
    rest = [name for k, name in enumerate(names) if k not in used]
    if rest:
        tell("passed over", f"columns {', '.join(rest)}", path)
    order = sorted(stamps, key=_STAMPS.index)
    return _Columns(
        [stamps[name] for name in order],
        [rates[axis] for axis in "xyz"],
        [forces[axis] for axis in "xyz"] if set(forces) == set("xyz") else [],
        phone="secondselapsed" in stamps or any("gyroscope x" in name.lower() for name in names),
    )


def _parted(name: str) -> tuple[str, str]:
    """A column's name, letters alone, and its unit."""
    found = re.fullmatch(r"(.*?)\s*[\[(](.*?)[\])]\s*", name)
    bare, unit = (found[1], found[2]) if found else (name, "")
    return re.sub(r"[^a-z]", "", bare.lower()), unit.strip().lower()


def _refuse_degrees(name: str, path: Path) -> None:
    if _DEGREES.search(name):
        raise DataError(
            f"The column '{name}' of {path} is in degrees; multiply it by pi / 180 = 0.0174533 and name it "
            "in rad/s."
        )


def _refuse_others(text: str, path: Path) -> None:
    """Raises DataError for files that hold no samples in rad/s, by name."""
    start = text.lstrip()[:200]
    if start.startswith("GYROFLOW"):
        raise DataError(f"{path} is Gyroflow's log, whose numbers are scaled counts; {_SHOULD}.")
    if start.startswith(("{", "[")):
        raise DataError(
            f"{path} is JSON, as Record3D's and ARCore's metadata, which hold no gyroscope's samples that "
            f"are read here; {_SHOULD}."
        )
