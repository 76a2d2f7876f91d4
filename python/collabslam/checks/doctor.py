"""Why a run went well or badly, in sentences, from its ``frames.csv`` and ``summary.json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from collabslam.frontend.worn_verdict import contradicted
from collabslam.geometry import rotation_log
from collabslam.runs.report import DEGRADED_BY, FIXED
from collabslam.runs.results import MAP
from collabslam.runs.run_folder import RunFolder
from collabslam.types import Array, Mask

FEW_FEATURES = 20
FEW_MATCHES = 8
MANY = 0.3
"""Share of the searched features that is much to lose for one reason."""
LARGE_NIS = 1.5
"""Normalised innovation over its degrees of freedom (1 is expected) that shows a model that does not fit."""
FEW_MEASURED = 0.1
"""Share of a person's views that are measured at least, unless something is wrong."""
IN_VAIN = 10
"""Overlapping views in a row without a match that are worth a word."""
GYRO_GAPS = 0.1
"""Share of the frames without a gyroscope that has one which is worth a word."""
SPANS = 3
"""Stretches of frames that are named."""
ONLY_TURNED = 150.0, 30.0
"""Degrees that a camera turns while it goes as far as what it sees is away, from which on it only turns, and
in all."""
GAP = 3.0
"""Time between frames, in median ones, that counts as a gap."""


def diagnose(run: RunFolder) -> list[str]:
    """What went wrong in a run, the gravest first, and what to do about it; one sentence each."""
    frames = Frames(run.frames())
    if not len(frames):
        return ["The run has no frames: nothing was estimated."]
    summary = run.summary()
    if not frames.started.any():
        return [*_never_started(frames, summary), *_worn(frames)]
    gyro = list(_gyro(frames, summary))
    found = [
        *_only_turned(frames, run),
        *_lost(frames),
        *_degraded(frames),
        *_tracking(frames),
        *_consistency(frames),
    ]
    found += [*_clock(frames), *_worn(frames), *_persons(summary), *_scale(frames, summary)]
    found = found or ["Nothing is wrong with this run as far as its diagnostics show."]
    return [*found, *gyro, *_left_out(frames)]


class Frames:
    """Columns of ``frames.csv`` as arrays; NaN where a cell is empty or the column is missing."""

    def __init__(self, rows: list[dict[str, str]]) -> None:
        self._rows = rows
        self.started: Mask = self["started"] == 1.0
        self.status = np.array([row.get("status", "") for row in rows])
        self.degraded_by = Counter(row.get("degraded_by", "") for row in rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, column: str) -> Array:
        cells = (row.get(column) or "nan" for row in self._rows)
        return np.array([float(cell) for cell in cells], np.float64)

    def total(self, column: str) -> float:
        """Sum of a column."""
        return float(np.nansum(self[column]))


def _never_started(frames: Frames, summary: dict[str, Any]) -> Iterator[str]:
    start = summary.get("start")
    if start == "worn" and not frames.total("worn"):
        yield (
            "The filter never started: it waits for the worn camera, and no frame has a view of it; give "
            "--worn, or --start scale-free with --mode mono."
        )
    elif start == "worn" and not frames.total("overlap"):
        yield (
            "The filter never started: the predicted views of Cs and Cf never overlap; check that T_CF maps "
            "from Cf to Cs, in metres, and the camera axes (x right, y down, z forward)."
        )
    elif start == "worn":
        yield (
            f"The filter never started: Cf overlaps in {frames.total('overlap'):.0f} frames, but at most "
            f"{np.nanmax(frames['cf_matches']):.0f} points match; see the next lines."
        )
    elif start == "scale-free":
        yield (
            "The filter never started: the images do not tell how the camera moved; it must move, not "
            "only turn, by some percent of the distance of what it sees, among things that stand still."
        )
    else:
        yield f"The filter never started from '{start}': the first frames show too few points to track."


