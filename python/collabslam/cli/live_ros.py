"""``collabslam live ros``."""

from __future__ import annotations

import argparse

from collabslam.cli import OK, options
from collabslam.cli.live_options import add_wheels, wheels_of
from collabslam.errors import SettingsError
from collabslam.settings.modes import MODES


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
    add_wheels(parser)
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


def main(arguments: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
    from collabslam.live.ros import NAME, RosNode, RosTopics
    from collabslam.live.ros_types import rclpy_of

    worn = (arguments.cf, arguments.cf_info, arguments.t_cf)
    if any(worn) and not all(worn):
        raise SettingsError("A worn camera needs --cf, --cf-info and --t-cf; give all three or none.")
    rclpy = rclpy_of()
    wheels = wheels_of(arguments)
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
