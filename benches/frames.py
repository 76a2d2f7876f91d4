"""Milliseconds a frame takes, stage by stage, on one core: the rendered demo, ``mono`` and ``collab-tight``.

The slowest frames stand below the means.  ORB-SLAM3 gets the same images of Cs in the same run, at the pace
of the recording, if ``collabslam-lab peers`` has made its environment; its threads share the core.

Run by ``make bench-frames``, or ``python benches/frames.py``; prints one table and writes
``results/frames.json``. One thread everywhere (OpenCV, BLAS), one core where the system can pin one. The demo
is rendered first and is not timed. Every run gives the same bits, so each frame's stage is timed in several
runs and the least counts: what other programs took is not the frame's. Columns are means over frames, those
with overlap and the others apart, and mixed as if the worn camera helped 40 % of the time.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported

import cv2
import numpy as np

from collabslam.errors import CollabslamError
from collabslam.evaluation.headline import frame_times
from collabslam.runs.report import STAGES, text_table
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import corridor_recording
from collabslam.slam.engine import Slam
from collabslam.types import Recording
from collabslam_lab.peers.compare import some_images
from collabslam_lab.peers.environments import default_folder, interpreter
from collabslam_lab.peers.prepared import run_script, write_job
from collabslam_lab.peers.systems import PEERS
from collabslam_lab.peers.vocabulary import train, write_vocabulary

TOTAL = "frame"
ALONE, WITH = "mono", "collab-tight"
SHARE = 0.4  # of the frames with overlap, in the last column


def one_core() -> str:
    """One thread, and one core where the system can pin one; says which."""
    cv2.setNumThreads(1)
    if not hasattr(os, "sched_setaffinity"):
        return "one thread"
    core = max(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return f"one thread on core {core}"


def timed_run(recording: Recording, mode: str) -> tuple[np.ndarray, np.ndarray]:
    """Milliseconds (frames, stages and the whole), and which frames had overlap."""
    engine = Slam(recording.camera, recording.worn_camera, mode=mode)
    rows, overlap = [], []
    for i in range(len(recording)):
        frame = recording.frame(i)
        began = time.perf_counter()
        step: Any = engine.step(frame.t, frame.image, frame.views)
        total = 1e3 * (time.perf_counter() - began)
        stages = [step.diagnostics[f"ms_{stage}"] for stage in STAGES[:-1]]
        rows.append([*stages, total - sum(stages), total])
        overlap.append(bool(step.diagnostics["overlap"]))
    return np.array(rows), np.array(overlap)


def measure(recording: Recording, mode: str, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Least milliseconds of each frame's stages over several runs; whether it had overlap."""
    results = [timed_run(recording, mode) for _ in range(runs)]
    return np.min([times for times, _ in results], axis=0), results[0][1]


def tail(totals: np.ndarray) -> tuple[float, float]:
    """What 99 of 100 frames need at most, and the slowest of them."""
    slow = frame_times((1e-3 * totals).tolist())
    return float(slow["ms_p99"] or 0.0), float(slow["ms_max"] or 0.0)


def orbslam3(recording: Recording, envs: Path, seconds: float = 300.0) -> dict[str, float] | str:
    """Milliseconds a frame of ORB-SLAM3 with one camera, or why there are none."""
    peer = next(peer for peer in PEERS if peer.name == "orbslam3-mono")
    python = interpreter(peer, envs)
    if python is None:
        return f"it has no environment in {envs}; collabslam-lab peers makes it"
    with tempfile.TemporaryDirectory() as work:
        try:
            words = Path(work) / "vocabulary.txt"
            write_vocabulary(train(some_images(recording)), words)
            write_job(recording, Path(work) / "job", vocabulary=words)
            found = run_script(peer, python, Path(work) / "job", seconds)
        except CollabslamError as error:
            return str(error)
    p99, worst = tail(1e3 * np.array(found.wall))
    return {
        "cpu": 1e3 * found.cpu / len(recording),
        "mean": 1e3 * float(np.mean(found.wall)),
        "p99": p99,
        "worst": worst,
        "tracked": len(found.live) / len(recording),
    }


def main() -> None:
    """Renders, measures, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the demo's noise")
    parser.add_argument("--runs", type=int, default=5, help="of each mode; a frame's least time counts")
    parser.add_argument("--out", type=Path, default=Path("results/frames.json"))
    parser.add_argument("--envs", type=Path, default=default_folder(), help="of collabslam-lab peers")
    arguments = parser.parse_args()
    recording = HeldRecording(corridor_recording(arguments.seed))
    where = one_core()
    times = {mode: measure(recording, mode, arguments.runs) for mode in (ALONE, WITH)}
    mono, _ = times[ALONE]
    collab, overlap = times[WITH]
    with_cf, without = collab[overlap].mean(axis=0), collab[~overlap].mean(axis=0)
    columns = {
        ALONE: mono.mean(axis=0),
        f"{WITH}, overlap": with_cf,
        f"{WITH}, others": without,
        f"{WITH}, {SHARE:.0%} overlap": SHARE * with_cf + (1.0 - SHARE) * without,
    }
    names = [*STAGES, TOTAL]
    groups = dict(zip(columns, (mono, collab[overlap], collab[~overlap], collab), strict=True))
    tails = {column: tail(times[:, -1]) for column, times in groups.items()}
    rows = [["ms a frame", *columns]]
    rows += [[name, *(f"{column[k]:.2f}" for column in columns.values())] for k, name in enumerate(names)]
    for k, name in enumerate(("p99", "worst")):
        rows.append([name, *(f"{slow[k]:.2f}" for slow in tails.values())])
    other = orbslam3(recording, arguments.envs)
    camera = recording.camera
    print(f"demo, seed {arguments.seed}, {camera.width} x {camera.height}, {len(recording)} frames of which")
    print(f"{int(overlap.sum())} have overlap; {where}; least of {arguments.runs} runs, mean over frames")
    print(text_table(rows))
    if isinstance(other, str):
        print(f"ORB-SLAM3, one camera: {other}")
    else:
        print(
            f"ORB-SLAM3, one camera: {other['cpu']:.2f} ms a frame in all threads; from a frame to its pose "
            f"{other['mean']:.2f}, p99 {other['p99']:.2f}, worst {other['worst']:.2f}; "
            f"{other['tracked']:.0%} of the frames tracked"
        )
    result: dict[str, Any] = {
        column: {**dict(zip(names, values.tolist(), strict=True)), "p99": tails[column][0],
                 "worst": tails[column][1]}
        for column, values in columns.items()
    }  # fmt: skip
    result["ORB-SLAM3"] = other
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"seed": arguments.seed, "runs": arguments.runs, **result}, indent=2))


if __name__ == "__main__":
    main()
