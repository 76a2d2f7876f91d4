"""An animated picture of several runs of one recording: what both cameras see, and the paths as they grow."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from collabslam.formats.files import write_bytes
from collabslam.types import Image, Recording
from collabslam.viz.plot import COLOURS, TRUTH, WORN

if TYPE_CHECKING:
    from collabslam.runs.runner import RunResult

STRIDE = 4
"""Every so many frames is drawn."""
SECONDS = 0.2
"""Time that each picture is shown."""
_COLOUR_COUNT = 40
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
    # The palette must hold the colours of the lines, however little of the pictures they cover.
    colours = [*(COLOURS.get(r.summary["mode"], TRUTH) for r in results.values()), TRUTH, WORN, _FOUND]
    swatch = Pictures.new("RGB", (frames[0].width, 2 * frames[0].height), "white")
    swatch.paste(frames[len(frames) // 2])
    for n, colour in enumerate(colours):
        swatch.paste(colour, (0, frames[0].height + 40 * n, frames[0].width, frames[0].height + 40 * (n + 1)))
    palette = swatch.quantize(_COLOUR_COUNT)
    quantized = [f.quantize(palette=palette, dither=Pictures.Dither.NONE) for f in frames]
    stream = BytesIO()
    times = [round(1e3 * SECONDS)] * (len(frames) - 1) + [2500]
    quantized[0].save(
        stream, "GIF", save_all=True, append_images=quantized[1:], duration=times, loop=0, optimize=True
    )
    write_bytes(path, stream.getvalue())


class _Scene:
    """Three panels whose contents are moved from frame to frame."""

    def __init__(self, recording: Recording, results: Mapping[str, RunResult]) -> None:
        self._recording = recording
        self._results = list(results.values())
        self._figure = Figure(figsize=(6.4, 4.4), dpi=100)
        self._canvas = FigureCanvasAgg(self._figure)
        left, right = (
            self._figure.add_axes((0.02, 0.44, 0.47, 0.5)),
            self._figure.add_axes((0.51, 0.44, 0.47, 0.5)),
        )
        first = recording.frame(0)
        self._cs = _picture(left, first.image, "robot's camera")
        self._cf = _picture(right, np.zeros_like(first.image), "worn camera")
        (self._dots,) = left.plot([], [], "o", markersize=4, markerfacecolor="none", color=_FOUND)
        below = self._figure.add_axes((0.09, 0.1, 0.88, 0.28))
        unit = self._results[-1].summary["unit"]
        below.set(xlabel=f"z, {unit}", ylabel=f"x, {unit}")
        below.grid(color="#e6e8eb", linewidth=0.7)
        truth = self._results[-1].truth
        if truth is not None:
            below.plot(truth.poses[:, 2, 3], truth.poses[:, 0, 3], color=TRUTH, linewidth=1.0, label="truth")
        self._paths = []
        for n, (label, result) in enumerate(results.items()):  # the thinner ones lie on top
            colour, width = COLOURS.get(result.summary["mode"], TRUTH), 1.5 + 2.0 * (len(results) - 1 - n)
            (line,) = below.plot([], [], color=colour, linewidth=width, label=label)
            self._paths.append(line)
        everything = np.concatenate([r.record.poses[r.record.valid][:, :3, 3] for r in self._results])
        low, high = everything.min(axis=0), everything.max(axis=0)
        below.set_xlim(low[2] - 0.3, high[2] + 0.3)
        below.set_ylim(low[0] - 0.3, high[0] + 0.3)
        below.legend(loc="lower left", fontsize=7, ncols=3, frameon=False)

    def draw(self, k: int) -> Image:
        """The picture (H, W, 3) of frame ``k``."""
        frame = self._recording.frame(k)
        self._cs.set_data(frame.image)
        blank = np.full_like(frame.image, 30)
        self._cf.set_data(blank if frame.worn is None else frame.worn.image)
        self._cf.axes.set_title(
            "worn camera" if frame.worn is not None else "worn camera: looks elsewhere", fontsize=9,
            color=WORN if frame.worn is not None else "#8a94a0",
        )  # fmt: skip
        features: Any = getattr(self._results[-1].record.steps[k], "features", None)
        if features is not None:
            used = np.array([state == "accepted" for state in features.states], dtype=np.bool_)
            self._dots.set_data(features.found[used, 0], features.found[used, 1])
        for line, result in zip(self._paths, self._results, strict=True):
            shown = np.where(result.record.valid[:, None], result.record.poses[:, :3, 3], np.nan)[: k + 1]
            line.set_data(shown[:, 2], shown[:, 0])
        self._canvas.draw()  # type: ignore[no-untyped-call]
        rgba: Image = np.asarray(self._canvas.buffer_rgba(), dtype=np.uint8)  # type: ignore[no-untyped-call]
        return np.ascontiguousarray(rgba[..., :3], dtype=np.uint8)


def _picture(axes: Axes, image: Image, title: str) -> Any:
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()
    return axes.imshow(image, cmap="gray", vmin=0, vmax=255)
