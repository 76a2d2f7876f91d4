"""This system on the same images, measured as the others are."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from collabslam.batch.processes import use_one_thread
from collabslam.datasets import attach_worn
from collabslam.results import Landmarks, StepResult
from collabslam.runs.plan import Plan
from collabslam.runs.runner import SlamLike, make_engine, run
from collabslam.settings.table import Settings
from collabslam.simulation.held import HeldRecording
from collabslam.types import Image, Recording, WornView
from collabslam_lab.benchmark.replay import open_entry
from collabslam_lab.benchmark.store import Item
from collabslam_lab.peers.prepared import SystemResult
from collabslam_lab.peers.undistorted import Undistorted

ALONE, TOGETHER = "collabslam, one camera", "collabslam, with Cf"


@dataclass
class _Timed:
    """An engine, and the processor's time that its frames took."""

    engine: SlamLike
    cpu: list[float] = field(default_factory=list)

    def step(self, t: float, image: Image, views: Sequence[WornView] = ()) -> StepResult:
        began = time.process_time()
        step = self.engine.step(t, image, views)
        self.cpu.append(time.process_time() - began)
        return step

    def landmarks(self) -> Landmarks:
        return self.engine.landmarks()


def opened(item: Item) -> Recording:
    """An item's recording without distortion; raises as `open_entry` does."""
    return Undistorted(open_entry(item))


def run_ours(item: Item) -> dict[str, SystemResult]:
    """What one camera alone finds, scale-free, and what it finds with Cf; in a process with one thread."""
    use_one_thread()
    recording = HeldRecording(opened(item))
    return {
        ALONE: measured(attach_worn(recording, "none"), "mono", "scale-free", item.settings),
        TOGETHER: measured(recording, item.mode, item.entry.start, item.settings),
    }


def measured(recording: Recording, mode: str, start: str, settings: Settings) -> SystemResult:
    """Positions and times of one run."""
    plan = Plan(
        mode, start, start != "scale-free", settings.replace({"filter.estimator.mode": mode}), {}, None
    )
    engine = _Timed(make_engine(recording, plan))
    slam: Any = engine
    record = run(recording, mode=mode, start=start, settings=settings, slam=slam).record
    valid = {k for k in range(len(record)) if record.valid_at(k)}
    live = {k: record.poses[k, :3, 3].tolist() for k in sorted(valid)}
    turns = {k: record.poses[k, :3, :3] for k in sorted(valid)}
    covariances = {k: record.covariances[k] for k in sorted(valid)}
    return SystemResult(live, {}, sum(engine.cpu), list(record.seconds), turns, covariances)
