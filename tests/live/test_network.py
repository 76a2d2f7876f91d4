"""Robot and worn camera over networks of every quality: two processes, mutual TLS, and a relay between them.

``make test-live`` runs it and writes ``results/live.json``.  What is asserted is what the program does, by
the records of both ends; how fast it is depends on the machine, and only the figures tell that.  Where the
machine permits no network namespaces, a relay of TCP is the network, and the figures are not written.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import wire as w

pytest.importorskip("zenoh", reason="the extra live is not installed")

from networks import loopback
from scenario import HERE, ScenarioOutcome, Walk, dark, error_without, play, stopped, walk

import collabslam
from collabslam.datasets.wrapped import FirstFrames
from collabslam.live.keys import make_keys
from collabslam.live.pace import LEVELS
from collabslam.live.replay import replay
from collabslam.live.senders import SILENT
from collabslam.simulation import corridor_recording
from collabslam.simulation.recording import SimulatedRecording
from collabslam.simulation.trajectory import CorridorWalk
from collabslam_lab.worlds.recording import world_recording

RESULTS = HERE.parents[1] / "results" / "live.json"
CLEAN = w.Wire()
BURSTS = replace(CLEAN, loss=0.10, burst=3.0)
SEEDS = (0, 1, 2)
"""Of the corridor's noise."""
FRESH = 0.5
"""Seconds: an image's age at the median, however busy the machine; a queue that grows is beyond it."""
SANE = 0.5
"""Metres of 15 by which a pose may be wrong where frames are lost, as on a busy machine; otherwise 0.03."""


@dataclass(frozen=True)
class Place:
    """What all scenarios share.

    Attributes
    ----------
    corridors : tuple of Walk
        The demo's corridor, in which the person now and then looks ahead, with the noise of several seeds.
    ahead : Walk
        The same, but the person looks ahead all the time: whatever is missing is the network's doing.
    """

    folder: Path
    keys: Path
    corridors: tuple[Walk, ...]
    ahead: Walk

    def play(self, name: str, wire: w.Wire, on: Walk | None = None, **options: Any) -> ScenarioOutcome:
        """A walk, `ahead` if none is given, over a network."""
        return play(on or self.ahead, self.keys, self.folder / name, wire, **options)


@pytest.fixture(scope="module")
def figures() -> Iterator[dict[str, Any]]:
    """What goes into results/live.json: figures of this run alone."""
    found: dict[str, Any] = {}
    yield found
    if w.possible():
        return
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(found, indent=2, sort_keys=True) + "\n")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    folder = tmp_path_factory.mktemp("live")
    make_keys(folder / "keys", hosts=[w.ADDRESSES[0], "127.0.0.1"], devices=["anna"])
    corridors = [corridor_recording(seed) for seed in SEEDS]
    first = corridors[0]
    always = CorridorWalk(1.5, glances=((0.0, CorridorWalk.period),))
    ahead = SimulatedRecording(first.renderer, always, first.times, "ahead", 0)
    return Place(
        folder,
        folder / "keys",
        tuple(walk(corridor, folder / str(seed)) for seed, corridor in zip(SEEDS, corridors, strict=True)),
        walk(ahead, folder / "ahead"),
    )


@pytest.fixture(scope="module")
def clean(place: Place) -> ScenarioOutcome:
    return place.play("clean", CLEAN, record=True)


def quantile_ms(seconds: Any, q: float) -> float:
    return 1e3 * float(np.quantile(seconds, q))


def test_what_arrives_went_over_the_wire(clean: ScenarioOutcome) -> None:
    assert clean.bytes_on_wire > clean.bytes_received > 10 * LEVELS[-1].size


def test_clean(place: Place, clean: ScenarioOutcome, figures: dict[str, Any]) -> None:
    figures["uplink_kBps"] = clean.rate / 1e3
    figures["age_p50_ms"] = quantile_ms(clean.ages, 0.5)
    figures["error_ratio_clean"] = clean.error / place.ahead.offline_error
    assert clean.rate < 150e3
    assert np.median(clean.ages) < FRESH
    assert len(clean.given) >= len(clean.came) - 1  # the last comes after the last frame
    assert clean.unused.size == 0
    assert clean.error < SANE


def test_clocks_that_are_apart(clean: ScenarioOutcome, figures: dict[str, Any]) -> None:
    figures["clock_error_ms"] = quantile_ms(np.abs(clean.clock), 0.99)
    assert (np.abs(clean.clock) < clean.clock_bound).all()
    assert np.median(clean.clock_bound) < 0.5  # else it says nothing


def test_robot_frames_are_not_held_up(clean: ScenarioOutcome, figures: dict[str, Any]) -> None:
    figures["frame_p99_ms"] = quantile_ms(clean.lasted, 0.99)
    figures["frame_work_p99_ms"] = quantile_ms(clean.worked, 0.99)
    assert np.median(clean.lasted) < 0.1  # the camera's own pace


def test_a_replay_is_the_same(place: Place, clean: ScenarioOutcome, figures: dict[str, Any]) -> None:
    replay(place.folder / "clean" / "record", place.folder / "again")
    same = [
        (place.folder / "again" / name).read_bytes() == (clean.out / name).read_bytes()
        for name in ("trajectory.tum", "trajectory.cov")
    ]
    figures["replay_identical"] = all(same)
    assert all(same)


