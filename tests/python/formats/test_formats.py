"""Every format is read back by the tool that users read it with."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.stand_ins import step_result
from rosbags.highlevel import AnyReader

from collabslam import geometry as g
from collabslam.cli import main as cli
from collabslam.errors import DataError
from collabslam.evaluation.record import RunRecord
from collabslam.formats import landmarks, trajectory
from collabslam.formats import ros_odometry as rosbag
from collabslam.results import Landmarks
from collabslam.runs.folder import MARK
from collabslam.runs.results import ResultWriter
from collabslam.runs.run_folder import RunFolder

TOOLS = Path(sys.executable).parent
COUNT = 60
SHIFT = 0.02
SIGMAS = np.array([0.02, 0.03, 0.04, 0.005, 0.006, 0.007])
TIMES = 1.5e9 + 0.1 * np.arange(COUNT)
TRUTH = np.array(
    [
        g.se3_exp([np.sin(0.2 * k), 0.1 * np.cos(k), 0.1 * k, 0.05 * np.sin(k), 0.02 * k, 0])
        for k in range(COUNT)
    ]
)


def tool(name: str, *arguments: object) -> str:
    """Standard output of a program that a user would run."""
    command = [str(TOOLS / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def rmse(text: str) -> float:
    """The figure ``rmse`` that evo prints."""
    return float(next(line.split()[1] for line in text.splitlines() if line.strip().startswith("rmse")))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder whose estimates are off by errors drawn from their own covariance, after a shift."""
    folder = tmp_path_factory.mktemp("run") / "run"
    draw = np.random.default_rng(3)
    record = RunRecord()
    points = draw.normal(size=(7, 3))
    spread = draw.normal(size=(7, 3, 3))
    cloud = Landmarks(np.arange(7) * 3, points, spread @ spread.transpose(0, 2, 1))
    with ResultWriter(folder, MARK + ": test\n") as writer:
        for k in range(COUNT):
            pose = TRUTH[k] @ g.se3_exp(SIGMAS * draw.normal(size=6))
            step = step_result(TIMES[k], pose, np.diag(SIGMAS**2), {"accepted": 20})
            record.append(step, worn=False, seconds=0.01)
            writer.frame(record)
        writer.finish(record, cloud, TRUTH, {"mode": "mono"})
    return folder


@pytest.mark.slow
def test_evo_reads_the_tum_files(run: Path) -> None:
    estimate, truth = run / "trajectory.tum", run / "groundtruth.tum"
    expected = np.sqrt(np.mean(np.sum((RunFolder(run).trajectory()[1] - TRUTH)[:, :3, 3] ** 2, axis=1)))
    assert rmse(tool("evo_ape", "tum", truth, estimate)) == pytest.approx(expected, rel=1e-4)
    assert 0.0 < rmse(tool("evo_rpe", "tum", truth, estimate)) < 0.2


@pytest.mark.slow
def test_smfeval_tells_a_consistent_covariance_from_one_that_is_not(run: Path, tmp_path: Path) -> None:
    times, _, covariances = RunFolder(run).trajectory()
    tight = tmp_path / "tight.cov"
    trajectory.write_covariances(tight, times, covariances / 25.0)
    too_small = []
    for sidecar in (run / "trajectory.cov", tight):
        text = tool("smfeval", "nees", run / "trajectory.tum", run / "groundtruth.tum", "--cov", sidecar,
                    "--est-body-frame", "cam", "--ref-body-frame", "cam", "--gauge", "fixed",
                    "--align", "none", "--json")  # fmt: skip
        too_small.append(json.loads(text)["k"])
    assert 0.6 < too_small[0] < 1.6
    assert too_small[1] == pytest.approx(25.0 * too_small[0], rel=1e-6)


def test_an_export_replaces_nothing(run: Path, tmp_path: Path) -> None:
    for name, kind in (("a.csv", "euroc"), ("a.csv", "csv"), ("b.txt", "kitti"), ("b.times.txt", "kitti")):
        mine = tmp_path / name
        mine.write_text("mine")
        out = tmp_path / name.replace(".times", "")
        assert cli.main(["export", str(run), str(out), "--format", kind]) == 2
        assert mine.read_text() == "mine"
        mine.unlink()


@pytest.mark.slow
def test_evo_reads_euroc_and_kitti(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    euroc, kitti = tmp_path / "run.csv", tmp_path / "run.txt"
    assert cli.main(["export", str(run), str(euroc), "--format", "euroc"]) == 0
    assert cli.main(["export", str(run), str(kitti), "--format", "kitti"]) == 0
    assert "60 poses" in capsys.readouterr().out
    assert rmse(tool("evo_ape", "euroc", euroc, run / "trajectory.tum")) < 1e-6
    truth = tmp_path / "truth.txt"
    trajectory.write_kitti(truth, TIMES, TRUTH)
    against_tum = rmse(tool("evo_ape", "tum", run / "groundtruth.tum", run / "trajectory.tum"))
    assert rmse(tool("evo_ape", "kitti", truth, kitti)) == pytest.approx(against_tum, abs=1e-6)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "run.times.txt"), TIMES, atol=1e-6)


