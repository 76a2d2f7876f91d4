"""The gate for inertial samples: what of them the filter can use, and what they were recorded in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collabslam._core import FASTEST_RATE, GYRO_GAP
from collabslam.datasets.gate import tell
from collabslam.datasets.stamps import usable_frames
from collabslam.errors import DataError
from collabslam.level import GRAVITY
from collabslam.types import Array, Imu, ImuLog, Indices, Mask

LEAST_RATE, MOST_RATE = 10.0, 2e4
"""Samples a second that a gyroscope gives."""
FASTEST, FAST = 35.0, 5.0
"""rad/s that hardly any sample may exceed (2000 degrees/s, the range of most sensors), and that half of
them may not: what turns faster than that for half of the time is not a camera, and its unit is degrees."""
FEW = 0.05
"""Share of such samples that are errors of transmission; more of them are in another unit."""
FULL_SCALE = 2.0
"""rad/s (115 degrees/s) below which a value that repeats at the limit of an axis is not clipping."""
STUCK = 1.0
"""Seconds in which a sensor that lives does not repeat a sample to the bit."""
CLIPPED = 3
"""So many samples running at the limit of an axis show that it is the sensor's."""
MOST_LEFT_OUT = 0.2
"""Share of the samples that may be left out."""
_NO_GYRO = "--gyro none leaves the gyroscope out (--worn-gyro none that of Cf)"


def checked(times: Array, rates: Array, accelerations: Array | None, sensor: Imu, where: str) -> ImuLog:
    """Samples that can be used, in order; those that cannot are left out and counted.

    Left out are samples that are not finite, whose stamp repeats or comes out of order, that repeat for
    `STUCK` seconds to the bit, that stand at the limit of the sensor's range, or that none could measure.

    Parameters
    ----------
    times : (N,) array
        Stamps, seconds, by the sensor's clock.
    rates : (N, 3) array
        rad/s along the sensor's axes.
    accelerations : (N, 3) array or None
        Specific force, m/s^2, NaN where there is none.
    sensor : Imu
    where : str
        The file or topic, for messages.

    Raises
    ------
    DataError
        If there are too few of them, too many cannot be used, they are in degrees a second, the clock was
        set back, or they come at a rate at which no gyroscope gives them.
    """
    times, rates = np.asarray(times, np.float64), np.asarray(rates, np.float64)
    total = len(times)
    finite = np.isfinite(times) & np.isfinite(rates).all(axis=1)
    kept = np.flatnonzero(finite)[_in_order(times[finite], where)]
    if len(kept) < 2:
        raise DataError(f"{where} holds {len(kept)} samples of a gyroscope; give two or more, or {_NO_GYRO}.")
    step = _check_rate(times[kept], where)
    possible = np.abs(rates[kept]).max(axis=1) <= FASTEST_RATE
    _check_unit(rates[kept][possible] if possible.mean() > 1.0 - FEW else rates[kept], where)
    stuck = possible & (_stuck(times[kept], rates[kept]) | _clipped(rates[kept]))
    counts = {
        "not finite": total - int(finite.sum()),
        "out of order": int(finite.sum()) - len(kept),
        "too fast": len(kept) - int(possible.sum()),
        "stuck or clipped": int(stuck.sum()),
    }
    said = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
    kept = kept[possible & ~stuck]
    if total - len(kept) > MOST_LEFT_OUT * total:
        raise DataError(
            f"Of {total} samples of a gyroscope in {where} too few can be used ({said}); record it again, "
            f"with a larger range if it is clipped. {_NO_GYRO}."
        )
    log = ImuLog(times[kept], rates[kept], None, sensor, total - len(kept))
    tell("gyroscope", f"{describe(log)}{f'; left out: {said}' if said else ''}", where)
    if _gaps(log.times, step).size:
        tell("gyroscope", gaps_text(log), where)
    if accelerations is None:
        return log
    return _with_accelerations(log, np.asarray(accelerations)[kept], where)


def describe(log: ImuLog) -> str:
    """Number, rate and span of the samples, in words."""
    span = float(log.times[-1] - log.times[0])
    rate = 1.0 / float(np.median(np.diff(log.times)))
    return f"{len(log)} samples at {rate:.0f} a second, {span:.2f} s"


