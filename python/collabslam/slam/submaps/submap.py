"""A submap as it is kept: landmarks, what is known of them, and how they look, in few arrays (METHOD 25).

A robot keeps a thousand of them.  Of a symmetric covariance the lower triangle is kept, covariances are in
single precision, descriptors in bytes, and of the views the windows are in one array: what they are read as
is made anew each time that it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collabslam import _core
from collabslam._core import LAST_TIME
from collabslam.formats.schema import array, covariance, instance, items, number, pose, refuse
from collabslam.frontend.describe import Descriptors
from collabslam.frontend.patch import Patch
from collabslam.slam.state import PATCH
from collabslam.types import Array, Ids, Indices


@dataclass(frozen=True)
class Submap:
    """What is kept of a submap: its landmarks as they stood to the camera where it ended.

    Attributes
    ----------
    t : float
        When it ended, seconds.
    pose, pose_covariance : (4, 4), (6, 6) float64
        T_WC there as the filter had it, and its covariance.
    ids : (N,) int64
    points : (N, 3) float64
        Metres, in the frame of the camera.
    triangle : (3 N (3 N + 1) / 2,) float32
        Lower triangle of `covariance`, row by row; see `rounded`.
    with_transferred, transferred : (3 N, K) float32, (K, K) float64
        See `_core.Submap`; runs with different numbers of worn cameras differ in K.  With the covariance they
        make one that is at least what the filter told, see `rounded`.
    windows : (N, h, h) uint8
    uv_ref : (N, 2) float64
    inside : (N, 4) float64
        Of `patches`.
    codes : (N, 128) uint8
        `descriptors` in bytes; (0, 128) until the search that follows the submap's end is done.
    used : (N,) bool
        Landmarks that a loop rests on: each tells what it knows once.
    """

    t: float
    pose: Array
    pose_covariance: Array
    ids: Ids
    points: Array
    triangle: NDArray[np.float32]
    with_transferred: NDArray[np.float32]
    transferred: Array
    windows: NDArray[np.uint8]
    uv_ref: Array
    inside: Array
    codes: NDArray[np.uint8]
    used: NDArray[np.bool_]

    @classmethod
    def taken_down(cls, t: float, made: _core.Submap, patches: Sequence[Patch]) -> Submap:
        """Of what the filter told, with a view of each landmark from where it ended; not described yet."""
        triangle, with_transferred, transferred = rounded(
            made.covariance, made.with_transferred, made.transferred
        )
        return cls(
            t,
            made.pose,
            made.pose_covariance,
            made.ids,
            made.points,
            triangle,
            with_transferred,
            transferred,
            *_in_arrays(patches),
            np.empty((0, 128), np.uint8),
            np.zeros(len(made.ids), dtype=bool),
        )

    @property
    def covariance(self) -> Array:
        """Joint covariance (3 N, 3 N) of the points, metres^2."""
        return mirrored(self.triangle)

    @property
    def patches(self) -> list[Patch]:
        """A view of each landmark, from where the submap ended."""
        there = np.eye(4)
        there.flags.writeable = False
        parts = zip(self.windows, self.uv_ref, self.inside, strict=True)
        return [Patch(window, uv, there, inside) for window, uv, inside in parts]

    @property
    def descriptors(self) -> Descriptors:
        """Of the patches, (N, 128)."""
        return from_bytes(self.codes)

    @property
    def described(self) -> bool:
        """Whether it can be recognised."""
        return len(self.codes) == len(self.ids)

    def of_landmarks(self, which: Indices, patches: Sequence[Patch], descriptors: Descriptors) -> Submap:
        """With some of its landmarks, and these views of them."""
        rows = (3 * which[:, None] + np.arange(3)).ravel()
        windows, uv_ref, inside = _in_arrays(patches)
        return replace(
            self,
            ids=self.ids[which],
            points=self.points[which],
            triangle=lower_triangle(self.covariance[np.ix_(rows, rows)]),
            with_transferred=self.with_transferred[rows],
            windows=windows,
            uv_ref=uv_ref,
            inside=inside,
            codes=in_bytes(descriptors),
            used=self.used[which],
        )

    def without_landmarks(self) -> Submap:
        """Its pose alone; no part of the others' arrays stays."""
        return self.of_landmarks(np.empty(0, dtype=np.int64), [], np.empty((0, 128), np.float32))


