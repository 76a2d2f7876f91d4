"""An animated picture of several runs of one recording: what both cameras see, the ways, and the errors.

Ways and errors grow; without a truth there are only ways.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from collabslam.formats.files import write_bytes
from collabslam.results import CELL
from collabslam.types import Array, Image, Mask, Recording
from collabslam.viz.plot import COLOURS, TRUTH, WORN, position_errors

if TYPE_CHECKING:
    from collabslam.runs.runner import RunResult

STRIDE = 8
"""Every so many frames is drawn."""
SECONDS = 0.2
"""Time that each picture is shown."""
_SHADE = 0.4
"""Brightness that is kept of what is left out."""
_GREYS = 48
"""Shades that the cameras' pictures keep."""
_FOUND = "#3cc85a"


def animate(recording: Recording, results: Mapping[str, RunResult], path: Path) -> None:
    """Write an animated GIF.

    Parameters
    ----------
    recording : Recording
        The frames that were run.
    results : mapping of label to RunResult
        In the order of drawing; the features are those of the last one.
    path : Path
    """
    from io import BytesIO

    from PIL import Image as Pictures

    scene = _Scene(recording, results)
    last = min(len(result.record) for result in results.values()) - 1
    frames = [Pictures.fromarray(scene.draw(k)) for k in [*range(0, last, STRIDE), last]]
    palette = _palette(
        [*(COLOURS.get(r.summary["mode"], TRUTH) for r in results.values()), TRUTH, WORN, _FOUND]
    )
    quantized = [f.quantize(palette=palette, dither=Pictures.Dither.NONE) for f in frames]
    stream = BytesIO()
    times = [round(1e3 * SECONDS)] * (len(frames) - 1) + [2500]
    quantized[0].save(
        stream, "GIF", save_all=True, append_images=quantized[1:], duration=times, loop=0, optimize=True
    )
    write_bytes(path, stream.getvalue())


class _Scene:
    """Pictures above curves, all of which change from frame to frame."""

    def __init__(self, recording: Recording, results: Mapping[str, RunResult]) -> None:
        self._recording = recording
        self._results = list(results.values())
        self._figure = Figure(figsize=(6.4, 5.2), dpi=100)
        self._canvas = FigureCanvasAgg(self._figure)
        left, right = (
            self._figure.add_axes((0.02, 0.53, 0.47, 0.42)),
            self._figure.add_axes((0.51, 0.53, 0.47, 0.42)),
        )
        first = recording.frame(0)
        self._cs = _picture(left, first.image, "robot's camera")
        self._cf = _picture(right, np.zeros_like(first.image), "worn camera")
        (self._dots,) = left.plot([], [], "o", markersize=4, markerfacecolor="none", color=_FOUND)
        self._lines: list[tuple[Any, Array]] = []
        self._ends: list[tuple[Any, Array]] = []
        known = all(result.truth is not None for result in self._results)
        unit = self._results[-1].summary["unit"]
        above = self._axes((0.09, 0.32, 0.88, 0.17) if known else (0.09, 0.09, 0.88, 0.38))
        above.set_xlabel(f"ahead of the start, {unit}", fontsize=8, labelpad=1)
        above.set_ylabel(f"right, {unit}", fontsize=8)
        if known:
            self._grow(above, _true_way(self._results[-1]), TRUTH, 4.5, "true way")
        for n, (label, result) in enumerate(results.items()):
            self._grow(above, _way(result), *self._style(n), label)
        _fit(above, [way for _, way in self._lines], 3.0)
        above.invert_yaxis()  # as seen from above: who looks ahead has the right hand below
        above.legend(loc="lower left", fontsize=7, ncols=3, frameon=False)
        if known:
            below = self._axes((0.09, 0.08, 0.88, 0.15))
            below.set_xlabel("time, s", fontsize=8, labelpad=1)
            below.set_ylabel(f"error, {unit}", fontsize=8)
            curves = [_errors(result) for result in self._results]
            for n, curve in enumerate(curves):
                self._grow(below, curve, *self._style(n), None)
            _fit(below, curves, 1.0)

    def _axes(self, place: tuple[float, float, float, float]) -> Axes:
        axes = self._figure.add_axes(place)
        axes.grid(color="#e6e8eb", linewidth=0.7)
        axes.tick_params(labelsize=7)
        return axes

    def _style(self, n: int) -> tuple[str, float]:
        """Colour and width of a run: the thinner ones lie on top."""
        colour = COLOURS.get(self._results[n].summary["mode"], TRUTH)
        return colour, 1.5 + 1.0 * (len(self._results) - 1 - n)

    def _grow(self, axes: Axes, curve: Array, colour: str, width: float, label: str | None) -> None:
        (line,) = axes.plot([], [], color=colour, linewidth=width, label=label)
        (end,) = axes.plot([], [], "o", color=colour, markersize=width + 2.5)
        self._lines.append((line, curve))
        self._ends.append((end, curve))

    def draw(self, k: int) -> Image:
        """The picture (H, W, 3) of frame ``k``."""
        frame = self._recording.frame(k)
        self._cs.set_data(frame.image)
        blank = np.full_like(frame.image, 30)
        self._cf.set_data(frame.views[0].image if frame.views else blank)
        self._cf.axes.set_title(
            "worn camera" if frame.views else "worn camera: looks elsewhere", fontsize=9,
            color=WORN if frame.views else "#8a94a0",
        )  # fmt: skip
        features: Any = getattr(self._results[-1].record.steps[k], "features", None)
        if features is not None:
            used = np.array([state == "accepted" for state in features.states], dtype=np.bool_)
            self._dots.set_data(features.found[used, 0], features.found[used, 1])
            self._cs.set_data(shaded(frame.image, features.left_out))
        for line, curve in self._lines:
            line.set_data(curve[: k + 1, 0], curve[: k + 1, 1])
        for end, curve in self._ends:
            end.set_data(curve[k : k + 1, 0], curve[k : k + 1, 1])
        self._canvas.draw()  # type: ignore[no-untyped-call]
        rgba: Image = np.asarray(self._canvas.buffer_rgba(), dtype=np.uint8)  # type: ignore[no-untyped-call]
        return np.ascontiguousarray(rgba[..., :3], dtype=np.uint8)


