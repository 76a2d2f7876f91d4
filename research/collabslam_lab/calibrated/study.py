"""All draws of the error on all trajectories: the corrected filter against the calibrated one (METHOD 26)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from collabslam.batch.engines import LOCAL, Engine
from collabslam.errors import SettingsError
from collabslam.evaluation.consistency import nees_band
from collabslam.runs.progress import Progress
from collabslam.runs.report import number
from collabslam_lab.calibrated.draw import EVEN, RECORDED, Drawn, go
from collabslam_lab.calibrated.trajectories import DEGREES, METRES, SECONDS, WALKS
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table, hand_over

DRAWS, EVEN_DRAWS = 8, 2
"""Of the error on a trajectory; on one where it must be left alone fewer do."""
KINDS = ("calibrated", "as it is", "while running", "views alone", "true poses")
FOUND = KINDS[3:]
AIM = 1.2
COLUMNS = (
    "trajectory",
    "seed",
    "kind",
    "ate_m",
    "nees",
    "untold",
    *(f"off_{k}" for k in range(7)),
    *(f"sd_{k}" for k in range(7)),
)


def reproduce(
    out: Path, data: Path | None, *, seed: int, jobs: int, engine: Engine | None = None, quick: bool = False
) -> dict[str, Any]:
    """Run all draws, write calibration.png, .csv, .json and .md into ``out``, print the Markdown.

    Parameters
    ----------
    out : Path
    data : Path or None
        Where the recordings of `RECORDED` are, if there are any.
    seed : int
        Of the first draw of noise and error.
    jobs : int
        Processes, each with one thread.
    engine : Engine, optional
        Where they run; on this machine if left out.
    quick : bool
        One draw on short rendered trajectories: to see that it works.

    Raises
    ------
    SettingsError
        For an impossible number.
    DataError
        If the folder cannot be written.
    """
    if jobs < 1 or seed < 0:
        raise SettingsError(f"jobs {jobs}, seed {seed}: give 1 job or more, seed 0 or more.")
    trajectories = list(WALKS)
    if data is not None:
        trajectories += [name for name in RECORDED if (data / name).is_dir()]
    count = {
        trajectory: 1 if quick else EVEN_DRAWS if trajectory in EVEN else DRAWS for trajectory in trajectories
    }
    asked = [
        (trajectory, seed + k, data, quick) for trajectory in trajectories for k in range(count[trajectory])
    ]
    drawn = _gone(asked, jobs, engine or LOCAL)
    how = f"collabslam-lab reproduce calibration --seed {seed}{' --quick' if quick else ''}"
    how += "" if data is None else " --data DIR"
    return hand_over(out, "calibration", finding(drawn), how)


def _gone(asked: list[tuple[str, int, Path | None, bool]], jobs: int, engine: Engine) -> list[Drawn]:
    with Progress(len(asked), "T_CF corrected", unit="draw") as bar:
        return engine.in_order(go, asked, jobs, bar.update)


def finding(drawn: list[Drawn]) -> Finding:
    """Tables, picture and numbers of all draws."""
    trajectories = list(dict.fromkeys(one.trajectory for one in drawn))
    numbers: dict[str, Any] = {"error_over_calibrated": {}, "ate_m": {}, "nees": {}, "nees_band": {}}
    numbers |= {"correction_in_sd": {}, "untold": {}, "draws": {}}
    for trajectory in trajectories:
        of_trajectory = [one for one in drawn if one.trajectory == trajectory]
        kinds = [kind for kind in KINDS if any(kind in one.ate for one in of_trajectory)]
        numbers["ate_m"][trajectory] = {
            kind: _rms([one.ate[kind] for one in of_trajectory if kind in one.ate]) for kind in kinds
        }
        numbers["error_over_calibrated"][trajectory] = {
            kind: _ratio(of_trajectory, kind) for kind in kinds[1:]
        }
        numbers["nees"][trajectory] = {
            kind: float(np.mean([one.nees[kind] for one in of_trajectory if kind in one.nees]))
            for kind in kinds
        }
        found = [kind for kind in kinds if any(kind in one.off for one in of_trajectory)]
        numbers["correction_in_sd"][trajectory] = {
            kind: _rms(
                np.concatenate([one.off[kind] / one.sd[kind] for one in of_trajectory if kind in one.off])
            )
            for kind in found
        }
        numbers["untold"][trajectory] = {
            kind: float(np.mean([one.untold[kind] for one in of_trajectory if kind in one.untold]))
            for kind in found
        }
        numbers["draws"][trajectory] = len(of_trajectory)
        numbers["nees_band"][trajectory] = nees_band(6, len(of_trajectory))
    rows = [
        [
            one.trajectory,
            one.seed,
            kind,
            one.ate[kind],
            one.nees[kind],
            one.untold.get(kind, ""),
            *np.asarray(one.off.get(kind, np.full(7, np.nan))).tolist(),
            *np.asarray(one.sd.get(kind, np.full(7, np.nan))).tolist(),
        ]
        for one in drawn
        for kind in one.ate
    ]
    return Finding(
        title="T_CF and its clock corrected",
        figure=_figure(numbers),
        tables=_tables(numbers),
        verdict=_VERDICT,
        numbers=numbers,
        columns=COLUMNS,
        rows=rows,
    )


_VERDICT = (
    f"All measured T_CF are wrong by {100 * METRES:g} cm and {DEGREES:g} degree in drawn directions along "
    f"Cs's axes, and all views were taken {1e3 * SECONDS:g} ms before or after their stamps. Calibrated: "
    "without that; as it is: nothing is done about it; while running: the filter is told how large such "
    "errors may be, and learns what its views say of T_CF's; the others: corrected by what "
    "`check-calib --write` finds in the recording, from a run of the filter (views alone) or with its "
    "true poses."
)


def _ratio(drawn: list[Drawn], kind: str) -> float:
    """RMS error over that of the calibrated runs of the same draws."""
    pairs = [one for one in drawn if kind in one.ate]
    return _rms([one.ate[kind] for one in pairs]) / _rms([one.ate["calibrated"] for one in pairs])


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _tables(numbers: dict[str, Any]) -> list[Table]:
    errors, consistency = [], []
    for trajectory, ate in numbers["ate_m"].items():
        over, nees = numbers["error_over_calibrated"][trajectory], numbers["nees"][trajectory]
        low, high = numbers["nees_band"][trajectory]
        told, sds = numbers["untold"][trajectory], numbers["correction_in_sd"][trajectory]
        errors.append(
            [trajectory, str(numbers["draws"][trajectory]), number(ate["calibrated"], 1, scale=100.0)]
        )
        errors[-1] += [number(over.get(kind), 2) for kind in KINDS[1:]]
        consistency.append(
            [trajectory, f"{low:.1f} to {high:.1f}", *(number(nees.get(kind), 1) for kind in KINDS)]
        )
        consistency[-1] += [f"{told[kind]:.1f} / {sds[kind]:.2f}" if kind in told else "-" for kind in FOUND]
    return [
        Table(
            "Error of the position, RMS over frames and draws: of the calibrated runs, and of the others "
            f"over it (aim: {AIM}):",
            ("trajectory", "draws", "calibrated, cm", *KINDS[1:]),
            errors,
        ),
        Table(
            "NEES of the pose (6 is ideal); of what was found, the number of directions that were left alone "
            "/ its error in standard deviations (expected 1):",
            ("trajectory", "band", *KINDS, "found, views alone", "found, true poses"),
            consistency,
        ),
    ]


def _figure(numbers: dict[str, Any]) -> Any:
    figure, panels = style.canvas(
        1, 1, (11.0, 4.6), "T_CF wrong by 3 cm, 1 degree and 50 ms: found and corrected"
    )
    axes = panels[0, 0]
    colours = (style.GREY, style.MONO, style.COLOURS["plain"], style.COLLAB, style.COLOURS["gauge"])
    trajectories = list(numbers["ate_m"])
    for k, (kind, colour) in enumerate(zip(KINDS, colours, strict=True)):
        heights = [100.0 * numbers["ate_m"][trajectory].get(kind, 0.0) for trajectory in trajectories]
        axes.bar(np.arange(len(trajectories)) + 0.16 * (k - 2), heights, 0.15, color=colour, label=kind)
    axes.set_xticks(range(len(trajectories)), trajectories)
    axes.set_ylabel("error of the position (cm)")
    style.legend(axes)
    return figure
