"""How the person is built, from a short walk during which the worn camera's pose is measured as well.

What stays for a whole walk, the camera's height and the neck's place over the legs, goes straight into the
length of the baseline and so into the scale: no later image corrects it. It is the same on every walk of the
same person, so it can be measured once, for instance with a board that both cameras see. So can what the
steps do to the head, as the legs tell where in a step the person is: it need not be taken for noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from collabslam.errors import DataError, InputError
from collabslam.types import Array, Mask
from collabslam.worn_pose.config import Person
from collabslam.worn_pose.lever_arm import pace_of
from collabslam.worn_pose.readings import WornPoseEstimate

_GATE = 16.3
"""chi2 of 3 degrees of freedom at 0.999: beyond it the estimate is of somebody else, or the pose is wrong."""
_LEAST = 10
_FITS = 0.7
"""Share of the poses that must pass the gate."""
_CHECK = (
    "check the board's size, the clocks, both mounts, what is told of the person (height_sd and lever_sd say "
    "how wrong it may be), and that the scanners follow the one who wears the camera."
)
_STEP = 0.25
"""Seconds over which what gait does to head and legs lasts: half a step, then it changes sign."""
_FULL, _SETTLES = 0.6, 0.8
"""Share of the usual speed below which somebody sets out or stops, and seconds for the track to settle."""
_STEPS_SD = 0.5
"""Of the head's motion by the legs' swing, metres for a metre, before anything was measured."""
_LEAST_BOB = 0.006
"""Metres that the steps add to the head's height in any case: no walk is like another."""


@dataclass(frozen=True)
class PersonFit:
    """Outcome of `calibrate_person`.

    Attributes
    ----------
    person : Person
        With ``camera_height``, ``lean``, ``surge``, ``bob``, ``height_sd``, ``lever_sd`` and ``bob_sd`` as
        measured.
    correction : (3,) array
        Of the neck against what was told: ahead, left, up, metres.
    covariance : (3, 3) array
        Of what is still wrong with it, m^2.
    used, given : int
        Instants of a steady walk with both: those that fit, and all.
    """

    person: Person
    correction: Array
    covariance: Array
    used: int
    given: int


class _Instants(NamedTuple):
    """Measured poses against estimates, along the trunk's axes.

    Attributes
    ----------
    off : (N, 3) array
        Where the measured camera is, from the estimated one, metres.
    white, slow : (N, 3, 3) array
        Covariances: of what is new in each instant, and of what lasts but for the person's build.
    seen : (N,) array
        The measured pose's variance upwards.
    by : (N, 3, 7) array
        Derivatives of ``off`` by build (3), surge (2) and bob (2).
    """

    off: Array
    white: Array
    slow: Array
    seen: Array
    by: Array

    def distances(self, built: Array) -> Array:
        """(N,) Mahalanobis distances from no correction, of a build known to ``built`` (3, 3)."""
        spread = built + self.slow + self.white
        return np.asarray(np.einsum("ki,kij,kj->k", self.off, np.linalg.inv(spread), self.off))

    def solved(self, alike: float) -> tuple[Array, Array]:
        """Build, surge and bob (7,) by least squares, and their covariance, where what is new lasts for
        ``alike`` instants; the build without its prior."""
        weighted = self.by.transpose(0, 2, 1) @ np.linalg.inv(self.white) / alike
        known = np.diag([0.0] * 3 + [_STEPS_SD**-2] * 4)
        covariance = np.linalg.inv(known + (weighted @ self.by).sum(axis=0))
        return covariance @ (weighted @ self.off[:, :, None]).sum(axis=0)[:, 0], covariance


