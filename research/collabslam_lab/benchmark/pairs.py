"""Pairs of posed views of one place, and true depths to judge matches between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.checks.samples import spread
from collabslam.datasets.emulated.view_overlap import grid_points
from collabslam.datasets.images import read_grey
from collabslam.datasets.recording import Rig
from collabslam.errors import DataError
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.frontend.viewed_points import ViewedPoints
from collabslam.frontend.worn_match import match_worn
from collabslam.geometry import pose_inverse
from collabslam.settings.table import Settings
from collabslam.simulation.recording import SimulatedRecording, demo_recording
from collabslam.types import Array, Image, Recording, WornView
from collabslam_lab.benchmark.opening import open_folder, views_of
from collabslam_lab.benchmark.plan import Entry

PER_BIN = 6
"""Pairs of each bin of angle between the optical axes, in each recording."""
_BINS = (0.0, 5.0, 10.0, 20.0, 30.0, 60.0)
_FRAMES, _OTHERS = 16, 120  # frames of Cs and other views among which pairs are looked for
_LEAST_SHARE, _LEAST_BASELINE = 0.3, 0.05
_THIRD_BASELINES = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)  # metres, of the frames that give the true depth
_THIRD_AXES, _THIRD_PARALLAX, _THIRD_AGREE = 10.0, 1.0, 0.08  # degrees, degrees, share of the range
_TRUTH_SD = np.diag(np.r_[np.full(3, 0.005), np.full(3, np.radians(0.1))] ** 2)


@dataclass(frozen=True)
class Others:
    """Views with true poses: camera, how to read them, and their ``T_WF`` (N, 4, 4)."""

    camera: Camera
    image: Callable[[int], Image]
    poses: Array


@dataclass(frozen=True)
class Scene:
    """A recording and the other views of its place.

    Attributes
    ----------
    recording : Recording
    poses : (N, 4, 4) float64
        True ``T_WC``.
    other : Others
    kind : str
        ``frames``, ``views`` or ``rig``: where the other views come from.
    """

    recording: Recording
    poses: Array
    other: Others
    kind: str

    @property
    def camera(self) -> Camera:
        """Of Cs."""
        return self.recording.camera

    def image(self, i: int) -> Image:
        """Frame ``i`` of Cs."""
        return self.recording.image(i)

    @classmethod
    def of(cls, entry: Entry, data: Path, seed: int) -> Scene:
        """The recording of an entry; raises DataError if it lacks true poses or the rig asked for."""
        recording: Recording = demo_recording(seed) if entry.rendered else open_folder(entry, data)
        truth = recording.truth
        if truth is None:
            raise DataError(f"{entry.name} has no true poses; matches cannot be judged.")
        kind = (entry.worn or "lag").partition(":")[0]
        if kind == "rig":
            rig: Any = getattr(recording, "rig", None)
            if not isinstance(rig, Rig):
                raise DataError(f"{entry.name} has no second camera; give another worn camera than 'rig'.")
            poses = np.full_like(truth, np.nan)
            for i in rig.paths:
                poses[i] = truth[i] @ rig.t_cf
            other = Others(rig.camera, lambda j: read_grey(rig.paths[j], rig.camera), poses)
            return cls(recording, truth, other, kind)
        if kind == "views":
            views = views_of(entry, recording)
            other = Others(views.camera, lambda j: read_grey(views.paths[j], views.camera), views.poses)
            return cls(recording, truth, other, kind)
        return cls(recording, truth, Others(recording.camera, recording.image, truth), "frames")


@dataclass(frozen=True)
class Pair:
    """Frame ``i`` of Cs, other view ``j``, true ``T_CF``."""

    i: int
    j: int
    t_cf: Array

    @property
    def axes_deg(self) -> float:
        """Angle between the optical axes, degrees."""
        return axes_angle(self.t_cf)

    def facts(self) -> dict[str, Any]:
        """For a row."""
        baseline = float(np.linalg.norm(self.t_cf[:3, 3]))
        return {"frame": self.i, "view": self.j, "axes_deg": self.axes_deg, "baseline_m": baseline}


def axes_angle(t_cf: Array) -> float:
    """Angle between the optical axes of two cameras, degrees."""
    return float(np.degrees(np.arccos(np.clip(t_cf[2, 2], -1.0, 1.0))))


def choose_pairs(scene: Scene) -> list[Pair]:
    """Pairs that share a good part of their view, evenly over the recording, some for each bin of angle."""
    frames = spread(_known(scene.poses), _FRAMES)
    others = spread(_known(scene.other.poses), _OTHERS)
    points = grid_points(scene.camera)
    binned: list[list[Pair]] = [[] for _ in _BINS[1:]]
    for i in frames:
        t_cw = pose_inverse(scene.poses[i])
        for j in [i] if scene.kind == "rig" else others:
            pair = Pair(i, j, t_cw @ scene.other.poses[j])
            k = int(np.searchsorted(_BINS, pair.axes_deg, side="right")) - 1
            near = np.linalg.norm(pair.t_cf[:3, 3]) < _LEAST_BASELINE
            if k < len(binned) and not near and _share(points, scene.other.camera, pair.t_cf) >= _LEAST_SHARE:
                binned[k].append(pair)
    return [group[k] for group in binned for k in spread(range(len(group)), PER_BIN)]


def _known(poses: Array) -> list[int]:
    """Indices of the poses that are not missing."""
    return [int(k) for k in np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))]


def _share(points: Array, camera: Camera, t_cf: Array) -> float:
    """Share of points of C, at plausible depths, that another camera sees."""
    return float(np.mean(camera.project((points - t_cf[:3, 3]) @ t_cf[:3, :3]).visible))


def true_inverse_ranges(scene: Scene, i: int, uv: Array, settings: Settings) -> Array:
    """(N,) inverse distance, 1/m, of points of frame ``i``; NaN where it is not known.

    A rendered scene knows it. On real images other frames, with their true poses, are matched: at least two
    of them must agree within 8 %.
    """
    rays = scene.camera.unproject(uv).reshape(-1, 3)
    if isinstance(scene.recording, SimulatedRecording):
        depth = scene.recording.renderer.depth(scene.poses[i], scene.camera)
        u, v = (np.clip(np.rint(uv[:, k]).astype(int), 0, depth.shape[1 - k] - 1) for k in (0, 1))
        return np.asarray(rays[:, 2] / depth[v, u])
    image = scene.image(i)
    found = np.full((len(_THIRD_BASELINES), len(uv)), np.nan)
    for row, k in enumerate(_third_frames(scene, i)):
        relative = pose_inverse(scene.poses[i]) @ scene.poses[k]
        there = WornView(scene.image(k), relative, _TRUTH_SD)
        matches = match_worn(image, there, ViewedPoints(uv), (scene.camera, scene.camera), settings)
        rays_s, rays_k = rays[matches.index], scene.camera.unproject(matches.uv_f).reshape(-1, 3)
        rho = inverse_ranges(rays_s, rays_k, relative)
        cosine = np.sum(rays_s * (rays_k @ relative[:3, :3].T), axis=1)
        wide = np.arccos(np.clip(cosine, -1.0, 1.0)) >= np.radians(_THIRD_PARALLAX)
        found[row, matches.index[wide & (rho > 0.0)]] = rho[wide & (rho > 0.0)]
    return _agreed(found)


def _agreed(found: Array) -> Array:
    """Median of each column where at least two of its numbers are near it, else NaN."""
    out = np.full(found.shape[1], np.nan)
    for n in range(found.shape[1]):
        values = found[np.isfinite(found[:, n]), n]
        if len(values) >= 2:
            middle = float(np.median(values))
            near = np.abs(values - middle) <= _THIRD_AGREE * middle
            if near.sum() >= 2:
                out[n] = values[near].mean()
    return out


def _third_frames(scene: Scene, i: int) -> list[int]:
    """Frames of Cs that look the same way from about each of the baselines away."""
    relative = np.array([pose_inverse(scene.poses[i]) @ pose for pose in scene.poses])
    length = np.linalg.norm(relative[:, :3, 3], axis=1)
    with np.errstate(invalid="ignore"):
        usable = relative[:, 2, 2] >= np.cos(np.radians(_THIRD_AXES))
    chosen = []
    for wanted in _THIRD_BASELINES:
        off = np.where(usable, np.abs(length - wanted), np.inf)
        k = int(np.argmin(off))
        if off[k] <= 0.5 * wanted and k != i and k not in chosen:
            chosen.append(k)
    return chosen