def _only_turned(frames: Frames, run: RunFolder) -> Iterator[str]:
    """Of one camera alone in a run that did not go well: turning tells no depth."""
    well = not frames.degraded_by.keys() - {""} and "LOST" not in frames.status
    points = run.landmarks().points if (run.path / MAP).exists() else np.empty((0, 3))
    if well or frames.total("worn") or not len(points):
        return
    _, poses, _ = run.trajectory()
    away = float(np.median(np.linalg.norm(points - poses[-1, :3, 3], axis=1)))
    steps = np.linalg.inv(poses[:-1]) @ poses[1:]
    turned = float(sum(np.degrees(np.linalg.norm(rotation_log(step[:3, :3]))) for step in steps))
    moved = float(np.linalg.norm(steps[:, :3, 3], axis=1).sum()) / away
    if turned > max(ONLY_TURNED[0] * moved, ONLY_TURNED[1]):
        yield (
            f"The camera only turned: {turned:.0f} degrees, on a way of {moved:.1f} times the distance of "
            "what it sees. Turning tells no depth: move it sideways too, or add Cf, a tag, odometry or a "
            "gyroscope."
        )


def _lost(frames: Frames) -> Iterator[str]:
    first = int(np.flatnonzero(frames.started)[0])
    lost = np.flatnonzero(frames.status == "LOST")
    coasting = int(np.sum(frames.status[first:] == "COASTING"))
    if lost.size:
        k = int(lost[0])
        before = frames["accepted"][max(first, k - 10) : k]
        again = int(frames.total("relocalised"))
        found = f" It finds itself in its map again {again} times." if again else ""
        yield (
            f"The camera is lost from frame {k} on ({frames['t'][k] - frames['t'][0]:.1f} s), after "
            f"{float(np.nanmean(before)):.0f} accepted matches a frame in the ten frames before.{found}"
        )
    elif coasting:
        yield f"In {coasting} of {len(frames) - first} frames fewer than {FEW_MATCHES} matches were accepted."


_REMEDIES = {
    "gyro": "check its mount, unit and clock (collabslam check-calib), or leave it out (--gyro none)",
    "t_cf": "check its frame, unit, clock and covariance, and the focal lengths (collabslam check-calib)",
    "cf_matches": "T_CF is off by more than its covariance says, or a focal length is wrong (check-calib)",
    "size": "the map has lost its scale, as in a turn that showed little that stands still, or T_CF is too "
    "long or too short, or depths are in another unit (--depth-scale)",
    "jump": "the images repeat or skip (a buffer that is played again), their stamps are wrong, or two "
    "places look the same",
    "matches": "things move over much of the image, the focal length is wrong, or one camera alone does not "
    "find the depths on this path",
    "moving": "things move over much of the image, the camera only turns (move it sideways), or its "
    "calibration is wrong (check-calib)",
    "noise": "check the calibration, or raise filter.pixel.sigma_cs",
    "attitude": "a turn showed nothing: give it a gyroscope (--gyro), light, or something to see; the map "
    "that began after it is right in itself",
}


def _degraded(frames: Frames) -> Iterator[str]:
    for cause, count in frames.degraded_by.most_common():
        if cause in _REMEDIES:
            yield f"{count} frames are not to be trusted: {DEGRADED_BY[cause]}; {_REMEDIES[cause]}."


def _tracking(frames: Frames) -> Iterator[str]:
    searched = frames.total("searched")
    predicted = frames["predicted"][frames.started]
    if predicted.size and float(np.nanmedian(predicted)) < FEW_FEATURES:
        yield (
            f"The map is thin: {float(np.nanmedian(predicted)):.0f} features are in view in the median; the "
            "scene lacks texture, or corners are refused (lower frontend.detect.quality)."
        )
    if fixed := frames.total("candidates_fixed"):
        yield f"{fixed:.0f} {FIXED}; clean the lens, crop the image, or turn the camera."
    if not searched:
        return
    if frames.total("rejected_low_score") > MANY * searched:
        share = frames.total("rejected_low_score") / searched
        yield (
            f"{100 * share:.0f} % of the features searched look different from their patches: blur, changing "
            "exposure, or a calibration that predicts them at the wrong place (try collabslam check-calib)."
        )
    if frames.total("rejected_ambiguous") > MANY * searched:
        share = frames.total("rejected_ambiguous") / searched
        yield f"{100 * share:.0f} % of the features searched are ambiguous: the texture repeats itself."
    refused = frames.total("rejected_hohct") + frames.total("rejected_chi2")
    if refused > 0.5 * MANY * searched:
        yield (
            f"{100 * refused / searched:.0f} % of the features searched are found where the filter does not "
            "allow: things move, the calibration is off, or filter.pixel.sigma_cs is too small."
        )


