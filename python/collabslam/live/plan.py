"""What a live run was asked for, as its record tells it: data of others, checked before it is used."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from collabslam.errors import CollabslamError, DataError
from collabslam.formats.schema import fields, items, number, optional, table, text
from collabslam.runs.results import jsonable
from collabslam.settings.modes import MODES, STARTS
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Imu, person_name


def imu_state(sensor: Imu | None) -> dict[str, Any] | None:
    """What a plan keeps of a gyroscope."""
    if sensor is None:
        return None
    told = {k: float(v) for k, v in vars(sensor).items() if k != "r_ci" and v is not None}
    return told | {"r_ci": np.asarray(sensor.r_ci, np.float64).ravel().tolist()}


def _person(value: Any, where: str) -> None:
    person_name(value, DataError)


def _imu_value(value: Any, where: str) -> None:
    (items(number(), 9) if isinstance(value, list) else number())(value, where)


_PLAN = fields(
    mode=text(MODES),
    start=text(STARTS),
    settings=table(str, lambda value, where: None),  # the table of settings asks
    tags=items(text()),
    boards=items(text()),
    t_bc=optional(items(number(), 16)),
    persons=items(_person),
    imu=optional(table(str, _imu_value)),
)


@dataclass(frozen=True)
class LivePlan:
    """What a live run was asked for: mode, start, settings by their full keys, printed targets as texts, the
    16 numbers of ``t_bc``, row by row, where there is odometry, the persons' names, if they have any, and
    what an `Imu` has that is not None, where there is a gyroscope."""

    mode: str
    start: str
    settings: dict[str, Any]
    tags: list[str]
    boards: list[str]
    t_bc: list[float] | None = None
    persons: list[str] = field(default_factory=list)
    imu: dict[str, Any] | None = None

    @classmethod
    def of(cls, told: str, where: str) -> LivePlan:
        """The plan that `written` wrote.

        Raises
        ------
        DataError
            Naming ``where``, if it is none, or asks for something impossible.
        """
        try:
            found = json.loads(told)
            _PLAN(found, "plan")
            plan = cls(**found)
            if len(set(plan.persons)) != len(plan.persons):
                raise DataError("It names a person twice.")
            plan.targets, plan.sensor  # noqa: B018
        except (CollabslamError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise DataError(
                f"The plan in {where} cannot be read ({str(error)[:300]}); the record is broken."
            ) from error
        return plan

    @property
    def written(self) -> str:
        """As a text."""
        return json.dumps(jsonable(vars(self)))

    @property
    def targets(self) -> list[Tag | Board]:
        """The printed targets."""
        return [*map(Tag.parse, self.tags), *map(Board.parse, self.boards)]

    @property
    def sensor(self) -> Imu | None:
        """The gyroscope."""
        if self.imu is None:
            return None
        return Imu(**{**self.imu, "r_ci": np.reshape(self.imu["r_ci"], (3, 3))})

    @property
    def mount(self) -> np.ndarray | None:
        """``t_bc`` as a matrix (4, 4)."""
        return None if self.t_bc is None else np.reshape(self.t_bc, (4, 4))
