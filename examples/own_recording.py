"""Writes images, stamps and measured poses of a worn camera as a recording, then runs it.

The arrays come from the demo here; in life they are yours.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

import collabslam
from collabslam.demo import corridor_recording

SENSOR = """\
camera_model: pinhole
intrinsics: [{0[0]}, {0[1]}, {0[2]}, {0[3]}]
distortion_model: radtan
distortion_coefficients: [{1[0]}, {1[1]}, {1[2]}, {1[3]}]
resolution: [{2}, {3}]
"""


def write_camera(folder: Path, camera: collabslam.Camera, images: dict[int, np.ndarray]) -> None:
    (folder / "data").mkdir(parents=True)
    text = SENSOR.format(camera.intrinsics, camera.distortion, camera.width, camera.height)
    (folder / "sensor.yaml").write_text(text)
    for stamp, image in images.items():
        cv2.imwrite(str(folder / "data" / f"{stamp}.png"), image)


def relative_pose(stamp: int, view: collabslam.WornView) -> str:
    """Stamp (ns), position, quaternion w x y z of T_CF, and the lower triangle of its covariance."""
    w = np.sqrt(max(0.0, 1.0 + np.trace(view.t_cf[:3, :3]))) / 2.0  # T_CF is far from half a turn here
    r = view.t_cf[:3, :3]
    xyz = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4.0 * w)
    numbers = [*view.t_cf[:3, 3], w, *xyz, *view.covariance[np.tril_indices(6)]]
    return ",".join([str(stamp), *(repr(float(x)) for x in numbers)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=12)
    source = corridor_recording()
    frames = [source.frame(i) for i in range(parser.parse_args().frames)]
    stamps = [round(1e9 * f.t) for f in frames]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "walk"
        write_camera(
            folder / "cam0", source.camera, {s: f.image for s, f in zip(stamps, frames, strict=True)}
        )
        seen = {s: f.worn for s, f in zip(stamps, frames, strict=True) if f.worn is not None}
        write_camera(folder / "cam1", source.worn_camera, {s: view.image for s, view in seen.items()})
        (folder / "relpose").mkdir()
        lines = [relative_pose(s, view) for s, view in seen.items()]
        (folder / "relpose" / "data.csv").write_text("\n".join(lines) + "\n")
        result = collabslam.run(folder)
    print(f"{result.summary['frames_ok']} of {result.summary['frames']} frames OK")


if __name__ == "__main__":
    main()
