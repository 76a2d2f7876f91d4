"""The one writer of every result file.

A result folder holds ``config.yaml`` (the settings as used), ``frames.csv`` (every frame), ``trajectory.tum``
and ``trajectory.cov`` (valid poses only), ``groundtruth.tum``, ``map.ply``, ``corrected.tum``,
``whole_map.ply``, ``submaps.tum``, ``submaps.cov``, ``level.tum``, ``level.cov``, ``level.ply``,
``poses_imu_rate.csv``,
``trajectory.png`` and ``summary.json``; those of
`worn_results` where there are worn cameras; ``checkpoint.bin`` until a run that keeps one is done;
``traceback.txt`` of one that a fault of this program ended.  Those of ``LINES`` grow line by
line, each line in one piece once its frame is done.
Whole files are written beside their place and then moved into it, so that a reader never meets half a file.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from collabslam.errors import CollabslamError, DataError
from collabslam.evaluation.record import RunRecord
from collabslam.formats.files import open_lines, remove_parts, write_text
from collabslam.formats.landmarks import write_ply
from collabslam.formats.trajectory import (
    METRES,
    covariance_line,
    position_quaternion,
    tum_line,
    write_covariances,
    write_tum,
)
from collabslam.level import Level
from collabslam.results import Landmarks, StepResult, SubmapPoses
from collabslam.runs.folder import CONFIG, unwritable
from collabslam.runs.worn_results import PATTERNS, WornTracks, worn_cells, worn_columns
from collabslam.types import Array

FRAMES, TRAJECTORY, COVARIANCE = "frames.csv", "trajectory.tum", "trajectory.cov"
GROUND_TRUTH, MAP, PICTURE, SUMMARY = "groundtruth.tum", "map.ply", "trajectory.png", "summary.json"
COMPARISON = "comparison.png"
SUBMAPS, SUBMAPS_COVARIANCE = "submaps.tum", "submaps.cov"
CORRECTED, WHOLE_MAP = "corrected.tum", "whole_map.ply"
LEVEL_TRAJECTORY, LEVEL_COVARIANCE, LEVEL_MAP = "level.tum", "level.cov", "level.ply"
RATE_POSES = "poses_imu_rate.csv"
CHECKPOINT, TRACEBACK = "checkpoint.bin", "traceback.txt"
LINES = (FRAMES, COVARIANCE, TRAJECTORY)
"""Files that grow line by line; a pose's covariance comes before the pose."""
AT_THE_END = (
    GROUND_TRUTH,
    MAP,
    CORRECTED,
    WHOLE_MAP,
    SUBMAPS,
    SUBMAPS_COVARIANCE,
    LEVEL_TRAJECTORY,
    LEVEL_COVARIANCE,
    LEVEL_MAP,
    RATE_POSES,
    PICTURE,
    SUMMARY,
)
RESULT_FILES = (CONFIG, FRAMES, TRAJECTORY, COVARIANCE, *AT_THE_END)
_OWN = (*RESULT_FILES, CHECKPOINT, COMPARISON, TRACEBACK)

POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
DIAGNOSTICS = (
    "predicted",
    "searched",
    "found",
    "accepted",
    "refused",
    "degraded_by",
    "relocalised",
    "loops",
    "restarted",
    "slipped",
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
    "cf_rate_used",
    "cf_rate_contradicted",
    "depth_rows",
    "births_instant",
    "births_depth",
    "births_delayed",
    "births_undelayed",
    "candidates_off_arc",
    "candidates_fixed",
    "left_out_pct",
    "wearers",
    "wearers_unseen",
    "deleted",
    "map_size",
    "candidates",
    "overlap",
    "nis",
    "nis_dof",
    "hohct_order",
    "hohct_exact",
    "bounded",
    "baseline_m",
    "t_cf_correction_m",
    "t_cf_correction_deg",
    "t_cf_against",
    "size_against",
    "t_cf_length_doubt",
    "ms_predict",
    "ms_search",
    "ms_cf",
    "ms_update",
    "ms_relocalise",
    "ms_map",
    "ms_total",
)
_CORRECTED_NOTE = "# Valid poses, as the loops of the whole run correct them."
_SUBMAPS_NOTE = "# Poses at the ends of submaps, as loops correct them."
_LEVEL_NOTE = "# W is level here: x ahead, y left, z up; the covariance has what is not known of that."
_TRUTH_NOTE = "# True poses, moved so that the one at the start equals the estimate's."
_TRUTH_NOTE_SCALED = "# True poses, moved so that the one at the start equals the estimate's, in its unit."
LEADING = ("index", "t", "status", "valid", "started", "worn")


