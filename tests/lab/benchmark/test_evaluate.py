"""Plans, runs that are resumed, and the pages that are made of them, on short rendered recordings."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip, Short
from helpers.plans import PLAN
from helpers.waiting import LONGEST

from collabslam.datasets import write_recording
from collabslam.errors import DataError, SettingsError
from collabslam.evaluation.metrics import ate_rmse
from collabslam.settings.table import Settings
from collabslam_lab.benchmark import (
    ablation,
    accuracy,
    altered,
    blackout,
    descriptors,
    figures,
    leave_one_out,
    overall,
    pairs,
    replay,
    running,
)
from collabslam_lab.benchmark.evaluate import Choice, chosen, evaluate
from collabslam_lab.benchmark.figures import NAMES
from collabslam_lab.benchmark.leave_one_out import Candidates
from collabslam_lab.benchmark.plan import find_plan, parse_plan
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.cli import main as lab
from collabslam_lab.intervals import t_interval
from collabslam_lab.program import code_hash
from collabslam_lab.switches import with_switches


@pytest.fixture(scope="module")
def place(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    write_recording(Short(clip, 7), folder / "walk")
    (folder / "broken").mkdir()
    (folder / "evaluate.yaml").write_text(PLAN)
    return folder


def row(name: str, mode: str, seed: int = 0, **numbers: Any) -> Row:
    base = {"recording": name, "mode": mode, "seed": seed, "bias_per_block": False, "status": "done",
            "independent": False, "ate_pct": 0.9,
            "ate_pct_all_frames": 1.0, "ate_alignment": "SE(3)", "coverage": 0.97, "ate_sim3_pct": 0.6,
            "false_ok_share": 0.004, "sharpness_position": 1.1, "sharpness_attitude": 0.8,
            "bound_exceeded_share": 0.0015, "bound_over_error_position": 5.0,
            "bound_over_error_attitude": 6.0, "ms_p99": 30.0,
            "ms_max": 44.0, "avg_error_pct": 2.0, "ok_share": 0.98, "scale_error": 0.01,
            "nees_position": 4.0, "nees_attitude": 12.0, "frames_false_ok": 1, "frames": 150,
            "ms_per_frame": {"search": 3.0, "total": 20.0}, "features_per_frame": 50.0,
            "target_residual_max_px": None}  # fmt: skip
    return {**base, **numbers}


def test_the_packages_own_plan_is_sound() -> None:
    plan = find_plan(Path("/nowhere"), None)
    assert [e.name for e in plan.recordings[:3]] == ["demo", "demo_miscalibrated", "scenes7_redkitchen"]
    assert plan.seeds == tuple(range(10))
    assert all(changed for changed in plan.ablation.levers.values())
    assert plan.recordings[0].independent == ()  # nothing to draw: rendered as it is
    assert plan.recordings[2].independent == ("collab-tight",)
    assert not plan.recordings[-1].seeded
    by_name = {e.name: e for e in plan.recordings}
    assert list(by_name["icl_two_cameras"].seeds(plan.seeds)) == [0, 1, 2]
    assert list(by_name["davison_monoslam"].seeds(plan.seeds)) == [0]
    assert not by_name["kitti_seq2"].scored
    for entry in plan.recordings:
        with_switches(Settings.default(), entry.settings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("recordings: {a: {wron: rig}}", "a has no option 'wron'; did you mean 'worn'"),
        ("recordings: {a: {modes: [mono, stereo]}}", "a, modes is .*give a list of mono"),
        ("recordings: {a: {noise: [1, 2]}}", "a, noise is .*give metres and degrees"),
        ("recordings: {a: {settings: {filter.map.in_veiw: 3}}}", "did you mean 'filter.map.in_view'"),
        ("recordings: {a: {reference: {system: x}}}", "needs 'system' and 'ate_sim3_pct'"),
        ("recordings: {a: {rendered: demo, worn: rig}}", "leave out 'worn'"),
        ("recordings: {a: {available: yes}}", "give a number"),
        ("recordings: {a: {start: here}}", "give one of worn"),
        ("seeds: 0-x\nrecordings: {a: {}}", "'0-x' are not seeds"),
        ("seeds: 0-4", "names no recordings"),
        ("recordings: [", "not valid YAML"),
        ("recordings: {a: 3}", "is not a mapping"),
    ],
)
def test_a_fault_of_a_plan_is_named(text: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        parse_plan(text, "mine.yaml")


def test_evaluate_runs_resumes_and_reports(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, asked = tmp_path / "out", Choice(seeds=(0,), jobs=1)
    rows = evaluate(place, out, asked)
    shown = capsys.readouterr().out
    assert [(r["recording"], r["mode"], r["bias_per_block"], r["status"]) for r in rows] == [
        ("walk", "mono", True, "done"),
        ("walk", "collab", True, "done"),
        ("walk", "collab", False, "done"),
        ("same", "collab", False, "done"),
        ("broken", "mono", False, "failed"),
        ("broken", "collab", False, "failed"),
    ]
    assert "gone: not in" in shown
    stored = json.loads((out / "evaluate.json").read_text())
    assert stored["missing"] == ["gone"]
    assert stored["complete"]
    assert [r["mode"] for r in stored["rows"]] == ["mono", "collab", "collab", "mono", "collab"]
    assert [r["recording"] for r in stored["independent_rows"]] == ["walk"]
    told = stored["recordings"]["walk"]["collab"]
    assert set(told) == {*NAMES, "runs"}
    assert told["ate_pct_all_frames"] == stored["rows"][1]["ate_pct_all_frames"] > 0.0
    assert told["coverage"] == 1.0
    nothing = dict.fromkeys(NAMES) | {"coverage": 0.0, "ok_share": 0.0, "runs": 1}
    assert stored["recordings"]["broken"]["mono"] == nothing
    (difference,) = stored["differences"]
    assert (difference["recording"], difference["mode"], difference["pairs"]) == ("walk", "collab", 1)
    summary = json.loads((out / "runs" / "walk-collab-seed0" / "summary.json").read_text())
    assert set(summary) <= set(stored["rows"][1])
    assert stored["rows"][1]["ate_sim3_pct"] == summary["ate_sim3_pct"] is not None
    assert "not recognised" in stored["rows"][-1]["error"]
    page = (out / "evaluate.md").read_text()
    assert "| broken | recorded | collab | failed |" in page
    assert "- gone: not in the folder" in page
    assert (out / "evaluate.png").read_bytes().startswith(b"\x89PNG")
    # again: only what failed is tried once more, and nothing changes
    again = evaluate(place, out, asked)
    assert "6 runs, 4 done already" in capsys.readouterr().out
    assert [r.get("ate_pct") for r in again] == [r.get("ate_pct") for r in rows]
    # a changed setting is another run
    evaluate(place, out, Choice(seeds=(0,), dry=True, changes={"filter.map.in_view": 30}))
    assert "6 runs, 0 done already" in capsys.readouterr().out


def test_a_changed_recording_or_option_is_another_run(place: Path, tmp_path: Path) -> None:
    from collabslam.batch.fingerprint import files_hash

    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "1.txt").write_text("one")
    first = files_hash(tmp_path / "a")
    (tmp_path / "a" / "1.txt").write_text("another")
    files_hash.cache_clear()
    assert files_hash(tmp_path / "a") != first
    assert len(code_hash()) == 64
    entry = find_plan(place, None).recordings[0]
    prints = {
        Item(entry, mode, seed, place, tmp_path, biased, "", changes).fingerprint()
        for mode, seed, biased, changes in [
            ("mono", 0, False, ()),
            ("collab", 0, False, ()),
            ("mono", 1, False, ()),
            ("mono", 0, True, ()),
            ("mono", 0, False, (("filter.map.in_view", 21),)),
        ]
    }
    assert len(prints) == 5


@pytest.mark.parametrize("how", altered.ALTERATIONS)
def test_an_altered_recording_is_one_recording(clip: Clip, how: str) -> None:
    """Points that the made camera and poses put into the images are where the images have them."""
    base = Short(clip, 7)
    made = altered.AlteredRecording(base, how)
    assert (np.diff(made.times) > 0.0).all()
    assert len(made) == len(made.times) == len(made.truth) == (5 if how == altered.LATER else 7)
    source = {altered.MIRRORED: 3, altered.BACKWARDS: 3, altered.LATER: 5}[how]
    at = {altered.MIRRORED: 3, altered.BACKWARDS: 3, altered.LATER: 3}[how]
    mirror = np.diag([-1.0, 1.0, 1.0]) if how == altered.MIRRORED else np.eye(3)
    points = np.array([[0.3, 0.2, 2.0], [-0.4, -0.1, 3.0]])
    seen = base.camera.project(points).uv
    world = points @ base.truth[source][:3, :3].T + base.truth[source][:3, 3]
    pose = made.truth[at]
    again = made.camera.project((world @ mirror - pose[:3, 3]) @ pose[:3, :3]).uv
    if how == altered.MIRRORED:
        seen[:, 0] = base.camera.width - 1.0 - seen[:, 0]
    assert np.allclose(again, seen)
    frame = made.frame(at)
    expected = base.image(source)
    assert np.array_equal(frame.image, expected[:, ::-1] if how == altered.MIRRORED else expected)
    assert (frame.index, frame.t, frame.views) == (at, made.times[at], ())


def test_the_plan_of_altered_recordings_is_sound() -> None:
    plan = find_plan(Path("/nowhere"), Path(altered.__file__).with_suffix(".yaml"))
    assert {entry.altered for entry in plan.recordings} == set(altered.ALTERATIONS)
    with pytest.raises(SettingsError, match="lag:SECONDS"):
        parse_plan("recordings: {a: {worn: rig, altered: mirrored}}")


def test_a_constant_is_scored_as_the_other_recordings_choose_it(place: Path) -> None:
    candidates = Candidates("filter.process.map_drift", (1, 2))
    choice = Choice(only=("walk", "same"), modes=("collab",), candidates=candidates)
    likes = {"walk": (5.0, 1.0), "same": (0.0, 2.0)}
    rows = [row(name, "collab", seed, lever=str(value), log_score=scores[value - 1] + seed)
            for name, scores in likes.items() for value in (1, 2) for seed in (0, 1)]  # fmt: skip
    page = leave_one_out.page(chosen(find_plan(place, None), choice), rows, candidates)
    assert "| walk | 5.50 | 1.50 | 2 | 4.00 |" in page
    assert "| same | 0.50 | 2.50 | 1 | 2.00 |" in page
    assert "| all | 3.00 | 2.00 | 1 |" in page


def test_recordings_choose_by_running(place: Path, tmp_path: Path) -> None:
    words = ["evaluate", str(place), "--only", "walk", "--modes", "collab", "--seeds", "0", "--jobs", "1"]
    assert lab.main([*words, "--choose", "filter.pixel.sigma_cs=1,4", "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "choose.json").read_text())["rows"]
    assert [r["lever"] for r in found] == ["1", "4"]
    assert found[0]["log_score"] != found[1]["log_score"]
    with pytest.raises(SystemExit):
        lab.main([*words, "--choose", "filter.pixel.sigma_cs=1"])


def test_the_ablation_changes_one_lever_at_a_time(place: Path, tmp_path: Path) -> None:
    rows = evaluate(place, tmp_path, Choice(study="ablation", only=("walk",), jobs=1))
    assert [r["lever"] for r in rows] == [ablation.BASE, "fewer", "tight"]
    assert len({r["settings_hash"] for r in rows}) == 3
    assert [r["mode"] for r in rows] == ["collab"] * 3  # the column is the mode; the lever may be another
    page = (tmp_path / "ablation.md").read_text()
    assert "| nothing changed | 1.00 | - | " in page  # there is nothing but the one recording
    assert "| fewer |" in page
    assert all(i.done() for i in ablation.lever_items(find_plan(place, None), place, tmp_path, ["walk"], ()))


def badly_run(item: Item) -> Row:
    """Stands for a run: one mode kills its process, one has a fault."""
    if item.mode == "mono":
        os.kill(os.getpid(), signal.SIGKILL)
    if item.mode == "collab-init":
        raise ZeroDivisionError("a fault")
    return {"status": "done"}


def test_a_run_that_dies_fails_alone(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = find_plan(place, None).recordings[0]
    modes = ("mono", "collab-init", "collab")
    monkeypatch.setattr(running, "timed_item", badly_run)
    items = [Item(entry, mode, 0, place, tmp_path) for mode in modes]
    died, faulty, done = running.run_items(items, jobs=2, told=lambda *_: None)
    assert (died["status"], died["error"]) == ("failed", "its process ended with the code -9")
    assert (faulty["status"], faulty["error"]) == ("failed", "ZeroDivisionError('a fault')")
    assert done == {"status": "done"}


def test_whoever_stops_does_not_wait(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = find_plan(place, None).recordings[0]
    items = [Item(plan, "mono", seed, place, tmp_path) for seed in range(4)]
    monkeypatch.setattr(running, "timed_item", first_of_all)

    def told(*_: object) -> None:
        raise KeyboardInterrupt

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        running.run_items(items, jobs=2, told=told)
    assert time.monotonic() - began < LONGEST


def first_of_all(item: Item) -> Row:
    """The first is quick; the others take longer than anybody waits."""
    time.sleep(0.0 if item.seed == 0 else LONGEST)
    return {"status": "done"}


def test_pages_hold_medians_bands_and_ratios() -> None:
    plan = parse_plan(PLAN)
    rows = [row("walk", "collab", seed, ate_pct_all_frames=1.0 + seed) for seed in (0, 1, 2)]
    rows += [row("walk", "mono", seed, ate_pct_all_frames=3.0 + 2.0 * seed) for seed in (0, 1, 2)]
    rows += [
        row("walk", "collab", independent=True, ate_pct_all_frames=5.0, coverage=0.5),
        row("same", "collab", nees_position=40.0),
    ]
    page = accuracy.page(plan, rows, [])
    cells = (
        "| walk | lag:0.2 | collab | 2.00 | 97.0 | 0.90 | 98.0 | 0.4 | 5.00 | 50.0 | 1.0 | 50.0 | 150 | - |"
    )
    assert cells in page
    told = "97.0 | 4.00 | yes | 12.00 | x2 | 1.10 | 0.80 | 0.15 | 5.0 | 6.0 | 4.00 | 12.00"
    assert f"| walk | lag:0.2 | collab | {told} |" in page
    told = "97.0 | 40.00 | high | 12.00 | x2 | 1.10 | 0.80 | 0.15 | 5.0 | 6.0 | - | -"
    assert f"| same | recorded | collab | {told} |" in page
    assert "| walk | lag:0.2 | collab | 0.60 | 97.0 | 0.50 | 1.20 | - | other |" in page
    assert "| walk | lag:0.2 | collab | 30.0 | 44.0 | - | 3.0 |" in page
    # 2, 3 and 4 percent less: 3 +- 4.303 / sqrt(3)
    assert "| walk | lag:0.2 | collab | -3.00 | -5.48 to -0.52 | 3 |" in page
    assert "| collab | 2 | 0.62 to 7.22 | 22.00 | high |" in page
    assert accuracy.band_word(0.15, 0.216, 9.35) == "x2"
    assert accuracy.band_word(0.1, 0.216, 9.35) == "low"
    assert accuracy.band_word(None, 0.216, 9.35) == "-"


def test_two_evaluations_are_compared_row_by_row(tmp_path: Path) -> None:
    def told(error: float | None, wrong: float) -> dict[str, Any]:
        names = dict.fromkeys(NAMES, 1.0)
        return {**names, "ate_pct_all_frames": error, "false_ok_share": wrong, "runs": 3}

    before = {"hall": {"collab": told(2.0, 0.0)}, "lost": {"collab": told(None, 0.0)}}
    now = {
        "hall": {"collab": told(1.0, 0.02)},
        "yard": {"collab": told(4.0, 0.3)},
        "lost": {"collab": told(1.0, 0.0)},
    }
    (tmp_path / "evaluate.json").write_text(json.dumps({"recordings": before}))
    lines = overall.compared(now, overall.read(tmp_path)).splitlines()
    assert [line.split(" | ")[0].strip("| ") for line in lines[2:]] == ["hall", "lost", "all"]
    assert "| 2.00 | 1.00 | 0.50 |" in lines[2]
    assert "| - | 1.00 | - |" in lines[3]
    assert "0.500" in lines[4]
    table = overall.table(now)
    assert "1.587" in table, "the cube root of 4"
    assert "30.0 (yard)" in table
    for text in ("", "[]", '{"recordings": {"hall": 3}}', '{"recordings": {"hall": {"collab": 1}}}'):
        (tmp_path / "evaluate.json").write_text(text)
        with pytest.raises(DataError, match="give a folder that evaluate wrote"):
            overall.read(tmp_path)


def test_the_interval_of_a_mean_is_students() -> None:
    stats = pytest.importorskip("scipy.stats")
    for count in (2, 3, 10, 31):
        values = np.random.default_rng(count).normal(size=count)
        mean, low, high = t_interval(values.tolist())
        expected = stats.t.interval(0.95, count - 1, loc=values.mean(), scale=stats.sem(values))
        assert (mean, low, high) == pytest.approx((values.mean(), *expected), rel=1e-3)
    assert t_interval([2.0]) == (2.0, None, None)


def test_a_truth_that_is_no_judge_serves_the_worn_camera_only(place: Path, tmp_path: Path) -> None:
    plan = parse_plan("recordings: {walk: {worn: 'lag:0.2', scored: false, modes: [collab]}}")
    item = Item(plan.recordings[0], "collab", 0, place, tmp_path)
    recording = replay.open_entry(item)
    assert recording.truth is None
    assert recording.frame(0).views
    told = figures.medians(plan, [replay.run_item(item)])["walk"]["collab"]
    assert told["ate_pct_all_frames"] is told["nees_position"] is told["false_ok_share"] is None
    assert told["coverage"] == told["ok_share"] == 1.0


def test_draws_of_the_relative_pose_take_the_recordings_place(place: Path, tmp_path: Path) -> None:
    import shutil

    folder = tmp_path / "walk"
    shutil.copytree(place / "walk", folder)
    shutil.copytree(folder / "relpose", folder / "other")
    listing = folder / "other" / "data.csv"
    head, first, *rest = listing.read_text().splitlines()
    stamp, x, *others = first.split(",")
    listing.write_text("\n".join([head, ",".join([stamp, str(float(x) + 0.5), *others]), *rest]) + "\n")
    entry = parse_plan("recordings: {walk: {draws: [relpose, other]}}").recordings[0]
    assert list(entry.seeds(range(5))) == [0, 1]
    opened = [replay.open_entry(Item(entry, "collab", seed, tmp_path, tmp_path)) for seed in (0, 1)]
    a, b = (recording.frame(0).views[0] for recording in opened)
    np.testing.assert_allclose(b.t_cf[:3, 3] - a.t_cf[:3, 3], [0.5, 0.0, 0.0], atol=1e-9)


def test_only_what_is_asked_for(place: Path, tmp_path: Path) -> None:
    plan = find_plan(place, None)
    less = chosen(plan, Choice(only=("walk",), modes=("mono",), seeds=(3,)))
    assert [(e.name, e.modes, e.independent) for e in less.recordings] == [("walk", ("mono",), ())]
    assert less.seeds == (3,)
    with pytest.raises(SettingsError, match="no recording 'wlak'"):
        chosen(plan, Choice(only=("wlak",)))
    with pytest.raises(DataError, match="does not exist"):
        evaluate(tmp_path / "nowhere", tmp_path, Choice())
    with pytest.raises(SettingsError, match="cannot be read"):
        find_plan(place, tmp_path / "none.yaml")


def test_the_command(place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lab.main(["evaluate", str(place), "--dry-run", "--only", "walk", "--out", str(tmp_path)]) == 0
    assert "to do  walk collab seed 1 independent" in capsys.readouterr().out
    assert not (tmp_path / "evaluate.json").exists()
    assert lab.main(["evaluate", str(place), "--dry-run", "--blackout", "--out", str(tmp_path)]) == 2
    assert "leave it out" in capsys.readouterr().err
    assert lab.main(["evaluate", str(place), "--only", "broken", "--jobs", "1", "--out", str(tmp_path)]) == 1
    assert "2 of 2 runs failed" in capsys.readouterr().err


def test_the_scale_is_fitted_only_on_demand() -> None:
    truth = np.random.default_rng(0).normal(size=(20, 3))
    estimate = 1.2 * truth + [1.0, 2.0, 3.0]
    assert ate_rmse(estimate, truth, with_scale=True) == pytest.approx(0.0, abs=1e-12)
    assert ate_rmse(estimate, truth) > 0.1


def test_descriptors_are_judged_by_the_truth(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(pairs, "demo_recording", lambda seed: clip.recording)
    monkeypatch.setattr(pairs, "_FRAMES", 2)
    monkeypatch.setattr(pairs, "_OTHERS", 100)
    monkeypatch.setattr(pairs, "PER_BIN", 2)
    entry = parse_plan("recordings: {demo: {rendered: demo}}").recordings[0]
    rows = descriptors.measure(entry, tmp_path, kinds=("warped-sift", "orb"))
    assert {r["descriptor"] for r in rows} == {"warped-sift", "orb"}
    for found in rows:
        assert found["depth_right"] <= found["with_depth"] <= found["matches"] <= found["points"]
        assert found["baseline_m"] >= 0.05
    mine = [r for r in rows if r["descriptor"] == "warped-sift" and r["parallax_deg"] < 3.0]
    assert sum(r["depth_right"] for r in mine) > 0.9 * sum(r["with_depth"] for r in mine) > 0
    page = descriptors.page(rows, ["lost: no poses"], "collabslam-lab evaluate DATA --descriptors")
    assert "warped-sift" in page
    assert "- lost: no poses" in page
    # a pose that is wrong is not called right
    scene = pairs.Scene.of(entry, tmp_path, 0)
    pair = pairs.choose_pairs(scene)[0]
    uv = np.array([[300.0, 200.0], [500.0, 300.0]])
    rho = pairs.true_inverse_ranges(scene, pair.i, uv, Settings.default())
    depth = clip.recording.renderer.depth(scene.poses[pair.i], scene.camera)[[200, 300], [300, 500]]
    rays = scene.camera.unproject(uv)
    np.testing.assert_allclose(rays[:, 2] / rho, depth, rtol=1e-9)


def test_a_second_taken_away_is_noticed_and_what_is_found_again_is_right(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(replay, "_rendered", lambda seed: clip.recording)
    monkeypatch.setattr(blackout, "PLACES", 1)
    monkeypatch.setattr(blackout, "BLIND_S", 0.5)
    monkeypatch.setattr(blackout, "AFTER_S", 0.3)
    entry = parse_plan("recordings: {demo: {rendered: demo}}").recordings[0]
    rows = blackout.measure(entry, tmp_path, tmp_path)
    assert [row["kind"] for row in rows] == list(blackout.KINDS)
    for row in rows:
        assert row["said_after"] == (None if row["kind"] == "jump" else blackout.SAYS)
        assert row["in_sight_after_s"] == 0.0
        assert blackout.in_time(row)
        assert not row["wrong"]
    text = blackout.page(rows, ["away: cannot be opened"], "collabslam-lab evaluate DATA --blackout")
    found = {row["kind"]: row["found_after_s"] for row in rows}
    assert found["jump"] == 0.0
    assert found["hand"] <= 0.1 + 1e-9
    assert f"| demo | hand | 1 | 1 | 1 | 1 | 0 | {found['hand']:.2f} | 0 |" in text
    assert "- away: cannot be opened" in text
    assert not blackout.in_time({**rows[0], "found_after_s": None})
    assert not blackout.in_time({**rows[0], "found_after_s": 1.5})
    late = blackout.page([{**rows[2], "ok_after": 4}], [], "")
    assert "| demo | jump | 1 | 0 |" in late


def test_true_depths_need_two_frames_that_agree() -> None:
    found = np.array([[1.0, 1.0, np.nan], [1.02, 2.0, 0.5], [5.0, np.nan, np.nan]])
    np.testing.assert_allclose(pairs._agreed(found), [1.01, np.nan, np.nan])


def test_calibrations_are_wrong_on_purpose(place: Path, tmp_path: Path) -> None:
    entry = find_plan(place, None).recordings[0]
    item = Item(replace(entry, calibration_sd=(0.01, 3.0, 0.01)), "collab", 0, place, tmp_path)
    right, wrong = replay.open_entry(replace(item, entry=entry)).camera, replay.open_entry(item).camera
    assert wrong.intrinsics != right.intrinsics
    assert wrong.intrinsics == replay.open_entry(item).camera.intrinsics
    assert item.fingerprint() != replace(item, entry=entry).fingerprint()
