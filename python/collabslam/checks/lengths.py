"""Are the lengths of T_CF and of the true poses in the same unit?

One view's epipolar lines do not depend on the length of T_CF.  A third image does: what Cs and Cf place in
space has to appear where another frame of Cs, moved by the true poses, sees it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from collabslam.checks.matching import LEAST_MATCHES, Matches, describe, match_points
from collabslam.checks.mistakes import MirroredCamera, PoseMistake, undone
from collabslam.checks.report import Report
from collabslam.checks.robot import RobotReport
from collabslam.checks.samples import CLEAR_GAIN, spread
from collabslam.datasets.at_frames import AtFrames
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Mask

VIEWS = 12
UNITS = {
    "T_CF is in millimetres, or the true poses in kilometres": 1e-3,
    "T_CF is in centimetres": 1e-2,
    "T_CF is in feet": 0.3048,
    "the true poses are in millimetres": 1e3,
    "the true poses are in centimetres": 1e2,
    "the true poses are in feet": 1.0 / 0.3048,
}
"""What may be wrong, and the factor that turns T_CF's lengths into those of the true poses."""
NEAR = 1.25
"""Factor around a unit's within which it is named."""
_LEAST_PARALLAX = np.deg2rad(1.0)
_GAPS = (20, 10, 5, 3, 2)
_NEIGHBOURS = 6
"""Points that tell a length together; fewer do not tell it at all."""
LONGEST = 100.0
"""Length of T_CF that no two cameras of one scene have, metres."""


@dataclass(frozen=True)
class LengthReport(Report):
    """``ratio`` is that of the true poses' lengths to T_CF's; None if nothing tells it."""

    ratio: float | None = None


class _Triple(NamedTuple):
    """Unit rays of points seen by Cs, by Cf and by Cs later, and the poses of the other two in Cs."""

    robot: Array
    worn: Array
    later: Array
    t_cf: Array
    t_cl: Array


def check_lengths(recording: AtFrames, robot: RobotReport, undo: PoseMistake | None) -> LengthReport:
    """Hold the length of ``T_CF`` against that of the true poses, or of what is plausible.

    Parameters
    ----------
    recording : AtFrames
    robot : RobotReport
        What was found of Cs; its camera and its poses are used as mended there.
    undo : PoseMistake or None
        What was found of T_CF, undone here as well.
    """
    if recording.worn_camera is None:
        return LengthReport()
    if robot.poses is None or not robot.by_gap:
        return _plausible(recording)
    triples = _triples(recording, robot, undo)
    ratios = [r for t in triples if (r := _ratio(t)) is not None]
    if len(ratios) < 2:
        note = "Too few points are seen three times: the length of T_CF is not checked."
        return LengthReport(notes=[note])
    logs = np.log(ratios)
    middle = float(np.median(logs))
    error = float(np.std(logs) / np.sqrt(len(logs)))
    ratio = float(np.exp(middle))
    named = [text for text, factor in UNITS.items() if abs(middle - np.log(factor)) < np.log(NEAR)]
    if not named and not (abs(middle) > np.log(NEAR) and abs(middle) > 3.0 * error):
        return LengthReport(ratio)
    before, after = (robot.model.focal * _transferred(triples, factor) for factor in (1.0, ratio))
    if after > CLEAR_GAIN * before:
        return LengthReport(ratio)
    numbers = (
        f"with {ratio:.3g} times T_CF's length the residual of a third image falls from {before:.1f} to "
        f"{after:.1f} px"
    )
    if named:
        text = f"{named[0][0].upper()}{named[0][1:]}: {numbers}; give metres."
        return LengthReport(ratio, findings=[text])
    text = f"T_CF and the true poses are of different lengths: {numbers}; check the scale of both."
    return LengthReport(ratio, findings=[text])


