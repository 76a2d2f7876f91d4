"""What the images say of a measured T_CF that is right, and of one that is not, nor the cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.clip import Clip, stretched_later
from helpers.posted import Posted

from collabslam import Camera, Slam, Tag
from collabslam.frontend.worn_verdict import (
    LEAST_AGREEING,
    Verdict,
    ask_images,
    contradicted,
    contradicted_lately,
)
from collabslam.geometry import pose, rotation_exp, se3_exp
from collabslam.types import Array, Frame, Image, Status, WornView

CAMERA = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
SDS = np.array([0.03, 0.03, 0.03, 0.009, 0.017, 0.009])
COVARIANCE = np.diag(SDS**2)
T_CF = se3_exp([-0.7, -0.2, 0.8, 0.05, -0.15, 0.02])


def matches(rng: np.random.Generator, t_cf: Array = T_CF, count: int = 25) -> tuple[Array, Array]:
    """Pixels of points of a room in Cs and in Cf, with half a pixel of noise."""
    points = rng.uniform((-2.0, -1.5, 3.0), (2.0, 1.5, 9.0), (count, 3))
    in_f = (points - t_cf[:3, 3]) @ t_cf[:3, :3]
    pixels = [CAMERA.project(p).uv + rng.normal(0.0, 0.5, (count, 2)) for p in (points, in_f)]
    return pixels[0], pixels[1]


def ask(
    uv: tuple[Array, Array], t_cf: Array, covariance: Array = COVARIANCE, camera: Camera = CAMERA
) -> Verdict | None:
    return ask_images(camera.unproject(uv[0]), CAMERA.unproject(uv[1]), t_cf, covariance, (500.0, 500.0))


def against(uv: tuple[Array, Array], t_cf: Array = T_CF, **options: object) -> float:
    verdict = ask(uv, t_cf, **options)  # type: ignore[arg-type]
    assert verdict is not None
    return verdict.against


def test_errors_within_the_covariance_are_not_held_against_t_cf() -> None:
    rng = np.random.default_rng(1)
    found = [against(matches(rng), T_CF @ se3_exp(SDS * rng.normal(size=6))) for _ in range(60)]
    assert max(found) < 1.0
    assert np.median(found) < 0.5


@pytest.mark.parametrize(
    "error",
    [[0.3, 0, 0, 0, 0, 0], [0, 0.3, 0, 0, 0, 0], [0, 0, 0, 0.06, 0, 0], [0, 0, 0, 0, 0.12, 0]],
    ids=["right", "down", "pitch", "yaw"],
)
def test_errors_far_beyond_it_are(error: list[float]) -> None:
    rng = np.random.default_rng(2)
    wrong = T_CF @ se3_exp(error)
    found = [ask(matches(rng), wrong) for _ in range(10)]
    assert all(v is not None and v.against > 1.0 for v in found)
    assert found[0] is not None
    across = found[0].correction + error
    across[:3] -= across[:3] @ T_CF[:3, 3] / (T_CF[:3, 3] @ T_CF[:3, 3]) * T_CF[:3, 3]
    assert np.abs(across[3:]).max() < 0.05


def test_the_length_of_t_cf_is_nothing_that_matches_tell() -> None:
    long = pose(T_CF[:3, :3], 3.28 * T_CF[:3, 3])
    rng = np.random.default_rng(3)
    assert max(against(matches(rng), long) for _ in range(10)) < 1.0


def test_a_focal_length_that_is_wrong_shows_and_in_both_cameras_hides() -> None:
    rng = np.random.default_rng(4)
    long = Camera("pinhole", 640, 480, (600.0, 600.0, 319.5, 239.5))
    one = [against(matches(rng, count=60), camera=long) for _ in range(10)]
    assert np.median(one) > 1.0


def test_matches_that_agree_on_nothing_say_nothing() -> None:
    rng = np.random.default_rng(5)
    uv = matches(rng, count=12)
    assert ask((uv[0], uv[1][::-1]), T_CF) is None
    few = LEAST_AGREEING - 1
    assert ask((uv[0][:few], uv[1][:few]), T_CF) is None
    assert ask((uv[0][:0], uv[1][:0]), T_CF) is None


def test_most_of_three_views_must_contradict() -> None:
    unsaid = float("nan")
    assert contradicted([2.0, 2.0, 0.1])
    assert not contradicted([2.0, 0.1, 0.1])
    assert not contradicted([2.0, 2.0, 0.1, 0.1])
    assert contradicted([0.9, 0.9, 0.9])
    assert not contradicted([0.7, 0.7, 0.7])
    assert not contradicted([2.0, unsaid, 2.0])
    assert not contradicted([])


def test_what_was_right_before_does_not_excuse_what_is_wrong_now() -> None:
    before = [0.1] * 26
    assert contradicted_lately([*before, 2.0, 2.0, float("nan"), 0.1, 2.0, 2.0])
    assert not contradicted([*before, 2.0, 2.0, float("nan"), 0.1, 2.0, 2.0])
    assert not contradicted_lately([*before, 2.0, 2.0, 2.0]), "some views may be wrong"
    assert not contradicted_lately([*before, *[0.9] * 7]), "each by itself"
    assert not contradicted_lately([2.0] * 6), "too few to speak of"


def sideways(worn: WornView) -> WornView:
    sure = np.diag([1e-4] * 3 + [np.deg2rad(0.5) ** 2] * 3)
    t_cf = worn.t_cf.copy()
    t_cf[0, 3] += 0.3
    return replace(worn, t_cf=t_cf, covariance=sure)


def _as_it_is(image: Image) -> Image:
    return image


def _mirrored(image: Image) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


@pytest.mark.parametrize(
    ("show", "measure", "good"),
    [
        (_as_it_is, lambda worn: worn, True),
        (_as_it_is, sideways, False),
        (_mirrored, lambda worn: worn, False),
    ],
    ids=["right", "30 cm off", "mirrored"],
)
def test_an_engine_is_not_sure_of_what_its_images_contradict(
    clip: Clip, show: Callable[[Image], Image], measure: Callable[[WornView], WornView], good: bool
) -> None:
    def shown(frame: Frame) -> Frame:
        return replace(frame, image=show(frame.image), views=tuple(map(measure, frame.views)))

    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    frames = [shown(f) for f in clip.frames]
    said = [slam.step(f.t, f.image, f.views) for f in frames]
    sure = [s.status is Status.OK for s in said]
    assert all(sure) if good else not any(sure)


def test_a_map_that_cf_finds_of_another_size_is_left_and_the_new_one_stays_degraded(clip: Clip) -> None:
    """No image tells how long T_CF is; a map that was right before does not follow it without a word."""
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    said = [slam.step(f.t, f.image, stretched_later(f.views, k)) for k, f in enumerate(clip.frames)]
    begun = [k for k, s in enumerate(said) if s.diagnostics["restarted"]]
    assert len(begun) == 1
    assert {s.status for s in said[begun[0] :]} == {Status.DEGRADED}
    assert {s.diagnostics["degraded_by"] for s in said[begun[0] :]} == {"size"}


def test_a_map_that_holds_a_printed_target_is_not_left_for_cfs(clip: Clip) -> None:
    """Cf contradicts the map's size: that is said, and the paper, which tells metres too, is believed."""
    tag, at = Tag("36h11", 3, 0.24), pose(rotation_exp([0.1, 0.6, 0.05]), [0.15, 0.0, 2.3])
    posted = Posted(clip.recording, [(tag, clip.recording.truth[0] @ at)], alone=True)
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    slam.announce(tag)
    said = [
        slam.step(f.t, posted.frame(k).image, stretched_later(f.views, k)) for k, f in enumerate(clip.frames)
    ]
    assert said[-1].diagnostics["degraded_by"] == "size"
    assert not any(s.diagnostics["restarted"] for s in said)


def test_images_that_come_again_are_a_jump(clip: Clip) -> None:
    slam, said = Slam(clip.recording.camera, clip.recording.worn_camera), []
    for k in range(16):  # the first eight frames, twice
        frame = clip.frames[k % 8]
        said.append(slam.step(0.1 * k, frame.image, frame.views))
    assert {s.status for s in said[:8]} == {Status.OK}
    assert {s.diagnostics["degraded_by"] for s in said[8:]} == {"jump"}
    assert {s.status for s in said[8:]} == {Status.DEGRADED}
