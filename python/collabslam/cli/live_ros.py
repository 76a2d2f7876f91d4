"""``collabslam live ros``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from collabslam.cli import OK, options
from collabslam.cli.live_options import add_wheels, wheels_of
from collabslam.errors import SettingsError
from collabslam.settings.modes import MODES

if TYPE_CHECKING:
    from collabslam.level import Level
    from collabslam.live.ros import MapFiles
    from collabslam.live.ros_frames import RosFrames
    from collabslam.live.ros_worn import WornTopics
    from collabslam.settings.table import Settings

LONGEST_LATENCY, FASTEST = 1.0, 1000.0
TF_CHOICES = ("all", "map", "none")
"""As `collabslam.live.ros_frames.TF_CHOICES`, which is not imported to tell of options."""
NEEDED = {"--cf": "cf", "--cf-info": "cf_info", "--t-cf": "t_cf"}
"""Options that each worn camera needs, and what argparse calls them."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--cs", metavar="TOPIC", required=True, help="images of Cs, Image or CompressedImage")
    parser.add_argument("--cs-info", metavar="TOPIC", required=True, help="CameraInfo of Cs")
    worn = parser.add_argument_group(
        "worn camera Cf", "of several persons each option is NAME=... and given for each of them"
    )
    person = partial(worn.add_argument, action="append", default=[])
    person("--cf", metavar="[NAME=]TOPIC", type=options.of_person(str), help="images of Cf")
    person("--cf-info", metavar="[NAME=]TOPIC", type=options.of_person(str), help="CameraInfo of Cf")
    person(
        "--t-cf",
        metavar="[NAME=]TOPIC",
        type=options.of_person(str),
        help="T_CF as PoseWithCovarianceStamped, with the stamps of Cf's images; or /tf, which tells it "
        "between the frames that both cameras' images name; or sensors:FILE, which says how the scanners "
        "and AHRSs are mounted from which it is estimated",
    )
    person(
        "--t-cf-sd",
        metavar="[NAME=]METRES,DEGREES",
        type=options.of_person(_deviations),
        help="with --t-cf /tf, which tells none: standard deviations of T_CF's coordinates and angles",
    )
    person(
        "--worn-gyro",
        metavar="[NAME=]TOPIC",
        type=options.of_person(str),
        help="a gyroscope of Cf's own, a sensor_msgs/Imu: how its rolling shutter turned",
    )
    person(
        "--worn-imu",
        metavar="[NAME=]FILE|AXES",
        type=options.of_person(str),
        help="how that sits, as --imu; without it tf tells it, between its frame and that of Cf's images",
    )
    add_wheels(parser)
    parser.add_argument("--gyro", metavar="TOPIC", help="the robot's gyroscope, a sensor_msgs/Imu")
    parser.add_argument(
        "--imu",
        metavar="FILE|AXES",
        help="how the gyroscope sits and how good it is: imu.yaml, camchain-imucam.yaml, or its axes "
        "(optical, opengl, ros); without it tf tells how it sits",
    )
    parser.add_argument(
        "--propagate",
        metavar="HZ",
        type=float,
        default=100.0,
        help="poses between frames, by the gyroscope (default %(default)g; 0: none)",
    )
    parser.add_argument(
        "--latency",
        metavar="SECONDS",
        type=float,
        default=0.0,
        help="by how much images of Cs are stamped after they were taken (default 0)",
    )
    _add_frames(parser)
    parser.add_argument(
        "--out",
        metavar="NAME",
        default="/collabslam",
        help="of published topics and services (default %(default)s)",
    )
    parser.add_argument("--map", metavar="FILE", help="start in this map of an earlier run")
    parser.add_argument("--save-map", metavar="FILE", help="where the service save_map writes it")
    parser.add_argument("--mode", choices=MODES, help="default: the setting's, or mono without --cf")
    options.add_settings(parser)


def _add_frames(parser: argparse.ArgumentParser) -> None:
    """Frames of REP 105."""
    group = parser.add_argument_group("frames")
    group.add_argument(
        "--base",
        metavar="X,Y,Z[,R,P,Y]|tf:BASE:CAMERA",
        type=options.mount,
        help="where Cs sits on the robot's base (x ahead, y left, z up): metres, and degrees of roll, pitch "
        "and yaw of a camera that looks along x; or two frames that fixed links of tf join (default: as "
        "--odometry-camera, whose default it is in turn; else 0,0,0)",
    )
    for name, default in (("map", "map"), ("odom", "odom"), ("base", "base_link")):
        group.add_argument(
            f"--{name}-frame",
            metavar="NAME",
            default=default,
            help="in tf and messages (default %(default)s)",
        )
    group.add_argument(
        "--tf",
        choices=TF_CHOICES,
        default="all",
        help="links that are sent: map -> odom -> base (all, default), map -> odom where the wheels' node "
        "sends odom -> base (map), or none",
    )
    group.add_argument(
        "--world",
        metavar="level[:ROLL,PITCH]",
        help="odom and map are level, as the accelerometer of --gyro tells which way is down (poses are sent "
        "once it has), or roll and pitch of Cs at the start, degrees (looking down by 10 is 0,10)",
    )


