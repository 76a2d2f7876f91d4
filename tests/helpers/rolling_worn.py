"""Views of a worn camera whose wearer turns fast while its shutter rolls, and what a filter makes of them."""

from __future__ import annotations

import numpy as np

from collabslam import Camera, Filter, FilterSettings, WornMeasurement
from collabslam.geometry import pose, pose_inverse, rotation_exp
from collabslam.types import Array

CAMERA = Camera("pinhole", 720, 480, (600.0, 600.0, 360.0, 240.0))
READOUT = 0.02
T_CF = pose(rotation_exp(np.array([0.0, -0.08, 0.02])), np.array([0.5, -0.3, 0.1]))
SDS = np.repeat([0.005, 0.002], 3)
"""Of T_CF, metres and radians: a tracker's, so that the shutter's rolling is what errs."""
FAST = np.array([1.5, -2.0, 1.0])
"""How fast Cf turns, rad/s along its axes: somebody looks round."""


def settings(**changes: float) -> FilterSettings:
    """Cs takes all rows at once, errors of T_CF are independent; Cf's readout is as a data sheet has it."""
    told = {"calibration.readout": 0.0, "calibration.readout_sd": 0.0, "worn.bias_share": 0.0}
    told |= {"worn.readout": READOUT, "worn.readout_sd": 0.002}
    return FilterSettings(told | {f"worn.{name}": value for name, value in changes.items()})


def pixels(points: Array, t_cf: Array, turned: Array) -> Array:
    """Pixels in Cf, which turns by ``turned`` (3,), radians, from its first row to the last one."""
    row = np.zeros(len(points))
    for _ in range(6):
        seen = [pose_inverse(t_cf @ pose(rotation_exp(turned * share), np.zeros(3))) for share in row]
        uv = CAMERA.project(
            np.array([t[:3, :3] @ p + t[:3, 3] for t, p in zip(seen, points, strict=True)])
        ).uv
        row = uv[:, 1] / CAMERA.height - 0.5
    return np.asarray(uv)


class View:
    """A first view of both cameras, at rest but for Cf's turn.

    Parameters
    ----------
    seed : int
    turn : (3,) array
        How fast Cf turns, rad/s.
    count : int
        Points in view.
    """

    def __init__(self, seed: int, turn: Array = FAST, count: int = 40) -> None:
        rng = np.random.default_rng(seed)
        corners = rng.uniform((60.0, 60.0), (660.0, 420.0), (count * 4, 2))
        depth = rng.uniform(2.0, 6.0, count * 4)
        points = np.column_stack([(corners - [360.0, 240.0]) / 600.0, np.ones(count * 4)]) * depth[:, None]
        uv_f = pixels(points, T_CF, turn * READOUT)
        inside = ((uv_f > 2.0) & (uv_f < [718.0, 478.0])).all(axis=1)
        self.points = points[inside][:count]
        self.uv = corners[inside][:count] + rng.normal(0.0, 0.5, (len(self.points), 2))
        self.uv_f = uv_f[inside][:count] + rng.normal(0.0, 0.5, (len(self.points), 2))
        error = rng.normal(0.0, SDS)
        self.t_cf = T_CF @ pose(rotation_exp(error[3:]), error[:3])
        self.turn = turn

    def measured(self, rate: Array | None, **changes: float) -> tuple[str, float, float]:
        """A filter that starts from it: what became of the rate, RMS of the errors of the inverse ranges, of
        their own size, and the mean of their squares over their variances."""
        core = Filter(CAMERA, CAMERA, settings=settings(**changes))
        core.predict(0.0)
        new = np.full(len(self.points), -1)
        view = WornMeasurement(self.t_cf, np.diag(SDS**2), new, self.uv, self.uv_f)
        view = view if rate is None else view.with_rate(rate)
        report = core.update([], [], np.empty((0, 2)), views=[view])
        born = report.views[0].born
        found = core.landmarks()
        place = {i: k for k, i in enumerate(found.ids.tolist())}
        errors = []
        for truth, i in zip(self.points, born.tolist(), strict=True):
            if i in place:
                k = place[i]
                wrong = 1.0 - np.linalg.norm(truth) / np.linalg.norm(found.points[k])
                errors.append((wrong, found.rho_ratio[k]))
        assert len(errors) >= 8, report.views[0].names
        wrong, sd = np.array(errors).T
        return report.rates.names[0], float(np.sqrt(np.mean(wrong**2))), float(np.mean((wrong / sd) ** 2))


WRONG = {
    "degrees for radians": np.clip(np.degrees(FAST), -69.0, 69.0),
    "axes exchanged": FAST[[1, 2, 0]],
    "signs turned round": -FAST,
    "stuck at zero": np.zeros(3),
    "half of it": 0.5 * FAST,
}
"""What a gyroscope may say instead of `FAST`, rad/s."""


def _table(seeds: int = 20) -> None:
    """Prints what births err by, without a rate, with it and with wrong ones."""
    for count in (40, 12):
        for name, rate in {"none": None, "right": FAST, **WRONG}.items():
            found = [View(seed, FAST, count).measured(rate) for seed in range(seeds)]
            wrong = 100.0 * np.sqrt(np.mean([of[1] ** 2 for of in found]))
            square, used = np.mean([of[2] for of in found]), sum(of[0] == "rate" for of in found)
            print(f"{count} points, {name}: used {used} of {seeds}, off by {wrong:.1f} %, NEES {square:.2f}")


if __name__ == "__main__":
    _table()
