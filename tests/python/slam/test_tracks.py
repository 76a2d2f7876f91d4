"""What the search of a frame does with features of which little is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.clip import make_view

from collabslam._core import Camera
from collabslam.frontend.search import AMBIGUOUS, FOUND
from collabslam.settings.table import Settings
from collabslam.slam.map_change import ImagePoints, MapChange, Recovered
from collabslam.slam.tracking.tracks import Tracks
from collabslam.slam.view import View
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


def _seen_before(view: View, seen: ImagePoints) -> Tracks:
    """Tracks of four features, some of which were seen in the last image, which is that of ``view``."""
    tracks = Tracks(
        Camera("pinhole", 240, 240, (200.0, 200.0, 120.0, 120.0), ()), Settings.default().frontend, 24
    )
    nothing = np.empty(0, np.int64)
    tracks.adopt(view, np.eye(4), MapChange(instant=ImagePoints(np.arange(4), TRUE)), nothing)
    tracks.adopt(view, np.eye(4), MapChange(), nothing, Recovered(seen))
    return tracks


@pytest.mark.parametrize(("told", "code"), [(True, FOUND), (False, AMBIGUOUS)])
def test_a_lost_feature_is_looked_for_where_the_others_expect_it(told: bool, code: int) -> None:
    image = _wallpaper()
    view = make_view(image)
    tracks = _seen_before(view, ImagePoints(np.arange(3), TRUE[:3]))  # the last one was not
    expected = _expected(np.array([2.0, 2.0, 2.0, 20.0]))
    asked = []

    def given(ids: Ids, uv: Array, wanted: Ids) -> Any:
        asked.append((ids.tolist(), wanted.tolist()))
        np.testing.assert_allclose(uv, TRUE[ids], atol=0.1)
        agree = np.ones(len(ids), np.bool_)
        if told:
            return SimpleNamespace(uv=TRUE[wanted] + 0.4, s=np.eye(2)[None], agree=agree)
        return SimpleNamespace(uv=TRUE[wanted], s=400.0 * np.eye(2)[None], agree=agree)

    found = tracks.search(view, np.eye(4), expected, given)
    assert asked == [([0, 1, 2], [3])]
    assert found.result.code.tolist() == [FOUND, FOUND, FOUND, code]
    if told:
        np.testing.assert_allclose(found.result.uv, TRUE, atol=0.1)


def test_what_flow_took_for_a_feature_is_searched_again_where_the_others_say() -> None:
    view = make_view(_wallpaper())
    slipped = TRUE.copy()
    slipped[3, 0] += 30.0  # one tile off: it looks the same there
    tracks = _seen_before(view, ImagePoints(np.arange(4), slipped))
    # The flow is told by the image of the last frame, which is this one.
    first = _expected(np.full(4, 2.0))
    tracks.search(view, np.eye(4), first, lambda *_: pytest.fail("no ellipse is wide"))
    tracks._last = dict(enumerate(slipped))
    asked = []

    def given(ids: Ids, uv: Array, wanted: Ids) -> Any:
        asked.append((ids.tolist(), wanted.tolist()))
        np.testing.assert_allclose(uv, slipped[ids], atol=0.1)
        s = np.broadcast_to(np.eye(2), (len(wanted), 2, 2))
        return SimpleNamespace(uv=TRUE[wanted] + 0.4, s=s, agree=ids < 3)

    found = tracks.search(view, np.eye(4), _expected(np.full(4, 20.0)), given)
    assert asked == [([0, 1, 2, 3], []), ([0, 1, 2], [3])]
    assert found.result.code.tolist() == [FOUND] * 4
    np.testing.assert_allclose(found.result.uv, TRUE, atol=0.1)
