"""A vocabulary of ORB's words, as ORB-SLAM3 reads it: a tree of descriptors of the recordings' own images.

The one that its authors hand out is a download of its own and on no registry.  Words serve relocalisation,
loops and the first guess of matches between keyframes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam.errors import DataError
from collabslam.formats.files import write_text
from collabslam.types import Array, Image, Indices

BRANCHES, DEPTH = 10, 6
"""Of the authors' own tree; ORB-SLAM3 compares keyframes by the nodes four levels above the words."""
FEW = 30
"""Descriptors of which no further branches are made."""
FEATURES = 800
"""Of an image."""
_ROUNDS = 6
_BITS = 256
_L1, _TF_IDF = 0, 0

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Node:
    """Of the tree.

    Attributes
    ----------
    parent : int
        Its place in the list of nodes, from 1; 0 is the root.
    descriptor : (32,) uint8
    weight : float
        Of a word, by how few images have it; 0 for a branch.
    leaf : bool
    """

    parent: int
    descriptor: Bytes
    weight: float
    leaf: bool


def train(images: Iterable[Image]) -> list[Node]:
    """The tree of the images' descriptors, each node after its parent.

    Raises
    ------
    DataError
        If the images have too few corners for a tree of two levels.
    """
    detector: Any = cv2.ORB.create(nfeatures=FEATURES)
    found, of_image = [], []
    number = 0
    for image in images:
        _, descriptors = detector.detectAndCompute(image, None)
        if descriptors is not None:
            found.append(descriptors)
            of_image.append(np.full(len(descriptors), number))
            number += 1
    if sum(map(len, found)) < BRANCHES * FEW:
        raise DataError(
            "The images have too few corners for a vocabulary; give recordings with more texture."
        )
    descriptors, source = np.concatenate(found), np.concatenate(of_image)
    bits = (2.0 * np.unpackbits(descriptors, axis=1) - 1.0).astype(np.float32)
    generator = np.random.default_rng(0)
    nodes: list[Node] = []
    waiting: list[tuple[int, int, Indices]] = [(0, 0, np.arange(len(bits)))]
    while waiting:
        parent, depth, members = waiting.pop()
        for centre, of_it in _clusters(bits, members, generator):
            leaf = depth + 1 == DEPTH or len(of_it) <= FEW
            weight = float(np.log(number / len(np.unique(source[of_it])))) if leaf else 0.0
            nodes.append(Node(parent, np.packbits(centre > 0.0), weight, leaf))
            if not leaf:
                waiting.append((len(nodes), depth + 1, of_it))
    return nodes


def write_vocabulary(nodes: list[Node], path: Path) -> None:
    """Writes the text that ORB-SLAM3 reads, which takes a last empty line for a node."""
    lines = [f"{BRANCHES} {DEPTH} {_L1} {_TF_IDF}"]
    for node in nodes:
        numbers = " ".join(map(str, node.descriptor))
        lines.append(f"{node.parent} {int(node.leaf)} {numbers} {node.weight:.6f}")
    write_text(path, "\n".join(lines))


def _clusters(
    bits: NDArray[np.float32], members: Indices, generator: np.random.Generator
) -> list[tuple[Array, Indices]]:
    """Members by the nearest of so many majorities of their bits, and these; at least two of them.

    With bits of -1 and 1 a product is 256 less twice the Hamming distance.
    """
    own = bits[members]
    centres = own[generator.choice(len(own), BRANCHES, replace=False)]
    for _ in range(_ROUNDS):
        nearest = np.argmax(own @ centres.T, axis=1)
        kept = [own[nearest == k].sum(axis=0) for k in np.unique(nearest)]
        centres = np.where(np.asarray(kept) >= 0.0, 1.0, -1.0).astype(np.float32)
    nearest = np.argmax(own @ centres.T, axis=1)
    return [(centres[k], members[nearest == k]) for k in np.unique(nearest)]
