"""Writes the parameters of the ROS 2 package; with --check says whether they are what the settings tell."""

from __future__ import annotations

import sys
from pathlib import Path

from collabslam.cli.ros_parameters import parameters_text

PLACE = Path(__file__).parents[1] / "ros" / "collabslam_ros" / "config" / "collabslam.yaml"


def main() -> int:
    """Exit status."""
    text = parameters_text()
    if "--check" in sys.argv:
        same = PLACE.read_text(encoding="utf-8") == text
        if not same:
            print(f"{PLACE} is not what packaging/ros_parameters.py writes; run it.", file=sys.stderr)
        return int(not same)
    PLACE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
