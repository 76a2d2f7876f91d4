"""Writes images, stamps and measured poses of a worn camera as a recording, then runs it.

The arrays come from the demo here; in life they are yours.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import collabslam
from collabslam.simulation import corridor_recording


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=12)
    source = corridor_recording()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "walk"
        with collabslam.RecordingWriter(folder, source.camera, source.worn_camera) as writer:
            for i in range(parser.parse_args().frames):
                frame = source.frame(i)
                writer.add(frame.t, frame.image, frame.views, truth=source.truth[i])
        result = collabslam.run(folder)
    print(f"{result.summary['frames_ok']} of {result.summary['frames']} frames OK")


if __name__ == "__main__":
    main()