def _left_out(frames: Frames) -> Iterator[str]:
    """What of the images was left out, and when: nothing wrong, but it may be more than is meant."""
    share, unseen = np.nan_to_num(frames["left_out_pct"]), np.nan_to_num(frames["wearers_unseen"])
    if share.any():
        some, wearers = share > 0.0, np.nan_to_num(frames["wearers"]) > 0.0
        seen = f", {_spans(frames, wearers)}" if wearers.any() else ""
        yield (
            f"{share[some].mean():.0f} % of the image was left out in the mean of {some.sum()} frames "
            f"({_spans(frames, some)}), at most {share.max():.0f} %: masked, fixed to the camera, or who "
            f"wears Cf (in view in {wearers.sum()} frames{seen})."
        )
    if unseen.any():
        there = unseen > 0.0
        yield (
            f"In {there.sum()} frames ({_spans(frames, there)}) the scene shows where whoever wears Cf "
            "should be: nobody is there (frontend.worn.body_radius=0), or T_CF is off."
        )


def _spans(frames: Frames, which: Mask) -> str:
    """From when to when frames are, of the longest stretches first, seconds from the first frame."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(np.int8)))
    spans = sorted(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True), key=lambda s: s[0] - s[1])
    t = frames["t"] - frames["t"][0]
    told = [f"{t[a]:.1f} to {t[b - 1]:.1f} s" for a, b in sorted(spans[:SPANS])]
    return ", ".join(told) + (f" and {len(spans) - SPANS} shorter" if len(spans) > SPANS else "")


def _consistency(frames: Frames) -> Iterator[str]:
    dof = frames.total("nis_dof")
    ratio = frames.total("nis") / dof if dof else 0.0
    if ratio > LARGE_NIS:
        yield (
            f"The innovations are {ratio:.1f} times as large as the filter expects: its covariance is too "
            "small here; check the calibration, or raise filter.pixel.sigma_cs."
        )


def _clock(frames: Frames) -> Iterator[str]:
    steps = np.diff(frames["t"])
    if not steps.size:
        return
    typical = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP * typical)
    if gaps.size:
        k = int(gaps[np.argmax(steps[gaps])])
        yield (
            f"There are {gaps.size} gaps in time, the longest of {steps[k]:.2f} s before frame {k + 1} "
            f"(frames are {typical:.3f} s apart): the motion in them is a guess."
        )


def _worn(frames: Frames) -> Iterator[str]:
    views, overlaps = frames.total("worn"), frames.total("overlap")
    if not views:
        return
    if not overlaps and frames.started.any():
        yield (
            f"Cf was there in {views:.0f} frames but its view never overlapped with Cs's as predicted; check "
            "that T_CF maps from Cf to Cs, in metres."
        )
        return
    points, matches = frames.total("cf_points"), frames.total("cf_matches")
    if points and matches < 0.1 * points:
        reasons = {
            "outside the overlap": frames.total("cf_rejected_region"),
            "no candidate near the epipolar line (T_CF or its clock)": frames.total("cf_rejected_epipolar"),
            "ambiguous or unlike (another viewpoint, blur)": frames.total("cf_rejected_ratio"),
            "low correlation": frames.total("cf_rejected_low_score"),
        }
        reason = max(reasons, key=lambda r: reasons[r])
        yield (
            f"Only {100 * matches / points:.1f} % of the points looked for in Cf match; most fail as: "
            f"{reason}."
        )
    yield from _in_vain(frames)
    if contradicted(frames["t_cf_against"]):
        metres, degrees = (float(np.nanmedian(frames[f"t_cf_correction_{unit}"])) for unit in ("m", "deg"))
        yield (
            f"T_CF contradicts the images: they move it by {100 * metres:.1f} cm and {degrees:.1f} degrees "
            f"in the median, more than its covariance allows; check its clock, its frame and its covariance "
            "(try collabslam check-calib)."
        )
    yield from _changed(frames)


def _changed(frames: Frames) -> Iterator[str]:
    """Whether lengths of T_CF have changed against the map."""
    doubt = np.nan_to_num(frames["t_cf_length_doubt"])
    if not doubt.any():
        return
    first = int(np.argmax(doubt > 0.0))
    yield (
        f"T_CF's lengths have changed against the map's, by up to {100 * doubt.max():.0f} %, first "
        f"seen in frame {first} ({frames['t'][first]:.1f} s): the scale of the tracker may have changed, or "
        "that of the map. Which of them it was no image tells, and the covariance holds both since; check "
        "the tracker."
    )


def _in_vain(frames: Frames) -> Iterator[str]:
    """Overlapping views of which all that was looked for failed, where others of the run match."""
    asked = np.flatnonzero((frames["overlap"] == 1.0) & (frames["cf_points"] > 0.0))
    matched = np.flatnonzero(frames["cf_matches"][asked] > 0.0)
    if not matched.size:
        return
    ends = np.concatenate([[-1], matched, [len(asked)]])
    k = int(np.argmax(np.diff(ends)))
    in_vain = asked[ends[k] + 1 : ends[k + 1]]
    if len(in_vain) >= IN_VAIN:
        yield (
            f"Of {len(in_vain)} overlapping views in a row, from frame {in_vain[0]} to {in_vain[-1]} "
            f"({frames['t'][in_vain[0]]:.1f} to {frames['t'][in_vain[-1]]:.1f} s), not one point matches, as "
            "they do in others: T_CF is of another place (a tracker that was lost, another clock), or Cf's "
            "view is blocked or blurred, or too far from that of Cs; the run went on without Cf."
        )


def _persons(summary: dict[str, Any]) -> Iterator[str]:
    """Of several persons those whose camera gives little; of one camera `_worn` tells more."""
    for of in summary.get("worn", []):
        name, views, measured = of["name"], of["views"], of["measured"]
        if not name or (views and measured >= FEW_MEASURED * views):
            continue
        if not views:
            yield f"No view of {name} reached the filter; check that person's clock and folder of images."
        else:
            yield (
                f"Of {views} views of {name} {measured} were measured: they do not overlap with Cs's, or "
                f"contradict it; check that person's T_CF (collabslam check-calib --worn recorded:{name})."
            )


def _gyro(frames: Frames, summary: dict[str, Any]) -> Iterator[str]:
    """Whether a gyroscope was used, and what for."""
    gyro = summary.get("gyro")
    if not gyro:
        return
    if not gyro["followed"]:
        yield (
            f"The gyroscope was left aside: the images of {gyro['contradicted']} frames contradict it; its "
            "mount, unit or clock is wrong (collabslam check-calib says which)."
        )
    used = frames["gyro_used"] == 1.0
    count, started = int(used.sum()), int(frames.started.sum())
    if not count:
        yield (
            "The gyroscope turned no frame: its samples do not cover them; put its stamps on the frames' "
            "clock (timeshift_cam_imu), see collabslam info."
        )
        return
    bare = int(np.sum(used & (np.nan_to_num(frames["accepted"]) < FEW_MATCHES)))
    blind = f", and alone in {bare} in which fewer than {FEW_MATCHES} matches told it" if bare else ""
    bias = " ".join(f"{b:.4f}" for b in gyro["bias_rad_s"])
    sd = max(gyro["bias_sd_rad_s"])
    yield (
        f"The gyroscope told how the camera turned in {count} of {started} frames{blind}; its bias is {bias} "
        f"rad/s (sd {sd:.4f}) at the end."
    )
    if count < (1.0 - GYRO_GAPS) * started:
        yield (
            f"The gyroscope's samples have gaps: {started - count} frames were predicted without it; see "
            "collabslam info, and record without other load."
        )


def _scale(frames: Frames, summary: dict[str, Any]) -> Iterator[str]:
    if summary.get("metric") is False:
        yield "Nothing told the scale at the start: lengths are in an arbitrary unit."
        return
    scale = summary.get("scale_error")
    if isinstance(scale, float) and abs(scale) > 0.05:
        where = (
            "long after the last overlap"
            if _since_overlap(frames) > 0.3 * len(frames)
            else "in spite of overlap"
        )
        depth = (
            " Its depths may be in another unit: see --depth-scale."
            if summary.get("start") == "depth"
            else ""
        )
        yield f"The path's scale is off by {100 * scale:+.0f} % against the truth, {where}.{depth}"


def _since_overlap(frames: Frames) -> int:
    seen = np.flatnonzero(frames["overlap"] == 1.0)
    return len(frames) - 1 - int(seen[-1]) if seen.size else len(frames)
