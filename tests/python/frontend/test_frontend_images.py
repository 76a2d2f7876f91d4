"""Corners, patches, active search and optical flow on synthetic images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.clip import make_view

from collabslam._core import Camera, Filter, sample_templates
from collabslam.errors import InputError, SettingsError
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.flow import FlowImage, flow_guess, global_motion
from collabslam.frontend.patch import affine_maps, capture, warp_templates
from collabslam.frontend.search import AMBIGUOUS, FOUND, LOW_SCORE, OUTSIDE, active_search
from collabslam.geometry import se3_exp
from collabslam.settings.frontend import FRONTEND, SearchSettings
from collabslam.settings.table import Settings
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.tracking.tracks import Tracks

SETTINGS = Settings.default().frontend
NONE = np.empty((0, 2))
NO_FEATURES = Filter(Camera("pinhole", 540, 360, (500.0, 500.0, 270.0, 180.0))).predict_pixels()


def texture(height: int = 360, width: int = 540, seed: int = 0) -> np.ndarray:
    """Random texture with structure from 3 to 25 pixels."""
    rng = np.random.Generator(np.random.PCG64(seed))
    image = sum(
        s * cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), s) for s in (1.5, 3.0, 6.0, 12.0)
    )
    image = (image - image.min()) / (image.max() - image.min())
    return (20 + 210 * image).astype(np.uint8)


def moved(image: np.ndarray, linear: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The image under uv -> linear @ uv + shift."""
    size = (image.shape[1], image.shape[0])
    return cv2.warpAffine(
        image, np.c_[linear, shift], size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


def rotation(angle: float, scale: float = 1.0) -> np.ndarray:
    return scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def covariances(count: int, sigma: float) -> np.ndarray:
    return np.repeat(sigma**2 * np.eye(2)[None], count, axis=0)


def flow_image(image):
    return FlowImage(image)


def test_settings_schema_is_complete_and_checked():
    keys = [setting.key for setting in FRONTEND]
    assert len(set(keys)) == len(keys)
    assert all(setting.doc.endswith(".") for setting in FRONTEND)
    for setting in FRONTEND:  # every default is inside its own range
        assert setting.checked(setting.default) == setting.default
    assert Settings.default().replace({"frontend.search.min_score": 0.5}).frontend.search.min_score == 0.5


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("search.min_skore", 0.5, "search.min_score"),
        ("search.min_score", 2.0, "-1 to 1"),
        ("search.min_score", float("nan"), "-1 to 1"),
        ("search.min_score", "high", "a number"),
        ("worn.descriptor", "brief", "warped-sift"),
    ],
)
def test_settings_refuse_bad_values(key, value, word):
    with pytest.raises(SettingsError, match=word):
        Settings.default().replace({f"frontend.{key}": value})


def test_corners_spread_and_keep_their_distance():
    image = texture()
    image[:, 270:] = 0.25 * image[:, 270:] + 100  # weak contrast on the right
    corners = detect_corners(image, NONE, 60, SETTINGS.detect, 20)
    assert len(corners) == 60
    assert np.all((corners >= 17) & (corners <= [539 - 17, 359 - 17]))
    assert 20 <= (corners[:, 0] > 270).sum() <= 40
    gaps = np.linalg.norm(corners[:, None] - corners[None], axis=2) + 1e3 * np.eye(60)
    assert gaps.min() > 3.0
    more = detect_corners(image, corners, 40, SETTINGS.detect, 20)
    assert np.linalg.norm(more[:, None] - corners[None], axis=2).min() > 3.0


def test_emptiest_cells_come_first():
    image = texture()
    held = np.random.Generator(np.random.PCG64(1)).uniform([0, 0], [269, 359], (200, 2))
    corners = detect_corners(image, held, 30, SETTINGS.detect, 10)
    assert (corners[:, 0] > 265).mean() > 0.9


def test_flat_image_has_no_corners():
    rng = np.random.Generator(np.random.PCG64(0))
    assert len(detect_corners(np.full((240, 320), 128, np.uint8), NONE, 50, SETTINGS.detect, 10)) == 0
    noise = np.clip(128 + rng.normal(0, 1.0, (240, 320)), 0, 255).astype(np.uint8)
    assert len(detect_corners(noise, NONE, 50, SETTINGS.detect, 10)) == 0


