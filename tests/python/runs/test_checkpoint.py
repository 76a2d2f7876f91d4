"""Stop and go on: a run that was killed, an engine or a filter that was saved, goes on bit for bit."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip, Short

from collabslam._core import Camera, Factor, Filter, PosedNode, WornMeasurement
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.errors import DataError, InputError, SettingsError
from collabslam.formats import container
from collabslam.runs import runner
from collabslam.runs.checkpoint import Checkpoint
from collabslam.runs.plan import Interval, Output
from collabslam.runs.results import CHECKPOINT, COVARIANCE, FRAMES, TRAJECTORY
from collabslam.runs.run_folder import RunFolder
from collabslam.slam.engine import Slam
from collabslam.slam.saving import CLASSES, KIND, VERSION
from collabslam.slam.state import PersistentState, persistent_parts
from collabslam.types import Frame, Target
from collabslam_lab.reliability.kills import check_lines, compare_results, run_kills

STOP = 7


# --- the engine -------------------------------------------------------------------------------


def step(slam: Slam, frame: Frame) -> bytes:
    """One frame; everything that comes out but times."""
    uv = [[200.0, 200.0], [400.0, 240.0]]
    slam.add_depth(uv, [3.0, 4.0], 0.5)
    out = slam.step(frame.t, frame.image, frame.views)
    told = {k: v for k, v in out.diagnostics.items() if not k.startswith("ms_")}
    features = (out.features.ids.tobytes(), out.features.found.tobytes(), out.features.s.tobytes())
    return repr((out.pose.tobytes(), out.covariance.tobytes(), out.status, told, features)).encode()


def differences(a: Any, b: Any, path: str, seen: set[int]) -> list[str]:
    """In what two objects differ, attribute by attribute; frames' own images and caches are skipped."""
    if id(a) in seen:
        return []
    seen.add(id(a))
    if isinstance(a, Filter):
        return [] if a.snapshot() == b.snapshot() else [path]
    if isinstance(a, Factor | PosedNode) and isinstance(b, type(a)):
        names = [n for n in dir(a) if not n.startswith("_") and not callable(getattr(a, n))]
        return [d for n in names for d in differences(getattr(a, n), getattr(b, n), f"{path}.{n}", set())]
    if type(a) is not type(b) and not (isinstance(a, list | tuple) and isinstance(b, list | tuple)):
        return [f"{path}: {type(a).__name__} and {type(b).__name__}"]
    if isinstance(a, np.ndarray):
        return [] if a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f") else [path]
    if isinstance(a, dict):
        if list(a) != list(b):
            return [f"{path}: other keys, or another order"]
        return [d for k in a for d in differences(a[k], b[k], f"{path}[{k!r}]", seen)]
    if isinstance(a, list | tuple):
        if len(a) != len(b):
            return [f"{path}: {len(a)} and {len(b)}"]
        return [
            d
            for i, (x, y) in enumerate(zip(a, b, strict=True))
            for d in differences(x, y, f"{path}[{i}]", seen)
        ]
    if dataclasses.is_dataclass(a) or (
        type(a).__module__.startswith("collabslam.") and hasattr(a, "__dict__")
    ):
        skipped = SKIPPED.get(type(a).__name__, ())
        names = [n for n in vars(a) if n not in skipped]
        return [d for n in names for d in differences(getattr(a, n), getattr(b, n), f"{path}.{n}", seen)]
    return [] if a == b or (a != a and b != b) else [f"{path}: {a!r} and {b!r}"]


SKIPPED = {
    "BackgroundTask": ("_now",),
    "Chain": ("graph", "solved"),
    "FlowImage": ("small",),
    "Guard": ("turn", "_kept"),
}
"""Attributes that are worked out from the others, or that serve one call."""


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["collab", "collab-tight", "mono", "mono-undelayed"])
def test_an_engine_that_was_saved_goes_on_bit_for_bit(clip: Clip, tmp_path: Path, mode: str) -> None:
    recording = clip.recording
    slam = Slam(recording.camera, recording.worn_camera, mode=mode)
    for k, frame in enumerate(clip.frames):
        if k in (0, 1, STOP, len(clip.frames) - 2):
            slam.save(tmp_path / f"{k}.bin")
        copy = Slam.load(tmp_path / f"{k}.bin") if (tmp_path / f"{k}.bin").exists() else None
        if copy is not None:
            # A part with a memory that it does not keep shows here, whether or not it matters to the result.
            assert differences(slam, copy, "slam", set()) == []
        told = step(slam, frame)
        if copy is not None:
            assert step(copy, frame) == told
            slam = copy if k == STOP else slam
    fresh = Slam(recording.camera, recording.worn_camera, mode=mode)
    assert [step(fresh, frame) for frame in clip.frames][-1] == told
    assert fresh.filter.snapshot() == slam.filter.snapshot()


