"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from collabslam.errors import CollabslamError, SettingsError

if TYPE_CHECKING:
    from collabslam.datasets.imu.beside import GyroGiven, WornGyroGiven
    from collabslam.datasets.odometry import OdometryGiven
    from collabslam.datasets.source import Source
    from collabslam.runs.runner import Watch
    from collabslam.settings.table import Settings
    from collabslam.targets.kinds import Board, Tag
    from collabslam.types import Recording

T = TypeVar("T")

OUT_HELP = "result folder (default: %(default)s)"
KEPT_HELP = "; an earlier run's results are kept: a numbered folder beside it is taken then"
OVERWRITE_HELP = "take the result folder even if it holds an earlier run's results, which are removed"
NOISE_HELP = (
    "standard deviation of T_CF: metres, then degrees of roll, pitch and yaw "
    "(default 0.03,0.5,0.5,1; for a rig 0.002,0.05,0.05,0.05)"
)


def add_source(parser: argparse.ArgumentParser, *, optional: bool = False) -> None:
    """SOURCE, and the files that may lie beside it."""
    parser.add_argument(
        "source",
        metavar="SOURCE",
        type=Path,
        nargs="?" if optional else None,
        help="folder or file of the recording",
    )
    group = parser.add_argument_group("files beside the recording")
    group.add_argument(
        "--camera",
        metavar="FILE",
        type=Path,
        help="calibration of Cs (of Kalibr, OpenCV, ROS, ORB-SLAM, COLMAP, ..)",
    )
    group.add_argument(
        "--mask",
        metavar="IMAGE",
        type=Path,
        help="what is never scene in the images of Cs, as the robot's own arm: black there, white elsewhere",
    )
    group.add_argument("--times", metavar="FILE", type=Path, help="time stamps in any unit, one a line")
    group.add_argument(
        "--poses",
        metavar="FILE",
        type=Path,
        help="true poses (TUM, EuRoC, KITTI, COLMAP, nerfstudio, ..), to score and to emulate Cf",
    )
    group.add_argument(
        "--depth", metavar="TOPIC", help="of a bag: depth images registered to Cs; as --topics depth=TOPIC"
    )
    group.add_argument(
        "--depth-scale",
        metavar="COUNTS",
        type=float,
        help="counts of a 16-bit depth image at one metre (TUM RGB-D 5000, a bag 1000 unless told)",
    )
    for option, whose in (("--poses-axes", "--poses"), ("--t-cf-axes", "the measured T_CF")):
        group.add_argument(
            option,
            choices=("optical", "opengl", "ros"),
            help=f"camera axes of {whose}: optical (x right, y down, z forward; default), opengl (x right, y "
            "up, z back: ARKit, ARCore, Blender), ros (x forward, y left, z up)",
        )
    group.add_argument(
        "--topics",
        metavar="ROLE=TOPIC,..",
        type=topics,
        help="of a bag: cs, cf, t_cf (a topic, tf:CS:CF:METRES:DEGREES, or rig), cs_info, cf_info, truth; of "
        "any recording with images of Cf: t_cf=tag:36h11:3=0.16",
    )
    add_gyro(group)
    add_worn_gyro(group)


def add_gyro(group: argparse._ActionsContainer) -> None:
    """The gyroscope beside Cs, and how it sits."""
    group.add_argument(
        "--gyro",
        metavar="FILE|TOPIC|none",
        help="gyroscope: CSV of stamp, wx, wy, wz (rad/s) and maybe ax, ay, az (m/s^2), or a phone's log, "
        "along the axes of Cs unless --imu says otherwise; of a bag: a topic of sensor_msgs/Imu; none: leave "
        "the recording's own out",
    )
    group.add_argument(
        "--imu",
        metavar="FILE|AXES",
        help="how the gyroscope sits and how good it is: imu.yaml or camchain-imucam.yaml, as Kalibr writes "
        "them; or its axes: optical, opengl, ros, phone-left, phone-right",
    )


