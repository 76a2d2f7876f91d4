"""Pictures of runs: the way seen from above, and the error over time beside what the filter claims.

Seen from above means W's x-z plane: W is the camera's optical frame at the start, so z goes ahead (drawn to
the right) and x to the right (drawn downwards).  What is in a picture, it says itself.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from collabslam.evaluation.record import RunRecord
from collabslam.formats.files import write_bytes
from collabslam.types import Array, Indices, Mask

if TYPE_CHECKING:
    from collabslam.evaluation.scoring import AlignedTruth
    from collabslam.results import SubmapPoses
    from collabslam.runs.runner import RunResult


TRUTH, WORN, POINTS, LOOPS, PERSONS = "#1b1b1b", "#f2b134", "#8a94a0", "#2a9d6f", "#b97f0a"
COLOURS = {"mono": "#d1495b", "mono-undelayed": "#b5651d", "collab-init": "#6a8d3a", "collab": "#1d6fa5",
           "collab-tight": "#5b3a8e"}  # fmt: skip
NOT_OK = {"NOT_STARTED": "#b4bcc4", "DEGRADED": "#e08e0b", "COASTING": "#6a737d", "LOST": "#c1121f"}
"""Colour of each status that is not OK."""
_OTHERS = ("#2a6f97", "#bc4b51", "#5b8e7d", "#7d4f9e", "#b5651d")
"""Of runs whose modes are the same."""
SIGMAS = 3.0
_MOST_BAND = 4.0
"""Height of the axis of errors in that of the largest error; a band that is higher is cut off, and told."""
_ELLIPSES = 12
_SURE_M = 0.3


def plot_run(result: RunResult, path: Path) -> None:
    """Write the picture of one run: top view with covariance ellipses, error and 3-sigma below."""
    summary = result.summary
    figure, top, bottom = _canvas((9.0, 7.2), f"{summary['recording']}, {summary['mode']}", _told(summary))
    colour = COLOURS.get(summary["mode"], POINTS)
    _truth(top, result.truth)
    _path(top, result.record, colour, "the robot's way, as found", ends=True)
    _loops(top, result.submaps)
    _scene(top, [result])
    _errors(bottom, result.record, result.truth, colour, "")
    _dress_errors(bottom, [result])
    _save(figure, path)


def plot_comparison(results: Mapping[str, RunResult], path: Path, *, title: str) -> None:
    """Write one picture of several runs of the same recording against the truth.

    Parameters
    ----------
    results : mapping of label to RunResult
        Drawn in this order; worn camera, truth and map are those of the last one.
    path : Path
    title : str
    """
    runs = list(results.values())
    figure, top, bottom = _canvas((9.0, 7.2), title, "Seen from above, both ways from one start.")
    _truth(top, runs[-1].truth)
    modes = [result.summary["mode"] for result in runs]
    alike = len(set(modes)) < len(modes)
    colours = _OTHERS if alike else [COLOURS.get(mode, POINTS) for mode in modes]
    for (label, result), colour in zip(results.items(), itertools.cycle(colours), strict=False):
        _path(top, result.record, colour, f"{label}{_verdict(result.summary)}", ends=len(runs) == 1)
        _errors(bottom, result.record, result.truth, colour, label.partition(" (")[0])
    _scene(top, runs)
    _dress_errors(bottom, runs)
    _save(figure, path)


def position_covariances(record: RunRecord) -> Array:
    """(N, 3, 3) covariance of the position along W's axes, m^2: ``R P_tt R^T``, since the tangent is in C."""
    rotation = record.poses[:, :3, :3]
    return np.asarray(rotation @ record.covariances[:, :3, :3] @ np.swapaxes(rotation, 1, 2))


def position_errors(record: RunRecord, truth: AlignedTruth) -> Array:
    """(N,) distance of each pose from the true one, in the unit of lengths; NaN where either is missing."""
    error = np.linalg.norm(record.poses[:, :3, 3] - truth.poses[:, :3, 3], axis=1)
    return np.where(truth.known & record.valid, error, np.nan)


