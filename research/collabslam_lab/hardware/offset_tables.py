"""Tables and a picture of what it costs that Cf's clock is behind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from collabslam_lab.figures.finding import Table
from collabslam_lab.figures.style import COLLAB, INK, MONO, legend
from collabslam_lab.hardware.clocks import Row, of, pooled, values
from collabslam_lab.hardware.wrong_stamps import CORRIDOR, LIVELY

COLUMNS = ("error", "NEES", "OK", "DEGRADED")
_LINES = {LIVELY: "-", CORRIDOR: ":"}


def offset_table(rows: Sequence[Row]) -> Table:
    """Error, NEES, OK and DEGRADED share by trajectory, certainty of T_CF and offset, of `offset_rows`."""
    lines = []
    for way, known in dict.fromkeys((row["way"], row["t_cf"]) for row in rows):
        same = of(rows, way=way, t_cf=known)
        base = pooled(of(same, offset_ms=0.0)).error
        for ms in values(same, "offset_ms"):
            cells = [_cells(of(same, offset_ms=ms, told=told), base) for told in (False, True)]
            lines.append([way, known, f"{ms:g} ms", *cells[0], *cells[1]])
    return Table(
        "Cf's clock is behind, without and with `worn.clock_sd` of that size. Error, and in brackets over "
        "that without an offset; NEES of the pose (6 expected); frames OK, and DEGRADED:",
        ["way", "T_CF is known to", "behind by", *COLUMNS, *(f"told: {name}" for name in COLUMNS)],
        lines,
    )


def _cells(rows: Sequence[Row], base: float) -> list[str]:
    if not rows:
        return len(COLUMNS) * ["-"]
    score = pooled(rows)
    shares = [float(np.mean([row[key] for row in rows])) for key in ("ok_share", "degraded_share")]
    error = f"{100 * score.error:.1f} cm ({score.error / base:.2f})"
    return [error, f"{score.nees:.1f}", *(f"{share:.0%}" for share in shares)]


def found_table(rows: Sequence[Row]) -> Table:
    """What `check-calib --write` finds of the offsets, of `found_rows` on one way."""
    where = " and ".join(dict.fromkeys(f"{row['way']}, seed {row['seed']}" for row in rows))
    certain = list(dict.fromkeys(row["t_cf"] for row in rows))
    lines = []
    for ms in values(rows, "offset_ms"):
        cells = (of(rows, offset_ms=ms, t_cf=known) for known in certain)
        lines.append([f"{ms:g} ms", *(_found(cell) for cell in cells)])
    return Table(
        f"What `check-calib --write` finds of it by a run and the views ({where}):",
        ["behind by", *(f"T_CF known to {known}" for known in certain)],
        lines,
    )


def _found(rows: Sequence[Row]) -> str:
    return ", ".join(f"{row['found_ms']:.0f} +- {row['sd_ms']:.0f} ms" for row in rows) or "-"


def draw_offsets(axes: Any, rows: Sequence[Row]) -> None:
    """Error over offset of each way and certainty of T_CF, where the filter is not told."""
    for way in dict.fromkeys(row["way"] for row in rows):
        for known, colour in zip(
            dict.fromkeys(row["t_cf"] for row in rows), (COLLAB, MONO, INK), strict=False
        ):
            some = of(rows, way=way, t_cf=known, told=False)
            offsets = values(some, "offset_ms")
            errors = [100 * pooled(of(some, offset_ms=ms)).error for ms in offsets]
            style, label = _LINES.get(way, "--"), f"{way}, T_CF to {known}"
            axes.plot(offsets, errors, style, marker="o", color=colour, label=label)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("Cf's clock is behind by, ms")
    axes.set_ylabel("RMS position error, cm")
    legend(axes)
