"""In which unit a column of time stamps was written: by the years that it would mean, and by its rate.

Stamps are kept as exact decimals until they are seconds, since nanoseconds since 1970 have more digits than
a float.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal, InvalidOperation

import numpy as np

from collabslam.datasets.gate import tell
from collabslam.errors import DataError
from collabslam.types import Array

NANOSECONDS = 10**9
UNITS = {"seconds": 0, "milliseconds": -3, "microseconds": -6, "nanoseconds": -9}
"""The power of ten that makes seconds of each unit."""
_YEARS = (6.3e8, 4.1e9)
"""Seconds since 1970 of 1990 and of 2100."""
_STEPS = (1e-4, 100.0)
"""Seconds between stamps of known years, or of a layout whose unit is known, that are believed."""
LONGEST = 2.0
"""Seconds between frames whose years nobody knows."""
_COUNTED = 8
"""Whole numbers without years that are so far apart count frames: no camera is so fast in any unit."""
_TICKS = (256, 512, 1001, 1024, 3000, 3003, 3600, 3750, 4500, 6000, 9000)
"""How far apart the stamps of films are that count ticks, as 90000 or 15360 a second; no clock's are."""
_NANO_DIGITS = 9
LEAST_STEP, MOST_STEP, MOST_GAP = 2e-3, 10.0, 86400.0
"""Seconds from frame to frame that a recording has in the middle, and the longest gap in one."""


def seconds(nanoseconds: int) -> float:
    """Seconds of an integer nanosecond stamp, correctly rounded."""
    return nanoseconds / NANOSECONDS


def read_stamps(
    texts: Iterable[str],
    where: str,
    *,
    lines: Sequence[int] = (),
    usual: str | None = None,
    longest: float = LONGEST,
) -> list[Decimal]:
    """Seconds of a column of stamps, all in one unit, which is found out.

    Parameters
    ----------
    texts
        The stamps as they were written.
    where
        The file, for messages.
    lines
        Their lines' numbers, for messages.
    usual
        The unit that the layout prescribes: another one is taken only if that one has an impossible rate.
    longest
        Seconds between stamps whose years nobody knows; thousandths of it are the next unit's.

    Raises
    ------
    DataError
        If one is not a number, or all fit no unit, naming the line.
    """
    texts = list(texts)
    if has_nanosecond_parts(texts):
        tell("passed over", "zeros that lack before the nanoseconds", where)
        texts = [padded(text) for text in texts]
    stamps = [
        _number(text, f"line {lines[k]} of {where}" if lines else where) for k, text in enumerate(texts)
    ]
    unit = _unit(stamps, where, usual, longest) if stamps else "seconds"
    tell("stamps", f"{len(stamps)}, in {unit}", where)
    found = [stamp.scaleb(UNITS[unit]) for stamp in stamps]
    if found and max(found) * NANOSECONDS >= 1 << 63:
        raise DataError(f"A stamp of {where} is far too large ({max(found):.3e} s); write it in seconds.")
    return found


def has_nanosecond_parts(texts: Sequence[str]) -> bool:
    """Whether stamps are seconds, a point, and nanoseconds without zeros before them, as some scripts write.

    Decimals as long as that, of different lengths, begin with a zero as often as not.
    """
    parts = [text.strip().split(".") for text in texts]
    if len(parts) < 5 or not all(len(p) == 2 and p[0].isdigit() and p[1].isdigit() for p in parts):
        return False
    lengths = {len(p[1]) for p in parts}
    if max(lengths) != _NANO_DIGITS or len(lengths) == 1 or any(p[1][0] == "0" != p[1] for p in parts):
        return False
    steps = [np.abs(np.diff(np.sort([float(t) for t in read]))) for read in (texts, map(padded, texts))]
    return float(np.ptp(steps[1])) < float(np.ptp(steps[0]))


def padded(text: str) -> str:
    """A stamp of seconds and nanoseconds with the zeros that it lacks."""
    whole, _, nanoseconds = text.strip().partition(".")
    return f"{whole}.{nanoseconds.zfill(_NANO_DIGITS)}"


def check_no_counter(texts: Sequence[str], where: str) -> None:
    """Refuses whole numbers that are as near as numbers of frames, or as ticks; DataError if they are."""
    if len(texts) < 3 or not all(text.isascii() and text.isdigit() and len(text) < 10 for text in texts):
        return
    step = float(np.median(np.diff(np.unique([int(text) for text in texts])))) if len(set(texts)) > 1 else 0.0
    if LONGEST < step <= _COUNTED:
        raise DataError(
            f"The stamps of {where} are whole numbers {step:g} apart, which count frames; give times in "
            "seconds (with a point, as 2.0, if they are)."
        )
    if step in _TICKS:
        raise DataError(
            f"The stamps of {where} are {step:g} apart, as the ticks of a film's own clock, of which nobody "
            "says how many a second has; give seconds (pts_time of ffprobe, not pts)."
        )


