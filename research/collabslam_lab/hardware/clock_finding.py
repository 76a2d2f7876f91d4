"""The page of `clocks`: tables, and a picture of what lateness and offsets cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from collabslam_lab.figures.finding import Finding, Table, hand_over
from collabslam_lab.figures.style import COLLAB, GREY, INK, MONO, RAMP, canvas, legend
from collabslam_lab.hardware import clocks as runs
from collabslam_lab.hardware.clocks import SETTLED, TOGETHER, Pooled, Row, pooled

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
    if quick:
        clocks = list(runs.clock_rows(seeds, runs.FEW_CLOCKS, QUICK_FRAMES))
        offsets = list(runs.offset_rows(seeds, runs.WAYS[:1], runs.FEW_OFFSETS_MS, QUICK_FRAMES))
    else:
        clocks = list(runs.clock_rows(seeds, runs.CLOCKS))
        offsets = list(runs.offset_rows(seeds, runs.WAYS, runs.OFFSETS_MS))
    how = f"collabslam-lab clocks --seeds {','.join(map(str, seeds))}{' --quick' if quick else ''}"
    hand_over(out, "clocks", finding(clocks, offsets), how)


def finding(clocks: Sequence[Row], offsets: Sequence[Row]) -> Finding:
    """What `clock_rows` and `offset_rows` gave, as a page."""
    figure, panels = canvas(1, 2, (11.0, 4.2), "A worn camera with a clock of its own")
    _draw_lateness(panels[0, 0], clocks)
    _draw_offsets(panels[0, 1], offsets)
    rows = [[*(row[key] for key in COLUMNS[:6]), *astuple(pooled([row]))] for row in clocks]
    return Finding(
        title="A worn camera with a clock of its own",
        figure=figure,
        tables=[_clock_table(clocks), _offset_table(offsets)],
        verdict=NOTE,
        numbers={"clocks": list(clocks), "offsets": list(offsets)},
        columns=COLUMNS,
        rows=rows,
    )


def _values(rows: Sequence[Row], key: str) -> list[Any]:
    return sorted({row[key] for row in rows})


def _of(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def _together(rows: Sequence[Row]) -> list[Row]:
    return _of(rows, rate_hz=TOGETHER.rate, phase_s=TOGETHER.phase, late_s=TOGETHER.late)


def _form(rows: Sequence[Row], base: Pooled) -> str:
    if not rows:
        return "-"
    score = pooled(rows)
    return f"{score.error / base.error:.2f} / {score.claimed / base.claimed:.2f} ({score.nees:.1f})"


def _clock_table(rows: Sequence[Row]) -> Table:
    base = pooled(_together(rows))
    late = _values(rows, "late_s")
    kinds = sorted({(row["rate_hz"], row["phase_s"]) for row in rows})
    lines = [
        [f"{rate:g} Hz", f"{1e3 * phase:g} ms"]
        + [_form(_of(rows, rate_hz=rate, phase_s=phase, late_s=t), base) for t in late]
        for rate, phase in kinds
    ]
    return Table(
        "Error, and the standard deviation that the filter claims, over those of views at the frames' own "
        f"instants ({100 * base.error:.1f} cm, {100 * base.claimed:.1f} cm, NEES {base.nees:.1f}); in "
        "brackets NEES of the pose (6 expected):",
        ["views of Cf", "first one after", *(f"late by {t:g} s" for t in late)],
        lines,
    )


def _offset_table(rows: Sequence[Row]) -> Table:
    def cell(sel: Sequence[Row]) -> str:
        if not sel:
            return "-"
        score = pooled(sel)
        return f"{100 * score.error:.1f} cm ({score.nees:.1f})"

    kinds = sorted({(row["way"], row["t_cf"], row["offset_ms"]) for row in rows})
    lines = [
        [way, known, f"{ms:g} ms"]
        + [cell(_of(rows, way=way, t_cf=known, offset_ms=ms, told=told)) for told in (False, True)]
        for way, known, ms in kinds
    ]
    return Table(
        "Cf's clock is behind: error and NEES of the pose, without and with `worn.clock_sd` of that size:",
        ["way", "T_CF is known to", "behind by", "not told", "told"],
        lines,
    )


def _draw_lateness(axes: Any, rows: Sequence[Row]) -> None:
    base = pooled(_together(rows)).error
    late = _values(rows, "late_s")
    for rate, colour in zip(_values(rows, "rate_hz"), RAMP, strict=False):
        errors = [pooled(_of(rows, rate_hz=rate, late_s=t)).error for t in late]
        axes.plot(late, np.asarray(errors) / base, "o-", color=colour, label=f"{rate:g} Hz, all phases")
    axes.axhline(1.0, color=GREY, linewidth=1.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("views come late by, s")
    axes.set_ylabel("error over that of views at frames' instants")
    legend(axes, "lower left")


def _draw_offsets(axes: Any, rows: Sequence[Row]) -> None:
    styles = {"corridor": "-"}
    for way in dict.fromkeys(row["way"] for row in rows):
        for known, colour in zip(
            dict.fromkeys(row["t_cf"] for row in rows), (COLLAB, MONO, INK), strict=False
        ):
            sel = _of(rows, way=way, t_cf=known, told=False)
            offsets = _values(sel, "offset_ms")
            errors = [100 * pooled(_of(sel, offset_ms=ms)).error for ms in offsets]
            axes.plot(
                offsets,
                errors,
                styles.get(way, "--"),
                marker="o",
                color=colour,
                label=f"{way}, T_CF to {known}",
            )
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("Cf's clock is behind by, ms")
    axes.set_ylabel("RMS position error, cm")
    legend(axes)
