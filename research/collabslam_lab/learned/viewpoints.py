"""What a learned descriptor would be worth: right matches of XFeat and of ours, by the angle of the cameras.

With ``T_CF`` the pipeline's own matching runs: with either descriptor at the same corners, and with XFeat at
its own key points in both views. Anywhere, as after a loss, the descriptors are alone: ours as a lost camera
is looked for (several scales, the best clearly better than the next), XFeat's as its authors match (mutual,
and alike enough).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np

from collabslam.batch.processes import use_one_thread
from collabslam.datasets.emulated.worn import PoseErrors
from collabslam.formats.files import write_text
from collabslam.frontend import describe, place_recognition, worn_match
from collabslam.frontend.describe import DESCRIPTORS
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.patch import SIZE
from collabslam.runs.report import number
from collabslam.runs.results import write_summary
from collabslam.settings.table import Settings
from collabslam.slam.worn.matcher import NEW_POINTS
from collabslam.types import Array, Indices
from collabslam_lab.benchmark.descriptors import EDGES, ImagePair, pose_errors, right_matches
from collabslam_lab.benchmark.pairs import Pair, Scene, choose_pairs
from collabslam_lab.benchmark.plan import Entry, find_plan
from collabslam_lab.benchmark.store import Row
from collabslam_lab.learned.network import Network
from collabslam_lab.learned.weights import REQUIREMENT, fetch, read
from collabslam_lab.report import markdown_table

OURS, LEARNED, OWN = "warped-sift", "xfeat", "xfeat, own key points"
OURS_ANYWHERE, LEARNED_ANYWHERE = "warped-sift, anywhere", "xfeat, anywhere"
WAYS = (OURS, LEARNED, OWN, OURS_ANYWHERE, LEARNED_ANYWHERE)
ALIKE = 0.82
"""Least cosine of two of XFeat's descriptors that match, as its authors choose it."""
MUTUAL = 1.0
"""Ratio of the best to the second best distance with XFeat: its authors ask only that matches are mutual."""
_OTHERS = 1000  # corners or key points of the other view, anywhere


