"""The one writer of every result file.

A result folder holds ``config.yaml`` (the settings as used), ``frames.csv`` (every frame, written as it
comes), ``trajectory.tum`` and ``trajectory.cov`` (valid poses only), ``groundtruth.tum``, ``map.ply``,
``trajectory.png`` and ``summary.json``.  Whole files are written beside their place and then moved into it,
so that a reader never meets half a file.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np

from collabslam.errors import DataError
from collabslam.evaluation.record import Landmarks, RunRecord, Step, status_name
from collabslam.formats.files import write_text
from collabslam.formats.landmarks import write_ply
from collabslam.formats.trajectory import METRES, position_quaternion, write_covariances, write_tum
from collabslam.types import Array

CONFIG, FRAMES, TRAJECTORY, COVARIANCE = "config.yaml", "frames.csv", "trajectory.tum", "trajectory.cov"
GROUND_TRUTH, MAP, PICTURE, SUMMARY = "groundtruth.tum", "map.ply", "trajectory.png", "summary.json"
RESULT_FILES = (CONFIG, FRAMES, TRAJECTORY, COVARIANCE, GROUND_TRUTH, MAP, PICTURE, SUMMARY)
MARK = "# collabslam settings"
"""How the first line of a result folder's ``config.yaml`` begins."""

POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
DIAGNOSTICS = (
    "predicted",
    "searched",
    "found",
    "accepted",
    "rejected_low_score",
    "rejected_ambiguous",
    "rejected_hohct",
    "rejected_conditional",
    "cf_points",
    "cf_matches",
    "cf_rejected_region",
    "cf_rejected_ratio",
    "cf_rejected_epipolar",
    "cf_rejected_chi2",
    "depth_rows",
    "births_instant",
    "births_depth",
    "births_delayed",
    "births_undelayed",
    "deleted",
    "map_size",
    "candidates",
    "overlap",
    "nis",
    "nis_dof",
    "hohct_order",
    "hohct_exact",
    "baseline_m",
    "t_cf_correction_m",
    "t_cf_correction_deg",
    "t_cf_correction_sigmas",
    "ms_predict",
    "ms_search",
    "ms_cf",
    "ms_update",
    "ms_map",
    "ms_total",
)
LEADING = ("index", "t", "status", "valid", "started", "worn")


class ResultWriter:
    """Writes the files of one run into a folder; use it as a context manager.

    Leaving the block, even by an exception, writes the trajectory as far as it came.

    Parameters
    ----------
    folder : Path
        Made if missing.  Results of an earlier run in it are removed.
    config : str
        Content of ``config.yaml``.
    unit : str
        Of lengths, for the trajectory's header.

    Raises
    ------
    DataError
        If the folder holds something that is no result of collabslam, or cannot be written.
    """

    def __init__(self, folder: Path, config: str, unit: str = METRES) -> None:
        self.folder = folder
        self._unit = unit
        claim_folder(folder)
        write_text(folder / CONFIG, config)
        self._frames: IO[str] = (folder / FRAMES).open("w", encoding="utf-8", newline="")
        self._columns: tuple[str, ...] = ()
        self._record: RunRecord | None = None

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._frames.close()
        if self._record is not None:
            write_trajectory(self.folder, self._record, self._unit)

    def frame(self, record: RunRecord) -> None:
        """Append the record's last frame to ``frames.csv``, and flush it."""
        self._record = record
        index = len(record) - 1
        step = record.steps[index]
        rows = csv.writer(self._frames, lineterminator="\n")
        if not self._columns:
            self._columns = frame_columns(step.diagnostics)
            rows.writerow(self._columns)
        rows.writerow(_cell(v) for v in _frame_row(index, step, record.worn[index], self._columns))
        self._frames.flush()

    def finish(
        self, record: RunRecord, landmarks: Landmarks | None, truth: Array | None, summary: Mapping[str, Any]
    ) -> None:
        """Write everything that needs the whole run.

        Parameters
        ----------
        record : RunRecord
        landmarks : Landmarks or None
        truth : (N, 4, 4) array or None
            In W, NaN where missing.
        summary : mapping
        """
        write_trajectory(self.folder, record, self._unit)
        if truth is not None:
            write_tum(
                self.folder / GROUND_TRUTH,
                record.times,
                truth,
                note="# True poses, moved so that the first one equals the estimate's.",
            )
        if landmarks is not None:
            write_ply(self.folder / MAP, landmarks)
        write_summary(self.folder / SUMMARY, summary)


def is_result_folder(folder: Path) -> bool:
    """Whether a run has written into this folder."""
    try:
        with (folder / CONFIG).open(encoding="utf-8") as lines:
            return lines.readline().startswith(MARK)
    except (OSError, UnicodeDecodeError):
        return False


def claim_folder(folder: Path) -> None:
    """Make the folder, or empty it of an earlier run's results; nothing else in it is touched.

    Raises
    ------
    DataError
        If it holds other things than results, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()) and not is_result_folder(folder):
            raise DataError(
                f"The folder {folder} is not empty and holds no collabslam result; give another --out."
            )
        for name in RESULT_FILES:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        text = f"The folder {folder} cannot be written ({error.strerror}); give another --out."
        raise DataError(text) from error


def write_trajectory(folder: Path, record: RunRecord, unit: str = METRES) -> None:
    """``trajectory.tum`` and ``trajectory.cov``: the valid poses, one line of each per pose."""
    use = record.valid
    write_tum(folder / TRAJECTORY, record.times[use], record.poses[use], unit=unit)
    write_covariances(folder / COVARIANCE, record.times[use], record.covariances[use])


def write_summary(path: Path, summary: Mapping[str, Any]) -> None:
    """The summary as JSON: sorted keys, and null for every number that is not finite."""
    write_text(path, json.dumps(jsonable(summary), indent=2, sort_keys=True, allow_nan=False) + "\n")


def jsonable(value: Any) -> Any:
    """``value`` in JSON's own types; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, str) or value is None:
        return value
    if isinstance(value, np.generic | np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, Sequence):
        return [jsonable(v) for v in value]
    if isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value)


def frame_columns(diagnostics: Mapping[str, Any]) -> tuple[str, ...]:
    """Columns of ``frames.csv``: the known ones in a fixed order, then any further diagnostics."""
    known = {*LEADING, *POSE_COLUMNS, *DIAGNOSTICS}
    return (*LEADING, *POSE_COLUMNS, *DIAGNOSTICS, *(k for k in diagnostics if k not in known))


def _frame_row(index: int, step: Step, worn: bool, columns: Iterable[str]) -> list[Any]:
    row: dict[str, Any] = dict(step.diagnostics)
    row.update(index=index, t=f"{step.t:.9f}", status=status_name(step.status), worn=worn)
    row.update(valid=bool(step.valid), started=bool(step.started))
    finite = bool(np.isfinite(step.pose).all())
    numbers = [f"{v:.9f}" for v in position_quaternion(step.pose)] if finite else [""] * len(POSE_COLUMNS)
    row.update(zip(POSE_COLUMNS, numbers, strict=True))
    return [row.get(column) for column in columns]


def _cell(value: Any) -> str:
    """Text of a cell: flags as 0 and 1, floats short, nothing for what is missing or not finite."""
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return f"{value:.6g}" if math.isfinite(value) else ""
    return "" if value is None else str(value)
