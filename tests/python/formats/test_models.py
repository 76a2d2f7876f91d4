"""Models for reconstruction tools: COLMAP's own reader finds cameras, poses and points where they were."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.stand_ins import step_result

from collabslam import geometry as g
from collabslam._core import Camera
from collabslam.cli import main as cli
from collabslam.datasets import RecordingWriter
from collabslam.errors import DataError
from collabslam.evaluation.record import RunRecord
from collabslam.formats.colmap import write_colmap
from collabslam.formats.landmarks import write_ply
from collabslam.formats.nerfstudio import CLOUD, write_transforms
from collabslam.formats.trajectory import write_tum
from collabslam.level import Level
from collabslam.results import Landmarks
from collabslam.runs.folder import MARK
from collabslam.runs.results import CORRECTED, LEVEL_TRAJECTORY, SUMMARY, WHOLE_MAP, ResultWriter
from collabslam.runs.run_folder import RunFolder
from collabslam.types import Status

INTRINSICS = (61.0, 63.0, 31.2, 23.4)
LENSES = {
    "pinhole": Camera("pinhole", 64, 48, INTRINSICS),
    "radtan4": Camera("radtan", 64, 48, INTRINSICS, [-0.1, 0.02, 1e-3, -2e-3]),
    "radtan5": Camera("radtan", 64, 48, INTRINSICS, [-0.1, 0.02, 1e-3, -2e-3, 0.01]),
    "radtan8": Camera("radtan", 64, 48, INTRINSICS, [0.3, 0.1, 1e-3, -2e-3, 0.01, 0.4, 0.12, 0.02]),
    "fisheye": Camera("fisheye", 64, 48, INTRINSICS, [-0.02, 0.01, -3e-3, 1e-3]),
}
COUNT, LOST = 9, 4
POSES = np.array([g.se3_exp([0.2 * k, -0.1 * k, 0.3, 0.05 * k, 0.02, -0.1 * k]) for k in range(COUNT)])
CLOUD_POINTS = Landmarks(
    np.array([0, 5, 9]), np.random.default_rng(1).normal(size=(3, 3)), np.zeros((3, 3, 3))
)
READ = """
import json, sys, numpy as np, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
lens = model.cameras[1]
rays = np.array(json.loads(sys.argv[2]))
print(json.dumps({
    "model": lens.model.name,
    "size": [lens.width, lens.height],
    "pixels": [np.asarray(lens.img_from_cam(ray)).ravel().tolist() for ray in rays],
    "names": [image.name for _, image in sorted(model.images.items())],
    "centres": [image.projection_center().tolist() for _, image in sorted(model.images.items())],
    "turns": [image.cam_from_world().rotation.matrix().tolist() for _, image in sorted(model.images.items())],
    "points": {str(k): point.xyz.tolist() for k, point in model.points3D.items()},
}))
"""


def colmap_reads(folder: Path, rays: np.ndarray) -> dict[str, Any]:
    """What COLMAP, in a process of its own, finds in a model; ``rays`` (N, 3) through its lens."""
    pytest.importorskip("pycolmap")
    command = [sys.executable, "-c", READ, str(folder), json.dumps(rays.tolist())]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize("name", LENSES)
def test_colmap_has_the_same_lens(tmp_path: Path, name: str) -> None:
    rays = np.array([[0.0, 0.0, 1.0], [0.2, -0.3, 1.0], [-0.35, 0.15, 1.0]])
    write_colmap(tmp_path, LENSES[name], ["a.png"], POSES[:1], CLOUD_POINTS, text=False)
    found = colmap_reads(tmp_path, rays)
    # COLMAP's first pixel has its centre at (0.5, 0.5), ours at (0, 0).
    np.testing.assert_allclose(found["pixels"], LENSES[name].project(rays).uv + 0.5, atol=1e-9)
    assert found["size"] == [64, 48]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder with a frame that has no pose, and beside it its recording."""
    folder = tmp_path_factory.mktemp("run")
    camera = LENSES["radtan5"]
    with RecordingWriter(folder / "walk", camera) as recording:
        for k in range(COUNT):
            recording.add(0.1 * k, np.full((48, 64), 20 * k, np.uint8))
    record = RunRecord()
    with ResultWriter(folder / "run", MARK + ": test\n") as writer:
        for k in range(COUNT):
            status = Status.LOST if k == LOST else Status.OK
            step = step_result(0.1 * k, POSES[k], np.eye(6), {"accepted": 20}, status)
            record.append(step, worn=False, seconds=0.01)
            writer.frame(record)
        names = ("model", "width", "height", "intrinsics", "distortion")
        writer.finish(record, CLOUD_POINTS, None, {"camera": {n: getattr(camera, n) for n in names}})
    return folder


@pytest.mark.parametrize("kind", ["colmap", "colmap-text"])
def test_colmap_reads_poses_points_and_names(run: Path, tmp_path: Path, kind: str) -> None:
    out = tmp_path / "model"
    words = ["export", str(run / "run"), str(out), "--format", kind, "--images", str(run / "walk")]
    assert cli.main(words) == 0
    found = colmap_reads(out / "sparse" / "0", np.array([[0.0, 0.0, 1.0]]))
    left = [k for k in range(COUNT) if k != LOST]
    assert found["names"] == [f"{k:06d}.png" for k in left]
    np.testing.assert_allclose(found["centres"], POSES[left, :3, 3], atol=1e-8)
    np.testing.assert_allclose(found["turns"], POSES[left, :3, :3].transpose(0, 2, 1), atol=1e-8)
    points = [found["points"][str(k + 1)] for k in CLOUD_POINTS.ids]
    np.testing.assert_allclose(points, CLOUD_POINTS.points, atol=1e-7)
    for k, name in zip(left, found["names"], strict=True):
        image = cv2.imread(str(out / "images" / name), cv2.IMREAD_GRAYSCALE)
        assert (image == 20 * k).all()
    assert cli.main(words) == 2  # it is there already


