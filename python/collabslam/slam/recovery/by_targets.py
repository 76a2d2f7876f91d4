"""A camera found by printed targets of its map, or of an inactive one (METHOD 17)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from collabslam._core import Camera, Filter
from collabslam.slam.map_change import ImagePoints, Recovered
from collabslam.slam.recovery.inactive_map import InactiveMap
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.targets.fix import BELIEVABLE, fixes, surprise
from collabslam.slam.targets.in_map import SeenTarget
from collabslam.types import Array, Ids


def find_by_targets(core: Filter, camera: Camera, seen: Sequence[SeenTarget]) -> Recovered | None:
    """Resets the filter to where the targets in the image put the camera; None if they do not tell.

    Parameters
    ----------
    core : Filter
        Started; it stays as it was where nothing is found.
    camera : Camera
        Cs.
    seen : sequence of SeenTarget
        With features of the map in use.
    """
    landmarks = core.landmarks()
    put = partial(_put, core)
    for fix, least in fixes(core, camera, seen, (landmarks.ids, landmarks.points), put):
        report = core.relocalise(fix.pose, fix.landmarks, fix.uv, least=least)
        if report.accepted:
            core.drop_candidates(core.candidates)
            accepted = report.bearings.accepted
            points = ImagePoints(fix.landmarks[accepted], fix.uv[accepted])
            return Recovered(points, identified=True, jumped=report.jumped)
    return None


def find_in_inactive(
    core: Filter,
    camera: Camera,
    seen: Sequence[SeenTarget],
    maps: Relocaliser,
    old: InactiveMap,
    *,
    lost: bool,
) -> Recovered | None:
    """Leaves the map in use for an inactive one, if the targets in the image put the camera there.

    Parameters
    ----------
    core : Filter
        Started; it stays as it was where nothing is found.
    camera : Camera
        Cs.
    seen : sequence of SeenTarget
        With landmarks by their places in that map.
    maps : Relocaliser
    old : InactiveMap
        One of those that ``maps`` holds.
    lost : bool
        Whether the camera may be anywhere.  Else a target that puts it where it cannot be was moved.
    """
    put = partial(_put_in, core, old)
    for fix, least in fixes(core, camera, seen, (old.use, old.points), put):
        trial = put(fix.pose, fix.landmarks, fix.uv, least)
        if trial is not None and (lost or surprise(core, trial) < BELIEVABLE):
            return maps.enter(old, fix, least)
    return None


def _put(core: Filter, first: Array, ids: Ids, uv: Array, least: int) -> Filter | None:
    """A filter like this one where corners put it; None if they contradict."""
    trial = Filter.restore(core.snapshot())
    return trial if trial.relocalise(first, ids, uv, least=least).accepted else None


def _put_in(core: Filter, old: InactiveMap, first: Array, ids: Ids, uv: Array, least: int) -> Filter | None:
    """The same in another map, whose landmarks ``ids`` are, by their places."""
    trial = Filter.restore(core.snapshot())
    there = trial.relocalise_in(old.landmarks, old.covariance, old.place, first, ids, uv, least=least)
    return trial if there.report.accepted else None
