"""``collabslam-lab reproduce``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from collabslam.cli import OK, options
from collabslam.cli.engine_options import add_engine, engine_of
from collabslam.extras import needs

WORLDS = "worlds"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from collabslam_lab import (
        calibrated,
        learned,
        long_trajectories,
        paper_simulation,
        paper_worlds,
        worn_cameras,
    )
    from collabslam_lab.paper_simulation.simulation_settings import SIMULATION

    simulated = [f"  {name:14} {text}" for name, text in paper_simulation.EXPERIMENTS.items()]
    rendered = [f"  {name:14} {text}" for name, text in paper_worlds.EXPERIMENTS.items()]
    by_learning = [f"  {name:14} {text}" for name, text in learned.EXPERIMENTS.items()]
    worn = [f"  {name:14} {text}" for name, text in worn_cameras.EXPERIMENTS.items()]
    long = [f"  {name:14} {text}" for name, text in long_trajectories.EXPERIMENTS.items()]
    corrected = [f"  {name:14} {text}" for name, text in calibrated.EXPERIMENTS.items()]
    settings = [
        f"  {key}={entry.default:g}{' ' + entry.unit if entry.unit else ''}: {entry.doc}"
        for key, entry in SIMULATION.items()
    ]
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "\n".join(
        [
            "names of simulations, all of them: all",
            *simulated,
            "",
            "names of experiments in rendered worlds, all of them: paper",
            *rendered,
            "",
            "names of experiments with learned descriptors, of the rendered demo and of --data's recordings:",
            *by_learning,
            "",
            "what sets these worlds, beside recordings (needs --data):",
            f"  {WORLDS:14} what the tracker makes of worlds and of recordings",
            "",
            "names of experiments about those who wear a camera:",
            *worn,
            "",
            "names of experiments on long trajectories:",
            *long,
            "",
            "what finding T_CF's bias is worth, on rendered trajectories and on --data's recordings:",
            *corrected,
            "",
            "settings of the simulation:",
            *settings,
        ]
    )
    names = [
        *paper_simulation.EXPERIMENTS,
        *paper_worlds.EXPERIMENTS,
        *learned.EXPERIMENTS,
        WORLDS,
        *worn_cameras.EXPERIMENTS,
        *long_trajectories.EXPERIMENTS,
        *calibrated.EXPERIMENTS,
        "all",
        "paper",
    ]
    parser.add_argument("names", metavar="NAME", nargs="+", choices=names, help="see below, or all, or paper")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/reproduce"), help=options.OUT_HELP
    )
    parser.add_argument(
        "--data", metavar="DIR", type=Path, help="recordings for `worlds`, as for `collabslam-lab evaluate`"
    )
    parser.add_argument(
        "--runs", metavar="N", type=int, default=200, help="Monte Carlo runs of a simulation (default 200)"
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of all noise of a simulation (default 0)"
    )
    parser.add_argument(
        "--seeds",
        metavar="A-B",
        type=options.seed_list,
        help="of all noise, of experiments in rendered worlds (default 0-9; 0 with --quick)",
    )
    parser.add_argument(
        "--plain", action="store_true", help="rendered worlds that are short and easy, not those of life"
    )
    parser.add_argument("--jobs", metavar="N", type=int, help="processes at a time (default: all cores)")
    add_engine(parser)
    parser.add_argument(
        "--quick", action="store_true", help="few recordings of each experiment: to see that it works"
    )
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="change one setting of the simulation, as listed below; may be repeated",
    )


def main(arguments: argparse.Namespace) -> int:
    """Run simulations and experiments, write their files, print their pages."""
    from collabslam.errors import SettingsError
    from collabslam.settings.table import parse_assignments
    from collabslam_lab import (
        calibrated,
        learned,
        long_trajectories,
        paper_simulation,
        paper_worlds,
        worn_cameras,
    )

    jobs = (os.cpu_count() or 1) if arguments.jobs is None else arguments.jobs
    if WORLDS in arguments.names and arguments.data is None:
        raise SettingsError(f"'{WORLDS}' compares with recordings: say with --data DIR where they are.")
    simulations = _asked(arguments.names, list(paper_simulation.EXPERIMENTS), "all")
    if simulations:
        paper_simulation.reproduce(
            simulations,
            arguments.out,
            runs=arguments.runs,
            seed=arguments.seed,
            jobs=jobs,
            engine=engine_of(arguments),
            changes=parse_assignments(arguments.set),
        )
    in_worlds = _asked(arguments.names, list(paper_worlds.EXPERIMENTS), "paper")
    if in_worlds:
        paper_worlds.run_experiments(
            in_worlds,
            arguments.out,
            seeds=arguments.seeds or ([0] if arguments.quick else list(range(10))),
            jobs=jobs,
            engine=engine_of(arguments),
            quick=arguments.quick,
            plain=arguments.plain,
        )
    if set(arguments.names) & set(learned.EXPERIMENTS):
        from collabslam_lab.learned.viewpoints import reproduce

        print(reproduce(arguments.out, arguments.data, seed=arguments.seed, quick=arguments.quick))
    if WORLDS in arguments.names:
        with needs("plot"):
            from collabslam_lab.appearance.compare import compare_worlds
        compare_worlds(
            arguments.data, arguments.out, jobs=jobs, engine=engine_of(arguments), quick=arguments.quick
        )
    of_worn_cameras = _asked(arguments.names, list(worn_cameras.EXPERIMENTS))
    if of_worn_cameras:
        worn_cameras.run_experiments(
            of_worn_cameras,
            arguments.out,
            seed=arguments.seed,
            jobs=jobs,
            engine=engine_of(arguments),
            quick=arguments.quick,
        )
    if set(arguments.names) & set(calibrated.EXPERIMENTS):
        with needs("plot"):
            from collabslam_lab.calibrated.study import reproduce as study_calibration
        study_calibration(
            arguments.out,
            arguments.data,
            seed=arguments.seed,
            jobs=jobs,
            engine=engine_of(arguments),
            quick=arguments.quick,
        )
    if set(arguments.names) & set(long_trajectories.EXPERIMENTS):
        long_trajectories.study_loops(
            arguments.out,
            seeds=arguments.seeds,
            jobs=jobs,
            engine=engine_of(arguments),
            quick=arguments.quick,
        )
    return OK


def _asked(names: list[str], known: list[str], every: str | None = None) -> list[str]:
    """Those of `known` that are asked for, in the order given; all if `every` is."""
    return known if every in names else [n for n in dict.fromkeys(names) if n in known]
