"""The measurements on real people and real inertial units, on small made-up recordings of both kinds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from collabslam.errors import DataError
from collabslam_lab.cli import main as lab
from collabslam_lab.real_people import ahrs, legs

PERIOD, BEAMS, STEP = 0.1, 360, np.radians(0.75)


def write_legs(path: Path) -> None:
    """A person walks past a robot that stands in a room of 8 m, on two legs of 6 cm radius."""
    angles = -0.5 * (BEAMS - 1) * STEP + STEP * np.arange(BEAMS)
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    times, scans, truth = PERIOD * np.arange(60), [], []
    for t in times:
        ranges = (4.0 / np.abs(rays).max(axis=1)).astype(float)
        middle = np.array([2.0, -2.5 + 0.9 * t])
        for side in (-0.12, 0.12):
            leg = middle + np.array([side, 0.0])
            along = rays @ leg
            gap = 0.06**2 - (leg @ leg - along**2)
            hit = (gap > 0.0) & (along > 0.0)
            ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(gap[hit]))
        scans.append(ranges)
        truth.append([t + PERIOD, *middle, 7.0])
    odom = np.column_stack([np.arange(-1.0, 7.0, 0.05), np.zeros((160, 3))])
    scan = [angles[0], STEP, 0.05, 20.0]
    np.savez(path, ranges=scans, t_header=times, scan=scan, odom=odom, truth=truth[10:50:3])


def test_a_person_in_a_room_is_seen_and_nobody_else(tmp_path: Path) -> None:
    write_legs(tmp_path / "room.npz")
    found = legs.judge(legs.read_legs(tmp_path / "room.npz"))
    person = found.walking
    assert person.annotated == person.in_scan == 14
    assert person.legs >= 12
    assert person.tracked >= 10
    assert person.followed >= 10
    assert person.elsewhere == found.made_up == 0
    assert found.walkers >= 8
    assert found.alone == 0
    assert found.standing == legs.Group()
    assert np.isnan(found.way)  # the robot stands
    (tmp_path / "bad.npz").write_bytes(b"PK nothing")
    with pytest.raises(DataError, match="holds no scans of legs"):
        legs.read_legs(tmp_path / "bad.npz")


def write_hall(path: Path) -> None:
    """A person comes straight towards a robot in a hall too wide for its scanner, a leg behind the other."""
    angles = -0.5 * (BEAMS - 1) * STEP + STEP * np.arange(BEAMS)
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    times, scans, truth = PERIOD * np.arange(50), [], []
    for t in times:
        ranges = np.where(np.abs(angles) > 1.5, 3.0 / np.maximum(np.abs(rays[:, 1]), 0.1), np.inf)
        middle = np.array([6.0 - 0.9 * t, 0.5])
        for ahead in (-0.2, 0.2):
            leg = middle * (1.0 + ahead / np.linalg.norm(middle))
            along = rays @ leg
            gap = 0.06**2 - (leg @ leg - along**2)
            hit = (gap > 0.0) & (along > 0.0)
            ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(gap[hit]))
        ranges[ranges > 8.0] = np.inf
        scans.append(ranges)
        truth.append([t + PERIOD, *middle, 7.0])
    odom = np.column_stack([np.arange(-1.0, 6.0, 0.05), np.zeros((140, 3))])
    np.savez(
        path, ranges=scans, t_header=times, scan=[angles[0], STEP, 0.05, 8.0], odom=odom, truth=truth[20:45:3]
    )


def test_who_comes_straight_on_in_a_hall_without_walls_is_followed(tmp_path: Path) -> None:
    write_hall(tmp_path / "hall.npz")
    found = legs.judge(legs.read_legs(tmp_path / "hall.npz"))
    assert found.walking.annotated == 9
    assert found.walking.tracked >= 7
    assert found.walkers >= 5
    assert found.alone == 0


def test_an_inertial_unit_that_turns_slowly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from scipy.io import savemat

    rate, count = 200.0, 8000
    angle = 0.2 * np.arange(count) / rate  # about the vertical
    gyr, acc = np.tile([0.0, 0.0, 0.2], (count, 1)), np.tile([0.0, 0.0, 9.81], (count, 1))
    mag = 40.0 * np.column_stack([np.sin(angle), np.cos(angle), np.full(count, -1.0)])
    true = np.column_stack([np.cos(angle / 2), np.zeros((count, 2)), np.sin(angle / 2)])
    content = {"imu_gyr": gyr, "imu_acc": acc, "imu_mag": mag, "opt_quat": true}
    savemat(tmp_path / "trial.mat", {**content, "movement": np.ones((count, 1)), "sampling_rate": rate})
    errors = ahrs.judge(tmp_path / "trial.mat")
    assert errors.tilt < 0.1
    assert errors.heading < 0.3
    assert errors.carried < 0.05
    write_legs(tmp_path / "room.npz")
    assert lab.main(["people", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "14 of 14" in printed
    assert "trial" in printed
    (tmp_path / "empty").mkdir()
    assert lab.main(["people", str(tmp_path / "empty")]) == 2
    savemat(tmp_path / "other.mat", {"x": 1.0})
    with pytest.raises(DataError, match="not a recording of an inertial unit"):
        ahrs.judge(tmp_path / "other.mat")
