"""Records of live runs that nobody recorded: each is replayed or refused, and writes nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from collabslam import CollabslamError, DataError
from collabslam.live import messages
from collabslam.live.plan import LivePlan
from collabslam.live.record import BIAS, T_CF
from collabslam.live.replay import replay
from collabslam_lab.reliability.attacks.records import BROKEN, GOOD, image, info, plan, record, worn


@pytest.mark.parametrize("name", list(BROKEN))
def test_a_record_that_is_none_is_refused(name: str, tmp_path: Path) -> None:
    path = record(tmp_path, *BROKEN[name]())
    before = set(tmp_path.rglob("*"))
    with pytest.raises(CollabslamError) as error:
        replay(path, tmp_path / "out")
    assert str(error.value).isprintable()
    assert {p for p in tmp_path.rglob("*") if tmp_path / "out" not in (p, *p.parents)} - before <= {
        tmp_path / "latest"
    }


def test_a_record_by_hand_that_is_whole_is_replayed(tmp_path: Path) -> None:
    twice = [(BIAS, messages.NUMBERS, messages.numbers(np.eye(6)))] * 2
    pose = (T_CF, messages.POSE, messages.pose(1.0, "cs", np.eye(4), np.eye(6)))
    path = record(tmp_path, plan(), info(), image(), pose, *twice, worn(), image(2.0), image(2.0), image(0.0))
    summary = replay(path, tmp_path / "out")
    assert summary["frames"] == 2


def test_a_plan_is_what_was_written() -> None:
    asked = LivePlan(**{**GOOD, "persons": ["anna", "Ben-2"], "t_bc": np.eye(4).ravel().tolist()})
    assert LivePlan.of(asked.written, "test") == asked
    with pytest.raises(DataError, match="test"):
        LivePlan.of(asked.written.replace("anna", "../x"), "test")
