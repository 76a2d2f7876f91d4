"""Measures what is promised of reliability: one file of results, one page of tables."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.errors import DataError
from collabslam.formats.files import write_text
from collabslam.runs.results import write_summary
from collabslam_lab.reliability.attacks.table import attacks_markdown, measure_attacks
from collabslam_lab.reliability.endurance import endure_session, many_dropped
from collabslam_lab.reliability.kills import run_kills
from collabslam_lab.reliability.lengths import lengths_markdown, measure_lengths
from collabslam_lab.reliability.live_inputs import fuzz_live
from collabslam_lab.reliability.readers import ReaderFindings, fuzz_readers
from collabslam_lab.reliability.table import faults_markdown, measure_faults
from collabslam_lab.report import markdown_table

PARTS = ("attacks", "faults", "lengths", "readers", "live", "core", "endurance", "kills")


@dataclass(frozen=True)
class Amounts:
    """How much is measured.

    Attributes
    ----------
    seeds : int
        Seeds of each fault.
    core_inputs, reader_inputs, live_inputs : int
        Inputs to the core's targets, to the readers of files, and messages of devices and of pages each.
    steps : int
        Steps of a filter alone.
    session_s : float
        Length of the session of frames, seconds.
    kills : int
        Kills of running processes.
    """

    seeds: int
    core_inputs: int
    reader_inputs: int
    live_inputs: int
    steps: int
    session_s: float
    kills: int


SHORT = Amounts(1, 20_000, 2_000, 10_000, 20_000, 60.0, 3)
FULL = Amounts(5, 10_000_000, 200_000, 500_000, 1_000_000, 3600.0, 50)


def measure(
    parts: Sequence[str],
    out: Path,
    *,
    full: bool = False,
    seed: int = 0,
    jobs: int = 1,
    driver: Path | None = None,
) -> bool:
    """Measures the parts, and adds them to the results in ``out``.

    Parameters
    ----------
    parts : sequence of str
        Of `PARTS`.
    out : Path
        ``reliability.json``; what it holds of other parts is kept.
    full : bool
        `FULL` amounts in place of the `SHORT` ones.
    seed : int
    jobs : int
        Attacks that are made at the same time.
    driver : Path, optional
        The built ``fuzz`` program; without it the core is not fuzzed and no filter runs alone.

    Returns
    -------
    bool
        Whether no attack succeeded, nothing was found and P was sound.

    Raises
    ------
    DataError
        If ``out`` holds something else, or the driver cannot be run.
    """
    amounts = FULL if full else SHORT
    results = _known(out)
    for part in parts:
        for found in _measured(part, amounts, seed, jobs, driver):
            results.update(found)
            results.update(_totals(results))
            write_summary(out, results)
    text = figures_markdown(results)
    write_text(out.with_suffix(".md"), text + "\n")
    print(text)
    print(f"results are in {out}")
    failed = results.get("fuzz_findings") or results.get("attacks_succeeded")
    return not failed and results.get("endurance_sound", True) is True


def _known(out: Path) -> dict[str, Any]:
    """What the file holds already; asked before anything is measured, as that may take an hour."""
    if not out.exists():
        return {}
    try:
        results: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
        _totals(results)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise DataError(
            f"{out} does not hold results of this version of the command; remove it, or name another file "
            "with --out."
        ) from error
    return results


def _measured(
    part: str, amounts: Amounts, seed: int, jobs: int, driver: Path | None
) -> Iterator[dict[str, Any]]:
    """Results of a part, as they come."""
    if part == "attacks":
        yield _attacks(jobs)
    elif part == "faults":
        yield _faults(amounts, seed)
    elif part == "lengths":
        yield _lengths(amounts, seed)
    elif part == "readers":
        yield {"fuzz_readers": _readers(amounts, seed)}
    elif part == "live":
        yield {"fuzz_live": _told(fuzz_live(amounts.live_inputs, seed))}
    elif part == "core":
        yield {"fuzz_core": _core(amounts, seed, driver)}
    elif part == "kills":
        yield {"kills_survived": run_kills(amounts.kills, seed)}
    else:
        yield {"session": endure_session(amounts.session_s, seed).jsonable()}
        yield {"engines_growth_mb": many_dropped()}
        if driver is not None:
            yield {"filter_alone": _drive(driver, "endure", amounts.steps, seed)}


def _totals(results: dict[str, Any]) -> dict[str, Any]:
    """What follows from the parts that are there."""
    fuzzed = [results[key] for key in ("fuzz_readers", "fuzz_live", "fuzz_core") if key in results]
    totals = {f"fuzz_{key}": sum(part[key] for part in fuzzed) for key in ("executions", "findings")}
    session, alone = results.get("session"), results.get("filter_alone")
    growth = [results["engines_growth_mb"]] if "engines_growth_mb" in results else []
    if session is not None:
        growth.append(session["memory_growth_mb"])
        totals["endurance_sound"] = session["sound"]
    if alone is not None:
        growth += [alone["memory_growth_mb"], alone["dropped_growth_mb"]]
        totals["endurance_steps"] = alone["steps"]
        totals["endurance_sound"] = totals.get("endurance_sound", True) and bool(alone["threads_equal"])
    finite = [float(g) for g in growth if g is not None and math.isfinite(g)]
    return totals | ({"memory_growth_mb": max(finite)} if finite else {})


def _attacks(jobs: int) -> dict[str, Any]:
    results = measure_attacks(jobs=jobs, progress=True)
    print(attacks_markdown(results))
    return {
        "attacks": [result.jsonable() for result in results],
        "attacks_made": len(results),
        "attacks_succeeded": sum(result.succeeded for result in results),
        "attacks_beyond_images": sum(result.beyond for result in results),
    }


def _faults(amounts: Amounts, seed: int) -> dict[str, Any]:
    rows = measure_faults(range(seed, seed + amounts.seeds), progress=True)
    print(faults_markdown(rows))
    return {"faults": [row.jsonable() for row in rows], "fault_seeds": amounts.seeds}


def _lengths(amounts: Amounts, seed: int) -> dict[str, Any]:
    rows = measure_lengths(range(seed, seed + amounts.seeds), progress=True)
    print(lengths_markdown(rows))
    return {"lengths": [row.jsonable() for row in rows], "length_seeds": amounts.seeds}


def _readers(amounts: Amounts, seed: int) -> dict[str, int]:
    return _told(fuzz_readers(amounts.reader_inputs, seed))


def _told(found: ReaderFindings) -> dict[str, int]:
    for finding in found.findings:
        print(finding)
    return {"executions": found.executions, "findings": len(found.findings)}


def _core(amounts: Amounts, seed: int, driver: Path | None) -> dict[str, int]:
    if driver is None:
        return {"executions": 0, "findings": 0}
    done = _drive(driver, "inputs", amounts.core_inputs, seed, 2)
    return {key: int(done[key]) for key in ("executions", "findings")}


def _drive(driver: Path, *words: object) -> dict[str, Any]:
    """What the core's driver answers; its findings go to standard error."""
    try:
        done = subprocess.run([str(driver), *map(str, words)], stdout=subprocess.PIPE, text=True, check=False)
        answer: dict[str, Any] = json.loads(done.stdout)
    except (OSError, ValueError) as error:
        raise DataError(
            f"The program {driver} cannot be run; build it with cargo build --release -p collabslam-fuzz."
        ) from error
    return answer