def add_worn_gyro(group: argparse._ActionsContainer) -> None:
    """The worn camera's own gyroscope, and how it sits."""
    group.add_argument(
        "--worn-gyro",
        metavar="FILE|TOPIC|none",
        help="a gyroscope of Cf's own, as --gyro that of Cs, along the axes of Cf unless --worn-imu says "
        "otherwise: how its rolling shutter turned",
    )
    group.add_argument("--worn-imu", metavar="FILE|AXES", help="how that sits, as --imu")


def add_odometry(parser: argparse.ArgumentParser) -> None:
    """What moved Cs."""
    group = parser.add_argument_group("odometry, in place of constant velocity")
    group.add_argument(
        "--odometry",
        metavar="FILE|TOPIC",
        help="CSV: stamp, vx, vy, vz (m/s), wx, wy, wz (rad/s), 21 numbers of the covariance; or of a bag: a "
        "topic of twists or nav_msgs/Odometry",
    )
    add_odometry_frame(group)


def add_odometry_frame(group: argparse._ActionsContainer) -> None:
    """Where Cs sits in the odometry's frame, and the noise."""
    group.add_argument(
        "--odometry-camera",
        metavar="X,Y,Z[,R,P,Y]|tf:BASE:CAMERA",
        type=mount,
        help="where Cs sits in the odometry's frame (x ahead, y left, z up): metres, and degrees of roll, "
        "pitch and yaw of a camera that looks along x (default 0,0,0); or two frames of tf, that of the "
        "odometry and that of Cs's images",
    )
    group.add_argument(
        "--odometry-sd",
        metavar="M/S,RAD/S",
        type=_numbers("--odometry-sd", 2),
        help="noise of a sample along and about every axis, in place of the source's own covariances",
    )


def add_worn(parser: argparse.ArgumentParser) -> None:
    """Where the worn camera's views come from."""
    worn = parser.add_argument_group("worn camera Cf")
    worn.add_argument(
        "--worn",
        metavar="SPEC",
        help="recorded, recorded:NAME,.. (these persons), none, lag:SECONDS, rig or views:FOLDER",
    )
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
    worn.add_argument(
        "--worn-mask",
        metavar="[NAME=]IMAGE",
        type=of_person(Path),
        action="append",
        help="as --mask, of the images of Cf; of several persons NAME's, and may be repeated",
    )
    worn.add_argument(
        "--worn-calibration",
        metavar="[NAME=]FILE",
        type=of_person(Path),
        action="append",
        help="corrects T_CF and the stamps of Cf, as `collabslam check-calib --write FILE` found it; of "
        "several persons NAME's, and may be repeated",
    )


def add_printed(parser: argparse.ArgumentParser) -> None:
    """Printed targets."""
    group = parser.add_argument_group("printed targets in the scene")
    group.add_argument(
        "--tag",
        metavar="SET:N=METRES",
        type=tag,
        action="append",
        default=[],
        help="tag N of AprilTag's 36h11 (or 25h9, 4x4_50, ...), side of its black square; may be repeated",
    )
    group.add_argument(
        "--board",
        metavar="CxR:METRES",
        type=board,
        action="append",
        default=[],
        help="checkerboard of C x R inner corners, side of a square",
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """A settings file and single settings."""
    parser.add_argument(
        "--config", metavar="FILE", type=Path, help="settings file, as collabslam settings dump prints it"
    )
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting; may be repeated"
    )


def add_view(parser: argparse.ArgumentParser) -> None:
    """Whether to look at the run."""
    group = parser.add_argument_group("looking (needs the extra viz)")
    group.add_argument("--view", action="store_true", help="open the Rerun viewer while it runs")
    group.add_argument("--save", metavar="FILE.rrd", type=Path, help="write a Rerun recording")


@contextlib.contextmanager
def watching(recording: Recording, arguments: argparse.Namespace) -> Iterator[Watch | None]:
    """What `add_view` asks for, as a function that is given every frame."""
    if not arguments.view and arguments.save is None:
        yield None
        return
    from collabslam.viz.rerun_log import RerunLog

    with RerunLog(recording, view=arguments.view, save=arguments.save) as log:
        yield log.frame


