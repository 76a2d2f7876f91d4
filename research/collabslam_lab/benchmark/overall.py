"""What all recordings say together, and two evaluations side by side."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from collabslam.errors import DataError
from collabslam.runs.report import number
from collabslam_lab.report import markdown_table

Medians = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""By recording and mode, as `figures.medians` gives them."""
ERROR, WRONG = "ate_pct_all_frames", "false_ok_share"
_SHARES = ("ok_share", WRONG)
_RATIOS = ("nees_position", "nees_attitude", "sharpness_position", "sharpness_attitude")


def table(found: Medians) -> str:
    """For each mode the geometric mean of the error over all recordings, and the worst share false OK."""
    lines = []
    for mode in _modes(found):
        runs = {name: modes[mode] for name, modes in found.items() if mode in modes}
        errors = [error for told in runs.values() if (error := _error(told)) is not None]
        wrong = {name: told[WRONG] for name, told in runs.items() if told.get(WRONG) is not None}
        worst = max(wrong, key=lambda name: wrong[name], default=None)
        lines.append(
            [
                mode,
                f"{len(errors)} of {len(runs)}",
                number(_geometric_mean(errors), 3),
                "-" if worst is None else f"{number(wrong[worst], 1, scale=100.0)} ({worst})",
            ]
        )
    header = (
        "mode",
        "recordings with an error",
        "ATE, all frames, geometric mean, %",
        "worst false OK, %",
    )
    return markdown_table(header, lines)


def compared(found: Medians, before: Medians) -> str:
    """Each recording and mode that both have, before and now, and the geometric mean of the ratios."""
    lines, ratios = [], dict[str, list[float]]()
    for name, modes in found.items():
        for mode in modes:
            if mode not in before.get(name, {}):
                continue
            was, now = before[name][mode], modes[mode]
            errors = _error(was), _error(now)
            ratio = None
            if errors[0] is not None and errors[1] is not None:
                ratio = errors[1] / errors[0]
                ratios.setdefault(mode, []).append(ratio)
            lines.append(
                [
                    name,
                    mode,
                    *(number(error, 2) for error in errors),
                    number(ratio, 2),
                    *(_pair(was, now, key, 0, 100.0) for key in _SHARES),
                    *(_pair(was, now, key, 1, 1.0) for key in _RATIOS),
                ]
            )
    for mode, of_mode in ratios.items():
        blank = [""] * (len(_SHARES) + len(_RATIOS))
        lines.append(["all", mode, "", "", number(_geometric_mean(of_mode), 3), *blank])
    header = ("recording", "mode", "ATE, all frames, %: before", "now", "ratio", "OK, %", "false OK, %",
              "NEES position", "NEES attitude", "error over sd: position", "attitude")  # fmt: skip
    return markdown_table(header, lines)


def read(folder: Path) -> Medians:
    """The medians of an evaluation's result folder; raises DataError if it is none."""
    path = folder / "evaluate.json"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))["recordings"]
        complete = all(isinstance(told, dict) for modes in found.values() for told in modes.values())
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"{path} is not an evaluation ({error}); give a folder that evaluate wrote."
        ) from error
    if not complete:
        raise DataError(f"{path} has no medians by recording and mode; give a folder that evaluate wrote.")
    return dict(found)


def _modes(found: Medians) -> Iterator[str]:
    yield from dict.fromkeys(mode for modes in found.values() for mode in modes)


def _error(told: Mapping[str, Any]) -> float | None:
    error = told.get(ERROR)
    return float(error) if isinstance(error, int | float) and error > 0.0 else None


def _geometric_mean(values: list[float]) -> float | None:
    return math.exp(sum(map(math.log, values)) / len(values)) if values else None


def _pair(was: Mapping[str, Any], now: Mapping[str, Any], key: str, digits: int, scale: float) -> str:
    return " / ".join(number(told.get(key), digits, scale=scale) for told in (was, now))
