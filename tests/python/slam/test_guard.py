"""A step that breaks off leaves no trace, and nobody comes between."""

from __future__ import annotations

import copy
import pickle
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.waiting import LONGEST

from collabslam import BusyError, InputError, Slam
from collabslam.slam.guard import all_or_nothing, alone
from collabslam.slam.state import persistent_parts
from collabslam.types import Frame

COUNT = 4
"""Frames that the engine has seen."""
STAGES = [
    ("blank", "judge"),
    ("tracks", "search"),
    ("worn", "match"),
    ("depth", "take"),
    ("recovery", "attempt"),
    ("map", "grow"),
    ("tracks", "adopt"),
    ("relocaliser", "forget"),
    ("monitor", "update"),
    ("relocaliser", "remember"),
]
"""Parts that a frame calls, in order."""


def engine_at(clip: Clip, count: int = COUNT) -> Slam:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, mode="collab-tight")
    for frame in clip.frames[:count]:
        slam.step(frame.t, frame.image, frame.views)
    slam.add_depth([[200.0, 200.0], [400.0, 240.0]], [3.0, 4.0], 0.5)
    return slam


def step(slam: Slam, frame: Frame) -> bytes:
    """One frame: all that comes out of it, and all that it leaves behind."""
    out = slam.step(frame.t, frame.image, frame.views)
    told = {k: v for k, v in out.diagnostics.items() if not k.startswith("ms_")}
    return repr((out.pose.tobytes(), out.covariance.tobytes(), out.status, told)).encode() + everything(slam)


def everything(slam: Slam) -> bytes:
    """The engine to the bit, array by array."""
    return repr(_plain(slam.state())).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.shape, value.tobytes())
    if isinstance(value, dict):
        return [(k, _plain(v)) for k, v in value.items()]
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return _plain(vars(value)) if hasattr(value, "__dict__") else value


@pytest.fixture(scope="module")
def straight(clip: Clip) -> tuple[bytes, bytes]:
    """The engine before the frame, and what an undisturbed frame gives."""
    slam = engine_at(clip)
    return everything(slam), step(slam, clip.frames[COUNT])


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize(("part", "method"), STAGES, ids=str)
def test_interrupted_at_any_stage_it_is_as_before(
    clip: Clip, straight: tuple[bytes, bytes], part: str, method: str, after: bool
) -> None:
    slam = engine_at(clip)
    frame, owner = clip.frames[COUNT], getattr(slam._parts, part)
    done = getattr(owner, method)

    def interrupted(*arguments: Any, **options: Any) -> None:
        if after:
            done(*arguments, **options)
        raise KeyboardInterrupt

    setattr(owner, method, interrupted)
    with pytest.raises(KeyboardInterrupt):
        slam.step(frame.t, frame.image, frame.views)
    delattr(owner, method)
    assert everything(slam) == straight[0]
    assert step(slam, frame) == straight[1]


@pytest.mark.slow
def test_interrupted_at_any_line_it_is_as_before(clip: Clip, straight: tuple[bytes, bytes]) -> None:
    """Ctrl-C comes between any two lines of ours: every fiftieth of a frame is tried."""
    slam, frame = engine_at(clip), clip.frames[COUNT]
    state, tried = straight[0], 0
    for line in range(1, 100_000, 50):
        if not _interrupt_at(line, lambda: slam.step(frame.t, frame.image, frame.views)):
            break
        assert everything(slam) == state, line
        tried += 1
    assert tried > 20
    slam = engine_at(clip)
    assert _interrupt_at(400, lambda: slam.step(frame.t, frame.image, frame.views))
    assert step(slam, frame) == straight[1]


def test_undoing_that_is_interrupted_is_done_by_the_next_call(
    clip: Clip, straight: tuple[bytes, bytes]
) -> None:
    slam, frame = engine_at(clip), clip.frames[COUNT]

    def twice(*_: Any) -> None:
        raise KeyboardInterrupt

    slam._parts.monitor.update = twice  # type: ignore[method-assign, assignment]
    repair = slam._guard.repair
    calls = []

    def interrupted() -> None:
        calls.append(1)
        if len(calls) == 2:  # the first one finds nothing to do
            raise KeyboardInterrupt
        repair()

    slam._guard.repair = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        slam.step(frame.t, frame.image, frame.views)
    del slam._parts.monitor.update, slam._guard.repair
    assert everything(slam) == straight[0]
    assert step(slam, frame) == straight[1]


def _interrupt_at(line: int, call: Callable[[], object]) -> bool:
    """Makes a call with Ctrl-C before the so manieth of our lines; False if there are fewer."""
    left = line

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left
        if "collabslam" not in frame.f_code.co_filename or frame.f_code.co_filename.endswith("guard.py"):
            return None
        if event == "line":
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


