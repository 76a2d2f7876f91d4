"""A result folder read back."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import LAST_TIME, Camera
from collabslam.datasets.poses import read_track
from collabslam.errors import DataError, InputError
from collabslam.formats.files import read_text
from collabslam.formats.landmarks import read_ply
from collabslam.formats.trajectory import ARBITRARY, read_covariances
from collabslam.level import Level
from collabslam.results import Landmarks
from collabslam.runs.folder import is_result_folder
from collabslam.runs.results import (
    CORRECTED,
    COVARIANCE,
    FRAMES,
    LEVEL_COVARIANCE,
    LEVEL_MAP,
    LEVEL_TRAJECTORY,
    MAP,
    SUMMARY,
    TRAJECTORY,
    WHOLE_MAP,
)
from collabslam.types import Array


@dataclass(frozen=True)
class RunFolder:
    """Where a run has left its results.

    Raises
    ------
    DataError
        If it is not a result folder; the methods, if a file of it is missing or broken.
    """

    path: Path

    def __post_init__(self) -> None:
        if not is_result_folder(self.path):
            raise DataError(
                f"{self.path} is not a result folder of collabslam; give what a run wrote (see --out)."
            )

    def trajectory(self) -> tuple[Array, Array, Array]:
        """Times (N,), poses ``T_WC`` (N, 4, 4) and covariances (N, 6, 6) of the valid frames."""
        return self._track(TRAJECTORY, COVARIANCE)

    def level_trajectory(self) -> tuple[Array, Array, Array]:
        """The same in the level world, of a run that was asked for it."""
        return self._track(LEVEL_TRAJECTORY, LEVEL_COVARIANCE)

    def level_landmarks(self) -> Landmarks:
        """The map at the end in the level world."""
        return read_ply(self.path / LEVEL_MAP)

    def r_lw(self) -> Array:
        """(3, 3), maps directions of W into that level world."""
        try:
            up = np.array(self.summary()["level"]["up"], dtype=np.float64).reshape(3)
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                f"{self.path / SUMMARY} does not say which way is down; run the recording again."
            ) from error
        if not abs(np.linalg.norm(up) - 1.0) < 1e-6:  # nor is it where one of them is no number
            raise DataError(f"{self.path / SUMMARY}: level: up is {up}, not of length 1; run it again.")
        return Level(up, np.zeros((2, 2)), "").r_lw

    def _track(self, poses_in: str, covariances_in: str) -> tuple[Array, Array, Array]:
        times, poses = read_track(self.path / poses_in)
        _, covariances = read_covariances(self.path / covariances_in)
        if len(covariances) == len(poses) + 1:  # killed between the two
            covariances = covariances[:-1]
        if len(covariances) != len(poses):
            raise DataError(
                f"{self.path / covariances_in} has {len(covariances)} rows for {len(poses)} poses; run the "
                "recording again."
            )
        return times, poses, covariances

    def corrected(self) -> Array | None:
        """The poses of `trajectory` as the loops of the whole run correct them; None if there are none."""
        path = self.path / CORRECTED
        return read_track(path)[1] if path.exists() else None

    def landmarks(self) -> Landmarks:
        """The map at the end."""
        return read_ply(self.path / MAP)

    def whole_map(self) -> Landmarks | None:
        """The landmarks of all submaps that have ended, where loops put them; None of a run without any."""
        path = self.path / WHOLE_MAP
        return read_ply(path) if path.exists() else None

    def valid_indices(self) -> list[int]:
        """Which of the usable frames, counted from 0, the poses of `trajectory` are of."""
        try:
            return [int(row["index"]) for row in self.frames() if row["valid"] == "1"]
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{self.path / FRAMES} is damaged; run the recording again.") from error

    def camera(self) -> Camera:
        """The calibration of Cs that the run used."""
        given = self.summary().get("camera")
        try:
            return Camera(**given)  # type: ignore[arg-type]
        except (TypeError, InputError) as error:
            raise DataError(
                f"{self.path / SUMMARY} does not say what the camera was; run the recording again."
            ) from error

    def is_metric(self) -> bool:
        """Whether lengths are metres, as the trajectory's header says."""
        try:
            return ARBITRARY not in read_text(self.path / TRAJECTORY).partition("\n")[0]
        except (OSError, UnicodeDecodeError) as error:
            raise DataError(f"{self.path / TRAJECTORY} cannot be read; run the recording again.") from error

    def frames(self) -> list[dict[str, str]]:
        """Rows of ``frames.csv`` by column."""
        return read_frames(self.path / FRAMES)

    def summary(self) -> dict[str, Any]:
        """``summary.json``."""
        return read_summary(self.path / SUMMARY)


def read_frames(path: Path) -> list[dict[str, str]]:
    """Rows of a ``frames.csv`` by column; raises DataError if it cannot be read, or is damaged."""
    try:
        rows: list[dict[str, Any]] = list(csv.DictReader(io.StringIO(read_text(path), newline="")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path} cannot be read; run the recording again.") from error
    for row in rows:
        if None in row or None in row.values() or not _is_time(row.get("t", "0")):
            raise DataError(f"{path} is damaged; run the recording again.")
    return rows


def _is_time(told: str) -> bool:
    try:
        return abs(float(told)) < LAST_TIME
    except ValueError:
        return False


def read_summary(path: Path) -> dict[str, Any]:
    """A ``summary.json``; raises DataError if it cannot be read."""
    try:
        summary = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path} cannot be read; run the recording again.") from error
    if not isinstance(summary, dict):
        raise DataError(f"{path} holds no summary; run the recording again.")
    return summary