def read_settings(arguments: argparse.Namespace) -> Settings:
    """The settings that `add_settings` asks for."""
    from collabslam.settings.table import Settings, parse_assignments

    settings = Settings.default() if arguments.config is None else Settings.load(arguments.config)
    return settings.replace(parse_assignments(arguments.set))


def source_of(arguments: argparse.Namespace) -> Source:
    """The recording that `add_source` names, as it is."""
    from collabslam.datasets.overrides import Given
    from collabslam.datasets.source import Source

    named = {} if arguments.depth is None else {"depth": arguments.depth}
    files = (arguments.camera, arguments.times, arguments.poses)
    named_axes = {"poses": arguments.poses_axes, "t_cf": arguments.t_cf_axes}
    axes = {of: axes for of, axes in named_axes.items() if axes is not None}
    topics = {**(arguments.topics or {}), **named}
    given = Given(
        *files,
        topics,
        odometry_of(arguments),
        arguments.depth_scale,
        axes,
        gyro_of(arguments),
        arguments.mask,
        _worn_gyro_of(arguments),
    )
    return Source(arguments.source, given)


def gyro_of(arguments: argparse.Namespace) -> GyroGiven | None:
    """What `add_gyro` asks for."""
    from collabslam.datasets.imu.beside import GyroGiven

    if arguments.gyro is None and arguments.imu is None:
        return None
    return GyroGiven(arguments.gyro, arguments.imu)


def _worn_gyro_of(arguments: argparse.Namespace) -> WornGyroGiven | None:
    """What `add_worn_gyro` asks for."""
    from collabslam.datasets.imu.beside import WornGyroGiven

    if arguments.worn_gyro is None and arguments.worn_imu is None:
        return None
    return WornGyroGiven(arguments.worn_gyro, arguments.worn_imu)


def odometry_of(arguments: argparse.Namespace) -> OdometryGiven | None:
    """What `add_odometry` asks for; raises SettingsError if its options lack the odometry."""

    given = vars(arguments)
    source, mount, sd = (given.get(k) for k in ("odometry", "odometry_camera", "odometry_sd"))
    if source is None:
        if mount is not None or sd is not None:
            raise SettingsError(
                "--odometry-camera and --odometry-sd belong to --odometry FILE|TOPIC; give it."
            )
        return None
    return odometry_given(source, mount, sd)


def odometry_given(source: str, mount: Any, sd: tuple[float, float] | None) -> OdometryGiven:
    """Odometry, placed as `mount` reads it, or not at all."""
    from collabslam.datasets.odometry import OdometryGiven

    if mount is not None and isinstance(mount[0], str):
        return OdometryGiven(source, sd=sd, frames=mount)
    return OdometryGiven(source, mount or (0.0, 0.0, 0.0), sd)


def source_with_worn(arguments: argparse.Namespace) -> Source:
    """The recording that `add_source` names, with the worn camera of `add_worn` or, without one, its own."""
    from collabslam.datasets.source import WornSpec

    worn = WornSpec(
        arguments.worn or "recorded",
        available=1.0 if arguments.worn_available is None else arguments.worn_available,
        period=arguments.worn_period,
        intervals=arguments.worn_intervals,
        noise=arguments.worn_noise,
        seed=arguments.seed,
        bias_per_block=arguments.worn_bias_per_block,
    )
    corrected = by_person("--worn-calibration", arguments.worn_calibration or [])
    masks = by_person("--worn-mask", arguments.worn_mask or [])
    return dataclasses.replace(source_of(arguments), worn=worn, worn_calibrations=corrected, worn_masks=masks)


def notes_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """How the worn camera was made, for the summary."""
    given = {k: v for k, v in vars(arguments).items() if k.startswith("worn") and v is not None}
    if arguments.mask is not None:
        given["mask"] = arguments.mask
    return given | {"seed": arguments.seed}


