"""A lost camera and its map: a second of each recording is taken away at some places, in three ways.

``blackout``: black images; ``hand``: a hand before the lens, dark and noisy; ``jump``: the frames are cut out
and the stamps closed up. The filter knows nothing of the truth, which only tells when the map was in sight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from collabslam.errors import CollabslamError
from collabslam.evaluation.consistency import pose_tangent_error, sigma_gate
from collabslam.evaluation.scoring import OK_SIGMAS
from collabslam.frontend.map_views import MapViews
from collabslam.frontend.place_recognition import confirmed
from collabslam.geometry import pose_inverse
from collabslam.results import StepResult
from collabslam.runs.report import number
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.engine import Slam
from collabslam.types import Array, Frame, Image, Recording, Status
from collabslam_lab.benchmark.plan import Entry, Plan
from collabslam_lab.benchmark.replay import open_entry
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.report import markdown_table

KINDS = ("blackout", "hand", "jump")
MODE = "collab"
PLACES = 6
"""Places of each recording, evenly spread."""
BLIND_S, AFTER_S = 1.0, 2.0
"""Seconds that are taken away, and that follow."""
SAYS, FINDS_S = 3, 1.0
"""Frames after which it must say LOST, and seconds after its map came in sight in which it must be found."""


@dataclass(frozen=True)
class _Place:
    """A recording up to the frame before the cut, and what is known of it there."""

    recording: Recording
    options: FrontendSettings
    slam_state: dict[str, object]
    last: StepResult
    index: int
    views: MapViews

    def pose(self, i: int) -> Array:
        """T_WC of frame ``i``: the pose at the cut, moved as the truth moved."""
        truth = self.recording.truth
        assert truth is not None
        return np.asarray(self.last.pose @ pose_inverse(truth[self.index]) @ truth[i])

    def in_sight(self, i: int, image: Image) -> bool:
        """Whether the map would confirm where the camera truly is."""
        camera = self.recording.camera
        fix = confirmed(image, camera, self.pose(i), self.views, self.options)
        return fix is not None


def measure(entry: Entry, data: Path, out: Path, *, seed: int = 0) -> list[Row]:
    """Every way of losing sight at every place of a recording.

    Parameters
    ----------
    entry : Entry
    data, out : Path
        Folder of the recordings; folder of results.
    seed : int
        Of the noise of ``T_CF``, and of that before the hand.

    Returns
    -------
    list of dict
        A row for each: ``kind``, ``frame``, ``said_after`` (frames until LOST, None if it never was),
        ``in_sight_after_s`` (None if the map was not to be seen in `AFTER_S`), ``found_after_s`` (None if not
        found), ``ok_after`` (frames until then), ``wrong`` (found with a pose that its covariance does not
        cover by `OK_SIGMAS`). No rows for a recording without truth.

    Raises
    ------
    CollabslamError
        If the recording cannot be opened.
    """
    item = Item(entry, MODE, seed, data, out, False, "", ())
    recording = open_entry(item)
    if recording.truth is None:
        return []
    options = item.settings.frontend
    rate = 1.0 / float(np.median(np.diff(recording.times)))
    blind, after = max(1, round(BLIND_S * rate)), max(1, round(AFTER_S * rate))
    slam = Slam(recording.camera, recording.worn_camera, settings=item.settings, mode=MODE, start=entry.start)
    end = len(recording) - blind - max(2, round(FINDS_S * rate))
    places = {int(i) for i in np.linspace(max(1, len(recording) // 5), end, PLACES) if i < end + 1}
    rows: list[Row] = []
    for i in range(max(places, default=0)):
        frame = recording.frame(i)
        last = slam.step(frame.t, frame.image, frame.views)
        if i + 1 in places and last.status is Status.OK and np.isfinite(recording.truth[i]).all():
            landmarks = slam.landmarks().points
            views = MapViews.of(landmarks, slam.saved_map().views)
            place = _Place(recording, options, slam.state(), last, i, views)
            rows += [
                {
                    "recording": entry.name,
                    "kind": kind,
                    "frame": i + 1,
                    **_lose(place, kind, blind, after, seed),
                }
                for kind in KINDS
            ]
    return rows


def _lose(place: _Place, kind: str, blind: int, after: int, seed: int) -> Row:
    """Takes frames away, and looks at what follows."""
    slam = Slam.from_state(place.slam_state)
    recording = place.recording
    first = place.index + 1 + blind
    said, frames = None, 0
    for frame in () if kind == "jump" else _blind(place, kind, blind, seed):
        frames += 1
        if slam.step(frame.t, frame.image).status is Status.LOST and said is None:
            said = frames
    shift = recording.times[first] - recording.times[place.index + 1] if kind == "jump" else 0.0
    in_sight = found = ok = None
    wrong = False
    for i in range(first, min(first + after, len(recording))):
        frame = recording.frame(i)
        frames += 1
        since = float(recording.times[i] - recording.times[first])
        if in_sight is None and place.in_sight(i, frame.image):
            in_sight = since
        result = slam.step(frame.t - shift, frame.image, frame.views)
        if result.status is Status.LOST and said is None:
            said = frames
        if result.status in (Status.OK, Status.DEGRADED):  # after a jump the run itself is degraded
            found, ok, wrong = since, frames, _is_wrong(place, result, i)
            break
    return {
        "said_after": said,
        "in_sight_after_s": in_sight,
        "found_after_s": found,
        "ok_after": ok,
        "wrong": wrong,
    }


def _blind(place: _Place, kind: str, count: int, seed: int) -> Iterator[Frame]:
    noise = np.random.Generator(np.random.PCG64((seed, place.index)))
    for i in range(place.index + 1, place.index + 1 + count):
        frame = place.recording.frame(i)
        image = np.zeros_like(frame.image)
        if kind == "hand":
            glow = 0.1 * cv2.GaussianBlur(frame.image, (0, 0), frame.image.shape[1] / 12.0).astype(np.float64)
            image = np.clip(glow + noise.normal(0.0, 2.5, image.shape), 0, 255).astype(np.uint8)
        yield replace(frame, image=image, views=())


def _is_wrong(place: _Place, result: StepResult, i: int) -> bool:
    """Whether the pose, relative to that at the cut, is off by more than its covariance covers."""
    error = pose_tangent_error(result.pose[None], place.pose(i)[None])[0]
    return bool(error @ np.linalg.solve(result.covariance, error) > sigma_gate(OK_SIGMAS, 6))


def measure_all(plan: Plan, data: Path, out: Path, present: Sequence[str]) -> tuple[list[Row], list[str]]:
    """Rows of every recording with a truth, and the faults of the others."""
    rows: list[Row] = []
    faults = []
    for entry in plan.recordings:
        if entry.name not in present:
            continue
        try:
            done = measure(entry, data, out, seed=plan.seeds[0])
        except CollabslamError as error:
            faults.append(f"{entry.name}: {error}")
            continue
        rows += done
        print(f"{entry.name}: {len(done)} times", flush=True)
    return rows, faults


def in_time(row: Row) -> bool:
    """Whether the camera was found as soon as it must be."""
    found, sight = row["found_after_s"], row["in_sight_after_s"]
    return found is not None and (sight is None or found <= sight + FINDS_S)


def page(rows: Sequence[Row], faults: Sequence[str], how: str) -> str:
    """The table: for each recording and way, how often it was said, seen, found, and wrongly found."""
    lines = []
    for name in dict.fromkeys(r["recording"] for r in rows):
        for kind in KINDS:
            some = [r for r in rows if r["recording"] == name and r["kind"] == kind]
            seen = [r for r in some if r["in_sight_after_s"] is not None]
            found = [r for r in some if r["found_after_s"] is not None]
            said = [r for r in some if _said(r)]
            delays = [max(0.0, r["found_after_s"] - (r["in_sight_after_s"] or 0.0)) for r in found]
            lines.append(
                [
                    name,
                    kind,
                    f"{len(some)}",
                    f"{len(said)}",
                    f"{len(seen)}",
                    f"{sum(in_time(r) for r in seen)}",
                    f"{len([r for r in found if r not in seen])}",
                    number(float(np.median(delays)) if delays else None, 2),
                    f"{sum(r['wrong'] for r in some)}",
                ]
            )
    header = (
        "recording",
        "what",
        "times",
        f"LOST within {SAYS} frames",
        "map in sight again",
        f"of these found in {FINDS_S:g} s",
        "others found",
        "median delay, s",
        "wrong",
    )
    text = (
        f"# Lost and found, measured\n\n```sh\n{how}\n```\n\n"
        f"{BLIND_S:g} s of each recording is taken away at up to {PLACES} places, mode `{MODE}`: black "
        "images, a hand before the lens (dark, noisy), or a jump (the frames cut out, the stamps closed up). "
        f"*LOST within {SAYS} frames*: or OK by then, as after a jump that ends where the map is known. "
        f"*Map in sight again*: in the {AFTER_S:g} s that follow, a relocalisation that were told where the "
        f"camera truly is would be confirmed by the map's patches; *found*: OK, or DEGRADED for the "
        f"jump, at most {FINDS_S:g} s after that. A camera that has turned away from all it knows has "
        "nothing to be found by. *Wrong*: OK with "
        f"a pose beyond {OK_SIGMAS:g} sigma, measured from the pose before.\n\n"
    )
    return text + "\n".join([markdown_table(header, lines), *(f"\n- {fault}" for fault in faults)]) + "\n"


def _said(row: Row) -> bool:
    """Whether it was LOST in time, or OK by then."""
    return any(row[key] is not None and row[key] <= SAYS for key in ("said_after", "ok_after"))
