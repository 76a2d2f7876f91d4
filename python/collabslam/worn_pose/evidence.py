"""What says that a track is a person, that it is the one who comes along, and that something else may be."""

from __future__ import annotations

import numpy as np

from collabslam.types import Array
from collabslam.worn_pose.track import Candidates, LegTrack

CONFIRM_TIME, _CONFIRM_QUALITY, _CONFIRM_WAY, _CONFIRM_SPEED = 1.3, 0.8, 0.5, 0.25
_CONFIRM_MOVING, CONFIRM_SOON = 0.6, 0.7
"""What a track must have done before it is a person: seconds (fewer for the only one who can have come from
where the person was last known), share of scans it was in, metres, metres a second, share of legs where beams
went through before."""
COMPANY_SPEED, _PARTING_SPEED = 1.3, 0.6
"""Metres a second by which the velocity of somebody who comes along differs from the robot's at most (now,
and on average: a passer-by may stop), and by which the distance between the two changes."""
LEFT = 1.5
"""Metres that the robot goes on until what has stayed where it was said to be is furniture."""
OWN_LEGS = 0.35
"""Metres from somebody up to which leg-like things are their own legs."""
_DECISIVE = 3.0
"""Logarithm of the odds from which one of two readings is the right one."""
_BESIDE_SD = 0.1
"""Metres that a thing that stands seems to move."""
TRIAL = 2.0
"""Seconds in which a new track must have walked."""


def rivalled(at: Array, expected: Array, covariance: Array, c: Candidates) -> bool:
    """Whether something else than what was taken for a person, hidden before, may as well be that person.

    Parameters
    ----------
    at : (2,) array
        Where the person now seems to be, metres.
    expected, covariance : (2,), (2, 2) array
        Where they were expected.
    c : Candidates
    """
    d = np.vstack([at, c.centre]) - expected
    mahalanobis = (d * np.linalg.solve(covariance, d.T).T).sum(axis=1)
    own = np.hypot(*(c.centre - at).T) < OWN_LEGS
    clutter = c.clutter[own].min() if own.any() else c.clutter.min()
    odds = 0.5 * (mahalanobis[0] - mahalanobis[1:]) + np.log(clutter / c.clutter)
    return bool((odds[~own] > -_DECISIVE).any())


def legs_at(places: Array, points: Array) -> Array:
    """Density (n,) per square metre at points (n, 2) of things that stand at places (m, 2)."""
    d = points[:, None] - places
    near = np.exp(-0.5 * (d * d).sum(axis=2) / _BESIDE_SD**2).sum(axis=1)
    return np.asarray(near / (2.0 * np.pi * _BESIDE_SD**2))


def accompanies(track: LegTrack, t: float, robot: Array, motion: Array) -> bool:
    """Whether somebody keeps up with the robot, other than who comes towards it or stays behind."""
    age, before, now = t - track.born, track.start - track.robot, track.x[:2] - robot
    change = abs(float(np.hypot(*now) - np.hypot(*before)))
    apart = max(float(np.hypot(*(track.x[2:4] - motion))), float(np.hypot(*(now - before))) / max(age, 1e-3))
    return apart < COMPANY_SPEED and change < _PARTING_SPEED * age


def may_walk(track: LegTrack) -> bool:
    """Whether a track's legs are, or were for long, where beams went through before."""
    return track.walked or track.moving >= _CONFIRM_MOVING


def walks(track: LegTrack) -> bool:
    """Whether a track is away from the place where it began."""
    return float(np.hypot(*(track.x[:2] - track.start))) >= _CONFIRM_WAY


def known_before(track: LegTrack, robot: Array) -> tuple[float, Array] | None:
    """When and where somebody was there, if what is followed now is furniture; None if it is not."""
    if not (track.walked or walks(track)) and float(np.hypot(*(robot - track.robot))) > LEFT:
        return track.born, track.start
    return track.sure if track.ambiguous else None


def confirmed(track: LegTrack, t: float, least: float) -> bool:
    """Whether a track is a person for certain: seen for a while, and walking."""
    age = t - track.born
    way = float(np.hypot(*(track.x[:2] - track.start)))
    return (
        age >= least
        and track.quality >= _CONFIRM_QUALITY
        and track.moving >= _CONFIRM_MOVING
        and way >= max(_CONFIRM_WAY, min(age, TRIAL) * _CONFIRM_SPEED)
    )