def share(text: str) -> float:
    """``0.4`` or ``40%`` as 0.4."""
    try:
        value = float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not a share; give 0 to 1, or 0% to 100%")
    return value


def intervals(text: str) -> list[tuple[float, float]]:
    """``0-2,5-7.5`` as [(0, 2), (5, 7.5)]."""
    try:
        pairs = [tuple(float(x) for x in part.split("-")) for part in text.split(",")]
        return [(a, b) for a, b in pairs]
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' are not intervals; give seconds as 0-2,5-7.5") from None


def noise(text: str) -> tuple[float, ...]:
    """``0.03,0.5,0.5,1`` as four numbers."""
    try:
        values = tuple(float(x) for x in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 4:
        raise argparse.ArgumentTypeError(f"'{text}' is not noise; give four numbers as 0.03,0.5,0.5,1")
    return values


def _numbers(option: str, *counts: int) -> Callable[[str], tuple[float, ...]]:
    """Reads numbers that commas part."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(x) for x in text.split(","))
        except ValueError:
            values = ()
        if len(values) not in counts or not all(map(math.isfinite, values)):
            wanted = " or ".join(map(str, counts))
            raise argparse.ArgumentTypeError(f"'{text}' does not do for {option}; give {wanted} numbers")
        return values

    return read


def mount(text: str) -> tuple[float, ...] | tuple[str, str]:
    """Three or six numbers, or ``tf:BASE:CAMERA`` as two names of frames."""
    if not text.startswith("tf:"):
        return _numbers("--odometry-camera", 3, 6)(text)
    base, _, camera = text.removeprefix("tf:").partition(":")
    if not (base and camera) or ":" in camera:
        raise argparse.ArgumentTypeError(f"'{text}' names no two frames; give tf:base_link:camera_optical")
    return base, camera


def of_person(read: Callable[[str], T]) -> Callable[[str], tuple[str, T]]:
    """Reads ``anna=VALUE`` as a name and a value; a VALUE alone, as ``/a=b/file``, is nobody's, ""."""

    def read_pair(text: str) -> tuple[str, T]:
        name, equals, value = text.partition("=")
        if not equals or {"/", ":"} & set(name):
            return "", read(text)
        return name, read(value)

    return read_pair


def by_person(option: str, pairs: Sequence[tuple[str, T]]) -> dict[str, T]:
    """The values of an option by name, as `of_person` reads them; SettingsError if a name is given twice."""
    out: dict[str, T] = {}
    for name, value in pairs:
        if name in out:
            whose = f" for {name}" if name else ""
            raise SettingsError(f"{option} was given twice{whose}; give it once, of each person as NAME=...")
        out[name] = value
    return out


def topics(text: str) -> dict[str, str]:
    """``cs=/a,cf=/b`` as a dictionary."""
    pairs = [part.partition("=")[::2] for part in text.split(",")]
    if not all(role and topic for role, topic in pairs):
        raise argparse.ArgumentTypeError(f"'{text}' are not topics; give ROLE=TOPIC, as cs=/cam0/image_raw")
    return dict(pairs)


def tag(text: str) -> Tag:
    """``36h11:3=0.16`` as a tag."""
    from collabslam.targets.kinds import Tag

    with _argument():
        return Tag.parse(text)


def board(text: str) -> Board:
    """``7x5:0.03`` as a board."""
    from collabslam.targets.kinds import Board

    with _argument():
        return Board.parse(text)


@contextlib.contextmanager
def _argument() -> Iterator[None]:
    """What is wrong with an argument, as argparse says it."""
    try:
        yield
    except CollabslamError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def seed_list(text: str) -> list[int]:
    """``0-4`` or ``0,2,5`` as a list."""
    try:
        first, dash, last = text.partition("-")
        seeds = list(range(int(first), int(last) + 1)) if dash else [int(x) for x in text.split(",")]
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise argparse.ArgumentTypeError(f"'{text}' are not seeds; give 0-4 or 0,2,5")
    return seeds