def compare(entry: Entry, data: Path, network: Network, seed: int, quick: bool) -> list[Row]:
    """Rows of every way on every pair of a recording; a few pairs if `quick`."""
    scene, errors = Scene.of(entry, data, seed), pose_errors(entry, seed)
    pairs = choose_pairs(scene)
    rows: list[Row] = []
    for pair in pairs[:: max(1, len(pairs) // 4)] if quick else pairs:
        rows += [
            {"recording": entry.name, **pair.facts(), **row} for row in _ways(scene, pair, errors, network)
        ]
    return rows


def _ways(scene: Scene, pair: Pair, errors: PoseErrors, network: Network) -> Iterator[Row]:
    image_pair = ImagePair(scene, pair, errors)
    yield image_pair.measure(OURS)
    with _known_as(LEARNED, lambda image, uv, *_: network.run(image).describe(uv)):
        row = image_pair.measure(LEARNED, MUTUAL)
        yield {**row, "ms_match": row["ms_match"] + row["ms_describe"]}  # the network on both images
        keys = network.run(image_pair.image).keys(2 * NEW_POINTS)
        far = np.array(image_pair.image.shape[::-1]) - 1 - SIZE
        inside = ((keys >= SIZE) & (keys <= far)).all(axis=1)
        own = ImagePair(scene, pair, errors, keys[inside][:NEW_POINTS])
        with patch.object(worn_match, "detect_corners", _keys_of(network)):
            row = own.measure(LEARNED, MUTUAL)
        yield {**row, "descriptor": OWN, "ms_match": row["ms_match"] + row["ms_describe"]}
    for way, match in ((OURS_ANYWHERE, _ours_anywhere), (LEARNED_ANYWHERE, _learned_anywhere(network))):
        began = time.process_time()
        index, uv_f = match(image_pair)
        took = 1e3 * (time.process_time() - began)
        yield {
            "descriptor": way,
            **image_pair.facts(),
            **image_pair.judge(index, uv_f),
            "ms_describe": 0.0,
            "ms_match": took,
        }


@contextmanager
def _known_as(name: str, make: describe.Describe) -> Iterator[None]:
    """The pipeline knows a descriptor for a while."""
    with patch.dict(DESCRIPTORS, {name: make}):
        yield


def _keys_of(network: Network) -> Callable[..., Array]:
    """The network's key points where the pipeline asks for corners of a part of the image."""
    return lambda crop, known, count, *_: network.run(crop).keys(count)


def _ours_anywhere(image_pair: ImagePair) -> tuple[Indices, Array]:
    recognition = place_recognition
    options = Settings.default().frontend
    there = detect_corners(image_pair.other, np.empty((0, 2)), _OTHERS, options.detect, SIZE // 2 + 1)
    views = describe.describe(image_pair.image, image_pair.uv, 0.0, describe.SUPPORT, recognition.KIND)
    corners = recognition.describe_corners(image_pair.other, there, 0.0, describe.SUPPORT)
    index, corner = recognition.match_descriptors(
        views, np.arange(len(views)), corners, recognition.RATIO, recognition.MAX_DISTANCE
    )
    return index, there[corner]


def _learned_anywhere(network: Network) -> Callable[[ImagePair], tuple[Indices, Array]]:
    def match(image_pair: ImagePair) -> tuple[Indices, Array]:
        other = network.run(image_pair.other)
        there = other.keys(_OTHERS)
        similarity = network.run(image_pair.image).describe(image_pair.uv) @ other.describe(there).T
        best, back = similarity.argmax(axis=1), similarity.argmax(axis=0)
        here = np.arange(len(best))
        index = np.flatnonzero((back[best] == here) & (similarity[here, best] > ALIKE))
        return index, there[best[index]]

    return match


def reproduce(out: Path, data: Path | None, *, seed: int, quick: bool) -> str:
    """Measures the rendered demo, and the plan's recordings if their folder is given; returns the page.

    Parameters
    ----------
    out : Path
        Folder of ``viewpoints.json`` and ``viewpoints.md``; the weights are kept in its ``weights``.
    data : Path or None
        Folder of recordings.
    seed : int
        Of the noise of ``T_CF``.
    quick : bool
        Four pairs of each recording.

    Raises
    ------
    DataError
        If the weights cannot be had, onnxruntime is missing or a recording cannot be read.
    """
    use_one_thread()
    (out / "weights").mkdir(parents=True, exist_ok=True)
    network = Network(read(fetch(out / "weights")))
    where = data or Path()
    rows: list[Row] = []
    for entry in find_plan(where, None).recordings:
        posed = (entry.noisy or entry.rendered) and not entry.calibration_sd
        if posed and (entry.rendered or (data is not None and (data / entry.folder).exists())):
            rows += compare(entry, where, network, seed, quick)
            print(f"{entry.name}: {len(rows)} rows so far", flush=True)
    write_summary(out / "viewpoints.json", {**summary(rows), "weights": REQUIREMENT, "rows": rows})
    text = page(rows)
    write_text(out / "viewpoints.md", text)
    return text


def summary(rows: Sequence[Row]) -> Row:
    """Right matches of XFeat over ours at 10 to 30 degrees between the axes, and milliseconds (median)."""
    ratios = {}
    for key, ours, learned in (
        ("right_matches_ratio_10_30deg", OURS, LEARNED),
        ("right_matches_ratio_10_30deg_own_key_points", OURS, OWN),
        ("right_matches_ratio_10_30deg_anywhere", OURS_ANYWHERE, LEARNED_ANYWHERE),
    ):
        right = [sum(map(right_matches, _within(rows, way, 10.0, 30.0))) for way in (ours, learned)]
        ratios[key] = right[1] / right[0] if right[0] else None
    took = [row["ms_match"] for row in rows if row["descriptor"] == LEARNED]
    return {**ratios, "ms": float(np.median(took)) if took else None}


def page(rows: Sequence[Row]) -> str:
    """A table: matches of each way, and how many are right, by the angle between the axes."""
    lines = []
    for low, high in pairwise(EDGES):
        for way in WAYS:
            found = _within(rows, way, low, high)
            if found:
                matches, judged, in_depth = (
                    sum(row[key] for row in found) for key in ("matches", "with_depth", "depth_right")
                )
                share = 100.0 * in_depth / judged if judged else float("nan")
                took = float(np.median([row["ms_match"] for row in found]))
                numbers = (matches / len(found), sum(map(right_matches, found)) / len(found), share, took)
                bins = f"{low:g}-{high:g} deg"
                lines.append([bins, way, str(len(found)), *(number(value, 1) for value in numbers)])
    columns = ("axes apart", "matching", "pairs", "matches a pair", "right a pair",
               "right of those whose depth is known, %", "ms")  # fmt: skip
    ratios = "\n".join(
        f"- `{key}`: {number(value, 2)}" for key, value in summary(rows).items() if value is not None
    )
    return f"{markdown_table(columns, lines)}\n\n{ratios}\n"


def _within(rows: Sequence[Row], way: str, low: float, high: float) -> list[Row]:
    return [row for row in rows if row["descriptor"] == way and low <= row["axes_deg"] < high]
