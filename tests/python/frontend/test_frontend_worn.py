"""Descriptors, matches with the worn camera, and the start from a target, on rendered planes."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from collabslam._core import Camera, MatchNoise, epipolar_residuals, find_consensus
from collabslam.errors import DataError, InputError
from collabslam.frontend import worn_match
from collabslam.frontend.describe import DESCRIPTORS, describe
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.frontend.viewed_points import ViewedPoints
from collabslam.frontend.worn_match import match_worn
from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.settings.table import Settings
from collabslam.slam.targets.patches import find_target
from collabslam.types import Target, WornView

SETTINGS = Settings.default()
CAMERA = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5), [])
NONE = np.empty((0, 2))
COVARIANCE = np.diag([0.03] * 3 + [np.radians(0.5), np.radians(1.0), np.radians(0.5)]) ** 2
T_CF = se3_exp([0.45, -0.05, 0.15, 0.02, -0.12, 0.06])


def texture(height: int, width: int, seed: int) -> np.ndarray:
    rng = np.random.Generator(np.random.PCG64(seed))
    image = sum(
        s * cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), s) for s in (1.5, 3.0, 6.0, 12.0)
    )
    image = (image - image.min()) / (image.max() - image.min())
    return (20 + 210 * image).astype(np.uint8)


def planes(t_cf: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A wall at 4 m and a board at 2 m before it, seen from C and from F, with the depth in C."""
    images = []
    depth = np.full((480, 640), 4.0)
    depth[120:330, 200:420] = 2.0
    for pose in (np.eye(4), pose_inverse(t_cf)):
        image = np.zeros((480, 640), np.uint8)
        for seed, z, inside in ((11, 4.0, None), (12, 2.0, (200, 120, 420, 330))):
            picture = texture(1000, 1200, seed)
            # A picture pixel (x, y) sits at ((x - 280) - 319.5, (y - 260) - 239.5) / 500 * z in C.
            to_plane = np.array(
                [[z / 500, 0, -(280 + 319.5) * z / 500], [0, z / 500, -(260 + 239.5) * z / 500], [0, 0, z]]
            )
            rotation, t = pose[:3, :3], pose[:3, 3]
            k = CAMERA.matrix
            full = k @ (rotation + np.outer(t, [0, 0, 1.0 / z])) @ to_plane
            warped = cv2.warpPerspective(picture, full, (640, 480), flags=cv2.INTER_AREA)
            mask = np.zeros(picture.shape, np.uint8)
            if inside is None:
                mask[:] = 255
            else:
                mask[260 + inside[1] : 260 + inside[3], 280 + inside[0] : 280 + inside[2]] = 255
            seen = cv2.warpPerspective(mask, full, (640, 480)) > 127
            image[seen] = warped[seen]
        images.append(image)
    return images[0], images[1], depth


@pytest.fixture(scope="module")
def scene():
    image_s, image_f, depth = planes(T_CF)
    uv = detect_corners(image_s, NONE, 150, SETTINGS.frontend.detect, 12)
    z = depth[np.rint(uv[:, 1]).astype(int), np.rint(uv[:, 0]).astype(int)]
    rays = CAMERA.unproject(uv)
    points = rays * (z / rays[:, 2])[:, None]
    there = CAMERA.project((points - T_CF[:3, 3]) @ T_CF[:3, :3])
    return image_s, image_f, uv, np.linalg.norm(points, axis=1), there.uv, there.visible


def measured(seed: int) -> np.ndarray:
    """The relative pose with noise of the stated covariance."""
    rng = np.random.Generator(np.random.PCG64(seed))
    return T_CF @ se3_exp(rng.multivariate_normal(np.zeros(6), COVARIANCE))


def run(scene, t_cf, *, settings=SETTINGS, rho=None, sd=None, roi_s=None, roi_f=None):
    image_s, image_f, uv = scene[:3]
    worn, points = WornView(image_f, t_cf, COVARIANCE), ViewedPoints(uv, rho, sd)
    return match_worn(image_s, worn, points, (CAMERA, CAMERA), settings, regions=(roi_s, roi_f))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_worn_matches_are_many_and_right(scene, seed):
    t_cf = measured(seed)
    found = run(scene, t_cf)
    true = scene[4][found.index]
    error = np.linalg.norm(found.uv_f - true, axis=1)
    assert len(found.index) >= 50
    assert len(set(found.index)) == len(found.index)
    assert (error < 1.5).mean() >= 0.97
    assert np.median(error) < 0.35
    assert found.verdict.against < 1.0
    assert sum(found.rejected.values()) + len(found.index) >= len(scene[2]) - 1


def test_known_depth_adds_matches(scene, monkeypatch):
    rho = 1.0 / scene[3]
    sd = 0.1 * rho
    rng = np.random.Generator(np.random.PCG64(5))
    monkeypatch.setattr(worn_match, "_CORNERS", 150)
    without = run(scene, measured(0))
    known = run(scene, measured(0), rho=rho + sd * rng.standard_normal(len(rho)), sd=sd)
    assert len(known.index) > 1.3 * len(without.index)
    error = np.linalg.norm(known.uv_f - scene[4][known.index], axis=1)
    assert (error < 1.5).mean() >= 0.97


