"""A submap is kept in few bytes, and read as the filter told it: its covariance never smaller."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam.errors import DataError
from collabslam.frontend.patch import Patch, capture
from collabslam.slam.engine import Slam
from collabslam.slam.submaps.submap import (
    Submap,
    check_submap,
    from_bytes,
    in_bytes,
    lower_triangle,
    mirrored,
    rounded,
)


@pytest.fixture(scope="module")
def told(clip: Clip) -> tuple[Any, list[Patch]]:
    """What the filter tells of a submap, and views of its landmarks."""
    slam, source = Slam(clip.recording.camera, clip.recording.worn_camera), clip.recording
    for frame in clip.frames[:3]:
        slam.step(frame.t, frame.image, frame.views)
    made = slam.filter.end_submap(slam.filter.features[:40])
    uv = source.camera.project(made.points).uv
    return made, capture(clip.frames[2].image, uv, np.eye(4))


@pytest.fixture
def submap(told: tuple[Any, list[Patch]]) -> Submap:
    return Submap.taken_down(1.5, *told)


def arrays(submap: Submap) -> dict[str, np.ndarray]:
    return {name: value for name, value in vars(submap).items() if isinstance(value, np.ndarray)}


def test_it_is_read_as_it_was_told(told: tuple[Any, list[Patch]], submap: Submap) -> None:
    made, patches = told
    assert len(submap.ids) > 25
    np.testing.assert_array_equal(made.covariance, made.covariance.T)
    np.testing.assert_allclose(submap.covariance, made.covariance, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(submap.with_transferred, made.with_transferred, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(submap.transferred, made.transferred, rtol=1e-5)
    np.testing.assert_array_equal(submap.points, made.points)
    for kept, patch in zip(submap.patches, patches, strict=True):
        for name in ("pixels", "uv_ref", "t_wc", "inside"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(patch, name))


def test_it_is_small_and_keeps_nothing_else_alive(submap: Submap) -> None:
    n, k = len(submap.ids), len(submap.transferred)
    of_covariance = 4 * (3 * n * (3 * n + 1) // 2 + 3 * n * k)
    of_landmarks = of_covariance + n * (43 * 43 + 128 + 8 * (1 + 3 + 2 + 4) + 1)
    assert sum(value.nbytes for value in arrays(submap).values()) < of_landmarks + 1000
    assert submap.windows.base is submap.triangle.base is None
    nothing = replace(submap, codes=np.ones((n, 128), np.uint8)).without_landmarks()
    of_others = {name for name, value in arrays(nothing).items() if value.base is not None}
    assert of_others <= {"pose", "pose_covariance", "transferred"}  # as the filter told them
    assert (nothing.covariance.shape, nothing.patches, nothing.described) == ((0, 0), [], True)
    np.testing.assert_array_equal(nothing.pose, submap.pose)


def test_some_of_its_landmarks(submap: Submap) -> None:
    which = np.array([7, 2, 11])
    rows = (3 * which[:, None] + np.arange(3)).ravel()
    patches = [submap.patches[k] for k in which]
    some = submap.of_landmarks(which, patches, np.zeros((3, 128), np.float32))
    np.testing.assert_array_equal(some.covariance, submap.covariance[np.ix_(rows, rows)])
    np.testing.assert_array_equal(some.windows, submap.windows[which])
    np.testing.assert_array_equal(some.ids, submap.ids[which])
    check_submap(some, "submap")


@pytest.mark.parametrize("n", [0, 1, 2, 120])
def test_a_triangle_is_the_whole_of_a_symmetric_matrix(n: int) -> None:
    root = np.random.default_rng(n).standard_normal((n, n))
    matrix = (root + root.T).astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(mirrored(lower_triangle(matrix)), matrix)


@pytest.mark.parametrize("known", [1e-1, 1e-3, 1e-5])
def test_a_covariance_in_single_precision_is_never_smaller(known: float) -> None:
    """Also of points of which one combination is known ``known`` times as well as each of them."""
    rng = np.random.default_rng(3)
    axes = np.linalg.qr(rng.standard_normal((120, 120)))[0]
    sd = np.geomspace(1.0, known, 120)
    told = (axes * sd**2) @ axes.T
    told = 0.5 * (told + told.T)
    for n in (120, 107, 0):
        triangle, with_others, others = rounded(told[:n, :n], told[:n, n:], told[n:, n:])
        kept = np.block([[mirrored(triangle), with_others], [with_others.T, others]])
        assert np.linalg.eigvalsh(kept - told).min() > 0.0
        np.testing.assert_allclose(np.diag(kept), np.diag(told), rtol=2e-5)


def test_descriptors_in_bytes() -> None:
    rng = np.random.default_rng(5)
    told = np.sqrt(rng.dirichlet(np.full(128, 0.3), 50)).astype(np.float32)
    told[7] = 0.0
    kept = from_bytes(in_bytes(told))
    assert np.linalg.norm(kept - told, axis=1).max() < 0.03  # of 0.8 at which two are alike
    np.testing.assert_allclose(np.linalg.norm(np.delete(kept, 7, axis=0), axis=1), 1.0, rtol=1e-6)
    np.testing.assert_array_equal(in_bytes(kept), in_bytes(from_bytes(in_bytes(kept))))
    assert not kept[7].any()


@pytest.mark.parametrize(
    "change",
    [
        lambda s: {"triangle": s.triangle[:-1]},
        lambda s: {"triangle": s.triangle.astype(np.float64)},
        lambda s: {"triangle": np.where(s.triangle == s.triangle[0], -1.0, s.triangle)},
        lambda s: {"triangle": s.triangle * np.nan},
        lambda s: {"windows": s.windows[:-1]},
        lambda s: {"windows": s.windows[:, :-1, :-1]},
        lambda s: {"windows": s.windows[:, :-1]},
        lambda s: {"uv_ref": s.uv_ref + 1e9},
        lambda s: {"inside": -s.inside - 1.0},
        lambda s: {"used": s.used[1:]},
        lambda s: {"codes": np.zeros((2, 128), np.uint8)},
    ],
)
def test_one_of_a_file_that_cannot_be_is_refused(submap: Submap, change: Any) -> None:
    check_submap(submap, "submap")
    with pytest.raises(DataError, match="submap"):
        check_submap(replace(submap, **change(submap)), "submap")
