"""What a simulation is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from collabslam_lab.paper_simulation.estimators import Estimator


@dataclass(frozen=True)
class Case:
    """A Monte Carlo, without its number of runs.

    Attributes
    ----------
    model : str
        Of `monte_carlo.MODELS`.
    estimator : Estimator
    collaboration : str
        How Cf helps in the windows; ``mono``: not at all.
    range_sigma : float or None
        Standard deviation of Cf's range, metres; the setting's if None.
    """

    model: str
    estimator: Estimator
    collaboration: str
    range_sigma: float | None = None
