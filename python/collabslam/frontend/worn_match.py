"""Matches between the robot's view Cs and the worn camera's view Cf (METHOD sections 7 and 9).

The relative pose T_CF is measured with a covariance.  It says how a window of Cs looks in Cf, which points of
Cf lie on a point's epipolar line and in front of both cameras, and how wide that line is.  So:

1. corners inside Cf's region of interest;
2. descriptors on windows of Cs warped to Cf's view (where the view depends on the depth: for a few depths);
3. the best candidate inside the gate, if it is much better than the second best there, and mutual;
4. a consensus: the correction of T_CF that most matches agree on, under the prior of its covariance;
5. the same again for all points under the corrected pose, whose gate is far narrower; points of known depth
   are searched with their own patch where they must be;
6. each match located to sub-pixel by correlating the warped patch, and the consensus once more with these,
   but for those that what is known around them says are of something that looks the same (`plausible`);
7. apart from all this, what the images say of the measured pose, matched once more without leaning on it,
   and of the map's size, matched without leaning on the map (`worn_size`).

The corrected pose only vets the matches: the filter uses the measured one, or the images would count twice.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from collabslam._core import (
    Camera,
    Consensus,
    MatchNoise,
    PairOptions,
    PairPoints,
    affine_at,
    find_consensus,
    match_pairs,
    sample_templates,
)
from collabslam.frontend.describe import DESCRIPTORS, SUPPORT, Descriptors, describe
from collabslam.frontend.detect import Hidden, detect_corners, halves
from collabslam.frontend.epipolar import inverse_ranges, skews
from collabslam.frontend.patch import SIZE, inverse_maps, limits
from collabslam.frontend.plausible import VisibleLandmarks, far_from, surface_around, unlike
from collabslam.frontend.search import FOUND, active_search, peak_test, search_around, search_window
from collabslam.frontend.viewed_points import Region, ViewedPoints, inside, whole
from collabslam.frontend.worn_size import LEAST, ask_size
from collabslam.frontend.worn_verdict import WIDE, Verdict, ask_images
from collabslam.geometry import pose_inverse
from collabslam.settings.table import Settings
from collabslam.types import Array, Image, Indices, Mask, WornView

SIGMA = 1.0
"""Standard deviation of a corner's pixel, for the gates."""
_CORNERS = 500  # most interest points searched in Cf's region of interest
_CORNER_DISTANCE = 0.008  # least distance between them, as a share of the image's width
_GATE = 3.0  # radius of the epipolar and depth gates in standard deviations
_MAX_DISTANCE = 0.85  # largest distance of two descriptors (unit vectors)
_REFINE_RADIUS = 7.0  # pixels, in which the correlation refines a match
_DEPTHS = (0.1, 0.25)  # inverse depths, as shares of the largest, at which windows are warped besides 0
_REASONS = ("region", "epipolar", "ratio", "mutual", "score", "consensus")
_DEPTH_CHANGE = 0.15  # relative change of the warp that makes another depth worth its cost


@dataclass(frozen=True)
class WornMatches:
    """Matches of one frame.

    Attributes
    ----------
    index : (M,) int64
        Points, by their place in `ViewedPoints.uv`.
    uv_f : (M, 2) float64
        Sub-pixel position in Cf.
    score : (M,) float64
        Correlation of the warped patch there.
    rejected : dict
        Number of points without a match by reason: ``region`` (outside the region of interest, or not
        expected in Cf's picture), ``epipolar`` (no candidate in the gate), ``ratio`` (ambiguous or unlike),
        ``mutual``, ``score`` (low correlation), ``consensus`` (against the pose that the others agree on).
    corners : int
        Interest points found in Cf.
    landmarks : int
        Points of known depth that are expected in Cf's picture.
    verdict : Verdict or None
        What the images say of the measured pose.
    size : float
        How much they contradict the map's size (`ask_size`).
    """

    index: Indices
    uv_f: Array
    score: Array
    rejected: dict[str, int]
    corners: int
    landmarks: int = 0
    verdict: Verdict | None = field(default=None, repr=False)
    size: float = float("nan")


def match_worn(
    image: Image,
    worn: WornView,
    points: ViewedPoints,
    cameras: tuple[Camera, Camera],
    settings: Settings,
    *,
    regions: tuple[Region | None, Region | None] = (None, None),
    hidden: Hidden | None = None,
) -> WornMatches:
    """Finds points of Cs in the worn camera's image.

    Parameters
    ----------
    image : (H, W) uint8
        Of Cs.
    worn : WornView
        With T_CF as it is for that image.
    points : ViewedPoints
    cameras : (Camera, Camera)
        Cs and Cf.
    settings : Settings
    regions : pair of (u0, v0, u1, v1) or None, optional
        Region of interest in each image, pixels; None is the whole image.
    hidden : callable, optional
        Which pixels of Cf are never scene.

    Returns
    -------
    WornMatches
    """
    return _Matcher(image, worn, points, cameras, settings, regions, hidden).run()


