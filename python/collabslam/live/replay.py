"""A record of a live run through the filter again: the same poses to the last bit."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from collabslam.errors import SettingsError
from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.live.core import LiveCore
from collabslam.live.printed import make_slam
from collabslam.live.record import EventReader
from collabslam.live.results import LiveResults
from collabslam.runs.folder import claim
from collabslam.settings.table import Settings


def replay(record: Path, out: Path, *, overwrite: bool = False) -> dict[str, Any]:
    """Run a record and write the result folder of the live run.

    Parameters
    ----------
    record : Path
        What ``collabslam live robot --record`` wrote.
    out : Path
        Result folder; a numbered one beside it if an earlier run's results are in it.
    overwrite : bool
        Take it even so.

    Raises
    ------
    DataError
        If the record is none, or broken, or the folder cannot be written.
    FilterError
        If the filter meets a numerical state from which it cannot go on.
    """
    reader = EventReader(record)
    plan = reader.plan
    try:
        settings = Settings.from_flat(plan.settings)
    except SettingsError as error:
        raise SettingsError(f"The record {record} is of another version. {error}") from error
    cameras = (reader.camera, reader.worn_cameras)
    slam = make_slam(
        *cameras,
        plan.targets,
        settings=settings,
        mode=plan.mode,
        start=plan.start,
        t_bc=plan.mount,
        imu=plan.sensor,
    )
    core = LiveCore(slam, targets=plan.targets)
    with contextlib.ExitStack() as stack:
        folder = claim(out, stack, overwrite=overwrite)
        unit = ARBITRARY if plan.start == "scale-free" else METRES
        results = LiveResults(folder, settings, unit, persons=list(slam.worn_cameras))
        stack.callback(results.close)
        for event in reader.events():
            pose = core.handle(event)
            if pose is not None:
                results.frame(pose)
        dropped = {f"dropped {k}": v for k, v in core.dropped.items()}
        facts = {**dropped, "mode": plan.mode, "interrupted": False, "folder": str(folder)}
        results.finish(slam, facts)
    return {**results.facts, **facts}