def test_every_part_with_a_memory_says_what_it_keeps(clip: Clip) -> None:
    recording = clip.recording
    slam = Slam(recording.camera, recording.worn_camera)
    before = {name: dict(vars(part)) for name, part in persistent_parts(slam._parts).items()}
    for frame in clip.frames[:4]:
        slam.step(frame.t, frame.image, frame.views)
    assert set(before) >= {"tracks", "depth", "monitor"}
    for name, part in persistent_parts(slam._parts).items():
        changed = {k for k, v in vars(part).items() if v is not before[name][k]}
        assert changed <= set(part.PERSISTENT), name
        assert set(part.PERSISTENT) <= set(vars(part)), name
    for name, part in vars(slam._parts).items():
        remembers = any(k.startswith(("_last", "_previous")) for k in getattr(part, "__dict__", {}))
        assert isinstance(part, PersistentState) or not remembers, name


def test_depths_and_a_target_are_kept(clip: Clip, tmp_path: Path) -> None:
    camera = clip.recording.camera
    points = np.array([[0.1 * i, 0.1 * j, 0.0] for i in range(3) for j in range(2)])
    target = Target(
        points, [np.full((9, 9), 40 * i, np.uint8) for i in range(6)], np.eye(4), np.eye(6) * 1e-4
    )
    slam = Slam(camera, start="target", target=target)
    slam.add_depth([[10.0, 20.0]], 3.0, 0.1)
    slam.save(tmp_path / "slam.bin")
    assert differences(slam, Slam.load(tmp_path / "slam.bin"), "slam", set()) == []


