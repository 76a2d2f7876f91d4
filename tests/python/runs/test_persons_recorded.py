"""Several persons from a file to the results: views, trajectory and numbers of each, alone and together."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.clip import GLOBAL_SHUTTER, Clip

from collabslam import DataError, InputError, RecordingWriter, Settings, SettingsError, open_recording
from collabslam.checks.board import board_poses
from collabslam.checks.calibration import check_calibration, check_persons
from collabslam.checks.doctor import diagnose
from collabslam.checks.worn_bias.recorded import time_correlated_error
from collabslam.cli import main as cli
from collabslam.datasets import attach_worn, write_recording
from collabslam.datasets.poses import read_track
from collabslam.datasets.ros.writer import topics_of, write_bag
from collabslam.datasets.source import Source
from collabslam.datasets.worn_calibration import CalibratedWorn, WornCalibration
from collabslam.formats.trajectory import read_covariances
from collabslam.runs import runner
from collabslam.runs.plan import Output
from collabslam.runs.run_folder import RunFolder
from collabslam.targets.kinds import Board
from collabslam.types import Frame, WornView, worn_cameras
from collabslam_lab.switches import with_switches

FRAMES = 8
BENS = [0, 4, 6]
"""Frames in which a view of Ben's is used."""
LINES = ("trajectory.tum", "trajectory.cov", "worn-anna.tum", "worn-anna.cov", "worn-ben.tum", "worn-ben.cov")


def views(frame: Frame) -> list[WornView]:
    """Anna sees what the clip's worn camera sees; Ben the same in every second frame, by his own clock.

    His first view between two frames is lost: until then no poses were kept for such.
    """
    assert frame.views
    taken = frame.t - 0.001 if frame.index else None
    ben = replace(frame.views[0], who="ben", t=taken, bias=0.5 * frame.views[0].covariance)
    return [replace(frame.views[0], who="anna"), *([ben] if frame.index % 2 == 0 else [])]


@pytest.fixture(scope="module")
def folder(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two persons on disk."""
    base = clip.recording
    out = tmp_path_factory.mktemp("persons") / "walk"
    with RecordingWriter(out, base.camera, dict.fromkeys(("anna", "ben"), base.worn_camera)) as writer:
        for frame in clip.frames[:FRAMES]:
            writer.add(frame.t, frame.image, views(frame), truth=base.truth[frame.index])
    return out


@pytest.fixture(scope="module")
def finished(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of it."""
    out = tmp_path_factory.mktemp("run") / "all"
    assert cli.main(["run", str(folder), "--out", str(out)]) == 0
    return out


def test_what_is_written_is_read_again(clip: Clip, folder: Path) -> None:
    read = open_recording(folder)
    assert list(worn_cameras(read)) == ["anna", "ben"]
    assert repr(read.worn_camera) == repr(clip.recording.worn_camera)
    for frame in clip.frames[:FRAMES]:
        again, given = read.frame(frame.index).views, views(frame)
        assert [view.who for view in again] == [view.who for view in given]
        for one, two in zip(again, given, strict=True):
            np.testing.assert_array_equal(one.image, two.image)
            np.testing.assert_allclose(one.t_cf, two.t_cf, atol=1e-12)
            np.testing.assert_array_equal(one.covariance, two.covariance)
            np.testing.assert_array_equal(one.bias, two.bias)
            assert one.t == (None if two.t is None else pytest.approx(two.t, abs=1e-9))


def test_written_again_it_is_the_same_to_the_byte(folder: Path, tmp_path: Path) -> None:
    again = write_recording(open_recording(folder), tmp_path / "again")
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(again) for path in again.rglob("*") if path.is_file())
    assert Path("worn/ben/relpose.csv") in files
    for path in files:
        assert (again / path).read_bytes() == (folder / path).read_bytes()


@pytest.mark.slow
def test_each_has_a_trajectory_with_covariance(clip: Clip, folder: Path, finished: Path) -> None:
    """Whose poses are those of the worn cameras in truth, as far as the filter claims."""
    poses = RunFolder(finished).trajectory()
    assert len(poses[0]) == FRAMES
    for name, frames in (("anna", list(range(FRAMES))), ("ben", BENS)):
        times, track = read_track(finished / f"worn-{name}.tum")
        _, spread = read_covariances(finished / f"worn-{name}.cov")
        off = np.where(times > 0.0, 0.001, 0.0) if name == "ben" else 0.0
        np.testing.assert_allclose(times + off, poses[0][frames], atol=1e-6)
        sd = np.sqrt(np.trace(spread[:, :3, :3], axis1=1, axis2=2))
        for k, (i, t_wf) in enumerate(zip(frames, track, strict=True)):
            origin = poses[1][0] @ np.linalg.inv(clip.recording.truth[0])
            true = origin @ clip.recording.truth[i] @ clip.recording.true_t_cf(i)
            assert np.linalg.norm(t_wf[:3, 3] - true[:3, 3]) < 4.0 * sd[k] + 0.01
    assert "worn camera of ben" in (finished / "worn-ben.tum").read_text().splitlines()[0]
    assert "worn-ben.tum" in (finished / "worn-ben.cov").read_text().splitlines()[0]


