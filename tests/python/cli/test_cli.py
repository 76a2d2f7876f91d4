"""The command line and the run behind it, with a stand-in for the engine."""

from __future__ import annotations

import argparse
import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.stand_ins import FakeSlam, Walk

from collabslam import demo
from collabslam.cli import COMMANDS, options
from collabslam.cli import main as cli
from collabslam.datasets import FirstFrames
from collabslam.datasets.opening import open_recording
from collabslam.errors import DataError, FilterError, SettingsError
from collabslam.runs import runner
from collabslam.runs.comparison import on_first
from collabslam.runs.plan import MODE_KEY, Output, Plan
from collabslam.runs.read_back import read_run
from collabslam.runs.report import median_summary, side_by_side, summary_text, untrusted_text
from collabslam.runs.summary import is_trusted
from collabslam.settings.table import Settings
from collabslam.simulation.recording import demo_recording
from collabslam.types import Frame
from collabslam.viz.plot import plot_run


def go(recording: Walk, out: Path | Output | None = None, **options):
    slam = options.pop("slam", None) or FakeSlam(recording)
    return runner.run(recording, slam=slam, out=out, **options).summary


@pytest.fixture
def _no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are slow, and the tests of the run itself need none."""
    monkeypatch.setattr("collabslam.viz.plot.plot_run", lambda result, path: None)


@pytest.fixture
def _walk_instead(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command line meets the walk and the stand-in, whatever it is asked to open."""
    monkeypatch.setattr("collabslam.datasets.source.open_given", lambda path, given: Walk())
    monkeypatch.setattr(runner, "make_engine", lambda *_: FakeSlam(Walk()))


def test_run_writes_results_and_scores_them(tmp_path: Path) -> None:
    summary = go(Walk(), Output(tmp_path, notes={"seed": 3}), mode="collab-tight")
    stored = json.loads((tmp_path / "summary.json").read_text())
    assert stored["frames"] == stored["frames_ok"] == 30
    assert stored["scale_error"] == pytest.approx(1 / 1.05 - 1, abs=1e-6)
    assert stored["options"]["seed"] == 3
    assert stored["depth_measurements"] == 45
    assert stored["overlap_ratio"] == pytest.approx(0.5)
    assert stored["ms_per_frame"]["update"] == 1.0
    assert stored["ms_per_frame"]["step"] > 0.0
    assert stored["fps"] > 0
    assert stored["settings_hash"] == summary["settings_hash"] == Settings.default().hash()
    for key in ("mode", "source", "version", "path_length_m", "ate_rmse_m", "avg_position_error_m",
                "final_position_error_m", "final_error_pct", "nees_mean", "ate_pct_all_frames", "coverage",
                "ok_share", "false_ok_share", "nees_position", "nees_attitude", "sharpness_position",
                "sharpness_attitude", "ms_p99", "ms_max"):  # fmt: skip
        assert stored[key] is not None
    assert Settings.load(tmp_path / "config.yaml") == Settings.default()
    assert is_trusted(summary)
    assert "average position error" in summary_text(summary)


def test_two_runs_write_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        go(Walk(), tmp_path / name)
    for file in (
        "trajectory.tum",
        "trajectory.cov",
        "frames.csv",
        "map.ply",
        "config.yaml",
    ):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


