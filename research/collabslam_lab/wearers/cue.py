"""Where to look (METHOD 23): is the foretold gain the real one, and does following it help?"""

from __future__ import annotations

from concurrent.futures import as_completed

import numpy as np

from collabslam.runs.progress import Progress
from collabslam.runs.report import number
from collabslam.types import Array
from collabslam_lab.engines import Engine
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.wearers.looking_way import EVERY, POLICIES, RATE, STARTS, Looked, look_along

FRAMES, QUICK_FRAMES = 60, 17
QUICK_WAYS = 2
AIMS = {"gain_correlation": 0.7, "error_over_random": 0.7, "error_over_best": 1.1, "ms": 5.0}
COLUMNS = ("foretold", "gained", "expected", "matched")

Ways = list[dict[str, list[Looked]]]


def make(*, seed: int, jobs: int, engine: Engine, quick: bool) -> Finding:
    """All ways, all policies."""
    ways = _walked(
        QUICK_WAYS if quick else len(STARTS), QUICK_FRAMES if quick else FRAMES, seed, jobs, engine
    )
    tried = [looked for way in ways for looked in way["best"]]
    views = np.array([[v for looked in tried for v in getattr(looked, name)] for name in COLUMNS]).T
    foretold, gained, expected, matched = views.T
    errors = {policy: _error(ways, policy) for policy in POLICIES}
    numbers = {
        "gain_correlation": _correlation(foretold, gained),
        "error_over_random": errors["cue"] / errors["random"],
        "error_over_best": errors["cue"] / errors["best"],
        "ms": float(np.median([ms for way in ways for looked in way["cue"] for ms in looked.ms])),
        "matches_correlation": _correlation(expected, matched),
        "matches_over_expected": float(matched.sum() / expected.sum()),
        "error_m": errors,
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
    by_policy = [[policy, number(100.0 * errors[policy], 2)] for policy in POLICIES]
    return Finding(
        title="Where to look",
        figure=figure,
        tables=[
            Table("Aims:", ("number", "reached", "aim"), aims),
            Table(
                f"Mean error of the position over the way, RMS over {len(ways)} ways, by where the person "
                f"looks every {EVERY / RATE:g} s:",
                ("policy", "cm"),
                by_policy,
            ),
        ],
        verdict="A random direction is one in which some landmark is in Cf's image; the best one is found by "
        "taking all of these views and keeping the one that left pose and scale best known.",
        numbers=numbers,
        columns=COLUMNS,
        rows=views.tolist(),
    )


def _walked(count: int, frames: int, seed: int, jobs: int, engine: Engine) -> Ways:
    with Progress(count, "where to look", unit="way") as bar:
        if jobs == 1 and engine.is_local:
            ways = []
            for way in range(count):
                ways.append(look_along(way, frames, seed))
                bar.update()
            return ways
        with engine.pool(jobs) as pool:
            futures = [pool.submit(look_along, way, frames, seed) for way in range(count)]
            for _ in as_completed(futures):
                bar.update()
            return [future.result() for future in futures]


def _error(ways: Ways, policy: str) -> float:
    """RMS over ways and draws of the mean error of the position, metres."""
    return float(np.sqrt(np.mean([looked.error**2 for way in ways for looked in way[policy]])))


def _correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])
