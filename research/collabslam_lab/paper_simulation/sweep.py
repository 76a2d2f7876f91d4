"""The sweep over sigma_r that figures 9 and 10 share."""

from __future__ import annotations

from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.estimators import GAUGE, PLAIN, Estimator
from collabslam_lab.paper_simulation.monte_carlo import Study
from collabslam_lab.paper_simulation.wall_run import RunOutcome

SIGMAS = (0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)
"""Metres; the paper's range."""
SHOWN = (0.25, 0.5, 0.75, 1.0)
"""Those whose curves are drawn."""

CURVES = (
    ("wall", PLAIN, "independent"),
    ("wall", PLAIN, "shared"),
    ("wall", GAUGE, "independent"),
    ("core", PLAIN, "independent"),
)
Key = tuple[str, str, str]


def sigmas_of(key: Key) -> tuple[float, ...]:
    """Where a curve is run: the plain EKF everywhere, the others where their curves are drawn."""
    return SIGMAS if key == ("wall", PLAIN.name, "independent") else SHOWN


def gather(study: Study, label: str) -> tuple[dict[Key, RunOutcome], dict[tuple[Key, float], RunOutcome]]:
    """Outcomes without pseudo-stereo by curve, and with it by curve and sigma_r."""
    reference = float(study.settings.range_sigma)
    mono, swept = {}, {}
    for model, estimator, collaboration in CURVES:
        key = (model, estimator.name, collaboration)
        mono[key] = Case(model, estimator, "mono")
        for sigma in sigmas_of(key):
            swept[key, sigma] = Case(model, estimator, collaboration, _given(sigma, reference))
    done = study.gather([*mono.values(), *swept.values()], label)
    return {k: done[r] for k, r in mono.items()}, {k: done[r] for k, r in swept.items()}


def name_of(key: Key) -> str:
    """A curve in words."""
    model, estimator, collaboration = key
    variant = "6-DoF core" if model == "core" else "2-DoF"
    kind: Estimator = PLAIN if estimator == PLAIN.name else GAUGE
    what = "plain EKF" if kind is PLAIN else "gauge transport"
    return f"{variant}, {what}, {collaboration} errors"


def _given(sigma: float, reference: float) -> float | None:
    """None for the reference, so that it is computed once for all figures."""
    return None if sigma == reference else sigma
