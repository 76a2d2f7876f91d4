"""Arrays on their way into the core: any order in memory is read right, any other type is refused by name."""

from __future__ import annotations

import copy
import pickle
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from collabslam import BusyError, Camera, Filter, InputError, Slam, _core

RNG = np.random.default_rng(3)
CAMERA = Camera("pinhole", 96, 64, (80.0, 80.0, 47.5, 31.5))
IMAGE = RNG.integers(0, 255, (64, 96), dtype=np.uint8)
UV = np.array([[30.3, 20.6], [50.0, 40.0], [70.2, 30.9]])
SAME = np.tile(np.eye(2), (3, 1, 1))
TEMPLATES = np.stack([IMAGE[v - 5 : v + 6, u - 5 : u + 6] for u, v in ((30, 21), (50, 40), (70, 31))])
DESCRIPTORS = RNG.normal(size=(2, 5, 32)).astype(np.float32)
RAYS = CAMERA.unproject(RNG.uniform((5, 5), (90, 60), (5, 2)))
T_CF = np.eye(4)
T_CF[:3, 3] = 0.3, 0.1, 0.0


def _unaligned(array: Any) -> Any:
    raw = np.zeros(array.nbytes + 1, np.uint8)
    raw[1:] = np.frombuffer(np.ascontiguousarray(array).tobytes(), np.uint8)
    return np.ndarray(array.shape, array.dtype, raw.data, 1)


def _stepped(array: Any) -> Any:
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), array.dtype)
    wide[..., ::2] = array
    return wide[..., ::2]


ORDERS: dict[str, Callable[[Any], Any]] = {
    "by column": np.asfortranarray,
    "transposed": lambda a: np.ascontiguousarray(a.T).T,
    "mirrored": lambda a: np.flip(np.ascontiguousarray(np.flip(a))),
    "every second": _stepped,
    "read only": lambda a: np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape),
    "unaligned": _unaligned,
}
"""Ways to keep the same array."""


def _search(image: Any, templates: Any) -> list[Any]:
    expected = _core.ExpectedPixels(UV + 1.0, 4.0 * SAME)
    window = _core.SearchWindow(
        gate=3.0, min_radius=2.5, large_radius=40.0, max_radius=40.0, guess_radius=6.0, guess_gate=1.5
    )
    peaks = _core.PeakTest(min_score=0.5, ambiguity=0.95, peak_distance=3.0, min_deviation=1.0)
    found = _core.search_templates(image, templates, expected, window, peaks)
    return [found.uv, found.score, found.second, found.code]


def _project(points: Any) -> list[Any]:
    there = CAMERA.project(points)
    return [there.uv, there.visible]


def _pairs(described: Any, described_f: Any) -> list[Any]:
    ranges = np.tile([0.0, 2.0], (5, 1))
    points = _core.PairPoints(RAYS, ranges, np.zeros(5, np.bool_), described, [0.0, 0.5])
    good = _core.PairOptions(sigma=(0.1, 0.1), gate=9.0, ratio=1.0, max_distance=100.0)
    found = _core.match_pairs(points, RAYS, described_f, T_CF, 0.1 * np.eye(6), good)
    return [found.index_s, found.index_f]


def _warp(pixels: Any) -> list[Any]:
    class Patch:
        uv_ref, t_wc, inside = UV[1], np.eye(4), np.array([0.0, 0.0, 28.0, 28.0])

    Patch.pixels = pixels  # type: ignore[attr-defined]
    limits = _core.WarpLimits(min_area=0.2, max_area=5.0, max_stretch=4.0)
    turned = np.eye(4)
    turned[:2, :2] = [[0.9, -np.sqrt(0.19)], [np.sqrt(0.19), 0.9]]
    seen = _core.warp_patches(CAMERA, [Patch()], turned, [[np.nan] * 3], 11, limits)  # type: ignore[list-item]
    assert seen.ok.all()
    return [seen.templates, seen.affine]


