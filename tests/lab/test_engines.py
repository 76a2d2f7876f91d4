"""Work on other engines: what dies fails alone, nothing is lost, and results are those of this machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from helpers.clip import Clip, Short
from helpers.plans import PLAN
from helpers.waiting import LONGEST, until

from collabslam.batch import engines
from collabslam.batch.engines import LOCAL, Engine
from collabslam.batch.isolated import Died, _end_idle, isolated, one
from collabslam.datasets import write_recording
from collabslam.errors import DataError, SettingsError
from collabslam_lab.benchmark import cluster, remote
from collabslam_lab.benchmark.evaluate import Choice, _items, chosen
from collabslam_lab.benchmark.plan import find_plan
from collabslam_lab.benchmark.running import run_items
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.cli import main as cli

DASK = Engine("dask", seconds=LONGEST)


@pytest.fixture(scope="module")
def place(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    write_recording(Short(clip, 7), folder / "walk")
    (folder / "broken").mkdir()
    (folder / "evaluate.yaml").write_text(PLAN)
    return folder


def double(x: int) -> int:
    return 2 * x


def act(what: str) -> str:
    """What a task may do to the process that it runs in."""
    if what == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "kill the worker":
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(LONGEST)
    if what == "hang":
        time.sleep(LONGEST)
    if what == "fail":
        raise DataError("what was asked for cannot be done")
    print("words of a task")  # they are not an answer
    return what


def test_a_child_that_dies_fails_one_piece() -> None:
    first, died, last = isolated(act, [("a",), ("die",), ("b",)], LONGEST)
    assert (first, last) == ("a", "b")
    assert isinstance(died, Died)
    assert str(died) == "its process ended with the code -9"
    with pytest.raises(DataError, match="cannot be done"):
        one(act, ("fail",), LONGEST)
    with pytest.raises(Died):
        one(act, ("die",), LONGEST)


def test_a_child_that_hangs_is_ended_and_each_piece_has_its_own_limit() -> None:
    hung = list(isolated(act, [("hang",), ("hang",)], 0.2))
    assert all(isinstance(answer, Died) for answer in hung)
    assert [str(answer) for answer in hung] == 2 * ["it took longer than 0.2 s"]
    assert one(act, ("a",), LONGEST) == "a"


class Unsendable(Exception):
    """Pickles, and cannot be made again from that."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what}: {why}")


def raise_unsendable(text: str) -> str:
    if text == "b":
        raise Unsendable("this", "that")
    return text


def test_an_exception_is_an_answer_whatever_it_is_made_of(capfd: pytest.CaptureFixture[str]) -> None:
    _end_idle()  # a child of before writes where it did then
    first, second, third = isolated(raise_unsendable, [("a",), ("b",), ("c",)], LONGEST)
    assert (first, third) == ("a", "c")
    assert isinstance(second, RuntimeError)
    assert "this: that" in str(second)
    assert "in raise_unsendable" in capfd.readouterr().err


def test_whoever_stops_does_not_wait_for_what_is_under_way() -> None:
    def hear(_: int, result: Callable[[], str]) -> None:
        raise KeyboardInterrupt(result())

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt, match="a"):
        LOCAL.each(act, [("hang",), ("a",), ("hang",), ("hang",)], 2, hear)
    assert time.monotonic() - began < LONGEST


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_order(jobs: int) -> None:
    told: list[None] = []
    doubled = LOCAL.in_order(double, [(k,) for k in range(5)], jobs, lambda: told.append(None))
    assert (doubled, len(told)) == ([0, 2, 4, 6, 8], 5)
    with pytest.raises(DataError, match="cannot be done"):
        LOCAL.in_order(act, [("a",), ("fail",)], jobs, lambda: None)


def pid() -> int:
    return os.getpid()


