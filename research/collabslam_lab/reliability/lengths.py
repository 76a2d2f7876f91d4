"""Lengths of T_CF that change while a run goes on: how many frames say OK beside a wrong pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam.runs.plan import Output
from collabslam.runs.runner import run
from collabslam.runs.summary import is_trusted
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import corridor_recording
from collabslam_lab.reliability.attacks.physical import longer, untold
from collabslam_lab.report import markdown_table

_LENGTH_M = 15.0


def _from(frame: int, factor: float) -> Callable[[int], float]:
    return lambda i: factor if i >= frame else 1.0


def _each(factor: float) -> Callable[[int], float]:
    return lambda i: factor**i


CHANGES: tuple[tuple[str, Callable[[int], float]], ...] = (
    ("none", _from(0, 1.0)),
    ("30 % longer", _from(40, 1.3)),
    ("30 % longer from frame 70 on", _from(70, 1.3)),
    ("23 % shorter", _from(40, 1.0 / 1.3)),
    ("15 % longer", _from(40, 1.15)),
    ("10 % longer", _from(40, 1.1)),
    ("5 % longer", _from(40, 1.05)),
    ("5 % shorter", _from(40, 0.95)),
    ("0.1 % a frame longer", _each(1.001)),
    ("0.1 % a frame shorter", _each(0.999)),
    ("0.3 % a frame longer", _each(1.003)),
    ("0.3 % a frame shorter", _each(0.997)),
)
"""What becomes of T_CF's length, by the number of the frame; from frame 40 on where it does not say."""


@dataclass(frozen=True)
class LengthRow:
    """What a change of length did, of each seed.

    Attributes
    ----------
    change : str
    told : bool
        Whether the views say that nothing of their error lasts; else they say nothing.
    false_ok : list of float
        Shares of the frames that say OK and are over 5 sigma off.
    ok : list of float
        Shares of the frames that say OK and are not.
    trusted : list of bool
        Whether the run is trusted at its end.
    """

    change: str
    told: bool
    false_ok: list[float]
    ok: list[float]
    trusted: list[bool]

    def jsonable(self) -> dict[str, Any]:
        """As a row of ``reliability.json``."""
        return dict(vars(self))


def measure_lengths(
    seeds: Sequence[int],
    *,
    changes: Sequence[tuple[str, Callable[[int], float]]] = CHANGES,
    progress: bool = False,
) -> list[LengthRow]:
    """Runs every change on corridors, with what lasts told and untold.

    Parameters
    ----------
    seeds : sequence of int
        Of the corridors.
    changes : sequence of (str, callable)
    progress : bool
        Whether to show progress on standard error.
    """
    corridors = [HeldRecording(corridor_recording(seed, length_m=_LENGTH_M)) for seed in seeds]
    rows = []
    for name, factor in changes:
        for told in (True, False):
            make = longer(factor) if told else untold(longer(factor))
            made = [make(corridor, np.random.default_rng(0)) for corridor in corridors]
            done = [run(recording, out=Output(progress=progress)).summary for recording in made]
            rows.append(
                LengthRow(
                    name,
                    told,
                    [one["false_ok_share"] for one in done],
                    [one["ok_share"] for one in done],
                    [is_trusted(one) for one in done],
                )
            )
    return rows


def lengths_markdown(rows: Sequence[LengthRow]) -> str:
    """The table of the documentation: frames of 100, **bold** where the run is trusted all the same."""
    changes = dict.fromkeys(row.change for row in rows)
    of = {(row.change, row.told): row for row in rows}
    header = ("T_CF's length", "nothing lasts, as stated: wrong", "OK", "nothing said: wrong", "OK")
    lines = []
    for change in changes:
        cells = [change]
        for told in (True, False):
            row = of[change, told]
            wrong = zip(row.false_ok, row.trusted, strict=True)
            cells.append(
                ", ".join(f"**{100 * w:.0f}**" if trusted else f"{100 * w:.0f}" for w, trusted in wrong)
            )
            cells.append(", ".join(f"{100 * ok:.0f}" for ok in row.ok))
        lines.append(cells)
    return markdown_table(header, lines)
