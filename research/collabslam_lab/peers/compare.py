"""``collabslam-lab peers``: this system and others on the same images, one table."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.batch.isolated import Died, one
from collabslam.datasets import open_recording
from collabslam.datasets.images import read_grey
from collabslam.errors import CollabslamError, DataError, SettingsError
from collabslam.formats.files import write_text
from collabslam.runs.results import jsonable
from collabslam.types import Image, Recording
from collabslam.version import version
from collabslam_lab.benchmark.plan import Entry, find_plan
from collabslam_lab.benchmark.store import Item
from collabslam_lab.peers import environments
from collabslam_lab.peers.ours import ALONE, TOGETHER, opened, run_ours
from collabslam_lab.peers.prepared import SystemResult, run_script, write_job
from collabslam_lab.peers.scored import Row, peers_markdown, scored
from collabslam_lab.peers.systems import OURS, PEERS, Peer
from collabslam_lab.peers.vocabulary import train, write_vocabulary

WORDS = "vocabulary.txt"
IMAGES_OF_EACH = 25
"""Images of a recording that the vocabulary is made from."""


@dataclass(frozen=True)
class Asked:
    """What is compared, and how.

    Attributes
    ----------
    plan : Path or None
        As of ``evaluate``; the folder's own or the package's if left out.
    only : sequence of str
        Recordings; all if empty.
    systems : sequence of str
        Names of `PEERS`, and `OURS`; all if empty.
    envs : Path or None
        Folder of the environments; the user's cache if left out.
    few : int
        Frames at most for systems that work offline.
    seconds : float
        Limit of each run.
    """

    plan: Path | None = None
    only: Sequence[str] = ()
    systems: Sequence[str] = ()
    envs: Path | None = None
    few: int = 100
    seconds: float = 1800.0


@dataclass(frozen=True)
class _Rig:
    """The other images of rectified pairs, and their baseline in metres."""

    right: Sequence[Image]
    baseline: float


def compare(data: Path, out: Path, asked: Asked | None = None) -> list[Row]:
    """Run every system on every recording that has a truth; writes ``peers.json`` and ``peers.md``.

    Rows of recordings and systems that are not asked for stay as they are in ``peers.json``.

    Parameters
    ----------
    data : Path
        Folder that holds the recordings.
    out : Path
    asked : Asked, optional

    Returns
    -------
    list of dict
        A row for each recording and system: ``recording``, ``system``, ``version``, ``status`` (``done`` or
        ``failed``, with ``error``), ``covariance``, ``frames``, ``given`` and the numbers of `scored`,
        None in a failed row.

    Raises
    ------
    DataError
        If the data folder does not exist, or the results cannot be written.
    SettingsError
        If a recording or system that is asked for is none.
    """
    asked = asked or Asked()
    if not data.is_dir():
        raise DataError(f"The data folder {data} does not exist; give the folder that holds the recordings.")
    if asked.few < 1:
        raise SettingsError(f"The number of frames is {asked.few}; give 1 or more.")
    items = _items(data, out, asked)
    chosen = [peer for peer in PEERS if not asked.systems or peer.name in asked.systems]
    rows = _earlier(out, {item.entry.name for item in items}, asked)
    pythons = {peer.name: _environment(peer, asked) for peer in chosen}
    words: Path | DataError | None = None
    if any(peer.words for peer in chosen):
        words = _words(data, out, asked)
    with tempfile.TemporaryDirectory(prefix="collabslam-peers-") as work:
        for item in items:
            for row in _rows(item, chosen, pythons, words, Path(work), asked):
                rows.append(row)
                print(f"{row['recording']}, {row['system']}: {_said(row)}", flush=True)
                _write(out, rows, asked, data)
    return _write(out, rows, asked, data)


def _items(data: Path, out: Path, asked: Asked) -> list[Item]:
    """One seed of each recording that can be scored, with its worn camera."""
    entries = find_plan(data, asked.plan).recordings
    names = [entry.name for entry in entries]
    systems = [OURS, *(peer.name for peer in PEERS)]
    for kind, given, known in (("recording", asked.only, names), ("system", asked.systems, systems)):
        for name in given:
            if name not in known:
                raise SettingsError(f"There is no {kind} '{name}'; there are {', '.join(known)}.")
    items = []
    for entry in entries:
        wanted = entry.name in asked.only if asked.only else _is_plain(entry)
        if wanted and (entry.rendered or (data / entry.folder).exists()):
            items.append(Item(entry, "collab-tight", 0, data, out))
    return items


def _is_plain(entry: Entry) -> bool:
    """Whether it has a worn camera and a truth, and nothing in it is wrong on purpose."""
    return entry.start == "worn" and entry.scored and entry.calibration_sd is None


def _environment(peer: Peer, asked: Asked) -> Path | DataError:
    try:
        return environments.install(peer, asked.envs or environments.default_folder())
    except DataError as error:
        return error


def _words(data: Path, out: Path, asked: Asked) -> Path | DataError:
    """The vocabulary of all recordings there are, whichever of them are asked for."""

    def images() -> Iterator[Image]:
        for entry in find_plan(data, asked.plan).recordings:
            if not entry.rendered and entry.name == entry.folder and (data / entry.folder).exists():
                yield from some_images(open_recording(data / entry.folder))

    try:
        out.mkdir(parents=True, exist_ok=True)
        write_vocabulary(train(images()), out / WORDS)
    except (CollabslamError, OSError) as error:
        return DataError(f"There is no vocabulary: {error}")
    return out / WORDS


def some_images(recording: Recording) -> Iterator[Image]:
    """Images of a recording for a vocabulary, evenly spread."""
    for i in range(0, len(recording), -(-len(recording) // IMAGES_OF_EACH)):
        yield recording.image(i)


def _rows(
    item: Item,
    peers: Sequence[Peer],
    pythons: dict[str, Path | DataError],
    words: Path | DataError | None,
    work: Path,
    asked: Asked,
) -> Iterator[Row]:
    recording = opened(item)
    if recording.truth is None:
        print(f"{item.entry.name}: it has no truth, left out", flush=True)
        return
    truth, ours = recording.truth, _NOTHING
    if not asked.systems or OURS in asked.systems:
        rows, ours = _our_rows(item, recording, asked)
        yield from rows
    rig = _rig(item)
    for peer in peers:
        name = {"recording": item.entry.name, "system": peer.name, "version": peer.version}
        if peer.stereo and rig is None:
            continue
        row: Row = {**name, "covariance": peer.covariance, "frames": len(recording)}
        python = pythons[peer.name]
        fault = next((x for x in (python, words if peer.words else None) if isinstance(x, DataError)), None)
        folder = work / f"{item.entry.name}-{peer.name}"
        try:
            if fault is not None or not isinstance(python, Path):
                raise fault or DataError("It has no environment.")
            spread = write_job(
                recording,
                folder,
                right=rig.right if rig and peer.stereo else None,
                baseline=rig.baseline if rig and peer.stereo else 0.0,
                vocabulary=words if isinstance(words, Path) else None,
                few=asked.few,
            )
            given = len(spread) if peer.offline else len(recording)
            found = run_script(peer, python, folder, asked.seconds)
            yield {
                **row,
                "status": "done",
                "given": given,
                **scored(found, truth, metric=peer.stereo, given=given, ours=ours.turns),
            }
        except CollabslamError as error:
            yield {**row, **_failed(str(error))}
        finally:
            shutil.rmtree(folder, ignore_errors=True)


_NOTHING = SystemResult({}, {}, 0.0)


def _our_rows(item: Item, recording: Recording, asked: Asked) -> tuple[list[Row], SystemResult]:
    """Rows of this system, and what it found with Cf."""
    assert recording.truth is not None
    count = len(recording)
    rows = []
    try:
        found: dict[str, SystemResult] = one(run_ours, (item,), asked.seconds)
        fault = None
    except (CollabslamError, Died) as error:
        found, fault = {ALONE: _NOTHING, TOGETHER: _NOTHING}, str(error)
    for name, what in found.items():
        row: Row = {"recording": item.entry.name, "system": name, "version": version()}
        row |= {"covariance": True, "frames": count}
        if fault is not None:
            rows.append({**row, **_failed(fault)})
        else:
            numbers = scored(what, recording.truth, metric=name == TOGETHER, given=count)
            rows.append({**row, "status": "done", "given": count, **numbers})
    return rows, found[TOGETHER]


def _failed(why: str) -> Row:
    empty = dict.fromkeys(scored(_NOTHING, np.zeros((0, 4, 4)), metric=False, given=1))
    return {"status": "failed", "error": why, "given": None, **empty}


def _rig(item: Item) -> _Rig | None:
    """The recording's rectified pairs, one for each frame; None if it has none."""
    if item.entry.rendered:
        return None
    recording: Any = open_recording(item.data / item.entry.folder)
    rig = getattr(recording, "rig", None)
    if rig is None or len(rig.paths) < len(recording) or rig.camera.model != "pinhole":
        return None
    across = rig.t_cf[:3, 3]
    if not np.allclose(rig.t_cf[:3, :3], np.eye(3), atol=1e-6) or not np.allclose(across[1:], 0.0, atol=1e-6):
        return None
    if rig.camera.intrinsics != recording.camera.intrinsics or across[0] <= 0.0:
        return None
    read = partial(read_grey, camera=rig.camera)
    return _Rig([read(rig.paths[i]) for i in range(len(recording))], float(across[0]))


