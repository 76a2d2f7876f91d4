"""``collabslam live ros``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from collabslam.cli import OK, options
from collabslam.errors import SettingsError
from collabslam.settings.modes import MODES

if TYPE_CHECKING:
    from collabslam.live.wheels import WheelTopic


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--cs", metavar="TOPIC", required=True, help="images of Cs, Image or CompressedImage")
    parser.add_argument("--cs-info", metavar="TOPIC", required=True, help="CameraInfo of Cs")
    parser.add_argument("--cf", metavar="TOPIC", help="images of Cf")
    parser.add_argument("--cf-info", metavar="TOPIC", help="CameraInfo of Cf")
    parser.add_argument(
        "--t-cf",
        metavar="TOPIC",
        help="T_CF as PoseWithCovarianceStamped, with the stamps of Cf's images; or /tf, which tells it "
        "between the frames that both cameras' images name; or sensors:FILE, which says how the scanners "
        "and AHRSs are mounted from which it is estimated",
    )
    parser.add_argument(
        "--t-cf-sd",
        metavar="METRES,DEGREES",
        type=_deviations,
        help="with --t-cf /tf, which tells none: standard deviations of T_CF's coordinates and angles",
    )
    wheels = parser.add_mutually_exclusive_group()
    wheels.add_argument(
        "--odometry",
        metavar="TOPIC",
        help="wheel odometry as nav_msgs/Odometry, in place of constant velocity",
    )
    wheels.add_argument("--twist", metavar="TOPIC", help="the same as TwistWithCovarianceStamped")
    options.add_odometry_frame(parser)
    parser.add_argument(
        "--out", metavar="NAME", default="/collabslam", help="of published topics (default %(default)s)"
    )
    parser.add_argument("--mode", choices=MODES, help="default: the setting's, or mono without --cf")
    options.add_settings(parser)


def _deviations(text: str) -> tuple[float, float]:
    """``0.03,1.0``: metres and degrees."""
    try:
        metres, degrees = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}' is no METRES,DEGREES, as 0.03,1.0") from error
    return metres, degrees


def _wheels(arguments: argparse.Namespace) -> WheelTopic | None:
    """The topic of odometry that is asked for; raises SettingsError if its options lack it."""
    from collabslam.datasets.odometry import mounted
    from collabslam.live import messages
    from collabslam.live.wheels import WheelTopic

    kinds = ((arguments.odometry, messages.ODOMETRY), (arguments.twist, messages.TWIST))
    asked = next(((name, kind) for name, kind in kinds if name), None)
    place, sd = arguments.odometry_camera, arguments.odometry_sd
    if asked is None:
        if place is not None or sd is not None:
            raise SettingsError(
                "--odometry-camera and --odometry-sd belong to --odometry or --twist; give one."
            )
        return None
    by_tf = place is not None and isinstance(place[0], str)
    return WheelTopic(*asked, place if by_tf else mounted(place or (0.0, 0.0, 0.0)), sd)


def main(arguments: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
    from collabslam.live.ros import NAME, RosNode, RosTopics
    from collabslam.live.ros_types import rclpy_of

    worn = (arguments.cf, arguments.cf_info, arguments.t_cf)
    if any(worn) and not all(worn):
        raise SettingsError("A worn camera needs --cf, --cf-info and --t-cf; give all three or none.")
    rclpy = rclpy_of()
    wheels = _wheels(arguments)
    topics = RosTopics(
        arguments.cs, arguments.cs_info, *worn, t_cf_sd=arguments.t_cf_sd, wheels=wheels, out=arguments.out
    )
    alone = "scale-free" if wheels is None else "odometry"
    mode, start = (arguments.mode, "worn") if arguments.cf else (arguments.mode or "mono", alone)
    rclpy.init(args=[])
    node = rclpy.create_node(NAME)
    live = RosNode(node, topics, options.read_settings(arguments), mode=mode, start=start)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    live.close()
    return OK
