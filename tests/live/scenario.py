"""A walk over a network: both ends in processes of their own, what may go wrong, and what both saw of it.

What happens is timed by what the robot has done, never by a clock: a busy machine starts processes late.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import wire as w
from networks import Network, network

import collabslam
from collabslam.datasets import write_recording
from collabslam.datasets.poses import read_track
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.live.decoding import view_image
from collabslam.live.pace import LEVELS, Encoder
from collabslam.types import Array, Frame, Recording

HERE = Path(__file__).parent
OFFSET, DRIFT = 3.7, 50e-6
"""Of the worn camera's clock: seconds, and share."""
START = 60.0
"""Seconds that processes may take to be there."""


@dataclass(frozen=True)
class Walk:
    """A recording, its true poses, and the mean position errors of offline runs, metres."""

    recording: Path
    times: Array
    truth: Array
    offline_error: float
    mono_error: float


@dataclass(frozen=True)
class ScenarioOutcome:
    """What a scenario gave; times are the machine's, seconds.

    Attributes
    ----------
    out : Path
        The robot's result folder.
    error : float
        Mean position error, metres.
    taken, came : (N,) array
        When images were taken, and when they came.
    given : (K, 2) array
        When views, images with their T_CF, were taken, and when the filter was given them.
    clock, clock_bound : (N,) array
        Errors of their stamps in the robot's time, seconds; and by how much the questions that were answered
        until then can be wrong.
    rate : float
        Bytes per second that left the worn camera, as counted on the wire.
    frames : (M,) array
        When Cs took its frames.
    collab : (M,) array of bool
        Whether the robot used the worn camera then.
    lasted, worked : (M,) array
        Seconds that a frame took, and those of them in which the machine worked on it: when it is busy with
        other things, too, the second is what is the frame's.
    began, ended : float
        Of the trouble.
    """

    out: Path
    summary: dict[str, Any]
    error: float
    taken: Array
    came: Array
    given: Array
    clock: Array
    clock_bound: Array
    rate: float
    bytes_on_wire: int
    bytes_received: int
    frames: Array
    collab: Any
    lasted: Array
    worked: Array
    began: float
    ended: float

    @property
    def ages(self) -> Array:
        """(N,) seconds that images had on their way."""
        return self.came - self.taken

    @property
    def unused(self) -> Array:
        """Times of frames that were done alone although there was a view that was fresh: there may be none.

        One that was on its way for long is no longer fresh soon after it has come, and an image whose T_CF
        was lost is not a view.
        """
        alone, (taken, given) = self.frames[~self.collab], self.given.T
        return np.array([t for t in alone if ((taken > t - 0.8) & (given < t - 0.3)).any()])


def walk(recording: Recording, folder: Path) -> Walk:
    """A recording, and how well it goes offline, with Cf's images as small as they are sent."""
    path = write_recording(recording, folder / "recording")
    written = collabslam.open_recording(path)
    errors = []
    for mode in ("collab-tight", "mono"):
        collabslam.run(Small(written), mode=mode, out=folder / mode)
        errors.append(position_error(folder / mode, written.times, written.truth))
    return Walk(path, written.times, np.asarray(written.truth), *errors)


class Small(WrappedRecording):
    """A recording with Cf's images as small as a worn camera sends them."""

    def __init__(self, base: Any) -> None:
        super().__init__(base)
        encoder, self._small = Encoder(), {}
        for i in range(len(base)):
            self._small[i] = tuple(
                replace(view, image=view_image(encoder.encode(view.image, LEVELS[0].size), base.worn_camera))
                for view in base.frame(i).views
            )

    def frame(self, i: int) -> Frame:
        return replace(super().frame(i), views=self._small[i])


class Without(WrappedRecording):
    """A recording without some of Cf's views: those for whose frames ``gone`` holds."""

    def __init__(self, base: Any, gone: Callable[[int], bool]) -> None:
        super().__init__(base)
        self._gone = gone

    def frame(self, i: int) -> Frame:
        frame = super().frame(i)
        return replace(frame, views=()) if self._gone(i) else frame


def error_without(walk: Walk, gone: Callable[[int], bool], out: Path) -> float:
    """Mean position error, metres, offline without some views."""
    collabslam.run(Without(Small(collabslam.open_recording(walk.recording)), gone), out=out)
    return position_error(out, walk.times, walk.truth)


def position_error(out: Path, times: Any, truth: Any) -> float:
    """Mean over the frames with a pose; the first one's pose is the true one's."""
    stamps, poses = read_track(out / "trajectory.tum")
    rows = [int(np.argmin(np.abs(times - t))) for t in stamps]
    moved = poses[0] @ np.linalg.inv(truth[rows[0]])
    true = np.array([moved @ truth[k] for k in rows])
    return float(np.mean(np.linalg.norm(poses[:, :3, 3] - true[:, :3, 3], axis=1)))


class Playing:
    """Both ends while they run."""

    def __init__(self, out: Path, worn: subprocess.Popen[Any], relay: subprocess.Popen[Any]) -> None:
        self.worn, self.relay = worn, relay
        self._out = out

    def until(self, link: str, count: int) -> None:
        """Waits until the last frames, so many, were ``link``."""
        end = time.monotonic() + START
        while time.monotonic() < end:
            links = [link for _, link in frames_of(self._out)]
            if len(links) >= count and set(links[-count:]) == {link}:
                return
            time.sleep(0.02)
        raise AssertionError(f"the robot never had {count} frames {link}")


