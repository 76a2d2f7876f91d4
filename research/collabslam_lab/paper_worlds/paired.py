"""What the worn camera brings, run by run against `mono` on the same pictures, with its interval.

METHOD
The ratio of the average errors of two modes on one recording and seed is a pair. Seeds share their scene, so
the logarithms of a sequence's ratios are averaged first; the interval is Student's t over the sequences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam.runs.report import number
from collabslam_lab.figures.finding import Table
from collabslam_lab.intervals import t_interval

BASE = "mono"
_COMPARED = ("collab", "collab-tight")
_LEAST = 1e-6


@dataclass(frozen=True)
class Gain:
    """A mode against `mono`.

    Attributes
    ----------
    mode, poses : str
    sequences, pairs : int
        How many there are of both.
    better : float
        Share of the sequences on which the mean over the seeds is better.
    ratio, ratio_low, ratio_high : float or None
        Geometric mean of the ratios of the average errors, and the ends of its 95 % interval.
    difference, difference_low, difference_high : float or None
        The same of the difference of the average errors, percent of the path.
    """

    mode: str
    poses: str
    sequences: int
    pairs: int
    better: float
    ratio: float
    ratio_low: float | None
    ratio_high: float | None
    difference: float
    difference_low: float | None
    difference_high: float | None


def gains(rows: Sequence[dict[str, Any]]) -> list[Gain]:
    """Every comparison that the rows allow; each has ``share``, its average error in percent of the path."""
    shares = {
        (r["mode"], r["poses"], r["sequence"], r["seed"]): max(float(r["share"]), _LEAST)
        for r in rows
        if r.get("final_error_pct") is not None
    }
    out = []
    for mode in _COMPARED:
        for poses in dict.fromkeys(r["poses"] for r in rows):
            pairs: dict[str, list[tuple[float, float]]] = {}
            for (of, source, sequence, seed), share in shares.items():
                base = shares.get((BASE, poses, sequence, seed))
                if of == mode and source == poses and base is not None:
                    pairs.setdefault(sequence, []).append((share, base))
            if pairs:
                out.append(_gain(mode, poses, list(pairs.values())))
    return out


def table(found: Sequence[Gain]) -> Table:
    """The gains."""
    lines = []
    for g in found:
        ratio = number(g.ratio, 2) + _interval(g.ratio_low, g.ratio_high)
        difference = number(g.difference, 2) + _interval(g.difference_low, g.difference_high)
        better = number(g.better, 0, "%", 100.0)
        lines.append(
            [f"{g.mode} against {BASE}", g.poses, str(g.sequences), str(g.pairs), better, ratio, difference]
        )
    header = (
        "modes", "pose of the worn camera", "sequences", "pairs", "sequences on which it is better",
        "ratio of average errors", "difference, % of the path",
    )  # fmt: skip
    return Table("Pairs of one recording and seed, 95 % intervals over the sequences:", header, lines)


def _gain(mode: str, poses: str, pairs: list[list[tuple[float, float]]]) -> Gain:
    logs = [float(np.mean([np.log(a / b) for a, b in group])) for group in pairs]
    differences = [float(np.mean([a - b for a, b in group])) for group in pairs]
    ratio = [None if x is None else float(np.exp(x)) for x in t_interval(logs)]
    better = float(np.mean([d < 0.0 for d in differences]))
    count = sum(len(group) for group in pairs)
    middle = float(np.exp(np.mean(logs)))
    return Gain(mode, poses, len(pairs), count, better, middle, ratio[1], ratio[2], *t_interval(differences))


def _interval(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f" ({number(low, 2)} to {number(high, 2)})"