@pytest.mark.parametrize("kind", ["ros2", "ros2-mcap"])
def test_rosbags_reads_the_odometry(run: Path, tmp_path: Path, kind: str) -> None:
    bag = tmp_path / "bag"
    assert cli.main(["export", str(run), str(bag), "--format", kind]) == 0
    assert cli.main(["export", str(run), str(bag), "--format", kind]) == 2  # it is there already
    _, poses, covariances = RunFolder(run).trajectory()
    with AnyReader([bag]) as reader:
        assert reader.topics[rosbag.TOPIC].msgtype == "nav_msgs/msg/Odometry"
        messages = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
    assert len(messages) == COUNT
    for k in (0, 41):
        stamp, position = messages[k].header.stamp, messages[k].pose.pose.position
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(TIMES[k], abs=1e-6)
        np.testing.assert_allclose([position.x, position.y, position.z], poses[k, :3, 3])
        p = np.asarray(messages[k].pose.covariance).reshape(6, 6)
        np.testing.assert_allclose(p, g.tangent_to_fixed(poses[k], covariances[k]))
    assert messages[0].twist.covariance[0] == -1.0


def test_a_bag_says_where_loops_put_the_odometry(run: Path, tmp_path: Path) -> None:
    times, poses, covariances = RunFolder(run).trajectory()
    moved = g.se3_exp([1.0, 0.5, -0.2, 0.1, 0.0, 0.2])
    rosbag.write_odometry(tmp_path / "bag", times, poses, covariances, moved @ poses)
    with AnyReader([tmp_path / "bag"]) as reader:
        messages = [
            reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if c.topic == "/tf"
        ]
    assert len(messages) == COUNT
    (found,) = messages[7].transforms
    assert (found.header.frame_id, found.child_frame_id) == (rosbag.MAP, rosbag.WORLD)
    at, turn = found.transform.translation, found.transform.rotation
    seen = g.pose_from_quaternion([at.x, at.y, at.z], [turn.w, turn.x, turn.y, turn.z])
    np.testing.assert_allclose(seen, moved, atol=1e-7)


def test_fixed_axis_covariance_is_that_of_fixed_axis_errors() -> None:
    draw = np.random.default_rng(5)
    pose = TRUTH[20]
    root = 1e-3 * draw.normal(size=(6, 6))
    covariance = root @ root.T
    errors = (root @ draw.normal(size=(6, 20000))).T
    seen = []
    for xi in errors[:4000]:
        moved = pose @ g.se3_exp(xi)
        turn = g.rotation_log(moved[:3, :3] @ pose[:3, :3].T)
        seen.append(np.concatenate([moved[:3, 3] - pose[:3, 3], turn]))
    expected = g.tangent_to_fixed(pose, covariance)
    np.testing.assert_allclose(np.cov(np.array(seen).T), expected, atol=0.08 * np.abs(expected).max())


def test_the_map_reads_back(run: Path, tmp_path: Path) -> None:
    points = RunFolder(run).landmarks()
    assert points.ids.tolist() == [0, 3, 6, 9, 12, 15, 18]
    assert cli.main(["export", str(run), str(tmp_path / "map.csv"), "--format", "csv"]) == 0
    table = np.genfromtxt(tmp_path / "map.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["y"], points.points[:, 1], rtol=1e-6)
    np.testing.assert_allclose(table["cov_yz"], points.covariance[:, 1, 2], rtol=1e-6)
    np.testing.assert_allclose(table["sigma_z"] ** 2, points.covariance[:, 2, 2], rtol=1e-5)


def test_what_is_no_result_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["export", str(tmp_path), str(tmp_path / "x"), "--format", "euroc"]) == 2
    assert "is not a result folder" in capsys.readouterr().err
    (tmp_path / "map.ply").write_bytes(b"ply\nproperty float x\nend_header\n")
    with pytest.raises(DataError, match="not written by collabslam"):
        landmarks.read_ply(tmp_path / "map.ply")
    with pytest.raises(DataError, match="cannot be read"):
        trajectory.read_covariances(tmp_path / "none.cov")
    (tmp_path / "file").write_text("")
    assert cli.main(["export", str(run), str(tmp_path / "file" / "x.csv"), "--format", "euroc"]) == 2
    assert "cannot be written" in capsys.readouterr().err
