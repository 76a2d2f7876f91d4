"""The recording of an entry of the plan, and the views of Cf that it names."""

from __future__ import annotations

from pathlib import Path

from collabslam.datasets import open_recording
from collabslam.datasets.emulated.views import PosedViews, load_views
from collabslam.datasets.images import list_images
from collabslam.datasets.poses import interpolate_track, read_track
from collabslam.datasets.units import as_seconds, read_stamps
from collabslam.types import Recording
from collabslam_lab.benchmark.altered import AlteredRecording
from collabslam_lab.benchmark.plan import Entry

_FIRST_CAMERA = "_0"


def open_folder(entry: Entry, data: Path) -> Recording:
    """The recording in an entry's folder, with the truth that the plan names.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    folder = data / entry.folder
    recording = open_recording(folder, poses=None if entry.truth is None else folder / entry.truth)
    return recording if entry.altered is None else AlteredRecording(recording, entry.altered)


def worn_of(entry: Entry, recording: Recording) -> str | PosedViews:
    """What `collabslam.attach_worn` makes the worn camera of; the entry has one.

    Raises
    ------
    DataError
        If the views cannot be read.
    """
    assert entry.worn is not None
    if entry.view_poses is None:
        return entry.worn
    return views_of(entry, recording)


def views_of(entry: Entry, recording: Recording) -> PosedViews:
    """The posed views of ``views:FOLDER``.

    With `Entry.view_poses` they are images ``<ns>`` or ``<ns>_0``, taken by Cs itself at other times.

    Raises
    ------
    DataError
        If they cannot be read, or have no poses.
    """
    assert entry.worn is not None
    folder = entry.worn.partition(":")[2]
    if entry.view_poses is None:
        return load_views(recording, folder)
    source = Path(recording.source)
    stems = {path: path.stem.removesuffix(_FIRST_CAMERA) for path in list_images(source / folder)}
    stamped = [path for path, stem in stems.items() if stem.isdigit()]
    stamps = read_stamps([stems[path] for path in stamped], str(source / folder), usual="nanoseconds")
    ranked = sorted(range(len(stamped)), key=lambda k: stamps[k])
    paths, times = [stamped[k] for k in ranked], as_seconds(stamps[k] for k in ranked)
    poses = interpolate_track(*read_track(source / entry.view_poses), times, widest=0.0)
    return PosedViews(recording.camera, paths, poses, times)
