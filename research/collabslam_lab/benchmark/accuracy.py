"""The page of measured accuracy: medians over the seeds, consistency, cost, other systems."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from typing import Any

from collabslam.evaluation.consistency import nees_band
from collabslam.evaluation.headline import SIM3
from collabslam.runs.report import median_of, number
from collabslam_lab.benchmark import overall
from collabslam_lab.benchmark.figures import BASE, differences, medians, split
from collabslam_lab.benchmark.plan import Entry, Plan
from collabslam_lab.benchmark.store import Row
from collabslam_lab.report import markdown_table

WITHIN = 2.0
"""Factor on both ends of a NEES band that still counts as near it."""
_STAGES = ("predict", "search", "cf", "update", "map", "total")

Cells = Callable[[Entry, str, list[Row], list[Row]], list[str] | None]


def page(plan: Plan, rows: Sequence[Row], missing: Sequence[str], how: str = "") -> str:
    """All tables, as Markdown; ``how`` is the command that made them."""
    seeds = sorted({row["seed"] for row in rows})
    spoken = ", ".join(map(str, seeds)) or "none"
    parts = [
        "# Measured accuracy",
        f"```sh\n{how}\n```",
        "Every recording of a plan is run (by default the package's own, whose folders lie in `DATA`; "
        "`--help` shows how to write one), in parallel; a call goes on where the last one stopped. This is "
        "what it writes, beside `evaluate.json` (`recordings`: the medians by recording and mode, "
        "under the names of `summary.json`) and a result folder for each run. Medians over the "
        f"seeds {spoken} of the noise of T_CF, of which there is one error for each block of overlap.",
        "## Error",
        "ATE over all frames, in percent of the path: where the filter gives no valid pose its last or "
        "predicted one counts. No scale is fitted, but for a `scale-free` start (*Sim(3)*). *with a pose*: "
        "share of the frames with a valid pose, and the ATE over those alone. A frame is OK if it has at "
        "least 8 accepted matches, or repeats the image of one that has for less than 0.1 s, and its pose is "
        "within 5 sigma of the truth; *false OK*: it claims so, and is further off. *independent*: with "
        "an error of T_CF of its own in each frame, which averages out.",
        _table(plan, rows, _ERROR, _error_cells),
        "All recordings together, by which a change of the filter is judged:",
        overall.table(medians(plan, split(rows)[0])),
        *_paired(plan, rows),
        "## Consistency of the covariance",
        _consistency_text(),
        _table(plan, rows, _CONSISTENCY, _consistency_cells),
        *_pooled(plan, rows),
        "## Beside other systems",
        "ATE after a Sim(3) alignment (scale fitted, as it must be for a monocular system), percent of the "
        "path, over all valid frames from the start on, with their share of all frames: which frames the "
        "other system tracked is not known beyond their number.",
        _table(plan, rows, _OTHERS, _other_cells),
        "## Milliseconds a frame",
        "Wall time of one thread: 99 of 100 frames need at most, the slowest, and means per stage. Compare "
        "within one table only: what else the machine did is in it (`make bench-frames` is for quiet ones).",
        _table(plan, rows, (*_HEAD, "p99", "slowest", *_STAGES), _cost_cells),
    ]
    failed = [row for row in rows if row["status"] != "done"]
    if failed or missing:
        parts.append("## Not measured")
        parts += [f"- {name}: not in the folder" for name in missing]
        parts += [f"- {r['recording']} {r['mode']} seed {r['seed']}: {r['error']}" for r in failed]
    return "\n\n".join(part for part in parts if part) + "\n"


_HEAD = ("recording", "worn camera", "mode")
_ERROR = (*_HEAD, "ATE, all frames, %", "with a pose, %", "ATE of these, %", "frames OK, %",
          "false OK, %", "independent: ATE, all frames, %", "with a pose, %", "scale error, %",
          "features a frame", "frames", "target, px")  # fmt: skip
_CONSISTENCY = (*_HEAD, "with a pose, %", "NEES position", "in its band", "NEES attitude", "in its band",
            "error over sd: position", "attitude", "over the bound, %", "bound over error: position",
            "attitude", "independent: NEES position", "attitude")  # fmt: skip
_OTHERS = (*_HEAD, "ours, Sim(3), %", "with a pose, %", "other, Sim(3), %", "ratio", "other's poses",
           "system")  # fmt: skip


def worn_text(entry: Entry) -> str:
    """How the worn camera is made, for a table."""
    return entry.worn or ("recorded" if entry.start == "worn" else "none")


def _table(plan: Plan, rows: Sequence[Row], header: Sequence[str], cells: Cells) -> str:
    """A line for each recording and mode that was run, in the order of the plan."""
    lines = []
    for entry in plan.recordings:
        for mode in entry.modes:
            runs = [r for r in rows if r["recording"] == entry.name and r["mode"] == mode]
            done = [r for r in runs if r["status"] == "done"]
            plain, independent = split(done)
            head = [entry.name, worn_text(entry), mode]
            if plain:
                made = cells(entry, mode, plain, independent)
                lines += [[*head, *made]] if made is not None else []
            elif runs:
                lines.append([*head, *(["failed"] * (len(header) - len(head)))])
    return markdown_table(header, lines) if lines else ""


def _error_cells(entry: Entry, mode: str, runs: list[Row], independent: list[Row]) -> list[str]:
    fitted = " (Sim(3))" if any(r["ate_alignment"] == SIM3 for r in runs) else ""
    error = number(median_of(runs, "ate_pct_all_frames"), 2)
    return [
        error + fitted if error != "-" else error,
        number(median_of(runs, "coverage"), 1, scale=100.0),
        number(median_of(runs, "ate_pct"), 2),
        number(median_of(runs, "ok_share"), 1, scale=100.0),
        number(median_of(runs, "false_ok_share"), 1, scale=100.0),
        number(median_of(independent, "ate_pct_all_frames"), 2),
        number(median_of(independent, "coverage"), 1, scale=100.0),
        number(median_of(runs, "scale_error"), 1, scale=100.0),
        number(median_of(runs, "features_per_frame"), 1),
        number(median_of(runs, "frames"), 0),
        number(median_of(runs, "target_residual_max_px"), 1),
    ]


def _paired(plan: Plan, rows: Sequence[Row]) -> list[str]:
    """By how much the error falls with Cf, seed by seed."""
    lines = [
        [
            d.recording,
            worn_text(next(e for e in plan.recordings if e.name == d.recording)),
            d.mode,
            f"{d.mean:+.2f}",
            "-" if d.low is None else f"{d.low:+.2f} to {d.high:+.2f}",
            str(d.pairs),
        ]
        for d in differences(plan, split(rows)[0])
    ]
    header = (*_HEAD, f"ATE, all frames, minus that of {BASE}, %", "95 % interval", "seeds")
    text = (
        f"What Cf brings: the difference to `{BASE}` with the same seed, in percent of the path, and the "
        "95 % interval of its mean over the seeds (Student's t)."
    )
    return [text, markdown_table(header, lines)] if lines else []


def _consistency_text() -> str:
    low, high = nees_band(3)
    return (
        "NEES of position and attitude, each with three degrees of freedom, averaged over the frames of a "
        "run: expected 3. Errors of neighbouring frames are correlated, and so are those of the seeds, "
        f"which share their images: the 95 % band is that of one draw, {low:.2f} to {high:.2f}. *yes*: "
        f"inside; *x{WITHIN:g}*: within a factor of {WITHIN:g} of it; *low* or *high*: outside. *error over "
        "sd*: root mean square error over the root mean square of the standard deviation that was claimed, 1 "
        "is consistent; a covariance that is much too large in some frames shows here. *over the bound*: of "
        "the frames that say OK, those further off than `StepResult.bound`, the mean over the seeds; *bound "
        "over error*: how many times the error it is, root mean squares."
    )


def band_word(value: Any, low: float, high: float) -> str:
    """Where a NEES lies: ``yes``, ``x2`` (within `WITHIN` of the band), ``low`` or ``high``."""
    if not isinstance(value, int | float):
        return "-"
    if low <= value <= high:
        return "yes"
    if low / WITHIN <= value <= high * WITHIN:
        return f"x{WITHIN:g}"
    return "low" if value < low else "high"


def _consistency_cells(entry: Entry, mode: str, runs: list[Row], independent: list[Row]) -> list[str] | None:
    position, attitude = (median_of(runs, f"nees_{what}") for what in ("position", "attitude"))
    if position is None:
        return None
    band = nees_band(3)
    return [
        number(median_of(runs, "coverage"), 1, scale=100.0),
        number(position, 2),
        band_word(position, *band),
        number(attitude, 2),
        band_word(attitude, *band),
        number(median_of(runs, "sharpness_position"), 2),
        number(median_of(runs, "sharpness_attitude"), 2),
        number(_mean_of(runs, "bound_exceeded_share"), 2, scale=100.0),
        number(median_of(runs, "bound_over_error_position"), 1),
        number(median_of(runs, "bound_over_error_attitude"), 1),
        number(median_of(independent, "nees_position"), 2),
        number(median_of(independent, "nees_attitude"), 2),
    ]


def _mean_of(runs: Sequence[Row], name: str) -> float | None:
    """What is rare would not show in a median."""
    values = [float(run[name]) for run in runs if run.get(name) is not None]
    return sum(values) / len(values) if values else None


def _pooled(plan: Plan, rows: Sequence[Row]) -> list[str]:
    """The mean over recordings, which are independent: its band is narrower."""
    lines = []
    for mode in dict.fromkeys(mode for entry in plan.recordings for mode in entry.modes):
        found = []
        for entry in plan.recordings:
            runs = [r for r in rows if r["recording"] == entry.name and r["mode"] == mode]
            runs = [r for r in split(runs)[0] if r["status"] == "done"]
            if median_of(runs, "nees_position") is not None:
                found.append([median_of(runs, f"nees_{w}") or 0.0 for w in ("position", "attitude")])
        if len(found) > 1:
            low, high = nees_band(3, len(found))
            means = [statistics.fmean(values) for values in zip(*found, strict=True)]
            words = [[number(m, 2), band_word(m, low, high)] for m in means]
            lines.append([mode, str(len(found)), f"{low:.2f} to {high:.2f}", *words[0], *words[1]])
    header = ("mode", "recordings", "band of the mean", "NEES position", "in its band", "NEES attitude",
              "in its band")  # fmt: skip
    text = "The mean over the recordings, which are independent of each other, has a narrower band:"
    return [text, markdown_table(header, lines)] if lines else []


def _other_cells(entry: Entry, mode: str, runs: list[Row], independent: list[Row]) -> list[str] | None:
    other, ours = entry.reference, median_of(runs, "ate_sim3_pct")
    if other is None or ours is None:
        return None
    lost = " (loses its way)" if other.lost else ""
    return [
        number(ours, 2),
        number(median_of(runs, "coverage"), 1, scale=100.0),
        number(other.ate_sim3_pct, 2) + lost,
        number(ours / other.ate_sim3_pct, 2),
        number(other.poses, 0),
        other.system,
    ]


def _cost_cells(entry: Entry, mode: str, runs: list[Row], independent: list[Row]) -> list[str]:
    stages = [r["ms_per_frame"] for r in runs]
    slow = [number(median_of(runs, key), 1) for key in ("ms_p99", "ms_max")]
    return [*slow, *(number(median_of(stages, stage), 1) for stage in _STAGES)]
