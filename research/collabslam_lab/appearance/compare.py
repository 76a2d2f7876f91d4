"""Worlds beside recordings: a table, a picture, and which world's numbers lie among the recordings'."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from collabslam.batch.engines import Engine
from collabslam.runs.report import number
from collabslam_lab.appearance.measure import FRAMES, QUICK_FRAMES, Numbers, Subject, measure, recordings
from collabslam_lab.appearance.tracking import STATISTICS
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table, hand_over
from collabslam_lab.worlds import SETS, lifelike

_COMPARED = ("corridor", "turn90", "turn180", "general")
_EVERY, _QUICK_EVERY = 2, 10


def compare_worlds(
    data: Path, out: Path, *, jobs: int, engine: Engine, quick: bool = False, progress: bool = True
) -> dict[str, Any]:
    """Run recordings, and every other world, in one mode each; write the page ``worlds`` and print it.

    It is worlds.png, .csv, .json and .md; what single runs gave is kept in ``out/tracking``.

    Parameters
    ----------
    data : Path
        Folder of recordings, as for `collabslam-lab evaluate`.
    out : Path
    jobs : int
        Processes, each with one thread.
    engine : Engine
        Where they run.
    quick : bool
        One world of each set and the first frames only: to see that it works.
    progress : bool

    Returns
    -------
    dict
        What worlds.json holds.

    Raises
    ------
    DataError
        If the folder holds no recordings, or one of them cannot be read.
    """
    count = QUICK_FRAMES if quick else FRAMES
    chosen = [r for name in _COMPARED for r in SETS[name][:: _QUICK_EVERY if quick else _EVERY]]
    first = [SETS[name][0] for name in _COMPARED]
    groups = {
        "recordings": recordings(data, quick=quick),
        "worlds": [Subject(w.name, recipe=w, frames=count) for w in map(lifelike, chosen)],
        "plain worlds": [Subject(w.name, recipe=w, frames=count) for w in first],
    }
    subjects = [subject for group in groups.values() for subject in group]
    found = measure(subjects, out / "tracking", jobs=jobs, engine=engine, progress=progress)
    rest = iter(found)
    numbers = {title: {s.name: next(rest) for s in group} for title, group in groups.items()}
    how = f"collabslam-lab reproduce worlds --data DIR{' --quick' if quick else ''}"
    return hand_over(out, "worlds", finding(numbers), how)


def finding(numbers: Mapping[str, Mapping[str, Numbers]]) -> Finding:
    """The page of what was measured, by group and name."""
    ranges = {key: ends(numbers["recordings"], key) for key in STATISTICS}
    inside = {
        name: {key: within(values[key], ranges[key]) for key in STATISTICS}
        for name, values in numbers["worlds"].items()
    }
    shares = {key: float(np.mean([row[key] for row in inside.values()])) for key in STATISTICS}
    lines = []
    for key, statistic in STATISTICS.items():
        low, high = ranges[key]
        line = [statistic.what, f"{number(low, statistic.digits)} to {number(high, statistic.digits)}"]
        line += [_spread(group, key) for group in numbers.values()]
        lines.append([*line, number(shares[key], 0, "%", 100.0)])
    header = (
        "of a run", "recordings, range", *(f"{title}: median (10th to 90th percentile)" for title in numbers),
        "worlds within the recordings' range",
    )  # fmt: skip
    columns = ("group", "name", *STATISTICS)
    rows = [[t, name, *values.values()] for t, group in numbers.items() for name, values in group.items()]
    each = [[t, name, *_cells(values)] for t, group in numbers.items() for name, values in group.items()]
    return Finding(
        title="Worlds beside recordings",
        figure=_figure(numbers),
        tables=[
            Table("What the tracker makes of both:", header, lines),
            Table("Each run:", columns, each),
        ],
        verdict=(
            "One run in one mode each, the filter's defaults; no pose, no truth and no second mode is looked "
            "at. Frame rates, lenses and motion of the recordings differ more than those of the worlds do."
        ),
        numbers={**numbers, "ranges": ranges, "inside": inside, "inside_share": shares},
        columns=columns,
        rows=rows,
    )


def ends(group: Mapping[str, Numbers], key: str) -> tuple[float | None, float | None]:
    """Least and largest number of a group; None if there is none."""
    known = _known(group, key)
    return (min(known), max(known)) if known else (None, None)


def within(value: float | None, limits: tuple[float | None, float | None]) -> bool:
    """Whether a number is known and lies between the limits."""
    low, high = limits
    return value is not None and low is not None and high is not None and low <= value <= high


def _known(group: Mapping[str, Numbers], key: str) -> list[float]:
    return [value for values in group.values() if (value := values[key]) is not None]


def _spread(group: Mapping[str, Numbers], key: str) -> str:
    known, digits = _known(group, key), STATISTICS[key].digits
    if not known:
        return "-"
    low, high = np.percentile(known, [10, 90])
    return f"{number(median(known), digits)} ({number(low, digits)} to {number(high, digits)})"


def _cells(values: Numbers) -> list[str]:
    return [number(values[key], statistic.digits) for key, statistic in STATISTICS.items()]


def _figure(numbers: Mapping[str, Mapping[str, Numbers]]) -> Any:
    columns = 4
    rows = -(-len(STATISTICS) // columns)
    figure, panels = style.canvas(rows, columns, (13.0, 2.2 * rows), "Worlds beside recordings")
    colours: Sequence[str] = (style.INK, style.COLLAB, style.GREY)
    for axes, key in zip(panels.flat, STATISTICS, strict=False):
        for place, (group, colour) in enumerate(zip(numbers.values(), colours, strict=True)):
            values = _known(group, key)
            axes.plot(values, np.full(len(values), -place), "o", color=colour, alpha=0.6, markersize=4)
        axes.set_yticks([-k for k in range(len(numbers))], list(numbers))
        axes.set_ylim(-len(numbers) + 0.5, 0.5)
        axes.set_title(STATISTICS[key].what, fontsize=8.5)
    for axes in panels.flat[len(STATISTICS) :]:
        axes.set_visible(False)
    return figure
