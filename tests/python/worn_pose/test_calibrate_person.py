"""How a person is built, measured with a board: the geometry, its consistency, its manners."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip, Short

from collabslam import geometry as g
from collabslam.checks.board import board_poses
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.datasets.ros.sensors import WornSensors, read_sensors, write_sensors
from collabslam.datasets.ros.writer import TOPICS
from collabslam.errors import DataError, InputError
from collabslam.targets import printed
from collabslam.targets.kinds import Board
from collabslam.targets.printed import board_corners, pose_between
from collabslam.types import Image
from collabslam.worn_pose import AhrsErrors, Person, WornPoseConfig, WornPoseEstimate, calibrate_person
from collabslam.worn_pose.attitude import AttitudeTrack
from collabslam.worn_pose.lever_arm import trunk
from collabslam.worn_pose.readings import AhrsReading, Wearer
from collabslam_lab.cli import main as lab
from collabslam_lab.worlds import WorldRecording, world_recording
from collabslam_lab.worlds.catalogue import BOARD
from collabslam_lab.worlds.sensors import config_of, estimated_poses, readings_of
from collabslam_lab.worn_sensors import camera_attitude

pytestmark = pytest.mark.slow

NAMES = ("corridor-2", "turn90-5", "h", "f")


@cache
def walk(name: str) -> tuple[WorldRecording, list[WornPoseEstimate], np.ndarray, np.ndarray]:
    """A walk towards the board: estimates, and poses as a board would show them, to 3 mm and 0.1 degrees."""
    world = world_recording(f"{name}-board")
    rng = np.random.default_rng(5)
    sd = np.array([0.003] * 3 + [0.0017] * 3)
    poses = [world.true_t_cf(i) @ g.se3_exp(sd * rng.standard_normal(6)) for i in range(len(world))]
    spread = np.repeat(np.diag(sd**2)[None], len(world), axis=0)
    return world, estimated_poses(world, readings_of(world, 0)), np.array(poses), spread


@pytest.fixture(scope="module")
def walked() -> tuple[WorldRecording, list[WornPoseEstimate], np.ndarray, np.ndarray]:
    return walk(NAMES[0])


def test_a_person_is_found_as_built_and_as_well_as_is_said() -> None:
    nees = []
    for name in NAMES:
        world, estimates, poses, spread = walk(name)
        fit = calibrate_person(Person(), estimates, poses, spread)
        build = world.scene.walk.walker.build
        error = np.array([*fit.person.lean, fit.person.camera_height]) - [*build.lean, build.camera_height]
        assert np.abs(error).max() < 0.03
        nees.append(error @ np.linalg.solve(fit.covariance, error))
        assert fit.person.lever_sd < 0.015
        assert fit.person.height_sd < 0.012
        assert fit.used > 0.9 * fit.given
        np.testing.assert_allclose(fit.person.lean, fit.correction[:2])
    assert np.sum(nees) < 32.9  # 99.9 % of 12


def test_what_was_found_makes_the_pose_better() -> None:
    time_correlated, bobbing = np.zeros(2), np.zeros(2)
    for name in NAMES[:2]:
        _, *measured = walk(name)
        fitted = calibrate_person(Person(), *measured).person
        world = world_recording(name)
        readings = readings_of(world, 0)
        for k, person in enumerate((Person(), fitted)):
            errors = [
                e.trunk.T @ (world.true_t_cf(i)[:3, 3] - e.t_cf[:3, 3])
                for i, e in enumerate(estimated_poses(world, readings, person))
                if e.t_cf is not None and e.trunk is not None
            ]
            time_correlated[k] += np.linalg.norm(np.mean(errors, axis=0))
            bobbing[k] += np.std(errors, axis=0)[2]
        assert fitted.bob_sd < 0.7 * Person().bob_sd
    assert time_correlated[1] < 0.6 * time_correlated[0]
    assert bobbing[1] < 0.6 * bobbing[0]  # the legs tell where in a step the person is


def test_a_second_walk_makes_the_person_better_known() -> None:
    _, *measured = walk(NAMES[0])
    once = calibrate_person(Person(), *measured).person
    world = WorldRecording(world_recording(f"{NAMES[0]}-board").recipe, 1)
    poses = np.array([world.true_t_cf(i) for i in range(len(world))])
    twice = calibrate_person(once, estimated_poses(world, readings_of(world, 1), once), poses, measured[2])
    assert twice.person.height_sd < once.height_sd
    assert twice.person.lever_sd < once.lever_sd
    build = world.scene.walk.walker.build
    error = np.array([*twice.person.lean, twice.person.camera_height]) - [*build.lean, build.camera_height]
    assert error @ np.linalg.solve(twice.covariance, error) < 16.3  # 99.9 % of 3


def test_a_board_shows_the_pose_between_both_cameras() -> None:
    world = world_recording("corridor-2-board")
    for i, metres in ((0, 0.5), (len(world) - 1, 0.02)):
        frame = world.frame(i)
        assert frame.views
        t_cf, covariance = pose_between(
            frame.image, world.camera, frame.views[0].image, world.worn_camera, [BOARD]
        )
        error = g.se3_log(g.pose_inverse(t_cf) @ world.true_t_cf(i))
        assert np.linalg.norm(error[:3]) < metres
        assert error @ np.linalg.solve(covariance, error) < 22.5  # 99.9 % of 6
    with pytest.raises(DataError, match="No printed target"):
        pose_between(frame.image, world.camera, frame.views[0].image, world.worn_camera, [Board(10, 7, 0.1)])


def test_the_trunk_faces_the_way_or_what_is_looked_at() -> None:
    looks_left = camera_attitude(np.pi / 2.0, -0.2, 0.0)
    walks = trunk(np.array([1.3, 0.0]), looks_left)
    assert np.degrees(np.arctan2(walks[1, 0], walks[0, 0])) == pytest.approx(8.6, abs=0.5)
    stands = trunk(np.zeros(2), looks_left)
    np.testing.assert_allclose(stands @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    for turn in (walks, stands):
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_a_level_robot_keeps_its_heading_and_loses_tilt() -> None:
    tilted = camera_attitude(0.7, 0.02, -0.01)
    half = AttitudeTrack("robot's", np.eye(3), 0.1, 1.0, 0.5)
    w, x, y, z = g.quaternion_wxyz(tilted)
    half.add(AhrsReading(0.0, np.array([x, y, z, w]), "robot"))
    found = half.at(0.0)
    assert found is not None
    up = np.arccos(-found[2, 1]), np.arccos(-tilted[2, 1])
    assert up[0] == pytest.approx(0.5 * up[1], rel=1e-6)
    assert np.arctan2(found[1, 2], found[0, 2]) == pytest.approx(0.7, abs=1e-3)
    config = config_of(world_recording("a"))
    alone = replace(config, level_sd=None)
    assert alone.tilt_share == 1.0
    assert alone.robot_tilt == pytest.approx((0.0087266**2 - 0.0034907**2, 0.0034907**2), rel=1e-4)
    assert sum(config.robot_tilt) == pytest.approx(1.0 / (config.level_sd**-2 + 0.0087266**-2), rel=1e-4)
    with pytest.raises(InputError, match="level_sd is -1"):
        replace(config, level_sd=-1.0)


def test_bad_input_is_named(
    walked: tuple[WorldRecording, list[WornPoseEstimate], np.ndarray, np.ndarray],
) -> None:
    _, estimates, poses, spread = walked
    person = Person()
    with pytest.raises(InputError, match=rf"^{len(poses)} estimates need poses \({len(poses)}, 4, 4\)"):
        calibrate_person(person, estimates, poses[1:], spread)
    gone = poses.copy()
    gone[:-5] = np.nan
    with pytest.raises(DataError, match="Only 5 instants"):
        calibrate_person(person, estimates, gone, spread)
    larger = poses.copy()
    larger[:, :3, 3] *= 1.3  # a board whose squares are smaller than was said
    with pytest.raises(DataError, match="check the board's size"):
        calibrate_person(person, estimates, larger, spread)
    with pytest.raises(InputError, match="upside down"):
        Board(8, 6, 0.1).check_direction()
    with pytest.raises(InputError, match=r"squares is -0\.1; give metres"):
        Board(9, 6, -0.1)
    with pytest.raises(InputError, match="lean is not two finite numbers"):
        replace(config_of(world_recording("a")), person=Person(lean=(0.0, float("nan"))))
    with pytest.raises(InputError, match="bob is not two finite numbers"):
        replace(config_of(world_recording("a")), person=Person(bob=(0.0, float("inf"))))


class _Alone:
    """A recording without a worn camera."""

    name, worn_camera = "alone", None

    def __len__(self) -> int:
        return 1


def test_a_recording_without_cf_is_named(
    tmp_path: Path, clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="alone has no worn camera"):
        board_poses(_Alone(), BOARD)  # type: ignore[arg-type]
    folder = write_recording(Short(clip, 3), tmp_path / "walk")
    words = ["calibrate-person", str(folder), "--board", "9x6:0.15"]
    assert cli.main(words) == 2
    assert "t_cf=sensors:FILE" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        cli.main([*words[:2], "--board", "nine"])


def test_a_person_from_a_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    known: dict[bytes, np.ndarray | None] = {}  # images come from the bag as they were written

    def corners(image: Image, board: Board) -> np.ndarray | None:
        key = repr((image.shape, board)).encode() + image.tobytes()
        if key not in known:
            known[key] = board_corners(image, board)
        return known[key]

    monkeypatch.setattr(printed, "board_corners", corners)
    bag = tmp_path / "walk"
    assert lab.main(["worlds", "corridor-2-board", str(bag), "--bag", "sqlite3"]) == 0
    file = bag / "sensors.yaml"
    topics = f"cs={TOPICS['cs']},cf={TOPICS['cf']},t_cf=sensors:{file}"
    capsys.readouterr()
    words = ["calibrate-person", str(bag), "--topics", topics, "--board", "9x6:0.15"]
    assert cli.main(words) == 0
    shown = capsys.readouterr().out
    world, estimates, *_ = walk("corridor-2-board")
    fit = calibrate_person(Person(), estimates, *board_poses(world, BOARD))
    assert f"# {fit.used} of {fit.given} frames fit" in shown
    file.write_text(file.read_text() + shown)  # what is printed can be written there
    person = read_sensors(file).config.person
    assert person.camera_height == pytest.approx(fit.person.camera_height, abs=1e-4)
    for name in ("lean", "surge", "bob"):
        np.testing.assert_allclose(getattr(person, name), getattr(fit.person, name), atol=1e-4)
    build = world.scene.walk.walker.build
    assert person.camera_height == pytest.approx(build.camera_height, abs=0.02)
    np.testing.assert_allclose(person.lean, build.lean, atol=0.025)


def test_a_sensors_file_comes_back_as_it_was(tmp_path: Path) -> None:
    person = Person(camera_height=1.66, lean=(0.02, -0.01), lever_sd=0.009)
    errors = AhrsErrors(yaw_sd=0.03, drift_time=20.0)
    config = WornPoseConfig(person=person, ahrs=errors, start=(0.5, 1.0), level_sd=0.004, max_gap=1.5)
    ahrs: dict[Wearer, str] = {"robot": "/imu", "worn": "/head/imu"}
    sensors = WornSensors(config, {"front": "/scan", "back": "/scan_back"}, ahrs)
    write_sensors(tmp_path / "sensors.yaml", sensors)
    found = read_sensors(tmp_path / "sensors.yaml")
    assert (found.scans, found.ahrs) == (sensors.scans, sensors.ahrs)
    assert found.config.person == person
    assert found.config.ahrs.yaw_sd == pytest.approx(0.03)
    assert (found.config.start, found.config.level_sd, found.config.max_gap) == ((0.5, 1.0), 0.004, 1.5)
    for name, pose in config.scanners.items():
        assert np.array_equal(found.config.scanners[name], pose)
    assert np.array_equal(found.config.r_f_ahrs, config.r_f_ahrs)
