"""Where the person with Cf should look next (METHOD section 24): the filter's answer in a person's terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from collabslam._core import Filter
from collabslam.formats.schema import Check, covariance, fields, optional, pose, table
from collabslam.slam.state import PersistentState
from collabslam.slam.status import StatusMonitor
from collabslam.types import Array, WornView


@dataclass(frozen=True)
class ViewPlan:
    """Where a person should look next, and where they should stand for more.

    Attributes
    ----------
    gain : float
        Expected decrease of half the logarithm of the determinant of the covariance of pose and scale, nats:
        0.7 is half the uncertainty in one of their seven directions.
    matches : float
        Matches to be expected of that view.
    t_cf : (4, 4) float64
        That view: maps points of F into C, metres; its position is the person's present one.
    right_deg, up_deg : float
        The turn from where Cf looks now to there, about its own axes, degrees.
    stand_at : (3,) float64
        The best of the places around, looking at the middle of what Cs sees, metres in C.
    stand_gain : float
        What a view from there is expected to gain.
    """

    gain: float
    matches: float
    t_cf: Array
    right_deg: float
    up_deg: float
    stand_at: Array
    stand_gain: float


DIAGNOSTICS = (
    "next_view_right_deg",
    "next_view_up_deg",
    "next_view_gain",
    "next_view_matches",
    "next_view_stand_x",
    "next_view_stand_y",
    "next_view_stand_z",
    "next_view_stand_gain",
)
"""Names of `counts`."""


def counts(plan: ViewPlan | None) -> dict[str, float]:
    """The answer as diagnostics of a frame, NaN where there is none."""
    if plan is None:
        return dict.fromkeys(DIAGNOSTICS, float("nan"))
    numbers = (plan.right_deg, plan.up_deg, plan.gain, plan.matches, *plan.stand_at.tolist(), plan.stand_gain)
    return dict(zip(DIAGNOSTICS, numbers, strict=True))


class ViewPlanner(PersistentState):
    """Remembers where Cf was last, and asks the filter where it should look.

    Parameters
    ----------
    core : Filter
    monitor : StatusMonitor
    least : int
        Fewest matches with which a view is used.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_last": table(int, fields(t_cf=pose, covariance=covariance(6), bias=optional(covariance(6)))),
    }

    def __init__(self, core: Filter, monitor: StatusMonitor, least: int) -> None:
        self._filter, self._monitor, self._least = core, monitor, least
        # By the number of the worn camera: ``t_cf``, ``covariance`` and ``bias`` as of its last `WornView`.
        self._last: dict[int, dict[str, Any]] = {}

    def saw(self, number: int, worn: WornView) -> None:
        """A frame came with this view of the worn camera with that number."""
        bias = None if worn.bias is None else np.array(worn.bias, np.float64)
        t_cf, covariance = (np.array(a, np.float64) for a in (worn.t_cf, worn.covariance))
        self._last = self._last | {number: {"t_cf": t_cf, "covariance": covariance, "bias": bias}}

    def ask(self, number: int) -> ViewPlan | None:
        """The answer for that worn camera; None where nothing is gained, it was never seen, or Cs is lost."""
        worn = self._last.get(number)
        if worn is None or self._monitor.lost:
            return None
        here, around = self._filter.next_best_view(**worn, least=self._least, who=number)
        if here.best is None:
            return None
        view = here.t_cf[here.best]
        stand = around.best
        return ViewPlan(
            gain=float(here.gain[here.best]),
            matches=float(here.matches[here.best]),
            t_cf=view,
            **_turn(worn["t_cf"], view),
            stand_at=(view if stand is None else around.t_cf[stand])[:3, 3],
            stand_gain=float(here.gain[here.best] if stand is None else around.gain[stand]),
        )


def _turn(now: Array, then: Array) -> dict[str, Any]:
    """The turn of the optical axis from one pose to another, as somebody who looks along ``now`` sees it."""
    x, y, z = now[:3, :3].T @ then[:3, 2]
    return {
        "right_deg": float(np.degrees(np.arctan2(x, z))),
        "up_deg": float(np.degrees(np.arctan2(-y, np.hypot(x, z)))),
    }
