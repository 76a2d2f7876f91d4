"""What a run was asked for, and where it leaves what it finds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from collabslam.datasets.source import Source
from collabslam.errors import SettingsError
from collabslam.formats.schema import fields, flag, number, optional, plain, table, text, whole
from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.settings.modes import MODES, SLAM_STARTS
from collabslam.settings.table import STATE as SETTINGS_STATE
from collabslam.settings.table import Settings

MODE_KEY = "filter.estimator.mode"


@dataclass(frozen=True)
class Interval:
    """How often a checkpoint is written: every so many frames, or seconds of the clock."""

    frames: int | None = None
    seconds: float | None = None

    @classmethod
    def parse(cls, value: int | str) -> Interval:
        """``100`` or ``"100"``: frames; ``"30s"``: seconds.

        Raises
        ------
        SettingsError
            If it is none of them, or not above zero.
        """
        text = str(value).strip()
        try:
            if text.endswith("s"):
                seconds = float(text[:-1])
                if 0.0 < seconds < float("inf"):
                    return cls(seconds=seconds)
            elif int(text) > 0:
                return cls(frames=int(text))
        except ValueError:
            pass
        raise SettingsError(f"A checkpoint every '{value}' is not understood; give frames as 100, or 30s.")

    def is_over(self, frames: int, seconds: float) -> bool:
        """Whether it is time, so many frames and seconds after the last checkpoint."""
        if self.frames is not None:
            return frames >= self.frames
        return self.seconds is not None and seconds >= self.seconds


@dataclass(frozen=True)
class Output:
    """Where a run leaves what it finds, and what it says meanwhile.

    Attributes
    ----------
    folder : str, Path or None
        Result folder; if an earlier run's results are in it, a numbered one beside it is taken, and the link
        ``latest`` names the newest (see `collabslam.runs.folder`).  None writes none.
    overwrite : bool
        Take ``folder`` even so: what an earlier run has written there is removed.
    latest : bool
        Let that link name the folder.
    save_map : str, Path or None
        File for the map at the end of the run, to start in later.
    checkpoint_every : int, str or None
        Write a checkpoint into the folder before the first frame and after so many (``100``), or seconds of
        the clock (``"30s"``).
    reopen : Source or None
        For the checkpoint: how the recording is opened again, where `run` is given one that is open.
    progress : bool
        Whether to show progress on standard error.
    world : str or None
        ``level`` or ``level:ROLL,PITCH[,SD]``: write poses and map in a level world, too; see
        `collabslam.runs.level.parse_world`.
    rate_poses : bool
        Write poses between frames at the gyroscope's rate, too; see `collabslam.runs.rate_poses`.
    notes : mapping
        Further facts for the summary's ``options``, such as how the worn camera was emulated.
    """

    folder: str | Path | None = None
    overwrite: bool = False
    latest: bool = True
    save_map: str | Path | None = None
    checkpoint_every: int | str | None = None
    reopen: Source | None = None
    progress: bool = False
    world: str | None = None
    rate_poses: bool = False
    notes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """What a run was asked for: all of it that a checkpoint keeps, and no place to write to.

    Attributes
    ----------
    mode, start : str
    metric : bool
        Whether lengths are metres.
    settings : Settings
        With the mode in them.
    notes : mapping
        Facts for the summary that only the caller knows.
    every : Interval or None
        Between checkpoints.
    """

    mode: str
    start: str
    metric: bool
    settings: Settings
    notes: Mapping[str, Any] = field(default_factory=dict)
    every: Interval | None = None

    @property
    def unit(self) -> str:
        """Of lengths."""
        return METRES if self.metric else ARBITRARY

    def state(self) -> dict[str, Any]:
        """In plain values, for a checkpoint."""
        return {
            **vars(self),
            "settings": self.settings.state(),
            "every": None if self.every is None else dict(vars(self.every)),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Plan:
        """The plan of a `state` that passes `PLAN_STATE`; raises SettingsError for unknown settings."""
        every = state["every"]
        return cls(
            **{k: state[k] for k in ("mode", "start", "metric", "notes")},
            settings=Settings.from_state(state["settings"]),
            every=None if every is None else Interval(**every),
        )


PLAN_STATE = fields(
    mode=text(MODES),
    start=text(SLAM_STARTS),
    metric=flag,
    settings=SETTINGS_STATE,
    notes=table(str, plain),
    every=optional(fields(frames=optional(whole(1)), seconds=optional(number(0.0)))),
)
"""What `Plan.state` may hold."""
