"""Matches of a wall that repeats: the wrong brick looks like the right one, and only landmarks know."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from collabslam._core import Camera
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.plausible import VisibleLandmarks, far_from, surface_around, unlike
from collabslam.frontend.viewed_points import ViewedPoints, inside
from collabslam.frontend.worn_match import match_worn
from collabslam.geometry import se3_exp
from collabslam.settings.table import Settings
from collabslam.types import Array, Image, WornView

SETTINGS = Settings.default()
CAMERA = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5), [])
DISTANCE, PITCH, BASELINE = 3.0, 90, 1.2
COVARIANCE = np.diag([0.03] * 3 + [np.radians(0.5), np.radians(1.0), np.radians(0.5)]) ** 2


def _wall(seed: int) -> tuple[Image, Image, float]:
    """Both views of a wall whose picture repeats, Cf beside Cs; and by how many pixels it is moved in Cf."""
    random = np.random.default_rng(seed)
    brick = sum(
        s * cv2.GaussianBlur(random.standard_normal((480, PITCH)), (0, 0), s, borderType=cv2.BORDER_REFLECT)
        for s in (1.5, 3.0, 6.0)
    )
    wall = np.tile((brick - brick.min()) / (brick.max() - brick.min()), (1, 14))
    wall = 20.0 + 210.0 * wall + 2.0 * random.standard_normal(wall.shape)
    moved = 500.0 * BASELINE / DISTANCE
    views = [wall[:, 300:940], wall[:, 300 + round(moved) : 940 + round(moved)]]
    of_s, of_f = (np.clip(v + random.standard_normal(v.shape), 0, 255).astype(np.uint8) for v in views)
    return np.ascontiguousarray(of_s), np.ascontiguousarray(of_f), moved


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_brick_out_of_the_picture_is_not_found_in_another_one(seed: int) -> None:
    image_s, image_f, moved = _wall(seed)
    uv = detect_corners(image_s, np.empty((0, 2)), 150, SETTINGS.frontend.detect, 12)
    rho = 1.0 / (DISTANCE * np.linalg.norm(CAMERA.unproject(uv), axis=1) / CAMERA.unproject(uv)[:, 2])
    known = np.arange(len(uv)) % 3 == 0
    t_cf = se3_exp([BASELINE, 0.0, 0.0, 0.0, 0.0, 0.0])
    t_cf = t_cf @ se3_exp(np.random.default_rng(seed).multivariate_normal(np.zeros(6), COVARIANCE))
    worn = WornView(image_f, t_cf, COVARIANCE)
    points = ViewedPoints(uv, np.where(known, rho, np.nan), np.where(known, 0.05 * rho, np.nan))
    found = match_worn(image_s, worn, points, (CAMERA, CAMERA), SETTINGS)
    true = uv[found.index] - [moved, 0.0]
    off = np.linalg.norm(found.uv_f - true, axis=1)
    assert (off < 1.5).sum() >= 30
    assert (true[:, 0] < 0.0).sum() == 0


def _seen(uv: Array, rho: float, sd: float) -> VisibleLandmarks:
    return VisibleLandmarks(uv, np.full(len(uv), rho), np.full(len(uv), sd))


def test_a_new_point_is_compared_with_the_surface_around_it() -> None:
    around = np.array([[300.0, 200.0], [340.0, 200.0], [320.0, 230.0], [20.0, 20.0]])
    here = np.array([[320.0, 210.0]])
    wall = surface_around(here, _seen(around, 0.33, 0.03), 640)
    assert wall.rho[0] == pytest.approx(0.33)
    for rho, sd, told in ((0.33, 0.02, False), (0.15, 0.02, True), (0.6, 0.02, True), (0.15, 0.08, False)):
        assert bool(unlike(_seen(here, rho, sd), wall)[0]) is told


def test_where_landmarks_are_far_off_more_of_them_have_to_agree() -> None:
    here = np.array([[320.0, 210.0]])
    angles = np.radians(np.arange(0.0, 360.0, 40.0))
    ring = here + 200.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    wall = surface_around(here, _seen(ring, 0.33, 0.02), 640)
    assert wall.rho[0] == pytest.approx(0.33)
    for rho, told in ((0.33, False), (0.1, True)):
        assert bool(unlike(_seen(here, rho, 0.02), wall)[0]) is told
    corner = VisibleLandmarks(ring, np.array([0.33] * 8 + [0.5]), np.full(9, 0.02))
    for landmarks in (_seen(ring[:8], 0.33, 0.02), _seen(here + 1.7 * (ring - here), 0.33, 0.02), corner):
        assert np.isnan(surface_around(here, landmarks, 640).rho[0])


def test_landmarks_that_are_far_off_or_of_no_one_surface_or_few_say_nothing() -> None:
    here = np.array([[320.0, 210.0]])
    around = np.array([[300.0, 200.0], [340.0, 200.0], [320.0, 230.0]])
    edge = VisibleLandmarks(around, np.array([0.33, 0.2, 0.33]), np.full(3, 0.005))
    for landmarks in (_seen(around + 300.0, 0.33, 0.005), _seen(around[:2], 0.33, 0.005), edge):
        silent = surface_around(here, landmarks, 640)
        assert np.isnan(silent.rho[0])
        assert not unlike(_seen(here, 0.1, 0.01), silent)[0]
    assert len(surface_around(np.empty((0, 2)), _seen(around, 0.33, 0.0), 640).rho) == 0


def test_what_is_inside_of_a_region_keeps_off_its_edge() -> None:
    uv = np.array([[635.0, 240.0], [631.0, 240.0], [320.0, 5.0], [8.0, 471.0], [np.nan, 240.0]])
    assert inside(uv, (8, 8, 631, 471)).tolist() == [False, True, False, True, False]


def test_far_is_said_in_standard_deviations_along_each_direction() -> None:
    expected, spread = np.array([[100.0, 50.0]] * 3), np.tile(np.diag([100.0, 4.0]), (3, 1, 1))
    found = expected + np.array([[19.0, 0.0], [21.0, 0.0], [0.0, 5.0]])
    assert far_from(found, expected, spread).tolist() == [False, True, True]