def shaded(image: Image, left_out: Mask | None) -> Image:
    """An image, darker where it was left out."""
    if left_out is None:
        return image
    height, width = image.shape
    squares = np.kron(left_out, np.ones((CELL, CELL), np.bool_))[:height, :width]
    out: Image = image.copy()
    part = out[: squares.shape[0], : squares.shape[1]]
    part[squares] = (_SHADE * part[squares]).astype(np.uint8)
    return out


def _way(result: RunResult) -> Array:
    """(N, 2): the way (z, x) as seen from above."""
    record = result.record
    return np.where(record.valid[:, None], record.poses[:, [2, 0], 3], np.nan)


def _true_way(result: RunResult) -> Array:
    """(N, 2): the true way in the world of a run."""
    truth = result.truth
    assert truth is not None
    return np.where(truth.known[:, None], truth.poses[:, [2, 0], 3], np.nan)


def _errors(result: RunResult) -> Array:
    """(N, 2): seconds and position error."""
    record = result.record
    assert result.truth is not None
    errors = position_errors(record, result.truth)
    return np.stack([record.times - record.times[0], errors], axis=1)


def _fit(axes: Axes, curves: Sequence[Array], above: float) -> None:
    """Limits that hold all curves, with room beyond the largest value for a legend."""
    seen = np.concatenate([curve[np.isfinite(curve).all(axis=1)] for curve in curves])
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = 0.05 * (high - low) + 1e-6
    axes.set_xlim(low[0] - margin[0], high[0] + margin[0])
    axes.set_ylim(low[1] - margin[1], high[1] + margin[1] * (1.0 + 5.0 * above))


def _palette(colours: Sequence[str]) -> Any:
    """A palette of greys and of the lines' colours, some mixed with white for smooth edges."""
    from matplotlib.colors import to_rgb
    from PIL import Image as Pictures

    greys = np.linspace(0.0, 1.0, _GREYS)[:, None].repeat(3, axis=1)
    lines = np.array([to_rgb(colour) for colour in colours])
    rows = np.concatenate([greys, *(1.0 - share * (1.0 - lines) for share in (1.0, 0.7, 0.4))])
    out = Pictures.new("P", (1, 1))
    out.putpalette(np.rint(255.0 * rows).astype(int).ravel().tolist())
    return out


def _picture(axes: Axes, image: Image, title: str) -> Any:
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()
    return axes.imshow(image, cmap="gray", vmin=0, vmax=255)
