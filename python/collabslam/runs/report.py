"""Summaries as text: one run, or several side by side."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Summary = Mapping[str, Any]
_MISSING = "-"


def number(value: Any, digits: int = 3, unit: str = "", scale: float = 1.0) -> str:
    """A number with a fixed count of decimals; a dash where there is none."""
    if not isinstance(value, int | float) or math.isnan(value):
        return _MISSING
    return f"{scale * value:.{digits}f}{' ' + unit if unit else ''}"


STAGES = ("predict", "search", "cf", "update", "map", "rest")
"""What a frame's time is spent on: METHOD 7.1-2, 7.3, 7.4, 7.5-7, 7.8, and telling what was done."""


LINES: tuple[tuple[str, Callable[[Summary], str]], ...] = (
    ("frames with a pose", lambda s: number(s["coverage"], 1, "%", 100.0)),
    ("frames OK", lambda s: f"{s['frames_ok']} of {s['frames']} ({number(s['ok_share'], 1, '%', 100.0)})"),
    ("false OK (over 5 sigma off)", lambda s: number(s["false_ok_share"], 1, "%", 100.0)),
    ("status at the end", lambda s: str(s["status_final"])),
    ("path length", lambda s: _path(s)),
    ("duration, speed", lambda s: _speed(s)),
    ("position at the end known to", lambda s: number(s.get("position_sd_final_m"), 3, "m (1 sigma)")),
    ("worn camera Cf", lambda s: _worn(s)),
    ("ATE, all frames", lambda s: _all_frames(s)),
    ("average position error", lambda s: _with_share(s["avg_position_error_m"], s["avg_error_pct"])),
    ("final position error", lambda s: _with_share(s["final_position_error_m"], s["final_error_pct"])),
    ("ATE of frames with a pose", lambda s: _with_share(s["ate_rmse_m"], s["ate_pct"])),
    ("scale error", lambda s: number(s["scale_error"], 1, "%", 100.0)),
    ("NEES position, attitude", lambda s: _pair(s, "nees", 1, " (expected 3)")),
    ("error over claimed sd", lambda s: _pair(s, "sharpness", 2, " (expected 1)")),
    ("features a frame", lambda s: number(s["features_per_frame"], 1)),
    ("loops found", lambda s: _loops(s)),
    ("overlap", lambda s: number(s["overlap_ratio"], 0, "%", 100.0)),
    ("measurements with depth", lambda s: str(s["depth_measurements"])),
    ("time a frame", lambda s: number(step_ms(s), 1, "ms")),
    ("  99 of 100 within", lambda s: number(s["ms_p99"], 1, "ms")),
    ("  the slowest", lambda s: number(s["ms_max"], 1, "ms")),
    *((f"  {stage}", lambda s, stage=stage: _stage(s, stage)) for stage in STAGES),
)
"""What a summary shows on a terminal: label and text."""


def step_ms(summary: Summary) -> float | None:
    """Mean milliseconds a frame takes, without reading or rendering images."""
    value = summary["ms_per_frame"].get("step")
    return None if value is None else float(value)


def stage_ms(summary: Summary, stage: str) -> float | None:
    """Mean milliseconds a frame spends in one of `STAGES`."""
    means, step = summary["ms_per_frame"], step_ms(summary)
    if stage != "rest":
        value = means.get(stage)
        return None if value is None else float(value)
    if step is None or "total" not in means:
        return None
    return max(0.0, step - float(means["total"]))


def summary_text(summary: Summary) -> str:
    """The summary of one run as a short table, without what it does not have, as errors without a truth."""
    head = f"{summary['recording']}, {summary['mode']}, start {summary['start']}"
    if summary["start_frame"] is None:
        head += " (the filter never started)"
    elif summary["interrupted"]:
        head += f" (interrupted after {summary['frames']} frames)"
    if not summary["metric"]:
        head += f" (lengths are in {summary['unit']}, not metres)"
    rows = [[label, said] for label, text in LINES if (said := text(summary)) != _MISSING]
    return (
        head
        + "\n"
        + text_table([*rows, *_gyro(summary), *_worn_gyro(summary), *_level(summary), *_persons(summary)])
    )