def test_wrong_depth_does_not_give_wrong_matches(scene):
    rho = 0.4 / scene[3]
    found = run(scene, measured(0), rho=rho, sd=0.02 * rho)
    error = np.linalg.norm(found.uv_f - scene[4][found.index], axis=1)
    assert (error > 2.0).sum() <= 3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_map_of_another_size_is_contradicted_by_its_points(scene, seed):
    rng = np.random.Generator(np.random.PCG64(seed))
    rho = np.exp(0.05 * rng.standard_normal(len(scene[3]))) / scene[3]
    rho[rng.random(len(rho)) < 0.5] = np.nan  # half are new
    found = {
        size: run(scene, measured(seed), rho=rho * size, sd=0.05 * rho * size) for size in (1.0, 0.4, 2.5)
    }
    assert found[1.0].size < 0.3
    assert found[0.4].size > 2.0
    assert found[2.5].size > 2.0
    assert np.isnan(run(scene, measured(seed)).size), "nothing is known of new points"


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_other_descriptors_match_too(scene, kind):
    settings = Settings.default().replace({"frontend.worn.descriptor": kind})
    found = run(scene, measured(1), settings=settings)
    error = np.linalg.norm(found.uv_f - scene[4][found.index], axis=1)
    assert len(found.index) >= 25
    assert (error < 1.5).mean() >= 0.95


def test_regions_of_interest_are_kept(scene):
    found = run(scene, measured(0), roi_s=(150.0, 100.0, 500.0, 400.0), roi_f=(100.0, 80.0, 400.0, 420.0))
    uv = scene[2][found.index]
    assert len(found.index) >= 15
    assert np.all((uv >= [150, 100]) & (uv <= [500, 400]))
    assert np.all((found.uv_f >= [97, 77]) & (found.uv_f <= [403, 423]))
    assert found.rejected["region"] > 20
    nothing = run(scene, measured(0), roi_f=(600.0, 440.0, 639.0, 479.0))
    assert len(nothing.index) == 0
    assert nothing.uv_f.shape == (0, 2)


def test_unrelated_views_give_no_matches(scene):
    image_s, _, uv = scene[:3]
    other = texture(480, 640, 77)
    worn = WornView(other, T_CF, COVARIANCE)
    found = match_worn(image_s, worn, ViewedPoints(uv), (CAMERA, CAMERA), SETTINGS)
    assert len(found.index) <= 2


def test_worn_matching_is_deterministic(scene):
    a, b = run(scene, measured(0)), run(scene, measured(0))
    assert np.array_equal(a.index, b.index)
    assert np.array_equal(a.uv_f, b.uv_f)


def test_worn_match_refuses_bad_arrays(scene):
    with pytest.raises(InputError, match="one inverse range"):
        ViewedPoints(scene[2], np.ones(3), np.ones(3))


def _pairs(count: int, wrong: int, seed: int, noise: float = 0.5):
    """Rays of points in both cameras with pixel noise; the first ``wrong`` of them at random."""
    rng = np.random.Generator(np.random.PCG64(seed))
    uv = rng.uniform([20, 20], [620, 460], (count, 2))
    rays = CAMERA.unproject(uv)
    ranges = rng.uniform(1.5, 6.0, count)
    uv_f = CAMERA.project((rays * ranges[:, None] - T_CF[:3, 3]) @ T_CF[:3, :3]).uv
    uv_f = uv_f + noise * rng.standard_normal((count, 2))
    uv_f[:wrong] = rng.uniform([20, 20], [620, 460], (wrong, 2))
    return rays, CAMERA.unproject(uv_f), ranges


def test_epipolar_residual_has_pixel_noise_and_right_derivatives():
    a, b, ranges = _pairs(400, 0, 1)
    found = epipolar_residuals(a, b, T_CF, (500.0, 500.0))
    residual, jacobian = found.residual, found.jacobian
    assert 0.25 < residual.std() < 0.55  # only F carries noise of 0.5 px: 0.5 / sqrt(2) on average
    step = 1e-6
    for k, axis in enumerate(np.eye(6)):
        moved = epipolar_residuals(a, b, T_CF @ se3_exp(step * axis), (500.0, 500.0)).residual
        numeric = (moved - residual) / step
        assert np.abs(numeric - jacobian[:, k]).max() < 0.05 * np.abs(jacobian).max()
    exact = _pairs(400, 0, 1, noise=0.0)[1]
    assert np.allclose(1.0 / inverse_ranges(a, exact, T_CF), ranges, rtol=1e-6)
    assert np.all(inverse_ranges(-a, exact, T_CF) < 0.0)