@pytest.mark.slow
def test_two_pictures_of_a_run_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        plot_run(runner.run(Walk(), slam=FakeSlam(Walk()), out=tmp_path / "run"), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    plot_run(read_run(tmp_path / "run"), tmp_path / "c.png")  # its files tell all that the picture shows
    a, c = (cv2.imread(str(tmp_path / name)).astype(int) for name in ("a.png", "c.png"))
    assert (np.abs(a - c).max(axis=2) > 8).mean() < 1e-3


def test_a_run_that_never_started_is_read_back(tmp_path: Path) -> None:
    """Its files of submaps have no line."""
    go(Walk(), tmp_path)
    for name in ("submaps.tum", "submaps.cov"):
        (tmp_path / name).write_text("# nothing\n")
    (tmp_path / "whole_map.ply").write_bytes((tmp_path / "map.ply").read_bytes())
    assert read_run(tmp_path).submaps.poses.shape == (0, 4, 4)
    (tmp_path / "submaps.tum").write_text("0 0 0 0 0 0 0 1\n")
    (tmp_path / "submaps.cov").write_text("0" + " 1" * 21 + "\n" + "1" + " 1" * 21 + "\n")
    with pytest.raises(DataError, match="1 poses, not 2"):
        read_run(tmp_path)


@pytest.mark.slow
def test_two_runs_stand_beside_each_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Settings.default().replace({"filter.map.in_view": 25})
    runner.run(Walk(), slam=FakeSlam(Walk()), out=tmp_path / "a")
    runner.run(Walk(), slam=FakeSlam(Walk(), scale=1.1), out=tmp_path / "b", settings=other)
    assert cli.main(["compare", str(tmp_path / "a"), str(tmp_path / "b")]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"average position error +\S+ m .* \S+ m ", printed)
    assert "filter.map.in_view: 40 and 25" in printed
    first, second = (read_run(tmp_path / name) for name in "ab")
    second, frames = on_first(first, second)
    apart = np.linalg.norm(
        second.record.poses[frames[:, 1], :3, 3] - first.record.poses[frames[:, 0], :3, 3], axis=1
    )
    assert apart[0] == pytest.approx(0.0, abs=1e-9)
    assert f"{apart.max():.3f} m at most" in printed
    assert apart[-1] > 0.1
    assert (tmp_path / "b" / "comparison.png").read_bytes().startswith(b"\x89PNG")
    assert cli.main(["compare", str(tmp_path / "a"), str(tmp_path)]) == 2


@pytest.mark.slow
def test_a_summary_that_was_changed_by_hand_is_refused_or_told(tmp_path: Path) -> None:
    """Whatever stands in the place of a number: a summary is somebody's file."""
    runner.run(Walk(), slam=FakeSlam(Walk()), out=tmp_path / "run")
    file, frames = tmp_path / "run" / "summary.json", tmp_path / "run" / "frames.csv"
    good, refused = json.loads(file.read_text()), 0
    for key in good:
        others = [{**good, key: value} for value in ("x", [1], None, {"a": 1})]
        for told in ({k: v for k, v in good.items() if k != key}, *others):
            file.write_text(json.dumps(told))
            try:
                side_by_side({"run": read_run(tmp_path / "run").summary})
            except DataError:
                refused += 1
    assert refused > len(good), "most keys are asked for, and by their kind"
    file.write_text(json.dumps(good))
    frames.write_text("")
    with pytest.raises(DataError, match="has no frames"):
        read_run(tmp_path / "run")


def test_the_doctor_says_by_its_status_what_a_folder_is_worth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    runner.run(Walk(), slam=FakeSlam(Walk()), out=folder)
    summary, frames = folder / "summary.json", folder / "frames.csv"
    good, rows = json.loads(summary.read_text()), frames.read_text().splitlines()

    def doctor(told: dict[str, object] | None, lines: list[str]) -> tuple[int, str]:
        summary.unlink(missing_ok=True)
        if told is not None:
            summary.write_text(json.dumps(told))
        frames.write_text("\n".join(lines))
        status = cli.main(["doctor", str(folder)])
        said = capsys.readouterr()
        return status, said.out + said.err

    assert doctor(good, rows)[0] == 0
    assert doctor({**good, "status_final": "LOST"}, rows)[0] == 1
    status, said = doctor({**good, "interrupted": True, "ended_by": "Ctrl-C"}, rows)
    assert (status, "ended before its recording did (Ctrl-C)" in said) == (1, True)
    damaged = [row.replace(",", ",x", 1) for row in rows]
    for told, lines, words in (
        (None, rows, "it was killed, or goes on"),
        (good, rows[:5], "has 4 frames, summary.json tells of"),
        (good, rows[:1], "has no frames"),
        (good, [], "has no frames"),
        ({}, rows, "holds nothing of a run"),
        ({**good, "worn": 3}, rows, "run the recording again"),
        (good, [rows[0], *damaged[1:]], "is damaged"),
    ):
        status, said = doctor(told, lines)
        assert status == 2, said
        assert words in said


def test_a_run_without_truth_says_what_it_knows(tmp_path: Path) -> None:
    walk = Walk()
    walk.truth = None
    summary = go(walk, slam=FakeSlam(Walk()))
    said = summary_text(summary)
    assert re.search(r"path length +[0-9.]+ m, by its own poses", said)
    assert re.search(r"duration, speed +[0-9.]+ s, [0-9.]+ m/s", said)
    assert re.search(r"worn camera Cf +in 15 of 30 frames", said)
    assert not re.search(" -$", said, re.MULTILINE)


def test_mode_and_settings_agree(tmp_path: Path) -> None:
    mono = Settings.default().replace({MODE_KEY: "mono"})
    assert go(Walk(), settings=mono)["mode"] == "mono"
    assert go(Walk(), tmp_path, mode="mono")["settings_hash"] == mono.hash()
    assert Settings.load(tmp_path / "config.yaml") == mono
    with pytest.raises(SettingsError, match="'best'"):
        go(Walk(), mode="best")


def test_a_scale_free_run_never_speaks_of_metres(tmp_path: Path) -> None:
    for start, word in (("scale-free", "an arbitrary unit"), ("worn", "metres")):
        walk = Walk()
        summary = go(walk, tmp_path / start, start=start, slam=FakeSlam(walk, scale=40.0))
        assert summary["unit"] == word
        assert f"seconds, {word};" in (tmp_path / start / "trajectory.tum").read_text().splitlines()[0]
        assert ("not metres" in summary_text(summary)) == (start == "scale-free")
        assert summary["metric"] == (start == "worn")
        arbitrary = start == "scale-free"
        assert (summary["nees_position"] is None) == (summary["ate_rmse_m"] is None) == arbitrary
        for name in ("trajectory.cov", "groundtruth.tum"):
            head = "".join((tmp_path / start / name).read_text().splitlines()[:4])
            assert word in head, name
            assert ("metres" in head) != arbitrary, name
        assert word.encode() in (tmp_path / start / "map.ply").read_bytes()[:200]


def test_max_frames_ends_the_run() -> None:
    for count, frames in ((7, 7), (700, 30)):
        assert go(FirstFrames(Walk(), count), slam=FakeSlam(Walk()))["frames"] == frames
    with pytest.raises(SettingsError, match="1 or more"):
        FirstFrames(Walk(), 0)


@pytest.mark.usefixtures("_no_picture")
def test_a_lost_camera_is_told(tmp_path: Path) -> None:
    walk = Walk()
    summary = go(walk, tmp_path, slam=FakeSlam(walk, lost_from=20))
    assert not is_trusted(summary)
    assert summary["frames_lost"] == 10
    assert len(np.loadtxt(tmp_path / "trajectory.tum", comments="#")) == 20


@pytest.mark.parametrize("scale", [1.05, 40.0])
@pytest.mark.parametrize(
    ("run", "trusted"),
    [
        ({}, True),
        ({"lost_from": 29}, False),  # it ends lost
        ({"degraded": range(29, 30)}, False),  # it ends DEGRADED
        ({"degraded": range(10, 13)}, True),
        ({"degraded": range(10, 14)}, False),  # more than a tenth
    ],
)
def test_trust_is_what_the_run_says_with_a_truth_or_without(
    run: dict[str, object], trusted: bool, scale: float
) -> None:
    known, unknown = Walk(), Walk()
    unknown.truth = None
    for walk in (known, unknown):
        assert is_trusted(go(walk, slam=FakeSlam(known, scale=scale, **run))) == trusted


def test_half_of_the_frames_must_say_ok() -> None:
    summary = {"frames": 10, "frames_ok_reported": 5, "frames_degraded": 0, "status_final": "OK"}
    assert is_trusted(summary)
    assert not is_trusted(summary | {"frames_ok_reported": 4})
    assert not is_trusted(summary | {"frames": 0, "frames_ok_reported": 0})


def test_why_a_run_is_not_trusted_is_told() -> None:
    walk = Walk()
    summary = go(walk, slam=FakeSlam(walk, scale=40.0, degraded=range(5, 30)))
    told = untrusted_text(summary)
    assert "5 of 30 frames say OK, 25 are DEGRADED: more matches are refused" in told
    assert "the last one is DEGRADED" in told
    assert "false OK (over 5 sigma off)" in summary_text(summary)


@pytest.mark.usefixtures("_no_picture")
def test_ctrl_c_keeps_what_was_done(tmp_path: Path) -> None:
    walk = Walk()
    summary = go(walk, tmp_path, slam=FakeSlam(walk, stop_at=12))
    assert summary["interrupted"]
    assert summary["frames"] == 12
    assert (tmp_path / "summary.json").exists()


def test_a_recording_that_breaks_off_leaves_the_part_before(tmp_path: Path) -> None:
    walk = Walk(breaks_at=7)
    with pytest.raises(DataError, match=r"7\.png"):
        go(walk, tmp_path)
    assert len(np.loadtxt(tmp_path / "trajectory.tum", comments="#")) == 7


def test_modes_and_starts_must_fit_the_recording() -> None:
    alone = Walk()
    alone.worn_camera = None
    settings = Settings.default()
    for mode, start, part in (
        ("mono", "magic", "start 'magic'"),
        ("collab", "scale-free", "needs a worn camera"),
        ("mono", "worn", "needs a worn camera"),
        ("mono", "target", "known target"),
    ):
        with pytest.raises(SettingsError, match=part):
            runner.make_engine(alone, Plan(mode, start, True, settings))


@pytest.mark.usefixtures("_walk_instead", "_no_picture")
def test_run_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["run", "anything", "--worn-available", "40%"]) == 0
    shown = capsys.readouterr()
    assert "walk, collab-tight, start worn" in shown.out
    assert "30/30 frames" in shown.err  # no terminal: plain lines
    stored = json.loads(Path("results/walk-collab-tight/summary.json").read_text())
    assert stored["options"]["worn_available"] == 0.4
    assert stored["frames_worn"] == 15
    assert cli.main(["run", "anything", "--worn", "none", "--out", "mono"]) == 0
    assert "the mode is mono" in capsys.readouterr().err