def test_a_model_has_what_loops_corrected(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run / "run", tmp_path / "run")
    moved = g.se3_exp([1.0, 0.5, -0.2, 0.1, 0.0, 0.2])
    poses = moved @ RunFolder(tmp_path / "run").trajectory()[1]
    write_tum(tmp_path / "run" / CORRECTED, 0.1 * np.arange(len(poses)), poses)
    left = Landmarks(np.array([0, 77]), np.array([[5.0, 6.0, 7.0], [1.0, 2.0, 3.0]]), np.zeros((2, 3, 3)))
    write_ply(tmp_path / "run" / WHOLE_MAP, left)
    assert cli.main(["export", str(tmp_path / "run"), str(tmp_path / "m"), "--format", "colmap"]) == 0
    found = colmap_reads(tmp_path / "m" / "sparse" / "0", np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(found["centres"], poses[:, :3, 3], atol=1e-7)
    beyond = CLOUD_POINTS.points[1:] @ moved[:3, :3].T + moved[:3, 3]  # 0 is a submap's, 5 and 9 are not
    expected = {1: left.points[0], 78: left.points[1], 6: beyond[0], 10: beyond[1]}
    assert {int(k) for k in found["points"]} == set(expected)
    for k, point in expected.items():
        np.testing.assert_allclose(found["points"][str(k)], point, atol=1e-6)
    up = np.array([0.1, -0.9, 0.2])
    level = Level(up / np.linalg.norm(up), np.zeros((2, 2)), "told")
    summary = tmp_path / "run" / SUMMARY
    summary.write_text(json.dumps(json.loads(summary.read_text()) | {"level": level.numbers()}))
    write_tum(tmp_path / "run" / LEVEL_TRAJECTORY, 0.1 * np.arange(len(poses)), poses)
    words = ["export", str(tmp_path / "run"), str(tmp_path / "l"), "--format", "colmap", "--world", "level"]
    assert cli.main(words) == 0
    found = colmap_reads(tmp_path / "l" / "sparse" / "0", np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(found["centres"], poses[:, :3, 3] @ level.r_lw.T, atol=1e-7)
    turns = (level.r_lw @ poses[:, :3, :3]).transpose(0, 2, 1)
    np.testing.assert_allclose(found["turns"], turns, atol=1e-7)
    for k, point in expected.items():
        np.testing.assert_allclose(found["points"][str(k)], level.r_lw @ point, atol=1e-6)
    of_length_2, no_number = {"up": [0.0, -2.0, 0.0]}, {"up": [float("nan"), -1.0, 0.0]}
    for wrong in (None, of_length_2, no_number):
        summary.write_text(json.dumps(json.loads(summary.read_text()) | {"level": wrong}))
        assert cli.main([*words[:2], str(tmp_path / "none"), *words[3:]]) == 2
        assert not (tmp_path / "none").exists()


def test_nerfstudio_sees_a_point_where_the_camera_saw_it(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "model"
    assert cli.main(["export", str(run / "run"), str(out), "--format", "nerfstudio"]) == 0
    content = json.loads((out / "transforms.json").read_text())
    assert content["camera_model"] == "OPENCV"
    lens = np.array([[content["fl_x"], 0, content["cx"]], [0, content["fl_y"], content["cy"]], [0, 0, 1]])
    coefficients = np.array([content[k] for k in ("k1", "k2", "p1", "p2", "k3")])
    point = np.array([0.1, -0.2, 2.0])
    for k, frame in zip((0, 7), (content["frames"][0], content["frames"][6]), strict=True):
        assert frame["file_path"] == f"images/{k:06d}.png"
        seen = POSES[k][:3, :3] @ point + POSES[k][:3, 3]
        x, y, z, _ = np.linalg.inv(frame["transform_matrix"]) @ [*seen, 1.0]
        assert z < 0.0  # OpenGL looks along -z, y is up
        pixel, _ = cv2.projectPoints(np.array([[x, -y, -z]]), np.zeros(3), np.zeros(3), lens, coefficients)
        np.testing.assert_allclose(pixel[0, 0], LENSES["radtan5"].project(point[None]).uv[0] + 0.5, atol=1e-9)
    head, _, body = (out / CLOUD).read_bytes().partition(b"end_header\n")
    assert b"element vertex 3" in head
    rows = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]))
    np.testing.assert_allclose(rows["xyz"], CLOUD_POINTS.points, atol=1e-6)


def test_what_a_tool_cannot_hold_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    davison = Camera("wideangle", 64, 48, INTRINSICS, [1e-5])
    with pytest.raises(DataError, match="know no lens 'wideangle'"):
        write_colmap(tmp_path, davison, [], POSES[:0], CLOUD_POINTS, text=True)
    with pytest.raises(DataError, match="no rational lens"):
        write_transforms(tmp_path, LENSES["radtan8"], [], POSES[:0], CLOUD_POINTS)
    words = ["export", str(run / "run"), str(tmp_path / "a.csv"), "--format", "euroc", "--images", "x"]
    assert cli.main(words) == 2
    assert "leave --images out for euroc" in capsys.readouterr().err
    with RecordingWriter(tmp_path / "short", LENSES["radtan5"]) as short:
        short.add(0.0, np.zeros((48, 64), np.uint8))
    words = ["export", str(run / "run"), str(tmp_path / "m"), "--format", "colmap"]
    assert cli.main([*words, "--images", str(tmp_path / "short")]) == 2
    assert "give the run's own" in capsys.readouterr().err
    assert not (tmp_path / "m").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["short"]
