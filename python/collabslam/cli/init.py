"""``collabslam init``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import OK, options

if TYPE_CHECKING:
    from collabslam._core import Camera
    from collabslam.checks.calibrate_camera import Calibration
    from collabslam.datasets.pictures import Pictures

STUB = """\
# Camera of {source}: its images are {width}x{height} pixels.
# The four intrinsics below are a GUESS ({guess}): replace them by those of a calibration, or the
# result has neither the right shape nor the right scale: collabslam init --board makes one. Kalibr, OpenCV
# and ROS files are read, too.
camera_model: pinhole
intrinsics: [{f:.1f}, {f:.1f}, {cx:.1f}, {cy:.1f}] # fx fy cx cy, pixels
distortion_model: radtan # none, radtan (k1 k2 p1 p2 and maybe k3) or equidistant (k1 k2 k3 k4)
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
resolution: [{width}, {height}]
rate: 30 # frames per second, for images that carry no time stamps
"""
PHONE = 0.76
"""Focal length of a phone's main camera as it films, as a share of the image's long side: phones of 24 to 28
mm (35 mm equivalent) whose stabilisation crops 0 to 20 % have 0.7 to 0.9."""
PHONE_COST = """\
A guess may be 10 % off, and then nothing that comes of it is metric: the way is bent and its scale is off by
as much. Two minutes with a board (collabslam init --board 7x5:0.03 VIDEO) make it 100 times better."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path(), help="folder (default: this one)")
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--board",
        metavar="CxR:METRES",
        type=options.board,
        help="calibrate from pictures of a checkerboard of C x R inner corners",
    )
    how.add_argument(
        "--phone", action="store_true", help="guess from the photograph, or as phones usually are"
    )


def main(arguments: argparse.Namespace) -> int:
    """Write settings.yaml and camera.yaml, and imu.yaml where there is a gyroscope; say how to go on."""
    from collabslam.errors import DataError
    from collabslam.formats.files import write_text
    from collabslam.settings.table import Settings

    if not arguments.source.exists():
        raise DataError(
            f"The recording {arguments.source} does not exist; give the folder or the file of one."
        )
    settings, camera, imu = (arguments.out / f"{name}.yaml" for name in ("settings", "camera", "imu"))
    for path in (settings, camera, imu):
        if path.exists():
            raise DataError(f"The file {path} exists already; give another folder with --out.")
    text, complete = _calibration(arguments)
    known = complete and arguments.board is None
    sensor = _gyroscope(arguments) if known else None
    write_text(settings, Settings.default().dump(title="defaults, to be changed"))
    write_text(camera, text)
    print(f"settings are in {settings}")
    guess = "" if complete else "; its intrinsics are a guess, replace them"
    print(f"the calibration is in {camera}{guess}")
    beside = ""
    if sensor is not None:
        write_text(imu, sensor)
        print(f"how the gyroscope sits is in {imu}")
        beside = f" --gyro {arguments.gyro}" if arguments.gyro else ""
        beside += f" --imu {imu}"
    elif arguments.gyro is not None and not known:
        print("how the gyroscope sits: collabslam init again, with that --camera and without --board")
    if arguments.board is not None:
        print(f"next: collabslam run VIDEO --camera {camera}, or {camera} as cam0.yaml beside your cam0.mp4")
    else:
        print(f"next: collabslam run {arguments.source} --camera {camera} --config {settings}{beside}")
    return OK


def _calibration(arguments: argparse.Namespace) -> tuple[str, bool]:
    """What to write of the camera, and whether it is known and not guessed."""
    from collabslam.datasets.pictures import open_pictures
    from collabslam.runs.busy import busy

    source: Path = arguments.source
    given = options.source_of(arguments).given
    if arguments.board is not None:
        return _from_board(arguments, open_pictures(source, given)), True
    pictures = None if arguments.camera else open_pictures(source, given, only_uncalibrated=True)
    if pictures is None:
        with busy("reading the recording"):
            return _text(options.source_of(arguments).open().camera, f"Camera Cs of {source}"), True
    return _guess(pictures, phone=arguments.phone), False


