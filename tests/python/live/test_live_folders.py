"""Result folders of live runs that go on: damaged ones are told, and a robot goes on from its first frame."""

from __future__ import annotations

import shutil
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("zenoh", reason="the extra live is not installed")

from helpers.in_step import InStep
from helpers.waiting import until

from collabslam import Camera, DataError, Settings, Slam
from collabslam.cli.drawn import draw
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.live import link
from collabslam.live.downlink import STATUS_EVERY, Downlink
from collabslam.live.link import Address
from collabslam.live.pictures import Pictures
from collabslam.live.record import EventWriter
from collabslam.live.results import ENGINE, LiveResults, written_frames
from collabslam.live.robot import RobotNode, RobotOptions, check_cameras
from collabslam.runs.read_back import read_run
from collabslam.types import Frame, Image
from collabslam_lab.reliability.attacks.live_folders import DAMAGES

FRAMES = 4


class Alone(WrappedRecording):
    """Cs alone, from one frame of the clip to another."""

    worn_camera = None

    def __init__(self, clip: Clip, first: int = 0, camera: Camera | None = None) -> None:
        super().__init__(clip.recording)
        self.worn_camera = None
        self.camera = camera or clip.recording.camera
        self._frames = clip.frames[first : first + FRAMES]
        self.times = np.array([f.t for f in self._frames])

    def __len__(self) -> int:
        return len(self._frames)

    def frame(self, i: int) -> Frame:
        return Frame(i, self._frames[i].t, self._frames[i].image)

    def image(self, i: int) -> Image:
        return self._frames[i].image


def drive(recording: Alone, out: Path, **options: Any) -> dict[str, Any]:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = Address("127.0.0.1", s.getsockname()[1])
    asked = RobotOptions(out, Settings.default(), mode="mono", start="scale-free", **options)
    with link.open_robot(address, None) as session:
        played = InStep(recording)
        node = RobotNode(session, played, asked)
        played.follow(node)
        return node.run()