def frames_of(out: Path, column: str = "link") -> list[tuple[float, str]]:
    """Time and link, or another column, of each frame that a result folder tells of by now."""
    path = out / "frames.csv"
    header, *rows = path.read_text().rpartition("\n")[0].split("\n") if path.is_file() else [""]
    if not rows:
        return []
    t, asked = (header.split(",").index(name) for name in ("t", column))
    return [(float(cells[t]), cells[asked]) for cells in (row.split(",") for row in rows)]


def stopped(playing: Playing) -> tuple[float, float]:
    """The worn process stops, and goes on when the robot has gone on alone for a while."""
    playing.until("collab", 10)
    began = time.monotonic()
    playing.worn.send_signal(signal.SIGSTOP)
    try:
        playing.until("mono", 5)
    finally:
        ended = time.monotonic()
        playing.worn.send_signal(signal.SIGCONT)
    return began, ended


def dark(playing: Playing) -> tuple[float, float]:
    """Nothing passes for three seconds."""
    playing.until("collab", 10)
    began = time.monotonic()
    playing.relay.send_signal(signal.SIGUSR1)
    time.sleep(3.0)
    ended = time.monotonic()
    playing.relay.send_signal(signal.SIGUSR1)
    return began, ended


def play(
    walk: Walk,
    keys: Path,
    folder: Path,
    wire: w.Wire,
    *,
    between: Callable[[w.Wire], Any] = network,
    record: bool = False,
    trouble: Callable[[Playing], tuple[float, float]] | None = None,
) -> ScenarioOutcome:
    """A walk over a network; ``trouble`` tells when it began and ended."""
    folder.mkdir()
    to_robot = {
        "recording": str(walk.recording),
        "keys": str(keys / "robot"),
        "out": str(folder / "out"),
        "tell": str(folder / "robot.json"),
    }
    if record:
        to_robot |= {"record": str(folder / "record")}
    to_worn = {
        "recording": str(walk.recording),
        "keys": str(keys / "anna"),
        "tell": str(folder / "worn.json"),
        "offset": OFFSET,
        "drift": DRIFT,
    }
    began = ended = 0.0
    with between(wire) as net:
        worn = _end(net, "worn", to_worn)
        ends = [worn]
        try:
            assert worn.stdout is not None
            assert worn.stdout.readline() == b"up\n"
            ends.append(_end(net, "robot", to_robot))
            if trouble is not None:
                began, ended = trouble(Playing(folder / "out", worn, net.relay))
            for process in reversed(ends):
                _, said = process.communicate(timeout=90.0)
                assert process.returncode == 0, said.decode()
        finally:
            for process in ends:
                process.kill()
                process.wait()
        net.relay.send_signal(signal.SIGINT)
        counts = w.Counts(**json.loads(net.relay.communicate()[0].splitlines()[-1]))
    return _outcome(walk, folder, counts, began, ended)


def _end(net: Network, role: str, asked: dict[str, Any]) -> subprocess.Popen[bytes]:
    one_core = ["taskset", "-c", "0" if role == "robot" else str((os.cpu_count() or 1) - 1)]
    command = [*net.inside[role], *one_core, sys.executable, str(HERE / "ends.py"), role]
    asked = asked | {"host": net.hosts[role]}
    return subprocess.Popen([*command, json.dumps(asked)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def _outcome(walk: Walk, folder: Path, counts: w.Counts, began: float, ended: float) -> ScenarioOutcome:
    robot, worn = (json.loads((folder / f"{role}.json").read_text()) for role in ("robot", "worn"))
    true = dict(worn["seen"])
    arrivals = [(true[stamp], taken, came) for stamp, taken, came in robot["arrivals"] if stamp in true]
    taken, told, came = (np.array(column) for column in zip(*arrivals, strict=True))
    frames = frames_of(folder / "out")
    return ScenarioOutcome(
        out=folder / "out",
        summary=robot["summary"],
        error=position_error(folder / "out", walk.times, walk.truth),
        taken=taken,
        came=came,
        given=np.array([(true[stamp], t) for stamp, t in robot["given"] if stamp in true]).reshape(-1, 2),
        clock=told - taken,
        clock_bound=np.array([_clock_bound(robot["exchanges"], t) for t in came]),
        rate=counts.sent[1] / (max(true.values()) - min(true.values()) + 0.1),
        bytes_on_wire=counts.sent[1],
        bytes_received=robot["received"].get("anna", 0),
        frames=np.array([t for t, _ in frames]) + robot["offset"],
        collab=np.array([link == "collab" for _, link in frames]),
        lasted=np.array(robot["frames"])[:, 0],
        worked=np.array(robot["frames"])[:, 1],
        began=began,
        ended=ended,
    )


def _clock_bound(exchanges: list[tuple[float, float]], t: float) -> float:
    """What a clock can be wrong by after the questions that were answered before ``t``.

    One answer is wrong by at most half of the time that it took, and those that took long count less; the
    line through them adds at most as much again at its end, and the system's own part a millisecond.
    """
    return 1e-3 + float(np.mean([delay for came, delay in exchanges if came <= t]))
