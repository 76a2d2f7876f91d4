"""Poses, quaternions and the tangent space of METHOD section 1."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collabslam import geometry as g
from collabslam._core import chi2_quantile, ray_angles
from collabslam.errors import InputError


def random_xi(rng: np.random.Generator) -> np.ndarray:
    w = rng.standard_normal(3)
    w *= rng.uniform(0.0, np.pi - 1e-3) / np.linalg.norm(w)
    return np.concatenate([rng.standard_normal(3), w])


@pytest.mark.parametrize("seed", range(10))
def test_rotation_and_quaternion_agree_with_scipy(seed: int) -> None:
    w = random_xi(np.random.default_rng(seed))[3:]
    expected = Rotation.from_rotvec(w)
    np.testing.assert_allclose(g.rotation_exp(w), expected.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(g.rotation_log(expected.as_matrix()), w, atol=1e-12)
    q = g.quaternion_wxyz(expected.as_matrix())
    x, y, z, s = expected.as_quat()
    np.testing.assert_allclose(q, np.array([s, x, y, z]) * np.sign(s), atol=1e-14)
    np.testing.assert_allclose(g.rotation_from_quaternion(3.0 * q), expected.as_matrix(), atol=1e-14)


def test_exp_moves_translation_and_rotation_separately() -> None:
    xi = random_xi(np.random.default_rng(1))
    np.testing.assert_array_equal(g.se3_exp(xi)[:3, 3], xi[:3])
    t = g.se3_exp(random_xi(np.random.default_rng(2)))
    moved = t @ g.se3_exp(xi)
    np.testing.assert_allclose(moved[:3, 3], t[:3, 3] + t[:3, :3] @ xi[:3], atol=1e-14)
    np.testing.assert_allclose(moved[:3, :3], t[:3, :3] @ g.rotation_exp(xi[3:]), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-7, 1e-3, 1.0, 3.1])
def test_log_inverts_exp_at_every_angle(angle: float) -> None:
    xi = np.array([0.3, -1.0, 2.0, angle * 0.6, 0.0, -angle * 0.8])
    np.testing.assert_allclose(g.se3_log(g.se3_exp(xi)), xi, rtol=1e-9, atol=1e-17)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.0, 0.8]])
def test_half_turns_keep_their_axis(axis: list[float]) -> None:
    w = np.pi * np.asarray(axis, dtype=float)
    rotation = g.rotation_exp(w)
    q = g.quaternion_wxyz(rotation)
    assert q[0] >= 0.0
    np.testing.assert_allclose(np.abs(q[1:]), np.abs(axis), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(g.rotation_log(rotation)), np.pi, atol=1e-9)


def test_inverse_and_composition() -> None:
    t = g.se3_exp(random_xi(np.random.default_rng(3)))
    np.testing.assert_allclose(g.pose_inverse(t) @ t, np.eye(4), atol=1e-14)


def test_adjoint_carries_a_small_step_to_the_left() -> None:
    rng = np.random.default_rng(4)
    t = g.se3_exp(random_xi(rng))
    xi = 1e-6 * rng.standard_normal(6)
    left = g.se3_log(t @ g.se3_exp(xi) @ g.pose_inverse(t))
    np.testing.assert_allclose(left, g.adjoint(t) @ xi, atol=1e-11)


def test_interpolation_is_straight_and_even() -> None:
    a = g.pose(g.rotation_exp([0, 0, 0.2]), [0, 0, 0])
    b = g.pose(g.rotation_exp([0, 0, 0.6]), [2, 0, 0])
    middle = g.interpolate_pose(a, b, 0.25)
    np.testing.assert_allclose(g.se3_log(middle), [0.5, 0, 0, 0, 0, 0.3], atol=1e-14)


def test_the_nearest_rotation_is_no_reflection() -> None:
    turn = g.rotation_exp([0.3, -0.8, 0.5])
    np.testing.assert_allclose(g.nearest_rotation(turn @ np.diag([2.0, 0.7, 0.1])), turn, atol=1e-14)
    mirrored = g.nearest_rotation(turn @ np.diag([2.0, 0.7, -0.1]))
    np.testing.assert_allclose(mirrored, turn, atol=1e-14)


def test_is_rotation_refuses_reflections_and_scales() -> None:
    assert g.is_rotation(np.eye(3))
    assert not g.is_rotation(np.diag([1.0, 1.0, -1.0]))
    assert not g.is_rotation(1.1 * np.eye(3))
    assert not g.is_rotation(np.full((3, 3), np.nan))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: g.se3_exp([0, 0, 0]), r"xi has shape \[3\], expected \(6,\)"),
        (lambda: g.se3_log(np.eye(3)), r"t has shape \[3, 3\], expected \(4, 4\)"),
        (lambda: g.se3_log(np.diag([1.0, 1.0, 1.0, 2.0])), "give a 4x4 rigid transform"),
        (lambda: g.rotation_from_quaternion([0, 0, 0, 0]), "give a unit quaternion"),
        (lambda: g.pose_inverse(np.full((4, 4), np.nan)), "t_ab has a value that is NaN"),
        (lambda: g.pose(np.eye(4), [0, 0, 0]), "give"),
        (lambda: chi2_quantile(1.0, 3.0), "give a number between 0 and 1"),
        (lambda: chi2_quantile(0.5, 0.0), "give a positive number"),
    ],
)
def test_bad_arrays_are_named(call, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words):
        call()


def test_the_left_jacobian_is_the_mean_of_the_turns_on_the_way() -> None:
    w = np.array([0.3, -0.8, 0.5])
    shares = (np.arange(2000) + 0.5) / 2000
    mean = np.mean([g.rotation_exp(s * w) for s in shares], axis=0)
    np.testing.assert_allclose(g.left_jacobian(w), mean, atol=1e-7)


def test_angles_of_rays_and_their_derivatives() -> None:
    rays = np.random.default_rng(3).uniform(0.2, 2.0, (20, 3)) * np.random.default_rng(4).choice(
        [-1.0, 1.0], (20, 3)
    )
    angles, by_rays = ray_angles(rays)
    level = np.cos(angles[:, 1])
    unit = np.stack(
        [level * np.sin(angles[:, 0]), -np.sin(angles[:, 1]), level * np.cos(angles[:, 0])], axis=1
    )
    np.testing.assert_allclose(unit, rays / np.linalg.norm(rays, axis=1)[:, None], atol=1e-12)
    for k, step in enumerate(1e-6 * np.eye(3)):
        slope = (ray_angles(rays + step)[0] - ray_angles(rays - step)[0]) / 2e-6
        np.testing.assert_allclose(by_rays[:, :, k], slope, rtol=1e-5, atol=1e-6)
