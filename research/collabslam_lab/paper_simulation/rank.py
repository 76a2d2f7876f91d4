"""Ranks of matrices: exact for rational entries, by singular values otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from collabslam.types import Array

TOLERANCE = 1e-7
"""Singular values below this share of the largest one count as zero, after every column is scaled to length
1."""

Rational = Sequence[Sequence[Fraction]]


def exact_rank(matrix: Rational) -> int:
    """Rank by Gaussian elimination in rational arithmetic: no rounding, no tolerance."""
    rows = [list(row) for row in matrix]
    rank = 0
    for column in range(len(rows[0]) if rows else 0):
        pivot = next((i for i in range(rank, len(rows)) if rows[i][column] != 0), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for i in range(rank + 1, len(rows)):
            if rows[i][column] != 0:
                factor = rows[i][column] / rows[rank][column]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[rank], strict=True)]
        rank += 1
    return rank


def singular_values(matrix: Array) -> Array:
    """Singular values over the largest, one for each column, columns scaled to length 1; zeros fill up."""
    length = np.linalg.norm(matrix, axis=0)
    values = np.linalg.svd(matrix / np.where(length > 0.0, length, 1.0), compute_uv=False)
    out = np.zeros(matrix.shape[1])
    out[: len(values)] = values / values[0]
    return out


def numeric_nullity(matrix: Array) -> int:
    """Number of singular values that count as zero."""
    return int((singular_values(matrix) < TOLERANCE).sum())