def listed_stamps(rows: list[tuple[int, list[str]]], where: str) -> tuple[list[Decimal], list[list[str]]]:
    """Stamps of a list of images' times, and what follows them in each line.

    A first column that counts the lines is passed over, as of TUM-mono's ``times.txt``.

    Raises
    ------
    DataError
        As `read_stamps`, or if there is nothing but such a column.
    """
    lines, columns = [n for n, _ in rows], [fields for _, fields in rows]
    if counts([fields[0] for fields in columns]):
        columns = [fields[1:] for fields in columns]
        if not all(columns):
            raise DataError(f"{where} counts its lines and tells no times; give stamps in seconds.")
        tell("passed over", "the first column (it counts the lines)", where)
    columns = _joined(columns, where)
    check_no_counter([fields[0] for fields in columns], where)
    stamps = read_stamps([fields[0] for fields in columns], where, lines=lines)
    return stamps, [fields[1:] for fields in columns]


def _joined(columns: list[list[str]], where: str) -> list[list[str]]:
    """Two columns of whole numbers, seconds since 1970 and nanoseconds as ROS has them, as one."""
    digits = all(len(f) > 1 and all(x.isascii() and x.isdigit() for x in f[:2]) for f in columns)
    if len(columns) < 2 or not digits:
        return columns
    whole, rest = ([int(f[k]) for f in columns] for k in (0, 1))
    dated = _YEARS[0] <= min(whole) and max(whole) < _YEARS[1] and len(set(whole)) < len(whole)
    if not dated or not LEAST_STEP * NANOSECONDS < max(rest) < NANOSECONDS:
        return columns
    tell("stamps", "seconds and nanoseconds in two columns", where)
    return [[f"{s}.{n:09d}", *f[2:]] for s, n, f in zip(whole, rest, columns, strict=True)]


def as_seconds(stamps: Iterable[Decimal]) -> Array:
    """Stamps as float64, each correctly rounded."""
    return np.asarray([float(stamp) for stamp in stamps], dtype=np.float64)


def as_nanoseconds(stamps: Iterable[Decimal]) -> list[int]:
    """Stamps as whole nanoseconds."""
    return [int((stamp * NANOSECONDS).to_integral_value()) for stamp in stamps]


def counts(texts: Sequence[str]) -> bool:
    """Whether a column only counts: 0, 1, 2 and so on, or from 1 on."""
    if len(texts) < 3 or not all(text.isascii() and text.isdigit() and len(text) < 10 for text in texts):
        return False
    numbers = [int(text) for text in texts]
    return numbers[0] in (0, 1) and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def looks_dated(text: str) -> bool:
    """Whether a number is a time between 1990 and 2100 in one of the units."""
    return any(_YEARS[0] <= float(text) * 10.0**power < _YEARS[1] for power in UNITS.values())


def _number(text: str, where: str) -> Decimal:
    try:
        stamp = Decimal(text.strip())
        fits = stamp.is_finite() and abs(stamp) < Decimal(10) ** 25
    except InvalidOperation:
        raise DataError(f"The stamp '{text[:24]}' in {where} is not a number; write it in seconds.") from None
    if not fits:
        raise DataError(
            f"The stamp '{text[:24]}' in {where} is not finite or far too large; write it in seconds."
        )
    return stamp


def _unit(stamps: list[Decimal], where: str, usual: str | None, longest: float) -> str:
    values = np.unique(np.asarray([float(stamp) for stamp in stamps]))
    typical = float(np.median(np.abs(values)))
    dated = next((u for u, p in UNITS.items() if _YEARS[0] <= typical * 10.0**p < _YEARS[1]), None)
    if len(values) < 2:
        return usual or dated or "seconds"
    step = float(np.median(np.diff(values)))
    for unit in (dated, usual):
        if unit is not None and _STEPS[0] <= step * 10.0 ** UNITS[unit] <= _STEPS[1]:
            return unit
    by_rate = next((u for u, p in UNITS.items() if step * 10.0**p <= longest), None)
    if by_rate is None:
        raise DataError(
            f"The stamps of {where} are {step:g} apart, which is not a camera's rate in any unit; write them "
            "in seconds."
        )
    return by_rate


def check_rate(times: Array, where: str) -> None:
    """Check that frames are as far apart as a camera's are, times in seconds; DataError if not."""
    steps = np.diff(times)
    if not len(steps):
        return
    middle, gap = float(np.median(steps)), float(np.max(steps))
    if not LEAST_STEP <= middle <= MOST_STEP or gap > MOST_GAP:
        raise DataError(
            f"The frames of {where} are {middle:.3g} s apart, at most {gap:.3g} s, which no camera's are; "
            "check the stamps, their unit, or the key 'rate' of the calibration."
        )
