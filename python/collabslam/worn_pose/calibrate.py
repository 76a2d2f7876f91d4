"""How the person is built, from a short walk during which the worn camera's pose is measured as well.

What stays for a whole walk, the camera's height and the neck's place over the legs, goes straight into the
length of the baseline and so into the scale: no later image corrects it. It is the same on every walk of the
same person, so it can be measured once, for instance with a board that both cameras see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collabslam.errors import DataError, InputError
from collabslam.types import Array
from collabslam.worn_pose.config import Person
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


@dataclass(frozen=True)
class PersonFit:
    """Outcome of `calibrate_person`.

    Attributes
    ----------
    person : Person
        With ``camera_height``, ``lean``, ``height_sd`` and ``lever_sd`` as measured.
    correction : (3,) array
        Of the neck against what was told: ahead, left, up, metres.
    covariance : (3, 3) array
        Of what is still wrong with it, m^2.
    used, given : int
        Poses that fit, of those with an estimate.
    """

    person: Person
    correction: Array
    covariance: Array
    used: int
    given: int


def calibrate_person(
    person: Person, estimates: Sequence[WornPoseEstimate], t_cf: Array, covariance: Array
) -> PersonFit:
    """Correct what is known of a person by poses of their camera that were measured.

    The difference of both poses, along the trunk's axes, is the correction; gait's errors last for half a
    step, and what the AHRSs' slow errors make of it for the whole walk. What was told is the prior.

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
        If the shapes do not fit.
    DataError
        If there are fewer than ten instants with both, or poses and estimates contradict each other.
    """
    poses, spread = np.asarray(t_cf, np.float64), np.asarray(covariance, np.float64)
    count = len(estimates)
    if poses.shape != (count, 4, 4) or spread.shape != (count, 6, 6):
        raise InputError(
            f"{count} estimates need poses ({count}, 4, 4) and covariances ({count}, 6, 6); got "
            f"{poses.shape} and {spread.shape}."
        )
    both = [k for k, e in enumerate(estimates) if e.t_cf is not None and np.isfinite(poses[k]).all()]
    if len(both) < _LEAST:
        raise DataError(
            f"Only {len(both)} instants have an estimate and a measured pose; {_LEAST} are needed: walk for "
            "some seconds where both cameras see the board."
        )
    built = np.diag([person.lever_sd**2, person.lever_sd**2, person.height_sd**2])
    rows = [_row(estimates[k], poses[k], spread[k], built) for k in both]
    off, white, slow = (np.stack(parts) for parts in zip(*rows, strict=True))
    distance = np.einsum("ki,kij,kj->k", off, np.linalg.inv(built + slow + white), off)
    fits = distance < _GATE
    if fits.mean() < _FITS:
        raise DataError(
            f"{int((~fits).sum())} of {len(both)} measured poses contradict the estimates: {_CHECK}"
        )
    weight = np.linalg.inv(white[fits])
    mean = np.linalg.solve(weight.sum(axis=0), (weight @ off[fits][:, :, None]).sum(axis=0)[:, 0])
    apart = float(np.median(np.diff([estimates[k].t for k in both])))
    noise = max(1.0, _STEP / apart) * np.linalg.inv(weight.sum(axis=0)) + slow[fits].mean(axis=0)
    if mean @ np.linalg.solve(built + noise, mean) > _GATE:
        far = 100.0 * float(np.linalg.norm(mean))
        raise DataError(f"The neck is {far:.0f} cm from where it was thought to be: {_CHECK}")
    gain = built @ np.linalg.inv(built + noise)
    correction, left = gain @ mean, (np.eye(3) - gain) @ built
    better = replace(
        person,
        camera_height=person.camera_height + float(correction[2]),
        lean=(person.lean[0] + float(correction[0]), person.lean[1] + float(correction[1])),
        height_sd=float(np.sqrt(left[2, 2])),
        lever_sd=float(np.sqrt(max(left[0, 0], left[1, 1]))),
    )
    return PersonFit(better, correction, 0.5 * (left + left.T), int(fits.sum()), len(both))


def _row(e: WornPoseEstimate, t_cf: Array, spread: Array, built: Array) -> tuple[Array, Array, Array]:
    """Along the trunk's axes: where the measured camera is, from the estimated one; covariances of that, of
    what is new in each instant and of what lasts but for the person's build."""
    if e.t_cf is None or e.covariance is None or e.bias is None or e.trunk is None:
        raise InputError(f"The estimate at {e.t} s has a pose but not its covariance, bias and trunk.")
    mine, theirs = e.trunk.T @ e.t_cf[:3, :3], e.trunk.T @ t_cf[:3, :3]
    white = mine @ (e.covariance - e.bias)[:3, :3] @ mine.T + theirs @ spread[:3, :3] @ theirs.T
    return e.trunk.T @ (t_cf[:3, 3] - e.t_cf[:3, 3]), white, mine @ e.bias[:3, :3] @ mine.T - built
