"""The lab's wheels: they lead where the robot went, and err as they are told to."""

from __future__ import annotations

import numpy as np

from collabslam.geometry import pose_inverse
from collabslam_lab.hardware.odometry import CASES, RATE, Wheels, medians, simulated
from collabslam_lab.worlds import world_recording


def _driven(wheels: Wheels) -> tuple[np.ndarray, np.ndarray]:
    """Where dead reckoning puts the camera, and where it was, after five seconds of a turn; metres."""
    world = world_recording("turn90-0", 0)
    odometry = simulated(world.robot, world.times, wheels, np.random.default_rng(0))
    chosen = (odometry.times > odometry.times[1] + 3.0) & (odometry.times <= odometry.times[1] + 8.0)
    first, last = np.flatnonzero(chosen)[[0, -1]]
    base = np.eye(4)
    for twist in odometry.twists[first + 1 : last + 1]:
        turn = twist[5] / RATE
        step = np.eye(4)
        step[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        step[:2, 3] = twist[:2] / RATE
        base = base @ step
    begin, end = (world.robot(float(odometry.times[k])) for k in (first, last))
    camera = pose_inverse(odometry.t_bc) @ base @ odometry.t_bc
    return camera[:3, 3], (pose_inverse(begin) @ end)[:3, 3]


def test_wheels_lead_where_the_robot_went() -> None:
    told, true = _driven(Wheels())
    assert np.linalg.norm(true) > 3.0
    assert np.linalg.norm(told - true) < 0.1
    told, true = _driven(Wheels(scale=1.05))
    assert abs(np.linalg.norm(told) / np.linalg.norm(true) - 1.05) < 0.01
    told, _ = _driven(Wheels(spin=(4.0, 5.0)))
    assert np.linalg.norm(told - true) > 0.5


def test_the_table_has_a_row_for_each_case() -> None:
    row = {"avg_position_error_m": 0.1, "final_position_error_m": 0.2, "nees": 6.0, "ok_share": 1.0}
    lit = [row | {"case": case, "dark": False, "slipped": 0} for case in CASES]
    dark = [{"case": case, "dark": True, "dark_error_share": 0.01, "dark_nees": 5.0} for case in CASES]
    table = medians(lit + dark)
    assert all(f"| {case} | 0.100 | 0.200 | 6.0 | 100% | 0 | 1.0% | 1.0% | 5.0 |" in table for case in CASES)