def _canvas(size: tuple[float, float], title: str, told: str) -> tuple[Figure, Axes, Axes]:
    """A figure of that size, inches, with the panel of the way and, below, that of the error."""
    figure = Figure(figsize=size, dpi=100)
    figure.suptitle(title, fontsize=14, fontweight="bold", y=0.985)
    figure.text(0.5, 0.932, told, ha="center", fontsize=10.5, color="#57606a")
    top, bottom = figure.add_axes((0.085, 0.465, 0.895, 0.445)), figure.add_axes((0.085, 0.08, 0.895, 0.255))
    for axes in (top, bottom):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e6e8eb", linewidth=0.7)
        axes.set_axisbelow(True)
    return figure, top, bottom


def _told(summary: Mapping[str, Any]) -> str:
    """A run in a sentence: how far it went, how far off it was or how sure it is."""
    unit = "m" if summary["metric"] else "arbitrary units"
    if summary.get("start_frame", 0) is None:
        return f"The filter never started in {summary['frames']} frames."
    length = f"{summary['path_length_m']:.1f} {unit}" if summary.get("path_length_m") else "no way known"
    text = f"Seen from above: {length} in {summary['frames']} frames"
    sd, off = summary.get("position_sd_final_m"), _verdict(summary)
    sure = f", at the end known to {sd:.2f} {unit} (1 sigma)" if isinstance(sd, float) and not off else ""
    return f"{text}{off or sure}."


def _verdict(summary: Mapping[str, object]) -> str:
    error, share = summary.get("avg_position_error_m"), summary.get("avg_error_pct")
    if not isinstance(error, float):
        return ""
    return f", {error:.2f} m off on average" + (
        f" ({share:.1f} % of the path)" if isinstance(share, float) else ""
    )


def _unit(result: RunResult) -> str:
    """Of lengths, for an axis."""
    return "m" if result.summary["metric"] else "arbitrary unit"


def _path(axes: Axes, record: RunRecord, colour: str, label: str, *, ends: bool) -> None:
    """The valid poses, with the 3-sigma ellipse of some of them; the gaps are where none is valid."""
    use = record.valid
    shown = np.where(use[:, None], record.poses[:, :3, 3], np.nan)
    axes.plot(shown[:, 2], shown[:, 0], color=colour, linewidth=2.0, label=label, zorder=4)
    valid = np.flatnonzero(use)
    if len(valid):
        covariances = position_covariances(record)
        some = valid[np.linspace(0, len(valid) - 1, _ELLIPSES).astype(int)]
        for i in _apart(some, shown, covariances):
            _ellipse(axes, shown[i], covariances[i], colour)
        for at, what, fill, below in ((valid[0], "start", "none", 9), (valid[-1], "end", "full", -15)):
            z, x = float(shown[at, 2]), float(shown[at, 0])
            axes.plot(z, x, "o", markersize=7, color=colour, fillstyle=fill, zorder=5)
            if ends:
                axes.annotate(what, (z, x), (4, below), textcoords="offset points", fontsize=9, zorder=7)


def _apart(frames: Indices, positions: Array, covariances: Array) -> list[int]:
    """The last of some frames, and backwards each that lies outside the ellipses of those taken."""
    taken: list[int] = []
    for i in reversed(np.unique(frames).tolist()):
        offsets = [positions[i, [2, 0]] - positions[j, [2, 0]] for j in taken]
        spreads = [covariances[j][np.ix_([2, 0], [2, 0])] for j in taken]
        if all(
            float(off @ np.linalg.pinv(spread) @ off) > SIGMAS**2
            for off, spread in zip(offsets, spreads, strict=True)
        ):
            taken.append(i)
    return taken


def _ellipse(axes: Axes, centre: Array, covariance: Array, colour: str) -> None:
    """The 3-sigma ellipse of a position in the (z, x) picture."""
    variances, directions = np.linalg.eigh(covariance[np.ix_([2, 0], [2, 0])])
    height, width = 2.0 * SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    shape = Ellipse((centre[2], centre[0]), width, height, angle=angle, facecolor=colour, edgecolor=colour)
    shape.set(alpha=0.16, linewidth=0.8, zorder=3)
    axes.add_patch(shape)


def _truth(axes: Axes, truth: AlignedTruth | None) -> None:
    if truth is not None:
        p = np.where(truth.known[:, None], truth.poses[:, :3, 3], np.nan)
        axes.plot(
            p[:, 2], p[:, 0], color=TRUTH, linewidth=1.6, linestyle=(0, (4, 2)), label="truth", zorder=5
        )