def test_a_child_that_did_all_it_was_asked_is_used_again() -> None:
    first = one(pid, (), LONGEST)
    assert list(isolated(pid, [(), ()], LONGEST)) == [first, first]
    with pytest.raises(Died):
        one(act, ("die",), LONGEST)
    second = one(pid, (), LONGEST)
    assert second != first
    os.kill(second, signal.SIGKILL)  # while nobody asks it anything
    psutil.wait_procs([psutil.Process(second)], timeout=LONGEST)
    assert one(pid, (), LONGEST) not in (first, second)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize(
    "work",
    [
        "one(write_and_sleep, ({mark!r},), 600.0)",
        "with LOCAL.pool(1) as pool: pool.submit(write_and_sleep, {mark!r}).result()",
    ],
    ids=["isolated", "pool"],
)
def test_a_child_ends_with_its_parent(tmp_path: Path, work: str, how: signal.Signals) -> None:
    mark = tmp_path / "pid"
    script = tmp_path / "work.py"  # children of a pool read it again
    script.write_text(PARENT + f"    {work.format(mark=str(mark))}\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen([sys.executable, script], env=environment)
    assert until(lambda: mark.is_file() and mark.read_text())
    child = psutil.Process(int(mark.read_text()))
    parent.send_signal(how)
    parent.wait(timeout=LONGEST)
    child.wait(timeout=LONGEST)
    assert not psutil.pid_exists(child.pid)


PARENT = """
import signal
from collabslam.batch.engines import LOCAL
from collabslam.batch.isolated import one
from test_engines import write_and_sleep
if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: exit(143))
"""


def write_and_sleep(mark: str) -> None:
    Path(mark).write_text(str(os.getpid()))
    time.sleep(LONGEST)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "ray"}, "no engine 'ray'; there are local, dask"),
        ({"scheduler": "tcp://host:1"}, "for --engine dask"),
        ({"kind": "dask", "seconds": float("nan")}, "positive"),
    ],
)
def test_an_engine_that_cannot_be(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Engine(**options)


def test_what_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(DataError, match=r"pip install '\.\[cluster\]'"), DASK.pool(1):
        pass
    assert cli.main(["evaluate", str(tmp_path), "--engine", "spark"]) == 2
    assert "no engine 'spark'" in capsys.readouterr().err


def test_a_poisonous_task_is_blamed_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "TRIES", 1)
    whats = ["a", "die", "b", "kill the worker", "c", "fail", "d", "e"]
    with Engine("dask", seconds=LONGEST).pool(2) as pool:
        futures: dict[str, Future[str]] = {what: pool.submit(act, what) for what in whats}
        assert [futures[what].result() for what in "abcde"] == list("abcde")
        with pytest.raises(Died):
            futures["die"].result()
        with pytest.raises(DataError, match="cannot be done"):
            futures["fail"].result()
        with pytest.raises(Exception, match="kill"):
            futures["kill the worker"].result()
        assert pool.submit(double, 4).result() == 8


class Dead(Exception):
    """Too many workers died."""


def test_who_is_blamed_with_another_is_tried_again_when_that_one_is_not_there() -> None:
    """A scheduler that runs nothing by itself: what is under way when one kills is blamed with it."""
    sent: list[tuple[str, Future[str]]] = []

    def send(what: str) -> Future[str]:
        sent.append((what, Future()))
        return sent[-1][1]

    blamed = engines._BlamedAlone(send, Dead)
    told = {what: blamed.submit(what) for what in ("a", "kills", "b", "fails", "c")}
    (_, a), (_, kills), (_, b), (_, fails), (_, c) = sent
    a.set_result("a")
    kills.set_exception(Dead("kills"))
    b.set_exception(Dead("b"))
    fails.set_exception(DataError("no"))
    assert len(sent) == 5  # c is still under way
    c.set_result("c")
    assert [what for what, _ in sent[5:]] == ["kills"]
    sent[5][1].set_exception(Dead("kills"))
    assert [what for what, _ in sent[6:]] == ["b"]
    sent[6][1].set_result("b")
    assert [told[what].result() for what in "abc"] == list("abc")
    for what, error in (("kills", Dead), ("fails", DataError)):
        with pytest.raises(error):
            told[what].result()
    gone = blamed.submit("gone")
    assert sent[7][1].cancel()
    sent[7][1].set_running_or_notify_cancel()
    assert gone.cancelled()


