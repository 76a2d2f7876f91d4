"""SURF, which the pipeline knows while descriptors are compared."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from collabslam.errors import DataError
from collabslam.frontend.describe import DESCRIPTORS, describe
from collabslam.frontend.detect import detect_corners
from collabslam.settings.table import Settings
from collabslam_lab.benchmark.surf import SURF, known_surf

NONE = np.empty((0, 2))


def texture(height: int, width: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    image = sum(
        s * cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), s) for s in (1.5, 3.0, 6.0, 12.0)
    )
    return cv2.normalize(image, None, 20, 230, cv2.NORM_MINMAX, cv2.CV_8U)


def test_it_finds_the_rotation_by_itself() -> None:
    pytest.importorskip("mahotas")
    image = texture(400, 500)
    turned = cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE)
    corners = Settings.default().frontend.detect
    uv = detect_corners(image[60:340, 60:440], NONE, 60, corners, 15) + 60.0
    place = np.c_[399.0 - uv[:, 1], uv[:, 0]]
    with known_surf():
        a, b = describe(image, uv, 0.0, 36.0, SURF), describe(turned, place, 0.0, 36.0, SURF)
        edge = describe(image, np.array([[2.0, 3.0], [497.0, 396.0]]), 0.0, 36.0, SURF)
        assert describe(image, NONE, 0.0, 36.0, SURF).shape == (0, 64)
    assert a.shape == (len(uv), 64)
    assert np.allclose(np.linalg.norm(a, axis=1), 1.0, atol=1e-3)
    # mahotas samples whole pixels: a quarter turn shifts them, and every third point is taken for another
    assert ((a @ b.T).argmax(axis=1) == np.arange(len(uv))).mean() > 0.5
    assert edge.shape == (2, 64)  # none is dropped at the border
    assert SURF not in DESCRIPTORS


def test_without_mahotas_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mahotas.features", None)
    with known_surf(), pytest.raises(DataError, match=r"research\[surf\]"):
        describe(texture(100, 100), np.array([[50.0, 50.0]]), 0.0, 36.0, SURF)
