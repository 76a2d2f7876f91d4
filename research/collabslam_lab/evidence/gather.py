"""Makes the parts one after another, each by its own command in its own folder, and keeps what is done."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.batch.engines import LOCAL, Engine
from collabslam.errors import SettingsError
from collabslam.formats.files import write_text
from collabslam.runs.results import write_summary
from collabslam_lab.evidence.archive import pack, table_of
from collabslam_lab.evidence.made_of import SOURCE, made_of
from collabslam_lab.evidence.parts import BENCHES, DATA, ENGINE, JOBS, OUT, PARTS, Command, Part
from collabslam_lab.program import everything_hash

DONE, SKIPPED, FAILED = "done", "skipped", "failed"
_GOOD = (0, 1)
"""Exit statuses of a study that has written its files; 1 says that not all in them is to be trusted."""


@dataclass(frozen=True)
class Asked:
    """What is made, and how.

    Attributes
    ----------
    data : Path or None
        Folder of the recordings; parts that need one are skipped without it.
    only : sequence of str
        Names of parts; all if empty.
    quick : bool
        A small piece of each: to see that it works, not to compare numbers.
    jobs : int
        Processes at a time.
    engine : Engine
        Where the studies that know of engines run.
    tables : Path or None
        Folder that gets the tables too, as ``docs/tables``; not those of `quick`.
    """

    data: Path | None = None
    only: Sequence[str] = ()
    quick: bool = False
    jobs: int = 2
    engine: Engine = LOCAL
    tables: Path | None = None


def gather(out: Path, asked: Asked | None = None, parts: Sequence[Part] = PARTS) -> dict[str, Any]:
    """Make all parts that are asked for; writes ``evidence.json``, ``tables`` and ``evidence.tar.gz``.

    What the same program has done is not done again; a part that ended early goes on where it was. One that
    lacks something is skipped and one that fails does not end the others: ``evidence.json`` says why.

    Parameters
    ----------
    out : Path
        Gets a folder for each part.
    asked : Asked, optional
    parts : sequence of Part

    Returns
    -------
    dict
        What ``evidence.json`` holds: commit, versions and machine, and of each part its ``status`` (done,
        skipped or failed), ``commands``, ``exit_statuses`` and ``commit``, or ``why`` it is not done.

    Raises
    ------
    SettingsError
        For a part that there is not, fewer jobs than one, or tables of a quick run.
    DataError
        If a file cannot be written.
    """
    asked = asked or Asked()
    _check(asked, parts)
    known = _known(out / "evidence.json")
    about = made_of()
    results: dict[str, Any] = {**about, "program": everything_hash(), "parts": known}
    for part in parts:
        if asked.only and part.name not in asked.only:
            continue
        commands = part.quick if asked.quick else part.full
        shown = [_shown(command) for command in commands]
        mark = {
            "commands": shown,
            "program": results["program"],
            "quick": asked.quick,
            "data": asked.data is not None,
        }
        before = known.get(part.name, {})
        if before.get("status") == DONE and {k: before.get(k) for k in mark} == mark:
            print(f"{part.name}: there already", flush=True)
            continue
        print(f"{part.name}: {part.question}", flush=True)
        known[part.name] = {**mark, "commit": about["commit"], **_made(part, commands, out, asked)}
        write_summary(out / "evidence.json", results)
        said = known[part.name]
        print(f"{part.name}: {said['status']}{': ' + said['why'] if 'why' in said else ''}", flush=True)
    write_summary(out / "evidence.json", results)
    _write_tables(out, parts, results, asked)
    done = [part.name for part in parts if known.get(part.name, {}).get("status") == DONE]
    print(f"{len(done)} of {len(parts)} parts are in {pack(out, done)}", flush=True)
    return results


def _check(asked: Asked, parts: Sequence[Part]) -> None:
    names = [part.name for part in parts]
    for name in asked.only:
        if name not in names:
            raise SettingsError(f"There is no part '{name}'; there are {', '.join(names)}.")
    if asked.jobs < 1:
        raise SettingsError(f"--jobs is {asked.jobs}; give 1 or more.")
    if asked.quick and asked.tables is not None:
        raise SettingsError("A quick run measures too little for the docs; leave --quick or --tables out.")


def _known(path: Path) -> dict[str, Any]:
    """What an earlier call has done."""
    try:
        parts = json.loads(path.read_text(encoding="utf-8"))["parts"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return parts if isinstance(parts, dict) else {}


def _made(part: Part, commands: Sequence[Command], out: Path, asked: Asked) -> dict[str, Any]:
    if asked.data is None and part.needs(DATA, quick=asked.quick):
        return {"status": SKIPPED, "why": "it needs recordings: say with --data where they are"}
    if part.needs(BENCHES, quick=asked.quick) and not (SOURCE / "benches").is_dir():
        return {"status": SKIPPED, "why": "it needs the source tree"}
    folder = out / part.name
    folder.mkdir(parents=True, exist_ok=True)
    statuses = []
    for command in commands:
        statuses.append(subprocess.run(_words(command, folder, asked), check=False).returncode)
        if statuses[-1] not in _GOOD:
            why = f"collabslam-lab {_shown(command)} ended with {statuses[-1]}; what it said is above"
            return {"status": FAILED, "why": why, "exit_statuses": statuses}
    missing = [file for file in part.tables.values() if not (folder / file).exists()]
    if missing and (not asked.quick or len(missing) == len(part.tables)):
        why = f"it wrote no {', '.join(missing)}"
        return {"status": FAILED, "why": why, "exit_statuses": statuses}
    return {"status": DONE, "exit_statuses": statuses}


def _words(command: Command, folder: Path, asked: Asked) -> list[str]:
    """The command line of a process."""
    program = ["-m", "collabslam_lab"]
    if command[0] == BENCHES:
        program, command = [str(SOURCE / "benches" / command[1])], command[2:]
    words: list[str] = [sys.executable, *program]
    for word in command:
        if word == JOBS:
            words += [JOBS, str(asked.jobs)]
        elif word == ENGINE:
            words += [ENGINE, asked.engine.kind, "--limit", str(asked.engine.seconds)]
            words += [] if asked.engine.scheduler is None else ["--scheduler", asked.engine.scheduler]
        elif word == DATA:
            words.append(str(asked.data))
        else:
            words.append(word.replace(OUT, str(folder), 1) if word.startswith(OUT) else word)
    return words


def _shown(command: Command) -> str:
    """A command as anybody can run it, without what changes no result."""
    return " ".join(word for word in command if word not in (JOBS, ENGINE))


def _write_tables(out: Path, parts: Sequence[Part], results: dict[str, Any], asked: Asked) -> None:
    for part in parts:
        made = results["parts"].get(part.name, {})
        if made.get("status") != DONE:
            continue
        words = " and ".join(f"`collabslam-lab {command}`" for command in made["commands"])
        piece = "A small piece, to see that it works. " if made["quick"] else ""
        there = {name: file for name, file in part.tables.items() if (out / part.name / file).exists()}
        for name, file in there.items():
            text = table_of(out / part.name / file, f"{piece}Made by {words} at commit {made['commit']}.")
            write_text(out / "tables" / f"{name}.md", text)
            if asked.tables is not None:
                write_text(asked.tables / f"{name}.md", text)
