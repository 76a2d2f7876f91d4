"""The page of `clocks`: tables, and a picture of what lateness and offsets cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from collabslam_lab.figures.finding import Finding, Table, hand_over
from collabslam_lab.figures.style import GREY, RAMP, canvas, legend
from collabslam_lab.hardware import clocks as runs
from collabslam_lab.hardware.clocks import SETTLED, TOGETHER, Pooled, Row, of, pooled, values
from collabslam_lab.hardware.offset_tables import draw_offsets, found_table, offset_table
from collabslam_lab.hardware.offsets import (
    FEW_OFFSETS_MS,
    FEW_WAYS,
    OFFSETS_MS,
    WAYS,
    found_rows,
    offset_rows,
)

COLUMNS = ("seed", "rate_hz", "phase_s", "late_s", "frames", "ok_share", "error_m", "claimed_m", "nees")
NOTE = (
    "Errors are RMS over all seeds and frames from "
    f"{SETTLED:g} s on, in W, without any alignment. At 7 Hz there are fewer views than frames, which costs "
    "by itself; of 15 and 30 Hz each frame takes the newest."
)


QUICK_FRAMES = 20


def report(out: Path, seeds: Sequence[int], *, quick: bool) -> None:
    """Run everything, write clocks.png, .csv, .json and .md into ``out``, print the page.

    Parameters
    ----------
    out : Path
    seeds : sequence of int
        Of the noise.
    quick : bool
        Few clocks and offsets, one way, two seconds of each: to see that it works.

    Raises
    ------
    DataError
        If the folder cannot be written.
    """
    clocks = runs.FEW_CLOCKS if quick else runs.CLOCKS
    ways, offsets = (FEW_WAYS, FEW_OFFSETS_MS) if quick else (WAYS, OFFSETS_MS)
    frames = QUICK_FRAMES if quick else None
    page = finding(
        list(runs.clock_rows(seeds, clocks, frames)),
        list(offset_rows(seeds, ways, offsets, frames)),
        list(found_rows(ways[0], seeds[0], offsets, frames)),
    )
    how = f"collabslam-lab clocks --seeds {','.join(map(str, seeds))}{' --quick' if quick else ''}"
    hand_over(out, "clocks", page, how)


def finding(clocks: Sequence[Row], offsets: Sequence[Row], found: Sequence[Row]) -> Finding:
    """What `clock_rows`, `offset_rows` and `found_rows` gave, as a page."""
    figure, panels = canvas(1, 2, (11.0, 4.2), "A worn camera with a clock of its own")
    _draw_lateness(panels[0, 0], clocks)
    draw_offsets(panels[0, 1], offsets)
    rows = [[*(row[key] for key in COLUMNS[:6]), *astuple(pooled([row]))] for row in clocks]
    return Finding(
        title="A worn camera with a clock of its own",
        figure=figure,
        tables=[_clock_table(clocks), offset_table(offsets), found_table(found)],
        verdict=NOTE,
        numbers={"clocks": list(clocks), "offsets": list(offsets), "found": list(found)},
        columns=COLUMNS,
        rows=rows,
    )


def _together(rows: Sequence[Row]) -> list[Row]:
    return of(rows, rate_hz=TOGETHER.rate, phase_s=TOGETHER.phase, late_s=TOGETHER.late)


def _form(rows: Sequence[Row], base: Pooled) -> str:
    if not rows:
        return "-"
    score = pooled(rows)
    return f"{score.error / base.error:.2f} / {score.claimed / base.claimed:.2f} ({score.nees:.1f})"


def _clock_table(rows: Sequence[Row]) -> Table:
    base = pooled(_together(rows))
    late = values(rows, "late_s")
    kinds = sorted({(row["rate_hz"], row["phase_s"]) for row in rows})
    lines = [
        [f"{rate:g} Hz", f"{1e3 * phase:g} ms"]
        + [_form(of(rows, rate_hz=rate, phase_s=phase, late_s=t), base) for t in late]
        for rate, phase in kinds
    ]
    return Table(
        "Error, and the standard deviation that the filter claims, over those of views at the frames' own "
        f"instants ({100 * base.error:.1f} cm, {100 * base.claimed:.1f} cm, NEES {base.nees:.1f}); in "
        "brackets NEES of the pose (6 expected):",
        ["views of Cf", "first one after", *(f"late by {t:g} s" for t in late)],
        lines,
    )


def _draw_lateness(axes: Any, rows: Sequence[Row]) -> None:
    base = pooled(_together(rows)).error
    late = values(rows, "late_s")
    for rate, colour in zip(values(rows, "rate_hz"), RAMP, strict=False):
        errors = [pooled(of(rows, rate_hz=rate, late_s=t)).error for t in late]
        axes.plot(late, np.asarray(errors) / base, "o-", color=colour, label=f"{rate:g} Hz, all phases")
    axes.axhline(1.0, color=GREY, linewidth=1.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("views come late by, s")
    axes.set_ylabel("error over that of views at frames' instants")
    legend(axes, "lower left")
