"""``collabslam-lab evaluate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import NOT_TRUSTED, OK, options
from collabslam.cli.engine_options import add_engine, engine_of
from collabslam.formats.yaml_text import load_yaml
from collabslam.settings.modes import MODES
from collabslam_lab.benchmark.leave_one_out import Candidates
from collabslam_lab.benchmark.studies import STUDIES

_PLAN = """\
A plan is a YAML file:

  seeds: 0-4                     # or a list; of the noise of T_CF
  defaults: {available: 0.4}     # options of every recording
  recordings:
    kitchen:                     # a name, and the folder below DATA_DIR unless 'folder' says another one
      worn: lag:2.0              # lag:SECONDS, rig, views:FOLDER, recorded, none; left out: as recorded
      truth: poses/frames.txt    # stamped poses of Cs (TUM), in place of the recording's own
      view_poses: poses/keys.txt # those of the images of views:FOLDER, which Cs took at other times
      altered: mirrored          # or backwards, later: recordings that nothing was chosen on; lag: or none
      available: 0.4             # share of each period that Cf is there, from its beginning
      period: 5.0                # seconds
      noise: [0.03, 0.5, 0.5, 1] # of T_CF: metres, degrees of roll, pitch, yaw; a rig: 0.002, 0.05 each
      calibration_sd: [0.005, 2, 0.01] # wrong on purpose: focal length, centre in px, distortion k1
      start: worn                # worn, target or scale-free
      modes: [mono, collab]
      independent: [collab]      # modes run once more with an error of T_CF of its own in each frame
      draws: [relpose, seed1/relpose] # recorded in two-camera layout: folders of T_CF, one for each seed
      scored: true               # false: the truth is not a judge and serves the worn camera only
      settings: {filter.map.in_view: 60}
      reference: {system: ORB-SLAM3, ate_sim3_pct: 0.94, poses: 476}
    demo: {rendered: demo}   # needs no folder
  ablation:                      # --ablation
    seeds: 0-2
    modes: [collab]
    levers: {no conditional gate: {filter.validate.conditional_level: 1.0}}

What is done, with the same recording, settings, options and version, is not run again."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = _PLAN
    parser.add_argument("data", metavar="DATA_DIR", type=Path, help="folder that holds the recordings")
    parser.add_argument(
        "--plan",
        metavar="FILE",
        type=Path,
        help="what to run (default: DATA_DIR/evaluate.yaml, or the package's own plan)",
    )
    parser.add_argument("--only", metavar="NAME,..", type=names, default=(), help="only these recordings")
    parser.add_argument("--seeds", metavar="A-B", type=options.seed_list, default=(), help="not the plan's")
    parser.add_argument("--modes", metavar="MODE,..", type=_modes, default=(), help="only these modes")
    studies = parser.add_mutually_exclusive_group()
    for study, what in STUDIES.items():
        studies.add_argument(f"--{study}", dest="study", action="store_const", const=study, help=what)
    studies.add_argument(
        "--choose",
        metavar="KEY=V,V,..",
        type=_candidates,
        help="which value of a setting the recordings choose, each one left out in turn, instead",
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/evaluate"), help=options.OUT_HELP
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="processes at a time (default 2)")
    add_engine(parser)
    parser.add_argument(
        "--against", metavar="DIR", type=Path, help="compare with an earlier evaluation, row by row"
    )
    parser.add_argument("--again", action="store_true", help="run also what is done")
    parser.add_argument("--dry-run", action="store_true", help="only say what there is to do, and its cost")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting of every run"
    )


def main(arguments: argparse.Namespace) -> int:
    """Run the plan, print the page."""
    from collabslam.settings.table import parse_assignments
    from collabslam_lab.benchmark.evaluate import Choice, evaluate, failed

    choice = Choice(
        plan=arguments.plan,
        only=arguments.only,
        seeds=arguments.seeds,
        modes=arguments.modes,
        study=arguments.study,
        changes=parse_assignments(arguments.set),
        jobs=arguments.jobs,
        engine=engine_of(arguments),
        again=arguments.again,
        dry=arguments.dry_run,
        against=arguments.against,
        candidates=arguments.choose,
    )
    return NOT_TRUSTED if failed(evaluate(arguments.data, arguments.out, choice)) else OK


def names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _candidates(text: str) -> Candidates:
    key, _, values = text.partition("=")
    if not key or len(names(values)) < 2:
        raise argparse.ArgumentTypeError(f"'{text}' has no setting with two values; give KEY=V,V")
    return Candidates(key, [load_yaml(value) for value in names(values)])


def _modes(text: str) -> tuple[str, ...]:
    modes = names(text)
    for mode in modes:
        if mode not in MODES:
            raise argparse.ArgumentTypeError(f"there is no mode '{mode}'; there are {', '.join(MODES)}")
    return modes
