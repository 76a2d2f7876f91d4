"""The pictures of the documentation are those that the commands beside them make."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Pictures
from PIL import ImageSequence

import collabslam
from collabslam.demo import run_demo

DOCS = Path(collabslam.__file__).parents[2] / "docs"


def apart(kept: np.ndarray, made: np.ndarray) -> float:
    """Share of two pictures that differs, but for a line that has moved by a pixel."""
    assert kept.shape == made.shape
    gap = np.abs(cv2.blur(kept, (5, 5)).astype(int) - cv2.blur(made, (5, 5))).max(axis=2)
    return float((gap > 40).mean())


def picture(path: Path) -> np.ndarray:
    """A picture, in RGB."""
    with Pictures.open(path) as one:
        return np.asarray(one.convert("RGB"))


def moving(path: Path) -> list[np.ndarray]:
    """The pictures of a GIF."""
    with Pictures.open(path) as gif:
        return [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(gif)]


@pytest.mark.slow
@pytest.mark.skipif(not DOCS.is_dir(), reason="needs the source tree")
def test_the_demos_pictures_are_what_the_demo_draws(tmp_path: Path) -> None:
    """By `collabslam demo --animation docs/demo.gif`; libraries round otherwise from machine to machine."""
    run_demo(tmp_path / "demo", seeds=[0], progress=False, animation=tmp_path / "demo.gif")
    assert apart(picture(DOCS / "demo.png"), picture(tmp_path / "demo" / "comparison.png")) < 0.01
    kept_frames, made_frames = moving(DOCS / "demo.gif"), moving(tmp_path / "demo.gif")
    assert len(kept_frames) == len(made_frames) > 30
    for one, other in zip(kept_frames, made_frames, strict=True):
        assert apart(one, other) < 0.02  # features are drawn, too
