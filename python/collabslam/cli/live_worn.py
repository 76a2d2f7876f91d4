"""``collabslam live worn``."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from collabslam.cli import OK, options
from collabslam.cli.live_options import add_camera, add_link
from collabslam.errors import SettingsError

PATIENCE = 5.0
"""Seconds without the robot after which the reasons are named."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_camera(parser)
    parser.add_argument(
        "--robot", metavar="HOST:PORT", default="127.0.0.1", help="where the robot is (default %(default)s)"
    )
    parser.add_argument(
        "--name",
        metavar="NAME",
        help="of this device, and of the person whose views a recording plays (default: its certificate's, "
        "or worn)",
    )
    parser.add_argument(
        "--sensors",
        metavar="FILE",
        type=Path,
        help="whose topic of the worn AHRS is sent, too (ros:TOPIC or a bag as SOURCE)",
    )
    parser.add_argument(
        "--robot-sensors",
        action="store_true",
        help="with --sensors: send the robot's scans and attitudes as well, where this machine hears them",
    )
    own = parser.add_argument_group("the device's own gyroscope, a topic beside ros:TOPIC")
    own.add_argument("--gyro", metavar="TOPIC", help="a sensor_msgs/Imu: how the rolling shutter turned")
    own.add_argument(
        "--imu",
        metavar="FILE|AXES",
        help="how it sits, as in 'collabslam run'; without it tf tells it, between the frames of images and "
        "samples",
    )
    add_link(parser)


def main(arguments: argparse.Namespace) -> int:
    """Send until the camera ends or Ctrl-C."""
    from collabslam.datasets.ros.sensors import read_sensors
    from collabslam.live import link
    from collabslam.live.cameras import ROS_TOPIC, RecordingPlayback, open_camera
    from collabslam.live.monotonic_clock import MonotonicClock
    from collabslam.live.sending import send_all, send_sensors
    from collabslam.live.status_line import StatusLine
    from collabslam.live.worn import WornDevice
    from collabslam.runs.busy import busy

    gyro = options.gyro_of(arguments)
    if gyro is not None and not arguments.source.startswith(ROS_TOPIC):
        raise SettingsError(
            f"--gyro and --imu tell of a topic beside the images of ros:TOPIC, and {arguments.source} is "
            "none; leave them out. A recording's own goes with its views by itself."
        )
    keys = link.keys_of(arguments.keys, insecure=arguments.insecure)
    address = link.Address.parse(arguments.robot)
    sensors = None if arguments.sensors is None else read_sensors(arguments.sensors)
    name = arguments.name or (keys.name if keys is not None else "worn")
    with busy("opening the camera"):
        camera = open_camera(arguments.source, arguments.camera, arguments.topics, gyro=gyro)
    calibration = camera.camera
    if isinstance(camera, RecordingPlayback):
        camera.clock = MonotonicClock()
        camera.play(name)
        calibration = camera.recording.worn_camera or calibration
    line = StatusLine()
    with (
        link.open_device(address, keys) as session,
        WornDevice(session, name, calibration, camera.clock, line.show) as device,
    ):
        if not device.wait_for_robot(PATIENCE):
            _say(
                f"no robot answers at {address.host}:{address.port}. Is 'collabslam live robot' running "
                "there, is the port open, are both ends' keys of one authority, and was the robot started "
                "after this device's keys were made? Trying on."
            )
        try:
            if sensors is not None:
                wanted = sensors if arguments.robot_sensors else sensors.only("worn")
                send_sensors(device, camera, wanted)
            send_all(device, camera, lambda: False)
            time.sleep(0.2)
        except KeyboardInterrupt:
            pass
        line.end()
        _say(f"{device.sent} images sent")
    return OK


def _say(text: str) -> None:
    print(f"collabslam: {text}", file=sys.stderr, flush=True)
