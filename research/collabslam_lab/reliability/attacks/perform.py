"""Performs an attack in a process of its own, under limits, and tells what became of it."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.cli import BAD_INPUT, FAULT, INTERRUPTED, NOT_TRUSTED, OK, TERMINATED
from collabslam_lab.reliability.attacks.attack import Attack, AttackOutcome, Deed, Result
from collabslam_lab.reliability.attacks.scene import Ground, Scene, program

SECONDS, MEGABYTES = 60.0, 1500.0
"""An attack that takes longer, or more memory, has succeeded."""
WRONG_SHARE = 0.02
"""Largest share of frames that may say OK further than 5 sigma from the truth."""
CHANGED = 4
"""Exit status of a child whose engine is not as before a refused call."""
_ERROR = re.compile(r"(collabslam[\w -]*: )?error: ")
_ADDRESSES_KB = 8_000_000
_FRAMES = 3
_UNCATCHABLE = (signal.SIGKILL, signal.SIGHUP)


@dataclass(frozen=True)
class Ending:
    """How a process ended."""

    status: int
    seconds: float
    memory_mb: float
    said: str
    printed: str
    hung: bool


def perform(attack: Attack, ground: Ground, seconds: float = SECONDS) -> Result:
    """Performs an attack in a new folder, which is removed.

    Parameters
    ----------
    attack : Attack
    ground : Ground
    seconds : float
        After which it hangs.
    """
    with tempfile.TemporaryDirectory(prefix="collabslam-attack-") as name:
        scene = Scene(Path(name).resolve(), ground)
        deed = attack.make(scene)
        before = scene.protected()
        ending = _watched(deed, scene.out, seconds)
        lost = _lost(before, scene.protected())
        summary = _summary(scene.out)
        outcome = judge(attack, ending, lost, summary)
        said = ending.said.replace(str(scene.folder), "...").replace(str(ground.walk.parent), "...")
    return Result(
        attack,
        outcome,
        ending.status,
        ending.seconds,
        ending.memory_mb,
        " ".join(f"{said}{' lost: ' if lost else ''}{', '.join(lost)}".split())[-400:],
        summary.get("ok_share"),
        summary.get("false_ok_share"),
    )


def judge(attack: Attack, ending: Ending, lost: list[str], summary: dict[str, Any]) -> AttackOutcome:
    """What became of an attack.

    Parameters
    ----------
    attack : Attack
    ending : Ending
    lost : list of str
        Files that were there before and are not, or not as they were.
    summary : dict
        Of the run, empty if there is none.
    """
    if ending.hung:
        return AttackOutcome.HANG
    if "Traceback (most recent call last)" in ending.said + ending.printed or ending.status == FAULT:
        return AttackOutcome.TRACEBACK
    if lost:
        return AttackOutcome.LOST
    if ending.memory_mb > MEGABYTES:
        return AttackOutcome.MEMORY
    if ending.status == CHANGED:
        return AttackOutcome.CHANGED
    if ending.status in (INTERRUPTED, TERMINATED) or -ending.status in _UNCATCHABLE:
        return AttackOutcome.ENDED
    if ending.status == BAD_INPUT:
        told = [line for line in ending.said.splitlines() if _ERROR.match(line)]
        return AttackOutcome.REFUSED if len(told) == 1 and attack.says in told[0] else AttackOutcome.UNNAMED
    if ending.status not in (OK, NOT_TRUSTED):
        return AttackOutcome.TRACEBACK
    wrong = summary.get("false_ok_share")  # whatever the status: who has no truth sees those frames OK
    if wrong is not None and wrong > WRONG_SHARE:
        return AttackOutcome.WRONG
    return AttackOutcome.HELD if ending.status == OK else AttackOutcome.TOLD


def _lost(before: dict[str, str], after: dict[str, str]) -> list[str]:
    return [name for name, mark in before.items() if after.get(name) != mark]


def _summary(out: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _watched(deed: Deed, out: Path, seconds: float) -> Ending:
    command = program(deed.words, {"v": _ADDRESSES_KB, **deed.limits})
    with tempfile.TemporaryFile() as printed, tempfile.TemporaryFile() as said:
        streams = {"stdout": _stream(deed.stdout, printed), "stderr": _stream(deed.stderr, said)}
        began = time.monotonic()
        process = subprocess.Popen(
            command,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **deed.environment},
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            **streams,
        )
        for kind, stream in zip((deed.stdout, deed.stderr), streams.values(), strict=True):
            if kind != "kept":
                os.close(stream)
        status, memory_kb, hung = _wait(process, deed, out, began + seconds)
        took = time.monotonic() - began
        texts = []
        for file in (printed, said):
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
    return Ending(status, took, memory_kb / 1024.0, texts[1], texts[0], hung)


def _stream(kind: str, kept: Any) -> Any:
    if kind == "closed":
        ours, theirs = os.pipe()
        os.close(ours)
        return theirs
    return os.open("/dev/full", os.O_WRONLY) if kind == "full" else kept


def _wait(process: subprocess.Popen[bytes], deed: Deed, out: Path, until: float) -> tuple[int, int, bool]:
    """Exit status, peak memory in kB, and whether it had to be killed; sends what signals the deed asks for.

    The kernel hands a child the peak of whoever forks it: what it says in the end counts only beyond our own,
    and up to there what was seen of it while it ran.
    """
    pending, began, hung = list(deed.signals), time.monotonic(), False
    ours, seen = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, 0
    while True:
        seen = max(seen, _peak_kb(process.pid))
        gone, status, usage = os.wait4(process.pid, os.WNOHANG)
        if gone:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage.ru_maxrss if usage.ru_maxrss > ours else seen, hung
        if pending and _due(pending[0][1], out, began):
            process.send_signal(pending.pop(0)[0])
        if time.monotonic() > until and not hung:
            hung = True
            os.killpg(process.pid, signal.SIGKILL)
        time.sleep(0.01)


def _peak_kb(pid: int) -> int:
    """Largest resident memory of a process since its program began; 0 once it is gone."""
    try:
        text = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return 0
    found = re.search(r"VmHWM:\s*(\d+) kB", text)
    return int(found[1]) if found else 0


def _due(when: float | str, out: Path, began: float) -> bool:
    if isinstance(when, str):
        try:
            return (out / "frames.csv").read_bytes().count(b"\n") > _FRAMES
        except OSError:
            return False
    return time.monotonic() - began > when
