"""The command line.  Each command imports what it needs, so that ``--help`` answers at once.

Exit status: 0 fine, 1 finished but lost the camera (or the filter gave up), 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from collabslam.errors import CollabslamError, FilterError
from collabslam.modes import MODES, STARTS

if TYPE_CHECKING:
    from collabslam.settings import Settings
    from collabslam.types import Recording

OUT_HELP = "result folder (default: %(default)s)"
NOISE_HELP = (
    "standard deviation of T_CF: metres, then degrees of roll, pitch and yaw "
    "(default 0.03,0.5,0.5,1; for a rig 0.002,0.05,0.05,0.05)"
)
OK, LOST, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    parser = build_parser()
    arguments = parser.parse_args(argv)
    try:
        status: int = arguments.command(arguments)
    except CollabslamError as error:
        print(f"collabslam: error: {error}", file=sys.stderr)
        return LOST if isinstance(error, FilterError) else BAD_INPUT
    except KeyboardInterrupt:
        print("collabslam: interrupted", file=sys.stderr)
        return INTERRUPTED
    return status


def build_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser = argparse.ArgumentParser(
        prog="collabslam",
        description="Metric monocular SLAM for a robot, helped now and then by a camera that a person wears.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_run(commands)
    _add_demo(commands)
    _add_settings(commands)
    _add_record(commands)
    _add_table(commands)
    return parser


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from collabslam.version import version

        print(f"collabslam {version()}")
        parser.exit()


Command = Callable[[argparse.Namespace], int]


def _command(commands: Any, name: str, run: Command, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
    parser.set_defaults(command=run)
    return parser


def _add_source(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="SOURCE", type=Path, help="folder of the recording")
    group = parser.add_argument_group("files beside the recording")
    group.add_argument(
        "--camera", metavar="FILE", type=Path, help="calibration of Cs (Kalibr or OpenCV YAML)"
    )
    group.add_argument("--times", metavar="FILE", type=Path, help="time stamps, one a line")
    group.add_argument(
        "--poses", metavar="FILE", type=Path, help="true poses (TUM), to score and to emulate Cf"
    )
    worn = parser.add_argument_group("worn camera Cf")
    worn.add_argument("--worn", metavar="SPEC", help="recorded, none, lag:SECONDS, rig or views:FOLDER")
    worn.add_argument(
        "--worn-available",
        metavar="SHARE",
        type=share,
        help="share of each period during which Cf is there, as 0.4 or 40%%",
    )
    worn.add_argument(
        "--worn-period", metavar="S", type=float, default=5.0, help="seconds of a period (default 5)"
    )
    worn.add_argument(
        "--worn-intervals",
        metavar="A-B,..",
        type=intervals,
        help="instead of a share: seconds from the first frame, as 0-2,5-7.5",
    )
    worn.add_argument("--worn-noise", metavar="M,R,P,Y", type=noise, help=NOISE_HELP)
    worn.add_argument(
        "--worn-bias-per-block",
        action="store_true",
        help="one error of T_CF for each stretch in which Cf is there, instead of one for each frame",
    )
    worn.add_argument("--seed", metavar="N", type=int, default=0, help="of the noise of T_CF (default 0)")


def _add_settings_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config", metavar="FILE", type=Path, help="settings file, as collabslam settings dump prints it"
    )
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting; may be repeated"
    )


def _add_run(commands: Any) -> None:
    parser = _command(commands, "run", run_command, "run a recording through the filter")
    _add_source(parser)
    parser.add_argument(
        "--mode", choices=MODES, help="default: collab, or mono where there is no worn camera"
    )
    parser.add_argument(
        "--start",
        choices=STARTS,
        help="where the scale comes from; default: the first of these that the recording allows",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="result folder (default: results/NAME-MODE)")
    parser.add_argument("--max-frames", metavar="N", type=int, help="stop after so many frames")
    _add_settings_options(parser)


def _add_demo(commands: Any) -> None:
    parser = _command(commands, "demo", demo_command, "render a corridor walk and run it with and without Cf")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("results/demo"), help=OUT_HELP)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--seed", metavar="N", type=int, default=0, help="of the noise (default 0)")
    which.add_argument("--seeds", metavar="A-B", type=seed_list, help="several: medians are printed")
    _add_settings_options(parser)


def _add_settings(commands: Any) -> None:
    parser = commands.add_parser("settings", help="list, write or check settings")
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    show = _command(actions, "show", settings_show_command, "list settings with value and range")
    show.add_argument("text", metavar="TEXT", nargs="?", default="", help="only keys that contain this")
    _add_settings_options(show)
    dump = _command(actions, "dump", settings_dump_command, "print a commented settings file")
    _add_settings_options(dump)
    check = _command(actions, "check", settings_check_command, "check a settings file")
    check.add_argument("config", metavar="FILE", type=Path)


def _add_record(commands: Any) -> None:
    parser = _command(commands, "record", record_command, "write a recording in the two-camera layout")
    _add_source(parser)
    parser.add_argument("out", metavar="OUT", type=Path, help="new folder")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier recording")


def _add_table(commands: Any) -> None:
    parser = _command(commands, "table", table_command, "measure the set of recordings and print the table")
    parser.add_argument("data", metavar="DATA_DIR", type=Path, help="folder that holds the recordings")
    parser.add_argument("--seeds", metavar="A-B", type=seed_list, default="0-4", help="default 0-4")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("results/table"), help=OUT_HELP)
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="processes at a time (default 2)")


def run_command(arguments: argparse.Namespace) -> int:
    """``collabslam run``."""
    from collabslam.report import lost_text, summary_text
    from collabslam.run import MODE_KEY, exit_status, run

    settings = _settings(arguments)
    recording = _recording(arguments)
    worn = recording.worn_camera is not None
    target = recording.target is not None
    start = arguments.start or ("worn" if worn else "target" if target else "scale-free")
    mode = arguments.mode or str(settings[MODE_KEY])
    if arguments.mode is None and not worn and mode.startswith("collab"):
        mode = "mono"
        print("There is no worn camera in this run (see --worn): the mode is mono.", file=sys.stderr)
    out = arguments.out or Path("results") / f"{recording.name}-{mode}"
    summary = run(
        recording,
        mode=mode,
        start=start,
        settings=settings,
        out=out,
        seed=arguments.seed,
        max_frames=arguments.max_frames,
        options=_worn_options(arguments),
    )
    print(summary_text(summary))
    print(f"  results are in {out}")
    if summary["interrupted"]:
        return INTERRUPTED
    status = exit_status(summary)
    if status:
        print(f"collabslam: {lost_text(summary)}; frames.csv says why.", file=sys.stderr)
    return status


def demo_command(arguments: argparse.Namespace) -> int:
    """``collabslam demo``."""
    from collabslam.demo_run import run_demo
    from collabslam.run import exit_status

    seeds = arguments.seeds or [arguments.seed]
    summaries = run_demo(arguments.out, seeds=seeds, settings=_settings(arguments))
    return exit_status(summaries["collab"])


def settings_show_command(arguments: argparse.Namespace) -> int:
    """``collabslam settings show``."""
    from collabslam.report import text_table
    from collabslam.settings import schema

    settings = _settings(arguments)
    rows = [
        [key, str(settings[key]), f"{entry.allowed()} {entry.unit}".strip()]
        for key, entry in schema().items()
        if arguments.text in key
    ]
    print(text_table(rows) if rows else f"No setting's name contains '{arguments.text}'.")
    return OK if rows else BAD_INPUT


def settings_dump_command(arguments: argparse.Namespace) -> int:
    """``collabslam settings dump``."""
    print(_settings(arguments).dump(), end="")
    return OK


def settings_check_command(arguments: argparse.Namespace) -> int:
    """``collabslam settings check``."""
    from collabslam.settings import Settings

    print(f"{arguments.config} is fine; its hash is {Settings.load(arguments.config).hash()}.")
    return OK


def record_command(arguments: argparse.Namespace) -> int:
    """``collabslam record``."""
    from collabslam.datasets import write_recording
    from collabslam.progress import Progress

    recording = _recording(arguments)
    with Progress(len(recording), f"{recording.name} writing") as bar:
        folder = write_recording(
            recording, arguments.out, overwrite=arguments.overwrite, progress=lambda done, total: bar.update()
        )
    print(f"{len(recording)} frames are in {folder}")
    return OK


def table_command(arguments: argparse.Namespace) -> int:
    """``collabslam table``."""
    from collabslam.table import run_table

    rows = run_table(arguments.data, seeds=arguments.seeds, out=arguments.out, jobs=arguments.jobs)
    return LOST if any("error" in row for row in rows) else OK


def _settings(arguments: argparse.Namespace) -> Settings:
    from collabslam.settings import Settings, parse_assignments

    settings = Settings.default() if arguments.config is None else Settings.load(arguments.config)
    return settings.replace(parse_assignments(arguments.set))


def _recording(arguments: argparse.Namespace) -> Recording:
    from collabslam.datasets import attach_worn, open_recording

    recording: Recording = open_recording(
        arguments.source, camera=arguments.camera, times=arguments.times, poses=arguments.poses
    )
    spec = arguments.worn or ("none" if recording.worn_camera is None else "recorded")
    return attach_worn(
        recording,
        spec,
        available=1.0 if arguments.worn_available is None else arguments.worn_available,
        period=arguments.worn_period,
        intervals=arguments.worn_intervals,
        noise=arguments.worn_noise,
        seed=arguments.seed,
        bias_per_block=arguments.worn_bias_per_block,
    )


def _worn_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """How the worn camera was made, for the summary."""
    return {k: v for k, v in vars(arguments).items() if k.startswith("worn") and v is not None}


def share(text: str) -> float:
    """``0.4`` or ``40%`` as 0.4."""
    try:
        value = float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"'{text}' is no share; give 0 to 1, or 0% to 100%")
    return value


def intervals(text: str) -> list[tuple[float, float]]:
    """``0-2,5-7.5`` as [(0, 2), (5, 7.5)]."""
    try:
        pairs = [tuple(float(x) for x in part.split("-")) for part in text.split(",")]
        return [(a, b) for a, b in pairs]
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' are no intervals; give seconds as 0-2,5-7.5") from None


def noise(text: str) -> tuple[float, ...]:
    """``0.03,0.5,0.5,1`` as four numbers."""
    try:
        values = tuple(float(x) for x in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 4:
        raise argparse.ArgumentTypeError(f"'{text}' is no noise; give four numbers as 0.03,0.5,0.5,1")
    return values


def seed_list(text: str) -> list[int]:
    """``0-4`` or ``0,2,5`` as a list."""
    try:
        first, dash, last = text.partition("-")
        seeds = list(range(int(first), int(last) + 1)) if dash else [int(x) for x in text.split(",")]
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise argparse.ArgumentTypeError(f"'{text}' are no seeds; give 0-4 or 0,2,5")
    return seeds
