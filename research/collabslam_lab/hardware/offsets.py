"""What it costs that Cf's clock is behind, and whether it is noticed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from collabslam import Settings, run
from collabslam.checks.worn_bias.recorded import time_correlated_error
from collabslam_lab.calibrated.trajectories import Untrue
from collabslam_lab.hardware.clocks import Row, scores_of
from collabslam_lab.hardware.wrong_stamps import CORRIDOR, KNOWN, LIVELY, WrongStamps, side_by_side

OFFSETS_MS = (0.0, 5.0, 10.0, 20.0, 50.0, 100.0)
FEW_OFFSETS_MS = (0.0, 20.0)
WAYS = (LIVELY, "turn90-0")
FEW_WAYS = (CORRIDOR,)


def offset_rows(
    seeds: Sequence[int], ways: Sequence[str], offsets_ms: Sequence[float], frames: int | None = None
) -> Iterator[Row]:
    """One row for each way, seed, certainty of T_CF, offset, and whether the filter is told of the offset.

    Parameters
    ----------
    seeds : sequence of int
        Of the noise.
    ways : sequence of str
        As for `side_by_side`.
    offsets_ms : sequence of float
        How far Cf's clock is behind, milliseconds.
    frames : int, optional
        Only so many from the first one on.
    """
    for way in ways:
        for seed in seeds:
            world = side_by_side(way, seed, frames)
            for ms in offsets_ms:
                for known, sds in KNOWN.items():
                    for told in (False, True) if ms else (False,):
                        changes = {"filter.worn.clock_sd": ms / 1e3} if told else {}
                        wrong = WrongStamps(world, ms / 1e3, sds)
                        result = run(wrong, start="worn", settings=Settings.default().replace(changes))
                        row = {"way": way, "seed": seed, "t_cf": known, "offset_ms": ms, "told": told}
                        yield row | scores_of(result)


def found_rows(way: str, seed: int, offsets_ms: Sequence[float], frames: int | None = None) -> Iterator[Row]:
    """What `check-calib --write` finds of each offset, by the images and a run alone; see `offset_rows`."""
    world = side_by_side(way, seed, frames)
    for ms in offsets_ms:
        for known, sds in KNOWN.items():
            error = time_correlated_error(Untrue(WrongStamps(world, ms / 1e3, sds)))
            if error is not None:
                yield {
                    "way": way,
                    "seed": seed,
                    "t_cf": known,
                    "offset_ms": ms,
                    "found_ms": 1e3 * error.fit.calibration.clock,
                    "sd_ms": 1e3 * float(error.fit.sd[6]),
                }
