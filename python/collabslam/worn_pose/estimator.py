"""The worn camera's pose from laser scans and two AHRSs (METHOD 11b, the paper's section 4)."""

from __future__ import annotations

from bisect import bisect_right
from functools import partial
from math import atan2, hypot, inf, pi
from typing import NamedTuple

import numpy as np

from collabslam.errors import InputError
from collabslam.types import Array, Indices, Mask
from collabslam.worn_pose.attitude import AttitudeTrack
from collabslam.worn_pose.config import WornPoseConfig
from collabslam.worn_pose.evidence import may_walk, walks
from collabslam.worn_pose.legs import FARTHEST, find_legs
from collabslam.worn_pose.lever_arm import Gait, trunk, worn_pose
from collabslam.worn_pose.person_tracker import PersonTracker
from collabslam.worn_pose.readings import AhrsReading, Diagnostics, LaserScan, WornPoseEstimate
from collabslam.worn_pose.surroundings import REACH, Surroundings
from collabslam.worn_pose.track import Candidates, carried

_LEARN_EVERY = 0.07
"""Seconds between two scans of a scanner that the surroundings are learnt from."""
_STANDS = 0.5
"""Share of a cluster's beams on known surroundings from which it is a part of them."""
_CLUTTER_MOVING, _CLUTTER_NEW = 0.02, 0.2
"""Leg-like things per square metre: where beams went through before, and in places not seen before."""
_BRIDGED = 0.15
"""Seconds without the legs from which an estimate counts as bridged."""


class _Moment(NamedTuple):
    """What was known after a scan."""

    t: float
    x: Array | None
    p: Array | None
    robot: Array
    plane: float
    seen: float
    candidates: int
    others: int
    scans: int


class People(NamedTuple):
    """Who is about the robot after the last scan: (n, 2) places, ahead and left of Cs on the floor, metres.

    ``legs`` are things in the last scan that may be a leg, ``everybody`` those who are followed, ``walkers``
    those of them who have walked and were seen just now, and ``person`` (2,) is who wears the camera, or
    None.  ``robot`` (2,) is the way of Cs since the first scan, along N's axes.
    """

    legs: Array
    everybody: Array
    walkers: Array
    person: Array | None
    robot: Array


