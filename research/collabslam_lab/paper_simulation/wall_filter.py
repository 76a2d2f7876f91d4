"""The EKF of the 2-DoF simulation, for many runs at once.

The state of each run is ``[x z heading vx vz turn | slots]``. A slot holds one landmark: while it waits for
parallax the pose from which it was first seen and the bearing in W, ``[x0 z0 angle -]``; after its birth an
inverse-depth feature ``[x0 z0 angle rho]``, at ``(x0, z0) + (cos angle, sin angle) / rho`` (Eq. 11).
Landmark ``j``
lives in slot ``j mod K``, so the map is the latest K landmarks. Arrays have the run first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collabslam.types import Array
from collabslam_lab.paper_simulation import wall_models
from collabslam_lab.paper_simulation.estimators import Estimator
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CAMERA = 6
EMPTY, WAITING, FEATURE = 0, 1, 2
_LEAST_RHO = 0.025
"""1/m; a birth further away than 40 m waits."""
_BOUNDS = 1e4
"""Metres and radians beyond which a run has diverged."""


class WallFilter:
    """B filters of one kind, in step.

    Parameters
    ----------
    s : SimulationSettings
    estimator : Estimator
    rates : (B, 3) array
        Velocities (m/s) and turn rate (rad/s) to start with.
    """

    def __init__(self, s: SimulationSettings, estimator: Estimator, rates: Array) -> None:
        self.s, self.estimator = s, estimator
        self.sigma = np.radians(s.bearing_sigma) * (s.inflation if estimator.inflated else 1.0)
        self.count, self.slots = len(rates), int(s.map_size)
        n = CAMERA + 4 * self.slots
        self.x = np.zeros((self.count, n))
        self.x[:, 2] = 0.5 * np.pi
        self.x[:, 3:6] = rates
        self.p = np.zeros((self.count, n, n))
        for i, sd in ((3, s.start_velocity_sigma), (4, s.start_velocity_sigma)):
            self.p[:, i, i] = sd**2
        self.p[:, 5, 5] = np.radians(s.start_turn_sigma) ** 2
        self.kind: Ints = np.zeros((self.count, self.slots), np.int64)
        self.landmark: Ints = np.full((self.count, self.slots), -1, np.int64)
        self.first_estimate = np.zeros((self.count, self.slots, 4))
        self.alive: Bools = np.ones(self.count, np.bool_)
        self._noted = np.zeros((self.count, self.slots, 3, 3))

    @property
    def features(self) -> Array:
        """(B, K, 4) view of the slots."""
        return self.x[:, CAMERA:].reshape(self.count, self.slots, 4)

    def points(self) -> Array:
        """(B, K, 2) points of the features in W, metres; NaN where there is none."""
        y = self.features
        rho = np.where((self.kind == FEATURE) & (y[..., 3] > 0.0), y[..., 3], np.nan)
        return y[..., :2] + wall_models.unit(y[..., 2]) / rho[..., None]

    def rho_ratio(self) -> Array:
        """(B, K) sd(rho) / rho; infinite where it says nothing."""
        variance = np.maximum(np.diagonal(self.p, axis1=1, axis2=2)[:, CAMERA + 3 :: 4], 0.0)
        rho = self.features[..., 3]
        good = (self.kind == FEATURE) & (rho > 0.0)
        return np.where(good, np.sqrt(variance) / np.where(good, rho, 1.0), np.inf)

    def predict(self) -> None:
        """One frame of constant velocity (METHOD 3)."""
        s, dt = self.s, 1.0 / self.s.rate
        f = np.eye(CAMERA)
        f[:3, 3:] = dt * np.eye(3)
        q = np.diag(
            [s.acceleration_density, s.acceleration_density, np.radians(s.angular_acceleration_density)]
        )
        q = q**2
        self.x[:, :3] += self.x[:, 3:6] * dt
        self.p[:, :CAMERA, :] = f @ self.p[:, :CAMERA, :]
        self.p[:, :, :CAMERA] = self.p[:, :, :CAMERA] @ f.T
        self.p[:, :CAMERA, :CAMERA] += np.block([[q * dt**3 / 3, q * dt**2 / 2], [q * dt**2 / 2, q * dt]])

    def know(self, run: Ints, landmark: Ints, points: Array) -> None:
        """Features at points (M, 2) that are known to ``known_sigma``, seen from the start."""
        distance = np.hypot(points[:, 0], points[:, 1])
        mean = np.zeros((len(run), 4))
        mean[:, 2], mean[:, 3] = np.arctan2(points[:, 1], points[:, 0]), 1.0 / distance
        noise = np.zeros((len(run), 4, 4))
        noise[:, 2, 2] = (self.s.known_sigma / distance) ** 2
        noise[:, 3, 3] = (self.s.known_sigma / distance**2) ** 2
        self._put(run, landmark, FEATURE, mean, np.zeros((len(run), 4, 7)), noise)

    def first_sight(self, run: Ints, landmark: Ints, bearing: Array) -> None:
        """Landmarks begin to wait for parallax."""
        mean, by = self._ray(run, bearing)
        noise = np.zeros((len(run), 4, 4))
        noise[:, 2, 2] = self.sigma**2
        if self.estimator.first_pose != "clone":
            noted = noise[:, :3, :3].copy()
            if self.estimator.first_pose == "independent":
                noted += self.p[run][:, :3, :3]
            self._noted[run, landmark % self.slots] = noted
            by[:], noise[:] = 0.0, 0.0
        self._put(run, landmark, WAITING, mean, by, noise)

    def birth(self, run: Ints, landmark: Ints, bearing: Array) -> None:
        """Delayed births from the first ray and the present one (METHOD 5); what is too far waits on."""
        slot = landmark % self.slots
        mean, by = self._ray(run, bearing)
        rho, by_now, by_first = wall_models.two_view_rho(mean[:, :3], self.features[run, slot, :3])
        mean[:, 3] = rho
        by[:, 3, :3], by[:, 3, 3:6] = by_now, by_first
        by_bearing = np.zeros((len(run), 4, 1))
        by_bearing[:, 2, 0], by_bearing[:, 3, 0] = 1.0, by_now[:, 2]
        noise = self.sigma**2 * by_bearing @ _t(by_bearing)
        if self.estimator.first_pose != "clone":
            noise[:, 3, 3] += np.einsum("bi,bij,bj->b", by_first, self._noted[run, slot], by_first)
            by[:, :, 3:] = 0.0
        good = rho > _LEAST_RHO
        self._put(run[good], landmark[good], FEATURE, mean[good], by[good], noise[good])

    def birth_at_range(
        self, run: Ints, landmark: Ints, bearing: Array, distance: Array, sigma: float
    ) -> None:
        """Instant births from a bearing of Cs and a pseudo-stereo range."""
        mean, by = self._ray(run, bearing)
        rho = 1.0 / np.maximum(distance, 2.0 * sigma)
        mean[:, 3] = rho
        noise = np.zeros((len(run), 4, 4))
        noise[:, 2, 2], noise[:, 3, 3] = self.sigma**2, (rho**2 * sigma) ** 2
        self._put(run, landmark, FEATURE, mean, by, noise)

    def parallax(self, bearings: Array) -> Array:
        """(B, K) angle between the first ray of a slot and the present one, rad."""
        angle: Array = np.abs(self.x[:, 2:3] + bearings - self.features[..., 2])
        return angle

    def update(self, use: Bools, bearings: Array, stereo: tuple[Array, Array, float] | None) -> None:
        """One update with the slots in ``use`` (B, K): bearings of Cs (B, K), and pseudo-stereo ranges and
        bearings
        (B, K) with the sigma of the ranges."""
        use = use & (self.kind == FEATURE)
        most = int(use.sum(axis=1).max())
        if most == 0:
            return
        slot = np.argsort(~use, axis=1, kind="stable")[:, :most]
        on = np.take_along_axis(use, slot, 1)
        at = (np.arange(self.count)[:, None], slot)
        y = np.where(on[..., None], self.features[at], [0.0, 0.0, 0.0, 1.0])
        frozen = y
        if self.estimator.first_jacobians:
            frozen = np.where(on[..., None], self.first_estimate[at], y)
        camera = self.x[:, None, :3]
        angle, by_camera, by_feature = wall_models.bearing(camera, y, frozen)
        blocks = [(wall_models.wrap(bearings[at] - angle), by_camera, by_feature, self.sigma)]
        if stereo is not None:
            ranges, others, sigma_r = stereo
            sigma_o = np.radians(self.s.stereo_bearing_sigma)
            blocks.append((wall_models.wrap(others[at] - angle), by_camera, by_feature, sigma_o))
            distance, by_camera, by_feature = wall_models.distance(camera, y, frozen)
            blocks.append((ranges[at] - distance, by_camera, by_feature, sigma_r))
        g = np.concatenate([b[0] * on for b in blocks], 1)
        h_camera = np.concatenate([b[1] * on[..., None] for b in blocks], 1)
        h_feature = np.concatenate([b[2] * on[..., None] for b in blocks], 1)
        noise = np.concatenate([np.where(on, b[3] ** 2, 1.0) for b in blocks], 1)
        columns = CAMERA + 4 * np.concatenate([slot] * len(blocks), 1)
        self._kalman(g, h_camera, h_feature, columns, noise)

    def _kalman(self, g: Array, h_camera: Array, h_feature: Array, columns: Ints, noise: Array) -> None:
        """B1-B5 with the rows' non-zero columns only."""
        run, rows = np.arange(self.count)[:, None], np.arange(g.shape[1])
        hp = h_camera @ self.p[:, :3, :]
        for c in range(4):
            hp += h_feature[..., c : c + 1] * self.p[run, columns + c]
        s = hp[:, :, :3] @ _t(h_camera)
        for c in range(4):
            take = np.broadcast_to((columns + c)[:, None, :], s.shape)
            s += np.take_along_axis(hp, take, 2) * h_feature[:, None, :, c]
        s = 0.5 * (s + _t(s))
        s[:, rows, rows] += noise
        inverse: Array = np.asarray(np.linalg.inv(self._factor(s)), np.float64)
        v = inverse @ np.where(self.alive[:, None, None], hp, 0.0)
        g = np.where(self.alive[:, None], g, 0.0)
        before, telling = self.x, self.rho_ratio() < self.s.scale_depth
        self.x = before + (_t(v) @ (inverse @ g[..., None]))[..., 0]
        self.p -= _t(v) @ v
        if self.estimator.gauge:
            wall_models.transport(before, self.x, self.p, self.kind > EMPTY, telling)

    def _factor(self, s: Array) -> Array:
        """Cholesky factors of S; a run whose S has none, or whose state left all bounds, has diverged."""
        bounded = np.all(np.abs(self.x[:, :3]) < _BOUNDS, axis=1)
        good: Bools = np.asarray(np.all(np.isfinite(s), axis=(1, 2)) & bounded)
        sound = np.where(good[:, None, None], s, np.eye(s.shape[1]))
        try:
            factor: Array = np.linalg.cholesky(sound)
        except np.linalg.LinAlgError:
            least, *_, largest = np.linalg.eigvalsh(sound).T
            good &= least > 1e-12 * largest
            factor = np.linalg.cholesky(np.where(good[:, None, None], s, np.eye(s.shape[1])))
        self._bury(~good)
        return factor

    def _bury(self, dead: Bools) -> None:
        """Runs that have diverged see nothing any more."""
        if dead.any():
            self.alive &= ~dead
            self.kind[dead], self.landmark[dead] = EMPTY, np.iinfo(np.int64).max
            self.p[dead], self.x[dead] = np.eye(self.x.shape[1]), 0.0

    def _ray(self, run: Ints, bearing: Array) -> tuple[Array, Array]:
        """``[x z angle 0]`` of a bearing (M,) now, and its (M, 4, 7) derivative by the camera (and the
        slot)."""
        mean, by = np.zeros((len(run), 4)), np.zeros((len(run), 4, 7))
        mean[:, :3] = self.x[run, :3]
        mean[:, 2] += bearing
        by[:, [0, 1, 2], [0, 1, 2]] = 1.0
        return mean, by

    def _put(self, run: Ints, landmark: Ints, kind: int, mean: Array, by: Array, noise: Array) -> None:
        """Fills slots: linear in the camera's pose and the slot as it was, plus noise. Runs must differ."""
        slot = landmark % self.slots
        own = (CAMERA + 4 * slot)[:, None] + np.arange(4)
        sources = np.concatenate([np.broadcast_to(np.arange(3), (len(run), 3)), own], axis=1)
        cross = by @ self.p[run[:, None], sources][:, : by.shape[2]]
        block = np.take_along_axis(cross, sources[:, None, :], 2) @ _t(by) + noise
        self.p[run[:, None], own] = cross
        self.p[run[:, None], :, own] = cross
        self.p[run[:, None, None], own[:, :, None], own[:, None, :]] = block
        self.x[run[:, None], own] = mean
        self.kind[run, slot], self.landmark[run, slot] = kind, landmark
        self.first_estimate[run, slot] = mean


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
