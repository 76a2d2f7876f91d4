"""How far apart two views may be and still be matched: each descriptor on real pairs, by viewpoint angle.

A pair is a frame of Cs and another view of the same place with a known pose: the other camera of a rig, a
posed view, or another frame. What is measured is the pipeline's own matching (`match_worn`) with a ``T_CF``
that has the noise of the recording's worn camera; the truth only judges.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from collabslam._core import Camera, Filter, epipolar_residuals
from collabslam.batch.fingerprint import files_hash
from collabslam.batch.processes import use_one_thread
from collabslam.datasets.emulated.pose_noise import RIG_NOISE, SENSOR_NOISE, PoseNoise
from collabslam.datasets.emulated.worn import PoseErrors
from collabslam.errors import CollabslamError
from collabslam.frontend.describe import DESCRIPTORS, SUPPORT, describe
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.patch import SIZE
from collabslam.frontend.viewed_points import ViewedPoints
from collabslam.frontend.worn_match import match_worn
from collabslam.geometry import pose_inverse
from collabslam.runs.report import number
from collabslam.runs.results import write_summary
from collabslam.settings.table import Settings
from collabslam.slam.worn.matcher import NEW_POINTS
from collabslam.types import Array, Indices, Mask, WornView
from collabslam_lab.benchmark.pairs import Pair, Scene, choose_pairs, true_inverse_ranges
from collabslam_lab.benchmark.plan import Entry, Plan
from collabslam_lab.benchmark.store import KEY, Row, slug
from collabslam_lab.benchmark.surf import known_surf
from collabslam_lab.program import code_hash
from collabslam_lab.report import markdown_table

EDGES = (0.0, 5.0, 10.0, 20.0, 30.0, 180.0)
"""Of the bins of viewpoint angle, degrees."""
EPIPOLAR_PX, DEPTH_PX, DEPTH_SHARE = 3.0, 6.0, 0.04
"""A match is right within so many pixels of the true epipolar line, and of where its true depth, give or take
a share of it, puts it: the truth of real recordings is no better."""
HELPFUL = 8
"""A pair with at least so many right matches helps: fewer the pipeline drops."""
_NONE = np.empty((0, 2))
_DESCRIBED = 200


def measure(entry: Entry, data: Path, *, seed: int = 0, kinds: Iterable[str] | None = None) -> list[Row]:
    """Every descriptor on every pair of a recording.

    Parameters
    ----------
    entry : Entry
    data : Path
        Folder of the recordings.
    seed : int
        Of the noise of ``T_CF``.
    kinds : iterable of str, optional
        Of `DESCRIPTORS`, or `SURF`; all if left out.

    Returns
    -------
    list of dict
        A row for each pair and descriptor.

    Raises
    ------
    DataError
        If the recording cannot be read, or a descriptor's library is missing.
    """
    scene = Scene.of(entry, data, seed)
    errors = pose_errors(entry, seed)
    rows: list[Row] = []
    for pair in choose_pairs(scene):
        image_pair = ImagePair(scene, pair, errors)
        facts = {"recording": entry.name, **pair.facts()}
        with known_surf():
            rows += [{**facts, **image_pair.measure(kind)} for kind in kinds or DESCRIPTORS]
    return rows


def pose_errors(entry: Entry, seed: int) -> PoseErrors:
    """What a recording's ``T_CF`` errs by."""
    noise = PoseNoise(*entry.noise) if entry.noise else RIG_NOISE if entry.worn == "rig" else SENSOR_NOISE
    return PoseErrors(noise, seed, per_block=False)


