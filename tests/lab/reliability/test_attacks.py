"""Attacks: the table is whole, what must not happen is seen when it happens, and one of each kind holds."""

from __future__ import annotations

import json
import shutil
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.waiting import LONGEST

from collabslam import Camera
from collabslam.frontend.worn_verdict import ask_images
from collabslam.geometry import pose, se3_exp
from collabslam_lab.reliability.attacks import perform as performing
from collabslam_lab.reliability.attacks.attack import HELD, REFUSED, Attack, AttackOutcome, Deed, Result
from collabslam_lab.reliability.attacks.perform import Ending, judge, perform
from collabslam_lab.reliability.attacks.scene import Ground, Scene
from collabslam_lab.reliability.attacks.table import ATTACKS, attacks_markdown

ROOT = Path(__file__).parents[3]
BY_NAME = {(attack.group, attack.name): attack for attack in ATTACKS}
ONE_EACH = (
    ("image", "gif"),
    ("video", "concat"),
    ("calibration", "nan"),
    ("list", "repeated"),
    ("relative pose", "negative"),
    ("truth", "far"),
    ("gyroscope", "set-back"),
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
    ("live call", "session-none"),
    ("live folder", "frames-quote"),
    ("record", "persons-above"),
    ("result folder", "export-tum-pipe"),
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
    result = perform(BY_NAME[name], ground, seconds=LONGEST)
    assert result.good, result


def _program(scene: Scene, text: str) -> Deed:
    module = scene.folder / "attacker.py"
    module.write_text(text)
    return Deed(["attacker"], environment={"PYTHONPATH": str(scene.folder)})


@pytest.mark.parametrize(
    ("text", "outcome"),
    [
        ("raise KeyError('x')", AttackOutcome.TRACEBACK),
        ("import os; os.abort()", AttackOutcome.TRACEBACK),
        ("import sys; sys.exit(3)", AttackOutcome.TRACEBACK),
        ("import time; time.sleep(600)", AttackOutcome.HANG),
        ("import os; os.remove(__file__)", AttackOutcome.LOST),
        ("open(__file__, 'a').write('#')", AttackOutcome.LOST),
        ("import sys; block = b'x' * 400_000_000; sys.exit(2)", AttackOutcome.MEMORY),
        ("import sys; sys.exit(2)", AttackOutcome.UNNAMED),
        (
            "import sys; print('collabslam: error: bad luck', file=sys.stderr); sys.exit(2)",
            AttackOutcome.UNNAMED,
        ),
        (
            "import sys; print('collabslam: error: bad word', file=sys.stderr); sys.exit(2)",
            AttackOutcome.REFUSED,
        ),
        ("import sys; sys.exit(4)", AttackOutcome.CHANGED),
        ("import sys; sys.exit(1)", AttackOutcome.TOLD),
        ("pass", AttackOutcome.HELD),
    ],
)
def test_what_must_not_happen_is_seen(
    ground: Ground, monkeypatch: pytest.MonkeyPatch, text: str, outcome: AttackOutcome
) -> None:
    if outcome in (
        AttackOutcome.MEMORY,
        AttackOutcome.UNNAMED,
    ):  # the kernel hands a child the peak of its parent
        monkeypatch.setattr(performing, "MEGABYTES", 300.0)
    ours = b"x" * 400_000_000 if outcome is AttackOutcome.UNNAMED else b""
    attack = Attack("test", "it", "what", lambda scene: _program(scene, text), REFUSED, "word")
    result = perform(attack, ground, seconds=1.0 if outcome is AttackOutcome.HANG else LONGEST)
    del ours
    assert result.outcome is outcome
    assert result.good == (outcome is AttackOutcome.REFUSED)


def test_ok_beside_a_wrong_pose_is_seen(ground: Ground) -> None:
    attack = Attack("test", "it", "what", lambda scene: scene.run(), HELD)
    ending = Ending(0, 1.0, 100.0, "", "", hung=False)
    assert judge(attack, ending, [], {"false_ok_share": 0.019}) is AttackOutcome.HELD
    assert judge(attack, ending, [], {"false_ok_share": 0.021}) is AttackOutcome.WRONG
    assert judge(attack, replace(ending, status=1), [], {"false_ok_share": 0.021}) is AttackOutcome.WRONG
    assert judge(attack, ending, [], {"false_ok_share": None}) is AttackOutcome.HELD
    result = perform(attack, ground)
    assert result.good
    assert result.ok_share == 1.0
    row = json.loads(json.dumps(result.jsonable()))
    assert (row["outcome"], row["good"]) == ("held", True)
    assert "| test | `it` | what | held |" in attacks_markdown([result])
    bad = perform(Attack("test", "it", "what", lambda scene: scene.run(), REFUSED), ground)
    assert bad.succeeded
    assert "**held**" in attacks_markdown([bad])


@pytest.mark.parametrize("beyond", [False, True])
def test_what_no_image_tells_is_listed_and_is_not_held(beyond: bool) -> None:
    attack = Attack("test", "it", "what", lambda scene: scene.run(), HELD, beyond=beyond)
    result = Result(attack, AttackOutcome.WRONG, 0, 1.0, 1.0, "")
    assert not result.good
    assert result.succeeded == (not beyond)
    assert ("wrong pose: no image tells |" in attacks_markdown([result])) == beyond
    assert ("**OK beside" in attacks_markdown([result])) == (not beyond)
    assert Result(attack, AttackOutcome.TRACEBACK, 0, 1.0, 1.0, "").succeeded


def _against(pixels: list[np.ndarray], t_cf: np.ndarray, focals: tuple[float, float]) -> float:
    """How much matches of Cs and Cf contradict a pose stated to 3 cm and 0.5 degrees, 1 in yaw."""
    cameras = [Camera("pinhole", 720, 480, (f, f, 359.5, 239.5)) for f in focals]
    rays_s, rays_f = (camera.unproject(uv) for camera, uv in zip(cameras, pixels, strict=True))
    sds = np.array([0.03, 0.03, 0.03, 0.0087, 0.0175, 0.0087])
    verdict = ask_images(rays_s, rays_f, t_cf, np.diag(sds**2), focals)
    assert verdict is not None
    return verdict.against


@pytest.mark.parametrize("degrees", [0.0, 5.0])
def test_no_image_tells_of_feet_nor_of_both_focal_lengths(degrees: float) -> None:
    """The cameras of the demo, beside each other, Cf a little turned against Cs; the pixels are exact."""
    t_cf = pose(
        se3_exp([0.0, 0.0, 0.0, 0.0, np.deg2rad(degrees), 0.0])[:3, :3], np.array([-0.74, -0.76, 0.19])
    )
    points = np.random.default_rng(1).uniform((-2.0, -1.5, 5.0), (2.0, 1.5, 20.0), (80, 3))
    right = Camera("pinhole", 720, 480, (620.0, 620.0, 359.5, 239.5))
    pixels = [right.project(p).uv for p in (points, (points - t_cf[:3, 3]) @ t_cf[:3, :3])]
    feet = t_cf.copy()
    feet[:3, 3] /= 0.3048
    assert _against(pixels, t_cf, (620.0, 620.0)) < 1e-6
    assert _against(pixels, feet, (620.0, 620.0)) < 1e-6
    assert _against(pixels, t_cf, (682.0, 682.0)) < 0.3
    assert _against(pixels, t_cf, (682.0, 620.0)) > 1.0


@pytest.mark.parametrize(("crop", "told"), [(1.0, False), (1.1, True)])
def test_a_stabilised_camera_is_told_by_its_enlarged_image_alone(crop: float, told: bool) -> None:
    """Turned by half a degree in pitch, and yaw, the calibration of Cs being that of the image as it was."""
    points = np.random.default_rng(1).uniform((-2.0, -1.5, 5.0), (2.0, 1.5, 20.0), (80, 3))
    t_cf = pose(np.eye(3), np.array([-0.74, -0.76, 0.19]))
    turned = se3_exp([0.0, 0.0, 0.0, np.deg2rad(0.5), np.deg2rad(0.5), 0.0])
    right = Camera("pinhole", 720, 480, (620.0, 620.0, 359.5, 239.5))
    larger = Camera("pinhole", 720, 480, (620.0 * crop, 620.0 * crop, 359.5, 239.5))
    pixels = [larger.project(points @ turned[:3, :3]).uv, right.project(points - t_cf[:3, 3]).uv]
    assert (_against(pixels, t_cf, (620.0, 620.0)) > 1.0) == told


@pytest.mark.parametrize(("by", "told"), [(5.0, False), (10.0, False), (60.0, True)])
def test_a_picture_that_sways_is_told_where_it_is_turned_by_more_than_t_cf_may_be(
    by: float, told: bool
) -> None:
    """Moved by so many pixels, athwart the baseline; what a turn by a / f leaves of that is a u^2 / f^2."""
    points = np.random.default_rng(1).uniform((-2.0, -1.5, 5.0), (2.0, 1.5, 20.0), (80, 3))
    t_cf = pose(np.eye(3), np.array([-0.74, -0.76, 0.19]))
    right = Camera("pinhole", 720, 480, (620.0, 620.0, 359.5, 239.5))
    turned = se3_exp([0.0, 0.0, 0.0, by / 620.0, by / 620.0, 0.0])[:3, :3]
    swayed, seen = right.project(points).uv + np.array([by, -by]), right.project(points - t_cf[:3, 3]).uv
    assert np.abs(swayed - right.project(points @ turned.T).uv).max() < 0.5 * by
    assert (_against([swayed, seen], t_cf, (620.0, 620.0)) > 1.0) == told


def test_every_attack_on_a_checkpoint_or_a_map_changes_what_is_there(ground: Ground, tmp_path: Path) -> None:
    """One on something that there is no more would end the whole suite."""
    for k, attack in enumerate(a for a in ATTACKS if a.group in ("checkpoint", "map")):
        folder = tmp_path / str(k)
        folder.mkdir()
        assert attack.make(Scene(folder, ground)).words, attack
        shutil.rmtree(folder)


def test_the_processes_run_this_python() -> None:
    assert performing.program(["m", "w"], {"n": 5})[-4:] == [sys.executable, "-m", "m", "w"]
