"""Image streams of the ASL layout: ``data/`` with ``data.csv`` (ns, file name), or stamps as names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from collabslam.datasets.gate import data_lines, leave_columns
from collabslam.datasets.images import list_images, named_file, require_files
from collabslam.datasets.units import as_nanoseconds, read_stamps, seconds
from collabslam.errors import DataError


def read_stream(folder: Path) -> tuple[list[int], list[Path]]:
    """Stamps (nanoseconds) and image files of a camera folder such as ``cam0``, in order of time.

    Raises
    ------
    DataError
        If the list is broken, an image is missing, or a name is not a stamp where there is no list.
    """
    listing = folder / "data.csv"
    if listing.is_file():
        rows = data_lines(listing)
        short = next((n for n, fields in rows if len(fields) < 2), None)
        if short is not None:
            raise DataError(
                f"Line {short} of {listing} needs two columns: the stamp in nanoseconds, the file name."
            )
        leave_columns((fields for _, fields in rows), 2, listing)
        texts, lines = [fields[0] for _, fields in rows], [n for n, _ in rows]
        files = [named_file(folder / "data", fields[1], f"line {n} of {listing}") for n, fields in rows]
        where = listing
    else:
        files = list_images(folder / "data")
        texts, lines, where = [p.stem for p in files], [], folder / "data"
    stamps = as_nanoseconds(read_stamps(texts, str(where), lines=lines, usual="nanoseconds"))
    pairs = sorted(zip(stamps, files, strict=True), key=lambda pair: pair[0])
    paths = [p for _, p in pairs]
    require_files(paths)
    return [s for s, _ in pairs], paths


def match_stamps(stamps: list[int], others: list[int], tolerance: int) -> Mapping[int, int]:
    """For each stamp the nearest of ``others`` within a tolerance, all nanoseconds.

    Both lists are sorted; each of ``others`` serves one stamp at most, the nearest.

    Returns
    -------
    Mapping of index in ``stamps`` to index in ``others``
    """
    found: dict[int, tuple[int, int]] = {}
    reference = np.asarray(stamps, dtype=np.int64)
    for j, other in enumerate(others):
        after = int(np.searchsorted(reference, other))
        for i in (after - 1, after):
            if 0 <= i < len(stamps):
                gap = abs(stamps[i] - other)
                if gap <= tolerance and (i not in found or gap < found[i][0]):
                    found[i] = (gap, j)
    taken: dict[int, tuple[int, int]] = {}
    for i, (gap, j) in sorted(found.items()):
        if j not in taken or gap < taken[j][0]:
            taken[j] = (gap, i)
    return {i: j for j, (_, i) in sorted(taken.items())}


def views_of_frames(stamps: list[int], views: list[int], ahead: int) -> Mapping[int, int]:
    """The view of Cf that comes with each frame: one of its instant, or of the time since the frame before.

    All are nanoseconds, and sorted.  Of several views the one nearest to the frame counts.  However long that
    time is, how late a view may be is the engine's to say (``worn.late``); before the first frame it is as
    long as frames are apart.

    Parameters
    ----------
    stamps : list of int
        Of the frames of Cs.
    views : list of int
        Of the views of Cf, which has a clock of its own.
    ahead : int
        A view that is taken up to so much after a frame comes with it.

    Returns
    -------
    Mapping of index in ``stamps`` to index in ``views``
    """
    reference = np.asarray(stamps, dtype=np.int64)
    apart = int(np.median(np.diff(reference))) if len(stamps) > 1 else ahead
    found: dict[int, tuple[int, int]] = {}
    for j, view in enumerate(views):
        i = int(np.searchsorted(reference, view - ahead))
        if i == len(stamps):
            break
        gap = abs(stamps[i] - view)
        if (i or gap <= apart) and (i not in found or gap <= found[i][0]):
            found[i] = (gap, j)
    return {i: j for i, (_, j) in sorted(found.items())}


def own_time(stamp: int, frame: int) -> float | None:
    """``WornView.t`` of a view with this stamp that comes with that frame's: None if they are the same."""
    return None if stamp == frame else seconds(stamp)
