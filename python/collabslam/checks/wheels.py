"""Does odometry agree with the images: where Cs sits on the robot, its axes, its units and its clock?

Between two frames Cs moved by T_CB M T_BC, if the samples say M of the odometry's frame B (hand and eye).  Of
that the images tell the turn and the direction of the way, not its length.  The usual mistakes in T_BC are
undone one after the other, and the one under which ways and turns point where the images have them is named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from collabslam._core import FilterSettings
from collabslam.checks.dead_reckoning import DeadReckoning
from collabslam.checks.gyro_fit import weighted_rms
from collabslam.checks.matching import Points, describe, match_points
from collabslam.checks.mistakes import MOUNT_MISTAKES, MirroredCamera
from collabslam.checks.relative_motion import relative_motion
from collabslam.checks.report import Report
from collabslam.checks.samples import lowest, spread
from collabslam.datasets.odometry import mount_of
from collabslam.geometry import nearest_rotation, pose_inverse, rotation_log
from collabslam.types import Array, Mask, Odometry, Recording

PLACES = 30
WAY, REACH = 0.3, 1.0
"""Metres that every other pair of frames is apart, and seconds that all are at most."""
LEAST_WAY, LEAST_TURN = 0.1, np.deg2rad(3.0)
"""Metres and radians of a pair from which on it tells the direction of its way, and the axis of its turn."""
PARALLAX = np.deg2rad(0.5)
"""Angle by which a way must move the points for the images to tell its direction."""
LEAST_PAIRS = 6
FITS = np.deg2rad(15.0)
"""Median angle of ways, and of turns, to those of the images up to which both agree."""
OFF, SURE = np.deg2rad(4.0), 3.0
"""Angle from which on a mount is another one, if it is so many standard deviations of the mean."""
STRAIGHT = 2.0
"""Metres of way for each radian of turn from which on an error of Cs's place on the robot hardly shows."""
ALIKE = np.deg2rad(3.0)
"""Mistakes whose misfits differ by less are alike; the one that is made most is named."""
CLOCK, CLEAR = 0.5, 0.7
"""Seconds up to which a clock is sought, and the share of the residual that a better one leaves."""
_NEAR = 1.4
"""Factor that turns may be wrong by beside their unit."""
_DEFAULTS = FilterSettings().odometry


class DrivenPair(NamedTuple):
    """Two frames: their times, and how Cs moved between them as the images have it.

    ``turn`` (3,) is the rotation vector, rad, and ``way`` (3,) a unit vector, both along the axes of Cs at
    the first; ``way`` is None where the points hardly moved.  ``true_way`` is its length by the true poses,
    metres, NaN without them.
    """

    first: float
    second: float
    turn: Array
    way: Array | None
    true_way: float = np.nan


class Misfit(NamedTuple):
    """Median angles, rad, of ways and of turns to those of the images; NaN where too few tell them."""

    ways: float
    turns: float

    @property
    def worst(self) -> float:
        """The larger one; infinite where neither is told."""
        return float(np.nanmax([*self, -np.inf])) if np.isfinite(self).any() else np.inf


@dataclass(frozen=True)
class WheelsReport(Report):
    """What was found.

    Attributes
    ----------
    told : (4, 4) array
        ``T_BC`` as it was told.
    pairs : int
        Pairs of frames whose motion the images told.
    misfit : Misfit or None
        Of the odometry as it was told.
    turn_scale : float or None
        What its turns are to be multiplied by for those of the images.
    """

    told: Array
    pairs: int
    misfit: Misfit | None = None
    turn_scale: float | None = None

    @property
    def agrees(self) -> bool:
        """Whether it was held against the images, and fits."""
        return self.misfit is not None and not self.findings


def check_wheels(recording: Recording) -> WheelsReport | None:
    """Hold the odometry of a recording against its images; None where it has none."""
    odometry: Odometry | None = getattr(recording, "odometry", None)
    if odometry is None:
        return None
    return judged(driven_pairs(recording, DeadReckoning(odometry)), odometry)