@pytest.fixture(scope="module")
def saved(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    recording = clip.recording
    slam = Slam(recording.camera, recording.worn_camera)
    for frame in clip.frames[:3]:
        slam.step(frame.t, frame.image, frame.views)
    path = tmp_path_factory.mktemp("saved") / "slam.bin"
    slam.save(path)
    return path


def test_spoilt_files_are_refused(saved: Path, tmp_path: Path) -> None:
    good, path = saved.read_bytes(), tmp_path / "bad.bin"
    random = np.random.Generator(np.random.PCG64(0))
    cases = [(good[:k], "cut short|altered") for k in (9, 30, 1000, len(good) // 2, len(good) - 1)]
    cases += [(b"", "cut short"), (b"#!/bin/sh\n" * 100, "is not an engine state"), (good + b"0", "altered")]
    cases.append((good[:8] + b"\x02" + good[9:], "has version 2"))
    for _ in range(20):
        at = int(random.integers(12, len(good)))
        altered = good[:at] + bytes([good[at] ^ 1 << int(random.integers(8))]) + good[at + 1 :]
        cases.append((altered, "altered|cut short"))
    for data, message in cases:
        path.write_bytes(data)
        with pytest.raises(DataError, match=message):
            Slam.load(path)
    with pytest.raises(DataError, match="cannot be read"):
        Slam.load(tmp_path / "nowhere.bin")


def test_files_that_hold_something_else_are_refused(saved: Path, tmp_path: Path) -> None:
    good = container.read_container(saved, KIND, VERSION, CLASSES)
    path = tmp_path / "bad.bin"
    parts, values = good["parts"], good["settings"]["values"]
    spoilt: list[Any] = [
        None,
        [],
        {},
        {**good, "camera": ("pinhole", 0, 0, [1.0], [])},
        {**good, "settings": {"values": {"filter.map.in_view": 30}, "switches": {}}},
        {**good, "settings": {**good["settings"], "switches": {"filter.no_such": 1}}},
        {**good, "settings": {**good["settings"], "values": {**values, "filter.map.in_view": -3}}},
        {**good, "filter": good["filter"][:-1]},
        {**good, "filter": 3},
        {**good, "start": "nowhere"},
        {**good, "parts": {}},
        {**good, "parts": {**parts, "_tracks": {}}},
        {**good, "parts": {**parts, "tracks": {**parts["tracks"], "_features": {}}}},
    ]
    for content in spoilt:
        container.write_container(path, KIND, VERSION, content, CLASSES)
        with pytest.raises(DataError):
            Slam.load(path)
    for version in (VERSION - 1, VERSION + 1):
        container.write_container(path, KIND, version, good, CLASSES)
        with pytest.raises(DataError, match=f"has version {version}, this program reads version {VERSION}"):
            Slam.load(path)


# --- the container ----------------------------------------------------------------------------


def test_a_container_gives_back_what_it_got(tmp_path: Path) -> None:
    shared = np.arange(6.0).reshape(2, 3)
    content = {
        "numbers": [1, 2.5, True, None, float("nan"), -0.0, 1e-320, 2**80],
        "arrays": [shared, shared, np.empty((0, 4)), np.array(3.5), np.array([True, False]), shared.T],
        7: (b"\x00\xff", "text", {}),
        "big-endian": np.arange(3, dtype=">f8"),
    }
    path = tmp_path / "box.bin"
    container.write_container(path, "box", 3, content)
    back = container.read_container(path, "box", 3)
    assert list(back) == list(content)
    assert repr(back["numbers"]) == repr(content["numbers"])
    assert back["arrays"][0] is back["arrays"][1]
    for a, b in zip(back["arrays"], content["arrays"], strict=True):
        assert a.shape == b.shape
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    assert back[7] == content[7]
    np.testing.assert_array_equal(back["big-endian"], [0, 1, 2])
    for odd in (object(), {1.5: 2}, np.array(["text"]), np.array([None]), {1, 2}, lambda: 0):
        with pytest.raises(TypeError, match="cannot be kept"):
            container.write_container(path, "box", 3, odd)
    assert container.read_container(path, "box", 3)[7] == content[7], "a failed write leaves the file"


@pytest.mark.parametrize(
    ("arrays", "tree"),
    [
        ([["<f8", [10**18]]], {"array": 0}),
        ([["<f8", [2**62, 2**62]]], {"array": 0}),
        ([["<f8", [-1]]], {"array": 0}),
        ([["|O", [1]]], {"array": 0}),
        ([["<U9", [1]]], {"array": 0}),
        ([], {"array": 0}),
        ([], {"class": "Path", "fields": {}}),
        ([], {"something": 1}),
        ([], {"dict": [[[1], 2]]}),
        ("text", None),
    ],
)
def test_a_header_is_not_believed(tmp_path: Path, arrays: Any, tree: Any) -> None:
    import hashlib
    import json

    header = json.dumps({"kind": "box", "version": 1, "arrays": arrays, "tree": tree}).encode()
    data = container._HEAD.pack(container.MAGIC, 1, len(header)) + header
    path = tmp_path / "box.bin"
    path.write_bytes(data + hashlib.sha256(data).digest())
    with pytest.raises(DataError):
        container.read_container(path, "box", 1)


# --- the filter -------------------------------------------------------------------------------


def test_a_filter_is_saved_and_restored(clip: Clip) -> None:
    recording = clip.recording
    slam = Slam(recording.camera, recording.worn_camera)
    for frame in clip.frames[:3]:
        slam.step(frame.t, frame.image, frame.views)
    data = slam.filter.snapshot()
    copy = Filter.restore(data)
    assert isinstance(data, bytes)
    assert copy.mean.tobytes() == slam.filter.mean.tobytes()
    assert copy.covariance.tobytes() == slam.filter.covariance.tobytes()
    assert copy.snapshot() == data
    copy.check()
    for bad in (b"", data[:-1], data[:100] + b"\x00" + data[101:], data + b"\x00"):
        with pytest.raises(DataError, match="snapshot cannot be used"):
            Filter.restore(bad)
    with pytest.raises(InputError):
        copy.predict(copy.time)


def test_a_measurement_that_would_break_the_filter_is_refused(clip: Clip) -> None:
    recording = clip.recording
    slam = Slam(recording.camera, recording.worn_camera)
    for frame in clip.frames[:3]:
        slam.step(frame.t, frame.image, frame.views)
    frame = clip.frames[3]
    assert frame.views
    core = slam.filter
    core.predict(frame.t)
    before, seen = core.snapshot(), core.predict_pixels()
    none = np.empty(0, np.int64)
    worn = WornMeasurement(frame.views[0].t_cf, frame.views[0].covariance * 1e60, seen.ids, seen.uv, seen.uv)
    with pytest.raises(InputError, match="covariance of T_CF"):
        core.update(none, seen.ids, seen.uv, views=[worn])
    assert core.snapshot() == before
    assert core.update(seen.ids, seen.ids, seen.uv).refused is None
    core.check()


def test_a_frame_that_is_refused_is_reported_and_the_run_goes_on(clip: Clip) -> None:
    recording = clip.recording
    slam = Slam(recording.camera, recording.worn_camera)
    for frame in clip.frames[:3]:
        slam.step(frame.t, frame.image, frame.views)
    core = slam.filter

    class Refused:
        """What became of so many measurements."""

        def __init__(self, count: int) -> None:
            self.accepted, self.born = np.zeros(count, np.bool_), np.full(count, -1)

        def __getattr__(self, name: str) -> int:
            return 0

    class Refusal:
        """What the filter answers to an update that would have broken it."""

        def __init__(self, bearings: int, pairs: list[int]) -> None:
            self._of_nothing = core.update([], [], np.empty((0, 2)))
            self.refused = "S is not positive definite"
            self.bearings, self.views = Refused(bearings), [Refused(count) for count in pairs]

        def __getattr__(self, name: str) -> Any:
            return getattr(self._of_nothing, name)

    class Breaking:
        """The filter, with an update that no arithmetic can do."""

        def __getattr__(self, name: str) -> Any:
            return getattr(core, name)

        def update(self, searched: Any, ids: Any, uv: Any, views: Any = (), **_: Any) -> Any:
            return Refusal(len(ids), [len(view) for view in views])

    slam._loop._filter = Breaking()  # type: ignore[assignment]
    frame = clip.frames[3]
    out = slam.step(frame.t, frame.image, frame.views)
    assert out.diagnostics["refused"] == 1
    assert "accepted" not in out.features.states
    slam._loop._filter = core
    out = slam.step(clip.frames[4].t, clip.frames[4].image)
    assert out.diagnostics["refused"] == 0
    assert out.diagnostics["accepted"] > 10


def test_steps_of_time_are_defined() -> None:
    camera = Camera("pinhole", 64, 48, (50.0, 50.0, 31.5, 23.5), [])
    core = Filter(camera)
    core.predict(0.0)
    core.add_undelayed([[20.0, 20.0], [40.0, 30.0]])
    before = core.snapshot()
    for t in (0.0, -1.0, float("nan"), float("inf"), 1e300, 1e12, 3700.0):
        with pytest.raises(InputError):
            core.predict(t)
        assert core.snapshot() == before
    core.predict(3600.0)
    assert np.isfinite(core.covariance).all()
    core.check()


# --- runs -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was left alone, without checkpoints."""
    out = tmp_path_factory.mktemp("runs") / "whole"
    runner.run(Short(clip), out=out, mode="collab")
    return out


@pytest.mark.slow
def test_checkpoints_change_nothing(clip: Clip, whole: Path, tmp_path: Path) -> None:
    runner.run(Short(clip), mode="collab", out=Output(tmp_path, checkpoint_every=2))
    assert compare_results(whole, tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 4, "1e-9s"])
def test_a_run_that_broke_off_goes_on_bit_for_bit(
    clip: Clip, whole: Path, tmp_path: Path, every: Any
) -> None:
    with pytest.raises(DataError, match="disk is gone"):
        runner.run(Short(clip, ends=STOP), mode="collab", out=Output(tmp_path, checkpoint_every=every))
    check_lines(tmp_path)
    assert len(RunFolder(tmp_path).frames()) == STOP, "what was reported is there"
    assert len(RunFolder(tmp_path).trajectory()[0]) == STOP
    result = runner.resume(tmp_path, Short(clip))
    assert len(result.record) == len(clip.frames)
    assert compare_results(whole, tmp_path) == []
    with pytest.raises(DataError, match="is finished"):
        runner.resume(tmp_path, Short(clip))


@pytest.mark.slow
def test_files_that_were_cut_are_made_whole(clip: Clip, whole: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError):
        runner.run(Short(clip, ends=STOP), mode="collab", out=Output(tmp_path, checkpoint_every=2))
    for name in (FRAMES, COVARIANCE, TRAJECTORY):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: 2 * len(data) // 3])
    (tmp_path / f".{CHECKPOINT}.99.part").write_bytes(b"half")
    runner.resume(tmp_path, Short(clip))
    assert compare_results(whole, tmp_path) == []
    assert not list(tmp_path.glob(".*"))


def test_another_recording_is_refused(clip: Clip, tmp_path: Path) -> None:
    with pytest.raises(DataError):
        runner.run(Short(clip, ends=STOP), mode="collab", out=Output(tmp_path, checkpoint_every=2))
    later, other = Short(clip), Short(clip)
    later.times = later.times + 1.0
    other.camera = Camera("pinhole", 720, 480, (600.0, 600.0, 359.5, 239.5), [])
    for recording, what in ((later, "time stamps"), (other, "calibration of Cs")):
        with pytest.raises(DataError, match=what):
            runner.resume(tmp_path, recording)
    with pytest.raises(DataError, match="give the recording"):
        runner.resume(tmp_path)


def test_checkpoints_of_another_program_are_refused(clip: Clip, tmp_path: Path) -> None:
    with pytest.raises(DataError):
        runner.run(Short(clip, ends=2), mode="collab", out=Output(tmp_path, checkpoint_every=1))
    checkpoint = dataclasses.replace(Checkpoint.read(tmp_path), program="99.0")
    checkpoint.write(tmp_path / CHECKPOINT)
    with pytest.raises(DataError, match=r"is of collabslam 99\.0"):
        runner.resume(tmp_path, Short(clip))


def test_intervals() -> None:
    assert Interval.parse(5) == Interval.parse("5") == Interval(frames=5)
    assert Interval.parse("30s") == Interval(seconds=30.0)
    assert Interval(frames=5).is_over(5, 0.0)
    assert not Interval(frames=5).is_over(4, 1e9)
    assert Interval(seconds=2.0).is_over(0, 2.5)
    for bad in ("", "0", "-1", "s", "0s", "-2s", "nans", "infs", "often", "1.5"):
        with pytest.raises(SettingsError):
            Interval.parse(bad)


def test_a_checkpoint_needs_a_place(clip: Clip) -> None:
    with pytest.raises(SettingsError, match="result folder"):
        runner.run(Short(clip), out=Output(checkpoint_every=2))


@pytest.mark.slow
def test_the_command_line(clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = write_recording(Short(clip), tmp_path / "walk")
    whole, out = tmp_path / "whole", tmp_path / "out"
    command = ["run", str(recording), "--mode", "collab", "--checkpoint-every", "2"]
    assert cli.main([*command, "--out", str(whole)]) == 0
    last = sorted((recording / "cam0" / "data").iterdir())[STOP]
    image = last.read_bytes()
    last.write_bytes(b"broken")
    assert cli.main([*command, "--out", str(out)]) == 2
    last.write_bytes(image)
    good = (out / CHECKPOINT).read_bytes()
    capsys.readouterr()
    for bad, message in (
        (good[:-5], "checksum"),
        (good[:100] + b"?" + good[101:], "altered"),
        (good[:8] + b"\x09" + good[9:], "version 9"),
        (b"", "cut short"),
    ):
        (out / CHECKPOINT).write_bytes(bad)
        assert cli.main(["run", "--resume", str(out)]) == 2
        assert message in capsys.readouterr().err
    (out / CHECKPOINT).write_bytes(good)
    assert cli.main(["run", "--resume", str(out), "--mode", "mono"]) == 2
    assert "leave out --mode" in capsys.readouterr().err
    os.rename(recording, tmp_path / "moved")
    assert cli.main(["run", "--resume", str(out)]) == 2
    assert cli.main(["run", str(tmp_path / "moved"), "--resume", str(out)]) == 0
    # The summary says where the recording lay; all else is the same.
    assert compare_results(whole, out) in ([], [difference_of_place(whole, out)])
    capsys.readouterr()
    assert cli.main(["run", "--resume", str(out)]) == 0
    assert "finished" in capsys.readouterr().err
    assert cli.main(["run", "--resume", str(tmp_path / "nowhere")]) == 2


def difference_of_place(whole: Path, out: Path) -> str:
    a, b = (RunFolder(f).summary()["source"] for f in (whole, out))
    return f"source of summary.json is {b} in place of {a}"


@pytest.mark.slow
def test_killed_runs_go_on() -> None:
    """The short form of `make reliability`."""
    assert run_kills(3, seed=1, frames=12, every=2) >= 3