def test_corners_are_sub_pixel():
    canvas = np.zeros((960, 1280), np.uint8)
    true = []
    for k, (u, v) in enumerate((u, v) for u in range(200, 1100, 180) for v in range(200, 800, 180)):
        du, dv = 8 * np.array([0.3 + 0.05 * k % 1, 0.6 - 0.04 * k % 1])
        u0, v0 = int(u + du), int(v + dv)
        canvas[v0 : v0 + 90, u0 : u0 + 90] = 220
        true.append(((u0 - 0.5 + 0.5) / 4 - 0.5, (v0 - 0.5 + 0.5) / 4 - 0.5))
    image = cv2.resize(canvas, (320, 240), interpolation=cv2.INTER_AREA)
    corners = detect_corners(image, NONE, 200, SETTINGS.detect, 10)
    error = [np.linalg.norm(corners - point, axis=1).min() for point in true]
    assert np.median(error) < 0.3


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_search_is_precise(noise):
    image = texture()
    uv = detect_corners(image, NONE, 60, SETTINGS.detect, 25)
    patches = capture(image, uv, np.eye(4))
    camera = Camera("pinhole", 540, 360, (500.0, 500.0, 270.0, 180.0), [])
    shift = np.array([1.37, -2.61])
    now = moved(image, np.eye(2), shift)
    now = np.clip(now + np.random.Generator(np.random.PCG64(1)).normal(0, noise, now.shape), 0, 255).astype(
        np.uint8
    )
    warped = warp_templates(camera, patches, np.eye(4), np.full((60, 3), np.nan))
    templates, ok, affine = warped.templates, warped.ok, warped.affine
    assert np.all(ok)
    assert np.allclose(affine, np.eye(2), atol=1e-9)
    result = active_search(now, templates, uv, covariances(60, 1.5), None, SETTINGS.search)
    found = result.code == FOUND
    assert found.mean() > 0.85
    error = (result.uv - uv - shift)[found]
    assert np.abs(error).max() < 0.6
    assert np.sqrt((error**2).mean()) < 0.1
    assert np.all(result.score[found] > 0.9)


@pytest.mark.parametrize("size", [7, 15, 21])
def test_search_agrees_with_opencv(size):
    rng = np.random.default_rng(size)
    image, other = texture(seed=11), texture(seed=12)
    settings = SearchSettings(min_score=-1.0)
    for k in range(20):
        u, v = rng.integers(60, 300, 2)
        template = (image if k % 2 else other)[v - size // 2 :, u - size // 2 :][:size, :size]
        centre = np.array([u, v]) + rng.uniform(-6, 6, 2)
        found = active_search(image, template[None], centre[None], covariances(1, 3.0), None, settings)
        values = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED)
        peaks = (values == cv2.dilate(values, np.ones((3, 3)))) & (values > 0)
        y, x = (i + size // 2 for i in np.nonzero(peaks))
        near = np.hypot(x - centre[0], y - centre[1]) <= np.hypot(9.0, 2.5)
        scores = values[y[near] - size // 2, x[near] - size // 2]
        assert found.score[0] == pytest.approx(scores.max() if len(scores) else -1.0, abs=1e-4)
        if len(scores):
            best = np.array([x[near], y[near]])[:, np.argmax(scores)]
            assert np.abs(found.uv[0] - best).max() <= 2.0  # a pixel by the surface, one by the alignment


def test_search_near_the_edge_and_in_small_images():
    rng = np.random.default_rng(0)
    for shape in ((15, 15), (16, 40), (17, 17), (40, 18), (5, 90)):
        image = rng.integers(0, 255, shape, dtype=np.uint8)
        uv = rng.uniform(-30, 120, (300, 2))
        guess = np.where(rng.random((300, 1)) < 0.5, np.nan, rng.uniform(-30, 120, (300, 2)))
        s = covariances(300, 1.0) * rng.uniform(0.1, 900, (300, 1, 1))
        result = active_search(
            image, rng.integers(0, 255, (300, 15, 15), dtype=np.uint8), uv, s, guess, SETTINGS.search
        )
        assert np.all(result.score <= 1.0 + 1e-6)
        assert np.all(np.isfinite(result.uv[result.code == FOUND]))


def test_templates_agree_with_opencv():
    image = texture(seed=13)
    uv = np.array([[100.3, 80.7], [250.0, 200.0], [2.0, 355.0]])
    affine = np.stack([rotation(0.4, 1.5), np.eye(2), np.array([[1.2, 0.3], [-0.1, 0.9]])])
    sampled = sample_templates(image, uv, affine, 15)
    templates, reach = sampled.templates, sampled.reach
    line = np.arange(15) - 7.0
    grid = np.stack([np.tile(line, 15), np.repeat(line, 15)])
    for k in range(3):
        at = (np.linalg.inv(affine[k]) @ grid + uv[k][:, None]).astype(np.float32)
        expected = cv2.remap(image, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        assert np.abs(templates[k].ravel() - expected.ravel().astype(float)).max() <= 3.0
        assert np.allclose(reach[k], np.abs(at - uv[k][:, None]).max(axis=1), atol=1e-4)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"image": np.zeros((40, 40))}, "uint8"),
        ({"image": np.zeros((0, 40), np.uint8)}, "image"),
        ({"templates": np.zeros((1, 14, 14), np.uint8)}, "odd"),
        ({"templates": np.zeros((1, 15, 13), np.uint8)}, "templates"),
        ({"templates": np.zeros((2, 15, 15), np.uint8)}, "rows"),
        ({"s": np.eye(2)}, "s"),
    ],
)
def test_search_names_bad_input(change, word):
    good = {
        "image": np.zeros((40, 40), np.uint8),
        "templates": np.zeros((1, 15, 15), np.uint8),
        "uv": np.full((1, 2), 20.0),
        "s": np.eye(2)[None],
    }
    arguments = {**good, **change}
    with pytest.raises(InputError, match=word):
        active_search(
            arguments["image"], arguments["templates"], arguments["uv"], arguments["s"], None, SETTINGS.search
        )