def gaps_text(log: ImuLog) -> str:
    """How many gaps the samples have, and the longest, in words."""
    gaps = _gaps(log.times, float(np.median(np.diff(log.times))))
    if not gaps.size:
        return "no gaps"
    return f"{len(gaps)} gaps, the longest of {float(gaps.max()):.2f} s"


def _gaps(times: Array, step: float) -> Array:
    """Silences that the filter does not bridge, and that are no pauses of a slow sensor."""
    steps = np.diff(times)
    return np.asarray(steps[steps > max(GYRO_GAP, 10.0 * step)])


def _in_order(times: Array, where: str) -> Indices:
    """The samples whose stamps increase."""
    if (np.diff(times) > 0.0).all():
        return np.arange(len(times), dtype=np.int64)
    kept, after = usable_frames(times)
    moved = np.flatnonzero(after != times[kept])
    if moved.size:
        raise DataError(
            f"The stamps of {where} are set back at {times[kept[moved[0]]]:.3f} s; the sensor's clock was "
            f"set while it recorded. Cut the samples there, or record again; {_NO_GYRO}."
        )
    return kept


def _check_rate(times: Array, where: str) -> float:
    """Seconds from sample to sample; raises DataError if no gyroscope samples so."""
    step = float(np.median(np.diff(times)))
    if not 1.0 / MOST_RATE <= step <= 1.0 / LEAST_RATE:
        raise DataError(
            f"The samples of {where} are {step:.3g} s apart, which no gyroscope's are ({LEAST_RATE:g} to "
            f"{MOST_RATE:g} a second); write the stamps in seconds, a sample each. {_NO_GYRO}."
        )
    return step


def _check_unit(rates: Array, where: str) -> None:
    turning = np.linalg.norm(rates, axis=1)
    middle, most = float(np.median(turning)), float(np.quantile(turning, 0.99))
    if most > FASTEST or middle > FAST:
        raise DataError(
            f"The rates of {where} have a median of {middle:.3g} and a 99 % quantile of {most:.3g} rad/s, "
            "which no camera's have: they are in degrees a second, or counts; multiply degrees by pi / 180 = "
            f"0.0174533. {_NO_GYRO}."
        )


def _stuck(times: Array, rates: Array) -> Mask:
    """Samples of stretches of `STUCK` seconds or more that repeat one sample."""
    change = np.flatnonzero((np.diff(rates, axis=0) != 0.0).any(axis=1)) + 1
    first, last = np.r_[0, change], np.r_[change, len(times)] - 1
    out = np.zeros(len(times), np.bool_)
    for a, b in zip(first.tolist(), last.tolist(), strict=True):
        if times[b] - times[a] >= STUCK:
            out[a + 1 : b + 1] = True
    return out


def _clipped(rates: Array) -> Mask:
    """Samples of runs of `CLIPPED` or more at the largest or the least value of an axis."""
    out = np.zeros(len(rates), np.bool_)
    for axis in rates.T:
        for limit in (float(axis.max()), float(axis.min())):
            at = np.flatnonzero(axis == limit)
            runs = np.split(at, np.flatnonzero(np.diff(at) != 1) + 1)
            for run in runs if abs(limit) > FULL_SCALE else ():
                if len(run) >= CLIPPED:
                    out[run] = True
    return out


def _with_accelerations(log: ImuLog, accelerations: Array, where: str) -> ImuLog:
    """With what the accelerometer says, if that holds gravity in m/s^2."""
    sizes = np.linalg.norm(accelerations, axis=1)
    sizes = sizes[np.isfinite(sizes)]
    middle = float(np.median(sizes)) if sizes.size else 0.0
    if 0.7 * GRAVITY <= middle <= 1.4 * GRAVITY:
        tell("accelerometer", f"{len(sizes)} samples, {middle:.2f} m/s^2 in the median", where)
        return replace(log, accelerations=accelerations)
    why = f"{middle:.3g} m/s^2 in the median is not gravity"
    if 0.7 <= middle <= 1.4:
        why += f": it is in g, multiply by {GRAVITY}"
    elif sizes.size:
        why += ": it is without gravity, or in another unit"
    tell("passed over", f"accelerometer ({why})", where)
    return log
