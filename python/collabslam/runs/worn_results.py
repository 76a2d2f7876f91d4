"""Where the worn cameras were, as result files: a trajectory of each, with its covariance; their numbers.

``worn.tum`` and ``worn.cov`` are those of a single worn camera, ``worn-NAME.tum`` and ``worn-NAME.cov`` of
each of several persons.  They have a line for each view that a frame with a valid pose used or looked at,
with the time at which it was taken: `T_WF` as its matches tell it, or where none did, as `T_CF` does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.errors import DataError
from collabslam.evaluation.record import is_valid
from collabslam.evaluation.worn_places import Places
from collabslam.formats.files import LineFile, open_lines, read_own_text, write_text
from collabslam.formats.trajectory import covariance_header, covariance_line, tum_header, tum_line
from collabslam.results import StepResult, WornPose

PATTERNS = ("worn.tum", "worn.cov", "worn-*.tum", "worn-*.cov")
"""Names of these files."""


def worn_files(name: str) -> tuple[str, str]:
    """Poses and covariances of a person's worn camera; of a single one's if the name is empty."""
    stem = f"worn-{name}" if name else "worn"
    return f"{stem}.tum", f"{stem}.cov"


class WornTracks:
    """The files of one run's worn cameras, which grow line by line.

    Parameters
    ----------
    folder : Path
    names : iterable of str
        Of the persons, "" for a single one's.
    unit : str
        Of lengths.

    Raises
    ------
    DataError
        If the folder cannot be written; so do the methods.
    """

    def __init__(self, folder: Path, names: Iterable[str], unit: str) -> None:
        self._folder, self._unit = folder, unit
        self._files: dict[str, list[LineFile]] = {}
        self._last = dict.fromkeys(names, -float("inf"))

    def begin(self, steps: Iterable[StepResult] = ()) -> None:
        """Write whole files from the frames that there are."""
        self.close()
        self._last = dict.fromkeys(self._last, -float("inf"))
        lines: dict[str, list[WornPose]] = {name: [] for name in self._last}
        for step in steps:
            for name, place in self._following(step):
                lines[name].append(place)
        for name, places in lines.items():
            poses, covariances = self._paths(name)
            whose = f"# C is the worn camera{' of ' + name if name else ''}, when its views were taken."
            body = "".join(tum_line(place.t, place.pose) + "\n" for place in places)
            write_text(poses, tum_header(self._unit, whose) + body)
            body = "".join(covariance_line(place.t, place.covariance) + "\n" for place in places)
            write_text(covariances, covariance_header(self._unit, poses.name) + body)
            self._files[name] = open_lines(poses, covariances)

    def take_up(self) -> None:
        """Go on with the files that are there; what a killed process left unfinished is cut off.

        Raises DataError if one is missing or damaged otherwise.
        """
        for name in self._last:
            paths = self._paths(name)
            texts = [read_own_text(path) for path in paths]
            lines = [text[: text.rfind("\n") + 1].splitlines(keepends=True) for text in texts]
            heads = [[line for line in each if line.startswith("#")] for each in lines]
            rows = [each[len(head) :] for each, head in zip(lines, heads, strict=True)]
            count = min(map(len, rows))
            for path, text, head, each in zip(paths, texts, heads, rows, strict=True):
                whole = "".join((*head, *each[:count]))
                if whole != text:
                    write_text(path, whole)
            self._last[name] = stamp_of_line(paths[0], rows[0][count - 1]) if count else -float("inf")
            poses, covariances = paths
            self._files[name] = open_lines(poses, covariances)

    def frame(self, step: StepResult) -> None:
        """Add a frame's."""
        for name, place in self._following(step):
            poses, covariances = self._files[name]
            covariances.append(covariance_line(place.t, place.covariance))
            poses.append(tum_line(place.t, place.pose))

    def sync(self) -> None:
        """Bring what was written to the disk."""
        for file in self._all():
            file.sync()

    def close(self) -> None:
        """Close the files."""
        for file in self._all():
            file.close()
        self._files = {}

    def _all(self) -> list[LineFile]:
        return [file for pair in self._files.values() for file in pair]

    def _paths(self, name: str) -> tuple[Path, Path]:
        poses, covariances = worn_files(name)
        return self._folder / poses, self._folder / covariances

    def _following(self, step: StepResult) -> list[tuple[str, WornPose]]:
        """The places of a frame with a valid pose, each later than its camera's last one."""
        out = []
        for name, place in step.worn.items() if is_valid(step) else ():
            finite = np.isfinite(place.pose).all() and np.isfinite(place.covariance).all()
            t = round(place.t, 9)  # as files have it
            if name in self._last and finite and t > self._last[name]:
                self._last[name] = t
                out.append((name, place))
        return out


def stamp_of_line(path: Path, line: str) -> float:
    """The time with which a line of a trajectory begins; raises DataError if it begins otherwise."""
    try:
        t = float(line.split(maxsplit=1)[0])
    except (ValueError, IndexError):
        t = np.nan
    if not np.isfinite(t):
        raise DataError(f"The last line of {path} has no time; the folder is damaged: run it again.")
    return t


def worn_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Columns of ``frames.csv`` of several persons, one each; a single camera has its own columns there."""
    return tuple(f"worn_{name}" for name in names if name)


def worn_cells(places: Places) -> dict[str, Any]:
    """Their values in a frame: matches of the person's view; 0 if it was not measured, empty without one."""
    return {f"worn_{name}": place.matches if place.measured else 0 for name, place in places.items() if name}


def worn_numbers(names: Sequence[str], steps: Sequence[StepResult]) -> list[dict[str, Any]]:
    """For ``summary.json``: of each person the views that were looked at, those whose matches tell where the
    camera was, matches in such a view, the mean claimed standard deviation of its position, metres, and by
    how much its views are taken after their stamps with the standard deviation of that, seconds, as known at
    the end."""
    out = []
    for name in names:
        places = [step.worn[name] for step in steps if name in step.worn]
        measured = [place for place in places if place.measured]
        sd = [float(np.sqrt(max(np.trace(place.covariance[:3, :3]), 0.0))) for place in measured]
        clock = places[-1].clock if places else None
        offset, offset_sd = clock or (None, None)
        out.append(
            {
                "name": name,
                "views": len(places),
                "measured": len(measured),
                "matches": float(np.mean([place.matches for place in measured])) if measured else None,
                "position_sd_m": float(np.mean(sd)) if measured else None,
                "clock_offset_s": offset,
                "clock_offset_sd_s": offset_sd,
            }
        )
    return out