@pytest.mark.usefixtures("_walk_instead")
def test_bad_input_gives_2_and_says_what(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", "x", "--set", "filter.nonsense=1", "--out", str(tmp_path)]) == 2
    assert cli.main(["run", "x", "--worn", "lag:never", "--out", str(tmp_path)]) == 2
    (tmp_path / "mine.txt").write_text("mine")
    assert cli.main(["run", "x", "--out", str(tmp_path)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("collabslam: error:") == 3
    assert "no collabslam result" in errors


@pytest.mark.usefixtures("_walk_instead")
def test_a_filter_that_gives_up_gives_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise FilterError("The innovation covariance is not positive.")

    monkeypatch.setattr(FakeSlam, "step", fail)
    assert cli.main(["run", "x", "--out", str(tmp_path)]) == 1


def test_a_missing_recording_gives_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", str(tmp_path / "none")]) == 2
    assert "does not exist" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["run"],
        ["run", "x", "--mode", "best"],
        ["run", "x", "--worn-available", "140%"],
        ["run", "x", "--worn-intervals", "3"],
        ["run", "x", "--worn-noise", "1,2"],
        ["demo", "--seeds", "a"],
    ],
)
def test_words_that_are_not_understood_give_2(words: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(words)
    assert caught.value.code == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main([command, "--help"])
    assert caught.value.code == 0
    assert COMMANDS[command] in " ".join(capsys.readouterr().out.split())


def test_option_texts() -> None:
    assert options.share("40%") == pytest.approx(0.4)
    assert options.share("0.4") == pytest.approx(0.4)
    assert options.intervals("0-2,5-7.5") == [(0.0, 2.0), (5.0, 7.5)]
    assert options.noise("0.03,0.5,0.5,1") == (0.03, 0.5, 0.5, 1.0)
    assert options.seed_list("0-2") == [0, 1, 2]
    assert options.seed_list("4,1") == [4, 1]
    with pytest.raises(argparse.ArgumentTypeError):
        options.seed_list("3-1")


def test_settings_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["settings", "dump"]) == 0
    path = tmp_path / "all.yaml"
    path.write_text(capsys.readouterr().out)
    assert cli.main(["settings", "check", str(path)]) == 0
    assert Settings.default().hash() in capsys.readouterr().out
    assert cli.main(["settings", "show", "frontend."]) == 0
    assert "frontend.detect.quality" in capsys.readouterr().out
    path.write_text("frontend: {detect: {qualty: 3}}\n")
    assert cli.main(["settings", "check", str(path)]) == 2
    assert "quality" in capsys.readouterr().err


def test_help_needs_no_heavy_import() -> None:
    code = "import sys; from collabslam.cli import main as cli; print([m for m in %r if m in sys.modules])"
    heavy = ("numpy", "cv2", "matplotlib", "yaml", "tqdm", "collabslam._core")
    done = subprocess.run([sys.executable, "-c", code % (heavy,)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    subprocess.run([sys.executable, "-m", "collabslam", "run", "--help"], capture_output=True, check=True)


@pytest.mark.usefixtures("_no_picture")
def test_demo_runs_both_modes_on_one_rendering(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rendered = []

    class Counted(Walk):
        def frame(self, i: int) -> Frame:
            rendered.append(i)
            return super().frame(i)

    scales = {"mono": 1.4, "collab": 1.1}
    monkeypatch.setattr(demo, "demo_recording", lambda seed: Counted())
    monkeypatch.setattr(
        runner, "make_engine", lambda recording, plan, map, printed: FakeSlam(Walk(), scale=scales[plan.mode])
    )
    medians = demo.run_demo(tmp_path, seeds=[0], progress=False)
    assert rendered == list(range(30))
    assert medians["collab"]["avg_position_error_m"] < medians["mono"]["avg_position_error_m"]
    assert "collab over mono: 0.25" in capsys.readouterr().out
    assert (tmp_path / "comparison.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "mono" / "summary.json").exists()


@pytest.mark.usefixtures("_no_picture")
def test_demo_of_several_seeds_gives_medians(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("collabslam.viz.plot.plot_comparison", lambda *_, **__: None)
    monkeypatch.setattr(demo, "demo_recording", lambda seed: Walk())
    monkeypatch.setattr(runner, "make_engine", lambda *_: FakeSlam(Walk()))
    demo.run_demo(tmp_path, seeds=[0, 1], progress=False)
    assert (tmp_path / "seed-1" / "collab" / "summary.json").exists()
    assert (tmp_path / "medians.json").exists()


def test_demo_writes_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = demo_recording(3)
    seeds = []

    def first_of(seed: int) -> FirstFrames:
        seeds.append(seed)
        return FirstFrames(whole, 3)

    monkeypatch.setattr("collabslam.simulation.recording.demo_recording", first_of)
    out = tmp_path / "walk"
    assert cli.main(["demo", "--seed", "3", "--recording", str(out)]) == 0
    assert f"3 frames are in {out}" in capsys.readouterr().out
    assert seeds == [3]
    written = open_recording(out)
    assert len(written) == 3
    for i in range(3):
        frame, made = written.frame(i), whole.frame(i)
        np.testing.assert_array_equal(frame.image, made.image)
        assert len(frame.views) == len(made.views)
        for view in frame.views:
            np.testing.assert_array_equal(view.bias, np.zeros((6, 6)))  # nothing lasts, and it says so
    assert cli.main(["demo", "--seeds", "0-1", "--recording", str(tmp_path / "other")]) == 2
    assert "it takes --seed" in capsys.readouterr().err


def test_medians_are_over_the_runs_that_have_the_number() -> None:
    base = {"name": "a", "flag": True, "ms_per_frame": {"step": 1.0}, "frames": 3}
    runs = [{**base, "x": 1.0}, {**base, "x": 5.0}, {**base, "x": None}]
    assert median_summary(runs)["x"] == 3.0
    assert median_summary(runs)["frames"] == 3


def test_no_recording_is_opened_without_a_word() -> None:
    """It may take long: wherever a command opens one, or draws, it says so after a moment."""
    for path in Path(str(options.__file__)).parent.glob("*.py"):
        tree = ast.parse(path.read_text())
        told = {
            inner
            for node in ast.walk(tree)
            if isinstance(node, ast.With) and any("busy(" in ast.unparse(item) for item in node.items)
            for inner in ast.walk(node)
        }
        for node in ast.walk(tree):
            name = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            opens = (name.endswith(".open") and name != "os.open") or name in (
                "open_recording",
                "open_camera",
            )
            if opens or name.startswith("plot_"):
                assert node in told, f"{path.name}:{node.lineno}"


def test_without_a_command_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        cli.main([])
    assert left.value.code == 0
    shown = capsys.readouterr().out
    assert all(command in shown for command in COMMANDS)