def _plausible(recording: AtFrames) -> LengthReport:
    lengths = []
    for i in spread(range(len(recording)), VIEWS):
        worn = recording.view(i)
        if worn is not None:
            lengths.append(float(np.linalg.norm(worn.t_cf[:3, 3])))
    if lengths and np.median(lengths) > LONGEST:
        text = (
            f"T_CF is {np.median(lengths):.0f} m long: no two cameras see one scene from so far apart; it "
            "seems to be in millimetres or centimetres, give metres."
        )
        return LengthReport(findings=[text])
    note = "Without true poses nothing tells the unit of T_CF: its length is not checked."
    return LengthReport(notes=[note] if lengths else [])


def _triples(recording: AtFrames, robot: RobotReport, undo: PoseMistake | None) -> list[_Triple]:
    poses, models = robot.poses, (robot.model, MirroredCamera(recording.worn_camera or recording.camera))
    assert poses is not None
    known: Mask = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    out: list[_Triple] = []
    for i in spread(range(len(recording)), 4 * VIEWS):
        worn = recording.view(i)
        if worn is None or not known[i] or len(out) == VIEWS:
            continue
        here, there = describe(recording.image(i)), describe(worn.image)
        pairs = _partners(match_points(here, there))
        if len(pairs) < LEAST_MATCHES:
            continue
        t_cf = recording.moved(i) @ undone(undo, worn.t_cf)
        for k in (i + way * gap for gap in _GAPS for way in (1, -1)):
            if not 0 <= k < len(recording) or not known[k]:
                continue
            later = _partners(match_points(here, describe(recording.image(k))))
            both = sorted(set(pairs) & set(later))
            if len(both) < _NEIGHBOURS:
                continue
            uvs = np.array(both), np.array([pairs[uv] for uv in both]), np.array([later[uv] for uv in both])
            rays = [model.rays(uv) for model, uv in zip((models[0], models[1], models[0]), uvs, strict=True)]
            usable = np.all([np.isfinite(r).all(axis=1) for r in rays], axis=0)
            units = [r[usable] / np.linalg.norm(r[usable], axis=1, keepdims=True) for r in rays]
            out.append(_Triple(units[0], units[1], units[2], t_cf, pose_inverse(poses[i]) @ poses[k]))
            break
    return out


def _partners(matches: Matches) -> dict[tuple[float, float], Array]:
    """Points of the second image by those of the first."""
    return {(float(u), float(v)): b for (u, v), b in zip(matches.uv_a, matches.uv_b, strict=True)}


def _ratio(triple: _Triple) -> float | None:
    """Length of the true poses over that of T_CF, from the ranges that both give the same points."""
    by_worn = inverse_ranges(triple.robot, triple.worn, triple.t_cf)
    by_later = inverse_ranges(triple.robot, triple.later, triple.t_cl)
    apart = [
        np.linalg.norm(np.cross(triple.robot, rays @ t[:3, :3].T), axis=1)
        for rays, t in ((triple.worn, triple.t_cf), (triple.later, triple.t_cl))
    ]
    clear = (by_worn > 0.0) & (by_later > 0.0) & (np.minimum(*apart) > np.sin(_LEAST_PARALLAX))
    if np.sum(clear) < _NEIGHBOURS:
        return None
    return float(np.exp(np.median(np.log(by_worn[clear] / by_later[clear]))))


def _transferred(triples: list[_Triple], factor: float) -> float:
    """Median angle of the third image's points to where T_CF, so many times as long, places them."""
    out = []
    for triple in triples:
        t_cf = triple.t_cf.copy()
        t_cf[:3, 3] *= factor
        ahead = inverse_ranges(triple.robot, triple.worn, t_cf)
        placed = triple.robot - np.outer(ahead, triple.t_cl[:3, 3])
        rays = placed @ triple.t_cl[:3, :3]
        seen = np.linalg.norm(rays, axis=1) > 0.0
        cosine = np.sum(rays * triple.later, axis=1)[seen] / np.linalg.norm(rays, axis=1)[seen]
        out.append(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.median(np.concatenate(out)))