class ImagePair:
    """One pair: points of Cs, their true depths, and what each descriptor makes of them.

    Attributes
    ----------
    overlap : OverlapPrediction or None
        By the measured ``T_CF``; None where that says that the views do not overlap.
    uv : (N, 2) float64
        The points: corners, unless others are given.
    """

    def __init__(self, scene: Scene, pair: Pair, errors: PoseErrors, uv: Array | None = None) -> None:
        settings = Settings.default()
        self._scene, self._pair, self._settings = scene, pair, settings
        image, other = scene.image(pair.i), scene.other.image(pair.j)
        t_cf, covariance = errors.measured(pair.t_cf, pair.i, 0), np.diag(errors.noise.deviations**2)
        core = Filter(scene.camera, scene.other.camera, settings=settings.filter)
        self.overlap = core.predict_overlap(t_cf, covariance)
        self._worn = WornView(other, t_cf, covariance)
        self.image, self.other = image, other
        if uv is None:
            uv = detect_corners(image, _NONE, NEW_POINTS, settings.frontend.detect, SIZE // 2 + 1)
        self.uv = uv
        self._rays = scene.camera.unproject(self.uv)
        self._rho = true_inverse_ranges(scene, pair.i, self.uv, settings)
        self._expected, self._inside = self._project(self._rho)
        changed, _ = self._project(self._rho * (1.0 + DEPTH_SHARE))
        self._slack = DEPTH_PX + np.linalg.norm(changed - self._expected, axis=1)

    def _project(self, rho: Array) -> tuple[Array, Mask]:
        """Where points of known inverse range lie in the other view, and which of them are in its image."""
        known = np.isfinite(rho) & (rho > 0.0)
        points = self._rays / np.where(known, rho, 1.0)[:, None]
        t_fc = pose_inverse(self._pair.t_cf)
        there = self._scene.other.camera.project(points @ t_fc[:3, :3].T + t_fc[:3, 3])
        return np.where(known[:, None], there.uv, np.nan), known & there.visible

    def parallax(self) -> float:
        """Median angle, degrees, at which both cameras see the points of known depth; NaN without any."""
        use = self._inside
        if not use.any():
            return float("nan")
        points = self._rays[use] / self._rho[use, None]
        back = points - self._pair.t_cf[:3, 3]
        cosine = np.sum(points * back, axis=1) / (
            np.linalg.norm(points, axis=1) * np.linalg.norm(back, axis=1)
        )
        return float(np.degrees(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))))

    def measure(self, kind: str, ratio: float | None = None) -> Row:
        """Matches, how many of them are right, and milliseconds of processor time.

        ``ratio`` is the largest of the best to the second best distance; the default's if left out.
        """
        frontend = self._settings.frontend
        worn = dataclasses.replace(frontend.worn, descriptor=kind)
        if ratio is not None:
            worn = dataclasses.replace(worn, ratio=ratio)
        settings = dataclasses.replace(self._settings, frontend=dataclasses.replace(frontend, worn=worn))
        row = {"descriptor": kind, **self.facts(), "ms_describe": self._describing(kind)}
        nothing = np.empty(0, np.int64)
        if self.overlap is None:
            return {**row, **self.judge(nothing, _NONE), "ms_match": 0.0}
        cameras = (self._scene.camera, self._scene.other.camera)
        regions = (self.overlap.roi_s, self.overlap.roi_f)
        began = time.process_time()
        found = match_worn(self.image, self._worn, ViewedPoints(self.uv), cameras, settings, regions=regions)
        took = 1e3 * (time.process_time() - began)
        return {**row, **self.judge(found.index, found.uv_f), "ms_match": took}

    def facts(self) -> Row:
        """Of the pair, whatever is matched."""
        return {
            "parallax_deg": self.parallax(),
            "points": len(self.uv),
            "points_with_depth": int(self._inside.sum()),
            "overlap": self.overlap is not None,
        }

    def judge(self, index: Indices, uv_f: Array) -> Row:
        """How many matches of points ``index`` with pixels of the other view are right."""
        rays_f = self._scene.other.camera.unproject(uv_f).reshape(-1, 3)
        focal = (_focal(self._scene.camera), _focal(self._scene.other.camera))
        residual = epipolar_residuals(self._rays[index], rays_f, self._pair.t_cf, focal).residual
        near = np.abs(residual) <= EPIPOLAR_PX * np.sqrt(2.0)  # of one coordinate: two views err
        judged = np.isfinite(self._rho[index]) & np.isfinite(self._expected[index]).all(axis=1)
        off = np.linalg.norm(uv_f - self._expected[index], axis=1)
        right = judged & near & (np.nan_to_num(off, nan=np.inf) <= np.nan_to_num(self._slack[index]))
        return {
            "matches": len(index),
            "epipolar_right": int(near.sum()),
            "with_depth": int(judged.sum()),
            "depth_right": int(right.sum()),
        }

    def _describing(self, kind: str) -> float:
        """Milliseconds for 200 points of the other view, all in one crop."""
        size = 0.5 * np.array(self.other.shape[::-1], np.float64)
        spread = np.linspace(-120.0, 120.0, 15)
        uv = (np.stack(np.meshgrid(spread, spread), axis=-1).reshape(-1, 2) + size)[:_DESCRIBED]
        began = time.process_time()
        describe(self.other, uv, 0.0, SUPPORT, kind)
        return 1e3 * (time.process_time() - began)


