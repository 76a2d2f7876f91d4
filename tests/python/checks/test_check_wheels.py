"""Odometry held against the motion of images: where Cs sits, axes, units, clock, and the mistakes by name."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.driven import wheels

from collabslam import RecordingWriter
from collabslam.checks.dead_reckoning import DeadReckoning
from collabslam.checks.mistakes import MOUNT_MISTAKES, OPTICAL_FROM_BODY
from collabslam.checks.wheels import DrivenPair, WheelsReport, judged
from collabslam.cli import main as cli
from collabslam.datasets.odometry import mount_of, mounted
from collabslam.datasets.poses import BODY_FROM_OPTICAL, OPENGL_FROM_OPTICAL
from collabslam.geometry import pose_inverse, rotation_log
from collabslam.types import Array, Odometry

MOUNT = (0.2, 0.05, 0.9, 3.0, 12.0, -4.0)
T_BC = mounted(MOUNT)
RATE, SECONDS = 50.0, 30.0
SD = np.array([0.02, 0.02, 0.05, 0.08, 0.08, 0.02])


def drive() -> Odometry:
    """A robot that drives ahead and to both sides, now slower and now faster."""
    times = np.arange(0.0, SECONDS, 1.0 / RATE)
    twists = np.zeros((len(times), 6))
    twists[:, 0] = 0.8 + 0.3 * np.sin(0.5 * times)
    twists[:, 5] = 0.5 * np.sin(1.3 * times) * (np.sin(0.4 * times) > 0.0)
    return Odometry(times, twists, np.tile(np.diag(SD**2), (len(times), 1, 1)), T_BC)


def seen(odometry: Odometry, t_bc: Array = T_BC, turning: float = 1.0) -> list[DrivenPair]:
    """What images would say of the drive: a degree off, with the shake of a robot, a few of them wrong."""
    generator, reckoned, pairs = np.random.default_rng(4), DeadReckoning(odometry), []
    for k, first in enumerate(np.linspace(0.5, SECONDS - 1.5, 30)):
        second = first + (0.4 if k % 2 else 1.0)
        moved = reckoned.between(first, second)
        assert moved is not None
        of_cs = pose_inverse(t_bc) @ moved @ t_bc
        turn = turning * rotation_log(of_cs[:3, :3]) + 0.005 * generator.standard_normal(3)
        length = float(np.linalg.norm(of_cs[:3, 3]))
        way = of_cs[:3, 3] / length + 0.02 * generator.standard_normal(3)
        if k % 10 == 3:
            turn, way = turn + 0.2, generator.standard_normal(3)
        pairs.append(DrivenPair(first, second, turn, way / np.linalg.norm(way), length))
    return pairs


def twisted(by: Array) -> Callable[[Odometry], Odometry]:
    """Twists along the axes that a matrix turns those of B into."""
    return lambda o: replace(o, twists=np.hstack([o.twists[:, :3] @ by.T, o.twists[:, 3:] @ by.T]))


def placed(undo: Callable[[Array], Array]) -> Callable[[Odometry], Odometry]:
    return lambda o: replace(o, t_bc=undo(o.t_bc))


def report_of(change: Callable[[Odometry], Odometry]) -> WheelsReport:
    odometry = drive()
    return judged(seen(odometry), change(odometry))


def test_what_fits_is_left_alone() -> None:
    report = report_of(lambda o: o)
    assert report.agrees
    assert report.findings == report.notes == []
    assert report.misfit is not None
    assert report.misfit.worst < np.deg2rad(3.0)
    assert report.turn_scale == pytest.approx(1.0, abs=0.03)


MISTAKES: list[tuple[Callable[[Odometry], Odometry], str]] = [
    (placed(pose_inverse), "T_BC is inverted: it maps from its frame B to Cs.*give its inverse"),
    (placed(lambda t: t @ OPTICAL_FROM_BODY), r"T_BC is that of Cs's body axes \(x forward"),
    (placed(lambda t: pose_inverse(t @ OPTICAL_FROM_BODY)), "T_BC is inverted, and of Cs's body axes"),
    (placed(lambda t: t @ BODY_FROM_OPTICAL), "T_BC was turned to optical axes although it had them"),
    (placed(lambda t: t @ OPENGL_FROM_OPTICAL), "T_BC is of OpenGL's axes of Cs"),
    (twisted(OPTICAL_FROM_BODY[:3, :3]), "twists are along optical axes"),
    (twisted(np.diag([1.0, -1.0, -1.0])), "turns positive to the right: .*negate vy, vz, wy and wz"),
    (twisted(np.diag([-1.0, -1.0, 1.0])), "x points back where Cs looks ahead"),
]


@pytest.mark.parametrize(("change", "said"), MISTAKES, ids=[m[1][:30] for m in MISTAKES])
def test_a_mistake_is_named(change: Callable[[Odometry], Odometry], said: str) -> None:
    report = report_of(change)
    (finding,) = report.findings
    assert re.search(said, finding.split(" (Or ")[0]), finding
    assert not report.agrees
    # What is told to be right fits; a mistake in T_BC is undone to the place where Cs was.
    told = re.search(r"--odometry-camera (\S+?)\.? ?(\(|$)", finding)
    assert told is not None
    mended = mounted(tuple(float(x) for x in told[1].split(",")))
    given = change(drive())
    assert judged(seen(drive()), replace(given, t_bc=mended)).agrees
    if "T_BC" in said:
        np.testing.assert_allclose(mount_of(mended), MOUNT, atol=0.02)


def test_every_mistake_has_its_input() -> None:
    assert len(MISTAKES) == len(MOUNT_MISTAKES)
    for mistake, (_, said) in zip(MOUNT_MISTAKES, MISTAKES, strict=True):
        assert re.search(said.split(".*")[0].removesuffix(": "), mistake.fault), mistake.fault


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            placed(lambda _: mounted((0.2, 0.05, 0.9))),
            r"sits otherwise on the robot: 13 degrees.*0\.9,[23]\.\d+,1[12]\.\d+,-[34]",
        ),
        (
            placed(lambda t: mounted((*MOUNT[:3], 3.0, 12.0, 86.0))),
            "sits otherwise on the robot: (89|90|91) degrees",
        ),
        (lambda o: replace(o, twists=o.twists * [1, 1, 1, 57.3, 57.3, 57.3]), "in degrees a second"),
        (lambda o: replace(o, twists=o.twists * [1, 1, 1, 1.3, 1.3, 1.3]), "turns times 0.7[67] fit"),
        (lambda o: replace(o, twists=o.twists * [1e3, 1e3, 1e3, 1, 1, 1]), "ways times 0.001 are as long"),
        (lambda o: replace(o, times=o.times + 0.2), r"clock is off: with -0\.(19|20|21) s added"),
        (lambda o: replace(o, twists=o.twists[::-1]), "does not move as the images do, wherever Cs sits"),
    ],
    ids=["level", "yaw", "degrees", "turns", "mm/s", "late", "another's"],
)
def test_what_else_may_be_wrong(change: Callable[[Odometry], Odometry], said: str) -> None:
    report = report_of(change)
    assert len(report.findings) == 1
    assert re.search(said, report.findings[0]), report.findings


def test_what_the_motion_does_not_tell_is_said() -> None:
    ahead = replace(drive(), twists=drive().twists * [1, 1, 1, 0, 0, 0])
    straight = judged(seen(ahead), ahead)
    assert straight.agrees
    assert "hardly turns" in straight.notes[0]
    (finding,) = judged(seen(ahead), replace(ahead, t_bc=pose_inverse(T_BC))).findings
    assert "T_BC is inverted" in finding
    spot = replace(drive(), twists=drive().twists * [0, 0, 0, 1, 1, 1])
    turning = judged([p._replace(way=None) for p in seen(spot)], spot)
    assert turning.agrees
    assert "hardly goes anywhere" in turning.notes[0]
    still = judged(seen(drive())[:3], drive())
    assert not still.agrees
    assert "Fewer than 6 pairs" in still.notes[0]


def test_an_axis_that_is_not_measured_counts_as_zero_and_gaps_are_not_bridged() -> None:
    odometry = drive()
    unmeasured = np.tile(np.diag([0.02, 0.02, 100.0, 100.0, 100.0, 0.02]) ** 2, (len(odometry), 1, 1))
    noise = np.random.default_rng(1).standard_normal((len(odometry), 6)) * [0, 0, 5, 5, 5, 0]
    assert judged(
        seen(odometry), replace(odometry, twists=odometry.twists + noise, covariances=unmeasured)
    ).agrees
    kept = (odometry.times < 5.0) | (odometry.times > 7.0)
    parts = (odometry.twists[kept], odometry.covariances[kept])
    reckoned = DeadReckoning(Odometry(odometry.times[kept], *parts, T_BC))
    assert reckoned.between(4.0, 4.5) is not None
    assert reckoned.between(4.5, 7.5) is None
    assert np.isnan(reckoned.way(4.5, 7.5))
    assert reckoned.between(29.0, 31.0) is None
    assert DeadReckoning(odometry).way(1.0, 2.0) == pytest.approx(
        float(np.mean(odometry.twists[(odometry.times > 1.0) & (odometry.times <= 2.0), 0])), abs=1e-3
    )


@pytest.mark.parametrize(
    "mount", [MOUNT, (0.0, 0.0, 0.0, -170.0, 30.0, 100.0), (1.0, 2.0, 3.0, 0.0, 90.0, 20.0)]
)
def test_a_mount_is_told_as_it_is_given(mount: tuple[float, ...]) -> None:
    np.testing.assert_allclose(mounted(mount_of(mounted(mount))), mounted(mount), atol=1e-9)


def test_the_command_names_it_and_what_it_names_fits(
    clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = wheels(clip, t_bc=mounted((0.2, 0.0, 0.9)))
    walk, csv = tmp_path / "walk", tmp_path / "wheels.csv"
    with RecordingWriter(walk, clip.recording.camera, t_bc=pose_inverse(given.t_bc)) as writer:
        for frame in clip.frames:
            writer.add(1.0 + frame.t, frame.image)
        for t, twist, covariance in zip(given.times, given.twists, given.covariances, strict=True):
            writer.add_odometry(1.0 + t, twist, covariance)
    assert cli.main(["check-calib", str(walk)]) == 1
    said = capsys.readouterr().out
    assert "The odometry's T_BC is inverted" in said
    assert re.search(r"ways of \d+ pairs beside the odometry's +\d+\.\d degrees", said)
    told = re.search(r"--odometry-camera (\S+?)\. ", said)
    assert told is not None
    rows = np.column_stack([1.0 + given.times, given.twists])
    np.savetxt(csv, rows, delimiter=",")
    options = ["--odometry", str(csv), "--odometry-sd", "0.02,0.02", "--odometry-camera", told[1]]
    assert cli.main(["check-calib", str(walk), *options]) == 0
    assert "The odometry moves as the images do" in capsys.readouterr().out