def driven_pairs(recording: Recording, reckoned: DeadReckoning) -> list[DrivenPair]:
    """Pairs of frames that odometry covers, spread over the recording, as far as images tell their motion."""
    times, truth, model = recording.times, recording.truth, MirroredCamera(recording.camera)
    points: dict[int, Points] = {}

    def of(k: int) -> Points:
        if k not in points:
            points[k] = describe(recording.image(k))
        return points[k]

    pairs = []
    covered = [i for i in range(len(times) - 1) if np.isfinite(reckoned.way(times[i], times[i + 1]))]
    for number, i in enumerate(spread(covered, PLACES)):
        far, wanted = i + 1, WAY if number % 2 else np.inf
        while far + 1 < len(times) and times[far + 1] - times[i] <= REACH:
            way, further = (reckoned.way(times[i], times[k]) for k in (far, far + 1))
            if way >= wanted or np.isnan(further):
                break
            far += 1
        for k in (i + max((far - i) // share, 1) for share in (1, 2, 4)):
            motion = relative_motion(match_points(of(i), of(k)), model)
            if motion is None:
                continue
            ahead = motion.t_ab[:3, 3] if motion.parallax > PARALLAX else None
            true = np.nan if truth is None else float(np.linalg.norm(truth[k, :3, 3] - truth[i, :3, 3]))
            pairs.append(DrivenPair(times[i], times[k], rotation_log(motion.t_ab[:3, :3]), ahead, true))
            break
    return pairs


class _Seen(NamedTuple):
    """Pairs as arrays: motions (K, 4, 4) of B, turns (K, 3) and ways (K, 3) of Cs by the images; which of$
    both tell a direction, and on which ways a wrong lever arm hardly shows."""

    moved: Array
    turns: Array
    ways: Array
    turning: Mask
    going: Mask
    straight: Mask

    def predicted(self, t_bc: Array) -> tuple[Array, Array]:
        """Turns (K, 3), rad, and ways (K, 3), metres, of Cs as odometry has them with a mount."""
        of_cs = pose_inverse(t_bc) @ self.moved @ t_bc
        return np.array([rotation_log(t[:3, :3]) for t in of_cs]), of_cs[:, :3, 3]

    def misfit(self, t_bc: Array) -> Misfit:
        """How far what odometry says with a mount points from what the images say."""
        turns, ways = self.predicted(t_bc)
        return Misfit(_median(ways, self.ways, self.going), _median(turns, self.turns, self.turning))


def judged(pairs: list[DrivenPair], odometry: Odometry) -> WheelsReport:
    """What pairs of frames say of odometry."""
    told, reckoned = np.asarray(odometry.t_bc, np.float64), DeadReckoning(odometry)
    pairs = [pair for pair in pairs if reckoned.between(pair.first, pair.second) is not None]
    seen = _seen(pairs, reckoned)
    misfit = seen.misfit(told)
    if not np.isfinite(misfit).any():
        text = (
            f"Fewer than {LEAST_PAIRS} pairs of frames tell how the camera moved while the odometry did: it "
            "is not checked."
        )
        return WheelsReport(told, len(pairs), notes=[text])
    scale = _turn_scale(seen, told)
    report = WheelsReport(told, len(pairs), misfit, scale)
    degrees = np.deg2rad(odometry.twists[:, 3:])
    slower = replace(odometry, twists=np.column_stack([odometry.twists[:, :3], degrees]))
    if _in_degrees(pairs, odometry, slower, misfit):
        report.findings.append(
            "The odometry's turns are in degrees a second: turned into rad/s (times 0.0174533) they fit the "
            "images; write them so."
        )
        return report
    if np.isnan(misfit.turns):
        report.notes.append("Cs hardly turns: nothing tells the odometry's turns, nor a roll of its mount.")
    if np.isnan(misfit.ways):
        report.notes.append("Cs hardly goes anywhere: nothing tells which way the odometry's x points.")
    right, said = _mount(seen, told, misfit)
    report.findings.extend(said)
    if right is not None:
        report.findings.extend(_clock(pairs, odometry, right) or _sizes(seen, right, pairs))
    return report


def _seen(pairs: list[DrivenPair], reckoned: DeadReckoning) -> _Seen:
    """Pairs that odometry covers, as arrays."""
    moved = np.array([reckoned.between(p.first, p.second) for p in pairs]).reshape(-1, 4, 4)
    turned = np.array([np.linalg.norm(rotation_log(m[:3, :3])) for m in moved])
    lengths = np.linalg.norm(moved[:, :3, 3], axis=1)
    ways = np.array([np.full(3, np.nan) if p.way is None else p.way for p in pairs]).reshape(-1, 3)
    going = (lengths >= LEAST_WAY) & np.isfinite(ways).all(axis=1)
    turns = np.array([p.turn for p in pairs]).reshape(-1, 3)
    return _Seen(moved, turns, ways, turned >= LEAST_TURN, going, going & (lengths >= STRAIGHT * turned))


def _angles(a: Array, b: Array) -> Array:
    """Between the rows of (N, 3) arrays, rad."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)))


def _median(a: Array, b: Array, which: Mask) -> float:
    return float(np.median(_angles(a[which], b[which]))) if which.sum() >= LEAST_PAIRS else np.nan


def _mount(seen: _Seen, told: Array, misfit: Misfit) -> tuple[Array | None, list[str]]:
    """``T_BC`` that fits, None where none does, and what is wrong with the one that was told."""
    undone = [mistake.undo(told) for mistake in MOUNT_MISTAKES]
    worst = np.array([seen.misfit(t_bc).worst for t_bc in undone])
    alike = np.flatnonzero(worst <= worst.min() + ALIKE)
    best = int(alike[0])
    if worst[best] < FITS and misfit.worst > 2.0 * worst[best] + FITS:
        fault, remedy = MOUNT_MISTAKES[best][:2]
        finding = (
            f"{fault[0].upper()}{fault[1:]}: corrected, {_falls(misfit, seen, undone[best])}; {remedy}. "
            f"That is {_given(undone[best])}."
        )
        others = [f"{MOUNT_MISTAKES[k].fault}: {_given(undone[k])}" for k in alike[1:]]
        return undone[best], [finding + (f" (Or {'; or '.join(others)}.)" if others else "")]
    fitted, sd = _fitted(seen, told)
    if seen.misfit(fitted).worst > FITS:
        return None, [
            "The odometry does not move as the images do, wherever Cs sits on the robot: "
            f"{_numbers(misfit)}; give the log that belongs to these images, by their clock."
        ]
    off = float(np.linalg.norm(rotation_log(fitted[:3, :3] @ told[:3, :3].T)))
    if off <= max(OFF, SURE * sd):
        return told, []
    return fitted, [
        f"Cs sits otherwise on the robot: {np.rad2deg(off):.0f} degrees (sd {np.rad2deg(sd):.1f}) from what "
        f"T_BC says; corrected, {_falls(misfit, seen, fitted)}. That is {_given(fitted)}."
    ]


def _fitted(seen: _Seen, told: Array) -> tuple[Array, float]:
    """The mount whose rotation fits best, its place as told, and the standard deviation of a mean angle.

    By Kabsch's method from directions, those that are far off weighted less; about an axis that nothing tells
    it stays as it was told.
    """
    turns, ways = seen.predicted(told)
    rows = [(ways, seen.ways, seen.straight if seen.straight.sum() >= LEAST_PAIRS else seen.going)]
    rows.append((turns, seen.turns, seen.turning))
    used = [(p[w], s[w]) for p, s, w in rows if w.sum() >= LEAST_PAIRS]
    by_told, by_images = (
        np.concatenate([part[k] / np.linalg.norm(part[k], axis=1, keepdims=True) for part in used])
        for k in (0, 1)
    )
    count, turn = len(by_told), np.eye(3)
    for _ in range(5):
        angles = _angles(by_told @ turn.T, by_images)
        weight = 1.0 / np.maximum(angles, max(float(np.median(angles)), 1e-3))
        prior = 1e-3 * float(weight.sum()) * np.eye(3)
        turn = nearest_rotation((weight[:, None] * by_images).T @ by_told + prior)
    sd = float(np.median(_angles(by_told @ turn.T, by_images))) / np.sqrt(count)
    fitted = told.copy()
    fitted[:3, :3] = told[:3, :3] @ turn.T
    return fitted, sd


def _turn_scale(seen: _Seen, t_bc: Array) -> float | None:
    if seen.turning.sum() < LEAST_PAIRS:
        return None
    turns = seen.predicted(t_bc)[0][seen.turning]
    sizes = np.linalg.norm(seen.turns[seen.turning], axis=1)
    return float(np.median(sizes / np.linalg.norm(turns, axis=1)))


def _in_degrees(pairs: list[DrivenPair], given: Odometry, slower: Odometry, misfit: Misfit) -> bool:
    """Whether turns of a 57th of the size fit, and those that were given do not."""
    turned = [np.linalg.norm(p.turn) for p in pairs]
    rates = np.linalg.norm(given.twists[:, 3:], axis=1)
    seconds = [p.second - p.first for p in pairs]
    by_images = float(np.sum(turned)) / float(np.sum(seconds))
    if not float(np.mean(rates)) > 10.0 * max(by_images, 1e-3):
        return False
    seen = _seen(pairs, DeadReckoning(slower))
    scale, after = _turn_scale(seen, given.t_bc), seen.misfit(given.t_bc)
    return (scale is None or 1.0 / _NEAR < scale < _NEAR) and after.worst < min(FITS, misfit.worst)


def _sizes(seen: _Seen, t_bc: Array, pairs: list[DrivenPair]) -> list[str]:
    """What is wrong with the lengths of turns, and, where there are true poses, of ways."""
    out = []
    scale = _turn_scale(seen, t_bc)
    if scale is not None and abs(scale - 1.0) > SURE * _DEFAULTS.turn_scale_sd:
        out.append(
            f"The odometry's turns times {scale:.2f} fit the images: the wheels' distance, their unit or a "
            "focal length is wrong; correct it, or raise filter.odometry.turn_scale_sd."
        )
    ways = np.linalg.norm(seen.predicted(t_bc)[1], axis=1)
    true = np.array([p.true_way for p in pairs])
    known = np.isfinite(true) & (ways >= LEAST_WAY)
    if known.sum() >= LEAST_PAIRS:
        ratio = float(np.median(true[known] / ways[known]))
        if abs(ratio - 1.0) > SURE * _DEFAULTS.scale_sd:
            out.append(
                f"The odometry's ways times {ratio:.3g} are as long as those of the true poses: give both in "
                "metres, and check the wheels' radius."
            )
    return out


def _clock(pairs: list[DrivenPair], odometry: Odometry, t_bc: Array) -> list[str]:
    """Whether turns about the axis that the wheels turn about most fit clearly better at other times."""
    rates = odometry.twists[:, 3:]
    axis = np.linalg.eigh(rates.T @ rates)[1][:, -1]
    by_images = np.array([axis @ t_bc[:3, :3] @ p.turn for p in pairs])
    reckoned = DeadReckoning(odometry)

    def left(offset: float) -> float:
        moved = [reckoned.between(p.first - offset, p.second - offset) for p in pairs]
        known = np.array([m is not None for m in moved])
        if known.sum() < max(LEAST_PAIRS, CLEAR * len(pairs)):
            return np.inf
        said = np.array([axis @ rotation_log(m[:3, :3]) for m in moved if m is not None])
        return weighted_rms(np.abs(by_images[known] - said))

    offsets = np.linspace(-CLOCK, CLOCK, 41)
    values = np.array([left(o) for o in offsets])
    late = lowest(offsets, values, 0.0)
    step = offsets[1] - offsets[0]
    turned = weighted_rms(np.abs(by_images))
    if turned < LEAST_TURN or abs(late) < step or not values.min() < CLEAR * left(0.0):
        return []
    return [
        f"The odometry's clock is off: with {late:+.2f} s added to its stamps its turns fit the images (of "
        f"{np.rad2deg(left(0.0)):.1f} degrees {np.rad2deg(values.min()):.1f} are left); correct its stamps."
    ]


def _numbers(misfit: Misfit) -> str:
    said = [
        f"{what} are {np.rad2deg(angle):.0f} degrees off those of the images"
        for what, angle in zip(("its ways", "its turns"), misfit, strict=True)
        if np.isfinite(angle)
    ]
    return " and ".join(said)


def _falls(misfit: Misfit, seen: _Seen, t_bc: Array) -> str:
    after = seen.misfit(t_bc)
    said = [
        f"{what} are {np.rad2deg(b):.0f} degrees off those of the images, not {np.rad2deg(a):.0f}"
        for what, a, b in zip(("its ways", "its turns"), misfit, after, strict=True)
        if np.isfinite(a) and np.isfinite(b) and b < a
    ]
    return " and ".join(said)


def _given(t_bc: Array) -> str:
    return "--odometry-camera " + ",".join(f"{round(x, 2) + 0.0:g}" for x in mount_of(t_bc))
