"""Printed tags and boards in the map: points of known distances, known by what is printed (METHOD 10)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from collabslam._core import Camera, Filter, Prediction, SearchResult
from collabslam.errors import CollabslamError, InputError
from collabslam.formats.schema import Check, array, items, refuse, table, text, whole
from collabslam.frontend.search import FOUND
from collabslam.geometry import pose_inverse, skew
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.state import PersistentState
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.targets.kinds import Board, Tag
from collabslam.targets.printed import Sighting, printed_corners, sighting
from collabslam.types import Array, Ids, Image

SIZE_SD = 0.005
"""Of each corner from its place, as a share of a target's size: measured, printed and flattened so well."""
MOST = 100
"""Targets, at most."""
_LEAST_HELD = 3
"""Corners by which a target is still where it was; with fewer it is added anew."""
_KEPT = 10
"""Targets whose corners stay in the map however long they were out of view."""
_BOARD_EVERY = 10  # frames from one search for boards in the map to the next: each takes long


@dataclass(frozen=True)
class SeenTarget:
    """A printed target in an image, and the landmarks that its corners are.

    Attributes
    ----------
    target : Tag or Board
    uv : (N, 2) float64
        Pixels of its corners.
    ids : (N,) int64
        Features of the map in use, or places in another one; some may be gone.
    """

    target: Tag | Board
    uv: Array
    ids: Ids


def known_points(seen: Sighting) -> tuple[Array, Array, Array]:
    """A printed target as the filter takes it, for `Filter.add_points`.

    Returns
    -------
    points : (N, 3) float64
        In C, metres.
    noise : (N, 3, 3) float64
        Of each point by itself, m^2.
    shared : (N, 3, 6) float64
        Derivative of the points by the error of the target's pose.
    """
    t_ct = pose_inverse(seen.t_tc)
    points = seen.points @ t_ct[:3, :3].T + t_ct[:3, 3]
    size = float(np.linalg.norm(np.ptp(seen.points, axis=0)))
    noise = np.tile((SIZE_SD * size) ** 2 * np.eye(3), (len(points), 1, 1))
    return points, noise, by_pose_error(points)


def by_pose_error(points: Array) -> Array:
    """(N, 3, 6) derivative of points (N, 3) in C by the error xi of T_TC: p_C = Exp(xi)^-1 p_hat."""
    out = np.zeros((len(points), 3, 6))
    out[:, :, :3] = -np.eye(3)
    for k, point in enumerate(points):
        out[k, :, 3:] = skew(point)
    return out


def _parse(name: str) -> Tag | Board:
    return Tag.parse(name) if "=" in name else Board.parse(name)


def _check_name(value: Any, where: str) -> None:
    text()(value, where)
    try:
        _parse(value)
    except CollabslamError:
        refuse(where, "a printed target")


def check_targets(value: Any, count: int, where: str) -> None:
    """Printed targets of a map of so many landmarks, as `PrintedTargets.in_list` gives them."""
    table(str, array("<i8", None))(value, where)
    for name, places in value.items():
        _check_name(name, where)
        if len(places) != len(_parse(name).corners()):
            refuse(f"{where} {name}", "the landmark of each corner")
        if ((places < -1) | (places >= count)).any():
            refuse(f"{where} {name}", "landmarks of this map, or -1")


