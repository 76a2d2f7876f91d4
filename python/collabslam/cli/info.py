"""``collabslam info``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from collabslam.cli import OK, options

if TYPE_CHECKING:
    from collections.abc import Mapping

    from collabslam._core import Camera
    from collabslam.types import ImuLog, Odometry, Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_odometry(parser)


def main(arguments: argparse.Namespace) -> int:
    """Print the topics of a bag, what the recording is, and what was read of it from where."""
    from collabslam.datasets.gate import listening
    from collabslam.datasets.ros.bag import Bag, is_bag
    from collabslam.datasets.ros.reader import ROLES
    from collabslam.runs.busy import busy
    from collabslam.runs.report import text_table

    if is_bag(arguments.source):
        with Bag(arguments.source) as bag:
            print(f"topics of {arguments.source}")
            print(text_table([[t.name, t.type, str(t.messages)] for t in bag.topics] or [["none"]]))
        print("roles for --topics")
        print(text_table([list(row) for row in ROLES.items()]))
    with busy("reading the recording"), listening() as facts:
        recording = options.source_of(arguments).open()
    print(recording.name)
    print(text_table([[label, text] for label, text in describe(recording).items()]))
    print("read")
    print(text_table([[f.what, f.source, f.value] for f in facts] or [["nothing beside the images"]]))
    return OK


def describe(recording: Recording) -> dict[str, str]:
    """What a recording holds, in words."""
    import numpy as np

    from collabslam.types import worn_cameras

    times, truth = recording.times, recording.truth
    seconds = float(times[-1] - times[0])
    rate = (len(times) - 1) / seconds if seconds > 0.0 else 0.0
    known = 0 if truth is None else int(np.isfinite(truth).all(axis=(1, 2)).sum())
    rig = getattr(recording, "rig", None)
    worn = worn_cameras(recording)
    return {
        "source": recording.source,
        "frames": f"{len(times)} in {seconds:.2f} s ({rate:.1f} a second)",
        "first stamp": f"{times[0]:.9f} s",
        "camera Cs": _camera(recording.camera),
        "worn camera Cf": "none recorded (see --worn)" if not worn else _worn(worn),
        "worn pose": "none" if not worn else getattr(recording, "worn_pose", "measured"),
        "second camera of the rig": "none"
        if rig is None
        else f"{_camera(rig.camera)}, {len(rig.paths)} images; used as Cf unless --worn says otherwise",
        "depth": "yes" if getattr(recording, "has_depth", False) else "none",
        "odometry": _odometry(getattr(recording, "odometry", None)),
        **_gyro(getattr(recording, "imu", None)),
        **_worn_gyro(getattr(recording, "worn_imu", {})),
        "true poses": f"{known} of {len(times)} frames" if known else "none (see --poses)",
        "known target": "none" if recording.target is None else f"{len(recording.target.points)} points",
        "conventions": "T_WC maps points of C into W; metres, seconds; C: x right, y down, z forward",
    }


def _worn(cameras: dict[str, Camera]) -> str:
    return "; ".join(
        f"{name}: {_camera(camera)}" if name else _camera(camera) for name, camera in cameras.items()
    )


def _odometry(odometry: Odometry | None) -> str:
    return "none" if odometry is None else f"{len(odometry)} samples"


def _worn_gyro(logs: Mapping[str, ImuLog]) -> dict[str, str]:
    """What there is of gyroscopes on worn cameras; nothing where there is none."""
    from collabslam.datasets.imu.log import describe

    told = "; ".join(f"{name}: {describe(log)}" if name else describe(log) for name, log in logs.items())
    return {"gyroscope of Cf": told} if told else {}


def _gyro(log: ImuLog | None) -> dict[str, str]:
    """What there is of a gyroscope: samples and gaps, noise, mount and clock."""
    if log is None:
        return {"gyroscope": "none (see --gyro)"}
    import numpy as np

    from collabslam.datasets.imu.log import describe, gaps_text
    from collabslam.geometry import rotation_log

    sensor = log.sensor
    stated = {
        "noise": (sensor.gyro_noise, "rad/s/sqrt(Hz)"),
        "bias": (sensor.gyro_bias_sd, "rad/s"),
        "bias walk": (sensor.gyro_bias_walk, "rad/s/sqrt(s)"),
        "scale": (sensor.gyro_scale_sd, ""),
    }
    noise = [f"{what} {sd:g} {unit}".rstrip() for what, (sd, unit) in stated.items() if sd is not None]
    turn = np.rad2deg(rotation_log(sensor.r_ci))
    sure = "" if sensor.mount_sd is None else f", known to {np.rad2deg(sensor.mount_sd):.2g}"
    return {
        "gyroscope": f"{describe(log)}, {gaps_text(log)}; {log.left_out} left out",
        "  accelerometer": "none" if log.accelerations is None else "yes",
        "  noise": ", ".join(noise) or "not told (the settings' defaults)",
        "  mount": f"axes turned by {turn[0]:.1f} {turn[1]:.1f} {turn[2]:.1f} degrees into those of Cs{sure}",
        "  clock": f"{sensor.time_offset:+.4f} s are added to its stamps",
    }


def _camera(camera: Camera) -> str:
    fx, fy, cx, cy = camera.intrinsics
    lens = " ".join([camera.model, *(f"{k:g}" for k in camera.distortion)])
    return f"{camera.width}x{camera.height} {lens}, fx {fx:g} fy {fy:g} cx {cx:g} cy {cy:g} px"
