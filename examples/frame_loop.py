"""A loop of one's own: images, and now and then a worn camera's view, go in; poses with covariance out."""

from __future__ import annotations

import argparse

import numpy as np

from collabslam import Slam, Status, WornView
from collabslam.simulation import corridor_recording


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=15)
    recording = corridor_recording()
    slam = Slam(recording.camera, recording.worn_camera)
    for i in range(parser.parse_args().frames):
        frame = recording.frame(i)  # in life: the robot's camera
        # in life: the worn camera's image, its measured pose T_CF and that one's covariance
        views = [WornView(view.image, view.t_cf, view.covariance) for view in frame.views]
        result = slam.step(frame.t, frame.image, views)
        if result.valid and result.status is Status.OK:
            sigma = np.sqrt(result.covariance.diagonal()[:3])
            print(f"{result.t:5.2f} s  position {result.pose[:3, 3].round(3)} m  sigma {sigma.round(4)} m")
    print(f"{len(slam.landmarks().ids)} landmarks")


if __name__ == "__main__":
    main()
