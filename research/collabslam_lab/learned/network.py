"""XFeat as a network that onnxruntime runs on one thread, and what it sees in an image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam.errors import DataError
from collabslam.types import Array, Image
from collabslam_lab.learned.weights import Tensors

try:
    import onnxruntime
    from onnx import TensorProto, helper, numpy_helper
except ImportError as error:
    raise DataError(
        f"This needs onnx and onnxruntime ({error}): pip install './research[learned]'."
    ) from error

_STRIDES = {"block1": (1, 2, 1, 2), "block2": (1, 1), "block3": (2, 1, 1), "block4": (2, 1, 1),
            "block5": (2, 1, 1, 1)}  # fmt: skip
_MULTIPLE = 32  # of which an image's sides must be one
_CELL = 8  # pixels of a cell of the map of features, along either side
_LEAST_KEY = 0.05  # probability of a key point


class _Graph:
    """A network in the making. Batch normalisation goes into the convolution before it."""

    def __init__(self, tensors: Tensors) -> None:
        self._tensors = tensors
        self.nodes: list[Any] = []
        self.numbers: list[Any] = []

    def add(self, kind: str, inputs: Sequence[str], **options: Any) -> str:
        out = f"{kind}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [out], **options))
        return out

    def keep(self, name: str, values: Any) -> str:
        self.numbers.append(numpy_helper.from_array(np.ascontiguousarray(values, np.float32), name))
        return name

    def convolve(self, x: str, name: str, stride: int = 1, norm: str | None = None) -> str:
        weight = self._tensors[f"{name}.weight"].astype(np.float64)
        bias = self._tensors.get(f"{name}.bias", np.zeros(len(weight))).astype(np.float64)
        if norm is not None:
            scale = 1.0 / np.sqrt(self._tensors[f"{norm}.running_var"] + 1e-5)
            weight, bias = (
                weight * scale[:, None, None, None],
                (bias - self._tensors[f"{norm}.running_mean"]) * scale,
            )
        side = weight.shape[2]
        inputs = [x, self.keep(f"{name}.w", weight), self.keep(f"{name}.b", bias)]
        return self.add(
            "Conv", inputs, kernel_shape=[side, side], strides=[stride] * 2, pads=[(side - 1) // 2] * 4
        )

    def block(self, x: str, name: str, strides: Sequence[int]) -> str:
        for i, stride in enumerate(strides):
            layer = f"{name}.{i}.layer"
            x = self.add("Relu", [self.convolve(x, f"{layer}.0", stride, f"{layer}.1")])
        return x

    def enlarge(self, x: str, factor: float) -> str:
        scales = self.keep(f"by{factor:g}", [1.0, 1.0, factor, factor])
        return self.add("Resize", [x, "", scales], mode="linear", coordinate_transformation_mode="half_pixel")


def onnx_of(tensors: Tensors) -> bytes:
    """The network as an ONNX model: image in; features, key points and reliability, cell by cell, out."""
    graph = _Graph(tensors)
    small = graph.add("AveragePool", ["image"], kernel_shape=[4, 4], strides=[4, 4])
    first = graph.block("image", "block1", _STRIDES["block1"])
    x = graph.add("Add", [first, graph.convolve(small, "skip1.1")])
    coarser = []
    for name in ("block2", "block3", "block4", "block5"):
        x = graph.block(x, name, _STRIDES[name])
        coarser.append(x)
    _, eighth, sixteenth, thirtysecond = coarser
    both = graph.add("Add", [eighth, graph.enlarge(sixteenth, 2.0)])
    fused = graph.block(graph.add("Add", [both, graph.enlarge(thirtysecond, 4.0)]), "block_fusion", (1, 1))
    features = graph.convolve(fused, "block_fusion.2")
    heat = graph.convolve(graph.block(features, "heatmap_head", (1, 1)), "heatmap_head.2")
    reliability = graph.add("Sigmoid", [heat])
    cells = graph.add("SpaceToDepth", ["image"], blocksize=_CELL)
    keys = graph.convolve(graph.block(cells, "keypoint_head", (1, 1, 1)), "keypoint_head.3")
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 1, "height", "width"])
    outs = [helper.make_tensor_value_info(n, TensorProto.FLOAT, None) for n in (features, keys, reliability)]
    made = helper.make_graph(graph.nodes, "xfeat", [image], outs, graph.numbers)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    return bytes(model.SerializeToString())


class NetworkOutput:
    """What the network sees in one image."""

    def __init__(self, shape: tuple[int, int], outputs: Sequence[NDArray[np.float32]]) -> None:
        features, keys, reliability = (out[0] for out in outputs)
        self._features = np.ascontiguousarray(features.transpose(1, 2, 0))
        self._features /= np.linalg.norm(self._features, axis=2, keepdims=True) + 1e-9
        self._keys, self._reliability = keys, reliability[0]
        cells = np.array(self._features.shape[1::-1], np.float64)
        self._pixels_a_cell = np.array(shape[::-1], np.float64) / cells

    def describe(self, uv: Array) -> NDArray[np.float32]:
        """(N, 64) unit vectors at pixels (N, 2)."""
        found = _between(self._features, (uv + 0.5) / self._pixels_a_cell - 0.5)
        return np.asarray(found / (np.linalg.norm(found, axis=1, keepdims=True) + 1e-9), np.float32)

    def keys(self, count: int) -> Array:
        """(N, 2) the network's own key points, the most reliable first, at most `count`."""
        chance = np.exp(self._keys - self._keys.max(axis=0))
        chance = (chance / chance.sum(axis=0))[:-1]  # the last is that there is none
        rows, columns = chance.shape[1:]
        whole = chance.reshape(_CELL, _CELL, rows, columns).transpose(2, 0, 3, 1)
        whole = np.ascontiguousarray(whole.reshape(_CELL * rows, _CELL * columns))
        peak = (whole == cv2.dilate(whole, np.ones((5, 5)))) & (whole > _LEAST_KEY)
        v, u = np.nonzero(peak)
        place = (np.column_stack([u, v]) + 0.5) / _CELL
        score = whole[v, u] * _between(self._reliability[:, :, None], place - 0.5)[:, 0]
        best = np.argsort(-score, kind="stable")[:count]
        return np.asarray(place[best] * self._pixels_a_cell - 0.5, np.float64)


