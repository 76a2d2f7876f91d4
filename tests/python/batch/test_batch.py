"""Many recordings by one plan: a broken one costs itself, what is done stays done, one table tells all."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from helpers.clip import Clip, Short

from collabslam.batch.job import NOTE, Job, run_job
from collabslam.batch.plan import read_plan
from collabslam.batch.running import TABLE, run_batch
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.errors import SettingsError
from collabslam.runs import runner
from collabslam.runs.plan import Output
from collabslam.runs.results import CHECKPOINT, SUMMARY
from collabslam.runs.run_folder import RunFolder

FRAMES = 6


@pytest.fixture
def plan(clip: Clip, tmp_path: Path) -> Path:
    """One recording in two modes, and one that is not there."""
    write_recording(Short(clip, FRAMES), tmp_path / "walk")
    path = tmp_path / "plan.yaml"
    path.write_text(
        "defaults: {max_frames: 5}\n"
        "recordings:\n"
        "  walk: {modes: [mono, collab-tight]}\n"
        "  gone: {source: nowhere, max_frames: 3}\n"
    )
    return path


def table(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / TABLE).read_text().splitlines()))


@pytest.mark.slow
def test_a_plan_is_done_once(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert cli.main(["batch", str(plan), "--out", str(out)]) == 1  # one of them is gone
    said = capsys.readouterr()
    assert "3 runs, 1 of them failed" in said.out
    assert "gone: failed: The recording" in said.err
    rows = {(row["recording"], row["mode"]): row for row in table(out)}
    assert {k: r["status"] for k, r in rows.items()} == {
        ("walk", "mono"): "done",
        ("walk", "collab-tight"): "done",
        ("gone", ""): "failed",
    }
    assert rows["walk", "mono"]["frames"] == "5"
    summary = out / "walk-mono" / SUMMARY
    assert RunFolder(out / "walk-mono").summary()["mode"] == "mono"
    before = summary.stat().st_mtime_ns
    jobs = [job for job in _jobs(plan, out) if job.entry.name == "walk"]
    assert [row["status"] for row in run_batch(jobs)] == ["done", "done"]
    assert summary.stat().st_mtime_ns == before  # it was not run again
    plan.write_text(plan.read_text().replace("max_frames: 5", "max_frames: 4"))
    (job,) = (job for job in _jobs(plan, out) if job.mode == "mono")
    assert job.done() is None
    assert run_batch([job])[0]["frames"] == 4


def _jobs(plan: Path, out: Path) -> list[Job]:
    return [Job(entry, mode, out) for entry in read_plan(plan) for mode in entry.modes]


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on(plan: Path, tmp_path: Path) -> None:
    job = _jobs(plan, tmp_path / "out")[0]
    whole = run_job(Job(job.entry, job.mode, tmp_path / "whole"))
    seen: list[int] = []

    def stop(frame: object, step: object, engine: object) -> None:
        seen.append(1)
        if len(seen) == 3:
            raise KeyboardInterrupt

    output = Output(job.folder, checkpoint_every=1, reopen=job.entry.source, notes={NOTE: job.fingerprint()})
    stopped = runner.run(job.entry.source.open(), mode=job.mode, out=output, watch=stop)
    assert stopped.summary["interrupted"]
    assert job.done() is None
    began = (job.folder / CHECKPOINT).stat().st_mtime_ns
    assert run_job(job)["frames"] == whole["frames"] == 5
    assert began
    one, other = (RunFolder(f).trajectory()[1] for f in (job.folder, tmp_path / "whole" / job.folder.name))
    assert one.tobytes() == other.tobytes()
    assert job.done() is not None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("recordings: {}", "names no recordings"),
        ("recordings: {a: {sauce: x}}", "did you mean 'source'"),
        ("recordings: {a: {modes: [best]}}", "modes is"),
        ("recordings: {a: {start: up}}", "start is 'up'"),
        ("recordings: {a: {max_frames: 0}}", "max_frames is 0"),
        ("recordings: {a: {settings: {filter.no: 1}}}", "settings: There is no setting"),
        ("recordings: {'..': {}}", "nothing can be called so"),
        ("recordings: [a]", "not a mapping"),
        ("recordings: {a: {source: 3}}", "source is 3"),
        ("a: [", "not valid YAML"),
    ],
)
def test_faults_of_a_plan_are_named(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "plan.yaml").write_text(text)
    with pytest.raises(SettingsError, match=said):
        read_plan(tmp_path / "plan.yaml")


def test_one_folder_is_one_jobs(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text("recordings: {a: {modes: [mono]}, a-mono: {}}")
    with pytest.raises(SettingsError, match="one result folder"):
        run_batch(_jobs(tmp_path / "plan.yaml", tmp_path))
    with pytest.raises(SettingsError, match="give 1 or more"):
        run_batch([], processes=0)
