"""``collabslam run``."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from collabslam.cli import INTERRUPTED, NOT_TRUSTED, OK, TERMINATED, options
from collabslam.cli.drawn import draw
from collabslam.errors import CollabslamError, SettingsError
from collabslam.settings.modes import MODES, STARTS

if TYPE_CHECKING:
    from collabslam.runs.runner import RunResult

Summary = dict[str, Any]


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser, optional=True)
    options.add_worn(parser)
    options.add_odometry(parser)
    options.add_printed(parser)
    parser.add_argument(
        "--mode", choices=MODES, help="default: the setting's, or mono where there is no worn camera"
    )
    parser.add_argument(
        "--start",
        choices=STARTS,
        help="where the scale comes from; default: the first of these that the recording allows",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help=f"result folder (default: results/NAME-MODE){options.KEPT_HELP}",
    )
    parser.add_argument("--overwrite", action="store_true", help=options.OVERWRITE_HELP)
    parser.add_argument(
        "--map", metavar="FILE", type=Path, help="start in the map of an earlier run, of any camera"
    )
    parser.add_argument(
        "--save-map", metavar="FILE", type=Path, help="write the map at the end, to start in with --map"
    )
    parser.add_argument(
        "--world",
        metavar="level[:ROLL,PITCH]",
        help="write poses and map in a level world, too (x ahead, y left, z up), as the accelerometer tells "
        "which way is down, or roll and pitch of Cs at the start, degrees (looking down by 10 is 0,10)",
    )
    parser.add_argument(
        "--rate-poses",
        action="store_true",
        help="write poses and velocities between frames at the gyroscope's rate, too: poses_imu_rate.csv",
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
    from collabslam.runs.busy import busy
    from collabslam.runs.plan import Output

    settings = options.read_settings(arguments)
    source = dataclasses.replace(options.source_with_worn(arguments), frames=arguments.max_frames)
    with busy("reading the recording"):
        recording = source.open()
    mode = arguments.mode or runner.default_mode(recording, settings)
    if arguments.mode is None and mode != settings.filter.estimator.mode:
        print(f"There is no worn camera in this run (see --worn): the mode is {mode}.", file=sys.stderr)
    if arguments.worn is None and getattr(recording, "rig_used", False):
        print(
            "The second camera of the rig takes the part of Cf (--worn none leaves it out).", file=sys.stderr
        )
    if arguments.map is not None and arguments.start is not None:
        raise SettingsError(f"A map was given but the start is '{arguments.start}'; leave the start out.")
    output = Output(
        arguments.out or Path("results") / f"{recording.name}-{mode}",
        overwrite=arguments.overwrite,
        save_map=arguments.save_map,
        checkpoint_every=arguments.checkpoint_every,
        reopen=source,
        progress=True,
        world=arguments.world,
        rate_poses=arguments.rate_poses,
        notes=options.notes_of(arguments),
    )
    with options.watching(recording, arguments) as watch:
        return _told(
            lambda: runner.run(
                recording,
                mode=mode,
                start=arguments.map or arguments.start,
                settings=settings,
                out=output,
                printed=[*arguments.tag, *arguments.board],
                watch=watch,
            ),
            arguments,
        )


def _resume(arguments: argparse.Namespace) -> int:
    from collabslam.runs import runner
    from collabslam.runs.busy import busy
    from collabslam.runs.checkpoint import Checkpoint
    from collabslam.runs.results import CHECKPOINT, SUMMARY
    from collabslam.runs.run_folder import RunFolder

    out: Path = arguments.resume
    _check_alone(arguments)
    if (out / SUMMARY).is_file() and not (out / CHECKPOINT).exists():
        print(f"The run in {out} is finished; nothing is left to do.", file=sys.stderr)
        return _report(RunFolder(out).summary(), out)
    source = Checkpoint.read(out).source()
    with busy("reading the recording"):
        recording = (source if arguments.source is None else source.moved(arguments.source)).open()
    with options.watching(recording, arguments) as watch:
        return _told(
            lambda: runner.resume(
                out,
                recording,
                checkpoint_every=arguments.checkpoint_every,
                save_map=arguments.save_map,
                progress=True,
                watch=watch,
            ),
            arguments,
        )


def _check_alone(arguments: argparse.Namespace) -> None:
    """Raises SettingsError if an option is given that the run has from its start."""
    parser = argparse.ArgumentParser(add_help=False)
    configure(parser)
    defaults = vars(parser.parse_args([]))
    allowed = ("source", "resume", "checkpoint_every", "save_map", "view", "save", "refuse")
    extra = [k for k, v in defaults.items() if k not in allowed and getattr(arguments, k) != v]
    if extra:
        names = ", ".join("--" + name.replace("_", "-") for name in extra)
        raise SettingsError(f"A run goes on with the options it was started with; leave out {names}.")


def _told(go: Callable[[], RunResult], arguments: argparse.Namespace) -> int:
    """Runs, draws the picture, says what came out; of a run that an error ended, too."""
    try:
        result = go()
    except CollabslamError as error:
        if error.result is not None:
            _show(error.result, arguments)
        raise
    return _show(result, arguments)


def _show(result: RunResult, arguments: argparse.Namespace) -> int:
    folder = result.folder or Path()
    draw(folder, lambda _: result)
    if arguments.save_map is not None and not len(result.landmarks.ids):
        print(f"collabslam: warning: there is no map, {arguments.save_map} is not written.", file=sys.stderr)
    return _report(result.summary, folder)


def _report(summary: Summary, folder: Path) -> int:
    """Print what came out, and say it as an exit status."""
    from collabslam.runs.level import WORLD_NOTE
    from collabslam.runs.report import summary_text, untrusted_text, unused_text
    from collabslam.runs.summary import TERMINATED as BY_SIGTERM
    from collabslam.runs.summary import is_trusted

    print(summary_text(summary))
    print(f"  results are in {folder}")
    if WORLD_NOTE in summary["options"] and summary["level"] is None:
        text = "nothing tells which way is down (see --world): no level poses are written"
        print(f"collabslam: warning: {text}.", file=sys.stderr)
    if unused := unused_text(summary):
        print(f"collabslam: warning: {unused}.", file=sys.stderr)
    if summary["interrupted"]:
        print(f"  go on with: collabslam run --resume {folder}")
        return TERMINATED if summary["ended_by"] == BY_SIGTERM else INTERRUPTED
    if is_trusted(summary):
        return OK
    print(f"collabslam: {untrusted_text(summary)}; collabslam doctor {folder} says why.", file=sys.stderr)
    return NOT_TRUSTED
