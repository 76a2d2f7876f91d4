"""How a run ends, and what it leaves: errors, signals, faults, closed pipes, impossible places."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip, Short
from helpers.stand_ins import FakeSlam, Walk
from helpers.waiting import until

from collabslam import Output, SavedMap, resume, run
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.errors import DataError
from collabslam.formats import container
from collabslam.runs import runner
from collabslam.runs.checkpoint import KIND, VERSION
from collabslam.runs.results import CHECKPOINT, SUMMARY, TRACEBACK
from collabslam.slam.saving import CLASSES
from collabslam_lab.cli import main as lab_cli
from collabslam_lab.reliability.kills import compare_results

PROGRAM = [sys.executable, "-m", "collabslam"]
HELD = """
import sys, time
from pathlib import Path
from collabslam import Slam
from collabslam.cli.main import main

def held(slam, *arguments, step=Slam.step):
    while frames.is_file() and frames.read_bytes().count(b"\\n") > 3 and not signalled.exists():
        time.sleep(0.01)
    return step(slam, *arguments)

out = Path(sys.argv[-1])
frames, signalled = out / "frames.csv", out.with_name("signalled")
Slam.step = held
sys.exit(main(sys.argv[1:]))
"""
"""The program, whose fourth frame lasts until a file says that it has been sent a signal."""


@pytest.fixture(scope="module")
def walk(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(Short(clip), tmp_path_factory.mktemp("endings") / "walk")


def spoil(recording: Path, frame: int) -> tuple[Path, bytes]:
    """Break the image of a frame; the file and what it held."""
    path = sorted((recording / "cam0" / "data").iterdir(), key=lambda p: int(p.stem))[frame]
    image = path.read_bytes()
    path.write_bytes(b"broken")
    return path, image


@pytest.mark.slow
def test_a_bad_datum_leaves_what_an_interrupt_leaves(clip: Clip, tmp_path: Path) -> None:
    out, map_file = tmp_path / "out", tmp_path / "walk.map"
    with pytest.raises(DataError, match="disk is gone") as caught:
        run(Short(clip, ends=8), mode="collab", out=Output(out, save_map=map_file))
    summary = json.loads((out / SUMMARY).read_text())
    assert summary["interrupted"]
    assert summary["ended_by"] == "The disk is gone."
    assert summary["frames"] == 8
    assert caught.value.result.summary["frames"] == 8
    assert caught.value.result.folder == out
    assert (out / "map.ply").is_file()
    assert len(SavedMap.load(map_file).landmarks) > 10
    # and it goes on from there, to the bit
    whole = run(Short(clip), mode="collab", out=tmp_path / "whole")
    resumed = resume(out, Short(clip), save_map=tmp_path / "end.map")
    assert compare_results(tmp_path / "whole", out) == []
    assert len(resumed.record) == len(whole.record)
    assert len(SavedMap.load(tmp_path / "end.map").landmarks) > 10


@pytest.mark.slow
def test_the_command_says_so_and_returns_2(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, image = spoil(walk, 6)
    try:
        assert cli.main(["run", str(walk), "--out", str(tmp_path / "out")]) == 2
    finally:
        path.write_bytes(image)
    shown = capsys.readouterr()
    assert "interrupted after 6 frames" in shown.out
    assert f"--resume {tmp_path / 'out'}" in shown.out
    assert path.name in shown.err
    assert cli.main(["run", "--resume", str(tmp_path / "out")]) == 0


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_signals_wait_for_the_end_of_the_frame(
    walk: Path, tmp_path: Path, number: signal.Signals, status: int
) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-c", HELD, "run", str(walk), "--out", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    frames = out / "frames.csv"
    assert until(lambda: frames.is_file() and frames.read_bytes().count(b"\n") > 3)
    process.send_signal(number)
    (tmp_path / "signalled").touch()
    _, said = process.communicate()
    assert process.returncode == status, said.decode()
    summary = json.loads((out / SUMMARY).read_text())
    assert summary["interrupted"]
    assert (out / "map.ply").is_file()
    rows = frames.read_text().splitlines()
    assert len(rows) == 1 + summary["frames"]
    assert (out / CHECKPOINT).is_file()


def test_a_library_run_is_stopped_by_ctrl_c_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who handles SIGTERM in a program of one's own is that program's affair."""
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        seen = []
        run(Walk(2), slam=FakeSlam(Walk(2)), watch=lambda *_: seen.append(signal.getsignal(signal.SIGTERM)))
        assert set(seen) == {signal.SIG_DFL}
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("place", ["file/below.map", "folder", "pipe"])
def test_places_are_tried_before_the_first_frame(clip: Clip, tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    seen: list[int] = []
    with pytest.raises(DataError, match="cannot be written"):
        run(
            Short(clip),
            out=Output(tmp_path / "out", save_map=tmp_path / place),
            watch=lambda frame, *_: seen.append(frame.index),
        )
    assert seen == []
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize("words", [["run", "LONG"], ["info", "LONG"], ["run", "WALK", "--out", "LONG"],
                                   ["run", "WALK", "--save-map", "LONG"], ["record", "WALK", "LONG"],
                                   ["run", "--resume", "LONG"], ["init", "LONG"]])  # fmt: skip
def test_what_the_system_refuses_is_no_fault_of_ours(
    walk: Path, tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    long = str(tmp_path / ("a" * 5000))
    words = [{"WALK": str(walk), "LONG": long}.get(word, word) for word in words]
    out = (
        [] if "--out" in words or words[0] != "run" or "--resume" in words else ["--out", str(tmp_path / "o")]
    )
    assert cli.main([*words, *out]) == 2
    assert "File name too long" in capsys.readouterr().err


@pytest.mark.slow
def test_the_checkpoint_goes_last(clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: SavedMap, path: Path) -> None:
        raise DataError("The disk is full.")

    out = Output(tmp_path / "out", save_map=tmp_path / "a.map", checkpoint_every=100)
    with monkeypatch.context() as patch:
        patch.setattr(SavedMap, "save", full)
        with pytest.raises(DataError, match="disk is full"):
            run(Short(clip), mode="collab", out=out)
    assert (tmp_path / "out" / CHECKPOINT).is_file()
    resume(tmp_path / "out", Short(clip), save_map=tmp_path / "a.map")
    assert len(SavedMap.load(tmp_path / "a.map").landmarks) > 10
    assert not (tmp_path / "out" / CHECKPOINT).exists()


def test_a_checkpoint_names_no_file_that_is_written(clip: Clip, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(DataError):
        run(Short(clip, ends=4), mode="collab", out=Output(out, save_map=tmp_path / "first.map"))
    content = container.read_container(out / CHECKPOINT, KIND, VERSION, CLASSES)
    assert "first.map" not in repr(content)
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for place in ("plan", "reopen"):
        hostile = {**content, place: {**(content[place] or {}), "save_map": str(victim)}}
        container.write_container(out / CHECKPOINT, KIND, VERSION, hostile, CLASSES)
        with pytest.raises(DataError, match="holds no checkpoint"):
            resume(out, Short(clip))
    assert victim.read_text() == "mine"


@pytest.mark.parametrize("main", [cli.main, lab_cli.main])
def test_a_fault_of_ours_is_told_as_one(
    main: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise KeyError("nobody expected this")

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("collabslam.datasets.source.open_given", broken)
    monkeypatch.setattr("collabslam_lab.benchmark.evaluate.evaluate", broken)
    words = ["run", "x"] if main is cli.main else ["evaluate", "x"]
    assert main(words) == 3  # type: ignore[operator]
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "KeyError: 'nobody expected this'" in said
    assert "report" in said
    (kept,) = tmp_path.glob("collabslam-traceback-*.txt")
    assert str(kept) in said
    assert "in broken" in kept.read_text()
    assert main([words[0], "--debug", *words[1:]]) == 3  # type: ignore[operator]
    assert "Traceback" in capsys.readouterr().err


def test_a_fault_in_a_run_is_kept_beside_its_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Broken(FakeSlam):
        def step(self, *arguments: object) -> object:
            if self._frame == 5:
                raise ZeroDivisionError
            return super().step(*arguments)

    monkeypatch.setattr("collabslam.datasets.source.open_given", lambda path, given: Walk())
    monkeypatch.setattr(runner, "make_engine", lambda *_: Broken(Walk()))
    assert cli.main(["run", "x", "--out", str(tmp_path / "out")]) == 3
    assert str(tmp_path / "out" / TRACEBACK) in capsys.readouterr().err
    assert "ZeroDivisionError" in (tmp_path / "out" / TRACEBACK).read_text()
    assert len(np.loadtxt(tmp_path / "out" / "trajectory.tum", comments="#")) == 5


@pytest.mark.slow
@pytest.mark.parametrize("words", [["settings", "show"], ["--help"], ["settings", "check", "/nowhere"]])
def test_closed_pipes_are_quiet(words: list[str]) -> None:
    expected = subprocess.run([*PROGRAM, *words], capture_output=True, check=False).returncode
    for closed in ("stdout", "stderr"):
        ours, theirs = os.pipe()
        os.close(ours)
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, closed: theirs}
        done = subprocess.run([*PROGRAM, *words], check=False, text=True, **streams)  # type: ignore[call-overload]
        os.close(theirs)
        assert done.returncode == expected
        assert "Traceback" not in f"{done.stdout}{done.stderr}"
        assert "Broken" not in f"{done.stdout}{done.stderr}"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs a shell that closes descriptors")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_streams_that_were_closed_before_are_quiet(closed: str) -> None:
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh"]
    for words, expected in ((["settings", "show"], 0), (["settings", "check", "/nowhere"], 2)):
        done = subprocess.run([*shell, *PROGRAM, *words], capture_output=True, check=False, text=True)
        assert done.returncode == expected, words
        assert "Traceback" not in f"{done.stdout}{done.stderr}"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs a full device")
def test_output_that_cannot_be_written_is_told() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*PROGRAM, "settings", "show"], check=False, stdout=full, stderr=subprocess.PIPE
        )
        assert done.returncode == 2
        assert b"The output cannot be written (No space left on device)" in done.stderr
        quiet = subprocess.run(
            [*PROGRAM, "settings", "show"], check=False, stdout=subprocess.PIPE, stderr=full
        )
        assert quiet.returncode == 0
        bad = subprocess.run([*PROGRAM, "settings", "check", "/nowhere"], check=False, stderr=full)
        assert bad.returncode == 2