@pytest.fixture(scope="module")
def driven(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("live") / "out"
    assert drive(Alone(clip), out)["frames"] == FRAMES
    return out


def test_a_run_goes_on(clip: Clip, driven: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(driven, tmp_path / "out"))
    assert drive(Alone(clip, FRAMES), out, resume=True)["frames"] == 2 * FRAMES
    columns, count, last = written_frames(out / "frames.csv")
    assert count == 2 * FRAMES
    assert last == clip.frames[2 * FRAMES - 1].t
    assert "session" in columns


@pytest.mark.parametrize("name", list(DAMAGES))
def test_a_damaged_folder_is_told(clip: Clip, driven: Path, tmp_path: Path, name: str) -> None:
    out = Path(shutil.copytree(driven, tmp_path / "out"))
    DAMAGES[name](out)
    mine = tmp_path / "mine"
    before = mine.read_bytes() if mine.exists() else b""
    with pytest.raises(DataError):
        drive(Alone(clip, FRAMES), out, resume=True)
    assert (mine.read_bytes() if mine.exists() else b"") == before


@pytest.mark.parametrize("line", [b"x y z\n", b"\n", b"nan 1 2\n", b"\xff\n"])
def test_damaged_tracks_of_worn_cameras_are_told(clip: Clip, tmp_path: Path, line: bytes) -> None:
    settings = Settings.default()
    LiveResults(tmp_path, settings, "metres", persons=["anna"]).close()
    for name in ("worn-anna.tum", "worn-anna.cov"):
        with (tmp_path / name).open("ab") as file:
            file.write(line)
    with pytest.raises(DataError):
        LiveResults(tmp_path, settings, "metres", persons=["anna"], resumed=True)


@pytest.mark.parametrize("name", ["../anna", "a\nb", "a/b"])
def test_nobody_of_an_engine_is_called_as_a_place(clip: Clip, name: str, tmp_path: Path) -> None:
    slam = Slam(clip.recording.camera, {"anna": clip.recording.camera})
    slam._parts.worn_cameras = {name: clip.recording.camera}
    slam.save(tmp_path / ENGINE)
    with pytest.raises(DataError, match="called"):
        Slam.load(tmp_path / ENGINE)


def test_another_calibration_is_told(clip: Clip, driven: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(driven, tmp_path / "out"))
    c = clip.recording.camera
    other = Camera(c.model, c.width, c.height, [1.1 * c.intrinsics[0], *c.intrinsics[1:]], c.distortion)
    with pytest.raises(DataError, match="other calibrations \\(Cs\\)"):
        drive(Alone(clip, FRAMES, other), out, resume=True)
    slam = Slam(c, {"anna": c, "ben": c})
    with pytest.raises(DataError, match="\\(Cf anna, Cf clara\\)"):
        check_cameras(slam, c, {"ben": c, "clara": c, "anna": other}, out)


def test_a_robot_goes_on_from_its_first_frame(clip: Clip, tmp_path: Path) -> None:
    """As the folder is when it is killed before any checkpoint was due."""
    killed = tmp_path / "killed"

    def copied(results: LiveResults, slam: Slam) -> None:
        if not killed.exists():
            shutil.copytree(results.folder, killed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LiveResults, "checkpoint", copied)
        drive(Alone(clip), tmp_path / "out")
    assert written_frames(killed / "frames.csv")[1] == 1
    assert drive(Alone(clip, FRAMES), killed, resume=True)["frames"] == 1 + FRAMES


@pytest.mark.parametrize("what", ["frame", "checkpoint", "write", "finish"])
def test_a_full_disk_does_not_take_the_pose(clip: Clip, tmp_path: Path, what: str) -> None:
    """Frames are done and told to the end, and the end says what was not written."""
    told: list[float] = []

    def full(*_: object) -> None:
        raise DataError("The disk is full.")

    def counted(self: Downlink, pose: Any, *_: object) -> None:
        told.append(pose.step.t)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EventWriter if what == "write" else LiveResults, what, full)
        patch.setattr(Downlink, "frame", counted)
        with pytest.raises(DataError, match="full"):
            drive(Alone(clip), tmp_path / "out", record=tmp_path / "record")
    assert told == [f.t for f in clip.frames[:FRAMES]]
    if what != "finish":
        assert "not written" in (tmp_path / "out" / "summary.json").read_text()


def test_a_robot_whose_workers_are_slow_to_come_up_is_not_silent(clip: Clip, tmp_path: Path) -> None:
    told: list[str] = []

    def slow(_: Pictures) -> None:
        assert until(lambda: len(told) >= 3)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Pictures, "wait", slow)
        patch.setattr(Downlink, "waits", lambda _, now, what: told.append(what))
        drive(Alone(clip), tmp_path / "out")
        before = len(told)
        time.sleep(2 * STATUS_EVERY)
    assert set(told) == {"its own start"}
    assert len(told) == before  # the frames' own status comes after it


def test_an_earlier_runs_checkpoint_does_not_outlive_it(driven: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(driven, tmp_path / "out"))
    LiveResults(out, Settings.default(), "metres").close()
    assert not (out / ENGINE).exists()
    assert not (out / "summary.json").exists()


def test_a_live_run_is_drawn_from_its_files(clip: Clip, tmp_path: Path) -> None:
    summary = drive(Alone(clip), tmp_path / "live")
    read = read_run(tmp_path / "live")
    assert len(read.record) == summary["frames"] == FRAMES
    assert read.summary["mode"] == "mono"
    draw(tmp_path / "live")
    assert (tmp_path / "live" / "trajectory.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "live" / "trajectory.cov").write_text("")
    (tmp_path / "live" / "trajectory.tum").write_text("")
    assert not np.isfinite(read_run(tmp_path / "live").record.covariances).any()
    draw(tmp_path / "live")  # of a run that never started there is a picture, too
    (tmp_path / "live" / "frames.csv").write_text("index,t\n0,1\n")
    with pytest.raises(DataError, match="is damaged"):
        read_run(tmp_path / "live")
