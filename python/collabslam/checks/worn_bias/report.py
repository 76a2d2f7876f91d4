"""What was found of T_CF's time-correlated error, in sentences."""

from __future__ import annotations

import numpy as np

from collabslam.checks.worn_bias.fit import AXES, BiasFit
from collabslam.types import Array

_UNITS = np.array([100.0] * 3 + [180.0 / np.pi] * 3 + [1000.0])
_NAMES = ("cm", "cm", "cm", "degrees", "degrees", "degrees", "ms")
_SHARE = 0.3
"""Least part of a direction that is named."""
_LIKE_BASELINE = 0.9
_REDUCED_CHI2 = 3.0
"""Squared residuals over what they should be from which on the correction is not believed."""


def rows(fit: BiasFit) -> list[list[str]]:
    """Name, correction and standard deviation of each of the seven numbers."""
    values = np.append(fit.calibration.correction, fit.calibration.clock) * _UNITS
    return [
        [f"T_CF, {name}" if name != "clock" else "clock of Cf", f"{value:+.2f} +- {sd:.2f} {unit}"]
        for name, value, sd, unit in zip(AXES, values, fit.sd * _UNITS, _NAMES, strict=True)
    ]


def believed(fit: BiasFit) -> bool:
    """Whether one correction explains the views, and any of it is told."""
    return fit.reduced_chi2 < _REDUCED_CHI2 and len(fit.untold) < len(AXES)


def sentences(fit: BiasFit, baseline: Array) -> list[str]:
    """What the views do not tell and why, and whether the correction explains them.

    Parameters
    ----------
    fit : BiasFit
    baseline : (3,) array
        Mean direction from Cs to Cf, along C's axes.
    """
    out = [_untold(direction, baseline) for direction in fit.untold]
    if fit.reduced_chi2 >= _REDUCED_CHI2:
        out.append(
            "No time-correlated error explains the views: their residuals are "
            f"{np.sqrt(fit.reduced_chi2):.1f} times what they should be; T_CF's covariance is too small, "
            "or its error changes."
        )
    return out


def _untold(direction: Array, baseline: Array) -> str:
    parts = [
        f"{value:+.1f} {name}" for value, name in zip(direction, AXES, strict=True) if abs(value) >= _SHARE
    ]
    why = "the motion does not tell it; let Cs and Cf turn and change speed by themselves"
    shift = float(np.linalg.norm(direction[:3]))
    if abs(direction[6]) >= _SHARE:
        why = (
            "Cs moves evenly, and a clock that is off looks like a Cf that is elsewhere; start, stop and turn"
        )
    elif shift > _LIKE_BASELINE and abs(direction[:3] @ baseline) > _LIKE_BASELINE * shift * float(
        np.linalg.norm(baseline)
    ):
        why = "it is the length of T_CF, which is the scale; walk to another side of Cs, or give true poses"
    elif shift > _LIKE_BASELINE:
        why = (
            "T_CF hardly changes, so that this is the scale or nothing; walk to another side, nearer, farther"
        )
    return f"Left as it is: {' '.join(parts)} (in what was thought possible): {why}."
