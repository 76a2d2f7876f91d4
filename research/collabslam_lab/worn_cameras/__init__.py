"""What those who wear a camera can do for the filter: ``collabslam-lab reproduce cue`` and ``persons``.

An experiment is a module with ``make(seed, jobs, engine, quick) -> Finding``.  Modules are imported when they
are needed.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collabslam.batch.engines import Engine

EXPERIMENTS = {
    "cue": "where to look: gains foretold and real, and the error that is left by following the advice",
    "persons": "several persons: consistency of the covariance, how much each more helps, and what it costs",
}
"""Name (also of its module) and what it shows."""


def run_experiments(
    names: Sequence[str],
    out: Path,
    *,
    seed: int,
    jobs: int,
    engine: Engine | None = None,
    quick: bool = False,
) -> dict[str, dict[str, Any]]:
    """Run experiments by name, write NAME.png, .csv, .json and .md into ``out``, print the Markdown.

    Parameters
    ----------
    names : sequence of str
        Of `EXPERIMENTS`.
    out : Path
    seed : int
        Of all noise.
    jobs : int
        Processes, each with one thread.
    engine : Engine, optional
        Where they run; on this machine if left out.
    quick : bool
        A short part: to see that it works, not to compare numbers.

    Returns
    -------
    dict
        What the JSON files hold, by name.

    Raises
    ------
    SettingsError
        For an impossible number.
    DataError
        If the folder cannot be written, or matplotlib is missing.
    """
    from collabslam.batch.engines import LOCAL
    from collabslam.errors import SettingsError
    from collabslam.extras import needs

    if jobs < 1 or seed < 0:
        raise SettingsError(f"jobs {jobs}, seed {seed}: give 1 job or more, seed 0 or more.")
    with needs("plot"):
        from collabslam_lab.figures.finding import hand_over
    numbers = {}
    for name in names:
        module = importlib.import_module(f"collabslam_lab.worn_cameras.{name}")
        finding = module.make(seed=seed, jobs=jobs, engine=engine or LOCAL, quick=quick)
        how = f"collabslam-lab reproduce {name} --seed {seed}{' --quick' if quick else ''}"
        numbers[name] = hand_over(out, name, finding, how)
    return numbers
