"""The node: parameters in, `collabslam.cli.ros_parameters.run` does the rest."""

from __future__ import annotations

import sys

from collabslam.cli.ros_parameters import run


def main() -> None:
    """Run until Ctrl-C."""
    sys.exit(run(sys.argv))


if __name__ == "__main__":
    main()