_BRIEF = (
    "frames OK",
    "status at the end",
    "path length",
    "duration, speed",
    "position at the end known to",
    "worn camera Cf",
    "ATE, all frames",
)


def brief_text(summary: Summary) -> str:
    """What came out of a run in a few lines."""
    rows = [[label, said] for label, text in LINES if label in _BRIEF and (said := text(summary)) != _MISSING]
    return f"run of {summary['recording']}, {summary['mode']}\n{text_table(rows)}"


DEGRADED_BY = {
    "gyro": "the gyroscope turns otherwise than the images do",
    "t_cf": "the images contradict T_CF by more than its covariance allows",
    "cf_matches": "points of the map are elsewhere in Cf than T_CF and its covariance say",
    "size": "Cf sees points of the map nearer or farther than the map has them, all by one factor",
    "jump": "the camera was found again where it cannot have got to since the frame before",
    "matches": "more matches are refused than a scene that stands still leaves",
    "moving": "new points do not move as those of a scene that stands still, seen by a camera that moves and "
    "does not only turn",
    "noise": "features are found farther from where they are expected than the noise that is claimed",
    "attitude": "the camera's attitude in W is not known to 20 degrees (one sd)",
}
"""Why frames are DEGRADED, by the cause in ``frames.csv``."""


FIXED = (
    "points turn with the camera and were left out with what is near them in the image: something is fixed "
    "to it (a hood, dirt on the lens, an overlay)"
)
"""What is said of a number of such points."""


def unused_text(summary: Summary) -> str:
    """What of the stream could not be used, empty if all could."""
    counts = (
        ("frames_out_of_order", "left out, whose time stamps repeat or go back"),
        ("frames_slipped", "contradict odometry or gyroscope, as where wheels slip"),
        ("frames_unseen", "only predicted, whose image is blank or repeats the last"),
    )
    parts = [f"{summary[key]} frames {what}" for key, what in counts if summary.get(key)]
    if points := summary.get("points_fixed_to_camera"):
        parts.append(f"{points} {FIXED}")
    return "; ".join(parts)


def untrusted_text(summary: Summary) -> str:
    """Why a run is not to be trusted."""
    if summary["start_frame"] is None:
        return "the filter never started"
    ok, frames = summary["frames_ok_reported"], summary["frames"]
    text = f"the run is not to be trusted: {ok} of {frames} frames say OK"
    if summary["frames_degraded"]:
        text += (
            f", {summary['frames_degraded']} are DEGRADED: {DEGRADED_BY[next(iter(summary['degraded_by']))]}"
        )
    return f"{text}; the last one is {summary['status_final']}"


def side_by_side(summaries: Mapping[str, Summary]) -> str:
    """Several runs of one recording, a column for each."""
    rows = [["", *summaries]]
    rows += [[label, *(text(s) for s in summaries.values())] for label, text in LINES]
    return text_table(rows)


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as aligned columns."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    lines = ("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
    return "\n".join("  " + line.rstrip() for line in lines)


def median_of(summaries: Sequence[Summary], key: str) -> float | None:
    """Median of a number over runs; None if no run has it."""
    values = [s[key] for s in summaries if isinstance(s.get(key), int | float)]
    return float(statistics.median(values)) if values else None


def median_summary(summaries: Sequence[Summary]) -> dict[str, Any]:
    """One summary whose numbers are the medians over runs; what is not a number is the first run's."""
    first = summaries[0]
    out: dict[str, Any] = dict(first)
    for key, value in first.items():
        if isinstance(value, bool | str):
            continue
        middle = median_of(summaries, key)
        if middle is not None:
            out[key] = int(middle) if all(isinstance(s.get(key), int) for s in summaries) else middle
    stages = [s["ms_per_frame"] for s in summaries]
    out["ms_per_frame"] = {k: median_of(stages, k) for k in stages[0]}
    return out


def _stage(summary: Summary, stage: str) -> str:
    value, step = stage_ms(summary, stage), step_ms(summary)
    if value is None or not step:
        return _MISSING
    return f"{value:.1f} ms ({100.0 * value / step:.0f} %)"


