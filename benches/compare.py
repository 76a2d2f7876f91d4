"""The filter core beside OpenBLAS, in turns on one thread; prints one table and writes results/bench.json.

Run by ``make bench``. A machine that other jobs share is only fair to what runs in turns, so every round
times each kernel of the core (by ``rounds``, the Rust program beside this file) and each yardstick (through
scipy) a few times, and the medians over all rounds are compared; p99 and the worst sample stand beside them.
Ratios in the JSON file are medians over medians (those named p99 and worst: over the yardstick's median), but
for two replays whose frames are the same in every run, so that the least time of each counts:
``local_n400_ratio``, an amortised cost, is a sum over a sum, ``python_overhead_pct`` the median over frames.
The update that HOHCT is set beside is that of the same matches in the same map: N = 100, 80 rows for 40 of
them, 200 rows for 100.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported

import numpy as np
import scipy
from scipy.linalg import blas, lapack
from threadpoolctl import threadpool_info

Samples = dict[str, list[float]]


class Rounds:
    """The Rust program: runs a case so many times, answers nanoseconds and counts."""

    def __init__(self, *command: str | Path) -> None:
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, line: str) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline().strip()
        if not answer:
            raise SystemExit(f"{line!r} failed")
        return answer

    def run(self, case: str, times: int) -> list[list[int]]:
        """One list per run: nanoseconds first."""
        return [[int(x) for x in run.split(",")] for run in self.ask(f"{case} {times}").split("|")]

    def __enter__(self) -> Rounds:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()


class Yardstick:
    """dsyrk (n x m), dtrsm (m x m on n right-hand sides) and dpotrf (m x m) of OpenBLAS."""

    def __init__(self, features: int, m: int) -> None:
        n = 13 + 6 * features
        rng = np.random.default_rng(0)
        self._v = np.asfortranarray(rng.standard_normal((n, m)))
        self._p = np.asfortranarray(np.eye(n))
        self._s = np.asfortranarray(np.eye(m) * m + 0.1 * self._v[:m].T @ self._v[:m])
        self._l, _ = lapack.dpotrf(self._s, lower=1)
        self._w = self._v.copy(order="F")

    def run(self) -> tuple[float, float, float]:
        """Milliseconds of each."""
        start = time.perf_counter()
        blas.dsyrk(-1e-9, self._v, beta=1.0, c=self._p, lower=1, overwrite_c=1)
        syrk = time.perf_counter()
        blas.dtrsm(1.0, self._l, self._w, side=1, lower=1, trans_a=1, overwrite_b=1)
        trsm = time.perf_counter()
        lapack.dpotrf(self._s, lower=1)
        potrf = time.perf_counter()
        self._w[:] = self._v
        return (syrk - start) * 1e3, (trsm - syrk) * 1e3, (potrf - trsm) * 1e3


def blas_in_use() -> str:
    """Version and kernel of the OpenBLAS that scipy calls."""
    found = [library for library in threadpool_info() if library["internal_api"] == "openblas"]
    found.sort(key=lambda library: "scipy.libs" in library["filepath"])
    blas = found[-1]
    name = f"OpenBLAS {blas['version']}, kernel {blas['architecture']}, {blas['num_threads']} thread"
    return f"{name} (scipy {scipy.__version__})"


SIZES = [(25, 20), (50, 40), (100, 20), (100, 40), (100, 80), (200, 40), (400, 40)]
TESTS = [(n, wrong) for n in (40, 100) for wrong in (0, 1, 3, 10)]
HARDEST = (100, 10)


def measure(rounds: Rounds, number: int) -> tuple[Samples, dict[str, Any]]:
    """Samples in milliseconds by name, and counts."""
    samples: Samples = {}
    counts: dict[str, Any] = {"hohct_struck": 0, "nodes": {}}

    def add(name: str, *values: float) -> None:
        samples.setdefault(name, []).extend(values)

    yardsticks = {(n, 2 * k): Yardstick(n, 2 * k) for n, k in [*SIZES, (100, 100)]}
    for index in range(number):
        for n, k in [*SIZES, (100, 100)]:
            runs = 8 if (n, k) == (100, 40) else 2
            update = rounds.run(f"update {n} {k}", runs)
            add(f"update n={n} m={2 * k}", *(ns / 1e6 for (ns,) in update))
            for _ in range(runs):
                parts = yardsticks[n, 2 * k].run()
                for name, ms in zip(("dsyrk", "dtrsm", "dpotrf"), parts, strict=True):
                    add(f"{name} n={n} m={2 * k}", ms)
                add(f"yardsticks n={n} m={2 * k}", sum(parts))
            if (n, k) == (100, 40):
                single = rounds.run(f"update-single {n} {k}", runs)
                add("update n=100 m=80, an anchor each", *(ns / 1e6 for (ns,) in single))
                add("step n=100 m=80", *(run[0] / 1e6 for run in rounds.run("step 100 40 3", runs)))
        for n, wrong in TESTS:
            runs_ = rounds.run(f"hohct {n} {wrong}", 4)
            add(f"hohct {wrong} of {n}", *(run[0] / 1e6 for run in runs_))
            counts["hohct_struck"] += sum(1 - run[2] for run in runs_)
            key = f"{wrong} of {n}"
            counts["nodes"][key] = max(counts["nodes"].get(key, 0), *(run[1] for run in runs_))
        if index % 5 == 0:
            add("dense n=100 m=80", rounds.run("dense 100 80", 1)[0][0] / 1e6)
    return samples, counts


def search(rounds: Rounds, frames: int, counts: dict[str, Any]) -> dict[str, float]:
    """HOHCT on so many more frames of its hardest case: one in thousands needs far more than the median."""
    n, wrong = HARDEST
    runs = rounds.run(f"hohct {n} {wrong}", frames)
    counts["hohct_struck"] += sum(1 - run[2] for run in runs)
    key = f"{wrong} of {n}"
    counts["nodes"][key] = max(counts["nodes"][key], *(run[1] for run in runs))
    return {"hohct_worst_ms": max(run[0] for run in runs) / 1e6, "hohct_frames": float(frames)}


FRAMES, TIMES = 300, 2
"""Frames of the replay, and how often a process runs it."""


def overhead(program: Path, processes: int, samples: Samples) -> dict[str, float]:
    """A step through Python over the same one in Rust: the median over the frames of a replay.

    Every run of the replay gives the same bits. The least time of each frame counts, over so many processes
    of each kind by turns: what other programs took, and where memory happens to lie, is not the frame's.
    """
    times: dict[str, list[list[float]]] = {"replay rust": [], "replay python": []}
    with Rounds(program) as rounds:
        frames = rounds.ask(f"record 100 {FRAMES}")
    for _ in range(processes):
        with Rounds(program) as rounds:
            runs = rounds.run(f"replay 100 {FRAMES}", TIMES * FRAMES)
        times["replay rust"].append([ns / 1e6 for (ns,) in runs])
        with Rounds(sys.executable, Path(__file__).with_name("replay.py"), str(TIMES)) as python:
            times["replay python"].append([int(ns) / 1e6 for ns in python.ask(frames).split("|")])
    least = {name: np.reshape(ms, (-1, FRAMES)).min(axis=0) for name, ms in times.items()}
    samples.update({name: ms.tolist() for name, ms in least.items()})
    return {"python_overhead_pct": 100 * float(np.median(least["replay python"] / least["replay rust"]) - 1)}


def walk(program: Path, frames: int, processes: int) -> dict[str, float]:
    """Plain and local filter over a replay of N = 400: sums, medians, features in view.

    As in `overhead`, the least time of each frame counts.
    """
    runs = []
    for _ in range(processes):
        with Rounds(program) as rounds:
            runs.append(rounds.run("local 400", frames))
    plain, local, seen = np.min(np.array(runs, float), axis=0).T
    return {
        "local_n400_ratio": float(local.sum() / plain.sum()),
        "local_n400_ms": float(local.mean()) / 1e6,
        "plain_n400_ms": float(plain.mean()) / 1e6,
        "local_n400_median_ms": float(np.median(local)) / 1e6,
        "plain_n400_median_ms": float(np.median(plain)) / 1e6,
        "local_n400_in_view": float(seen.mean()),
        "local_n400_frames": float(frames),
    }


def crowd(program: Path, frames: int) -> dict[str, float]:
    """A walk through 1000 landmarks: milliseconds of a whole frame, prediction to upkeep."""
    with Rounds(program) as rounds:
        times = np.array(rounds.run("walk 1000", frames), float)[:, 0] / 1e6
    return {
        "walk_n1000_median_ms": float(np.median(times)),
        "walk_n1000_p99_ms": float(np.percentile(times, 99.0)),
        "walk_n1000_worst_ms": float(times.max()),
        "walk_n1000_frames": float(frames),
    }


def allocations(said: Path | None) -> int | None:
    """Heap allocations of warm steps."""
    found = re.search(r"warm_step_allocations (\d+)", said.read_text()) if said else None
    return int(found[1]) if found else None


def criterion(folder: Path) -> dict[str, float]:
    """Medians in milliseconds that criterion has left there."""
    out = {}
    for file in sorted(folder.glob("**/new/estimates.json")):
        name = json.loads(file.with_name("benchmark.json").read_text())["full_id"]
        out[name] = json.loads(file.read_text())["median"]["point_estimate"] / 1e6
    return out


def main() -> None:
    """See the module's page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=Path, help="the program `rounds`")
    parser.add_argument("--criterion", type=Path, help="criterion's folder, whose medians join the table")
    parser.add_argument("--allocations", type=Path, help="what the test that counts them has said")
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=12, help="that replay, of each kind")
    parser.add_argument("--walk", type=int, default=600, help="frames of the walk through 400 features")
    parser.add_argument("--walks", type=int, default=3, help="processes that go it")
    parser.add_argument("--crowd", type=int, default=500, help="frames of the walk through 1000 landmarks")
    parser.add_argument("--hardest", type=int, default=2400, help="frames of HOHCT's hardest case")
    parser.add_argument("--out", type=Path, default=Path("results/bench.json"))
    args = parser.parse_args()
    rounds = Rounds(args.program)
    samples, counts = measure(rounds, args.rounds)
    worst = search(rounds, args.hardest, counts) if args.hardest else {}
    through_python = overhead(args.program, args.processes, samples)
    median = {name: statistics.median(values) for name, values in samples.items()}
    unit, step = median["yardsticks n=100 m=80"], median["step n=100 m=80"]
    result: dict[str, Any] = {
        "update_n100_m80_ratio": median["update n=100 m=80"] / unit,
        "update_single_anchor_ratio": median["update n=100 m=80, an anchor each"] / unit,
        "step_n100_m80_ratio": step / unit,
        "hohct_3of40_ratio": median["hohct 3 of 40"] / median["update n=100 m=80"],
        "hohct_10of100_ratio": median["hohct 10 of 100"] / median["update n=100 m=200"],
        "hohct_struck": counts["hohct_struck"],
        "hohct_most_nodes": counts["nodes"],
        **worst,
        "warm_step_allocations": allocations(args.allocations),
        **through_python,
    }
    if args.walk:
        result |= walk(args.program, args.walk, args.walks)
    if args.crowd:
        result |= crowd(args.program, args.crowd)
    result["blas"] = blas_in_use()
    result["medians_ms"] = median
    result |= tails(samples)
    result["step_n100_m80_p99_ratio"] = result["p99_ms"]["step n=100 m=80"] / unit
    result["step_n100_m80_worst_ratio"] = result["worst_ms"]["step n=100 m=80"] / unit
    if args.criterion:
        result["criterion_medians_ms"] = criterion(args.criterion)
    print_table(result)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(result, indent=2) + "\n")


def tails(samples: Samples) -> dict[str, dict[str, float]]:
    """What 99 of 100 samples need at most, and the slowest one, milliseconds."""
    ordered = {name: sorted(values) for name, values in samples.items()}
    return {
        "p99_ms": {name: values[-(-99 * len(values) // 100) - 1] for name, values in ordered.items()},
        "worst_ms": {name: values[-1] for name, values in ordered.items()},
    }


def print_table(result: dict[str, Any]) -> None:
    """All figures, one a line."""
    write = sys.stdout.write
    write(f"{result['blas']}\n\n{'criterion, median':48} {'ms':>10}\n")
    for name, ms in result.get("criterion_medians_ms", {}).items():
        write(f"{name:48} {ms:10.4f}\n")
    write(f"\n{'in turns, ms':48} {'median':>10} {'p99':>10} {'worst':>10}\n")
    for name, ms in result["medians_ms"].items():
        write(f"{name:48} {ms:10.4f} {result['p99_ms'][name]:10.4f} {result['worst_ms'][name]:10.4f}\n")
    write("\n")
    for name, value in result.items():
        if isinstance(value, (int, float)):
            write(f"{name:48} {value:10.4g}\n")


if __name__ == "__main__":
    main()