def _focal(camera: Camera) -> float:
    return float(np.sqrt(camera.intrinsics[0] * camera.intrinsics[1]))


def measure_all(
    plan: Plan,
    data: Path,
    present: Sequence[str],
    kept: Kept,
) -> tuple[list[Row], list[str]]:
    """Rows of every recording that has posed views, and the faults of the others.

    Runs in this process, one thread, so that times can be compared.
    """
    rows: list[Row] = []
    faults = []
    use_one_thread()
    for entry in plan.recordings:
        if entry.name not in present or not (entry.noisy or entry.rendered):
            continue
        done = kept.rows(entry)
        if done is None:
            try:
                done = measure(entry, data, seed=plan.seeds[0])
            except CollabslamError as error:
                faults.append(f"{entry.name}: {error}")
                print(f"{entry.name}: failed: {error}", flush=True)
                continue
            kept.keep(entry, done)
        rows += done
        print(f"{entry.name}: {len(done)} pairs and descriptors", flush=True)
    return rows, faults


class Kept:
    """The rows of each recording as files, used again as long as nothing changes that they depend on."""

    def __init__(self, folder: Path, data: Path, seed: int, again: bool) -> None:
        self._folder, self._data, self._seed, self._again = folder, data, seed, again

    def rows(self, entry: Entry) -> list[Row] | None:
        """The rows of an earlier run, or None."""
        try:
            stored = json.loads(self._path(entry).read_text(encoding="utf-8"))
            rows: list[Row] = stored["rows"]
            return None if self._again or stored[KEY] != self._facts(entry) else rows
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def keep(self, entry: Entry, rows: Sequence[Row]) -> None:
        """Write the rows."""
        write_summary(self._path(entry), {KEY: self._facts(entry), "rows": list(rows)})

    def _path(self, entry: Entry) -> Path:
        return self._folder / f"{slug(entry.name)}.json"

    def _facts(self, entry: Entry) -> str:
        here = Path(__file__)
        code = [
            code_hash(),
            *(files_hash(here.with_name(name)) for name in (here.name, "pairs.py", "surf.py")),
        ]
        recording = "" if entry.rendered else files_hash(self._data / entry.folder)
        return repr([*code, recording, self._seed, entry.worn, entry.noise, Settings.default().hash()])


def page(rows: Sequence[Row], faults: Sequence[str], how: str) -> str:
    """Tables by angle, each descriptor in each bin, over all recordings; and the range in which Cf helps."""
    parts = [
        "# Descriptors by viewpoint angle",
        f"```sh\n{how}\n```",
        "The pipeline's own matching of two views (corners of Cs tried in Cf, their depths unknown, one "
        "frame by itself, so the hardest case), with the measured T_CF and its noise. *Right by epipolar "
        f"line*: within {EPIPOLAR_PX:g} px of it under the true pose. *Right by depth*: also within "
        f"{DEPTH_PX:g} px of where the point's true depth, give or take {100 * DEPTH_SHARE:g} %, puts it, of "
        "those matches whose depth is known: in the rendered demo from the scene, on real images from two or "
        "more other frames with true poses that agree on it. *Of the points*: matches right by depth, of all "
        "points whose true place is inside Cf's image, hidden or not. "
        f"*Helped*: pairs with at least {HELPFUL} right matches (those of unknown depth judged by the line). "
        "Times are processor milliseconds, one thread, medians: the whole matching, and describing 200 "
        "points.",
    ]
    if not rows:
        return "\n\n".join([*parts, "No pairs were measured."]) + "\n"
    for key, title in (
        ("parallax_deg", "By the angle at which both cameras see the points (median of the pair)"),
        ("axes_deg", "By the angle between the optical axes"),
    ):
        parts += [f"## {title}", _by_angle(rows, key)]
    parts += [_range(rows), "## By recording", _by_recording(rows)]
    parts += [f"- {fault}" for fault in faults]
    return "\n\n".join(parts) + "\n"