def _loops(axes: Axes, submaps: SubmapPoses | None) -> None:
    """Where submaps ended, as loops correct them; a line from each one seen to where that was."""
    if submaps is None or len(submaps.poses) < 2:
        return
    p = submaps.poses[:, :3, 3]
    name = "ends of submaps, corrected by loops" if submaps.loops else "ends of submaps"
    style: dict[str, Any] = {"linewidth": 1.0 if submaps.loops else 0.0, "markersize": 4, "zorder": 4}
    axes.plot(p[:, 2], p[:, 0], color=LOOPS, marker=".", label=name, **style)
    for k, loop in enumerate(submaps.loops):
        ends = p[[loop.first, loop.second]]
        label = "place seen again (loop)" if k == 0 else None
        axes.plot(ends[:, 2], ends[:, 0], color=LOOPS, linewidth=2.2, label=label, zorder=6)


def _deviation(covariances: Array) -> Array:
    """Standard deviations (N,) over all axes of covariances (N, 3, 3)."""
    return np.asarray(np.sqrt(np.maximum(np.trace(covariances, axis1=1, axis2=2), 0.0)))


def _scene(axes: Axes, runs: list[RunResult]) -> None:
    """What surrounds the paths: map and worn camera of the last run, limits, labels."""
    low, high = _view_box(runs)
    last = runs[-1]
    landmarks = last.landmarks if last.submaps is None else last.submaps.landmarks
    points = np.asarray(landmarks.points, np.float64).reshape(-1, 3)
    sd = _deviation(np.asarray(landmarks.covariance, np.float64).reshape(-1, 3, 3))
    sure = sd < _SURE_M
    if (valid := last.record.valid).any():  # as sure as the way beside them, but for so much
        way = last.record.poses[valid, :3, 3]
        apart = np.linalg.norm(points[:, None, ::2] - way[None, :, ::2], axis=2)
        beside = _deviation(last.record.covariances[valid, :3, :3])[np.argmin(apart, axis=1)]
        sure = sd < _SURE_M + beside
    if sure.any():
        style_of: dict[str, Any] = {"s": 7, "color": POINTS, "linewidths": 0, "zorder": 1}
        axes.scatter(points[sure, 2], points[sure, 0], label="points of the map", **style_of)
    there = _worn(last.record)
    there[1:] |= there[:-1]  # up to the frame after: a single view is seen as well
    worn = np.where((last.record.valid & there)[:, None], last.record.poses[:, :3, 3], np.nan)
    if np.isfinite(worn).any():
        style: dict[str, Any] = {"color": WORN, "linewidth": 11, "alpha": 0.35, "solid_capstyle": "round"}
        axes.plot(worn[:, 2], worn[:, 0], label="worn camera at hand", zorder=2, **style)
    _persons(axes, last.record)
    box = axes.get_window_extent()
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    half_z = max(half[2], half[0] * box.width / box.height)
    half_x = half_z * box.height / box.width
    axes.set_xlim(middle[2] - half_z, middle[2] + half_z)
    axes.set_ylim(middle[0] + half_x, middle[0] - half_x)
    unit = _unit(last)
    axes.set_xlabel(f"ahead of the start, z ({unit})")
    axes.set_ylabel(f"to the right, x ({unit})")
    axes.add_patch(Ellipse((np.nan, np.nan), 1, 1, color=POINTS, alpha=0.3, label="3 sigma of the position"))
    axes.legend(loc="best", fontsize=9, framealpha=0.9)


def _persons(axes: Axes, record: RunRecord) -> None:
    """Where each of several persons' worn cameras was when its views were measured."""
    frames = [step.worn for step in record.steps]
    names = dict.fromkeys(name for places in frames for name in places if name)
    for name, marker in zip(names, itertools.cycle("^vs<>D")):
        places = [places[name] for places in frames if name in places and places[name].measured]
        if places:
            p = np.array([place.pose[:3, 3] for place in places])
            label = f"worn camera of {name}"
            axes.plot(p[:, 2], p[:, 0], marker, color=PERSONS, markersize=4, label=label, zorder=3)


