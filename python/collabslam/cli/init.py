"""``collabslam init``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import OK, options

if TYPE_CHECKING:
    from collabslam._core import Camera

STUB = """\
# Camera of {source}: its images are {width}x{height} pixels.
# The four intrinsics below are a GUESS (a lens 60 degrees wide): replace them by those of a calibration, or
# the result has neither the right shape nor the right scale.  Kalibr, OpenCV and ROS files are read, too.
camera_model: pinhole
intrinsics: [{f:.1f}, {f:.1f}, {cx:.1f}, {cy:.1f}] # fx fy cx cy, pixels
distortion_model: radtan # none, radtan (k1 k2 p1 p2 and maybe k3) or equidistant (k1 k2 k3 k4)
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
resolution: [{width}, {height}]
rate: 30 # frames per second, for images that carry no time stamps
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path(), help="folder (default: this one)")


def main(arguments: argparse.Namespace) -> int:
    """Write settings.yaml and camera.yaml, say how to go on."""
    from collabslam.errors import DataError
    from collabslam.formats.files import write_text
    from collabslam.settings.table import Settings

    settings, camera = arguments.out / "settings.yaml", arguments.out / "camera.yaml"
    for path in (settings, camera):
        if path.exists():
            raise DataError(f"The file {path} exists already; give another folder with --out.")
    text, complete = _calibration(arguments)
    write_text(settings, Settings.default().dump(title="defaults, to be changed"))
    write_text(camera, text)
    print(f"settings are in {settings}")
    guess = "" if complete else "; its intrinsics are a guess, replace them"
    print(f"the calibration is in {camera}{guess}")
    print(f"next: collabslam run {arguments.source} --camera {camera} --config {settings}")
    return OK


def _calibration(arguments: argparse.Namespace) -> tuple[str, bool]:
    """The recording's own calibration, or a stub for its images; and whether it is complete."""
    from collabslam.datasets.images import image_size, list_images
    from collabslam.datasets.readers.folder import images_of
    from collabslam.datasets.readers.video import matches as is_video

    source: Path = arguments.source
    if arguments.camera is None and source.is_dir():
        folder = images_of(source)
        if folder is not None and not _is_known(source):
            return _stub(source, *image_size(list_images(folder)[0])), False
    if arguments.camera is None and is_video(source):
        from collabslam.datasets.readers.video import frame_size

        return _stub(source, *frame_size(source)), False
    recording = options.source_of(arguments).open()
    return _text(recording.camera, source), True


def _is_known(source: Path) -> bool:
    from collabslam.datasets.opening import recognise
    from collabslam.datasets.overrides import Given
    from collabslam.errors import DataError

    try:
        recognise(source.resolve(), Given())
    except DataError:
        return False
    return True


def _stub(source: Path, width: int, height: int) -> str:
    size = {"width": width, "height": height, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return STUB.format(source=source, f=0.866 * width, **size)


def _text(camera: Camera, source: Path) -> str:
    import yaml

    from collabslam.datasets.calibration import sensor_mapping

    body: str = yaml.safe_dump(sensor_mapping(camera), sort_keys=False)
    return f"# Camera Cs of {source}\n{body}"
