"""``collabslam export``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import OK

if TYPE_CHECKING:
    from collabslam.runs.run_folder import RunFolder

FORMATS = {
    "euroc": "trajectory as EuRoC CSV",
    "kitti": "trajectory as KITTI poses, with their stamps in a second file",
    "csv": "landmarks with covariance as CSV",
    "ply": "the same as binary PLY",
    "ros2": "trajectory with covariance as nav_msgs/Odometry in a ROS 2 bag (sqlite3), loops on /tf",
    "ros2-mcap": "the same in an MCAP bag",
    "colmap": "camera, poses and landmarks as a COLMAP model (sparse/0), binary",
    "colmap-text": "the same as text",
    "nerfstudio": "the same as transforms.json and a cloud",
}
MODELS = ("colmap", "colmap-text", "nerfstudio")
"""Those that are folders of poses and points, with images where they are asked for."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("run", metavar="RUN", type=Path, help="result folder of a run")
    parser.add_argument("out", metavar="OUT", type=Path, help="new file, or folder of a bag or a model")
    texts = "; ".join(f"{name}: {text}" for name, text in FORMATS.items())
    parser.add_argument(
        "--world",
        choices=("start", "level"),
        default="start",
        help="axes: those of Cs at the start (x right, y down, z forward; default), or level (x ahead, "
        "y left, z up), of a run with --world level",
    )
    parser.add_argument("--format", metavar="FORMAT", required=True, choices=FORMATS, help=texts)
    parser.add_argument(
        "--images",
        metavar="SOURCE",
        type=Path,
        help="of a model: the run's recording, whose images are to lie beside the poses",
    )
    parser.add_argument(
        "--camera", metavar="FILE", type=Path, help="calibration that the recording of --images needs"
    )


def main(arguments: argparse.Namespace) -> int:
    """Write one format."""
    from collabslam.errors import DataError, SettingsError
    from collabslam.formats import landmarks, trajectory
    from collabslam.formats import ros_odometry as rosbag
    from collabslam.runs.results import LEVEL_TRAJECTORY
    from collabslam.runs.run_folder import RunFolder

    run, out, kind = RunFolder(arguments.run), arguments.out, arguments.format
    level = arguments.world == "level"
    if level and not (run.path / LEVEL_TRAJECTORY).is_file():
        raise DataError(f"{run.path} has no poses in a level world; run the recording with --world level.")
    if arguments.images is not None and kind not in MODELS:
        raise SettingsError(f"Images go with {', '.join(MODELS)}; leave --images out for {kind}.")
    for place in (out, trajectory.kitti_stamps(out)) if kind == "kitti" else (out,):
        if place.exists():
            raise DataError(f"The file {place} exists already; give another place.")
    if not run.is_metric():
        print("collabslam: warning: lengths are in an arbitrary unit, not metres.", file=sys.stderr)
    if kind in ("csv", "ply"):
        points = run.level_landmarks() if level else run.landmarks()
        write = landmarks.write_csv if kind == "csv" else landmarks.write_ply
        write(out, points)
        print(f"{len(points.ids)} landmarks are in {out}")
        return OK
    if kind in MODELS:
        return _write_model(run, arguments, level=level)
    times, poses, covariances = run.level_trajectory() if level else run.trajectory()
    if kind == "euroc":
        trajectory.write_euroc(out, times, poses)
    elif kind == "kitti":
        print(f"the stamps are in {trajectory.write_kitti(out, times, poses)}")
    else:
        from collabslam.runs.busy import busy

        storage = "mcap" if kind == "ros2-mcap" else "sqlite3"
        corrected = None if level else run.corrected()
        with busy(f"writing {len(times)} poses"):
            rosbag.write_odometry(out, times, poses, covariances, corrected, storage=storage)
    print(f"{len(times)} poses are in {out}")
    return OK


def _write_model(run: RunFolder, arguments: argparse.Namespace, *, level: bool) -> int:
    """Poses and points, as loops correct them, in a folder of their own."""
    from collabslam.datasets import open_recording
    from collabslam.runs.busy import busy
    from collabslam.runs.model_folder import write_model

    recording = None
    with busy("writing the model") as tell:
        if arguments.images is not None:
            tell("reading the recording")
            recording = open_recording(arguments.images, camera=arguments.camera)
            tell("writing the model and its images")
        poses, points = write_model(run, arguments.out, arguments.format, level=level, recording=recording)
    print(f"{poses} poses and {points} landmarks are in {arguments.out}")
    return OK