def test_search_codes():
    image = texture()
    uv = np.array([[200.0, 150.0], [200.0, 150.0], [20.0, 20.0], [-300.0, 100.0], [np.nan, 5.0]])
    flat = np.full((15, 15), 90, np.uint8)
    other = texture(seed=9)[100:115, 100:115]
    right = image[143:158, 193:208]
    templates = np.stack([right, other, flat, right, right])
    result = active_search(image, templates, uv, covariances(5, 2.0), None, SETTINGS.search)
    assert list(result.code) == [FOUND, LOW_SCORE, LOW_SCORE, OUTSIDE, OUTSIDE]
    assert np.allclose(result.uv[0], [200, 150], atol=0.05)


def test_repeated_texture_is_ambiguous():
    tile = texture(16, 16, seed=3)
    image = np.tile(tile, (20, 20))
    templates = image[153:168, 153:168][None]
    result = active_search(
        image, templates, np.array([[160.0, 160.0]]), covariances(1, 8.0), None, SETTINGS.search
    )
    assert result.code[0] == AMBIGUOUS
    near = active_search(
        image, templates, np.array([[160.0, 160.0]]), covariances(1, 1.0), None, SETTINGS.search
    )
    assert near.code[0] == FOUND


def test_search_stays_in_the_ellipse():
    image = texture()
    uv = np.array([[250.0, 180.0]])
    template = image[173:188, 243:258][None]
    thin = np.array([[[36.0, 0.0], [0.0, 0.1]]])
    inside = active_search(image, template, uv + np.array([14.0, 0.5]), thin, None, SETTINGS.search)
    assert inside.code[0] == FOUND
    outside = active_search(image, template, uv + np.array([0.5, 14.0]), thin, None, SETTINGS.search)
    assert outside.code[0] != FOUND


def test_wide_search_uses_the_guess_or_searches_all():
    image = texture()
    template = image[173:188, 243:258][None]
    s = covariances(1, 12.0)
    start, true = np.array([[225.0, 165.0]]), np.array([[250.0, 180.0]])
    for guess in (None, true + 2.0, np.full((1, 2), np.nan)):
        result = active_search(image, template, start, s, guess, SETTINGS.search)
        assert result.code[0] == FOUND
        assert np.allclose(result.uv, true, atol=0.05)
    unbelieved = active_search(image, template, start, s, true + 200.0, SETTINGS.search)
    assert unbelieved.code[0] == FOUND
    misled = active_search(image, template, start, s, start - 20.0, SETTINGS.search)
    assert misled.code[0] == LOW_SCORE


