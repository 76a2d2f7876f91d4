"""``python -m collabslam``."""

from __future__ import annotations

import sys

from collabslam.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
