"""A mask says what is never scene: nothing is searched, born or matched there, in either camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import InputError
from collabslam.frontend.mask import StaticMask
from collabslam.frontend.patch import SIZE
from collabslam.results import StepResult
from collabslam.slam.engine import Slam
from collabslam.types import Array

WIDTH, HEIGHT = 720, 480


def _half(value: Any = 255) -> Any:
    """Nothing in the left 40 % of the image."""
    mask = np.full((HEIGHT, WIDTH), value)
    mask[:, : WIDTH * 2 // 5] = 0
    return mask.astype(bool if value is True else np.uint8)


def _run(clip: Clip, frames: int = 15, **masks: Any) -> list[StepResult]:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, **masks)
    return [slam.step(f.t, f.image, f.views) for f in clip.frames[:frames]]


def _seen(steps: list[StepResult], at: slice) -> Array:
    """Pixels of Cs (the first two) and of Cf (the others) of all matches."""
    return np.concatenate([s.features.pairs[:, at] for s in steps])


@pytest.fixture(scope="module")
def plain(clip: Clip) -> list[StepResult]:
    return _run(clip)


@pytest.mark.parametrize("value", [255, 1, True])
def test_what_is_masked_in_cs_is_left_alone(clip: Clip, plain: list[StepResult], value: Any) -> None:
    mask = _half(value)
    hides = StaticMask(mask != 0).hides
    for step in (steps := _run(clip, mask=mask)):
        found = step.features.found
        assert not hides(found[np.isfinite(found).all(axis=1)]).any()
        assert not hides(step.features.pairs[:, :2]).any()
    before = [s.features.found for s in plain]
    assert sum(int(hides(f[np.isfinite(f).all(axis=1)]).sum()) for f in before) > 50
    assert all(s.status.value == "OK" for s in steps)
    assert steps[-1].diagnostics["accepted"] > 15


def test_no_match_is_in_what_is_masked_in_cf(clip: Clip, plain: list[StepResult]) -> None:
    mask = _half()
    steps, hides = _run(clip, worn_mask=mask), StaticMask(mask != 0).hides
    assert hides(_seen(plain, slice(2, 4))).sum() > 20
    assert not hides(_seen(steps, slice(2, 4))).any()
    assert len(_seen(steps, slice(2, 4))) > 20


def test_a_mask_that_hides_nothing_changes_nothing(clip: Clip, plain: list[StepResult]) -> None:
    white = np.ones((HEIGHT, WIDTH), np.bool_)
    for a, b in zip(_run(clip, 6, mask=white, worn_mask={"": white}), plain, strict=False):
        np.testing.assert_array_equal(a.pose, b.pose)
        np.testing.assert_array_equal(a.covariance, b.covariance)


def test_what_is_saved_keeps_its_masks(clip: Clip, tmp_path: Path) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, mask=_half(), worn_mask=_half(True))
    for frame in clip.frames[:3]:
        slam.step(frame.t, frame.image, frame.views)
    slam.save(tmp_path / "engine")
    again = Slam.load(tmp_path / "engine")
    for frame in clip.frames[3:8]:
        a, b = (one.step(frame.t, frame.image, frame.views) for one in (slam, again))
        np.testing.assert_array_equal(a.pose, b.pose)
        np.testing.assert_array_equal(a.features.found, b.features.found)


def test_a_patch_that_would_show_the_mask_is_hidden_too() -> None:
    mask = _half() != 0
    edge = WIDTH * 2 // 5  # the first column that may be scene
    uv = np.array([[edge - 1.0, 9.0], [edge + SIZE // 2 - 1.0, 9.0], [edge + SIZE // 2 + 1.0, 9.0]])
    np.testing.assert_array_equal(StaticMask(mask).hides(uv), [True, True, False])
    outside = np.array([[-3.0, 9.0], [np.nan, 9.0], [9.0, HEIGHT + 1.0], [np.inf, np.inf]])
    assert not StaticMask(mask).hides(outside).any()


@pytest.mark.parametrize(
    ("mask", "said"),
    [
        (_half()[:, :-1], "719 x 480 pixels, its camera's images are 720 x 480"),
        (np.linspace(0, 255, WIDTH * HEIGHT).astype(np.uint8).reshape(HEIGHT, WIDTH), "255 values beside 0"),
        (np.zeros((HEIGHT, WIDTH), np.uint8), "leaves 0 % of the image"),
        (_half().astype(np.float64), r"\(480, 720\) float64; give a \(H, W\) array"),
        (np.stack([_half()] * 3, axis=2), r"\(480, 720, 3\) uint8; give a \(H, W\) array"),
        ("hood.png", "is str; give a"),
    ],
)
def test_what_is_no_mask_is_refused(clip: Clip, mask: Any, said: str) -> None:
    for given in ({"mask": mask}, {"worn_mask": mask}):
        with pytest.raises(InputError, match=said):
            Slam(clip.recording.camera, clip.recording.worn_camera, **given)


def test_a_mask_of_nobodys_camera_is_refused(clip: Clip) -> None:
    with pytest.raises(InputError, match="mask of the worn camera 'ben'; there is ''"):
        Slam(clip.recording.camera, clip.recording.worn_camera, worn_mask={"ben": _half()})
    with pytest.raises(InputError, match="there is no worn camera"):
        Slam(clip.recording.camera, mode="mono", start="scale-free", worn_mask=_half())
