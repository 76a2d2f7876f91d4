"""``collabslam run``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from collabslam.cli import INTERRUPTED, options
from collabslam.errors import SettingsError
from collabslam.settings.modes import MODES, STARTS

if TYPE_CHECKING:
    from collabslam.runs.runner import RunResult

Summary = dict[str, Any]


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser, optional=True)
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
    parser.add_argument(
        "--map", metavar="FILE", type=Path, help="start in the map of an earlier run, of any camera"
    )
    parser.add_argument(
        "--save-map", metavar="FILE", type=Path, help="write the map at the end, to start in with --map"
    )
    parser.add_argument("--max-frames", metavar="N", type=int, help="stop after so many frames")
    group = parser.add_argument_group("stop and go on")
    group.add_argument(
        "--checkpoint-every",
        metavar="N",
        help="write a checkpoint into the result folder after N frames, or after Ns, N seconds, as 30s",
    )
    group.add_argument(
        "--resume",
        metavar="DIR",
        type=Path,
        help="go on with the run of this result folder, with the options it had; SOURCE only if it was moved",
    )
    options.add_settings(parser)
    options.add_view(parser)
    parser.set_defaults(refuse=parser.error)


def main(arguments: argparse.Namespace) -> int:
    """Run the recording, or go on with a run, and print its summary."""
    if arguments.resume is not None:
        return _resume(arguments)
    if arguments.source is None:
        arguments.refuse("there is no SOURCE; give a recording, or --resume DIR to go on with a run")
    return _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    from collabslam.runs import runner

    settings = options.read_settings(arguments)
    recording = options.open_with_worn(arguments)
    mode = arguments.mode or runner.default_mode(recording, settings)
    if arguments.mode is None and mode != settings[runner.MODE_KEY]:
        print(f"There is no worn camera in this run (see --worn): the mode is {mode}.", file=sys.stderr)
    out = arguments.out or Path("results") / f"{recording.name}-{mode}"
    with options.watching(recording, arguments) as watch:
        result = runner.run(
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
            checkpoint_every=arguments.checkpoint_every,
            reopen=options.opened_with(arguments),
            map=arguments.map,
            save_map=arguments.save_map,
        )
    _draw(result, out)
    return _report(result.summary, out)


def _resume(arguments: argparse.Namespace) -> int:
    from collabslam.runs import runner
    from collabslam.runs.checkpoint import Checkpoint
    from collabslam.runs.results import CHECKPOINT, SUMMARY
    from collabslam.runs.run_folder import RunFolder

    out: Path = arguments.resume
    _check_alone(arguments)
    if (out / SUMMARY).is_file() and not (out / CHECKPOINT).is_file():
        print(f"The run in {out} is finished; nothing is left to do.", file=sys.stderr)
        return _report(RunFolder(out).summary(), out)
    recording = options.open_again(Checkpoint.read(out).reopen, arguments.source)
    with options.watching(recording, arguments) as watch:
        every = arguments.checkpoint_every
        result = runner.resume(out, recording, checkpoint_every=every, progress=True, watch=watch)
    _draw(result, out)
    return _report(result.summary, out)


def _check_alone(arguments: argparse.Namespace) -> None:
    """Raises SettingsError if an option is given that the run has from its start."""
    parser = argparse.ArgumentParser(add_help=False)
    configure(parser)
    defaults = vars(parser.parse_args([]))
    allowed = ("source", "resume", "checkpoint_every", "view", "save", "refuse")
    extra = [k for k, v in defaults.items() if k not in allowed and getattr(arguments, k) != v]
    if extra:
        names = ", ".join("--" + name.replace("_", "-") for name in extra)
        raise SettingsError(f"A run goes on with the options it was started with; leave out {names}.")


def _draw(result: RunResult, out: Path) -> None:
    """The run's picture, beside its other results."""
    from collabslam.extras import drawing
    from collabslam.runs.results import PICTURE

    if drawing():
        from collabslam.viz.plot import plot_run

        plot_run(result, out / PICTURE)


def _report(summary: Summary, out: Path) -> int:
    """Print what came out, and say it as an exit status."""
    from collabslam.runs import runner
    from collabslam.runs.report import lost_text, summary_text, unused_text

    print(summary_text(summary))
    print(f"  results are in {out}")
    if unused := unused_text(summary):
        print(f"collabslam: warning: {unused}.", file=sys.stderr)
    if summary["interrupted"]:
        return INTERRUPTED
    status = runner.exit_status(summary)
    if status:
        print(f"collabslam: {lost_text(summary)}; frames.csv says why.", file=sys.stderr)
    return status
