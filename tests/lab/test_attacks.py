"""Attacks: the table is whole, what must not happen is seen when it happens, and one of each kind holds."""

from __future__ import annotations

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from collabslam_lab.reliability.attacks import perform as performing
from collabslam_lab.reliability.attacks.attack import HELD, REFUSED, Attack, Deed, Outcome
from collabslam_lab.reliability.attacks.perform import Ending, judge, perform
from collabslam_lab.reliability.attacks.scene import Ground, Scene
from collabslam_lab.reliability.attacks.table import ATTACKS, attacks_markdown

ROOT = Path(__file__).parents[2]
BY_NAME = {(attack.group, attack.name): attack for attack in ATTACKS}
ONE_EACH = (
    ("image", "gif"),
    ("calibration", "nan"),
    ("list", "repeated"),
    ("relative pose", "negative"),
    ("truth", "far"),
    ("settings", "object"),
    ("bag", "encoding"),
    ("checkpoint", "victim"),
    ("map", "crooked"),
    ("command", "letters"),
    ("place", "map-pipe"),
    ("place", "record-above"),
    ("limit", "small-files"),
    ("signal", "term"),
    ("call", "interrupted"),
    ("stream", "dark"),
)


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Ground:
    return Ground(tmp_path_factory.mktemp("ground"), length_m=1.8)


def test_the_table_is_whole() -> None:
    assert len(ATTACKS) >= 200
    assert len(BY_NAME) == len(ATTACKS)
    assert {group for group, _ in ONE_EACH} == {attack.group for attack in ATTACKS}
    assert max(Counter(attack.what for attack in ATTACKS).values()) == 1
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    rows = {tuple(row.split(" | ")[:2]) for row in page.splitlines() if row.startswith("| ")}
    missing = [key for key in BY_NAME if (f"| {key[0]}", f"`{key[1]}`") not in rows]
    assert not missing, "collabslam-lab reliability attacks prints the table"


@pytest.mark.parametrize("name", ONE_EACH, ids="-".join)
def test_one_of_each_kind(ground: Ground, name: tuple[str, str]) -> None:
    result = perform(BY_NAME[name], ground)
    assert result.good, result


def _program(scene: Scene, text: str) -> Deed:
    module = scene.folder / "attacker.py"
    module.write_text(text)
    return Deed(["attacker"], environment={"PYTHONPATH": str(scene.folder)})


@pytest.mark.parametrize(
    ("text", "outcome"),
    [
        ("raise KeyError('x')", Outcome.TRACEBACK),
        ("import os; os.abort()", Outcome.TRACEBACK),
        ("import sys; sys.exit(3)", Outcome.TRACEBACK),
        ("import time; time.sleep(60)", Outcome.HANG),
        ("import os; os.remove(__file__)", Outcome.LOST),
        ("open(__file__, 'a').write('#')", Outcome.LOST),
        ("import sys; sys.exit(2)", Outcome.MEMORY),
        ("import sys; sys.exit(2)", Outcome.UNNAMED),
        ("import sys; print('collabslam: error: bad luck', file=sys.stderr); sys.exit(2)", Outcome.UNNAMED),
        ("import sys; print('collabslam: error: bad word', file=sys.stderr); sys.exit(2)", Outcome.REFUSED),
        ("import sys; sys.exit(4)", Outcome.CHANGED),
        ("import sys; sys.exit(1)", Outcome.TOLD),
        ("pass", Outcome.HELD),
    ],
)
def test_what_must_not_happen_is_seen(
    ground: Ground, monkeypatch: pytest.MonkeyPatch, text: str, outcome: Outcome
) -> None:
    if outcome is Outcome.MEMORY:  # a process counts what the one that started it had
        monkeypatch.setattr(performing, "MEGABYTES", 1.0)
    attack = Attack("test", "it", "what", lambda scene: _program(scene, text), REFUSED, "word")
    result = perform(attack, ground, seconds=3.0)
    assert result.outcome is outcome
    assert result.good == (outcome is Outcome.REFUSED)


def test_ok_beside_a_wrong_pose_is_seen(ground: Ground) -> None:
    attack = Attack("test", "it", "what", lambda scene: scene.run(), HELD)
    ending = Ending(0, 1.0, 100.0, "", "", hung=False)
    assert judge(attack, ending, [], {"ok_but_wrong_share": 0.019}) is Outcome.HELD
    assert judge(attack, ending, [], {"ok_but_wrong_share": 0.021}) is Outcome.WRONG
    assert judge(attack, replace(ending, status=1), [], {"ok_but_wrong_share": 0.021}) is Outcome.WRONG
    assert judge(attack, ending, [], {"ok_but_wrong_share": None}) is Outcome.HELD
    result = perform(attack, ground)
    assert result.good
    assert result.ok_share == 1.0
    row = json.loads(json.dumps(result.jsonable()))
    assert (row["outcome"], row["good"]) == ("held", True)
    assert "| test | `it` | what | held |" in attacks_markdown([result])
    bad = perform(Attack("test", "it", "what", lambda scene: scene.run(), REFUSED), ground)
    assert "**held**" in attacks_markdown([bad])


def test_the_processes_run_this_python() -> None:
    assert performing.program(["m", "w"], {"n": 5})[-4:] == [sys.executable, "-m", "m", "w"]