def _path(summary: Summary) -> str:
    """How far, by the truth or by itself."""
    length = number(summary["path_length_m"], 2, "m")
    own = length != _MISSING and summary.get("path_length_of") == "estimate"
    return f"{length}, by its own poses" if own else length


def _speed(summary: Summary) -> str:
    seconds, metres = summary.get("duration_s"), summary["path_length_m"]
    if not seconds:
        return _MISSING
    return f"{seconds:.1f} s" + (f", {metres / seconds:.2f} m/s" if metres is not None else "")


def _worn(summary: Summary) -> str:
    """What Cf did."""
    frames = summary.get("frames_worn")
    if not frames:
        return _MISSING
    born = summary.get("births_instant", 0)
    return f"in {frames} of {summary['frames']} frames; {born} points got their depth by it"


def _all_frames(summary: Summary) -> str:
    """The error with what it was laid over the truth by, which says whether its scale is part of it."""
    error = summary["ate_pct_all_frames"]
    return _MISSING if error is None else f"{error:.2f} % of the path ({summary['ate_alignment']})"


def _pair(summary: Summary, what: str, digits: int, note: str) -> str:
    """Position and attitude side by side."""
    values = [summary[f"{what}_{part}"] for part in ("position", "attitude")]
    return _MISSING if None in values else ", ".join(number(v, digits) for v in values) + note


def _gyro(summary: Summary) -> list[list[str]]:
    """What a gyroscope gave, and what came out of it."""
    gyro = summary.get("gyro")
    if not gyro:
        return []
    bias = " ".join(f"{b:.4f}" for b in gyro["bias_rad_s"])
    dropped = "" if gyro["followed"] else "; left aside, the images contradict it"
    clock = number(gyro["clock_offset_s"], 1, "ms", 1e3)
    return [
        ["gyroscope", f"{gyro['samples']} samples, turned {gyro['frames']} frames{dropped}"],
        ["  bias", f"{bias} rad/s (sd {max(gyro['bias_sd_rad_s']):.4f})"],
        ["  added to its stamps", f"{clock} (sd {number(gyro['clock_offset_sd_s'], 1, scale=1e3)})"],
    ]


def _worn_gyro(summary: Summary) -> list[list[str]]:
    """In how many views a gyroscope of Cf told how it turned."""
    told = summary.get("worn_gyro")
    if not told:
        return []
    against = f"; {told['contradicted']} contradict it" if told["contradicted"] else ""
    return [["gyroscope of Cf", f"told how it turned in {told['used']} views{against}"]]


def _level(summary: Summary) -> list[list[str]]:
    """How Cs was turned against the horizon at the start."""
    level = summary.get("level")
    if not level:
        return []
    angles = f"{level['roll_deg']:.1f}, {level['pitch_deg']:.1f} degrees (sd {level['sd_deg']:.1f})"
    return [["roll, pitch at the start", f"{angles}, {level['source']}"]]


def _persons(summary: Summary) -> list[list[str]]:
    """What each of several persons gave."""
    return [
        [
            f"worn camera of {of['name']}",
            f"located by matches in {of['measured']} of {of['views']} views, {number(of['matches'], 1)} each",
        ]
        for of in summary["worn"]
        if of["name"]
    ]


def _loops(summary: Summary) -> str:
    """How many, between how many submaps, and by how much the camera was off at the largest of them."""
    loops, submaps = summary["loops"], summary["submaps"]
    if not loops:
        return f"none between {submaps} submaps"
    worst = max(loops, key=lambda loop: loop["residual_m"])
    off = f"{worst['residual_m']:.2f} m, {worst['residual_deg']:.1f} deg"
    return f"{len(loops)} between {submaps} submaps, off by {off} at most"


def _with_share(metres: Any, percent: Any) -> str:
    if not isinstance(metres, int | float):
        return _MISSING
    share = f" ({percent:.2f} % of the path)" if isinstance(percent, int | float) else ""
    return f"{metres:.3f} m{share}"
