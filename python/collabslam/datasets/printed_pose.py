"""``T_CF`` from printed targets that both cameras see: the worn camera needs no other localisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from collabslam._core import Camera
from collabslam.datasets.calibration import check_resolution
from collabslam.datasets.stream import StreamRecording
from collabslam.errors import DataError, InputError, SettingsError
from collabslam.targets.kinds import Board, Tag
from collabslam.targets.printed import pose_between
from collabslam.types import Image, WornView

KINDS = ("tag:", "board:")
PRINTED_ROLE = "tag:36h11:3=0.16 or board:9x6:0.03 (a printed target that both cameras see; several with +)"


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


@dataclass(frozen=True)
class Unposed:
    """Images of a worn camera without T_CF.

    Attributes
    ----------
    camera : Camera
    views : mapping
        Number of the view taken together with a frame, by the frame's index.
    read : callable
        The image of a view by its number.
    """

    camera: Camera
    views: Mapping[int, int]
    read: Callable[[int], Image]


def with_printed_poses(
    recording: StreamRecording, worn: Mapping[str, Unposed], targets: list[Tag | Board]
) -> StreamRecording:
    """A recording of Cs with the views of each Cf in which both see a target.

    Parameters
    ----------
    recording : StreamRecording
    worn : mapping
        Images of each worn camera by the name of whoever wears it.
    targets : list of Tag and Board

    Raises
    ------
    DataError
        If no view of one was taken together with a frame.
    """
    for one in worn.values():
        if not one.views:
            raise DataError(
                f"No image of Cf in {recording.source} was taken together with one of Cs; put both on one "
                "clock."
            )

    def read_worn(i: int, name: str, one: Unposed) -> WornView | None:
        if i not in one.views:
            return None
        image = one.read(one.views[i])
        check_resolution(one.camera, image, f"of Cf in frame {i} of {recording.source}")
        try:
            pair = pose_between(recording.image(i), recording.camera, image, one.camera, targets)
        except DataError:  # one of them does not see it
            return None
        return WornView(image, *pair, who=name)

    def read_views(i: int) -> list[WornView]:
        found = (read_worn(i, name, one) for name, one in worn.items())
        return [view for view in found if view is not None]

    cameras = {name: one.camera for name, one in worn.items()}
    return replace(recording, worn_cameras=cameras, read_views=read_views, worn_pose="printed target")
