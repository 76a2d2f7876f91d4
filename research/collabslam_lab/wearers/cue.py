"""Where to look: is the foretold gain the real one, and does following it help? METHOD, section 24."""

from __future__ import annotations

import numpy as np

from collabslam.runs.progress import Progress
from collabslam.runs.report import number
from collabslam.types import Array
from collabslam_lab.engines import Engine
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.wearers.looking_way import EVERY, POLICIES, RATE, Looked, look_along

FRAMES, QUICK_FRAMES = 45, 17
WAYS, QUICK_WAYS = 24, 2
RESAMPLED = 2000
"""Drawings of ways for an interval."""
AIMS = {"gain_correlation": 0.7, "error_over_random": 0.7, "error_over_best": 1.1, "ms": 5.0}
COLUMNS = ("foretold", "gained", "expected", "matched")

Ways = list[dict[str, list[Looked]]]


def make(*, seed: int, jobs: int, engine: Engine, quick: bool) -> Finding:
    """All ways, all policies."""
    ways = _walked(QUICK_WAYS if quick else WAYS, QUICK_FRAMES if quick else FRAMES, seed, jobs, engine)
    tried = [looked for way in ways for looked in way["best"]]
    views = np.array([[v for looked in tried for v in getattr(looked, name)] for name in COLUMNS]).T
    foretold, gained, expected, matched = views.T
    errors = {policy: _rms(_squares(ways, policy)) for policy in POLICIES}
    said = {policy: _rms(_squares(ways, policy, "sd")) for policy in POLICIES}
    ratios = {policy: _ratio(ways, policy, seed) for policy in POLICIES if policy != "cue"}
    numbers = {
        "gain_correlation": _correlation(foretold, gained),
        "error_over_random": ratios["random"][0],
        "error_over_best": ratios["best"][0],
        "ms": float(np.median([ms for way in ways for looked in way["cue"] for ms in looked.ms])),
        "matches_correlation": _correlation(expected, matched),
        "matches_over_expected": float(matched.sum() / expected.sum()),
        "error_m": errors,
        "sd_m": said,
        "error_over": ratios,
        "ways": len(ways),
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
                f"Error of the position from the first look on, RMS over {len(ways)} ways (the best choice: "
                f"{len(_squares(ways, 'best'))}), by where the person looks every {EVERY / RATE:g} s:",
                ("policy", "cm", "cm by its own covariance", "error by the cue over it (95 %)"),
                by_policy,
            ),
        ],
        verdict="A person can look in any direction of a grid of 15 degrees. Anywhere: in any; random: "
        "in any in which some landmark is in Cf's image; best: all views that the filter compares are taken, "
        "and the one that left pose and scale best known is kept. Ratios are over the same ways, which are "
        "drawn anew for the intervals.",
        numbers=numbers,
        columns=COLUMNS,
        rows=views.tolist(),
    )


def _walked(count: int, frames: int, seed: int, jobs: int, engine: Engine) -> Ways:
    with Progress(count, "where to look", unit="way") as bar:
        return engine.in_order(look_along, [(way, frames, seed) for way in range(count)], jobs, bar.update)


def _squares(ways: Ways, policy: str, name: str = "error") -> Array:
    """Of each way that has the policy, the mean square over its draws of an error of the position, m^2."""
    return np.array(
        [np.mean([getattr(looked, name) ** 2 for looked in way[policy]]) for way in ways if way[policy]]
    )


def _rms(squares: Array) -> float:
    return float(np.sqrt(squares.mean()))


def _ratio(ways: Ways, policy: str, seed: int) -> tuple[float, float, float]:
    """RMS error by the cue over that of a policy on the same ways, and the ends of its 95 % interval."""
    pairs = [way for way in ways if way[policy]]
    cue, other = _squares(pairs, "cue"), _squares(pairs, policy)
    drawn = np.random.Generator(np.random.PCG64(seed)).integers(len(pairs), size=(RESAMPLED, len(pairs)))
    low, high = np.percentile(np.sqrt(cue[drawn].mean(axis=1) / other[drawn].mean(axis=1)), (2.5, 97.5))
    return _rms(cue) / _rms(other), float(low), float(high)


def _as_text(ratio: tuple[float, float, float] | None) -> str:
    return "" if ratio is None else "{:.2f} ({:.2f} to {:.2f})".format(*ratio)


def _correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])