def _deviations(text: str) -> tuple[float, float]:
    """``0.03,1.0``: metres and degrees."""
    try:
        metres, degrees = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}' is no METRES,DEGREES, as 0.03,1.0") from error
    return metres, degrees


def main(arguments: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
    from collabslam.live.ros import NAME
    from collabslam.live.ros_types import rclpy_of

    rclpy = rclpy_of()
    rclpy.init(args=[])
    node = rclpy.create_node(NAME)
    maps = map_files(arguments.map, arguments.save_map)
    return spin(node, arguments, options.read_settings(arguments), lambda: maps)


def map_files(start: str | None, save: str | None) -> MapFiles:
    """The files of these names, of those that are given."""
    from collabslam.live.ros import MapFiles

    return MapFiles(*(Path(name) if name else None for name in (start, save)))


def spin(node: Any, arguments: argparse.Namespace, settings: Settings, maps: Callable[[], MapFiles]) -> int:
    """Run a ``rclpy`` node until Ctrl-C, with the arguments that `configure` asks for."""
    from collabslam.live.gyro_topic import GyroTopic
    from collabslam.live.ros import RosNode, RosTopics
    from collabslam.live.ros_types import rclpy_of

    rclpy = rclpy_of()
    arguments = with_mounts(arguments)
    worn, wheels = worn_topics(arguments), wheels_of(arguments)
    gyro = GyroTopic.asked(arguments.gyro, arguments.imu)
    topics = RosTopics(
        arguments.cs,
        arguments.cs_info,
        worn,
        wheels,
        gyro,
        arguments.out,
        frames_of(arguments),
        arguments.latency,
        arguments.propagate,
        arguments.world is not None,
        told_level(arguments),
    )
    alone = "scale-free" if wheels is None else "odometry"
    mode, start = (arguments.mode, "worn") if worn else (arguments.mode or "mono", alone)
    live = RosNode(node, topics, settings, mode=mode, start=start, maps=maps)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, import_module("rclpy.executors").ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    live.close()
    return OK


def told_level(arguments: argparse.Namespace) -> Level | None:
    """Which way is down as --world tells it; raises SettingsError if neither that nor a sensor does."""
    from collabslam.runs.level import parse_world

    told = None if arguments.world is None else parse_world(arguments.world)
    if arguments.world is not None and told is None and arguments.gyro is None:
        raise SettingsError(
            "--world level asks an accelerometer, and there is none; give the --gyro TOPIC of a sensor that "
            "has one, or level:ROLL,PITCH."
        )
    return told


def with_mounts(arguments: argparse.Namespace) -> argparse.Namespace:
    """The arguments, in which the wheels' frame is the base where nothing else is said of it."""
    wheels = arguments.odometry or arguments.twist
    if wheels and arguments.odometry_camera is None:
        return argparse.Namespace(**{**vars(arguments), "odometry_camera": arguments.base})
    return arguments


def frames_of(arguments: argparse.Namespace) -> RosFrames:
    """Names of frames, and where Cs sits; raises SettingsError for a time or rate that cannot be."""
    from collabslam.live.ros_frames import RosFrames

    if not abs(arguments.latency) <= LONGEST_LATENCY:
        raise SettingsError(
            f"The latency is {arguments.latency} s; give at most {LONGEST_LATENCY:g} s either way."
        )
    if not 0.0 <= arguments.propagate <= FASTEST:
        raise SettingsError(
            f"{arguments.propagate} poses a second cannot be propagated; give 0 to {FASTEST:g}."
        )
    names = (arguments.map_frame, arguments.odom_frame, arguments.base_frame)
    if len(set(names)) < len(names) or not all(names):
        raise SettingsError(f"The frames {', '.join(names)} are not three different names; give such.")
    return RosFrames(*names, arguments.base, arguments.tf)


def worn_topics(arguments: argparse.Namespace) -> dict[str, WornTopics]:
    """The topics of each worn camera, by the name of whoever wears it; "" is that of a single one.

    Raises
    ------
    SettingsError
        If a name cannot be one, is given twice, or lacks an option, or a gyroscope is described and not
        named.
    """
    from collabslam.live.gyro_topic import GyroTopic
    from collabslam.live.names import device_name
    from collabslam.live.ros_worn import WornTopics

    needed = {of: options.by_person(of, getattr(arguments, key)) for of, key in NEEDED.items()}
    deviations = options.by_person("--t-cf-sd", arguments.t_cf_sd)
    gyros = options.by_person("--worn-gyro", arguments.worn_gyro)
    imus = options.by_person("--worn-imu", arguments.worn_imu)
    told = (*needed.values(), deviations, gyros, imus)
    names = dict.fromkeys(name for values in told for name in values)
    if "" in names and len(names) > 1:
        raise SettingsError("Of several worn cameras each is a person's; give every option as NAME=... then.")
    for name in names:
        whose = f"The worn camera of {device_name(name)}" if name else "A worn camera"
        missing = [of for of, values in needed.items() if name not in values]
        if missing:
            raise SettingsError(
                f"{whose} needs {', '.join(needed)} and has no {', '.join(missing)}; give all three or none."
            )
    images, infos, poses = needed.values()
    own = {n: GyroTopic.asked(gyros.get(n), imus.get(n), "worn-") for n in names}
    return {n: WornTopics(images[n], infos[n], poses[n], deviations.get(n), own[n]) for n in names}