READERS: dict[str, tuple[Callable[..., list[Any]], tuple[Any, ...]]] = {
    "search": (_search, (IMAGE, TEMPLATES)),
    "pairs": (_pairs, (DESCRIPTORS, DESCRIPTORS[0])),
    "warp": (_warp, (IMAGE[26:55, 36:65],)),
    "sample": (lambda image: [_core.sample_templates(image, UV, 0.8 * SAME, 11).templates], (IMAGE,)),
    "capture": (lambda image: [*_core.capture_windows(image, UV, 7).windows], (IMAGE,)),
    "describe": (lambda image: [_core.describe_windows(image, UV, SAME, 2.0)], (IMAGE,)),
    "corners": (lambda r: [_core.corner_peaks(r, 2, 3, 0.1, 0.0)], (IMAGE.astype(np.float32),)),
    "project": (_project, (RAYS,)),
    "affine": (
        lambda uv, t, rho: [_core.affine_maps(CAMERA, uv, CAMERA, t, rho).affine],
        (UV, np.tile(T_CF, (3, 1, 1)), np.array([0.1, 0.5, 1.0])),
    ),
}
"""Functions that read arrays, and what they read."""


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("reader", READERS)
def test_any_order_in_memory_is_read_right(reader: str, order: str) -> None:
    read, arrays = READERS[reader]
    expected = read(*arrays)
    assert any(len(e) for e in expected)
    for k in range(len(arrays)):
        kept = [ORDERS[order](a) if i == k else a for i, a in enumerate(arrays)]
        np.testing.assert_array_equal(kept[k], arrays[k])
        for found, want in zip(read(*kept), expected, strict=True):
            np.testing.assert_array_equal(found, want)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (IMAGE.astype(np.uint16), r"not \(64, 96\) uint16"),
        (IMAGE / 255.0, r"not \(64, 96\) float64"),
        (np.repeat(IMAGE[..., None], 3, 2), r"not \(64, 96, 3\) uint8"),
        (IMAGE[..., None], r"not \(64, 96, 1\) uint8"),
        (IMAGE.tolist(), "array of uint8"),
        (IMAGE[:0], "not empty"),
    ],
)
def test_other_images_are_refused_by_name(image: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        _core.capture_windows(image, UV, 5)


def test_a_frame_by_column_gives_the_same_step() -> None:
    image = np.kron(IMAGE, np.ones((4, 4), np.uint8))
    camera = Camera("pinhole", 384, 256, (320.0, 320.0, 191.5, 127.5))
    steps = []
    for order in (np.ascontiguousarray, np.asfortranarray):
        slam = Slam(camera, start="scale-free")
        for k in range(8):
            # Two planes at two distances, seen by a camera that moves sideways.
            seen = np.concatenate([np.roll(image[:128], k, axis=1), np.roll(image[128:], 3 * k, axis=1)])
            step = slam.step(0.1 * k, order(seen))
        steps.append(step)
    assert steps[0].diagnostics["found"] > 5
    assert steps[0].diagnostics["found"] == steps[1].diagnostics["found"]
    np.testing.assert_array_equal(steps[0].pose, steps[1].pose)
    np.testing.assert_array_equal(steps[0].covariance, steps[1].covariance)


# --- one filter, one thread -------------------------------------------------------------------


def _write_while(reader: threading.Thread, core: Filter) -> None:
    while reader.is_alive():
        core.remove_features([])


def test_a_second_thread_is_told_that_the_filter_is_busy() -> None:
    core = Filter(CAMERA)
    core.predict(0.0)
    core.add_undelayed(RNG.uniform((5, 5), (90, 60), (150, 2)))
    before = core.snapshot()
    reader = threading.Thread(target=core.soundness)
    reader.start()
    with pytest.raises(BusyError, match="another thread"):
        _write_while(reader, core)
    reader.join()
    core.remove_features([])
    assert core.snapshot() == before


def test_two_threads_may_read_at_once() -> None:
    core = Filter(CAMERA)
    core.predict(0.0)
    core.add_undelayed(RNG.uniform((5, 5), (90, 60), (100, 2)))
    reader = threading.Thread(target=core.soundness)
    reader.start()
    assert len(core.mean) == 13 + 1 + 600  # the readout
    reader.join()


@pytest.mark.parametrize("take", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_filter_is_copied_by_its_snapshot_alone(take: Callable[[Filter], object]) -> None:
    with pytest.raises(InputError, match=r"Filter.restore\(filter.snapshot\(\)\)"):
        take(Filter(CAMERA))
