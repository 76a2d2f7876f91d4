"""A recording whose stamps repeat, swap or jump, without the frames that cannot be used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collabslam.datasets.gate import tell
from collabslam.datasets.recording import ImageRecording
from collabslam.datasets.stamps import usable_frames
from collabslam.datasets.stream import StreamRecording
from collabslam.errors import DataError
from collabslam.types import Array, Indices

_FEW = 3
"""Of more frames half must be usable: what one bad stamp costs is one frame."""
_MANY = 0.1
"""Share of the frames that repeat a stamp from which on their images are looked at, too."""
_LOOKED_AT = 8
"""Of these frames that are looked at."""
DiskRecording = ImageRecording | StreamRecording


def in_order(recording: DiskRecording) -> DiskRecording:
    """The recording with stamps that increase: see `collabslam.datasets.stamps.usable_frames`.

    Raises
    ------
    DataError
        If no frame has a stamp that can be used, most have none, or many repeat the stamp of another image.
    """
    kept, times = usable_frames(recording.times)
    if len(kept) == len(recording) and (times == recording.times).all():
        return recording
    if not len(kept):
        raise DataError(f"The recording {recording.source} has no usable time stamp; give finite ones.")
    if len(kept) * 2 < len(recording) > _FEW:
        raise DataError(
            f"Of the {len(recording)} frames of {recording.source} only {len(kept)} have stamps that "
            "increase: they repeat (whole seconds, digits cut off, one stamp for all), go back, or are "
            "intervals; give the time of each frame."
        )
    _check_repeated(recording)
    if gone := len(recording) - len(kept):
        why = "their stamps repeat, go back or are far off"
        tell("passed over", f"{gone} of {len(recording)} frames ({why})", recording.source)
    if (times != recording.times[kept]).any():
        tell("stamps", "set forward where the clock was set back", recording.source)
    if isinstance(recording, StreamRecording):
        return _stream(recording, kept, times)
    return _images(recording, kept, times)


def _check_repeated(recording: DiskRecording) -> None:
    """Refuses many frames that have the stamp of the one before, but another image: digits were cut off."""
    again = np.flatnonzero(np.diff(recording.times) == 0.0) + 1
    if len(again) < max(_FEW, _MANY * len(recording)):
        return
    some = again[np.unique(np.linspace(0, len(again) - 1, _LOOKED_AT).round().astype(int))].tolist()
    others = sum(not np.array_equal(recording.image(i), recording.image(i - 1)) for i in some)
    if 2 * others > len(some):
        raise DataError(
            f"{len(again)} of the {len(recording)} frames of {recording.source} have the stamp of the frame "
            "before, and another image: digits of the stamps were cut off; give the time of each frame."
        )


def _stream(recording: StreamRecording, kept: Indices, times: Array) -> StreamRecording:
    read, indices = recording.read, kept.tolist()
    read_depth = recording.read_depth
    return replace(
        recording,
        times=times,
        truth=None if recording.truth is None else recording.truth[kept],
        read=lambda i: read(indices[i]),
        worn={name: one.of_frames(kept) for name, one in recording.worn.items()},
        read_depth=None if read_depth is None else lambda i: read_depth(indices[i]),
        left_out=len(recording) - len(kept),
    )


def _images(recording: ImageRecording, kept: Indices, times: Array) -> ImageRecording:
    new = {old: k for k, old in enumerate(kept.tolist())}
    rig, depth = recording.rig, recording.depth
    if depth is not None:
        depth = {new[i]: image for i, image in depth.items() if i in new}
    if rig is not None:
        rig = replace(rig, paths={new[i]: path for i, path in rig.paths.items() if i in new})
    return replace(
        recording,
        paths=tuple(recording.paths[i] for i in new),
        times=times,
        truth=None if recording.truth is None else recording.truth[kept],
        rig=rig,
        worn={name: one.of_frames(kept) for name, one in recording.worn.items()},
        depth=depth,
        left_out=len(recording) - len(kept),
    )