class ResultWriter:
    """Writes the files of one run into a folder; use it as a context manager.

    What was written stays, however the run ends; leaving the block closes the files.  If an error leaves it
    that is no `CollabslamError`, its traceback is kept beside the results.

    Parameters
    ----------
    folder : Path
        Of this run alone, see `folder.claim`; results of an earlier one in it are removed.
    config : str
        Content of ``config.yaml``.
    unit : str
        Of lengths, for the trajectory's header.
    persons : sequence of str
        Who wears a camera, "" for a single one's.
    resumed : RunRecord, optional
        Frames of the same run until its checkpoint: their lines are kept, what came later is cut off.

    Raises
    ------
    DataError
        If the folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        config: str,
        unit: str = METRES,
        persons: Sequence[str] = (),
        resumed: RunRecord | None = None,
    ) -> None:
        self.folder = folder
        self._unit, self._persons = unit, persons
        self._worn = WornTracks(folder, persons, unit)
        self._record = resumed or RunRecord()
        if resumed is None:
            clear_folder(folder, (*(name for name in _OWN if name != CONFIG), *PATTERNS))
            write_text(folder / CONFIG, config)
        else:
            clear_folder(folder, (*AT_THE_END, TRACEBACK))
        self._columns = self._write_lines()
        self._count = len(self._record)
        self._frames, self._covariances, self._poses = open_lines(*(folder / name for name in LINES))

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for lines in (self._frames, self._covariances, self._poses, self._worn):
            lines.close()
        with contextlib.suppress(DataError):  # a disk that is full was told of before
            if self._count != len(self._record):  # stopped between two lines of a frame
                self._write_lines()
                self._worn.close()
            if isinstance(error, Exception) and not isinstance(error, CollabslamError):
                write_text(self.folder / TRACEBACK, "".join(traceback.format_exception(error)))
                error.kept_in = self.folder / TRACEBACK  # type: ignore[attr-defined]

    def frame(self, record: RunRecord) -> None:
        """Append the record's last frame to the files that grow."""
        self._record = record
        index = len(record) - 1
        step = record.steps[index]
        if not self._columns:
            self._columns = frame_columns(step.diagnostics, self._persons)
            self._frames.append(csv_line(self._columns))
        self._frames.append(csv_line(_frame_cells(record, index, self._columns)))
        if record.valid_at(index):
            self._covariances.append(covariance_line(step.t, step.covariance))
            self._poses.append(tum_line(step.t, step.pose))
        self._worn.frame(step)
        self._count = len(record)

    def checkpoint(self, write: Callable[[Path], None]) -> None:
        """Bring what was written to the disk, then let ``write`` write the checkpoint into its place."""
        for lines in (self._frames, self._covariances, self._poses, self._worn):
            lines.sync()
        write(self.folder / CHECKPOINT)

    def finish(
        self,
        record: RunRecord,
        landmarks: Landmarks | None,
        truth: Array | None,
        summary: Mapping[str, Any],
        submaps: SubmapPoses | None = None,
    ) -> None:
        """Write everything that needs the whole run.

        Parameters
        ----------
        record : RunRecord
        landmarks : Landmarks or None
        truth : (N, 4, 4) array or None
            In W, NaN where missing.
        summary : mapping
        submaps : SubmapPoses, optional
        """
        if truth is not None:
            write_tum(
                self.folder / GROUND_TRUTH,
                record.times,
                truth,
                note=_TRUTH_NOTE if self._unit == METRES else _TRUTH_NOTE_SCALED,
                unit=self._unit,
            )
        if landmarks is not None:
            write_ply(self.folder / MAP, landmarks, self._unit)
        if submaps is not None:
            self._way(record, submaps)
        write_summary(self.folder / SUMMARY, summary)

    def _way(self, record: RunRecord, submaps: SubmapPoses) -> None:
        """What the loops of the whole run correct."""
        times, unit = record.times[record.valid], self._unit
        poses = submaps.corrected(times, record.poses[record.valid])
        write_tum(self.folder / CORRECTED, times, poses, note=_CORRECTED_NOTE, unit=unit)
        write_tum(self.folder / SUBMAPS, submaps.times, submaps.poses, note=_SUBMAPS_NOTE, unit=unit)
        write_covariances(self.folder / SUBMAPS_COVARIANCE, submaps.times, submaps.covariances, unit)
        write_ply(self.folder / WHOLE_MAP, submaps.landmarks, unit)

    def level(self, record: RunRecord, landmarks: Landmarks, level: Level) -> None:
        """Poses and map in a level world."""
        use, unit = record.valid, self._unit
        poses, covariances = level.poses(record.poses[use], record.covariances[use])
        write_tum(self.folder / LEVEL_TRAJECTORY, record.times[use], poses, note=_LEVEL_NOTE, unit=unit)
        write_covariances(self.folder / LEVEL_COVARIANCE, record.times[use], covariances, unit)
        moved = Landmarks(landmarks.ids, *level.points(landmarks.points, landmarks.covariance))
        write_ply(self.folder / LEVEL_MAP, moved, unit)

    def complete(self) -> None:
        """Nothing is left to do: the checkpoint is removed."""
        (self.folder / CHECKPOINT).unlink(missing_ok=True)

    def _write_lines(self) -> tuple[str, ...]:
        """The files that grow, as whole files from the record; returns the columns of frames.csv."""
        record = self._record
        columns = frame_columns(record.steps[0].diagnostics, self._persons) if record.steps else ()
        rows = (_frame_cells(record, i, columns) for i in range(len(record)))
        text = "".join(csv_line(row) + "\n" for row in ((columns, *rows) if columns else ()))
        write_text(self.folder / FRAMES, text)
        write_trajectory(self.folder, record, self._unit)
        self._worn.begin(record.steps)
        return columns


