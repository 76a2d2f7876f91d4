"""``collabslam run``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from collabslam.commands import INTERRUPTED, options
from collabslam.modes import MODES, STARTS


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_worn(parser)
    parser.add_argument(
        "--mode", choices=MODES, help="default: the setting's, or mono where there is no worn camera"
    )
    parser.add_argument(
        "--start",
        choices=STARTS,
        help="where the scale comes from; default: the first of these that the recording allows",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="result folder (default: results/NAME-MODE)")
    parser.add_argument("--max-frames", metavar="N", type=int, help="stop after so many frames")
    options.add_settings(parser)
    options.add_view(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run the recording, print its summary."""
    from collabslam import runner
    from collabslam.report import lost_text, summary_text

    settings = options.read_settings(arguments)
    recording = options.open_with_worn(arguments)
    mode = arguments.mode or runner.default_mode(recording, settings)
    if arguments.mode is None and mode != settings[runner.MODE_KEY]:
        print(f"There is no worn camera in this run (see --worn): the mode is {mode}.", file=sys.stderr)
    out = arguments.out or Path("results") / f"{recording.name}-{mode}"
    with options.watching(recording, arguments) as watch:
        summary = runner.run(
            recording,
            mode=mode,
            start=arguments.start,
            settings=settings,
            out=out,
            seed=arguments.seed,
            max_frames=arguments.max_frames,
            progress=True,
            options=options.worn_options(arguments),
            watch=watch,
        ).summary
    print(summary_text(summary))
    print(f"  results are in {out}")
    if summary["interrupted"]:
        return INTERRUPTED
    status = runner.exit_status(summary)
    if status:
        print(f"collabslam: {lost_text(summary)}; frames.csv says why.", file=sys.stderr)
    return status
