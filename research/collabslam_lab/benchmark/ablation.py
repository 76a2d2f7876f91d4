"""The ablation: every lever changed, one at a time, against the runs with nothing changed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from collabslam.runs.report import median_of, number
from collabslam_lab.benchmark.plan import Plan
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.report import markdown_table

BASE = "nothing changed"
ERROR = "ate_pct_all_frames"
_NUMBERS = (
    (ERROR, 2, 1.0),
    ("coverage", 1, 100.0),
    ("ok_share", 1, 100.0),
    ("false_ok_share", 1, 100.0),
    ("nees_position", 1, 1.0),
    ("nees_attitude", 1, 1.0),
)


def lever_items(
    plan: Plan, data: Path, out: Path, present: Sequence[str], changes: Sequence[tuple[str, object]]
) -> list[Item]:
    """Every lever on every recording that can show it, the unchanged runs first where the plan has them."""
    ablation = plan.ablation
    levers = {BASE: {}, **ablation.levers} if ablation.unchanged else ablation.levers
    items = []
    for entry in plan.recordings:
        modes = [mode for mode in ablation.modes if mode in entry.modes]
        if entry.name not in present:
            continue
        for seed in entry.seeds(ablation.seeds):
            for mode in modes:
                for lever, changed in levers.items():
                    merged = (*changes, *changed.items())
                    items.append(Item(entry, mode, seed, data, out, False, lever, merged))
    return items


def page(plan: Plan, rows: Sequence[Row], how: str = "") -> str:
    """A table for each mode: a line for each lever, medians over the seeds for each recording."""
    parts = [
        "# Ablation",
        f"```sh\n{how}\n```",
        "One lever changed at a time, everything else at its default; medians over the seeds "
        f"{', '.join(map(str, plan.ablation.seeds))}. *ATE* and *NEES*, *milliseconds*: geometric means over "
        "the recordings of what it is with the lever over what it is without; above 1 the rule pays. "
        "*elsewhere*: the same without the recording where the lever does most harm, the one that the rule "
        "may have been made for. *false OK*: the worst recording's, percent. *code*: lines of the files that "
        "serve the rule alone.",
    ]
    for mode in plan.ablation.modes:
        names = [e.name for e in plan.recordings if any(_of(rows, BASE, mode, e.name))]
        if not names:
            continue
        overall, lines = [], []
        for lever in (BASE, *plan.ablation.levers):
            runs = {name: _of(rows, lever, mode, name) for name in names}
            overall.append(_overall(rows, lever, mode, names, plan.ablation.code.get(lever, ())))
            lines.append([lever, *(_cell(runs[name]) for name in names)])
        parts += [
            f"## Mode `{mode}`",
            markdown_table(_OVERALL, overall),
            "By recording: ATE over all frames in percent of the path (SE(3), no scale fitted) / frames with "
            "a pose in percent / frames OK in percent / false OK in percent / NEES of position / of attitude "
            "(expected 3).",
            markdown_table(("lever", *names), lines),
        ]
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
    done = _done(runs)
    if not done:
        return "failed" if runs else "-"
    return " / ".join(number(median_of(done, key), digits, scale=scale) for key, digits, scale in _NUMBERS)


_OVERALL = (
    "lever", "ATE", "elsewhere", "with a pose, %", "OK, %", "false OK, %", "NEES position", "NEES attitude",
    "milliseconds", "code, lines",
)  # fmt: skip


def _overall(
    rows: Sequence[Row], lever: str, mode: str, names: Sequence[str], code: Sequence[str]
) -> list[str]:
    """What a lever does to all recordings together."""
    errors = _ratios(rows, lever, mode, names, ERROR)
    elsewhere = sorted(errors)[:-1]
    shares = [_medians(rows, lever, mode, names, key) for key in ("coverage", "ok_share", "false_ok_share")]
    return [
        lever,
        number(_geometric_mean(errors), 2),
        number(_geometric_mean(elsewhere), 2),
        *(number(sum(of) / len(of) if of else None, 1, scale=100.0) for of in shares[:2]),
        number(max(shares[2], default=None), 1, scale=100.0),
        *(
            number(_geometric_mean(_ratios(rows, lever, mode, names, key)), 2)
            for key in ("nees_position", "nees_attitude", "ms_total")
        ),
        str(lines) if (lines := _lines(code)) else "-",
    ]


def _medians(rows: Sequence[Row], lever: str, mode: str, names: Sequence[str], key: str) -> list[float]:
    found = (median_of(_done(_of(rows, lever, mode, name)), key) for name in names)
    return [median for median in found if median is not None]


def _ratios(rows: Sequence[Row], lever: str, mode: str, names: Sequence[str], key: str) -> list[float]:
    """By recording, the median with the lever over that without."""
    pairs = (
        [median_of(_done(_of(rows, which, mode, name)), key) for which in (lever, BASE)] for name in names
    )
    return [mine / base for mine, base in pairs if mine and base]


def _geometric_mean(values: Sequence[float]) -> float | None:
    return math.exp(sum(map(math.log, values)) / len(values)) if values else None


def _done(runs: Sequence[Row]) -> list[Row]:
    done = (row for row in runs if row["status"] == "done")
    return [{**row, "ms_total": row["ms_per_frame"]["total"]} for row in done]


def _lines(code: Sequence[str]) -> int:
    """Lines of these files of the project, where its sources are."""
    root = Path(__file__).parents[3]
    paths = (root / path for path in code)
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths if path.is_file())