def calibrate_person(
    person: Person, estimates: Sequence[WornPoseEstimate], t_cf: Array, covariance: Array
) -> PersonFit:
    """Correct what is known of a person by poses of their camera that were measured.

    The difference of both poses, along the trunk's axes, is the correction and, ahead and up, the steps; what
    is left of these lasts for half a step, and what the AHRSs' slow errors make of it for the whole walk.
    What was told is the prior, so one walk after the other makes the person better known. The steps are
    those of the speed that was walked at: walk as fast as later.

    Parameters
    ----------
    person : Person
        The one whom the estimator was told of.
    estimates : sequence of WornPoseEstimate
        Of the estimator, N of them in order of time.
    t_cf : (N, 4, 4) array
        Measured poses at the same instants; NaN where there is none.
    covariance : (N, 6, 6) array
        Theirs, tangent on the right, independent from pose to pose.

    Returns
    -------
    PersonFit

    Raises
    ------
    InputError
        If the shapes do not fit, or an estimate lacks what belongs to its pose.
    DataError
        If a steady walk has fewer than ten instants with both, or poses and estimates contradict each other.
    """
    poses, spread = np.asarray(t_cf, np.float64), np.asarray(covariance, np.float64)
    count = len(estimates)
    if poses.shape != (count, 4, 4) or spread.shape != (count, 6, 6):
        raise InputError(
            f"{count} estimates need poses ({count}, 4, 4) and covariances ({count}, 6, 6); got "
            f"{poses.shape} and {spread.shape}."
        )
    steady = _steady(estimates)
    both = [k for k, e in enumerate(estimates) if steady[k] and np.isfinite(poses[k]).all()]
    if len(both) < _LEAST:
        raise DataError(
            f"Only {len(both)} instants of a steady walk have an estimate and a measured pose; {_LEAST} are "
            "needed: walk on for some seconds, as fast as later, where both cameras see the board."
        )
    speed = np.array([estimates[k].diagnostics.speed for k in both])
    built = np.diag([person.lever_sd**2, person.lever_sd**2, person.height_sd**2])
    rows = [_row(estimates[k], poses[k], spread[k], built) for k in both]
    instants = _Instants(*(np.stack(parts) for parts in zip(*rows, strict=True)))
    fits = instants.distances(built) < _GATE
    if fits.mean() < _FITS:
        raise DataError(
            f"{int((~fits).sum())} of {len(both)} measured poses contradict the estimates: {_CHECK}"
        )
    apart = float(np.median(np.diff([estimates[k].t for k in both])))
    good = _Instants(*(part[fits] for part in instants))
    found, covariance_found = good.solved(max(1.0, _STEP / apart))
    neck, surge, bob = found[:3], found[3:5], found[5:]
    noise = covariance_found[:3, :3] + good.slow.mean(axis=0)
    if neck @ np.linalg.solve(built + noise, neck) > _GATE:
        far = 100.0 * float(np.linalg.norm(neck))
        raise DataError(f"The neck is {far:.0f} cm from where it was thought to be: {_CHECK}")
    gain = built @ np.linalg.inv(built + noise)
    correction, left = gain @ neck, (np.eye(3) - gain) @ built
    upwards = (good.off - good.by @ found)[:, 2]
    better = replace(
        person,
        camera_height=person.camera_height + float(correction[2]),
        lean=(person.lean[0] + float(correction[0]), person.lean[1] + float(correction[1])),
        surge=(person.surge[0] + float(surge[0]), person.surge[1] + float(surge[1])),
        bob=(person.bob[0] + float(bob[0]), person.bob[1] + float(bob[1])),
        bob_sd=_bob_left(person.bob_sd, upwards, good.seen, speed[fits]),
        height_sd=float(np.sqrt(left[2, 2])),
        lever_sd=float(np.sqrt(max(left[0, 0], left[1, 1]))),
    )
    return PersonFit(better, correction, 0.5 * (left + left.T), int(fits.sum()), len(both))


def _steady(estimates: Sequence[WornPoseEstimate]) -> Mask:
    """(N,) bool: estimates of somebody who has walked on for a while; as they set out, their track lags."""
    t = np.array([e.t for e in estimates])
    speed = np.array([0.0 if e.t_cf is None else e.diagnostics.speed for e in estimates])
    slow = t[speed < _FULL * float(np.median(speed))]
    before = np.searchsorted(slow, t, side="right")
    since = t - np.concatenate([[-np.inf], slow])[before]
    return np.asarray(np.array([e.t_cf is not None for e in estimates]) & (since > _SETTLES))


def _bob_left(told: float, residual: Array, seen: Array, speed: Array) -> float:
    """What the steps still do to the head's height, metres at 1.3 m/s: residuals (N,) less what the measured
    poses' own variances (N,) make of them; as told if too few of these are exact."""
    pace = np.array([pace_of(float(v)) for v in speed])
    weight = (pace / (seen + (told * pace) ** 2 + 1e-12)) ** 2
    if weight.sum() ** 2 < _LEAST * (weight**2).sum():
        return told
    square = float(weight @ (residual**2 - seen) / (weight @ pace**2))
    return float(np.clip(np.sqrt(max(square, 0.0)), min(_LEAST_BOB, told), told))


def _row(
    e: WornPoseEstimate, t_cf: Array, spread: Array, built: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """One of `_Instants`."""
    if e.t_cf is None or e.covariance is None or e.bias is None or e.trunk is None or e.swing is None:
        raise InputError(f"The estimate at {e.t} s has a pose but not its covariance, bias, trunk and swing.")
    mine, theirs = e.trunk.T @ e.t_cf[:3, :3], e.trunk.T @ t_cf[:3, :3]
    seen = theirs @ spread[:3, :3] @ theirs.T
    white = mine @ (e.covariance - e.bias)[:3, :3] @ mine.T + seen
    by = np.hstack([np.eye(3), np.zeros((3, 4))])
    by[0, 3:5] = by[2, 5:7] = e.swing
    off = e.trunk.T @ (t_cf[:3, 3] - e.t_cf[:3, 3])
    return off, white, mine @ e.bias[:3, :3] @ mine.T - built, seen[2, 2], by
