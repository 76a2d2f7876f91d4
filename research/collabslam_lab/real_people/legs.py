"""Real people's legs in laser scans of a moving robot: are they seen, are they followed, who is made up.

A recording is an ``.npz`` file: ``ranges`` (N, K) metres, ``t_header`` (N,) seconds, ``scan`` (angle of the
first beam, increment, least and largest range), ``odom`` (M, 4 or more: t, x, y, heading) and ``truth``
(A, 4: t, x, y, number of the person) in the laser's frame.  Annotations are of some people in some scans.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np

from collabslam.errors import DataError
from collabslam.types import Array
from collabslam.worn_pose import AhrsReading, LaserScan, WornPoseConfig, WornPoseEstimator, laser_scans
from collabslam.worn_pose.config import scanner_pose
from collabslam.worn_pose.estimator import People
from collabslam.worn_pose.legs import find_legs

NEAR, ALONE = 0.3, 0.5
"""Metres within which a person counts as found, and beyond which from all that are annotated as made up."""
WALKS = 0.5
"""Metres over the floor from which a person walks."""
_SAME_SCAN = 0.05
_LEAST_SHOWN = 5  # annotations of a person who is followed
_WAY, _FAR = 2.0, 0.5  # seconds of a way, and its least length, metres
_KEYS = ("ranges", "t_header", "scan", "odom", "truth")


@dataclass(frozen=True)
class Legs:
    """A recording: ``scans``, ``odometry``, its heading as ``readings`` of an AHRS, and ``truth`` (A, 4)."""

    name: str
    odometry: Array
    scans: list[LaserScan]
    readings: list[AhrsReading]
    truth: Array


@dataclass(frozen=True)
class Group:
    """What became of annotated people, of whom each counts once in each scan.

    Attributes
    ----------
    annotated : int
    in_scan, legs : int
        Those with something leg-like within `NEAR`: in the scan alone, and of what is not held to be
        surroundings.
    tracked : int
        Those within `NEAR` of somebody who is followed.
    asked, followed : int
        Annotations of people whose first place was told, after it; those where they are within `NEAR`.
    elsewhere : int
        Those where the person is believed to be further away.
    """

    annotated: int = 0
    in_scan: int = 0
    legs: int = 0
    tracked: int = 0
    asked: int = 0
    followed: int = 0
    elsewhere: int = 0


@dataclass(frozen=True)
class LegsResult:
    """How the estimator did on a recording.

    Attributes
    ----------
    walking, standing : Group
        Those who go more than `WALKS` over the floor while they are annotated, and those who do not: for the
        estimator these are furniture until they walk.
    walkers, alone, made_up : int
        People at annotated scans who have walked, as far as is believed; those with nobody annotated within
        `ALONE` (not everybody is); and those of them with nothing leg-like in the scan within `NEAR`.
    way : float
        Error of the robot's way of two seconds, which the scans alone tell, against the odometry turned
        by one angle: median share of its length.
    """

    walking: Group
    standing: Group
    walkers: int
    alone: int
    made_up: int
    way: float


def read_legs(path: Path) -> Legs:
    """Read a recording; raises DataError if the file is none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            ranges, t, scan, odom, truth = (np.asarray(file[key], np.float64) for key in _KEYS)
        scans = laser_scans(t, ranges, scan[0], scan[1], range_min=scan[2], range_max=scan[3])
    except (OSError, KeyError, ValueError, IndexError) as error:
        raise DataError(
            f"The file {path} holds no scans of legs ({error}); give an .npz file of them."
        ) from error
    if odom.ndim != 2:  # a robot that stands
        odom = np.pad(np.arange(t[0] - 1.0, t[-1] + 1.0, 0.05)[:, None], ((0, 0), (0, 3)))
    readings = [
        AhrsReading(float(row[0]), np.array([0.0, 0.0, np.sin(row[3] / 2.0), np.cos(row[3] / 2.0)]), "robot")
        for row in odom[np.concatenate([[True], np.diff(odom[:, 0]) > 0.0])]
    ]
    return Legs(path.stem, odom, scans, readings, truth.reshape(-1, 4))


def judge(legs: Legs) -> LegsResult:
    """How the estimator does on a recording."""
    everybody = _run(legs, WornPoseConfig(scanners={"front": scanner_pose(0.0, 0.0, -0.6)}))
    walkers = alone = made_up = 0
    for stamp in np.unique(legs.truth[:, 0]):
        k = _scan_at(legs, stamp)
        state = everybody.get(k)
        if state is not None:
            there = legs.truth[legs.truth[:, 0] == stamp, 1:3]
            others = state.walkers[_nearest(state.walkers, there) > ALONE]
            walkers += len(state.walkers)
            alone += len(others)
            made_up += int((_nearest(others, _leg_like(legs.scans[k])) > NEAR).sum())
    groups = {True: Group(), False: Group()}
    for number in np.unique(legs.truth[:, 3]):
        rows = legs.truth[legs.truth[:, 3] == number]
        walks = _way_of(legs, rows, everybody) > WALKS
        groups[walks] = _sum(groups[walks], _fate(legs, rows, everybody))
    return LegsResult(groups[True], groups[False], walkers, alone, made_up, _way_error(legs, everybody))