def test_two_percent_lost(place: Place, figures: dict[str, Any]) -> None:
    found = place.play("loss2", replace(CLEAN, loss=0.02))
    figures["age_p99_ms_loss2"] = quantile_ms(found.ages, 0.99)
    assert np.median(found.ages) < FRESH
    assert found.unused.size == 0


def test_ten_percent_lost_in_bursts(place: Place, figures: dict[str, Any]) -> None:
    found = place.play("burst10", BURSTS)
    figures["age_p99_ms_burst10"] = quantile_ms(found.ages, 0.99)
    figures["images_burst10"] = len(found.ages)
    assert np.median(found.ages) < FRESH
    assert found.unused.size == 0


def test_the_pose_at_ten_percent_lost(place: Place, figures: dict[str, Any]) -> None:
    found = [place.play(f"burst10-{k}", BURSTS, on) for k, on in enumerate(place.corridors)]
    error = sum(f.error for f in found)
    figures["error_ratio_loss10"] = error / sum(on.offline_error for on in place.corridors)
    assert all(f.error < SANE for f in found)
    assert all(f.unused.size == 0 for f in found)


def test_the_pose_without_views(place: Place, figures: dict[str, Any], tmp_path: Path) -> None:
    """What is lost on the way costs little; over three seeds, whose noise is larger than that."""
    lost = np.random.default_rng(5).random(len(place.corridors[0].times)) < 0.1
    missing = {"dark": lambda i: 35 <= i < 65, "lost": lambda i: i > 2 and lost[i]}
    errors = {
        name: sum(error_without(on, gone, tmp_path / f"{name}-{k}") for k, on in enumerate(place.corridors))
        for name, gone in missing.items()
    }
    mono, offline = (sum(getattr(on, f"{e}_error") for on in place.corridors) for e in ("mono", "offline"))
    figures["blackout_error_over_mono"] = errors["dark"] / mono
    figures["error_ratio_lost_views"] = errors["lost"] / offline
    assert errors["dark"] < 1.5 * mono
    assert errors["lost"] < 2.0 * offline


def test_a_turn(place: Place, figures: dict[str, Any]) -> None:
    """Another way than the demo's: round a corner, as the laboratory renders it."""
    around = walk(FirstFrames(world_recording("turn90-0"), 80), place.folder / "turn")
    found = place.play("turn-live", replace(CLEAN, loss=0.02), around)
    figures["turn_uplink_kBps"] = found.rate / 1e3
    figures["turn_age_p50_ms"] = quantile_ms(found.ages, 0.5)
    figures["turn_age_p99_ms_loss2"] = quantile_ms(found.ages, 0.99)
    figures["turn_error_ratio_loss2"] = found.error / around.offline_error
    assert found.rate < 150e3
    assert np.median(found.ages) < FRESH
    assert found.unused.size == 0
    assert found.error < SANE


def test_a_thin_line(place: Place) -> None:
    found = place.play("thin", replace(CLEAN, rate_mbit=5.0))
    assert np.median(found.ages) < FRESH
    assert found.unused.size == 0


def test_packets_that_overtake_each_other(place: Place) -> None:
    found = place.play("reordered", replace(CLEAN, jitter_ms=5.0))
    assert np.median(found.ages) < FRESH
    assert found.unused.size == 0
    assert (np.abs(found.clock) < found.clock_bound).all()


def returned(found: ScenarioOutcome) -> float:
    """Seconds from the end of the trouble to the first image; asserts that the robot did as it should."""
    before = found.came[found.came < found.ended]
    silent = (found.frames > before.max() + SILENT + 0.3) & (found.frames < found.ended)
    assert silent.any()
    assert not found.collab[silent].any()
    back = float(found.came[found.came > found.ended].min())
    there = found.frames > back
    assert found.frames[there & found.collab].min() - back < SILENT
    assert found.unused.size == 0
    return back - found.ended


def test_a_blackout_of_three_seconds(place: Place, figures: dict[str, Any]) -> None:
    found = place.play("blackout", CLEAN, trouble=dark)
    figures["blackout_error_over_mono_ahead"] = found.error / place.ahead.mono_error
    figures["back_after_blackout_s"] = returned(found)
    assert found.error < SANE


def test_a_blackout_on_a_machine_without_namespaces(place: Place) -> None:
    found = place.play("loopback", replace(CLEAN, loss=0.02), trouble=dark, between=loopback)
    assert found.bytes_on_wire > found.bytes_received > 10 * LEVELS[-1].size
    returned(found)


def test_a_worn_process_that_is_stopped_and_goes_on(place: Place, figures: dict[str, Any]) -> None:
    found = place.play("stopped", CLEAN, trouble=stopped)
    figures["back_after_stop_s"] = returned(found)


def test_kept_poses_cost_little(place: Place, figures: dict[str, Any]) -> None:
    recording = collabslam.open_recording(place.corridors[0].recording)
    frames = [recording.frame(i) for i in range(len(recording))]
    late = [(), *([replace(view, t=f.t) for view in f.views] for f in frames[:-1])]
    slams = [collabslam.Slam(recording.camera, recording.worn_camera) for _ in range(2)]
    costs: list[list[float]] = [[], []]
    for frame, *given in zip(frames, [f.views for f in frames], late, strict=True):
        for slam, views, cost in zip(slams, given, costs, strict=True):  # by turns: a busy machine slows both
            cost.append(slam.step(frame.t, frame.image, views).diagnostics["ms_update"])
    now, then = (float(np.median(cost)) for cost in costs)
    figures["clones_share_of_update"] = max(0.0, (then - now) / then)
    assert figures["clones_share_of_update"] < 0.5
