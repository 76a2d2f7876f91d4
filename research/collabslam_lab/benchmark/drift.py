"""How large the drift of the world frame is that no measurement shows, sized by maximum likelihood.

``filter.process.position_drift`` and ``attitude_drift`` enter the reported covariance of the pose only, and
linearly by their squares: ``C = C_0 + q_p^2 D_p + q_a^2 D_a``. So three runs with the same poses, (0, 0),
(1, 0) and (0, 1), give the three parts. Sizes are fitted on some recordings and held against others: each in
turn is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collabslam.evaluation.consistency import nees, nees_band, pose_tangent_error, sigma_gate
from collabslam.evaluation.scoring import OK_SIGMAS
from collabslam.runs.report import number
from collabslam.runs.runner import run
from collabslam.settings.table import Settings
from collabslam.types import Array
from collabslam_lab.benchmark.accuracy import band_word
from collabslam_lab.benchmark.running import open_entry
from collabslam_lab.benchmark.store import Item
from collabslam_lab.report import markdown_table
from collabslam_lab.switches import with_switches

POSITION, ATTITUDE = "filter.process.position_drift", "filter.process.attitude_drift"
_THINNED = 10  # poses of a run in the likelihood: neighbours say the same
_POSITIONS, _ATTITUDES = np.geomspace(0.002, 0.2, 21), np.geomspace(0.02, 4.0, 24)


@dataclass(frozen=True)
class Parts:
    """One run: errors (N, 6) of its poses, their covariance (N, 6, 6) without drift, what the drifts add."""

    errors: Array
    own: Array
    by_position: Array
    by_attitude: Array

    def covariance(self, position: float, attitude: float) -> Array:
        """(N, 6, 6) with drifts of those sizes."""
        return np.asarray(self.own + position**2 * self.by_position + attitude**2 * self.by_attitude)

    def thinned(self) -> Parts:
        """A few of the poses, evenly."""
        rows = np.unique(np.linspace(0, len(self.errors) - 1, _THINNED + 1).round().astype(int))[1:]
        return Parts(*(x[rows] for x in (self.errors, self.own, self.by_position, self.by_attitude)))


def measure(item: Item) -> Parts | None:
    """The parts of one run; None if it has no truth or never starts.

    Raises
    ------
    CollabslamError
        If the recording cannot be opened.
    """
    recording = open_entry(item)
    covariances, errors, use = [], None, None
    for sizes in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        changes = dict(zip((POSITION, ATTITUDE), sizes, strict=True))
        settings = with_switches(item.settings, changes)
        result = run(recording, mode=item.used_mode, start=item.entry.start, settings=settings)
        if result.truth is None:
            return None
        if errors is None:
            use = result.truth.known & result.record.valid
            use[result.truth.start] = False
            errors = pose_tangent_error(result.record.poses[use], result.truth.poses[use])
        covariances.append(result.record.covariances[use])
    assert errors is not None
    return Parts(errors, covariances[0], *(c - covariances[0] for c in covariances[1:]))


def fit(runs: Mapping[str, Sequence[Parts]]) -> tuple[float, float]:
    """Most likely (position, attitude) drift for Gaussian errors; every recording weighs the same."""
    thin = [[part.thinned() for part in parts] for parts in runs.values()]

    def cost(position: float, attitude: float) -> float:
        return float(sum(np.mean([_surprise(p, position, attitude) for p in parts]) for parts in thin))

    found = min((cost(p, a), p, a) for p in _POSITIONS for a in _ATTITUDES)
    return float(found[1]), float(found[2])


def _surprise(parts: Parts, position: float, attitude: float) -> float:
    """Mean negative log-likelihood of the errors, but for a constant."""
    covariance = parts.covariance(position, attitude) + 1e-12 * np.eye(6)
    weighted = np.linalg.solve(covariance, parts.errors[..., None])[..., 0]
    return float(np.mean(np.linalg.slogdet(covariance)[1] + (parts.errors * weighted).sum(axis=1)) / 2.0)


def honesty(runs: Sequence[Parts], position: float, attitude: float) -> tuple[float, float, float]:
    """Medians over runs: NEES of position and of attitude, and the share of poses within 5 sigma."""
    rows = []
    for parts in runs:
        e, p = parts.errors, parts.covariance(position, attitude)
        near = nees(e, p) <= sigma_gate(OK_SIGMAS, 6)
        rows.append([nees(e[:, :3], p[:, :3, :3]).mean(), nees(e[:, 3:], p[:, 3:, 3:]).mean(), near.mean()])
    middle = np.median(rows, axis=0)
    return float(middle[0]), float(middle[1]), float(middle[2])


def fits_of(runs: Mapping[str, Sequence[Parts]]) -> dict[str, tuple[float, float]]:
    """The sizes that each recording asks for by itself."""
    return {name: fit({name: parts}) for name, parts in runs.items()}


def page(
    runs: Mapping[str, Sequence[Parts]], fits: Mapping[str, tuple[float, float]], mode: str, how: str
) -> str:
    """What each recording asks for (``fits``), what the others ask for, and how honest these are."""
    default = Settings.default()
    chosen = (float(default.switch(POSITION)), float(default.switch(ATTITUDE)))
    band = nees_band(3)
    lines = []
    for name, parts in runs.items():
        others = {k: v for k, v in runs.items() if k != name}
        cells = [name]
        for sizes in (fits[name], fit(others) if others else chosen, chosen):
            position, attitude, near = honesty(parts, *sizes)
            cells += [f"{sizes[0]:.3f}, {sizes[1]:.2f}"]
            cells += [f"{number(position, 2)} {band_word(position, *band)}"]
            cells += [f"{number(attitude, 2)} {band_word(attitude, *band)}", number(100.0 * near, 1)]
        lines.append(cells)
    three = ("drift", "NEES position", "NEES attitude", "within 5 sigma, %")
    whose = ("itself", "the others", "default")
    header = ("recording", *(f"{who}: {what}" for who in whose for what in three))
    return (
        f"# Size of the drift\n\n```sh\n{how}\n```\n\n"
        "The drift of the world frame (`process.position_drift` in m/m^0.5, `process.attitude_drift` in "
        "deg/s^0.5) stands for what no measurement shows. Sizes are those that make the errors of the poses "
        f"most likely, in mode `{mode}`: fitted to the recording itself, fitted to all others, and the "
        f"default. Behind a NEES: *yes* inside {band[0]:.2f} to {band[1]:.2f}, the 95 % band of one draw; "
        "*x2* within a factor of 2 of it.\n\n" + markdown_table(header, lines) + "\n"
    )


def drift_items(items: Sequence[Item], mode: str) -> list[Item]:
    """The runs to take apart: one mode, independent errors."""
    return [replace(item, lever="drift") for item in items if item.mode == mode and not item.independent]
