"""Points followed from one image into the next, for the camera's turn (METHOD 27)."""

import cv2
import numpy as np
import pytest

from collabslam._core import Camera, Filter
from collabslam.errors import InputError
from collabslam.frontend.flow import FlowImage
from collabslam.frontend.followed import followed_points
from collabslam.settings.frontend import FlowSettings
from collabslam.simulation import corridor_recording

CAMERA = Camera("radtan", 720, 480, (780.0, 780.0, 360.0, 240.0), (0.0, 0.0, 0.0, 0.0))
TURN = np.array([0.0, 0.08, 0.01])  # 4.6 degrees to the right


@pytest.fixture(scope="module")
def images():
    """One of the corridor, and the same as the camera sees it after the turn."""
    first = corridor_recording(length_m=0.3).image(0)
    k = np.array([[780.0, 0.0, 360.0], [0.0, 780.0, 240.0], [0.0, 0.0, 1.0]])
    rotation, _ = cv2.Rodrigues(TURN)
    turned = k @ rotation.T @ np.linalg.inv(k)
    return first, cv2.warpPerspective(first, turned, (720, 480)), turned


def _followed(images, turn, hidden=None):
    pair = FlowImage(images[0]), FlowImage(images[1])
    return followed_points(pair, CAMERA, turn, FlowSettings(), hidden)


@pytest.mark.slow
@pytest.mark.parametrize("expected", [TURN, np.zeros(3)])
def test_points_are_where_the_turn_takes_them(images, expected):
    before, now = _followed(images, expected)
    assert len(before) == len(now) >= 40
    moved = np.column_stack([before, np.ones(len(before))]) @ images[2].T
    off = np.linalg.norm(moved[:, :2] / moved[:, 2:] - now, axis=1)
    assert np.median(off) < 0.5
    assert np.quantile(off, 0.9) < 1.5


def test_hidden_pixels_are_left_out(images):
    before, now = _followed(images, TURN, lambda uv: uv[:, 0] < 300.0)
    assert len(before) >= 10
    assert before[:, 0].min() >= 300.0
    assert now[:, 0].min() >= 300.0


def test_points_are_all_over_the_image_though_its_strongest_corners_are_on_who_passes():
    faint = cv2.GaussianBlur(np.random.default_rng(4).normal(90.0, 40.0, (480, 720)), (0, 0), 4.0)
    squares = 255 * (np.indices((480, 160)) // 20).sum(axis=0) % 510
    first = np.clip(faint, 0, 255).astype(np.uint8)
    second = np.roll(first, 6, axis=1)
    first[:, 260:420], second[:, 290:450] = squares, squares
    before, now = _followed((first, second), np.zeros(3))
    still = np.abs(now - before - [6.0, 0.0]).max(axis=1) < 1.0
    assert (still & (before[:, 0] < 240)).sum() >= 15
    assert (still & (before[:, 0] > 470)).sum() >= 15


def test_an_image_without_corners_gives_none():
    grey = np.full((480, 720), 90, np.uint8)
    before, now = _followed((grey, grey), np.zeros(3))
    assert before.shape == now.shape == (0, 2)


def test_the_filter_refuses_what_is_no_list_of_pairs():
    core = Filter(CAMERA)
    points = np.zeros((20, 2))
    assert core.predict_again(0.0, points, points) is False  # it has not started
    with pytest.raises(InputError, match="20 were and 19 are"):
        core.predict_again(0.0, points, points[1:])
    with pytest.raises(InputError, match="points followed"):
        core.predict_again(0.0, points, np.full((20, 2), np.nan))
    nothing = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 2))
    for before, now in [(points, points[1:]), (points, np.full((20, 2), np.nan)), (points.T, points.T)]:
        with pytest.raises(InputError, match="points"):
            core.update(*nothing, followed=(0.0, before, now))
