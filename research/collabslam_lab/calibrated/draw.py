"""One draw of the error on one trajectory: what the filter makes of it as it is, and corrected."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from collabslam import Settings, attach_worn
from collabslam.batch.processes import use_one_thread
from collabslam.checks.worn_bias.recorded import TimeCorrelatedError, time_correlated_error
from collabslam.datasets.worn_calibration import CalibratedWorn
from collabslam.runs.runner import run
from collabslam.types import Array, Recording
from collabslam_lab.benchmark.opening import open_folder, worn_of
from collabslam_lab.benchmark.plan import find_plan
from collabslam_lab.calibrated.trajectories import SECONDS, Erring, Stated, Untrue, drawn_error, rendered

RECORDED = ("hololens_000", "scenes7_redkitchen", "euroc_v101")
"""Recordings of the plan of `collabslam-lab evaluate` that are taken where --data has them."""
EVEN = ("even", "one axis")
FRAMES, QUICK_FRAMES = 100, 40
"""Of a rendered trajectory."""


LASTS = {"filter.worn.bias_time": 1e5, "filter.worn.clock_sd": SECONDS}
"""Of the runs in which the filter learns of the error: how long it lasts, how wrong the clock may be."""


@dataclass
class Drawn:
    """What one draw gave; by kind of run (`calibrated`: no error, `as it is`, and how it was corrected).

    Attributes
    ----------
    trajectory : str
    seed : int
    ate, nees : dict of str to float
        Metres; 6 is ideal.
    off : dict of str to (7,) array
        Error of what was found, metres, radians and seconds, by how it was found.
    sd : dict of str to (7,) array
        What it says of that error.
    untold : dict of str to int
        Directions that were left alone.
    """

    trajectory: str
    seed: int
    ate: dict[str, float] = field(default_factory=dict)
    nees: dict[str, float] = field(default_factory=dict)
    off: dict[str, Array] = field(default_factory=dict)
    sd: dict[str, Array] = field(default_factory=dict)
    untold: dict[str, int] = field(default_factory=dict)

    def score(self, kind: str, recording: Recording, settings: Settings | None = None) -> None:
        """Run the filter."""
        summary = run(recording, settings=settings).summary
        self.ate[kind], self.nees[kind] = (
            float("nan") if summary[key] is None else float(summary[key])
            for key in ("ate_rmse_m", "nees_mean")
        )

    def correct(self, kind: str, recording: Recording, found: TimeCorrelatedError | None) -> None:
        """Judge what was found, and run the filter on the recording corrected by it."""
        if found is None:
            return
        error, clock = drawn_error(self.seed)
        calibration = found.fit.calibration
        self.off[kind] = np.append(calibration.correction + error, calibration.clock - clock)
        self.sd[kind], self.untold[kind] = found.fit.sd, len(found.fit.untold)
        self.score(kind, CalibratedWorn(recording, calibration))


def go(trajectory: str, seed: int, data: Path | None, quick: bool) -> Drawn:
    """All runs of one draw; also the work of a child process."""
    use_one_thread()
    out = Drawn(trajectory, seed)
    error, clock = drawn_error(seed)
    if data is not None and trajectory in RECORDED:
        base = _recorded(trajectory, seed, data)
    else:
        base = rendered(trajectory, QUICK_FRAMES if quick else FRAMES, seed)
    out.score("calibrated", base)
    wrong = Erring(base, error, clock)
    out.score("as it is", wrong)
    out.score("while running", Stated(wrong), Settings.default().replace(LASTS))
    out.correct("views alone", wrong, time_correlated_error(Untrue(wrong)))
    out.correct("true poses", wrong, time_correlated_error(wrong))
    return out


def _recorded(name: str, seed: int, data: Path) -> Recording:
    entry = next(entry for entry in find_plan(data, None).recordings if entry.name == name)
    recording = open_folder(entry, data)
    worn = worn_of(entry, recording)
    return attach_worn(recording, worn, available=entry.available, period=entry.period, seed=seed)