def _view_box(runs: list[RunResult]) -> tuple[Array, Array]:
    """Corners (3,) of what the top view shows: truth and estimates with a margin.

    A run that drifts by more than the extent of the truth leaves the picture instead of shrinking the rest.
    """
    truths = [r.truth.poses[r.truth.known, :3, 3] for r in runs if r.truth is not None]
    points = np.concatenate([r.record.poses[r.record.valid, :3, 3] for r in runs])
    true = np.concatenate(truths) if truths else points
    if not len(true):
        return -np.ones(3), np.ones(3)
    low, high = true.min(axis=0), true.max(axis=0)
    points = np.concatenate([true, np.clip(points, low - (high - low).max(), high + (high - low).max())])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(0.5, 0.12 * float((high - low)[[0, 2]].max()))
    return low - margin, high + margin


def _errors(axes: Axes, record: RunRecord, truth: AlignedTruth | None, colour: str, label: str) -> None:
    """Position error of the valid poses, with a band up to 3 sigma along the worst direction."""
    t = record.times - record.times[0] if len(record) else record.times
    of = f"{label}: " if label else ""
    band = _band(record)
    axes.fill_between(t, 0.0, band, color=colour, alpha=0.14, linewidth=0)
    axes.plot(t, band, color=colour, linewidth=1.0, linestyle=":", label=f"{of}3 sigma, as told")
    if truth is not None:
        error = position_errors(record, truth)
        axes.plot(t, error, color=colour, linewidth=2.0, label=f"{of}error", zorder=3)
    statuses = np.array(record.statuses, dtype=object)
    style: dict[str, Any] = {"marker": "|", "markersize": 9, "linewidth": 0, "clip_on": False, "zorder": 6}
    for status, shade in NOT_OK.items():
        at = t[statuses == status]
        if len(at):
            axes.plot(at, np.zeros(len(at)), color=shade, label=f"{of}{status}", **style)


def _band(record: RunRecord) -> Array:
    """(N,) 3 sigma of the position along its worst direction; NaN where there is no pose."""
    band = np.full(len(record), np.nan)
    valid = record.valid
    largest = np.linalg.eigvalsh(record.covariances[valid, :3, :3])[:, -1]
    band[valid] = SIGMAS * np.sqrt(np.maximum(largest, 0.0))
    return band


def _worn(record: RunRecord) -> Mask:
    """(N,) whether a view of the worn camera was at hand."""
    return np.array(record.worn, bool)


def _worn_spans(axes: Axes, record: RunRecord) -> None:
    on = _worn(record)
    if not on.any():
        return
    t = record.times - record.times[0]
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    for k, (a, b) in enumerate(zip(edges[::2], edges[1::2] - 1, strict=True)):
        name = "worn camera at hand" if k == 0 else None
        axes.axvspan(t[a], t[b] + step, color=WORN, alpha=0.2, linewidth=0, zorder=0, label=name)


def _dress_errors(axes: Axes, runs: list[RunResult]) -> None:
    """Worn camera, labels, and a range that shows errors and bands; what is far above errors is cut."""
    _worn_spans(axes, runs[-1].record)
    errors = [position_errors(run.record, run.truth) for run in runs if run.truth is not None]
    bands = [_band(run.record) for run in runs]
    largest, highest = (float(np.nanmax(np.concatenate([*of, [0.0]]))) for of in (errors, bands))
    unit = _unit(runs[-1])
    top = highest if largest == 0.0 else min(highest, _MOST_BAND * largest)
    top = max(1.15 * largest, 1.08 * top)
    axes.set_ylim(0.0, top if top > 0.0 else None)
    if highest > 1.05 * top > 0.0:
        note = f"3 sigma goes up to {highest:.2g} {unit}"
        axes.text(0.995, 0.96, note, transform=axes.transAxes, ha="right", va="top", fontsize=9)
    longest = max((float(np.ptp(run.record.times)) for run in runs if len(run.record)), default=0.0)
    axes.set_xlim(0.0, longest or 1.0)
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"position error ({unit})" if largest > 0.0 else f"3 sigma of the position ({unit})")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(-0.01, 1.0),
            fontsize=9,
            ncols=5,
            columnspacing=1.0,
            handlelength=1.5,
            frameon=False,
        )


def _save(figure: Figure, path: Path) -> None:
    """Written as a whole, without date or version, so that equal runs give equal files."""
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    write_bytes(path, buffer.getvalue())
