"""The ablation: every lever changed, one at a time, against the runs with nothing changed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from collabslam.runs.report import median_of, number
from collabslam_lab.benchmark.plan import Plan
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.report import markdown_table

BASE = "nothing changed"
_NUMBERS = (
    ("ate_pct_all_frames", 2, 1.0),
    ("coverage", 1, 100.0),
    ("ok_share", 1, 100.0),
    ("nees_position", 1, 1.0),
)


def lever_items(
    plan: Plan, data: Path, out: Path, present: Sequence[str], changes: Sequence[tuple[str, object]]
) -> list[Item]:
    """Every lever on every recording that can show it, the unchanged runs first."""
    ablation = plan.ablation
    items = []
    for entry in plan.recordings:
        modes = [mode for mode in ablation.modes if mode in entry.modes]
        if entry.name not in present:
            continue
        for seed in entry.seeds(ablation.seeds):
            for mode in modes:
                for lever, changed in {BASE: {}, **ablation.levers}.items():
                    merged = (*changes, *changed.items())
                    items.append(Item(entry, mode, seed, data, out, False, lever, merged))
    return items


def page(plan: Plan, rows: Sequence[Row], how: str = "") -> str:
    """A table for each mode: a line for each lever, medians over the seeds for each recording."""
    parts = [
        "# Ablation",
        f"```sh\n{how}\n```",
        "One lever changed at a time, everything else at its default; medians over the seeds "
        f"{', '.join(map(str, plan.ablation.seeds))}. For each recording: ATE over all frames in percent of "
        "the path (SE(3), no scale fitted) / frames with a pose in percent / frames OK in percent / NEES of "
        "the position (expected 3). *worse* is the geometric mean over the recordings of the ATE over that "
        "of the unchanged run.",
    ]
    for mode in plan.ablation.modes:
        names = [e.name for e in plan.recordings if any(_of(rows, BASE, mode, e.name))]
        if not names:
            continue
        lines = []
        for lever in (BASE, *plan.ablation.levers):
            runs = {name: _of(rows, lever, mode, name) for name in names}
            lines.append([lever, _worse(rows, lever, mode, names), *(_cell(runs[name]) for name in names)])
        parts += [f"## Mode `{mode}`", markdown_table(("lever", "worse", *names), lines)]
    if any(row["status"] != "done" for row in rows):
        parts.append("## Failed")
        parts += [
            f"- {r['lever']}, {r['recording']}, seed {r['seed']}: {r['error']}"
            for r in rows
            if r["status"] != "done"
        ]
    return "\n\n".join(parts) + "\n"


def _of(rows: Sequence[Row], lever: str, mode: str, name: str) -> list[Row]:
    return [r for r in rows if r.get("lever") == lever and r["mode"] == mode and r["recording"] == name]


def _cell(runs: Sequence[Row]) -> str:
    done = [r for r in runs if r["status"] == "done"]
    if not done:
        return "failed" if runs else "-"
    return " / ".join(number(median_of(done, key), digits, scale=scale) for key, digits, scale in _NUMBERS)


def _worse(rows: Sequence[Row], lever: str, mode: str, names: Sequence[str]) -> str:
    """Geometric mean of the ratios of the medians of the ATE."""
    product, count = 1.0, 0
    for name in names:
        mine, base = (
            median_of([r for r in _of(rows, which, mode, name) if r["status"] == "done"], _NUMBERS[0][0])
            for which in (lever, BASE)
        )
        if mine is not None and base:
            product, count = product * mine / base, count + 1
    return number(product ** (1.0 / count), 2) if count else "-"
