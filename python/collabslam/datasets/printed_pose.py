"""``T_CF`` from printed targets that both cameras see: the worn camera needs no other localisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from collabslam._core import Camera
from collabslam.datasets.calibration import check_resolution
from collabslam.datasets.recorded_worn import RecordedWorn, WornImages
from collabslam.datasets.stream import StreamRecording
from collabslam.errors import DataError, InputError, SettingsError
from collabslam.targets.kinds import Board, Tag
from collabslam.targets.printed import pose_between
from collabslam.types import Image, WornView

KINDS = ("tag:", "board:")
PRINTED_ROLE = "tag:36h11:3=0.16 or board:9x6:0.03 (a printed target that both cameras see; several with +)"

PRINTED = "printed target"
"""What tells T_CF then."""


def printed_source(source: str | None) -> list[Tag | Board]:
    """The targets that a source of ``T_CF`` names, as ``tag:36h11:3=0.16+tag:36h11:4=0.16``; none for others.

    Raises
    ------
    SettingsError
        If a target is not understood, or is a board that looks the same upside down.
    """
    if source is None or not source.startswith(KINDS):
        return []
    targets: list[Tag | Board] = []
    for part in source.split("+"):
        kind, _, rest = part.partition(":")
        if not part.startswith(KINDS):
            raise SettingsError(f"The target '{part}' is not understood; give {PRINTED_ROLE}.")
        try:
            target = Tag.parse(rest) if kind == "tag" else Board.parse(rest)
            if isinstance(target, Board):
                target.check_direction()
        except InputError as error:
            raise SettingsError(str(error)) from error
        targets.append(target)
    return targets


def with_printed_poses(
    recording: StreamRecording, worn: Mapping[str, WornImages], targets: list[Tag | Board]
) -> StreamRecording:
    """A recording of Cs with the views of each Cf in which both see a target.

    Parameters
    ----------
    recording : StreamRecording
    worn : mapping
        Images of each worn camera, those taken together with frames, by the name of whoever wears it.
    targets : list of Tag and Board

    Raises
    ------
    DataError
        If no view of one was taken together with a frame.
    """
    if not all(images for _, images in worn.values()):
        raise DataError(
            f"No image of Cf in {recording.source} was taken together with one of Cs; put both on one clock."
        )

    def read(i: int, camera: Camera, read_image: Callable[[], Image]) -> WornView | None:
        image = read_image()
        check_resolution(camera, image, f"of Cf in frame {i} of {recording.source}")
        try:
            pair = pose_between(recording.image(i), recording.camera, image, camera, targets)
        except DataError:  # one of them does not see it
            return None
        return WornView(image, *pair)

    posed = {
        name: RecordedWorn(camera, {i: partial(read, i, camera, image) for i, image in images.items()})
        for name, (camera, images) in worn.items()
    }
    return replace(recording, worn=posed, worn_pose=PRINTED)
