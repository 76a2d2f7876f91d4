"""Pieces of work whose results are kept: what fails is named, costs none of the others, and is done later."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from helpers.waiting import LONGEST

from collabslam.batch.engines import LOCAL, Engine
from collabslam.errors import DataError
from collabslam_lab import kept as kept_module
from collabslam_lab.kept import Task, kept
from collabslam_lab.program import made_by


@dataclass(frozen=True)
class Sum:
    """Two numbers; ``cured`` is a file without which 3 dies and 5 fails."""

    number: int
    cured: Path

    @property
    def stem(self) -> str:
        return f"sum-{self.number}"


def add(piece: Sum) -> str:
    if not piece.cured.exists():
        if piece.number == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        if piece.number == 5:
            raise DataError("five is not there")
        if piece.number == 6:
            raise ZeroDivisionError("six")
    return json.dumps(piece.number + 1)


def parsed(_: Sum, content: Any) -> int:
    if not isinstance(content, int):
        raise ValueError
    return content


TASK = Task(add, parsed, lambda piece, result: f"{piece.number}: {result}", "sums", "sum")


def go(numbers: list[int], folder: Path, jobs: int = 2, engine: Engine = LOCAL) -> list[int]:
    pieces = [Sum(number, folder / "cured") for number in numbers]
    return kept(TASK, pieces, folder, jobs=jobs, engine=engine, progress=True)


@pytest.mark.parametrize("engine", [LOCAL, Engine("dask", seconds=LONGEST)], ids=["local", "dask"])
def test_what_fails_costs_none_of_the_others(
    tmp_path: Path, engine: Engine, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DataError) as failed:
        go([1, 3, 2, 5, 6, 4], tmp_path, engine=engine)
    assert str(failed.value) == (
        "3 of 6 sums failed: sum-3 (its process ended with the code -9), sum-5 (five is not there), "
        f"sum-6 (ZeroDivisionError('six')). The others are in {tmp_path}; "
        "the same command does what is missing."
    )
    assert sorted(path.name[:5] for path in tmp_path.iterdir()) == ["sum-1", "sum-2", "sum-4"]
    (tmp_path / "cured").touch()
    assert go([1, 3, 2, 5, 6, 4], tmp_path, engine=engine) == [2, 4, 3, 6, 7, 5]
    assert "3 of 6 sums are there already" in capsys.readouterr().out


def test_one_process_goes_on_too(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"1 of 3 sums failed: sum-5 \(five is not there\)"):
        go([1, 5, 2], tmp_path, jobs=1)
    assert sorted(path.name[:5] for path in tmp_path.iterdir()) == ["sum-1", "sum-2"]


def test_a_message_stays_readable(tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match=r"8 of 8 sums failed: (sum-6 \(\S+\), ){4}sum-6 \(\S+\) and 3 more\."
    ):
        go([6] * 8, tmp_path, jobs=1)


def test_a_file_that_is_none_is_made_again(tmp_path: Path) -> None:
    go([1], tmp_path, jobs=1)
    (path,) = tmp_path.iterdir()
    for broken in ("", "[1", '"two"'):
        path.write_text(broken)
        assert go([1], tmp_path, jobs=1) == [2]
        assert path.read_text() == "2"


def test_other_code_is_another_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    go([1], tmp_path, jobs=1)
    monkeypatch.setattr(kept_module, "made_by", lambda work: f"{work.__name__}, changed")
    go([1], tmp_path, jobs=1)
    assert len(list(tmp_path.iterdir())) == 2
    first, second = made_by(add), made_by(DataError)
    assert first == made_by(parsed) != second  # of one module, and of another
    assert first.split()[:-1] == second.split()[:-1]
