"""The paper's experiments with images, done again in rendered worlds: ``collabslam-lab reproduce table1`` ...

An experiment is a module with the recordings it needs, ``cases(quick)``, and ``make(results) -> Finding``.
Modules are imported when they are needed.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collabslam.batch.engines import Engine

EXPERIMENTS = {
    "table1": "ten corridors of 15 m: average errors without and with the worn camera (section 5.2)",
    "fig11": "figures 11 and 12: the worst and the average corridor",
    "fig13": "close turns of 90 and 180 degrees (section 5.3)",
    "table2": "ten ways with straights and turns: errors, overlap, tau, kappa, U (section 5.4, figure 14)",
    "fig15": "the same: error at the end against the share of time with overlap",
    "cost": "the same: what pseudo-stereo costs in time",
    "study": "the paper's future work: error against availability, overlap and noise of the worn camera",
}
"""Name (also of its module) and what it shows."""


def run_experiments(
    names: Sequence[str],
    out: Path,
    *,
    seeds: Sequence[int],
    jobs: int,
    engine: Engine | None = None,
    quick: bool = False,
    plain: bool = False,
    progress: bool = True,
) -> dict[str, dict[str, Any]]:
    """Run experiments by name, write NAME.png, .csv, .json and .md into ``out``, print the Markdown.

    Each recording's results are kept in ``out/recordings`` as they come in; a later call with the same
    settings, seed and version goes on from there.

    Parameters
    ----------
    names : sequence of str
        Of `EXPERIMENTS`.
    out : Path
    seeds : sequence of int
        Of all noise; the scenes are fixed.
    jobs : int
        Processes, each with one thread.
    engine : Engine, optional
        Where they run; on this machine if left out.
    quick : bool
        Only a few recordings of each set: to see that it works, not to compare numbers.
    plain : bool
        In the recipes as they are, short and easy, and not under the conditions of life.
    progress : bool

    Returns
    -------
    dict
        What the JSON files hold, by name.

    Raises
    ------
    SettingsError
        For an unknown name, or an impossible number.
    DataError
        If the folder cannot be written, or matplotlib is missing.
    """
    from collabslam.batch.engines import LOCAL
    from collabslam.errors import SettingsError
    from collabslam.extras import needs
    from collabslam_lab.paper_worlds.cases import gather

    for name in names:
        if name not in EXPERIMENTS:
            raise SettingsError(f"There is no experiment '{name}'; there are {', '.join(EXPERIMENTS)}.")
    if jobs < 1 or not seeds or min(seeds) < 0:
        raise SettingsError(f"jobs {jobs}, seeds {list(seeds)}: give 1 job or more, seeds of 0 or more.")
    with needs("plot"):
        from collabslam_lab.figures.finding import hand_over
    numbers = {}
    modules = {name: importlib.import_module(f"collabslam_lab.paper_worlds.{name}") for name in names}
    wanted = {
        name: [replace(case, seed=seed, plain=plain) for case in module.cases(quick) for seed in seeds]
        for name, module in modules.items()
    }
    # A world's seeds follow on each other: a process renders it once.
    every = [case for cases in wanted.values() for case in cases]
    results = gather(every, out / "recordings", jobs=jobs, progress=progress, engine=engine or LOCAL)
    for name, module in modules.items():
        finding = module.make([results[case] for case in wanted[name]])
        options = f"{' --plain' if plain else ''}{' --quick' if quick else ''}"
        how = f"collabslam-lab reproduce {name} --seeds {','.join(map(str, seeds))}{options}"
        numbers[name] = hand_over(out, name, finding, how)
    return numbers
