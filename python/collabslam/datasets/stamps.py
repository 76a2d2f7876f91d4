"""Which frames of a stream can be used, and when they were taken: stamps repeat, swap and jump."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import ArrayLike

from collabslam.types import Array, Indices

SET_BACK = 3
"""So many frames running that lie behind show a clock that was set back; fewer came out of order."""
FAR_SECONDS, FAR_STEPS = 20.0, 100.0
"""A gap of so many seconds, and of so many usual intervals, is one that no motion is predicted over."""


def usable_frames(times: ArrayLike) -> tuple[Indices, Array]:
    """The frames whose stamps increase, after a clock that was set back is set forward again.

    As few frames as can be are left out: one for a repeated stamp, one for a frame out of order, and one for
    a single stamp far in the future, after which a rule that looks at one frame at a time would refuse all
    others.  Fewer than `SET_BACK` frames at either end that a gap of more than `FAR_SECONDS` parts from all
    others are left out, too: their stamps are wrong, or nothing can be known of them.  Where the clock was
    set back, later stamps are moved so that the frames there are one usual interval apart.

    Parameters
    ----------
    times : (N,) array
        Seconds.  Frames whose stamp is not finite are left out.

    Returns
    -------
    (M,) int64
        Indices, increasing.
    (M,) float64
        Their times, seconds, increasing; the stamps themselves where no clock was set back.
    """
    stamps = np.array(times, dtype=np.float64)
    steps = np.diff(stamps)
    forward = steps[steps > 0.0]
    usual = float(np.median(forward)) if len(forward) else 0.0
    while True:
        chosen = _longest_increasing(stamps)
        back = _set_back(stamps, chosen)
        if back is None or usual == 0.0:
            chosen = _without_far_ends(chosen, stamps, usual)
            return chosen, stamps[chosen]
        stamps[back:] += stamps[back - 1] - stamps[back] + usual


def _without_far_ends(chosen: Indices, stamps: Array, usual: float) -> Indices:
    """The chosen frames but for a few at the ends that are far from all others."""
    far = np.flatnonzero(np.diff(stamps[chosen]) > max(FAR_SECONDS, FAR_STEPS * usual)) + 1
    first = max((int(k) for k in far if k < SET_BACK), default=0)
    last = min((int(k) for k in far if k > len(chosen) - SET_BACK), default=len(chosen))
    return chosen[first:last] if last - first >= SET_BACK else chosen


def _set_back(stamps: Array, chosen: Indices) -> int | None:
    """First frame after a clock was set back: the largest step back beside frames that were left out."""
    out = np.setdiff1d(np.flatnonzero(np.isfinite(stamps)), chosen)
    for run in np.split(out, np.flatnonzero(np.diff(out) != 1) + 1):
        if len(run) < SET_BACK:
            continue
        first = max(1, int(run[0]))
        steps = np.diff(stamps[first - 1 : int(run[-1]) + 2])
        at = int(np.argmin(steps))
        if steps[at] < 0.0 and int(np.sum(steps <= 0.0)) < SET_BACK:
            return first + at
    return None


def _longest_increasing(stamps: Array) -> Indices:
    """The longest choice of frames whose stamps increase; of two with one stamp the first.

    A stamp that repeats is most often one that was not renewed: it was true of the first.
    """
    ends: list[float] = []  # ends[k]: least stamp with which a choice of k + 1 frames can end
    last: list[int] = []  # its frame
    before = [-1] * len(stamps)
    for i, t in enumerate(stamps.tolist()):
        if not np.isfinite(t):
            continue
        k = bisect_left(ends, t)
        before[i] = last[k - 1] if k else -1
        if k == len(ends):
            ends.append(t)
            last.append(i)
        elif t < ends[k]:
            ends[k], last[k] = t, i
    chosen = []
    i = last[-1] if last else -1
    while i >= 0:
        chosen.append(i)
        i = before[i]
    return np.array(chosen[::-1], dtype=np.int64)
