"""Runs a command twice at the same time: one must be refused, the other's results must be whole.

python -m collabslam_lab.reliability.attacks.twice OUT COMMAND...
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from collabslam.cli import BAD_INPUT, OK


def main(words: list[str]) -> int:
    """Exit status 0 if all is as it should be; what is not is said."""
    out, *command = words
    both = [subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) for _ in range(2)]
    said = [process.communicate()[1].decode(errors="replace") for process in both]
    statuses = sorted(process.returncode for process in both)
    if statuses != [OK, BAD_INPUT]:
        print(*said, f"error: two runs into one folder ended with {statuses}.", sep="\n", file=sys.stderr)
        return BAD_INPUT
    rows = (Path(out) / "frames.csv").read_text(encoding="utf-8").splitlines()
    summary = json.loads((Path(out) / "summary.json").read_text(encoding="utf-8"))
    if len(rows) != 1 + summary["frames"]:
        print(f"error: {len(rows) - 1} rows of {summary['frames']} frames.", file=sys.stderr)
        return BAD_INPUT
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
