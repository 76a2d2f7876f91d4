"""A constant that recordings choose: scored on each one as the others choose it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from collabslam.runs.report import number
from collabslam_lab.benchmark.plan import Plan
from collabslam_lab.benchmark.store import Row
from collabslam_lab.report import markdown_table

SCORE = "log_score"
Scores = Mapping[str, Mapping[str, float]]
"""Mean of `SCORE` over the seeds, by recording and value."""


@dataclass(frozen=True)
class Candidates:
    """Values that a setting may have.

    Attributes
    ----------
    key : str
        The setting, or a switch, by its full dotted key.
    values : sequence
    """

    key: str
    values: Sequence[Any]

    def in_place_of_levers(self, plan: Plan) -> Plan:
        """A plan whose ablation has a lever for each value, named after it."""
        levers = {str(value): {self.key: value} for value in self.values}
        return replace(plan, ablation=replace(plan.ablation, levers=levers, unchanged=False))


def page(plan: Plan, rows: Sequence[Row], candidates: Candidates, how: str = "") -> str:
    """A table for each mode: the scores of each recording, and what all others choose for it."""
    parts = [
        f"# Which `{candidates.key}`?",
        f"```sh\n{how}\n```",
        "How likely the errors of position and attitude are under the covariance that is told (`log_score` "
        "of summary.json, means over the seeds); higher is better. *others choose*: the value with the best "
        "mean over all other recordings; *costs*: what that loses against the recording's own best.",
    ]
    for mode in plan.ablation.modes:
        scores = _scores(plan, rows, mode)
        if scores:
            parts += [f"## Mode `{mode}`", _table(scores, list(plan.ablation.levers))]
    parts += [
        f"- {r['lever']}, {r['recording']}, seed {r['seed']}: {r['error']}"
        for r in rows
        if r["status"] != "done"
    ]
    return "\n\n".join(parts) + "\n"


def chosen(scores: Scores, names: Sequence[str], values: Sequence[str]) -> str:
    """The value with the best mean over recordings."""
    return max(values, key=lambda value: sum(scores[name][value] for name in names))


def _scores(plan: Plan, rows: Sequence[Row], mode: str) -> Scores:
    """Of the recordings that have a score with every value."""
    out = {}
    for name in (entry.name for entry in plan.recordings):
        found: dict[str, list[float]] = {value: [] for value in plan.ablation.levers}
        for row in rows:
            if row["recording"] == name and row["mode"] == mode and row.get(SCORE) is not None:
                found[row["lever"]].append(float(row[SCORE]))
        if all(found.values()):
            out[name] = {value: sum(some) / len(some) for value, some in found.items()}
    return out


def _table(scores: Scores, values: Sequence[str]) -> str:
    lines = []
    for name, told in scores.items():
        others = [other for other in scores if other != name]
        choice = chosen(scores, others, values) if others else None
        cost = None if choice is None else max(told.values()) - told[choice]
        lines.append([name, *(number(told[v], 2) for v in values), choice or "-", number(cost, 2)])
    mean = [number(sum(told[v] for told in scores.values()) / len(scores), 2) for v in values]
    lines.append(["all", *mean, chosen(scores, list(scores), values), ""])
    return markdown_table(("recording", *values, "others choose", "costs"), lines)
