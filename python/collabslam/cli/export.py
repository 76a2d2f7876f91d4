"""``collabslam export``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from collabslam.cli import OK

FORMATS = {
    "euroc": "trajectory as EuRoC CSV",
    "kitti": "trajectory as KITTI poses, with their stamps in a second file",
    "csv": "landmarks with covariance as CSV",
    "ros2": "trajectory with covariance as nav_msgs/Odometry in a ROS 2 bag (sqlite3), loops on /tf",
    "ros2-mcap": "the same in an MCAP bag",
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("run", metavar="RUN", type=Path, help="result folder of a run")
    parser.add_argument("out", metavar="OUT", type=Path, help="new file, or folder of a bag")
    texts = "; ".join(f"{name}: {text}" for name, text in FORMATS.items())
    parser.add_argument(
        "--world",
        choices=("start", "level"),
        default="start",
        help="axes: those of Cs at the start (x right, y down, z forward; default), or level (x ahead, "
        "y left, z up), of a run with --world level",
    )
    parser.add_argument("--to", metavar="FORMAT", required=True, choices=FORMATS, help=texts)


def main(arguments: argparse.Namespace) -> int:
    """Write one format."""
    from collabslam.errors import DataError
    from collabslam.formats import landmarks, trajectory
    from collabslam.formats import ros_odometry as rosbag
    from collabslam.runs.results import LEVEL_TRAJECTORY
    from collabslam.runs.run_folder import RunFolder

    run, out, kind = RunFolder(arguments.run), arguments.out, arguments.to
    level = arguments.world == "level"
    if level and not (run.path / LEVEL_TRAJECTORY).is_file():
        raise DataError(f"{run.path} has no poses in a level world; run the recording with --world level.")
    for place in (out, trajectory.kitti_stamps(out)) if kind == "kitti" else (out,):
        if place.exists():
            raise DataError(f"The file {place} exists already; give another place.")
    if kind == "csv":
        points = run.level_landmarks() if level else run.landmarks()
        landmarks.write_csv(out, points)
        print(f"{len(points.ids)} landmarks are in {out}")
        return OK
    times, poses, covariances = run.level_trajectory() if level else run.trajectory()
    if not run.is_metric():
        print("collabslam: warning: lengths are in an arbitrary unit, not metres.", file=sys.stderr)
    if kind == "euroc":
        trajectory.write_euroc(out, times, poses)
    elif kind == "kitti":
        print(f"the stamps are in {trajectory.write_kitti(out, times, poses)}")
    else:
        storage = "mcap" if kind == "ros2-mcap" else "sqlite3"
        corrected = None if level else run.corrected()
        rosbag.write_odometry(out, times, poses, covariances, corrected, storage=storage)
    print(f"{len(times)} poses are in {out}")
    return OK