class PrintedTargets(PersistentState):
    """The tags and boards that were announced, and which features of the map their corners are.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_names": items(_check_name),
        "_features": table(str, array("<i8", None)),
        "_board_in": whole(0, _BOARD_EVERY),
    }

    def __init__(self, core: Filter, camera: Camera) -> None:
        self._core, self._camera = core, camera
        self._names: list[str] = []
        self._features: dict[str, Ids] = {}
        self._board_in = 0
        self._corners: dict[Tag | Board, Array] = {}

    def add(self, target: Tag | Board) -> None:
        """Announces a target; raises InputError if it was announced with another size, or is one too many."""
        known = [_parse(name) for name in self._names]
        if target in known:
            return
        if any(_alike(target, other) for other in known):
            raise InputError(f"The target {target} is known with another size; give each one once.")
        if len(known) >= MOST:
            raise InputError(f"There are {MOST} printed targets already; leave out some.")
        self._names = [*self._names, str(target)]

    def place(self, view: View, expected: Prediction, found: TrackingResult) -> TrackingResult:
        """The frame's search, with the corners of targets where they were read off.

        Parameters
        ----------
        view : View
        expected : Prediction
            Features that should be visible.
        found : TrackingResult
            Outcome of the search.
        """
        if not self._names:
            return found
        self._corners = printed_corners(view.image, self._looked_for())
        for target, uv in self._corners.items():
            ids = self._features.get(str(target))
            if ids is not None:
                found = _with_corners(found, expected, ids, _as_expected(target, uv, ids, expected))
        unread = [ids for name, ids in self._features.items() if _parse(name) not in self._corners]
        return _without_missed(found, np.concatenate([np.empty(0, np.int64), *unread]))

    def best(self) -> Sighting | None:
        """Of the targets in this frame the one that tells the camera's pose best; None if there is none."""
        seen = [
            s for s in (sighting(t, uv, self._camera) for t, uv in self._corners.items()) if s is not None
        ]
        return min(seen, key=lambda s: float(np.linalg.slogdet(s.covariance)[1]), default=None)

    def adopt(self, seen: Sighting, ids: Ids) -> None:
        """These features, in order, are the corners of a target."""
        self._features = {**self._features, str(seen.target): ids}

    def in_list(self, ids: Ids) -> dict[str, Ids]:
        """Where the corners of the map's targets are in a list of features: (N,) by target, -1 where gone."""
        place = {i: k for k, i in enumerate(ids.tolist())}
        corners = {
            name: np.array([place.get(i, -1) for i in features.tolist()], np.int64)
            for name, features in self._features.items()
        }
        return {name: places for name, places in corners.items() if (places >= 0).sum() >= _LEAST_HELD}

    def begin(self, targets: Mapping[str, Ids], ids: Ids) -> None:
        """The targets of a map to start in, as `in_list` gives them; its features are ``ids`` now."""
        for name, places in targets.items():
            self.add(_parse(name))
            self._features = {**self._features, name: np.where(places >= 0, ids[places], -1)}

    def move(self, features: Mapping[str, Ids]) -> None:
        """The camera is in another map, of which these features are the corners of targets, by name."""
        self._features = dict(features)

    def in_map(self) -> list[SeenTarget]:
        """Those in this frame whose corners were features of the map, and which one is which can be told."""
        return self.among(self._features)

    def among(self, known: Mapping[str, Ids]) -> list[SeenTarget]:
        """Those in this frame whose corners are among landmarks, and which one is which can be told."""
        return [
            SeenTarget(target, uv, known[str(target)])
            for target, uv in self._corners.items()
            if str(target) in known and (isinstance(target, Tag) or target.has_direction)
        ]

    def kept(self) -> Ids:
        """Features that the map keeps though they are out of view: four corners of each of the first targets.

        They are where the camera, or a worn one, finds out how far it has drifted.
        """
        first = list(self._features.items())[:_KEPT]
        corners = [features[_outermost(_parse(name))] for name, features in first]
        ids = np.concatenate([np.empty(0, np.int64), *corners])
        return ids[ids >= 0]

    def in_worn(self, image: Image) -> ImagePoints:
        """Features that are corners of tags in a picture of Cf, and their pixels there (METHOD 10).

        Boards are not looked for: it takes long, and each view of Cf would have to wait for it.
        """
        tags = [tag for tag in map(_parse, self._features) if isinstance(tag, Tag)]
        if not tags:
            return ImagePoints()
        corners = printed_corners(image, tags)
        seen = ImagePoints()
        for tag, uv in corners.items():
            seen = seen.with_more(ImagePoints(self._features[str(tag)], uv))
        return seen.without(np.setdiff1d(seen.ids, self._core.features))

    def births(self) -> ImagePoints:
        """Adds the corners of targets in this frame that the map does not hold, or hardly any of."""
        if not self._corners:
            return ImagePoints()
        held = self._core.features
        born = ImagePoints()
        for target, uv in self._corners.items():
            ids = self._features.get(str(target), np.empty(0, np.int64))
            if np.isin(ids, held).sum() >= _LEAST_HELD:
                continue
            seen = sighting(target, uv, self._camera)
            if seen is None:
                continue
            new = ImagePoints(self._core.add_points(*known_points(seen), seen.covariance), uv)
            self.adopt(seen, new.ids)
            born = born.with_more(new)
        return born

    def counts(self) -> dict[str, int]:
        """Diagnostics: printed targets in this frame, where any were announced."""
        return {"printed_targets": len(self._corners)} if self._names else {}

    def _looked_for(self) -> list[Tag | Board]:
        """All targets, but boards that the map holds only every now and then."""
        targets = [_parse(name) for name in self._names]
        if self._board_in == 0:
            self._board_in = _BOARD_EVERY
        else:
            known = self._features
            targets = [t for t in targets if isinstance(t, Tag) or str(t) not in known]
        self._board_in -= 1
        return targets