IMU_NOTE = """\
# Gyroscope of {source}: {told}.
# Of its noise nothing is known here: its data sheet or an Allan variance says it; doubled it is safe.
# gyroscope_noise_density: 0.001   # rad/s/sqrt(Hz)
# gyroscope_random_walk: 0.0001    # rad/s^2/sqrt(Hz)
# gyro_bias_sd: 0.05               # rad/s
"""


def _gyroscope(arguments: argparse.Namespace) -> str | None:
    """What to write of the gyroscope; None where there is none, or only pictures are there."""
    import yaml

    from collabslam.checks.gyroscope import check_gyroscope
    from collabslam.datasets.imu.description import mapping
    from collabslam.runs.busy import busy

    with busy("turns of the images beside the gyroscope's"):
        report = check_gyroscope(options.source_of(arguments).open())
    if report is None:
        return None
    told = "mount and clock are those that fit the images"
    if report.sensor is None:
        why = " ".join(report.findings + report.notes)
        told = "mount and clock are as they were told, the images do not say them"
        print(f"the gyroscope's mount is not found: {why}")
    body: str = yaml.safe_dump(mapping(report.sensor or report.told), sort_keys=False)
    return IMU_NOTE.format(source=arguments.source, told=told) + body


def _from_board(arguments: argparse.Namespace, pictures: Pictures) -> str:
    from collabslam.checks.calibrate_camera import MOST_LOOKED_AT, calibrate_camera
    from collabslam.runs.progress import Progress

    board = arguments.board
    looked_at = min(pictures.count, MOST_LOOKED_AT)
    with Progress(looked_at, "looking for the board", unit="picture") as bar:
        note = f"a {board.columns}x{board.rows} board is in view in"
        fit = calibrate_camera(
            pictures.count, pictures.read, board, lambda seen: bar.update(f"{note} {seen}")
        )
    words = _words(fit)
    print("\n".join(words))
    title = [f"Camera of {arguments.source}, from a board {arguments.board}", *words]
    return _text(fit.camera, *title)


def _words(fit: Calibration) -> list[str]:
    """How good a calibration is."""
    faults = fit.faults()
    return [
        f"{fit.used} views of the board fitted, of {fit.seen} in {fit.looked_at} pictures",
        f"corners are {fit.rms:.2f} px off (RMS), the boards cover {100.0 * fit.covered:.0f} % of the image",
        f"focal length {fit.camera.intrinsics[0]:.1f} px, known to {100.0 * fit.focal_sd:.2f} %; two halves "
        f"of the views differ by {100.0 * fit.halves:.2f} %",
        "this is a good calibration" if not faults else f"it could be better: {'; '.join(faults)}",
    ]


def _guess(pictures: Pictures, *, phone: bool) -> str:
    from collabslam.datasets.exif import equivalent_focal_length

    width, height = pictures.size
    stated = None if pictures.first is None else equivalent_focal_length(pictures.first)
    f, guess = 0.866 * max(width, height), "a lens 60 degrees wide"
    if stated is not None:
        f, guess = stated * (width**2 + height**2) ** 0.5, "from the photograph's EXIF block"
    elif phone:
        f, guess = PHONE * max(width, height), "as phones usually are"
    if phone:
        print(f"focal length {f:.0f} px: {guess}")
        print(PHONE_COST)
    size = {"width": width, "height": height, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return STUB.format(source=pictures.source, f=f, guess=guess, **size)


def _text(camera: Camera, *title: str) -> str:
    import yaml

    from collabslam.datasets.calibration import sensor_mapping

    body: str = yaml.safe_dump(sensor_mapping(camera), sort_keys=False)
    return "".join(f"# {line}\n" for line in title) + body
