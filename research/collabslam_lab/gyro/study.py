"""With a gyroscope and without: trajectories as hard as life, turns, corridors; ``gyro.json`` and a table."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.batch.engines import LOCAL, Engine
from collabslam.formats.files import write_text
from collabslam.runs.results import jsonable
from collabslam_lab.gyro.pieces import OfWorld, Piece, Score, parsed, ran
from collabslam_lab.gyro.simulated import RATE as SAMPLES_RATE
from collabslam_lab.kept import Task, kept
from collabslam_lab.report import markdown_table
from collabslam_lab.worlds import LIFE, SETS
from collabslam_lab.worlds.recording import RATE as FRAMES_RATE

TIGHT = "collab-tight"
MODES = (TIGHT, "mono")
_SEEDS = range(10)
_QUICK = {"trajectories": ("d",), "turns": ("turn180-2",), "corridors": ("corridor-0",)}
_QUICK_FRAMES = 120

Row = tuple[Piece, Score]


def worlds_of(*, quick: bool) -> dict[str, list[str]]:
    """Names of the worlds by their group, all as hard as life."""
    sets = {
        "trajectories": [r.name for r in SETS["general"]],
        "turns": [r.name for r in (*SETS["turn90"], *SETS["turn180"])],
        "corridors": [r.name for r in SETS["corridor"]],
    }
    return {group: [name + LIFE for name in (_QUICK[group] if quick else sets[group])] for group in sets}


def study_gyro(
    folder: Path,
    *,
    seeds: Sequence[int] | None = None,
    kind: str = "phone",
    jobs: int = 1,
    quick: bool = False,
    engine: Engine = LOCAL,
) -> dict[str, Any]:
    """Runs all worlds with and without a gyroscope, writes ``gyro.json`` and ``gyro.md``, prints the tables.

    Parameters
    ----------
    folder : Path
        For ``gyro.json`` and, in ``runs``, what came of each world; those that are there are not done again.
    seeds : sequence of int, optional
        Of all noise; ten of them if left out, one if ``quick``.
    kind : str
        Of the gyroscope, one of `collabslam_lab.gyro.simulated.KINDS`.
    jobs : int
        Processes at a time.
    quick : bool
        One world of each group, its first frames.
    engine : Engine
        What runs the processes.
    """
    groups = worlds_of(quick=quick)
    drawn = seeds or ((0,) if quick else _SEEDS)
    works = [
        OfWorld(
            tuple(
                Piece(world, seed, mode, gyro, _QUICK_FRAMES if quick else None)
                for seed in drawn
                for mode in MODES
                for gyro in ("", kind)
            ),
        )
        for worlds in groups.values()
        for world in worlds
    ]
    task = Task(ran, parsed, _said, "gyroscope", "world")
    scores = kept(task, works, folder / "runs", jobs=jobs, engine=engine, progress=True)
    rows = [row for work, of in zip(works, scores, strict=True) for row in zip(work.pieces, of, strict=True)]
    numbers = summary(groups, rows, kind)
    write_text(folder / "gyro.json", json.dumps(jsonable(numbers), indent=1, sort_keys=True) + "\n")
    text = table(groups, rows) + "\n\n" + trajectories_table(groups["trajectories"], rows)
    write_text(folder / "gyro.md", text + "\n")
    print(text)
    return numbers


def summary(groups: dict[str, list[str]], rows: Sequence[Row], kind: str) -> dict[str, Any]:
    """The numbers of ``gyro.json``: of `TIGHT` with the gyroscope, trajectories and turns; and every run."""
    told = _told(rows)
    bare = [row for row in rows if row[0].mode == TIGHT and not row[0].kind]
    ways, turns = (_of(told, groups[name]) for name in ("trajectories", "turns"))
    ends, headings = _values(ways, "end_pct"), _values(turns, "heading_deg")
    # A prediction's time hangs on the map, too: what is added is a difference of means, and the samples.
    sample_us = float(np.nanmean(_values(told, "us_sample")))
    more = np.nanmean(_values(told, "ms_predict")) - np.nanmean(_values(bare, "ms_predict"))
    return {
        "kind": kind,
        "end_pct_mean": float(np.mean(ends)),
        "end_pct_worst": float(np.max(ends)),
        "false_ok_share": float(np.mean(_values(ways, "false_ok"))),
        "heading_deg_mean": float(np.mean(headings)),
        "heading_deg_worst": float(np.max(headings)),
        "ms_per_frame": float(max(more, 0.0)) + 1e-3 * sample_us * SAMPLES_RATE / FRAMES_RATE,
        "us_per_sample": sample_us,
        "bias_within_3_sigma": float(np.nanmean(_values(told, "bias_inside"))),
        "runs": [asdict(piece) | asdict(score) for piece, score in rows],
    }


def table(groups: dict[str, list[str]], rows: Sequence[Row]) -> str:
    """Group by group, mode by mode, without and with."""
    head = ["worlds", "mode", "gyroscope", "end, %", "worst", "heading, deg", "worst", "mean error, %"]
    head += ["OK, %", "false OK, %", "with a pose, %", "lost at the end, %", "NEES (6)", "bias in 3 sd, %"]
    columns: list[tuple[str, Callable[..., Any], float]] = [
        ("end_pct", np.mean, 1.0),
        ("end_pct", np.max, 1.0),
        ("heading_deg", np.mean, 1.0),
        ("heading_deg", np.max, 1.0),
        ("mean_pct", np.mean, 1.0),
        ("ok", np.mean, 100.0),
        ("false_ok", np.mean, 100.0),
        ("posed", np.mean, 100.0),
        ("lost_at_end", np.mean, 100.0),
        ("nees", np.mean, 1.0),
        ("bias_inside", np.mean, 100.0),
    ]
    lines = []
    for group, worlds in groups.items():
        of_group = _of(rows, worlds)
        for mode, gyro in dict.fromkeys((piece.mode, piece.kind) for piece, _ in of_group):
            some = [row for row in of_group if (row[0].mode, row[0].kind) == (mode, gyro)]
            cells = [f"{scale * float(of(_values(some, name))):.2f}" for name, of, scale in columns]
            lines.append([group, mode, gyro or "none", *(cell.replace("nan", "-") for cell in cells)])
    return markdown_table(head, lines)


def trajectories_table(worlds: Sequence[str], rows: Sequence[Row]) -> str:
    """`TIGHT` with the gyroscope, trajectory by trajectory: mean and worst of the draws."""
    head = ["world", "end, %", "mean error, %", "heading, deg", "OK, %", "false OK, %", "NEES (6)"]
    columns: list[tuple[str, Callable[..., Any], float]] = [
        ("end_pct", np.max, 1.0),
        ("mean_pct", np.max, 1.0),
        ("heading_deg", np.max, 1.0),
        ("ok", np.min, 100.0),
        ("false_ok", np.max, 100.0),
        ("nees", np.max, 1.0),
    ]
    told = _told(rows)
    lines = []
    for name, some in [*((w, [w]) for w in worlds), ("all", worlds)]:
        of_world = _of(told, some)
        cells = []
        for column, worst, scale in columns:
            values = scale * np.array(_values(of_world, column))
            cells.append(f"{np.mean(values):.1f}, {worst(values):.1f}")
        lines.append([name, *cells])
    return markdown_table(head, lines)


def _said(_: OfWorld, scores: Sequence[Score]) -> str:
    return f"{np.mean([score.end_pct for score in scores]):.1f} % at the end"


def _told(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row[0].mode == TIGHT and row[0].kind]


def _of(rows: Sequence[Row], worlds: Sequence[str]) -> list[Row]:
    return [row for row in rows if row[0].world in worlds]


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [float(getattr(score, name)) for _, score in rows]