@pytest.mark.parametrize(
    "spoil",
    [
        lambda slam, frame: slam.step(frame.t, frame.image[:, :-1], frame.views),
        lambda slam, frame: slam.step(-1.0, frame.image, frame.views),
        lambda slam, frame: slam.add_depth(np.empty((0, 2)), [1.0, 2.0], 0.1),
        lambda slam, frame: slam.add_depth([[1.0, 2.0]], 0.0, 0.1),
        lambda slam, frame: slam.add_depth([[1.0, 2.0]], 3.0, 1e-9),
        lambda slam, frame: slam.add_depth([[1.0, 2.0]], 1e300, 0.1),
        lambda slam, frame: slam.add_depth([[1.0, 2.0]], 3.0, 1e200),
    ],
)
def test_bad_input_leaves_no_trace(clip: Clip, straight: tuple[bytes, bytes], spoil: Any) -> None:
    slam, frame = engine_at(clip), clip.frames[COUNT]
    with pytest.raises(InputError):
        spoil(slam, frame)
    assert everything(slam) == straight[0]
    assert step(slam, frame) == straight[1]


def test_no_depths_are_none(clip: Clip, straight: tuple[bytes, bytes]) -> None:
    slam = engine_at(clip)
    slam.add_depth([], [], [])
    slam.add_depth(np.empty((0, 2)), 1.0, 0.1)
    assert everything(slam) == straight[0]
    alone = Slam(clip.recording.camera, mode="mono", start="depth")
    alone.add_depth([], 1.0, 0.1)
    assert not alone.step(0.0, clip.frames[0].image).started


def test_every_part_with_a_memory_is_undone(clip: Clip) -> None:
    slam = engine_at(clip)
    assert slam._guard._parts == list(persistent_parts(slam._parts).values())
    assert len(slam._guard._parts) >= 5


def test_a_second_thread_is_told_that_the_engine_is_busy(clip: Clip, straight: tuple[bytes, bytes]) -> None:
    slam, frame = engine_at(clip), clip.frames[COUNT]
    inside, go_on, refused = threading.Event(), threading.Event(), []
    search = slam._parts.tracks.search

    def slow(*arguments: Any) -> Any:
        inside.set()
        assert go_on.wait(LONGEST)
        return search(*arguments)

    slam._parts.tracks.search = slow  # type: ignore[method-assign, assignment]
    results: list[bytes] = []
    thread = threading.Thread(target=lambda: results.append(step(slam, frame)))
    thread.start()
    assert inside.wait(LONGEST)
    calls: list[Callable[[], object]] = [
        lambda: slam.step(frame.t, frame.image, frame.views),
        slam.state,
        slam.saved_map,
        slam.landmarks,
        lambda: slam.add_depth([[1.0, 2.0]], 1.0, 0.1),
    ]
    for call in calls:
        with pytest.raises(BusyError, match="another thread"):
            call()
        refused.append(call)
    go_on.set()
    thread.join()
    del slam._parts.tracks.search
    assert len(refused) == len(calls)
    assert results == [straight[1]]


class Room:
    """Two methods that take turns."""

    def __init__(self, clip: Clip) -> None:
        self._guard = engine_at(clip, 1)._guard
        self.entered, self.leave = threading.Event(), threading.Event()

    @alone
    def stay(self) -> None:
        self.entered.set()
        assert self.leave.wait(LONGEST)

    @all_or_nothing
    def pass_through(self) -> None:
        pass


@pytest.mark.slow
def test_nobody_waits_wherever_the_other_thread_stands(clip: Clip) -> None:
    """One stops before the n-th line of the guard, another comes: one goes on, the other is told."""
    busy = 0
    for line in range(1, 100):
        room, stopped, go_on, told = Room(clip), threading.Event(), threading.Event(), []
        first = threading.Thread(target=_held_at, args=(line, stopped, go_on, told, room.pass_through))
        first.start()
        assert stopped.wait(LONGEST)
        if told:  # the guard has fewer lines than that
            break
        second = threading.Thread(target=_noted, args=(told, room.stay))
        second.start()
        while not room.entered.wait(0.01) and not told:
            pass
        go_on.set()
        first.join(LONGEST)
        waits = first.is_alive()
        room.leave.set()
        second.join(LONGEST)
        assert not waits, line
        busy += told.count("busy")
        assert sorted(told) in (["busy", "done"], ["done", "done"]), line
    assert line > 5
    assert busy > 3


def _noted(told: list[str], call: Callable[[], None]) -> None:
    try:
        call()
        told.append("done")
    except BusyError:
        told.append("busy")


def _held_at(
    line: int, stopped: threading.Event, go_on: threading.Event, told: list[str], call: Callable[[], None]
) -> None:
    """Makes a call that stops before the so manieth line of the guard."""
    left = line

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left
        if frame.f_code.co_filename.endswith("guard.py") and event == "line":
            left -= 1
            if left == 0:
                stopped.set()
                assert go_on.wait(LONGEST)
        return trace

    sys.settrace(trace)
    try:
        _noted(told, call)
    finally:
        sys.settrace(None)
        stopped.set()


@pytest.mark.parametrize("take", [copy.copy, copy.deepcopy, pickle.dumps])
def test_an_engine_is_copied_by_its_file_alone(clip: Clip, take: Callable[[Slam], object]) -> None:
    with pytest.raises(InputError, match=r"save\(path\).*Slam\.load\(path\)"):
        take(engine_at(clip, 1))
