"""A gyroscope beside a tiny recording: its samples as arrays and as lines."""

from __future__ import annotations

import numpy as np

RATE = 200.0


def samples(first: float, seconds: float = 0.4, rate: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and rates of a sensor that turns to and fro, no two alike."""
    times = first + np.arange(round(seconds * rate)) / rate
    t = times - first
    noise = 1e-3 * np.random.default_rng(3).standard_normal((len(times), 3))
    return times, np.stack(
        [0.4 * np.sin(9 * t), 0.3 * np.cos(7 * t), 0.2 * np.sin(5 * t + 1)], axis=1
    ) + noise


def lines(stamps: list[str], *columns: np.ndarray) -> str:
    """A CSV of stamps and columns."""
    rows = np.concatenate(columns, axis=1)
    return "".join(
        f"{stamp},{','.join(repr(float(x)) for x in row)}\n" for stamp, row in zip(stamps, rows, strict=True)
    )
