"""Depth from a range finder in place of a worn camera: a line of beams across the image of Cs.

The rendered corridor has no range finder, so its beams are read from the scene itself, with 2 % of noise.
"""

from __future__ import annotations

import argparse

import numpy as np

from collabslam import Slam
from collabslam.simulation import corridor_recording

BEAMS = 60
NOISE = 0.02


def beams(recording, frame: int, generator: np.random.Generator):
    """Pixels that the beams hit, and their depths along the optical axis with standard deviations, metres."""
    camera = recording.camera
    rows = np.linspace(0.35, 0.65, 5) * camera.height
    u, v = np.meshgrid(np.linspace(5, camera.width - 6, BEAMS), rows)
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    image = recording.renderer.depth(recording.truth[frame], camera)
    depth = image[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    hit = np.isfinite(depth) & (depth > 0.0)
    sigma = NOISE * depth[hit]
    return uv[hit], depth[hit] + sigma * generator.standard_normal(hit.sum()), sigma


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=15)
    frames = parser.parse_args().frames
    recording, generator = corridor_recording(), np.random.default_rng(0)
    slam = Slam(recording.camera, mode="mono", start="depth")
    for i in range(frames):
        slam.add_depth(*beams(recording, i, generator))
        result = slam.step(recording.times[i], recording.image(i))
    moved = np.linalg.inv(recording.truth[0]) @ recording.truth[frames - 1]
    error = np.linalg.norm(result.pose[:3, 3] - moved[:3, 3])
    print(f"{result.status.value} after {frames} frames and {np.linalg.norm(moved[:3, 3]):.2f} m")
    print(
        f"position error {error:.3f} m, standard deviation {np.sqrt(result.covariance[:3, :3].trace()):.3f} m"
    )


if __name__ == "__main__":
    main()