def _outermost(target: Tag | Board) -> list[int]:
    """Four corners that are far apart, by their place among all of a target's."""
    if isinstance(target, Tag):
        return [0, 1, 2, 3]
    last = target.columns * target.rows - 1
    return [0, target.columns - 1, last - target.columns + 1, last]


def _alike(a: Tag | Board, b: Tag | Board) -> bool:
    """Whether an image cannot tell two targets apart."""
    if isinstance(a, Tag) and isinstance(b, Tag):
        return (a.family, a.number) == (b.family, b.number)
    if isinstance(a, Board) and isinstance(b, Board):
        return sorted((a.columns, a.rows)) == sorted((b.columns, b.rows))
    return False


def _as_expected(target: Tag | Board, uv: Array, ids: Ids, expected: Prediction) -> Array:
    """The corners from the end where they were expected, for boards that look the same upside down."""
    if isinstance(target, Tag) or target.has_direction:
        return uv
    rows = np.flatnonzero(np.isin(expected.ids, ids))
    at = np.array([int(np.flatnonzero(ids == i)[0]) for i in expected.ids[rows]], dtype=np.int64)
    off = [np.linalg.norm(corners[at] - expected.uv[rows], axis=1).sum() for corners in (uv, uv[::-1])]
    return uv if off[0] <= off[1] else uv[::-1]


def _without_missed(found: TrackingResult, ids: Ids) -> TrackingResult:
    """The search's outcome, as if those of these features that it missed had not been looked for.

    A target too near, half out of the image or blurred is not gone: its corners stay in the map.
    """
    kept = found.hit | ~np.isin(found.searched, ids)
    result = found.result
    return replace(
        found,
        searched=found.searched[kept],
        result=SearchResult(result.uv[kept], result.score[kept], result.second[kept], result.code[kept]),
        rho=found.rho[kept],
        rho_sd=found.rho_sd[kept],
    )


def _with_corners(found: TrackingResult, expected: Prediction, ids: Ids, uv: Array) -> TrackingResult:
    """The search's outcome, with these features found at these pixels if they were expected at all."""
    result = found.result
    there = np.isin(found.searched, ids)
    more = np.isin(expected.ids, ids) & ~np.isin(expected.ids, found.searched)
    searched = np.concatenate([found.searched, expected.ids[more]])
    count = int(more.sum())
    code = np.concatenate([result.code, np.full(count, FOUND)])
    pixels = np.concatenate([result.uv, expected.uv[more]])
    read = np.flatnonzero(np.isin(searched, ids))
    by_id = dict(zip(ids.tolist(), uv, strict=True))
    for row in read.tolist():
        pixels[row], code[row] = by_id[int(searched[row])], FOUND
    score = np.concatenate([np.where(there, 1.0, result.score), np.ones(count)])
    second = np.concatenate([np.where(there, 0.0, result.second), np.zeros(count)])
    return replace(
        found,
        searched=searched,
        result=SearchResult(pixels, score, second, code),
        rho=np.concatenate([found.rho, expected.rho[more]]),
        rho_sd=np.concatenate([found.rho_sd, expected.rho_sd[more]]),
    )