def _fate(legs: Legs, rows: Array, everybody: dict[int, People]) -> Group:
    """What became of one person's annotations (A, 4)."""
    states = [everybody.get(_scan_at(legs, row[0])) for row in rows]
    near = {
        name: sum(
            state is not None and _nearest(row[None, 1:3], getattr(state, name))[0] <= NEAR
            for row, state in zip(rows, states, strict=True)
        )
        for name in ("legs", "everybody")
    }
    asked = followed = elsewhere = 0
    if len(rows) >= _LEAST_SHOWN:
        first = rows[0]
        start = (-float(first[2]), float(first[1]))
        config = WornPoseConfig(scanners={"front": scanner_pose(0.0, 0.0, -0.6)}, start=start)
        told = _run(legs, config, since=_scan_at(legs, first[0]), until=_scan_at(legs, rows[-1, 0]))
        for row in rows[1:]:
            state = told.get(_scan_at(legs, row[0]))
            asked += 1
            if state is None or state.person is None:
                continue
            off = float(np.linalg.norm(state.person - row[1:3]))
            followed += off <= NEAR
            elsewhere += off > NEAR
    scans = [_scan_at(legs, row[0]) for row in rows]
    in_scan = sum(
        k >= 0 and _nearest(row[None, 1:3], _leg_like(legs.scans[k]))[0] <= NEAR
        for row, k in zip(rows, scans, strict=True)
    )
    return Group(len(rows), in_scan, near["legs"], near["everybody"], asked, followed, elsewhere)


def _sum(a: Group, b: Group) -> Group:
    return Group(*(x + y for x, y in zip(astuple(a), astuple(b), strict=True)))


def _way_of(legs: Legs, rows: Array, everybody: dict[int, People]) -> float:
    """Metres over the floor from a person's first annotation to the last one."""
    places = []
    for row in rows[[0, -1]]:
        state = everybody.get(_scan_at(legs, row[0]))
        if state is None:
            return 0.0
        heading = float(np.interp(row[0], legs.odometry[:, 0], np.unwrap(legs.odometry[:, 3])))
        c, s = np.cos(heading), np.sin(heading)
        places.append(state.robot + np.array([[c, -s], [s, c]]) @ row[1:3])
    return float(np.linalg.norm(places[1] - places[0]))


def _leg_like(scan: LaserScan) -> Array:
    """Places (n, 2) of leg-like things in one scan, whatever was there before, metres."""
    beams = np.flatnonzero((scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max))
    ranges = scan.ranges[beams]
    angles = scan.angle_min + scan.angle_increment * beams
    points = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
    config = WornPoseConfig()
    found = find_legs(scan, beams, points, np.zeros(2), config.person.leg_radius, config.range_sd)
    return found.centre


def _way_error(legs: Legs, states: dict[int, People]) -> float:
    """Median share by which ways of `_WAY` seconds differ from the odometry's; NaN where the robot stands."""
    numbers = sorted(states)
    times = np.array([legs.scans[k].t for k in numbers])
    found = np.array([states[k].robot for k in numbers])
    odom = np.column_stack([np.interp(times, legs.odometry[:, 0], legs.odometry[:, c]) for c in (1, 2)])
    later = np.searchsorted(times, times + _WAY)
    first = np.flatnonzero(later < len(times))
    ours, true = (track[later[first]] - track[first] for track in (found, odom))
    length = np.linalg.norm(true, axis=1)
    far = length > _FAR
    # The scanner may be mounted at any angle to the wheels.
    cross = (ours[far, 0] * true[far, 1] - ours[far, 1] * true[far, 0]).sum()
    angle = float(np.arctan2(cross, (ours[far] * true[far]).sum()))
    c, s = np.cos(angle), np.sin(angle)
    ours = ours @ np.array([[c, s], [-s, c]])
    return (
        float(np.median(np.linalg.norm(ours - true, axis=1)[far] / length[far]))
        if far.any()
        else float("nan")
    )


def _run(legs: Legs, config: WornPoseConfig, since: int = 0, until: int | None = None) -> dict[int, People]:
    """The estimator over the scans from one to another, by the scan's number."""
    estimator, j = WornPoseEstimator(config), 0
    out: dict[int, People] = {}
    last = len(legs.scans) - 1 if until is None else until
    for k in range(since, last + 1):
        scan = replace(legs.scans[k], scanner="front")
        while j < len(legs.readings) and legs.readings[j].t <= scan.t + 0.2:
            estimator.add_ahrs(legs.readings[j])
            j += 1
        if estimator.add_scan(scan) and (people := estimator.people()) is not None:
            out[k] = people
    return out


def _scan_at(legs: Legs, stamp: float) -> int:
    # An annotation has the stamp of the scan after the one that it is of: nowhere else are there points.
    times = np.array([scan.t for scan in legs.scans])
    stamp -= float(np.median(np.diff(times)))
    k = int(np.argmin(np.abs(times - stamp)))
    return k if abs(times[k] - stamp) <= _SAME_SCAN else -1


def _nearest(points: Array, others: Array) -> Array:
    """Distance of each point to the nearest other one; infinite without any."""
    if not len(others):
        return np.full(len(points), np.inf)
    return np.asarray(np.linalg.norm(points[:, None] - others[None], axis=2).min(axis=1))