_COLUMNS = ("pairs", "matches a pair", "right by epipolar line, %", "right by depth, %", "of the points, %",
            "helped, %", "ms matching", "ms describing")  # fmt: skip


def _by_angle(rows: Sequence[Row], key: str) -> str:
    lines = []
    for name, low, high in _bins():
        for kind in _kinds(rows):
            found = _within(rows, kind, key, low, high)
            if found:
                lines.append([f"{name} deg", kind, *_numbers(found)])
    return markdown_table(("angle", "descriptor", *_COLUMNS), lines)


def _by_recording(rows: Sequence[Row]) -> str:
    lines = [
        [name, kind, *_numbers([r for r in rows if r["recording"] == name and r["descriptor"] == kind])]
        for name in dict.fromkeys(r["recording"] for r in rows)
        for kind in _kinds(rows)
    ]
    return markdown_table(("recording", "descriptor", *_COLUMNS), lines)


def _within(rows: Sequence[Row], kind: str, key: str, low: float, high: float) -> list[Row]:
    """Rows of a descriptor whose angle lies in a bin; those without one in none."""
    return [r for r in rows if r["descriptor"] == kind and low <= (-1.0 if r[key] is None else r[key]) < high]


def _numbers(rows: Sequence[Row]) -> list[str]:
    keys = ("matches", "epipolar_right", "with_depth", "depth_right")
    total = {key: sum(r[key] for r in rows) for key in keys}
    points = sum(r["points_with_depth"] for r in rows)
    return [
        str(len(rows)),
        number(float(np.median([r["matches"] for r in rows])), 0),
        _percent(total["epipolar_right"], total["matches"]),
        _percent(total["depth_right"], total["with_depth"]),
        _percent(total["depth_right"], points),
        _percent(sum(helped(r) for r in rows), len(rows)),
        number(float(np.median([r["ms_match"] for r in rows])), 1),
        number(float(np.median([r["ms_describe"] for r in rows])), 1),
    ]


def helped(row: Row) -> bool:
    """Whether a pair has enough right matches."""
    return right_matches(row) >= HELPFUL


def right_matches(row: Row) -> float:
    """How many matches of a pair are right: by depth where it is known, else by the epipolar line."""
    unknown = row["matches"] - row["with_depth"]
    share = row["epipolar_right"] / row["matches"] if row["matches"] else 0.0
    return float(row["depth_right"] + share * unknown)


def _range(rows: Sequence[Row]) -> str:
    """Up to which angle at least half of the pairs help."""
    parts = []
    for kind in _kinds(rows):
        reach = "0"
        for _, low, high in _bins():
            found = _within(rows, kind, "parallax_deg", low, high)
            if found and sum(helped(r) for r in found) >= 0.5 * len(found):
                reach = f"{high:g}" if high < EDGES[-1] else f"beyond {low:g}"
        parts.append(f"{kind} {reach}")
    return (
        "The range in which Cf helps (bins in which at least half of the pairs have enough right matches), "
        f"degrees at which both cameras see the points: up to: {', '.join(parts)}."
    )


def _bins() -> list[tuple[str, float, float]]:
    return [
        (f"{low:g}-{high:g}" if high < 180.0 else f"{low:g}+", low, high) for low, high in pairwise(EDGES)
    ]


def _kinds(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(r["descriptor"] for r in rows))


def _percent(part: float, whole: float) -> str:
    return number(100.0 * part / whole, 1) if whole else "-"
