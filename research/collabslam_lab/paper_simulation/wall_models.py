"""Formulas of the 2-DoF simulation: measurements with Jacobians, two-view depth, and the gauge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collabslam.types import Array


def unit(angle: Array) -> Array:
    """(..., 2) directions of angles."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def wrap(angle: Array) -> Array:
    """Angles in [-pi, pi)."""
    wrapped: Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped


def bearing(camera: Array, feature: Array, frozen: Array | None = None) -> tuple[Array, Array, Array]:
    """Bearing of features against the optical axis (Eq. 10 and 11, scaled by rho), rad.

    Parameters
    ----------
    camera : (..., 3) array
        x, z, heading.
    feature : (..., 4) array
        x0, z0, angle, rho.
    frozen : (..., 4) array, optional
        Where the Jacobians are taken; ``feature`` by default.

    Returns
    -------
    bearing (...), derivative by the camera (..., 3) and by the feature (..., 4)
    """
    h, _ = _scaled(camera, feature)
    value = np.arctan2(h[..., 1], h[..., 0]) - camera[..., 2]
    y = feature if frozen is None else frozen
    h, offset = _scaled(camera, y)
    by_h = np.stack([-h[..., 1], h[..., 0]], axis=-1) / (h**2).sum(-1, keepdims=True)
    rho, turn = y[..., 3:], _quarter(unit(y[..., 2]))
    by_camera = np.concatenate([-rho * by_h, -np.ones_like(rho)], axis=-1)
    by_feature = np.concatenate([rho * by_h, _dot(by_h, turn), _dot(by_h, offset)], axis=-1)
    return value, by_camera, by_feature


def distance(camera: Array, feature: Array, frozen: Array | None = None) -> tuple[Array, Array, Array]:
    """Present range of features, metres (METHOD 13: Eq. 12 is the depth from the anchor); arguments as
    `bearing`."""
    h, _ = _scaled(camera, feature)
    value = np.sqrt((h**2).sum(-1)) / feature[..., 3]
    y = feature if frozen is None else frozen
    h, _ = _scaled(camera, y)
    ray, rho = h / np.sqrt((h**2).sum(-1, keepdims=True)), y[..., 3:]
    away = unit(y[..., 2])
    by_camera = np.concatenate([-ray, np.zeros_like(rho)], axis=-1)
    by_feature = np.concatenate([ray, _dot(ray, _quarter(away)) / rho, -_dot(ray, away) / rho**2], axis=-1)
    return value, by_camera, by_feature


def two_view_rho(now: Array, first: Array) -> tuple[Array, Array, Array]:
    """Inverse depth along the present ray where it meets the first one (METHOD 5).

    Parameters
    ----------
    now, first : (M, 3) array
        Origin and angle of both rays.

    Returns
    -------
    rho (M,), derivatives by ``now`` and ``first`` (M, 3)
    """
    u1, u0 = unit(now[:, 2]), unit(first[:, 2])
    offset = now[:, :2] - first[:, :2]
    a, b = _cross(u1, u0), _cross(offset, u0)
    q0 = _quarter(u0)
    by_offset = (a / b**2)[:, None] * np.stack([u0[:, 1], -u0[:, 0]], axis=1)
    by_now = -_cross(_quarter(u1), u0) / b
    by_first = -_cross(u1, q0) / b + a / b**2 * _cross(offset, q0)
    return (
        -a / b,
        np.concatenate([by_offset, by_now[:, None]], axis=1),
        np.concatenate([-by_offset, by_first[:, None]], axis=1),
    )


def gauge_directions(x: Array, filled: NDArray[np.bool_]) -> Array:
    """(B, n, 2): how states (B, n) move when W turns (per rad) and grows (per unit of log) about the
    origin."""
    out = np.zeros((*x.shape, 2))
    out[:, 2, 0] = 1.0
    for at in (0, 3):
        out[:, at : at + 2, 0], out[:, at : at + 2, 1] = _quarter(x[:, at : at + 2]), x[:, at : at + 2]
    slots = x[:, 6:].reshape(*filled.shape, 4)
    moves = out[:, 6:].reshape(*filled.shape, 4, 2)
    moves[..., :2, 0], moves[..., :2, 1] = _quarter(slots[..., :2]), slots[..., :2]
    moves[..., 2, 0], moves[..., 3, 1] = 1.0, -slots[..., 3]
    moves *= filled[..., None, None]
    return out


def gauge_coordinates(x: Array, converged: NDArray[np.bool_]) -> Array:
    """(B, 2, n) with ``B N = 1``: the heading, and the mean logarithm of the range of converged features."""
    camera, slots = x[:, None, :3], x[:, 6:].reshape(*converged.shape, 4)
    y = np.where(converged[..., None], slots, [0.0, 0.0, 0.0, 1.0])
    value, by_camera, by_feature = distance(camera, y)
    weight = converged / np.maximum(converged.sum(axis=1, keepdims=True), 1) / value
    out = np.zeros((len(x), 2, x.shape[1]))
    out[:, 0, 2] = 1.0
    out[:, 1, :3] = (weight[..., None] * by_camera).sum(axis=1)
    out[:, 1, 6:] = (weight[..., None] * by_feature).reshape(len(x), -1)
    return out


def transport(
    before: Array, after: Array, p: Array, filled: NDArray[np.bool_], converged: NDArray[np.bool_]
) -> None:
    """Carries P (B, n, n) in place along with the gauge (METHOD 14): ``T = 1 + (N(after) - N(before))
    B(before)``."""
    move = gauge_directions(after, filled) - gauge_directions(before, filled)
    b = gauge_coordinates(before, converged)
    bp = b @ p
    half = move @ (bp + 0.5 * (bp @ np.swapaxes(b, 1, 2)) @ np.swapaxes(move, 1, 2))
    p += half + np.swapaxes(half, 1, 2)


def _scaled(camera: Array, feature: Array) -> tuple[Array, Array]:
    """``rho (p - r) + u``, a direction in W, and ``p - r``."""
    offset = feature[..., :2] - camera[..., :2]
    return feature[..., 3:] * offset + unit(feature[..., 2]), offset


def _quarter(v: Array) -> Array:
    """Vectors turned by 90 degrees."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(-1, keepdims=True)
    return product


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
