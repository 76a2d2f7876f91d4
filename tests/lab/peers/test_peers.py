"""Other systems beside this one: the command with an environment that is made up, without a network."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.clip import Clip, Short

from collabslam._core import Camera
from collabslam.datasets import write_recording
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError
from collabslam.geometry import rotation_exp
from collabslam.types import Array, Image, Recording
from collabslam_lab.cli import main as cli
from collabslam_lab.peers import environments
from collabslam_lab.peers.prepared import SystemResult, run_script, write_job
from collabslam_lab.peers.scored import apart, scored
from collabslam_lab.peers.systems import PEERS, SCRIPTS
from collabslam_lab.peers.undistorted import Undistorted
from collabslam_lab.peers.vocabulary import BRANCHES, train, write_vocabulary

FRAMES = 12
PLAN = """
seeds: [0]
recordings:
  walk: {worn: "lag:0.3", modes: [collab]}
"""
FAKE = """#!{python}
import json, sys
from pathlib import Path
import numpy as np
script, folder = Path(sys.argv[1]), Path(sys.argv[2])
job, images = json.loads((folder / "job.json").read_text()), np.load(folder / "left.npy")
assert len(images) == len(job["times"]) and images.dtype == np.uint8
truth = np.load({truth!r})
if script.name == "svo.py":
    print("out of memory")
    sys.exit(3)
name, frames = ("final", job["few"]) if script.name == "colmap.py" else ("live", range(len(images)))
places = {{k: (0.5 * truth[k, :3, 3] + 7).tolist() for k in frames[1:]}}
found = {{name: places, "cpu": 0.5, "wall": [0.01] * len(images)}}
if script.name == "colmap.py":
    found["turns"] = {{k: (np.diag([1, -1, -1]) @ truth[k, :3, :3]).tolist() for k in places}}
    found["covariances"] = {{k: (1e-4 * np.eye(6)).tolist() for k in places}}
    found["residual_px"] = 0.5