class WornPoseEstimator:
    """Finds the person's legs in the scans, follows them, and says where the camera on the head is.

    The walk is tracked in a frame with N's axes (up, and the AHRS's heading) that stands still on the floor:
    the robot's turns come from its AHRS, its way from its own scans laid on what they saw before, so that
    neither makes the person seem to move, and furniture stays where it is. Only positions a moment apart are
    ever compared: drift of that way and of the heading does not add up. C's attitude is the robot's AHRS's,
    never the SLAM filter's.

    Parameters
    ----------
    config : WornPoseConfig

    Examples
    --------
    >>> estimator = WornPoseEstimator(WornPoseConfig())
    >>> estimator.pose_at(0.0).reason
    'no scan has been used yet'
    """

    def __init__(self, config: WornPoseConfig | None = None) -> None:
        self.config = config or WornPoseConfig()
        c = self.config
        keep = c.history + 1.0
        self._robot = AttitudeTrack("robot's", np.asarray(c.r_c_ahrs).T, c.max_ahrs_age, keep, c.tilt_share)
        self._worn = AttitudeTrack("worn", np.asarray(c.r_f_ahrs).T, c.max_ahrs_age, keep)
        self._scanners = {name: np.asarray(pose, np.float64) for name, pose in c.scanners.items()}
        self._learnt = dict.fromkeys(self._scanners, -inf)
        self._scanned = dict.fromkeys(self._scanners, -inf)
        self._last = -inf
        self._surroundings = Surroundings()
        self._tracker = PersonTracker(c)
        self._hint: Array | None = None
        self._moments: list[_Moment] = []
        self._legs: Array = np.zeros((0, 2))
        self._scans = 0
        slow = c.ahrs.yaw_sd**2 - c.ahrs.yaw_white_sd**2
        self._drift = 2.0 * slow / c.ahrs.drift_time

    def add_ahrs(self, reading: AhrsReading) -> None:
        """Take an attitude.

        Raises
        ------
        InputError
            If it is not later than the one before of the same AHRS; the estimator stays as it was.
        """
        (self._robot if reading.where == "robot" else self._worn).add(reading)

    def add_scan(self, scan: LaserScan) -> bool:
        """Take a scan; all scanners' scans come in order of time.

        Returns
        -------
        bool
            Whether it was used: not before the robot's attitude is known, nor without any return.

        Raises
        ------
        InputError
            If the scanner is unknown or the scan is not in order; the estimator stays as it was.
        """
        if scan.scanner not in self._scanners:
            raise InputError(
                f"There is no scanner '{scan.scanner}'; the configuration has {', '.join(self._scanners)}."
            )
        middle = scan.t + 0.5 * scan.time_increment * (len(scan.ranges) - 1)
        if middle < self._last or middle <= self._scanned[scan.scanner]:
            raise InputError(
                f"The scan at {scan.t} s is older than the one before, at {self._last} s; give scans in "
                "order of time."
            )
        r_nc = self._robot.at(middle)
        if r_nc is None:
            return False
        return self._take(scan, middle, r_nc)

    def _take(self, scan: LaserScan, t: float, r_nc: Array) -> bool:
        t_cs = self._scanners[scan.scanner]
        good = (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
        beams = np.flatnonzero(good)
        if len(beams) < 3:
            return False
        ranges = scan.ranges[beams]
        angles = scan.angle_min + scan.angle_increment * beams + self._turns(scan, t, beams)
        r_ns = r_nc @ t_cs[:3, :3]
        lever_arm = r_nc @ t_cs[:3, 3]
        flat = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
        points = flat @ r_ns[:2, :2].T + lever_arm[:2]
        dt = 0.0 if self._last == -inf else t - self._last
        surroundings, tracker = self._surroundings, self._tracker
        surroundings.predict(dt)
        tracker.predict(dt, surroundings.position, self._drift)
        if self._hint is None and self.config.start is not None:
            right, ahead = self.config.start
            self._hint = surroundings.position + (r_nc @ np.array([right, 0.0, ahead]))[:2]
        near = ranges < REACH
        learn = t - self._learnt[scan.scanner] >= _LEARN_EVERY
        if learn:
            mine = ~tracker.claimed(points + surroundings.position, self._hint)
            surroundings.align(t, points[near & mine])
        robot = surroundings.position.copy()
        world = points + robot
        candidates, ambiguous = self._candidates(scan, beams, world, robot + lever_arm[:2])
        self._legs = candidates.centre
        view = partial(_in_view, scan, robot + lever_arm[:2], r_ns[:2, :2])
        tracker.update(
            t, candidates, robot, surroundings.state[2:], self.config.ahrs.yaw_white_sd**2, self._hint, view
        )
        if learn:
            still = ~tracker.claimed(world, self._hint)
            surroundings.learn(t, robot + lever_arm[:2], world, still, ambiguous, self._unmet(scan, t, r_ns))
            self._learnt[scan.scanner] = t
        self._last = self._scanned[scan.scanner] = t
        self._scans += 1
        self._remember(t, float(lever_arm[2]), len(candidates))
        return True

    def _unmet(self, scan: LaserScan, t: float, r_ns: Array) -> Array:
        """Rays (K, 2) of the beams that met nothing up to the scanner's limit, metres along N's axes."""
        beams = np.flatnonzero(scan.ranges > scan.range_max)
        angles = scan.angle_min + scan.angle_increment * beams + self._turns(scan, t, beams)
        flat = scan.range_max * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.asarray(flat @ r_ns[:2, :2].T)

    def _turns(self, scan: LaserScan, t: float, beams: Indices) -> Array | float:
        half = 0.5 * scan.time_increment * (len(scan.ranges) - 1)
        before, after = self._robot.at(t - half), self._robot.at(t + half)
        if half == 0.0 or before is None or after is None:
            return 0.0
        return turned(scan, beams, self._scanners[scan.scanner][:3, :3], before, after)

    def _candidates(
        self, scan: LaserScan, beams: Indices, world: Array, origin: Array
    ) -> tuple[Candidates, Mask]:
        """Leg-like things that are not surroundings, and which beams they are made of."""
        c = self.config
        legs = find_legs(scan, beams, world, origin, c.person.leg_radius, c.range_sd)
        stands, opened = self._surroundings.standing(world)
        share = _shares(stands, legs.first, legs.stop)
        moving = _shares(opened, legs.first, legs.stop) > _STANDS
        keep = share < _STANDS
        clutter = np.where(moving, _CLUTTER_MOVING, _CLUTTER_NEW)
        edges = np.zeros(len(beams) + 1, np.int64)
        np.add.at(edges, legs.first[keep], 1)
        np.add.at(edges, legs.stop[keep], -1)
        ambiguous = np.cumsum(edges[:-1]) > 0
        found = Candidates(
            legs.centre[keep], legs.covariance[keep], legs.wide[keep], clutter[keep], moving[keep]
        )
        return found, ambiguous

    def _remember(self, t: float, plane: float, candidates: int) -> None:
        tracker = self._tracker
        person = tracker.person if tracker.sure else None
        x, p = (None, None) if person is None else (person.x, person.p)
        seen = person.seen if person is not None else -inf if tracker.lost is None else tracker.lost[0]
        self._moments.append(
            _Moment(
                t,
                x,
                p,
                self._surroundings.state.copy(),
                plane,
                seen,
                candidates,
                len(tracker.others),
                self._scans,
            )
        )
        if len(self._moments) > 64 and self._moments[len(self._moments) // 2].t < t - self.config.history:
            del self._moments[: len(self._moments) // 2]

    def people(self) -> People | None:
        """Who was about the robot at the last scan; None before the first."""
        r_nc = self._robot.at(self._last)
        if r_nc is None:
            return None
        ahead = r_nc[:2, 2] / float(np.hypot(*r_nc[:2, 2]))
        axes = np.array([ahead, [-ahead[1], ahead[0]]])
        robot, tracker = self._surroundings.position, self._tracker
        tracks = [*([] if tracker.person is None else [tracker.person]), *tracker.others]
        places = np.array([track.x[:2] for track in tracks]).reshape(-1, 2)
        walked = np.array(
            [walks(o) and may_walk(o) and self._last - o.seen < _BRIDGED for o in tracks], np.bool_
        )
        person = tracker.person if tracker.sure else None
        return People(
            (self._legs - robot) @ axes.T,
            (places - robot) @ axes.T,
            (places[walked] - robot) @ axes.T,
            None if person is None else axes @ (person.x[:2] - robot),
            robot.copy(),
        )

    def pose_at(self, t: float) -> WornPoseEstimate:
        """Pose of Cf in Cs at the stamp of an image, from the scans up to then.

        Parameters
        ----------
        t : float
            Seconds; within `WornPoseConfig.history` of the last scan, later ones included.

        Returns
        -------
        WornPoseEstimate
            With a pose, or a reason.

        Raises
        ------
        InputError
            If ``t`` is not finite.
        """
        if not np.isfinite(t):
            raise InputError(f"The stamp is {t}; give seconds.")
        k = bisect_right(self._moments, t, key=lambda moment: moment.t)
        if k == 0:
            why = (
                "it lies before the scans that are remembered"
                if self._moments
                else "no scan has been used yet"
            )
            return _none(t, why, Diagnostics("searching", inf, inf, 0.0, 0, 0, self._scans))
        m, c = self._moments[k - 1], self.config
        if m.x is None or m.p is None:
            state = "searching" if m.seen == -inf else "lost"
            why = "no person has been found yet" if state == "searching" else "the person is lost"
            return _none(t, why, Diagnostics(state, t - m.seen, inf, 0.0, m.candidates, m.others, m.scans))
        x, p = carried(m.x, m.p, t - m.t, 0.0, c.person)
        away = x[:2] - m.robot[:2] - (t - m.t) * m.robot[2:]
        legs = p[:2, :2] + self._drift * (t - m.t) * float(away @ away) * np.eye(2)
        sd = float(np.sqrt(np.linalg.eigvalsh(legs)[-1]))
        since = t - m.seen
        state = "tracked" if since < _BRIDGED else "bridged"
        speed = float(np.hypot(x[2], x[3]))
        d = Diagnostics(state, since, sd, speed, m.candidates, m.others, m.scans)
        r_nc, r_nf = self._robot.at(t), self._worn.at(t)
        if r_nc is None or r_nf is None:
            which = "robot" if r_nc is None else "worn camera"
            return _none(t, f"the AHRS of the {which} says nothing at this instant", d)
        if since > c.max_gap:
            return _none(t, f"the legs were not seen for {since:.1f} s", d)
        if sd > c.max_position_sd:
            return _none(t, f"the legs are known to {sd:.2f} m only", d)
        way = trunk(x[2:4], r_nf)
        swing = np.array([x[4:6], x[6:8] / (2.0 * pi * c.person.step_rate)]) @ way[:2, 0]
        pose = worn_pose(c, r_nc, r_nf, away, legs, m.plane, Gait(speed, way, swing))
        return WornPoseEstimate(t, *pose, None, d, r_nc.T @ way, swing)


def turned(scan: LaserScan, beams: Indices, mount: Array, before: Array, after: Array) -> Array:
    """How much the scanner had turned at each beam since the middle of its scan, radians.

    Parameters
    ----------
    scan : LaserScan
    beams : (N,) int
    mount : (3, 3) array
        Turns the scanner's axes into C's.
    before, after : (3, 3) array
        R_NC at the scan's first and last beam.
    """
    turn = mount.T @ before.T @ after @ mount
    share = beams / (len(scan.ranges) - 1) - 0.5
    return np.asarray(float(np.arctan2(turn[1, 0], turn[0, 0])) * share)


def _none(t: float, reason: str, diagnostics: Diagnostics) -> WornPoseEstimate:
    return WornPoseEstimate(t, None, None, None, reason, diagnostics)


def _shares(flags: Mask, first: Indices, stop: Indices) -> Array:
    """Share of flags set in each slice."""
    sums = np.concatenate([[0.0], np.cumsum(flags)])
    return np.asarray((sums[stop] - sums[first]) / (stop - first))


def _in_view(scan: LaserScan, origin: Array, turn: Array, place: Array) -> bool:
    """Whether a scanner at ``origin`` looks at a place, its legs included."""
    x, y = (place - origin).tolist()
    ahead, left = turn[0, 0] * x + turn[1, 0] * y, turn[0, 1] * x + turn[1, 1] * y
    span = scan.angle_increment * (len(scan.ranges) - 1)
    away = atan2(left, ahead) - (scan.angle_min + 0.5 * span)
    away = abs((away + pi) % (2.0 * pi) - pi)
    return away < 0.5 * abs(span) - 0.05 and scan.range_min < hypot(x, y) < FARTHEST