def lower_triangle(matrix: Array) -> NDArray[np.float32]:
    """Of a symmetric matrix (N, N), row by row, to the nearest in single precision: (N (N + 1) / 2,)."""
    return matrix[np.tril_indices(len(matrix))].astype(np.float32)


def rounded(
    covariance: Array, with_others: Array, others: Array
) -> tuple[NDArray[np.float32], NDArray[np.float32], Array]:
    """A joint covariance (N + K, N + K) that is at least the one given, less exactly.

    Rounding changes an entry by a share ``e = 2^-24`` of itself at most, and no entry is larger than the root
    of the variances of its row and column: N + K + 2 such shares of each variance, added to it, outweigh all
    that rounding does, that of the sum too.

    Parameters
    ----------
    covariance, with_others, others : (N, N), (N, K), (K, K) float64

    Returns
    -------
    tuple
        The `lower_triangle` of the first and the second in single precision, and the third.
    """
    e = float(np.finfo(np.float32).eps) / 2.0
    share = 1.0 + (len(covariance) + len(others) + 2) * e
    wider, others = covariance.copy(), others.copy()
    for matrix in (wider, others):
        matrix[np.diag_indices(len(matrix))] *= share
    return lower_triangle(wider), with_others.astype(np.float32), others


def in_bytes(descriptors: Descriptors) -> NDArray[np.uint8]:
    """Unit vectors without negative entries, each entry to 1 / 255."""
    return np.asarray(np.rint(255.0 * descriptors), np.uint8)


def from_bytes(codes: NDArray[np.uint8]) -> Descriptors:
    """Unit vectors again; one of nothing stays nothing."""
    vectors = codes.astype(np.float32)
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1.0), np.float32)


def mirrored(triangle: NDArray[np.float32]) -> Array:
    """The symmetric matrix (N, N) of which this is the `lower_triangle`."""
    n = (math.isqrt(8 * len(triangle) + 1) - 1) // 2
    rows, columns = np.tril_indices(n)
    matrix = np.empty((n, n))
    matrix[rows, columns] = triangle
    matrix[columns, rows] = triangle
    return matrix


def _in_arrays(patches: Sequence[Patch]) -> tuple[NDArray[np.uint8], Array, Array]:
    """Windows, `uv_ref` and `inside` of views of one size, each in one array."""
    if not patches:
        return np.empty((0, 1, 1), np.uint8), np.empty((0, 2)), np.empty((0, 4))
    return (
        np.stack([patch.pixels for patch in patches]),
        np.stack([patch.uv_ref for patch in patches]),
        np.stack([patch.inside for patch in patches]),
    )


def check_submap(value: Any, where: str) -> None:
    """A `Submap` of a file whose parts fit together."""
    sizes = instance(
        Submap,
        ids=array("<i8", None),
        codes=array("|u1", None, 128),
        transferred=covariance(None),
    )
    sizes(value, where)
    n = len(value.ids)
    instance(
        Submap,
        t=number(-LAST_TIME, LAST_TIME),
        pose=pose,
        pose_covariance=covariance(6),
        points=array("<f8", n, 3),
        triangle=array("<f4", 3 * n * (3 * n + 1) // 2),
        with_transferred=array("<f4", 3 * n, len(value.transferred)),
        windows=array("|u1", n, None, None),
        uv_ref=array("<f8", n, 2),
        inside=array("<f8", n, 4),
        used=array("|b1", n),
    )(value, where)
    covariance(3 * n)(value.covariance, f"{where}.covariance")
    items(PATCH, n)(value.patches, f"{where}.patches")
    if len(value.codes) and not value.described:
        refuse(where, "a submap with a descriptor of each landmark")