def test_the_numbers_of_each_are_told(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames, summary = RunFolder(finished).frames(), RunFolder(finished).summary()
    assert all(int(row["worn_anna"]) > 8 for row in frames)
    assert [k for k, row in enumerate(frames) if row["worn_ben"] != ""] == BENS
    told = {of["name"]: of for of in summary["worn"]}
    assert (told["anna"]["views"], told["ben"]["views"]) == (FRAMES, len(BENS))
    assert told["ben"]["measured"] == len(BENS)
    assert told["ben"]["matches"] > 8.0
    assert cli.main(["run", "--resume", str(finished)]) == 0  # which prints the summary of a finished run
    assert "worn camera of anna" in capsys.readouterr().out


def test_one_of_them_is_chosen(folder: Path, tmp_path: Path) -> None:
    assert cli.main(["run", str(folder), "--worn", "recorded:ben", "--out", str(tmp_path / "ben")]) == 0
    summary = json.loads((tmp_path / "ben" / "summary.json").read_text())
    assert [of["name"] for of in summary["worn"]] == ["ben"]
    assert not (tmp_path / "ben" / "worn-anna.tum").exists()
    with pytest.raises(SettingsError, match=r"'clara'.*'anna', 'ben'"):
        attach_worn(open_recording(folder), "recorded:ben,clara")


def test_a_calibration_is_given_to_each_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    twice = [word for file in ("a.yaml", "b.yaml") for word in ("--worn-calibration", f"anna={file}")]
    assert cli.main(["run", str(folder), *twice]) == 2
    assert "twice for anna" in capsys.readouterr().err


@pytest.mark.slow
def test_two_see_more_than_one(folder: Path) -> None:
    # Without map drift: it goes by the innovations of a few frames, of which two persons' are other ones.
    settings = with_switches(Settings.default().replace(GLOBAL_SHUTTER), {"filter.process.map_drift": 0.0})
    recordings = open_recording(folder), attach_worn(open_recording(folder), "recorded:ben")
    both, alone = (runner.run(each, settings=settings).record.covariances[-1] for each in recordings)
    assert np.linalg.slogdet(both)[1] < np.linalg.slogdet(alone)[1]


@pytest.mark.parametrize("stop", [1, 5])
def test_a_run_that_was_stopped_ends_as_one_that_was_not(
    folder: Path, finished: Path, tmp_path: Path, stop: int
) -> None:
    done: list[Frame] = []

    def stopping(frame: Frame, *_: object) -> None:
        done.append(frame)
        if len(done) == stop:
            raise KeyboardInterrupt

    output = Output(tmp_path / "run", checkpoint_every=2, reopen=Source(folder))
    assert runner.run(Source(folder), out=output, watch=stopping).summary["interrupted"]
    runner.resume(tmp_path / "run")
    for name in LINES:
        assert (tmp_path / "run" / name).read_bytes() == (finished / name).read_bytes(), name
    summaries = [RunFolder(where).summary()["worn"] for where in (tmp_path / "run", finished)]
    assert summaries[0] == summaries[1]


@pytest.mark.slow
def test_results_of_other_persons_are_removed(folder: Path, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    for names in ("anna,ben", "anna"):
        recording = attach_worn(open_recording(folder), f"recorded:{names}")
        runner.run(recording, out=Output(out, overwrite=True))
    assert sorted(path.name for path in out.glob("worn*")) == ["worn-anna.cov", "worn-anna.tum"]


def test_a_bag_has_topics_of_each(folder: Path, tmp_path: Path) -> None:
    recording = open_recording(folder)
    write_bag(recording, tmp_path / "bag")
    topics = topics_of(worn_cameras(recording))
    assert topics["cf.ben"] == "/cf/ben/image_raw"
    read = open_recording(tmp_path / "bag", topics=topics)
    assert list(worn_cameras(read)) == ["anna", "ben"]
    for i in range(FRAMES):
        one, two = recording.frame(i).views, read.frame(i).views
        assert [view.who for view in one] == [view.who for view in two]
        for a, b in zip(one, two, strict=True):
            np.testing.assert_array_equal(a.image, b.image)
            np.testing.assert_allclose(a.t_cf, b.t_cf, atol=1e-9)
    with pytest.raises(DataError, match=r"no topic's role 't_cf.clara'"):
        open_recording(tmp_path / "bag", topics={**topics, "t_cf.clara": "/t_cf/anna"})
    with pytest.raises(DataError, match=r"give cf.NAME"):
        open_recording(tmp_path / "bag", topics={**topics, "cf": "/cf/anna/image_raw"})


def test_the_clock_and_the_pose_of_one_are_corrected(folder: Path) -> None:
    correction = WornCalibration(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros((6, 6)), clock=0.01)
    base = open_recording(folder)
    moved = CalibratedWorn(base, correction, "ben")
    here, there = ({view.who: view for view in r.frame(3).views} for r in (base, moved))
    np.testing.assert_array_equal(here["anna"].t_cf, there["anna"].t_cf)
    assert set(here) == {"anna"}
    assert set(there) == {"anna", "ben"}  # taken with frame 2, 1 ms before it, and really 9 ms after it
    assert there["ben"].t == pytest.approx(base.times[2] + 0.009, abs=1e-6)
    with pytest.raises(SettingsError, match=r"say whose, as NAME=FILE"):
        CalibratedWorn(base, correction)


@pytest.mark.slow
def test_the_calibration_of_each_is_checked(folder: Path, tmp_path: Path) -> None:
    reports = check_persons(open_recording(folder))
    assert list(reports) == ["anna", "ben"]
    assert all(report.worn.residual is not None for report in reports.values())
    assert reports["anna"].by_gap == reports["ben"].by_gap
    assert cli.main(["check-calib", str(folder), "--write", str(tmp_path / "worn.yaml")]) == 2
    for ask in (
        check_calibration,
        time_correlated_error,
        lambda recording: board_poses(recording, Board(9, 6, 0.1)),
    ):
        with pytest.raises(SettingsError, match="recorded:anna"):
            ask(open_recording(folder))


def test_the_doctor_names_who_does_not_help(finished: Path, tmp_path: Path) -> None:
    for path in finished.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert not any("ben" in line for line in diagnose(RunFolder(tmp_path)))
    summary["worn"][1]["measured"] = 0
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    assert any("ben" in line and "check-calib" in line for line in diagnose(RunFolder(tmp_path)))


def bad(header: dict[str, object]) -> object:
    return yaml.safe_dump({"format": "collabslam-recording", "version": 2, "name": "walk", **header})


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({}, "names no persons"),
        ({"worn": []}, "names no persons"),
        ({"worn": {"anna": "cam1"}}, "names no persons"),
        ({"worn": ["anna", "anna"]}, "names no persons"),
        ({"worn": ["../anna"]}, "cannot be called"),
        ({"worn": [["anna"]]}, "cannot be called"),
        ({"worn": ["clara"]}, "clara"),
        ({"version": 3}, "update"),
    ],
)
def test_a_header_that_names_nobody_is_refused(
    folder: Path, tmp_path: Path, header: dict[str, object], message: str
) -> None:
    for path in folder.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "recording.yaml").unlink()
    (tmp_path / "recording.yaml").write_text(str(bad(header)))
    with pytest.raises(DataError, match=message):
        open_recording(tmp_path)


def test_who_cannot_be_written_is_refused(clip: Clip, tmp_path: Path) -> None:
    base, frame = clip.recording, clip.frames[0]
    cameras = dict.fromkeys(("anna", "ben"), base.worn_camera)
    for names in (("a/b",), ("", "ben")):
        with pytest.raises(InputError, match="cannot be called"):
            RecordingWriter(tmp_path / "bad", base.camera, dict.fromkeys(names, base.worn_camera))
    with RecordingWriter(tmp_path / "walk", base.camera, cameras) as writer:
        anna = views(frame)[0]
        wrong: list[tuple[Sequence[WornView], str]] = [
            ([anna, anna], "given twice"),
            ([replace(anna, who="clara")], "'clara'"),
            ([replace(anna, who="")], "no worn_camera"),
        ]
        for given, message in wrong:
            with pytest.raises(InputError, match=message):
                writer.add(frame.t, frame.image, given)
        writer.add(frame.t, frame.image, [anna])
    read = open_recording(tmp_path / "walk")
    assert list(worn_cameras(read)) == ["anna", "ben"]  # Ben's camera is known, of which there is no view
    assert [view.who for view in read.frame(0).views] == ["anna"]