def figures_markdown(results: dict[str, Any]) -> str:
    """The figures beside the faults, as a table."""
    session, alone = results.get("session", {}), results.get("filter_alone", {})
    readers, core = results.get("fuzz_readers", {}), results.get("fuzz_core", {})
    live = results.get("fuzz_live", {})
    rows = [
        ("attacks", results.get("attacks_made")),
        ("attacks that succeeded", results.get("attacks_succeeded")),
        ("attacks that no image tells of", results.get("attacks_beyond_images")),
        ("kills survived", results.get("kills_survived")),
        ("inputs to the core's targets", core.get("executions")),
        ("promises broken by them", core.get("findings")),
        ("damaged files", readers.get("executions")),
        ("promises broken by them", readers.get("findings")),
        ("messages of devices and pages", live.get("executions")),
        ("promises broken by them", live.get("findings")),
        ("steps of a filter alone", results.get("endurance_steps")),
        ("its time a step, last tenth over second", alone.get("step_time_ratio")),
        ("frames of one session", session.get("frames")),
        ("its time a frame, last fifth over second", session.get("time_ratio")),
        ("least eigenvalue of the scaled P", session.get("least_eigenvalue")),
        ("largest growth of memory, MB", results.get("memory_growth_mb")),
        ("of which 100 engines made and dropped, MB", results.get("engines_growth_mb")),
    ]
    shown = [(name, _shown(value)) for name, value in rows if value is not None]
    return markdown_table(("figure", "value"), shown)


def _shown(value: float) -> str:
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ")
    return f"{value:.1e}" if abs(value) < 1e-3 else f"{value:.2f}"
