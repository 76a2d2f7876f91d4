"""A submap is kept in few bytes, and read as the filter told it, to the bit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam.errors import DataError
from collabslam.frontend.patch import Patch, capture
from collabslam.slam.engine import Slam
from collabslam.slam.submaps.submap import Submap, check_submap, lower_triangle, mirrored


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
    np.testing.assert_array_equal(submap.covariance, made.covariance)
    np.testing.assert_array_equal(submap.points, made.points)
    for kept, patch in zip(submap.patches, patches, strict=True):
        for name in ("pixels", "uv_ref", "t_wc", "inside"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(patch, name))


def test_it_is_small_and_keeps_nothing_else_alive(submap: Submap) -> None:
    n = len(submap.ids)
    of_landmarks = 8 * (3 * n * (3 * n + 1) // 2) + n * (43 * 43 + 8 * (1 + 3 + 3 * 7 + 2 + 4) + 1)
    assert sum(value.nbytes for value in arrays(submap).values()) < of_landmarks + 1000
    assert submap.windows.base is submap.triangle.base is None
    nothing = replace(submap, descriptors=np.ones((n, 128), np.float32)).without_landmarks()
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
    matrix = root + root.T
    np.testing.assert_array_equal(mirrored(lower_triangle(matrix)), matrix)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: {"triangle": s.triangle[:-1]},
        lambda s: {"triangle": s.triangle.astype(np.float32)},
        lambda s: {"triangle": np.where(s.triangle == s.triangle[0], -1.0, s.triangle)},
        lambda s: {"triangle": s.triangle * np.nan},
        lambda s: {"windows": s.windows[:-1]},
        lambda s: {"windows": s.windows[:, :-1, :-1]},
        lambda s: {"windows": s.windows[:, :-1]},
        lambda s: {"uv_ref": s.uv_ref + 1e9},
        lambda s: {"inside": -s.inside - 1.0},
        lambda s: {"used": s.used[1:]},
        lambda s: {"descriptors": np.zeros((2, 128), np.float32)},
    ],
)
def test_one_of_a_file_that_cannot_be_is_refused(submap: Submap, change: Any) -> None:
    check_submap(submap, "submap")
    with pytest.raises(DataError, match="submap"):
        check_submap(replace(submap, **change(submap)), "submap")
