"""Where to look: is the foretold gain the real one, and does following it help? METHOD, section 24."""

from __future__ import annotations

import numpy as np

from collabslam.batch.engines import Engine
from collabslam.runs.progress import Progress
from collabslam.runs.report import number
from collabslam.types import Array
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.worn_cameras.planned_views import EVERY, POLICIES, RATE, PlannedViews, plan_along

FRAMES, QUICK_FRAMES = 45, 17
TRAJECTORIES, QUICK_TRAJECTORIES = 24, 2
RESAMPLED = 2000
"""Drawings of trajectories for an interval."""
AIMS = {"gain_correlation": 0.7, "error_over_random": 0.7, "error_over_best": 1.1, "ms": 5.0}
COLUMNS = ("foretold", "gained", "expected", "matched")

Trajectories = list[dict[str, list[PlannedViews]]]


def make(*, seed: int, jobs: int, engine: Engine, quick: bool) -> Finding:
    """All trajectories, all policies."""
    trajectories = _walked(
        QUICK_TRAJECTORIES if quick else TRAJECTORIES, QUICK_FRAMES if quick else FRAMES, seed, jobs, engine
    )
    tried = [looked for trajectory in trajectories for looked in trajectory["best"]]
    views = np.array([[v for looked in tried for v in getattr(looked, name)] for name in COLUMNS]).T
    foretold, gained, expected, matched = views.T
    errors = {policy: _rms(_squares(trajectories, policy)) for policy in POLICIES}
    said = {policy: _rms(_squares(trajectories, policy, "sd")) for policy in POLICIES}
    ratios = {policy: _ratio(trajectories, policy, seed) for policy in POLICIES if policy != "cue"}
    numbers = {
        "gain_correlation": _correlation(foretold, gained),
        "error_over_random": ratios["random"][0],
        "error_over_best": ratios["best"][0],
        "ms": float(
            np.median([ms for trajectory in trajectories for looked in trajectory["cue"] for ms in looked.ms])
        ),
        "matches_correlation": _correlation(expected, matched),
        "matches_over_expected": float(matched.sum() / expected.sum()),
        "error_m": errors,
        "sd_m": said,
        "error_over": ratios,
        "trajectories": len(trajectories),
        "views": len(views),
    }
    figure, panels = style.canvas(1, 2, (11.0, 4.6), "Where to look")
    axes = panels[0, 0]
    axes.plot(foretold, gained, ".", color=style.COLLAB, alpha=0.5)
    axes.plot([0.0, foretold.max()], [0.0, foretold.max()], color=style.GREY, linewidth=1.0)
    axes.set_xlabel("foretold gain of a view (nats)")
    axes.set_ylabel("what it gained (nats)")
    axes = panels[0, 1]
    axes.bar(POLICIES, [100.0 * errors[policy] for policy in POLICIES], color=style.COLLAB)
    axes.set_ylabel("error of the position (cm)")
    aims = [
        [name, number(numbers[name], 2), f"{'at least' if name == 'gain_correlation' else 'at most'} {aim:g}"]
        for name, aim in AIMS.items()
    ]
    by_policy = [
        [policy, *(number(100.0 * of[policy], 2) for of in (errors, said)), _as_text(ratios.get(policy))]
        for policy in POLICIES
    ]
    return Finding(
        title="Where to look",
        figure=figure,
        tables=[
            Table("Aims:", ("number", "reached", "aim"), aims),
            Table(
                f"Error of the position from the first look on, RMS over {len(trajectories)} trajectories "
                f"(the best choice: {len(_squares(trajectories, 'best'))}), "
                f"by where the person looks every {EVERY / RATE:g} s:",
                ("policy", "cm", "cm by its own covariance", "error by the cue over it (95 %)"),
                by_policy,
            ),
        ],
        verdict="A person can look in any direction of a grid of 15 degrees. Anywhere: in any; random: "
        "in any in which some landmark is in Cf's image; best: all views that the filter compares are taken, "
        "and the one that left pose and scale best known is kept. Ratios are over the same trajectories, "
        "which are drawn anew for the intervals.",
        numbers=numbers,
        columns=COLUMNS,
        rows=views.tolist(),
    )


def _walked(count: int, frames: int, seed: int, jobs: int, engine: Engine) -> Trajectories:
    with Progress(count, "where to look", unit="run") as bar:
        return engine.in_order(
            plan_along, [(trajectory, frames, seed) for trajectory in range(count)], jobs, bar.update
        )


def _squares(trajectories: Trajectories, policy: str, name: str = "error") -> Array:
    """Of each trajectory that has the policy, the mean square over its draws of a position's error, m^2."""
    return np.array(
        [
            np.mean([getattr(looked, name) ** 2 for looked in trajectory[policy]])
            for trajectory in trajectories
            if trajectory[policy]
        ]
    )


def _rms(squares: Array) -> float:
    return float(np.sqrt(squares.mean()))


def _ratio(trajectories: Trajectories, policy: str, seed: int) -> tuple[float, float, float]:
    """RMS error by the cue over a policy's on the same trajectories, and the ends of its 95 % interval."""
    pairs = [trajectory for trajectory in trajectories if trajectory[policy]]
    cue, other = _squares(pairs, "cue"), _squares(pairs, policy)
    drawn = np.random.Generator(np.random.PCG64(seed)).integers(len(pairs), size=(RESAMPLED, len(pairs)))
    low, high = np.percentile(np.sqrt(cue[drawn].mean(axis=1) / other[drawn].mean(axis=1)), (2.5, 97.5))
    return _rms(cue) / _rms(other), float(low), float(high)


def _as_text(ratio: tuple[float, float, float] | None) -> str:
    return "" if ratio is None else "{:.2f} ({:.2f} to {:.2f})".format(*ratio)


def _correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])