class _Described(NamedTuple):
    """Descriptors: (D, N, K) of points of Cs at inverse ranges ``depths`` (D,), and (M, K) of those of Cf."""

    of_s: Descriptors
    depths: Array
    of_f: Descriptors


class _Expected(NamedTuple):
    """Where points of known depth are expected in Cf.

    Attributes
    ----------
    uv : (N, 2) float64
        Pixels in Cf.
    spread : (N, 2, 2) float64
        Covariance from the depth, the pose and the pixels, px^2.
    ahead : (N,) bool
        Whether Cf looks towards them, so that they have a pixel at all.
    shown : (N,) bool
        Whether that is in Cf's picture, where its corners are.
    """

    uv: Array
    spread: Array
    ahead: Mask
    shown: Mask


class _Matcher:
    """The steps of :func:`match_worn` over their common data."""

    def __init__(
        self,
        image: Image,
        worn: WornView,
        points: ViewedPoints,
        cameras: tuple[Camera, Camera],
        settings: Settings,
        regions: tuple[Region | None, Region | None],
        hidden: Hidden | None,
    ) -> None:
        self.image_s, self.image_f = image, worn.image
        self.camera_s, self.camera_f = cameras
        self.hidden_f = hidden
        self.t_cf = np.asarray(worn.t_cf, dtype=np.float64)
        self.covariance = np.asarray(worn.covariance, dtype=np.float64)
        self.roi_s, self.roi_f = whole(regions[0], self.image_s), whole(regions[1], self.image_f)
        self.settings, self.options = settings.frontend, settings.frontend.worn
        self.near = settings.filter.overlap.near
        self.focal = (_focal(self.camera_s), _focal(self.camera_f))
        self.uv_s, self.rho = points.uv, points.rho
        self.rays_s = self.camera_s.unproject(self.uv_s).reshape(-1, 3)
        self.rho_sd = np.maximum(points.rho_sd, self.options.depth_floor * np.abs(self.rho))
        self.verdict: Verdict | None = None
        self.size = float("nan")
        self.known = np.isfinite(self.rho) & np.isfinite(self.rho_sd) & (self.rho_sd >= 0.0)

    def run(self) -> WornMatches:
        """All steps, in the order of the module's description."""
        usable = inside(self.uv_s, self.roi_s) & np.all(np.isfinite(self.rays_s), axis=1)
        points = np.flatnonzero(usable)
        rejected = dict.fromkeys(_REASONS, 0)
        rejected["region"] = len(usable) - len(points)
        uv_f = self._corners()
        corners = len(uv_f)
        if len(points) == 0 or corners < 2:
            return self._none(rejected, corners)
        rays_f = self.camera_f.unproject(uv_f)
        described = self._describe(points, uv_f)
        blind = self._without_the_map(points, described)
        self.verdict = self._ask(points, rays_f, blind)
        self.size = self._ask_size(points, rays_f, blind)
        i, j, _ = self._assign(points, rays_f, described, self.t_cf, self.covariance)
        seeds = self._consensus(self.rays_s[points[i]], rays_f[j], SIGMA)
        i, j, why = self._assign(points, rays_f, described, seeds.t_cf, seeds.covariance)
        rejected.update(why)
        index, place = points[i], uv_f[j]
        of_map = points[self.known[points]]
        expected = self._expect(of_map, seeds)
        index, place = self._add_known(of_map, expected, index, place, seeds.t_cf)
        tried = len(index)
        index, place, score = self._locate(index, place, seeds.t_cf)
        rejected["score"] = tried - len(index)
        beyond = self._new_beyond_the_edge(index, place, seeds)
        known = self.known[index]
        at = np.searchsorted(of_map, index[known])
        beyond[known] = ~expected.shown[at] & far_from(place[known], expected.uv[at], expected.spread[at])
        rejected["region"] += int(beyond.sum())
        index, place, score = index[~beyond], place[~beyond], score[~beyond]
        if len(index) == 0:
            return self._none(rejected, corners)
        rays_f = self.camera_f.unproject(place)
        final = self._consensus(self.rays_s[index], rays_f, 0.5 * SIGMA, seeds)
        keep = final.agree
        rejected["consensus"] = int((~keep).sum())
        if keep.sum() < max(self.options.min_matches, self.options.min_share * tried):
            rejected["consensus"] = len(index)
            return self._none(rejected, corners)
        matched = index[keep], place[keep], score[keep]
        landmarks = int(expected.shown.sum())
        return WornMatches(*matched, rejected, corners, landmarks, self.verdict, self.size)

    def _none(self, rejected: dict[str, int], corners: int) -> WornMatches:
        empty = np.empty(0)
        return WornMatches(
            np.empty(0, np.int64),
            empty.reshape(0, 2),
            empty,
            rejected,
            corners,
            verdict=self.verdict,
            size=self.size,
        )

    def _corners(self) -> Array:
        """Corners of Cf inside the region of interest."""
        roi = self.roi_f
        u0, v0 = (max(0, int(np.floor(x))) for x in roi[:2])
        u1, v1 = int(np.ceil(roi[2])) + 1, int(np.ceil(roi[3])) + 1
        crop = np.ascontiguousarray(self.image_f[v0:v1, u0:u1])
        border = SIZE // 2 + 1
        if min(crop.shape) <= 2 * border + 2:
            return np.empty((0, 2))
        detect = dataclasses.replace(
            self.settings.detect,
            subpixel=False,  # the correlation does that
            min_distance=_CORNER_DISTANCE * self.image_f.shape[1] / crop.shape[1],
        )
        corners = detect_corners(
            crop, np.empty((0, 2)), _CORNERS, detect, border, halves(self.image_f.shape[1])
        )
        corners += np.array([u0, v0])
        return corners if self.hidden_f is None else corners[~self.hidden_f(corners)]

    def _warps(self, points: Indices, t_cf: Array, rho: Array) -> Array:
        """(N, 2, 2) maps of Cs offsets to Cf offsets; those without a usable depth show the rotation only."""
        motion, allowed = pose_inverse(t_cf), limits(self.settings.patch)
        return affine_at(self.camera_s, self.uv_s[points], self.camera_f, motion, rho, allowed)

    def _describe(self, points: Indices, uv_f: Array) -> _Described:
        """Descriptors of the points of Cs, as they look in Cf at some depths, and of the corners of Cf."""
        known = self.known[points]
        free = np.flatnonzero(~known)
        depths = self._depths(points[free[:: max(1, len(free) // 16)]])
        own = np.where(known, self.rho[points], 0.0)
        of_s = self._windows(points, depths, free, own)
        of_f = describe(self.image_f, uv_f, 0.0, SUPPORT, self.options.descriptor)
        return _Described(of_s, np.array(depths), of_f)

    def _windows(self, points: Indices, depths: list[float], free: Indices, first: Array) -> Descriptors:
        """(D, N, K) descriptors of points of Cs, at their ``first`` inverse range; ``free`` ones at all."""
        of, rho = [points], [first]
        for depth in depths[1:]:
            of.append(points[free])
            rho.append(np.full(len(free), depth))
        index = np.concatenate(of)
        warps = self._warps(index, self.t_cf, np.concatenate(rho))
        make = DESCRIPTORS[self.options.descriptor]
        found = make(self.image_s, self.uv_s[index], inverse_maps(warps), SUPPORT)
        of_s = np.zeros((len(depths), len(points), found.shape[1]), dtype=np.float32)
        of_s[0] = found[: len(points)]
        of_s[1:, free] = found[len(points) :].reshape(len(depths) - 1, len(free), found.shape[1])
        return of_s

    def _depths(self, sample: Indices) -> list[float]:
        """Inverse ranges at which windows are warped: 0, and those where the warp has changed enough."""
        depths = [0.0]
        if len(sample) == 0:
            return depths
        last = self._warps(sample, self.t_cf, np.zeros(len(sample)))
        for share in _DEPTHS:
            rho = share / self.near
            warps = self._warps(sample, self.t_cf, np.full(len(sample), rho))
            change = np.linalg.norm(warps - last, axis=(1, 2)) / np.linalg.norm(last, axis=(1, 2))
            if np.median(change) > _DEPTH_CHANGE:
                depths.append(rho)
                last = warps
        return depths

    def _without_the_map(self, points: Indices, described: _Described) -> _Described:
        """Descriptors as if no depth were known."""
        known = np.flatnonzero(self.known[points])
        of_s = described.of_s.copy()
        depths = described.depths.tolist()
        of_s[:, known] = self._windows(points[known], depths, np.arange(len(known)), np.zeros(len(known)))
        return described._replace(of_s=of_s)

    def _ask(self, points: Indices, rays_f: Array, blind: _Described) -> Verdict | None:
        """What the images say of the measured pose: no depth of the map counts, as the map may rest on it."""
        nothing = np.zeros(len(points), np.bool_)
        i, j, _ = self._assign(points, rays_f, blind, self.t_cf, WIDE * self.covariance, nothing)
        return ask_images(self.rays_s[points[i]], rays_f[j], self.t_cf, self.covariance, self.focal)

    def _ask_size(self, points: Indices, rays_f: Array, blind: _Described) -> float:
        """How much the images contradict the map's size, by its points that match along their whole line."""
        if self.known[points].sum() < LEAST:
            return float("nan")
        nothing = np.zeros(len(points), np.bool_)
        i, j, _ = self._assign(points, rays_f, blind, self.t_cf, self.covariance, nothing)
        pose = self._consensus(self.rays_s[points[i]], rays_f[j], SIGMA)
        i, j, _ = self._assign(points, rays_f, blind, pose.t_cf, pose.covariance, nothing)
        of_map = self.known[points[i]] & (self.rho[points[i]] > 0.0)
        index, rays_f = points[i[of_map]], rays_f[j[of_map]]
        rays_s = self.rays_s[index]
        rho, rho_sd = inverse_ranges(rays_s, rays_f, pose.t_cf), self._triangulated_sd(rays_s, pose)
        measured = rho > _GATE * rho_sd
        index, rho, rho_sd = index[measured], rho[measured], rho_sd[measured]
        length = float(np.linalg.norm(pose.t_cf[:3, 3]))
        ours = np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3]).max()) / max(length, 1e-9)
        sd = np.sqrt((self.rho_sd[index] / self.rho[index]) ** 2 + (rho_sd / rho) ** 2 + ours**2)
        return ask_size(np.log(rho / self.rho[index]), sd)

    def _triangulated_sd(self, rays_s: Array, pose: Consensus) -> Array:
        """Standard deviation of the inverse range of matched points, 1/m, whatever it is."""
        across = np.maximum(np.linalg.norm(np.cross(rays_s, pose.t_cf[:3, 3]), axis=1), 1e-9)
        angle = np.sqrt(np.trace(pose.covariance[3:, 3:]) / 3.0 + (SIGMA / self.focal[1]) ** 2)
        return np.asarray(angle / across)

    def _assign(
        self,
        points: Indices,
        rays_f: Array,
        described: _Described,
        t_cf: Array,
        covariance: Array,
        known: Mask | None = None,
    ) -> tuple[Indices, Indices, dict[str, int]]:
        """Best, unambiguous and mutual candidates in the gate of a pose: rows of points and of corners.

        ``known`` are those of known depth, by default all that are.
        """
        options, known = self.options, self.known[points] if known is None else known
        reach = _GATE * self.rho_sd[points]
        low = np.where(known, self.rho[points] - reach, 0.0)
        high = np.where(known, self.rho[points] + reach, 1.0 / self.near)
        wanted = PairPoints(
            self.rays_s[points],
            np.stack([low, high], axis=1),
            known,
            described.of_s,
            described.depths,
        )
        good = PairOptions(
            sigma=(SIGMA / self.focal[0], SIGMA / self.focal[1]),
            gate=_GATE,
            ratio=options.ratio,
            max_distance=_MAX_DISTANCE,
        )
        found = match_pairs(wanted, rays_f, described.of_f, t_cf, covariance, good)
        why = {"epipolar": found.alone, "ratio": found.indistinct, "mutual": found.one_sided}
        return found.index_s, found.index_f, why

    def _consensus(
        self, rays_s: Array, rays_f: Array, sigma: float, start: Consensus | None = None
    ) -> Consensus:
        noise = MatchNoise(self.focal, sigma, max(self.options.max_residual, _GATE * sigma))
        return find_consensus(rays_s, rays_f, self.t_cf, self.covariance, noise, start)

    def _add_known(
        self, of_map: Indices, expected: _Expected, index: Indices, place: Array, t_cf: Array
    ) -> tuple[Indices, Array]:
        """Points of known depth without a match, searched with their own patch where they must be."""
        here = expected.ahead & inside(expected.uv, self.roi_f) & ~np.isin(of_map, index)
        rest = of_map[here]
        if len(rest) == 0:
            return index, place
        affine = self._warps(rest, t_cf, np.maximum(self.rho[rest], 0.0))
        templates = self._templates(rest, affine)
        uv, spread = expected.uv[here], expected.spread[here]
        result = active_search(self.image_f, templates, uv, spread, None, self.settings.search)
        found = result.code == FOUND
        return np.concatenate([index, rest[found]]), np.concatenate([place, result.uv[found]])

    def _expect(self, index: Indices, consensus: Consensus) -> _Expected:
        """Where points of known depth are in Cf under a corrected pose and its covariance."""
        t_cf = consensus.t_cf
        rotation, t = t_cf[:3, :3], t_cf[:3, 3]
        rho = np.maximum(self.rho[index], 0.0)
        seen = (self.rays_s[index] - rho[:, None] * t) @ rotation
        # By inverse range, by translation (on the right), by rotation (on the right).
        by_rho = -(t @ rotation)[None].repeat(len(index), axis=0)
        scale = np.linalg.norm(seen, axis=1, keepdims=True)
        directions = [by_rho * self.rho_sd[index][:, None]]
        root = np.asarray(np.linalg.cholesky(consensus.covariance), dtype=np.float64)
        directions += list(-rho[:, None] * root[:3].T[:, None] + seen @ skews(root[3:]))
        stack = np.stack([seen, *(seen + 1e-3 * d for d in directions)])
        front = seen[:, 2] > 1e-3 * scale[:, 0]
        in_front = np.where(front[None, :, None], stack, [0.0, 0.0, 1.0])
        uv = self.camera_f.project(in_front.reshape(-1, 3)).uv.reshape(len(directions) + 1, len(index), 2)
        change = (uv[1:] - uv[0]) / 1e-3
        spread = np.einsum("kni,knj->nij", change, change) + SIGMA**2 * np.eye(2)
        ahead = front & np.all(np.isfinite(uv), axis=(0, 2))
        return _Expected(uv[0], spread, ahead, ahead & self._in_picture(uv[0]))

    def _in_picture(self, uv: Array) -> Mask:
        """Which pixels of Cf are as far off the edge of its picture as its corners."""
        edge = SIZE // 2 + 1
        height, width = self.image_f.shape
        return inside(uv, (edge, edge, width - 1 - edge, height - 1 - edge))

    def _templates(self, index: Indices, affine: Array) -> Image:
        side = SIZE
        return sample_templates(self.image_s, self.uv_s[index], affine, side).templates

    def _locate(self, index: Indices, place: Array, t_cf: Array) -> tuple[Indices, Array, Array]:
        """Sub-pixel positions in Cf by correlating the patch of Cs, warped at each match's own depth."""
        if len(index) == 0:
            return index, place, np.empty(0)
        rho = inverse_ranges(self.rays_s[index], self.camera_f.unproject(place), t_cf)
        templates = self._templates(index, self._warps(index, t_cf, np.maximum(rho, 0.0)))
        result = search_around(
            self.image_f,
            templates,
            place,
            np.zeros((len(index), 2, 2)),
            search_window(self.settings.search.max_radius, min_radius=_REFINE_RADIUS),
            peak_test(self.options.min_score, ambiguity=1.0),
        )
        found = result.code == FOUND
        if self.hidden_f is not None:
            found[found] = ~self.hidden_f(result.uv[found])
        return index[found], result.uv[found], result.score[found]

    def _new_beyond_the_edge(self, index: Indices, place: Array, consensus: Consensus) -> Mask:
        """Which matches are of new points that Cf would not see, were they as far as what is around them.

        Only those whose match says that they are not.
        """
        out = np.zeros(len(index), np.bool_)
        free, of_map = np.flatnonzero(~self.known[index]), np.flatnonzero(self.known)
        uv, rays = self.uv_s[index[free]], self.rays_s[index[free]]
        landmarks = VisibleLandmarks(self.uv_s[of_map], self.rho[of_map], self.rho_sd[of_map])
        around = surface_around(uv, landmarks, self.image_s.shape[1])
        t = consensus.t_cf[:3, 3]
        matched = inverse_ranges(rays, self.camera_f.unproject(place[free]), consensus.t_cf)
        there = (rays - np.nan_to_num(around.rho)[:, None] * t) @ consensus.t_cf[:3, :3]
        seen = self.camera_f.project(there)
        shown = seen.visible & self._in_picture(seen.uv)
        out[free] = ~shown & unlike(
            VisibleLandmarks(uv, matched, self._triangulated_sd(rays, consensus)), around
        )
        return out


def _focal(camera: Camera) -> float:
    """Pixels per radian near the optical axis."""
    return float(np.sqrt(camera.intrinsics[0] * camera.intrinsics[1]))