def test_a_call_that_cannot_be_sent_again_says_so() -> None:
    sent: list[Future[str]] = []

    def send(_: str) -> Future[str]:
        if sent:
            raise DataError("the scheduler is gone")
        sent.append(Future())
        return sent[0]

    told = engines._BlamedAlone(send, Dead).submit("a")
    sent[0].set_exception(Dead())
    with pytest.raises(DataError, match="gone"):
        told.result(timeout=LONGEST)


def test_what_else_the_machine_does_is_not_the_clusters_overhead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]

    def run(*arguments: Any) -> list[Row]:
        """Four replays side by side in two; with Dask the machine is half as fast, and 6 % are lost."""
        slow = 1.0 if arguments[4].is_local else 2.0
        clock[0] += 10.0 * slow * (1.0 if arguments[4].is_local else 1.06)
        return [{"status": "done", "seconds": 5.0 * slow} for _ in range(4)]

    (tmp_path / "data").mkdir()
    monkeypatch.setattr(cluster, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(cluster, "_run", run)
    monkeypatch.setattr(cluster, "_same", lambda *_: True)
    monkeypatch.setattr(cluster, "_start_and_rate", lambda *_: (1.06, 500.0))
    results = cluster.measure_cluster(tmp_path, replays=2, jobs=2, tasks=10)
    assert results["overhead_pct"] == pytest.approx(6.0)
    assert results["overhead_running_pct"] == pytest.approx(100.0 * (1.06 * 0.95 - 1.0))
    assert (results["lost"], results["identical"], results["seconds_for_1000_workers"]) == (0, True, 2.0)
    assert "6.0 %" in (tmp_path / "cluster.md").read_text()
    monkeypatch.setattr(cluster, "_run", lambda *_: [{"status": "failed", "error": "no image"}])
    with pytest.raises(DataError, match="no image"):
        cluster.measure_cluster(tmp_path, replays=2, jobs=2, tasks=10)


def untimed(row: Row) -> Row:
    """A row without what a clock says."""
    return {k: v for k, v in row.items() if k not in ("ms_per_frame", "ms_p99", "ms_max", "fps", "seconds")}


def test_workers_that_are_killed_lose_nothing_and_change_no_bit(place: Path, tmp_path: Path) -> None:
    plan = chosen(find_plan(place, None), Choice(seeds=(0, 1)))

    def items(out: str) -> list[Item]:
        return _items(plan, place, tmp_path / out, ["walk", "same", "broken"], Choice())

    here = run_items(items("here"), jobs=1, told=lambda *_: None)
    killed: list[int] = []

    def kill(item: Item, row: Row) -> None:
        """Every worker, when the first answer comes."""
        if not killed:
            for process in psutil.Process().children(recursive=True):
                if "spawn_main" in " ".join(process.cmdline()):
                    killed.append(process.pid)
                    process.kill()

    there = run_items(items("there"), jobs=2, told=kill, engine=DASK)
    assert killed
    assert [untimed(row) for row in there] == [untimed(row) for row in here]
    assert {row["status"] for row in there} == {"done", "failed"}
    for a, b in zip(items("here"), items("there"), strict=True):
        if a.folder is not None and b.folder is not None and a.done() is not None:
            for name in ("trajectory.tum", "trajectory.cov", "map.ply", "config.yaml"):
                assert (a.folder / name).read_bytes() == (b.folder / name).read_bytes()
    left = [path.name for path in (tmp_path / "there" / "runs").iterdir() if path.name.startswith(".")]
    assert left == []


def test_what_a_dead_worker_has_done_stays_done(place: Path, tmp_path: Path) -> None:
    entry = find_plan(place, None).recordings[0]
    item = Item(entry, "mono", 0, place, tmp_path / "out")
    (row,) = remote.replay([item], LONGEST, False)
    stamp = item.summary.stat().st_mtime_ns
    (found,) = remote.replay([item], LONGEST, False)
    assert untimed(found) == untimed(row)
    assert item.summary.stat().st_mtime_ns == stamp
    remote.replay([item], LONGEST, True)
    assert item.summary.stat().st_mtime_ns != stamp
