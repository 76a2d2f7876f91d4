"""What odometry is worth: seconds without images, wheels whose scale is wrong, wheels that spin, turns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from collabslam import Settings, Slam, run
from collabslam.datasets.odometry import increments, mounted
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.evaluation.metrics import path_length
from collabslam.geometry import pose_inverse
from collabslam.runs.runner import RunResult
from collabslam.simulation.held import HeldRecording
from collabslam.types import Array, Frame, Image, Odometry, Recording
from collabslam_lab.report import markdown_table
from collabslam_lab.worlds import world_recording

Row = dict[str, Any]

MOUNT = (0.0, 0.0, 0.0)
"""Where Cs sits on the robot, metres: wheels tell the motion at the camera's own height, as what shakes the
rendered cameras turns them about themselves, and no lever moves them by it."""
RATE = 50.0
"""Samples of odometry per second."""
SD_V, SD_W = 0.02, 0.02
"""White noise of a sample, m/s and rad/s."""
SD = (SD_V, SD_V, 0.05, 0.08, 0.08, SD_W)
"""What the filter is told of a sample: wheels know nothing of the shake of driving but that it is small."""
DARK = 5.0
"""Seconds without images."""


@dataclass(frozen=True)
class Wheels:
    """How wheels err.

    Attributes
    ----------
    scale, turn_scale : float
        What they tell, over what is: of the way, and of turns.
    spin : (float, float) or None
        Seconds from the first frame between which they spin, twice as fast as the robot moves.
    """

    scale: float = 1.0
    turn_scale: float = 1.0
    spin: tuple[float, float] | None = None


def simulated(
    robot: Callable[[float], Array], times: Array, wheels: Wheels, generator: np.random.Generator
) -> Odometry:
    """Wheel odometry of a robot in the plane: its velocity and turn rate, the rest told as zero.

    The rendered robots sway to the side as they drive, so their wheels are such as can tell that.

    Parameters
    ----------
    robot : callable
        True T_WC (4, 4) at a stamp, in a world with z up.
    times : (N,) float64
        Stamps of the frames, seconds.
    wheels : Wheels
    generator : numpy Generator
    """
    t_bc = mounted(MOUNT)
    stamps = times[0] - 0.5 / RATE + np.arange(int((times[-1] - times[0]) * RATE) + 2) / RATE
    bases = np.stack([_base(robot(float(t)), t_bc) for t in stamps])
    true = increments(stamps, bases, np.zeros(6))
    twists = np.zeros_like(true)
    twists[:, :2] = wheels.scale * true[:, :2] + SD_V * generator.standard_normal((len(true), 2))
    twists[:, 5] = wheels.turn_scale * true[:, 5] + SD_W * generator.standard_normal(len(true))
    if wheels.spin is not None:
        since = stamps - times[0]
        twists[(since >= wheels.spin[0]) & (since < wheels.spin[1]), 0] *= 2.0
    return Odometry(stamps, twists, np.tile(np.diag(np.square(SD)), (len(stamps), 1, 1)), t_bc)


def _base(t_wc: Array, t_bc: Array) -> Array:
    """The robot's base below its camera: upright, heading as the camera does."""
    heading = float(np.arctan2(t_wc[1, 2], t_wc[0, 2]))
    base = np.eye(4)
    base[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    base[:3, 3] = t_wc[:3, 3] - base[:3, :3] @ t_bc[:3, 3]
    return base


class Driven(WrappedRecording):
    """A recording with odometry, or none, and without images for some time.

    Parameters
    ----------
    base : Recording
    odometry : Odometry or None
    dark : (float, float) or None
        Seconds from the first frame between which the images are black, and Cf is not there.
    """

    def __init__(
        self, base: Recording, odometry: Odometry | None, dark: tuple[float, float] | None = None
    ) -> None:
        super().__init__(base)
        self.odometry = odometry
        since = self.times - self.times[0]
        self.is_dark = np.zeros(len(since), bool) if dark is None else (since >= dark[0]) & (since < dark[1])

    def image(self, i: int) -> Image:
        """The image of Cs in frame ``i``, black in the dark."""
        image = self._base.image(i)
        return np.zeros_like(image) if self.is_dark[i] else image

    def frame(self, i: int) -> Frame:
        """Frame ``i``, black and without Cf in the dark."""
        frame = self._base.frame(i)
        return replace(frame, image=np.zeros_like(frame.image), views=()) if self.is_dark[i] else frame


class Trusting(Slam):
    """An engine that never tests its wheels."""

    def _may_have_slipped(self, *_: Any) -> bool:
        return False


EXACT = {"filter.odometry.scale_sd": 0.0, "filter.odometry.turn_scale_sd": 0.0}
NO_TURNS = {"filter.odometry.turn_scale_sd": 0.0}
SLIP = Wheels(1.05, 1.05)

CASES: dict[str, tuple[Wheels | None, dict[str, Any], bool]] = {
    "constant velocity": (None, {}, True),
    "odometry": (Wheels(), {}, True),
    "odometry, scales taken as exact": (Wheels(), EXACT, True),
    "5 % slip": (SLIP, {}, True),
    "5 % slip, scales taken as exact": (SLIP, EXACT, True),
    "5 % slip, scale of turns taken as exact": (SLIP, NO_TURNS, True),
    "spinning wheels": (Wheels(spin=(2.0, 3.0)), {}, True),
    "spinning wheels, never tested": (Wheels(spin=(2.0, 3.0)), {}, False),
}
"""Name of each case: the wheels, settings, and whether the filter may distrust the wheels."""
SPINNING = [name for name in CASES if name.startswith("spinning")]


def odometry_rows(
    worlds: Sequence[str], seeds: Sequence[int], *, cases: Sequence[str] = tuple(CASES)
) -> Iterator[Row]:
    """One row for each world, seed, case, and whether there are images all the way."""
    for name in worlds:
        for seed in seeds:
            world = world_recording(name, seed)
            held = HeldRecording(world)
            span = float(world.times[-1] - world.times[0])
            dark = (0.5 * (span - DARK), 0.5 * (span + DARK))
            for case in cases:
                wheels, changes, testing = CASES[case]
                noise = np.random.default_rng([23, seed])
                odometry = None
                if wheels is not None:
                    odometry = simulated(world.robot, world.times, wheels, noise)
                for gap in (None,) if case in SPINNING else (None, dark):
                    driven = Driven(held, odometry, gap)
                    result = _run(driven, changes, testing=testing)
                    yield {"world": name, "seed": seed, "case": case, "dark": gap is not None} | _row(
                        result, driven
                    )


def _run(recording: Driven, changes: dict[str, Any], *, testing: bool) -> RunResult:
    settings = Settings.default().replace(changes)
    engine = None
    if not testing:
        t_bc = None if recording.odometry is None else recording.odometry.t_bc
        engine = Trusting(recording.camera, recording.worn_camera, settings=settings, t_bc=t_bc)
    return run(recording, start="worn", settings=settings, slam=engine)


def _row(result: RunResult, recording: Driven) -> Row:
    """Scores of a run."""
    summary, truth = result.summary, result.truth
    row: Row = {
        "avg_position_error_m": summary["avg_position_error_all_m"],
        "final_position_error_m": summary["final_position_error_m"],
        "heading_error_final_deg": summary["heading_error_final_deg"],
        "ate_pct_all_frames": summary["ate_pct_all_frames"],
        "scale_error": summary["scale_error"],
        "ok_share": summary["ok_share"],
        "nees": summary["nees_mean"],
        "slipped": summary["frames_slipped"],
    }
    if truth is None or not recording.is_dark.any():
        return row
    record = result.record
    last = int(np.flatnonzero(recording.is_dark)[-1])
    before = int(np.flatnonzero(recording.is_dark)[0]) - 1
    estimated = pose_inverse(record.poses[before]) @ record.poses[last]
    true = pose_inverse(truth.poses[before]) @ truth.poses[last]
    way = path_length(truth.poses[before : last + 1, :3, 3])
    off = estimated[:3, 3] - true[:3, 3]
    errors = pose_tangent_error(record.poses[last : last + 1], truth.poses[last : last + 1])
    again = record.statuses[last + 1 : last + 11]
    return row | {
        "dark_way_m": way,
        "dark_error_m": float(np.linalg.norm(off)),
        "dark_error_share": float(np.linalg.norm(off)) / way,
        "dark_nees": float(nees(errors, record.covariances[last : last + 1])[0]),
        "dark_valid": bool(record.valid[last]),
        "frames_until_ok": next((k for k, s in enumerate(again) if getattr(s, "value", s) == "OK"), None),
    }


def medians(rows: Sequence[Row]) -> str:
    """Medians over worlds and seeds, case by case, in Markdown."""
    head = [
        "motion input",
        "average error, m",
        "at the end, m",
        "NEES of the pose (6)",
        "frames OK",
        "frames taken as slipped",
        f"{DARK:g} s dark: error, % of the way",
        "largest",
        "NEES after it (6)",
    ]
    lines = []
    for case in dict.fromkeys(row["case"] for row in rows):
        lit = [row for row in rows if row["case"] == case and not row["dark"]]
        dark = [row for row in rows if row["case"] == case and row["dark"]]
        lines.append(
            [
                case,
                _median(lit, "avg_position_error_m", "{:.3f}"),
                _median(lit, "final_position_error_m", "{:.3f}"),
                _mean(lit, "nees"),
                _median(lit, "ok_share", "{:.0%}"),
                _median(lit, "slipped", "{:.0f}"),
                _median(dark, "dark_error_share", "{:.1%}"),
                _most(dark, "dark_error_share"),
                _mean(dark, "dark_nees"),
            ]
        )
    return markdown_table(head, lines)


def _values(rows: Sequence[Row], key: str) -> list[float]:
    return [float(row[key]) for row in rows if row.get(key) is not None]


def _median(rows: Sequence[Row], key: str, form: str) -> str:
    values = _values(rows, key)
    return form.format(float(np.median(values))) if values else "-"


def _mean(rows: Sequence[Row], key: str) -> str:
    values = _values(rows, key)
    return f"{float(np.mean(values)):.1f}" if values else "-"


def _most(rows: Sequence[Row], key: str) -> str:
    values = _values(rows, key)
    return f"{max(values):.1%}" if values else "-"