def _earlier(out: Path, recordings: set[str], asked: Asked) -> list[Row]:
    """Rows of an earlier run that this one does not make again; none of another version's numbers."""
    systems = {peer.name for peer in PEERS if not asked.systems or peer.name in asked.systems}
    if not asked.systems or OURS in asked.systems:
        systems |= {ALONE, TOGETHER}
    try:
        rows = json.loads((out / "peers.json").read_text(encoding="utf-8"))
        rows = [row for row in rows if _failed("").keys() <= row.keys() | {"error"}]
        return [row for row in rows if row["recording"] not in recordings or row["system"] not in systems]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _said(row: Row) -> str:
    if row["status"] != "done":
        return f"failed: {row['error']}"
    ate = "-" if row["ate_sim3_pct"] is None else f"{row['ate_sim3_pct']:.2f} %"
    return f"ATE Sim(3) {ate}, pose in {row['coverage']:.0%}, {row['cpu_ms']:.0f} ms a frame"


def _write(out: Path, rows: Sequence[Row], asked: Asked, data: Path) -> list[Row]:
    """Writes both files; returns the rows in the order of plan and systems."""
    order = {entry.name: k for k, entry in enumerate(find_plan(data, asked.plan).recordings)}
    systems = {name: k for k, name in enumerate([ALONE, TOGETHER, *(peer.name for peer in PEERS)])}
    rows = sorted(rows, key=lambda row: (order.get(row["recording"], len(order)), systems[row["system"]]))
    text = json.dumps(jsonable(rows), indent=2, allow_nan=False)
    write_text(out / "peers.json", text + "\n")
    write_text(out / "peers.md", peers_markdown(rows) + "\n")
    return rows