class Network:
    """Runs on one thread, once for each image: the last two are remembered."""

    def __init__(self, tensors: Tensors) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session = onnxruntime.InferenceSession(
            onnx_of(tensors), options, providers=["CPUExecutionProvider"]
        )
        self._seen: list[tuple[Image, NetworkOutput]] = []

    def run(self, image: Image) -> NetworkOutput:
        """What it sees in an image (H, W) uint8."""
        for known, output in self._seen:
            if known is image:
                return output
        rows, columns = (side // _MULTIPLE * _MULTIPLE for side in image.shape)
        grey = cv2.resize(image, (columns, rows)).astype(np.float32)
        grey = (grey - grey.mean()) / np.sqrt(grey.var() + 1e-5)
        output = NetworkOutput(
            (image.shape[0], image.shape[1]), self._session.run(None, {"image": grey[None, None]})
        )
        self._seen = [*self._seen[-1:], (image, output)]
        return output


def _between(cells: NDArray[np.float32], place: Array) -> NDArray[np.float32]:
    """(N, C) values between the middles of cells (H, W, C), bilinear."""
    top = np.array(cells.shape[1::-1], np.float64) - 1.0
    x, y = np.clip(place, 0.0, top).T
    i = np.minimum(x.astype(int), max(int(top[0]) - 1, 0))
    j = np.minimum(y.astype(int), max(int(top[1]) - 1, 0))
    a, b = (x - i)[:, None], (y - j)[:, None]
    above = cells[j, i] * (1.0 - a) + cells[j, i + 1] * a
    below = cells[j + 1, i] * (1.0 - a) + cells[j + 1, i + 1] * a
    return np.asarray(above * (1.0 - b) + below * b, np.float32)
