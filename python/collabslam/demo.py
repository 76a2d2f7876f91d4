"""The embedded demo: one rendered walk, with and without the worn camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from collabslam.extras import drawing
from collabslam.formats.files import try_place
from collabslam.runs.busy import busy
from collabslam.runs.folder import is_result_folder, numbered
from collabslam.runs.plan import Output
from collabslam.runs.progress import Progress
from collabslam.runs.report import median_summary, number, side_by_side
from collabslam.runs.results import COMPARISON, write_summary
from collabslam.runs.runner import RunResult, run
from collabslam.settings.table import Settings
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import demo_recording
from collabslam.types import Recording

MODES = ("mono", "collab")

Summary = dict[str, Any]


def run_demo(
    out: Path,
    *,
    seeds: list[int],
    settings: Settings | None = None,
    animation: Path | None = None,
    overwrite: bool = False,
    progress: bool = True,
) -> dict[str, Summary]:
    """Render the demo for each seed, run every mode on it, print the table, write the results.

    Parameters
    ----------
    out : Path
        Gets a result folder for each mode (below ``seed-N`` if there are several seeds), ``comparison.png``
        of the first seed and, for several seeds, ``medians.json``.  If an earlier demo is in it, a numbered
        folder beside it does.
    seeds : list of int
        Of the noise of pictures and of the measured ``T_CF``.
    settings : Settings, optional
        The same for both modes.
    animation : Path, optional
        Where to write an animated picture (GIF) of the first seed.
    overwrite : bool
        Take ``out`` even so: what an earlier demo has written there is removed.
    progress : bool

    Returns
    -------
    dict
        The summary of each mode; medians over the seeds if there are several.
    """
    runs: dict[str, list[Summary]] = {mode: [] for mode in MODES}
    parts = [f"seed-{seed}" for seed in seeds] if len(seeds) > 1 else [""]
    if not overwrite:
        out = next(f for f in numbered(out) if not _holds_results(f))
    if animation is not None:
        try_place(animation)
    pictures = drawing()
    for seed, part in zip(seeds, parts, strict=True):
        folder = out / part
        recording = demo_recording(seed)
        with Progress(len(recording), f"{recording.name} rendering", enabled=progress) as bar:
            held = HeldRecording(recording, bar.update)
        results = run_pair(held, folder, seed=seed, settings=settings, progress=progress)
        for mode, result in results.items():
            runs[mode].append(result.summary)
        if seed == seeds[0] and pictures:
            from collabslam.viz.plot import plot_comparison

            labels = {f"{mode} ({_CAPTIONS[mode]})": result for mode, result in results.items()}
            with busy("drawing both ways") as tell:
                plot_comparison(labels, out / COMPARISON, title=_TITLE)
                if animation is not None:
                    from collabslam.viz.animation import animate

                    tell("drawing the moving picture")
                    animate(held, labels, animation)
    medians = {mode: median_summary(summaries) for mode, summaries in runs.items()}
    if len(seeds) > 1:
        write_summary(out / "medians.json", medians)
    print(comparison_text(medians, seeds))
    print(f"  results {f'and {COMPARISON} ' if pictures else ''}are in {out}")
    return medians


def _holds_results(folder: Path) -> bool:
    """Whether an earlier demo, of one seed or several, has written into this folder."""
    return any(is_result_folder(f) for f in (*folder.glob("*"), *folder.glob("seed-*/*")))


def run_pair(
    recording: Recording, out: Path | None, *, seed: int, settings: Settings | None, progress: bool
) -> dict[str, RunResult]:
    """Every mode of the demo on one recording."""
    return {
        mode: run(
            recording,
            mode=mode,
            start="worn",
            settings=settings,
            out=Output(
                None if out is None else out / mode,
                overwrite=True,
                latest=False,
                progress=progress,
                notes={"seed": seed},
            ),
        )
        for mode in MODES
    }


def comparison_text(summaries: dict[str, Summary], seeds: list[int]) -> str:
    """The table of the demo, and the ratio of both average errors."""
    mono, collab = (summaries[mode]["avg_position_error_m"] for mode in MODES)
    ratio = collab / mono if mono and collab is not None else None
    features = [summaries[mode]["features_per_frame"] for mode in MODES]
    tracked = features[0] / features[1] if features[0] is not None and features[1] else None
    what = f"medians over seeds {', '.join(map(str, seeds))}" if len(seeds) > 1 else f"seed {seeds[0]}"
    return "\n".join(
        [
            f"corridor walk, {what}",
            side_by_side(summaries),
            f"  average position error of collab over mono: {number(ratio, 2)}",
            f"  features a frame of mono over collab: {number(tracked, 2)}",
        ]
    )


_TITLE = "A walk down a corridor, with and without the worn camera"
_CAPTIONS = {"mono": "robot camera alone", "collab": "with the worn camera"}
