"""Every fault on the demo: what becomes of the run, and its error against the clean run's."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from collabslam.errors import CollabslamError
from collabslam.runs.plan import Output
from collabslam.runs.runner import run
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import corridor_recording
from collabslam.types import Recording
from collabslam_lab.reliability.faults import FAULTS, Fault, inject
from collabslam_lab.report import markdown_table

MODE = "collab"
ERROR = "avg_position_error_all_m"
"""Average position error over all frames from the start on, LOST ones too: getting lost does not pay."""


@dataclass(frozen=True)
class FaultRow:
    """What a fault did, medians over the seeds.

    Attributes
    ----------
    fault : Fault
    error_ratio : float or None
        Average position error over the clean run's; None where the run stops.
    ratios : list of float
        The same of each seed.
    ok_share : float or None
        Share of the frames that are OK.
    lost : int or None
        Frames that are LOST, of all seeds.
    unused : int or None
        Frames left out or only predicted, of all seeds.
    error : str
        The error that ended the run, empty if none did.
    """

    fault: Fault
    error_ratio: float | None
    ratios: list[float]
    ok_share: float | None
    lost: int | None
    unused: int | None
    error: str = ""

    def jsonable(self) -> dict[str, Any]:
        """As a row of ``reliability.json``."""
        return {
            "fault": self.fault.name,
            "what": self.fault.what,
            "answer": self.fault.answer,
            "error_ratio": self.error_ratio,
            "error_ratios": self.ratios,
            "ok_share": self.ok_share,
            "frames_lost": self.lost,
            "frames_unused": self.unused,
            "error": self.error,
        }


def measure_faults(
    seeds: Sequence[int],
    *,
    faults: Iterable[Fault] = FAULTS,
    length_m: float = 15.0,
    progress: bool = False,
) -> list[FaultRow]:
    """Runs every fault on the demo's corridor, for each seed, beside the clean run.

    Parameters
    ----------
    seeds : sequence of int
        Of the demo's noise and of the faults.
    faults : iterable of Fault
    length_m : float
        Length of the corridor, metres.
    progress : bool
        Whether to show progress on standard error.
    """
    faults = list(faults)
    outcomes: dict[str, list[dict[str, Any]]] = {fault.name: [] for fault in faults}
    for seed in seeds:
        clean = HeldRecording(corridor_recording(seed, length_m=length_m))
        best = _run(clean, progress)[ERROR]
        for fault in faults:
            outcomes[fault.name].append({**_run(inject(clean, fault, seed), progress), "clean": best})
    return [_row(fault, outcomes[fault.name]) for fault in faults]


def _run(recording: Recording, progress: bool) -> dict[str, Any]:
    try:
        return run(recording, mode=MODE, start="worn", out=Output(progress=progress)).summary
    except CollabslamError as error:
        return {"error": str(error)}


def _row(fault: Fault, outcomes: list[dict[str, Any]]) -> FaultRow:
    errors = [o["error"] for o in outcomes if "error" in o]
    if errors:
        return FaultRow(fault, None, [], None, None, None, errors[0])
    ratios = [o[ERROR] / o["clean"] for o in outcomes]
    return FaultRow(
        fault,
        statistics.median(ratios),
        ratios,
        statistics.median(o["ok_share"] for o in outcomes),
        sum(o["frames_lost"] for o in outcomes),
        sum(o["frames_out_of_order"] + o["frames_unseen"] for o in outcomes),
    )


def faults_markdown(rows: Iterable[FaultRow]) -> str:
    """The table of the documentation."""
    header = ("fault", "what happens to the stream", "answer", "error / clean", "frames OK", "LOST", "unused")
    lines = []
    for row in rows:
        fault = row.fault
        cells = ["stops", "", "", ""]
        if row.error_ratio is not None:
            cells = [
                f"{row.error_ratio:.2f}",
                f"{100.0 * (row.ok_share or 0.0):.0f} %",
                f"{row.lost}",
                f"{row.unused}",
            ]
        lines.append([fault.name, fault.what, fault.answer, *cells])
    return markdown_table(header, lines)
