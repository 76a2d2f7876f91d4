"""Runs that are killed and go on: whether their results are those of a run that was left alone."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from collabslam.datasets import FirstFrames, write_recording
from collabslam.errors import DataError
from collabslam.runs.folder import CONFIG
from collabslam.runs.results import (
    CHECKPOINT,
    COVARIANCE,
    FRAMES,
    GROUND_TRUTH,
    MAP,
    SUMMARY,
    TRAJECTORY,
)
from collabslam.simulation import corridor_recording

SAME = (CONFIG, TRAJECTORY, COVARIANCE, GROUND_TRUTH, MAP)
"""Files that are the same to the byte; frames.csv and the summary are, but for wall times."""
WALL_TIMES = ("ms_per_frame", "ms_p99", "ms_max", "fps")
_RUN = [sys.executable, "-m", "collabslam", "run"]


def run_kills(count: int, seed: int, *, frames: int = 40, every: int = 3) -> int:
    """Kill runs of the demo's first frames at random moments, and let each go on until it is done.

    A moment is a number of frames that the process has reported, and some milliseconds more; or, in one of
    five cases, some time after its birth, so that starting up, opening a checkpoint and mending the result
    files are hit too.  After each kill the files that grow are read: every line is whole.

    Parameters
    ----------
    count : int
        Least number of kills.
    seed : int
        Of the moments.
    frames : int
        Of the recording.
    every : int
        Frames from one checkpoint to the next.

    Returns
    -------
    int
        Number of kills, all survived.

    Raises
    ------
    DataError
        If a result differs, a line is half, or a run does not go on.
    """
    random = np.random.Generator(np.random.PCG64(seed))
    with tempfile.TemporaryDirectory(prefix="collabslam-kills-") as folder:
        place = Path(folder)
        recording = write_recording(FirstFrames(corridor_recording(seed=0), frames), place / "recording")
        whole = place / "whole"
        _finish(_start(recording, whole, every))
        kills = 0
        while kills < count:
            out = place / "killed"
            for attempt in _attempts(recording, out, every):
                if kills >= count:
                    _finish(attempt)
                    break
                if not _kill(attempt, out / FRAMES, random):
                    break
                kills += 1
                check_lines(out)
            differences = compare_results(whole, out)
            if differences:
                raise DataError(f"After {kills} kills the results differ: {'; '.join(differences)}.")
            for path in out.iterdir():
                path.unlink()
    return kills


def compare_results(whole: Path, other: Path) -> list[str]:
    """In what two result folders differ, wall times left aside; empty if in nothing."""
    differences = [
        f"{name} is another" for name in SAME if (whole / name).read_bytes() != (other / name).read_bytes()
    ]
    if _untimed_rows(whole) != _untimed_rows(other):
        differences.append(f"{FRAMES} is another")
    a, b = (json.loads((f / SUMMARY).read_text(encoding="utf-8")) for f in (whole, other))
    differences += [
        f"{key} of {SUMMARY} is {b.get(key)} in place of {a.get(key)}"
        for key in sorted({*a, *b})
        if key not in WALL_TIMES and a.get(key) != b.get(key)
    ]
    if (whole / CHECKPOINT).exists() or (other / CHECKPOINT).exists():
        differences.append(f"there is a {CHECKPOINT} left")
    return differences


def check_lines(out: Path) -> None:
    """Raises DataError if a line of a file that grows is not whole."""
    for name, columns in ((FRAMES, None), (TRAJECTORY, 8), (COVARIANCE, 22)):
        path = out / name
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        lines = [line for line in text.splitlines() if not line.startswith("#")]
        parted = [line.split("," if columns is None else " ") for line in lines]
        wanted = columns or (len(parted[0]) if parted else 0)
        if (text and not text.endswith("\n")) or any(len(fields) != wanted for fields in parted):
            raise DataError(f"The file {path} has half a line after a kill.")


def _attempts(recording: Path, out: Path, every: int) -> Iterator[subprocess.Popen[bytes]]:
    """The run, then the same run going on, for as long as it is asked for."""
    while True:
        if (out / CHECKPOINT).is_file() or (out / SUMMARY).is_file():
            yield _process("--resume", str(out))
        else:  # killed before the first checkpoint: nothing is lost but the start
            yield _start(recording, out, every)


def _start(recording: Path, out: Path, every: int) -> subprocess.Popen[bytes]:
    return _process(str(recording), "--out", str(out), "--overwrite", "--checkpoint-every", str(every))


def _process(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([*_RUN, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def _finish(process: subprocess.Popen[bytes]) -> None:
    _, said = process.communicate()
    if process.returncode not in (0, 1):
        raise DataError(f"A run did not go on: {said.decode(errors='replace')[-2000:]}")


def _kill(process: subprocess.Popen[bytes], frames: Path, random: np.random.Generator) -> bool:
    """Kill the process at a random moment; False if it was done before."""
    at_birth = random.random() < 0.2
    pause = float(random.uniform(0.0, 1.5 if at_birth else 0.1))
    goal = 0 if at_birth else int(random.integers(1, 12))
    last, seen = _count(frames), 0
    while not at_birth and seen < goal and process.poll() is None:
        time.sleep(0.005)
        now = _count(frames)
        seen, last = seen + max(0, now - last), now
    time.sleep(pause)
    if process.poll() is None:
        process.send_signal(signal.SIGKILL)
    _, said = process.communicate()
    if process.returncode not in (0, 1, -signal.SIGKILL):
        raise DataError(f"A run did not go on: {said.decode(errors='replace')[-2000:]}")
    return process.returncode == -signal.SIGKILL


def _count(path: Path) -> int:
    """Number of lines of a file that may not be there."""
    try:
        return path.read_bytes().count(b"\n")
    except OSError:
        return 0


def _untimed_rows(out: Path) -> list[dict[str, str]]:
    with (out / FRAMES).open(newline="", encoding="utf-8") as lines:
        return [{k: v for k, v in row.items() if not k.startswith("ms_")} for row in csv.DictReader(lines)]
