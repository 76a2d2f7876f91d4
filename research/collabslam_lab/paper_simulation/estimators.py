"""The estimators that are compared in the 2-DoF simulation."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimator:
    """How a filter of the 2-DoF simulation works.

    Attributes
    ----------
    name : str
        Key in result files.
    label : str
    first_pose : str
        ``clone`` (kept in the state), ``independent`` (remembered with its covariance, correlations dropped)
        or
        ``perfect`` (taken as exact): the pose from which a delayed feature was first seen.
    first_jacobians : bool
        Whether features enter the Jacobians at their first estimate.
    gauge : bool
        Whether the covariance moves with the gauge directions.
    inflated : bool
        Whether the noise of Cs's bearings is taken larger by the setting ``inflation``.
    """

    name: str
    label: str
    first_pose: str = "clone"
    first_jacobians: bool = False
    gauge: bool = False
    inflated: bool = False


PLAIN = Estimator("plain", "plain EKF, first pose cloned")
GAUGE = Estimator("gauge", "gauge transport, inflated noise", gauge=True, inflated=True)

ESTIMATORS = (
    PLAIN,
    Estimator("independent", "first pose independent (the paper)", first_pose="independent"),
    Estimator("perfect", "first pose taken as exact", first_pose="perfect"),
    Estimator("fej", "first-estimates Jacobians", first_jacobians=True),
    Estimator("inflated", "plain EKF, inflated noise", inflated=True),
    Estimator("gauge-only", "gauge transport, noise as it is", gauge=True),
    GAUGE,
)
"""In the order of the tables."""
