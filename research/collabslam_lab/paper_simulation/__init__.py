"""The paper's simulation and observability, reproduced and corrected: what ``collabslam-lab reproduce`` runs.

An experiment is a module with a function ``make(study) -> Finding``; `EXPERIMENTS` lists them. Modules are
imported when they are needed.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collabslam.batch.engines import Engine

EXPERIMENTS = {
    "observability": "what can be told from bearings, and what depth adds (section 3.3)",
    "fig7": "map and trajectory of one simulated run",
    "fig8": "drift of scale, error of position and consistency of every estimator over time",
    "fig9": "error of position over time for several sigma_r",
    "fig10": "average error against sigma_r",
    "consistency": "not in the paper: NEES of the 6-DoF filter, without and with the gauge transport",
    "worn-pose": "not in the paper: error and NEES of the worn camera's pose from laser scans and AHRSs",
}
"""Name (also of its module, with _ for -) and what it shows."""


def reproduce(
    names: Sequence[str],
    out: Path,
    *,
    runs: int,
    seed: int,
    jobs: int,
    engine: Engine | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: bool = True,
) -> dict[str, dict[str, Any]]:
    """Run experiments by name, write NAME.png, .csv, .json and .md into ``out``, print the Markdown.

    Parameters
    ----------
    names : sequence of str
        Of `EXPERIMENTS`.
    out : Path
    runs : int
        Of the 2-DoF Monte Carlo.
    seed : int
    jobs : int
        Processes.
    engine : Engine, optional
        Where they run; on this machine if left out.
    changes : mapping, optional
        Settings of the simulation over the defaults of `simulation_settings.SIMULATION`.
    progress : bool

    Returns
    -------
    dict
        What the JSON files hold, by name.

    Raises
    ------
    SettingsError
        For an unknown name or setting, or an impossible value.
    DataError
        If the folder cannot be written, or matplotlib is missing.
    """
    from collabslam.batch.engines import LOCAL
    from collabslam.errors import SettingsError
    from collabslam.extras import needs
    from collabslam.formats.files import try_place
    from collabslam_lab.paper_simulation.monte_carlo import Study
    from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings

    for name in names:
        if name not in EXPERIMENTS:
            raise SettingsError(
                f"There is no experiment '{name}'; there are {', '.join(EXPERIMENTS)}, and all."
            )
    with needs("plot"):
        from collabslam_lab.figures.finding import hand_over
    numbers = {}
    overrides = "".join(f" --set {key}={value}" for key, value in (changes or {}).items())
    settings = SimulationSettings(changes)
    for name in names:
        try_place(out / f"{name}.md")
    place = engine or LOCAL
    with Study(settings, runs=runs, seed=seed, jobs=jobs, engine=place, progress=progress) as study:
        for name in names:
            finding = importlib.import_module(
                f"collabslam_lab.paper_simulation.{name.replace('-', '_')}"
            ).make(study)
            how = f"collabslam-lab reproduce {name} --runs {runs} --seed {seed}{overrides}"
            numbers[name] = hand_over(out, name, finding, how)
    return numbers