def test_warp_follows_rotation_and_scale():
    image = texture(480, 640)
    camera = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5), [])
    uv = np.array([[319.5, 239.5], [400.0, 300.0], [250.0, 200.0]])
    depth = 2.0
    points = depth * np.c_[(uv - [319.5, 239.5]) / 500.0, np.ones(3)]
    t_wc = se3_exp([0.0, 0.0, 0.5, 0.0, 0.0, 0.3])  # nearer, and rolled
    linear = rotation(-0.3, depth / (depth - 0.5))
    centre = np.array([319.5, 239.5])
    now = moved(image, linear, centre - linear @ centre)
    warped = warp_templates(camera, capture(image, uv, np.eye(4)), t_wc, points)
    templates, ok, affine = warped.templates, warped.ok, warped.affine
    assert np.all(ok)
    assert np.allclose(affine[0], linear, atol=0.01)
    place = (uv - centre) @ linear.T + centre
    result = active_search(now, templates, place + 1.0, covariances(3, 1.0), None, SETTINGS.search)
    assert np.all(result.code == FOUND)
    assert np.abs(result.uv - place).max() < 0.15
    unwarped = warp_templates(camera, capture(image, uv, np.eye(4)), np.eye(4), points).templates
    assert np.any(
        active_search(now, unwarped, place, covariances(3, 1.0), None, SETTINGS.search).code != FOUND
    )


