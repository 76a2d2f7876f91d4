"""The pictures of the documentation are those that the commands beside them make."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import collabslam
from collabslam.demo import run_demo

DOCS = Path(collabslam.__file__).parents[2] / "docs"


@pytest.mark.slow
@pytest.mark.skipif(not DOCS.is_dir(), reason="needs the source tree")
def test_the_demos_picture_is_what_the_demo_draws(tmp_path: Path) -> None:
    """But for a line that has moved by a pixel: libraries round otherwise from machine to machine."""
    run_demo(tmp_path, seeds=[0], progress=False)
    kept, made = (cv2.imread(str(file)) for file in (DOCS / "demo.png", tmp_path / "comparison.png"))
    assert kept.shape == made.shape
    apart = np.abs(cv2.blur(kept, (5, 5)).astype(int) - cv2.blur(made, (5, 5))).max(axis=2)
    assert (apart > 40).mean() < 0.01