def test_consensus_survives_wrong_matches():
    a, b, _ = _pairs(80, 40, 2)
    t_cf = measured(3)
    consensus = find_consensus(a, b, t_cf, COVARIANCE, MatchNoise((500.0, 500.0), 0.5, 2.0))
    assert consensus.agree[40:].mean() > 0.95
    assert consensus.agree[:40].mean() < 0.25
    error = se3_log(pose_inverse(T_CF) @ consensus.t_cf)
    before = se3_log(pose_inverse(T_CF) @ t_cf)
    assert np.linalg.norm(error[3:]) < 0.5 * np.linalg.norm(before[3:])
    assert error @ np.linalg.solve(consensus.covariance, error) < 30.0
    few = find_consensus(a[:2], b[:2], t_cf, COVARIANCE, MatchNoise((500.0, 500.0), 0.5, 2.0))
    assert np.array_equal(few.t_cf, t_cf)


def test_consensus_does_not_shrink_the_baseline():
    """A pose without baseline satisfies every epipolar constraint; it must not be what they agree on."""
    a, b, _ = _pairs(80, 30, 4)
    short = T_CF.copy()
    short[:3, 3] *= 0.2  # the same scene at a fifth of the size
    wide = COVARIANCE.copy()
    wide[:3, :3] *= 4.0
    consensus = find_consensus(
        a, b, short @ se3_exp([0, 0, 0, 0.01, -0.01, 0.01]), wide, MatchNoise((500.0, 500.0), 0.5, 2.0)
    )
    assert np.linalg.norm(consensus.t_cf[:3, 3]) > 0.5 * np.linalg.norm(short[:3, 3])
    assert consensus.agree[30:].mean() > 0.95


@pytest.mark.parametrize("kind", DESCRIPTORS)
def test_descriptors_follow_the_rotation(kind):
    image = texture(400, 500, 1)
    angle = 0.6
    linear = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = np.array([249.5, 199.5])
    turned = cv2.warpAffine(image, np.c_[linear, centre - linear @ centre], (500, 400))
    uv = detect_corners(image[80:320, 100:400], NONE, 60, SETTINGS.frontend.detect, 15) + np.array([100, 80])
    place = (uv - centre) @ linear.T + centre
    a, b = describe(image, uv, 0.0, 36.0, kind), describe(turned, place, angle, 36.0, kind)
    assert np.allclose(np.linalg.norm(a, axis=1), 1.0, atol=1e-3)
    assert ((a @ b.T).argmax(axis=1) == np.arange(len(uv))).mean() > 0.95
    upright = describe(turned, place, 0.0, 36.0, kind)
    assert ((a @ upright.T).argmax(axis=1) == np.arange(len(uv))).mean() < 0.5
    assert describe(image, NONE, 0.0, 36.0, kind).shape == (0, a.shape[1])
    one = describe(image, uv[:1], np.zeros(1), 36.0, kind)
    assert (one @ a[0])[0] > 0.95  # a crop does not change what is described


def test_unknown_descriptor():
    with pytest.raises(InputError, match="warped-sift"):
        describe(texture(100, 100, 0), np.array([[50.0, 50.0]]), 0.0, 36.0, "brief")


def _target_scene():
    picture = texture(480, 640, 21)
    t_tc = se3_exp([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    uv = detect_corners(picture, NONE, 8, SETTINGS.frontend.detect, 60)
    rays = CAMERA.unproject(uv)
    points = rays / rays[:, 2:] + t_tc[:3, 3]  # on the plane z = 0 of the target
    patches = [cv2.getRectSubPix(picture, (15, 15), (float(u), float(v))) for u, v in uv]
    moved = t_tc @ se3_exp([0.02, -0.01, 0.03, 0.01, -0.02, 0.02])
    t_ct = pose_inverse(moved)
    # Homography from the picture (seen from t_tc) to the new view, through the plane z = 0.
    k = CAMERA.matrix
    plane = np.c_[t_ct[:3, 0], t_ct[:3, 1], t_ct[:3, 3]]
    back = pose_inverse(t_tc)
    first = k @ np.c_[back[:3, 0], back[:3, 1], back[:3, 3]]
    image = cv2.warpPerspective(picture, k @ plane @ np.linalg.inv(first), (640, 480), flags=cv2.INTER_CUBIC)
    covariance = np.diag([0.02] * 3 + [0.02] * 3) ** 2
    return image, Target(points, patches, t_tc, covariance), moved


def test_target_gives_the_pose():
    image, target, true = _target_scene()
    fix = find_target(image, CAMERA, target)
    assert len(fix.uv) >= 6
    error = se3_log(pose_inverse(true) @ fix.t_tc)
    assert np.linalg.norm(error[:3]) < 0.006
    assert np.linalg.norm(error[3:]) < 0.006
    assert error @ np.linalg.solve(fix.covariance, error) < 25.0


def test_target_that_is_not_there():
    _, target, _ = _target_scene()
    with pytest.raises(DataError, match="start pose"):
        find_target(texture(480, 640, 99), CAMERA, target)
    with pytest.raises(DataError, match="patches"):
        find_target(texture(480, 640, 99), CAMERA, dataclasses.replace(target, patches=[]))