def clear_folder(folder: Path, names: Iterable[str]) -> None:
    """Remove files of these names or patterns, and what a killed process left of ours; raises DataError if it
    cannot be done."""
    try:
        remove_parts(folder, (*_OWN, *PATTERNS))
        for name in names:
            for path in list(folder.glob(name)):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error


def write_trajectory(folder: Path, record: RunRecord, unit: str = METRES) -> None:
    """``trajectory.tum`` and ``trajectory.cov``: the valid poses, one line of each per pose."""
    use = record.valid
    write_tum(folder / TRAJECTORY, record.times[use], record.poses[use], unit=unit)
    write_covariances(folder / COVARIANCE, record.times[use], record.covariances[use], unit)


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


def frame_columns(diagnostics: Mapping[str, Any], persons: Iterable[str] = ()) -> tuple[str, ...]:
    """Columns of ``frames.csv``: the known ones in a fixed order, any further diagnostics, one of each of
    several persons."""
    known = {*LEADING, *POSE_COLUMNS, *DIAGNOSTICS}
    further = (k for k in diagnostics if k not in known)
    return (*LEADING, *POSE_COLUMNS, *DIAGNOSTICS, *further, *worn_columns(persons))


def frame_cells(
    step: StepResult, index: int, *, worn: bool, more: Mapping[str, Any], columns: Iterable[str]
) -> list[str]:
    """Cells of a line of ``frames.csv``: the step's own, and ``more`` by column."""
    row: dict[str, Any] = {**more, **worn_cells(step.worn)}
    row.update(index=index, t=f"{step.t:.9f}", status=step.status.value, worn=worn)
    row.update(valid=bool(step.valid), started=bool(step.started))
    finite = bool(np.isfinite(step.pose).all())
    numbers = [f"{v:.9f}" for v in position_quaternion(step.pose)] if finite else [""] * len(POSE_COLUMNS)
    row.update(zip(POSE_COLUMNS, numbers, strict=True))
    return [_cell(row.get(column)) for column in columns]


def _frame_cells(record: RunRecord, index: int, columns: Iterable[str]) -> list[str]:
    step = record.steps[index]
    return frame_cells(step, index, worn=record.worn[index], more=step.diagnostics, columns=columns)


def csv_line(cells: Iterable[str]) -> str:
    """Cells as a line of CSV."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(cells)
    return line.getvalue()


def _cell(value: Any) -> str:
    """Text of a cell: flags as 0 and 1, floats short, nothing for what is missing or not finite."""
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return f"{value:.6g}" if math.isfinite(value) else ""
    return "" if value is None else str(value)