def test_warp_averages_when_it_shrinks():
    checker = ((np.indices((101, 101)).sum(axis=0) % 2) * 200).astype(np.uint8)
    camera = Camera("pinhole", 101, 101, (100.0, 100.0, 50.0, 50.0), [])
    patch = capture(checker, np.array([[50.0, 50.0]]), np.eye(4))
    back = se3_exp([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    warped = warp_templates(camera, patch, back, np.array([[0.0, 0.0, 1.0]]))
    templates, ok = warped.templates, warped.ok
    assert ok[0]
    assert templates[0].std() < 40.0  # a sampled checkerboard keeps 100


def test_warp_is_refused():
    image = texture()
    camera = Camera("pinhole", 540, 360, (500.0, 500.0, 270.0, 180.0), [])
    uv = np.array([[270.0, 180.0], [9.0, 180.0]])
    patches = capture(image, uv, np.eye(4))
    points = 3.0 * np.c_[(uv - [270, 180]) / 500.0, np.ones(2)]
    same = warp_templates(camera, patches, np.eye(4), points).ok
    assert list(same) == [True, True]
    near = warp_templates(camera, patches, se3_exp([0, 0, 2.7, 0, 0, 0]), points).ok
    assert not near[0]  # a hundred times the area
    behind = warp_templates(camera, patches, se3_exp([0, 0, 4.0, 0, 0, 0]), points).ok
    assert not behind[0]
    turned = warp_templates(camera, patches, se3_exp([0, 0, 0, 0, 0, 0.8]), points).ok
    assert list(turned) == [True, False]  # the second one needs pixels that the image did not have
    nothing = warp_templates(camera, [], np.eye(4), np.empty((0, 3)))
    empty, ok, affine = nothing.templates, nothing.ok, nothing.affine
    assert [x.shape for x in (empty, ok, affine)] == [(0, 15, 15), (0,), (0, 2, 2)]


@pytest.mark.parametrize("model", ["pinhole", "radtan", "fisheye"])
def test_affine_map_agrees_with_projection(model):
    distortion = {"pinhole": [], "radtan": [-0.2, 0.05, 0.001, -0.001], "fisheye": [0.02, -0.01, 0.0, 0.0]}[
        model
    ]
    camera = Camera(model, 640, 480, (400.0, 410.0, 320.0, 240.0), distortion)
    uv = np.array([[150.0, 120.0], [320.0, 240.0], [500.0, 350.0]])
    motion = se3_exp([0.3, -0.1, 0.2, 0.1, -0.2, 0.3])
    rho = np.array([0.5, 0.0, np.nan])
    maps = affine_maps(camera, uv, camera, motion, rho)
    predicted, affine, ok = maps.uv, maps.affine, maps.ok
    assert np.all(ok)
    rays = camera.unproject(uv)
    far = np.where(np.isfinite(rho) & (rho > 0), rho, 1e-9)
    seen = rays / far[:, None] @ motion[:3, :3].T + motion[:3, 3]
    assert np.allclose(camera.project(seen).uv, predicted, atol=1e-5)
    for k, step in enumerate(np.eye(2)):  # a small step on the plane that faces the camera
        moved_rays = camera.unproject(uv + 0.01 * step)
        on_plane = moved_rays / (moved_rays * rays).sum(axis=1, keepdims=True) / far[:, None]
        change = (camera.project(on_plane @ motion[:3, :3].T + motion[:3, 3]).uv - predicted) / 0.01
        assert np.allclose(affine[:, :, k], change, atol=0.03)


def test_global_motion_finds_shift_and_roll():
    image = texture(480, 640, seed=4)
    linear = rotation(0.06)
    centre = np.array([319.5, 239.5])
    shift = centre - linear @ centre + [95.0, -60.0]
    motion = global_motion(flow_image(image), flow_image(moved(image, linear, shift)))
    grid = np.array([[200.0, 150.0], [320.0, 240.0], [450.0, 330.0]])
    error = grid @ (motion[:, :2] - linear).T + motion[:, 2] - shift
    assert np.abs(error).max() < 10.0  # a pixel of the small images is 16 here
    still = global_motion(flow_image(image), flow_image(image))
    assert np.abs(still - np.eye(2, 3)).max() < 0.2


def test_flow_survives_a_large_motion():
    image = texture(480, 640, seed=4)
    linear = rotation(0.05)
    shift = np.array([120.0, 30.0])
    now = moved(image, linear, shift)
    uv = detect_corners(image[100:380, 100:480], NONE, 40, SETTINGS.detect, 20) + 100.0
    true = uv @ linear.T + shift
    found, ok = flow_guess(flow_image(image), flow_image(now), uv, SETTINGS.flow)
    inside = np.all((true > 20) & (true < [620, 460]), axis=1)
    good = np.linalg.norm(found - true, axis=1) < 1.0
    assert good[inside].mean() > 0.9
    assert good[ok].mean() > 0.95
    misled = np.array([[1.0, 0.0, 80.0], [0.0, 1.0, -70.0]])
    again, ok = flow_guess(flow_image(image), flow_image(now), uv, SETTINGS.flow, misled)
    assert (np.linalg.norm(again - true, axis=1) < 1.0)[inside].mean() > 0.9


@pytest.mark.parametrize("exposure", [0.6, 1.5])
def test_flow_survives_a_step_of_the_exposure(exposure):
    image = texture(seed=9) // 2 + 20
    shift = np.array([18.0, -7.0])
    now = np.round(exposure * moved(image, np.eye(2), shift)).astype(np.uint8)
    uv = detect_corners(image[60:-60, 60:-60], NONE, 60, SETTINGS.detect, 8) + 60.0
    found, ok = flow_guess(flow_image(image), flow_image(now), uv, SETTINGS.flow)
    assert ok.mean() > 0.95
    assert np.percentile(np.linalg.norm(found - uv - shift, axis=1)[ok], 90) < 0.5


def test_motion_is_no_step_of_the_exposure():
    image = texture(seed=9)
    before, now = flow_image(image), flow_image(moved(image, np.eye(2), np.array([60.0, 10.0])))
    assert before.as_bright_as(now) is before


def test_flow_refuses_what_is_gone():
    image, other = texture(seed=5), texture(seed=6)
    uv = detect_corners(image, NONE, 40, SETTINGS.detect, 20)
    _, ok = flow_guess(flow_image(image), flow_image(other), uv, SETTINGS.flow)
    assert ok.mean() < 0.2
    empty, none = flow_guess(flow_image(image), flow_image(other), NONE, SETTINGS.flow)
    assert [empty.shape, none.shape] == [(0, 2), (0,)]


def test_candidates_do_not_drift():
    image = texture(seed=7)
    uv = detect_corners(image[60:300, 60:440], NONE, 40, SETTINGS.detect, 20) + 60.0
    ids = np.arange(len(uv))
    tracks = Tracks(Camera("pinhole", 540, 360, (500.0, 500.0, 270.0, 180.0), []), SETTINGS, 24)
    view = make_view(image)
    tracks.search(view, np.eye(4), NO_FEATURES, None)
    tracks.adopt(view, np.eye(4), MapChange(candidates=ImagePoints(ids, uv)), ids)
    for step in range(1, 13):
        now = moved(image, np.eye(2), step * np.array([3.3, -1.7]))
        found = tracks.search(make_view(now), np.eye(4), NO_FEATURES, None)
    error = found.candidate_uv - uv[found.candidates] - 12 * np.array([3.3, -1.7])
    assert len(found.candidates) > 0.8 * len(uv)
    assert np.sqrt((error**2).mean()) < 0.1


def test_everything_is_deterministic():
    image = texture(seed=8)
    now = moved(image, rotation(0.02), np.array([5.0, 3.0]))
    first, second = (
        (
            detect_corners(image, NONE, 50, SETTINGS.detect, 15),
            global_motion(flow_image(image), flow_image(now)),
        )
        for _ in range(2)
    )
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])
