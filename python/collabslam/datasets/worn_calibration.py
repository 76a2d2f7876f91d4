"""What was found of the worn camera's time-correlated error and clock: a file to open a recording with.

A file is YAML, with the correction along C's axes (METHOD section 26)::

    format: collabslam-worn-calibration
    version: 1
    shift_m: [0.01, 0.0, -0.02]    # is added to the position of Cf in C
    turn_rad: [0.0, 0.017, 0.0]    # rotation vector, in front of the measured attitude
    clock_s: 0.05                  # seconds after its stamp that a view was taken
    clock_sd_s: 0.004
    covariance: [...]              # lower triangle, row by row, of the 6x6 over (shift, turn), m^2 and rad^2

A direction that was not told has neither correction nor variance there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from collabslam.datasets.gate import read_keys
from collabslam.datasets.odometry import TRIANGLE
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError, SettingsError
from collabslam.formats.files import write_text
from collabslam.geometry import rotation_exp
from collabslam.types import Array, Frame, Recording, WornView

FORMAT = "collabslam-worn-calibration"
VERSION = 1
_MOST_METRES, _MOST_SECONDS = 10.0, 10.0
_NOTHING = 1e-12
"""Share of the largest variance below which a direction counts as not told."""


def corrected(t_cf: Array, correction: Array) -> Array:
    """A measured ``T_CF`` (4, 4) moved by ``correction`` (6,) along C's axes, metres and radians."""
    out = np.array(t_cf)
    out[:3, :3] = rotation_exp(correction[3:]) @ t_cf[:3, :3]
    out[:3, 3] += correction[:3]
    return out


@dataclass(frozen=True)
class WornCalibration:
    """A correction of every measured ``T_CF``, and of the stamps of views.

    Attributes
    ----------
    correction : (6,) float64
        Along C's axes: ``t + c[:3]`` metres, ``Exp(c[3:]) R`` radians.
    covariance : (6, 6) float64
        Of what is left of the time-correlated error in the directions that were told; 0 in all others.
    clock : float
        Seconds after its stamp that a view was taken.
    clock_sd : float
        Its standard deviation, seconds.
    """

    correction: Array
    covariance: Array
    clock: float = 0.0
    clock_sd: float = 0.0

    def view(self, worn: WornView) -> WornView:
        """A view of Cf with its pose corrected; its stamp is `CalibratedWorn`'s.

        What is left of the error is added to the covariance of a view that states no bias; one that is
        stated shrinks to what is left of it.
        """
        t_cf = corrected(worn.t_cf, self.correction)
        turn = np.kron(np.eye(2), t_cf[:3, :3])
        if worn.bias is None:
            covariance = worn.covariance + turn.T @ self.covariance @ turn
            return replace(worn, t_cf=t_cf, covariance=0.5 * (covariance + covariance.T))
        bias = turn.T @ self._left(turn @ worn.bias @ turn.T) @ turn
        bias = 0.5 * (bias + bias.T)
        return replace(worn, t_cf=t_cf, covariance=worn.covariance - worn.bias + bias, bias=bias)

    def _left(self, stated: Array) -> Array:
        """What is left of a bias that was stated, (6, 6) along C's axes, after the views have told of it."""
        values, directions = np.linalg.eigh(self.covariance)
        told = directions[:, values > _NOTHING * max(float(values[-1]), 1e-300)]
        if not told.size:
            return stated
        innovation = told.T @ (stated + self.covariance) @ told
        gain = stated @ told @ np.linalg.inv(innovation)
        left: Array = stated - gain @ (stated @ told).T
        return left

    def save(self, path: Path) -> None:
        """Write the file; DataError if that cannot be done."""
        content = {
            "format": FORMAT,
            "version": VERSION,
            "shift_m": [float(v) for v in self.correction[:3]],
            "turn_rad": [float(v) for v in self.correction[3:]],
            "clock_s": float(self.clock),
            "clock_sd_s": float(self.clock_sd),
            "covariance": [float(v) for v in self.covariance[TRIANGLE]],
        }
        write_text(path, yaml.safe_dump(content, sort_keys=False))

    @classmethod
    def load(cls, path: Path) -> WornCalibration:
        """Read a file.

        Raises
        ------
        DataError
            If it is not such a file, or holds what cannot be.
        """
        with read_keys(path) as keys:
            if (keys.take("format"), keys.take("version")) != (FORMAT, VERSION):
                raise DataError(
                    f"{path} does not say 'format: {FORMAT}' and 'version: {VERSION}'; give what "
                    "`collabslam check-calib --write` wrote."
                )
            shift, turn = (np.asarray(keys.numbers(key, count=(3,))) for key in ("shift_m", "turn_rad"))
            clock, clock_sd = keys.number("clock_s"), keys.number("clock_sd_s")
            triangle = keys.numbers("covariance", count=(21,))
        covariance = np.zeros((6, 6))
        covariance[TRIANGLE] = triangle
        covariance += np.tril(covariance, -1).T
        largest = max(float(np.max(np.diag(covariance))), 0.0)
        if float(np.linalg.eigvalsh(covariance)[0]) < -1e-9 * largest or clock_sd < 0.0:
            raise DataError(f"{path} holds a covariance that is not positive semidefinite; correct it.")
        small = np.abs(shift).max() <= _MOST_METRES and np.abs(turn).max() <= np.pi
        if not (small and abs(clock) <= _MOST_SECONDS):
            raise DataError(
                f"{path} corrects T_CF by more than {_MOST_METRES:g} m, half a turn or {_MOST_SECONDS:g} s; "
                "check its numbers."
            )
        return cls(np.concatenate([shift, turn]), covariance, clock, clock_sd)


class CalibratedWorn(WrappedRecording):
    """A recording whose views of a Cf have their poses corrected, and come when they were really taken.

    Parameters
    ----------
    base : Recording
    calibration : WornCalibration
    who : str
        Whose camera's views; those of others stay as they are.

    Raises
    ------
    SettingsError
        If there is no such person.
    """

    def __init__(self, base: Recording, calibration: WornCalibration, who: str = "") -> None:
        super().__init__(base)
        self._calibration, self._who = calibration, who
        if who not in self.worn_cameras:
            known = ", ".join(map(repr, self.worn_cameras)) or "nobody"
            raise SettingsError(
                f"The worn camera of {who!r} is to be corrected and {base.name} has those of {known}; say "
                "whose, as NAME=FILE."
            )
        # Of each frame the one whose view comes with it: the first frame that is not before the view.
        self._source = dict(enumerate(range(len(base))))
        if calibration.clock:
            with_frame = np.searchsorted(self.times, np.asarray(self.times) + calibration.clock)
            self._source = {int(j): i for i, j in enumerate(with_frame)}

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the view that was taken last before it, corrected."""
        frame = self._base.frame(i)
        source = self._source.get(i)
        other = frame if source == i else None if source is None else self._base.frame(source)
        views = {view.who: view for view in frame.views if view.who != self._who}
        if other is not None:
            views |= {
                view.who: self._corrected(other.t, view) for view in other.views if view.who == self._who
            }
        return replace(frame, views=tuple(views[name] for name in self.worn_cameras if name in views))

    def _corrected(self, t: float, view: WornView) -> WornView:
        """A view that came with the frame at ``t``, seconds."""
        worn = self._calibration.view(view)
        if self._calibration.clock:
            worn = replace(worn, t=(t if worn.t is None else worn.t) + self._calibration.clock)
        return worn
