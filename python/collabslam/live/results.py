"""The result folder of a live run: it grows line by line, whatever ends the run, and holds nothing back."""

from __future__ import annotations

import contextlib
import csv
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.errors import DataError
from collabslam.formats.files import open_lines, read_own_text, write_text
from collabslam.formats.landmarks import write_ply
from collabslam.formats.trajectory import covariance_line, tum_line, write_covariances, write_tum
from collabslam.live.core import LivePose
from collabslam.runs.folder import CONFIG
from collabslam.runs.results import (
    COVARIANCE,
    FRAMES,
    MAP,
    PICTURE,
    SUMMARY,
    TRAJECTORY,
    clear_folder,
    csv_line,
    frame_cells,
    frame_columns,
    write_summary,
)
from collabslam.runs.worn_results import PATTERNS, WornTracks
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.version import version

ENGINE = "engine.bin"
"""The checkpoint: the engine after some frame."""
_LINES = (FRAMES, TRAJECTORY, COVARIANCE)


class LiveResults:
    """Writes the files of one live run into its folder.

    ``frames.csv``, ``trajectory.tum``, ``trajectory.cov`` and those of `worn_results` as a run's, with the
    columns ``link`` and ``session``; ``engine.bin``, from which a run that was killed goes on; at the end
    ``map.ply`` and ``summary.json``.

    Parameters
    ----------
    folder : Path
        Claimed for this run.
    settings : Settings
    unit : str
        Of lengths.
    persons : sequence of str
        Who wears a camera, "" for a single one's.
    every : int
        Frames between two checkpoints.
    resumed : bool
        Whether to go on with the lines that are there.

    Raises
    ------
    DataError
        If the folder cannot be written, or is damaged.
    """

    def __init__(
        self,
        folder: Path,
        settings: Settings,
        unit: str,
        *,
        persons: Sequence[str] = (),
        every: int = 50,
        resumed: bool = False,
    ) -> None:
        self.folder, self._every = folder, every
        self._unit, self._persons = unit, persons
        self._worn = WornTracks(folder, persons, unit)
        self._columns: tuple[str, ...] = ()
        self._last = -float("inf")
        self.frames, self.statuses, self.links = 0, Counter[str](), Counter[str]()
        if resumed:
            self._take_up()
        else:
            clear_folder(folder, (ENGINE, MAP, PICTURE, SUMMARY, *PATTERNS))
            write_text(folder / CONFIG, settings.dump(title="as used by a live run"))
            write_text(folder / FRAMES, "")
            none = np.empty(0)
            write_tum(folder / TRAJECTORY, none, np.empty((0, 4, 4)), unit=unit)
            write_covariances(folder / COVARIANCE, none, np.empty((0, 6, 6)), unit)
        self._frames, self._poses, self._covariances = open_lines(*(folder / name for name in _LINES))
        with contextlib.ExitStack() as opened:
            opened.callback(self.close)
            if resumed:
                self._worn.take_up()
            else:
                self._worn.begin()
            opened.pop_all()

    def frame(self, pose: LivePose) -> None:
        """Add a frame, unless it was written before a kill; raises DataError if the disk is full."""
        step = pose.step
        self._worn.frame(step)  # of its own count: a kill may come between two files
        t = round(step.t, 9)  # as files have it
        if t <= self._last:
            return
        self._last = t
        diagnostics = {**step.diagnostics, "link": pose.link, "session": " ".join(pose.sessions)}
        if not self._columns:
            self._columns = frame_columns(diagnostics, self._persons)
            self._frames.append(csv_line(self._columns))
        worn = bool(pose.views)
        cells = frame_cells(step, self.frames, worn=worn, more=diagnostics, columns=self._columns)
        self._frames.append(csv_line(cells))
        if step.valid and np.isfinite(step.pose).all() and np.isfinite(step.covariance).all():
            self._covariances.append(covariance_line(step.t, step.covariance))
            self._poses.append(tum_line(step.t, step.pose))
        self.frames += 1
        self.statuses[step.status.value] += 1
        self.links[pose.link] += 1

    def checkpoint(self, slam: Slam) -> None:
        """Keep the engine as it is, if it is time; raises DataError if it cannot be written."""
        if self.frames % self._every == 0:
            slam.save(self.folder / ENGINE)

    @property
    def facts(self) -> dict[str, Any]:
        """What was counted."""
        return {
            "version": version(),
            "unit": self._unit,
            "frames": self.frames,
            "statuses": dict(self.statuses),
            "links": dict(self.links),
        }

    def finish(self, slam: Slam, facts: dict[str, Any]) -> None:
        """What needs the whole run, each whether or not another can be written."""
        with contextlib.ExitStack() as stack:  # the last one first
            stack.callback(slam.save, self.folder / ENGINE)
            stack.callback(write_summary, self.folder / SUMMARY, {**self.facts, **facts})
            stack.callback(write_ply, self.folder / MAP, slam.landmarks(), self._unit)

    def close(self) -> None:
        """Close the files."""
        for lines in (self._frames, self._poses, self._covariances, self._worn):
            lines.close()

    def _take_up(self) -> None:
        """Count the lines that are there; one that a killed process left unfinished is cut off."""
        for name in _LINES:
            path = self.folder / name
            text = read_own_text(path)
            if text and not text.endswith("\n"):
                write_text(path, text[: text.rfind("\n") + 1])
        self._columns, self.frames, self._last = written_frames(self.folder / FRAMES)


def written_frames(path: Path) -> tuple[tuple[str, ...], int, float]:
    """Columns of a ``frames.csv``, its frames, and the time of the last, seconds.

    Raises
    ------
    DataError
        If the file is damaged.
    """
    text = read_own_text(path)
    if not text:
        return (), 0, -float("inf")
    try:
        header, *rows = csv.reader(io.StringIO(text), strict=True)
        at = header.index("t")
        times = [float(row[at]) for row in rows]
    except (csv.Error, ValueError, IndexError) as error:
        raise _damaged(path) from error
    if any(len(row) != len(header) for row in rows) or not np.isfinite(times).all():
        raise _damaged(path)
    return tuple(header), len(rows), max(times, default=-float("inf"))


def _damaged(path: Path) -> DataError:
    return DataError(f"The file {path} is not a table of frames; the folder is damaged: leave --resume out.")
