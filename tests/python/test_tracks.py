"""What the search of a frame does with features of which little is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import make_view

from collabslam._core import Camera
from collabslam.frontend.search import AMBIGUOUS, FOUND
from collabslam.settings.table import Settings
from collabslam.slam.map_change import ImagePoints, MapChange, Recovered
from collabslam.slam.tracks import Tracks
from collabslam.types import Array, Ids, Image

TRUE = np.array([[60.0, 60.0], [150.0, 60.0], [60.0, 150.0], [105.0, 105.0]])


def _wallpaper() -> Image:
    """A texture that repeats every 30 pixels."""
    tile = np.random.default_rng(0).integers(0, 255, (30, 30)).astype(np.uint8)
    return np.tile(tile, (8, 8))


def _expected(spread: Array) -> Any:
    count = len(TRUE)
    return SimpleNamespace(
        ids=np.arange(count),
        uv=TRUE + 3.0,
        s=spread[:, None, None] ** 2 * np.eye(2),
        points=np.full((count, 3), np.nan),
        rho=np.ones(count),
        rho_sd=np.ones(count),
    )


@pytest.mark.parametrize(("told", "code"), [(True, FOUND), (False, AMBIGUOUS)])
def test_a_lost_feature_is_looked_for_where_the_others_expect_it(told: bool, code: int) -> None:
    image = _wallpaper()
    tracks = Tracks(
        Camera("pinhole", 240, 240, (200.0, 200.0, 120.0, 120.0), ()), Settings.default().frontend()
    )
    view = make_view(image)
    born = MapChange(instant=ImagePoints(np.arange(4), TRUE))
    nothing = np.empty(0, np.int64)
    tracks.adopt(view, np.eye(4), born, nothing)
    seen = ImagePoints(np.arange(3), TRUE[:3])  # the last one was not
    tracks.adopt(view, np.eye(4), MapChange(), nothing, Recovered(seen))
    expected = _expected(np.array([2.0, 2.0, 2.0, 20.0]))
    asked = []

    def given(ids: Ids, uv: Array, wanted: Ids) -> Any:
        asked.append((ids.tolist(), wanted.tolist()))
        np.testing.assert_allclose(uv, TRUE[ids], atol=0.1)
        if told:
            return SimpleNamespace(uv=TRUE[wanted] + 0.4, s=np.eye(2)[None])
        return SimpleNamespace(uv=TRUE[wanted], s=400.0 * np.eye(2)[None])

    found = tracks.search(view, np.eye(4), expected, given)
    assert asked == [([0, 1, 2], [3])]
    assert found.result.code.tolist() == [FOUND, FOUND, FOUND, code]
    if told:
        np.testing.assert_allclose(found.result.uv, TRUE, atol=0.1)