(folder / "found.json").write_text(json.dumps(found))
"""


def made_up(folder: Path, truth: Path) -> None:
    """Environments in which every system tells the truth at half its size, but for SVO, which breaks down."""
    for peer in PEERS:
        place = folder / peer.requirement.replace("==", "-")
        (place / "bin").mkdir(parents=True, exist_ok=True)
        python = place / "bin" / "python"
        python.write_text(FAKE.format(python=sys.executable, truth=str(truth)))
        python.chmod(0o755)
        (place / "installed.txt").write_text(peer.requirement + "\n")


@pytest.fixture(scope="module")
def table(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, object]]:
    place = tmp_path_factory.mktemp("peers")
    write_recording(Short(clip, FRAMES), place / "data" / "walk")
    (place / "data" / "evaluate.yaml").write_text(PLAN)
    np.save(place / "truth.npy", clip.recording.truth[:FRAMES])
    made_up(place / "envs", place / "truth.npy")
    words = ["--out", str(place / "out"), "--envs", str(place / "envs"), "--offline-frames", "6"]
    assert cli.main(["peers", str(place / "data"), "--systems", "collabslam,svo", *words]) == 0
    assert cli.main(["peers", str(place / "data"), "--systems", "orbslam3-mono,svo,colmap", *words]) == 0
    assert "orbslam3-mono" in (place / "out" / "peers.md").read_text()
    rows: list[dict[str, object]] = json.loads((place / "out" / "peers.json").read_text())
    return rows


def test_every_system_has_a_row(table: list[dict[str, object]]) -> None:
    rows = {str(row["system"]): row for row in table}
    assert len(rows) == len(table)
    assert set(rows) == {"collabslam, one camera", "collabslam, with Cf", "orbslam3-mono", "svo", "colmap"}
    assert {row["recording"] for row in table} == {"walk"}
    mono, colmap, ours = rows["orbslam3-mono"], rows["colmap"], rows["collabslam, with Cf"]
    assert mono["ate_sim3_pct"] == pytest.approx(0.0, abs=1e-6)
    assert mono["ate_se3_pct"] is None  # one camera alone has no scale
    assert (mono["coverage"], mono["cpu_ms"], mono["covariance"]) == (11 / 12, pytest.approx(500 / 12), False)
    assert (colmap["given"], colmap["coverage"], colmap["ate_sim3_live_pct"]) == (6, 5 / 6, None)
    assert (mono["attitude_deg"], colmap["attitude_deg"]) == (None, pytest.approx(0.0, abs=1e-6))
    assert colmap["attitude_to_ours_deg"] is None  # it was run by itself
    assert 0.0 < float(str(ours["attitude_deg"])) < 5.0
    assert ours["attitude_to_ours_deg"] is None
    assert ours["covariance"]
    assert isinstance(ours["ate_se3_pct"], float)
    assert 0.0 < float(str(ours["nees_position"])) < 100.0
    assert (colmap["residual_px"], mono["nees_attitude"]) == (0.5, None)  # the latter tells no covariance
    assert 0.0 < float(str(ours["cpu_ms"])) <= 1000.0 * 60.0
    assert rows["collabslam, one camera"]["ate_se3_pct"] is None


def test_a_system_that_breaks_down_is_a_row_with_the_reason(table: list[dict[str, object]]) -> None:
    svo = next(row for row in table if row["system"] == "svo")
    assert (svo["status"], svo["ate_sim3_pct"], svo["coverage"]) == ("failed", None, None)
    assert svo["error"] == "It ended with the code 3: out of memory"


def test_what_cannot_be_installed_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pip = "import sys; sys.exit('ERROR: No matching distribution found for svo-cpp==1.5.0')"
    (tmp_path / "python").write_text(f'#!/bin/sh\nexec {sys.executable} -c "{pip}"\n')
    (tmp_path / "python").chmod(0o755)
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    with pytest.raises(DataError, match="No matching distribution"):
        environments.install(PEERS[2], tmp_path / "envs")
    assert environments.interpreter(PEERS[2], tmp_path / "envs") is None


def test_junk_and_hangs_are_faults(clip: Clip, tmp_path: Path) -> None:
    python = tmp_path / "python"
    codes = {"exec sleep 60": "longer than 1 s", "echo '{' > found.json": "be read", "true": "be read"}
    for number, (code, message) in enumerate(codes.items()):
        folder = tmp_path / str(number)
        write_job(Short(clip, 3), folder)
        python.write_text(f"#!/bin/sh\n{code}\n")
        python.chmod(0o755)
        with pytest.raises(DataError, match=message):
            run_script(PEERS[2], python, folder, 1.0 if "sleep" in code else 60.0)


def test_errors_are_those_of_the_frames_with_a_pose() -> None:
    truth = np.tile(np.eye(4), (5, 1, 1))
    truth[:, :3, 3] = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0], [2, 2, 0]], float)
    places = {k: (2.0 * truth[k, :3, 3]).tolist() for k in range(4)}
    row = scored(SystemResult(places, {}, 1.0), truth, metric=True, given=5)
    assert row["ate_sim3_pct"] == pytest.approx(0.0, abs=1e-9)
    spread = truth[:4, :3, 3] - truth[:4, :3, 3].mean(axis=0)
    assert row["ate_se3_pct"] == pytest.approx(100.0 * np.sqrt((spread**2).sum(axis=1).mean()) / 4.0)
    assert row["coverage"] == 0.8
    assert scored(SystemResult({0: places[0]}, {}, 1.0), truth, metric=True, given=5)["ate_sim3_pct"] is None


def test_nees_is_what_was_drawn_whichever_the_world_and_its_scale() -> None:
    rng = np.random.default_rng(3)
    frames, scale = 400, 0.25
    truth = np.tile(np.eye(4), (frames, 1, 1))
    truth[:, :3, 3] = rng.normal(0.0, 3.0, (frames, 3))
    truth[:, :3, :3] = [rotation_exp(rng.normal(0.0, 1.0, 3)) for _ in range(frames)]
    sd = np.array([0.01, 0.02, 0.03, 0.001, 0.002, 0.003])
    drawn = rng.normal(0.0, 1.0, (frames, 6)) * sd
    drawn[7] = 0.0  # what is held fixed
    units = np.array([scale] * 3 + [1.0] * 3)
    world, places, turns, told = rotation_exp([0.3, -2.0, 0.7]), {}, {}, {}
    for k, pose in enumerate(truth):
        turn = pose[:3, :3] @ rotation_exp(drawn[k, 3:])
        turns[k] = world @ turn
        places[k] = (scale * (world @ (pose[:3, 3] + pose[:3, :3] @ drawn[k, :3]) + 5.0)).tolist()
        told[k] = np.diag((sd * units) ** 2 * (k != 7))
    row = scored(SystemResult(places, {}, 1.0, [], turns, told), truth, metric=False, given=frames)
    for part in ("position", "attitude"):
        assert row[f"nees_{part}"] == pytest.approx(3.0, abs=0.3)
        assert row[f"over_sd_{part}"] == pytest.approx(1.0, abs=0.05)
    halved = {k: p / 4.0 for k, p in told.items()}
    row = scored(SystemResult(places, {}, 1.0, [], turns, halved), truth, metric=False, given=frames)
    assert row["over_sd_attitude"] == pytest.approx(2.0, abs=0.1)


def test_attitudes_are_compared_whichever_way_the_worlds_are_turned() -> None:
    world = rotation_exp([0.3, -2.0, 0.7])
    truth = np.tile(np.eye(4), (5, 1, 1))
    truth[:, :3, :3] = [rotation_exp([0.1 * k, 0.0, 0.2]) for k in range(5)]
    nods = np.radians([1.0, -1.0, 1.0, -1.0])
    turns = {k: world @ truth[k, :3, :3] @ rotation_exp([nod, 0.0, 0.0]) for k, nod in enumerate(nods)}
    ours = {k: truth[k, :3, :3] @ rotation_exp([nod, 0.0, 0.0]) for k, nod in enumerate(nods)}
    row = scored(SystemResult({}, {}, 1.0, [], turns), truth, metric=False, given=5, ours=ours)
    assert row["attitude_deg"] == pytest.approx(1.0, abs=1e-3)
    assert row["attitude_to_ours_deg"] == pytest.approx(0.0, abs=1e-6)
    assert apart({0: world, 1: world}, {0: world, 1: world}) is None


class Bent(WrappedRecording):
    """The clip as a camera with distortion would have seen it, its frames white but for a dot."""

    def __init__(self, base: Recording, dot: Array) -> None:
        super().__init__(base)
        c = base.camera
        self.camera = Camera("radtan", c.width, c.height, c.intrinsics, [-0.2, 0.05, 0.0, 0.0])
        self._dot = self.camera.project(dot[None]).uv[0]

    def image(self, i: int) -> Image:
        image = np.zeros((self.camera.height, self.camera.width), np.uint8)
        cv2.circle(image, tuple(round(float(x)) for x in self._dot), 4, 255, -1)
        return image


def test_without_distortion_a_point_is_where_a_pinhole_sees_it(clip: Clip) -> None:
    dot = np.array([0.3, 0.2, 1.0])
    straight = Undistorted(Bent(Short(clip, 1), dot))
    v, u = np.nonzero(straight.image(0) > 100)
    fx, fy, cx, cy = straight.camera.intrinsics
    assert straight.camera.model == "pinhole"
    assert (u.mean(), v.mean()) == pytest.approx((fx * 0.3 + cx, fy * 0.2 + cy), abs=1.0)


def test_the_vocabulary_is_a_tree_of_words(clip: Clip, tmp_path: Path) -> None:
    nodes = train(clip.frames[i].image for i in range(0, 12, 3))
    write_vocabulary(nodes, tmp_path / "words.txt")
    head, *lines = (tmp_path / "words.txt").read_text().split("\n")
    assert head == f"{BRANCHES} 6 0 0"
    assert len(lines) == len(nodes)  # a last empty line would be taken for a node
    leaves = {k + 1 for k, node in enumerate(nodes) if node.leaf}
    parents = {node.parent for node in nodes}
    assert leaves.isdisjoint(parents)
    assert parents | leaves == set(range(len(nodes) + 1))
    assert all(node.parent <= k for k, node in enumerate(nodes))
    assert all(len(line.split()) == 35 for line in lines)
    with pytest.raises(DataError, match="too few corners"):
        train([np.zeros((100, 100), np.uint8)])


def test_scripts_are_no_part_of_the_package() -> None:
    """What a script imports is under another licence: it runs in its own environment, imported by nothing."""
    lab = SCRIPTS.parents[1]
    names = [path.stem for path in SCRIPTS.glob("*.py")]
    assert sorted(names) == sorted({Path(peer.script).stem for peer in PEERS})
    for path in lab.rglob("*.py"):
        text = path.read_text()
        assert "peers.scripts" not in text
        if path.parent != SCRIPTS:
            assert not any(f"import {wheel}" in text for wheel in ("pyorbslam3", "svo_cpp", "pycolmap"))
