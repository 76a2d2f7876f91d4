"""What the names of a folder's images tell: their order, and whether they are of one camera, and one kind."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from pathlib import Path

from collabslam.datasets.gate import tell
from collabslam.datasets.units import has_nanosecond_parts, padded
from collabslam.errors import DataError

_LEAST = 3
"""So many images make a kind."""
_DENSE = 1.1
"""Numbers over which names spread for each image, where they count."""
_LEAST_NINES = 4
"""Digits of the largest number of a camera's counter."""
_CAMERA = re.compile(r"(?:cam|camera|left|right|view)[_-]?([0-9]+)(?![0-9])")


def of_one_kind(paths: Sequence[Path]) -> list[Path]:
    """The images but for those without a number among numbered ones, such as a mask or a thumbnail.

    Raises
    ------
    DataError
        If a folder holds two pictures of each number, as left and right, colour and depth, or of ``cam0``
        and ``cam1``: taken for one film they jump from one to the other.
    """
    kinds: dict[str, list[Path]] = {}
    for path in paths:
        kinds.setdefault(re.sub(r"[0-9]+", "#", path.name.lower()), []).append(path)
    if len(kinds) == 1 or _hexadecimal(paths) is not None:
        _check_one_camera(paths)
        return list(paths)
    large = sorted((of for of in kinds.values() if len(of) >= _LEAST), key=len)
    for k, few in enumerate(large):
        for many in large[k + 1 :]:
            shared = {_numbers(p) for p in few} & {_numbers(p) for p in many}
            if 2 * len(shared) >= len(few):
                raise DataError(
                    f"The folder {few[0].parent} holds images of several kinds ({few[0].name}, "
                    f"{many[0].name}); give a folder of one kind."
                )
    odd = {p for kind, of in kinds.items() if "#" not in kind and len(of) < _LEAST for p in of}
    if not large or not any("#" in kind for kind, of in kinds.items() if len(of) >= _LEAST):
        return list(paths)
    if odd:
        tell("passed over", f"{', '.join(sorted(p.name for p in odd))} (named otherwise)", paths[0].parent)
    return [path for path in paths if path not in odd]


def _numbers(path: Path) -> tuple[int, ...]:
    return tuple(int(text) for text in re.findall(r"[0-9]+", path.stem))


def _check_one_camera(paths: Sequence[Path]) -> None:
    cameras = {match[1]: path.name for path in paths if (match := _CAMERA.search(path.stem.lower()))}
    if 1 < len(cameras) <= len(paths) // _LEAST and all(_CAMERA.search(p.stem.lower()) for p in paths):
        raise DataError(
            f"The folder {paths[0].parent} holds images of several cameras "
            f"({', '.join(list(cameras.values())[:2])}); give a folder of one."
        )


def in_order_of_names(paths: Iterable[Path]) -> list[Path]:
    """Images in the order of the numbers in their names: 2 before 10, and 9 before a where they count so.

    Raises
    ------
    DataError
        If the camera's counter ran over on the way, from 9999 to 1.
    """
    found = list(paths)
    stems = [path.stem for path in found]
    if has_nanosecond_parts(stems):
        return sorted(found, key=lambda path: Decimal(padded(path.stem)))
    if all(re.fullmatch(r"-?[0-9]+(\.[0-9]+)?", stem) for stem in stems):
        found.sort(key=lambda path: (Decimal(path.stem), path.name))
    elif (counted := _hexadecimal(found)) is not None:
        tell("order", "by the hexadecimal numbers in the names", found[0].parent)
        found.sort(key=lambda path: counted[path])
    else:
        found.sort(key=natural)
    numbers = counting(found)
    if numbers is not None:
        _check_counter(found, numbers)
    return found


def natural(path: Path) -> tuple[list[str | int], str]:
    """A key that sorts files by the numbers in their names."""
    parts = re.split(r"([0-9]+)", path.name)
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], path.name


def counting(paths: Sequence[Path]) -> list[int] | None:
    """The numbers in the names of images by which each comes after the last; None if there are none.

    It is the last number before the name's first dot that increases, or what they count to the base 16.
    """
    groups = [re.findall(r"[0-9]+", path.name.split(".")[0]) for path in paths]
    columns = list(zip(*groups, strict=True)) if len(set(map(len, groups))) == 1 else []
    rising = [[int(text) for text in column] for column in reversed(columns)]
    counted = _hexadecimal(paths)
    if counted is not None:
        rising.append([counted[path] for path in paths])
    return next((row for row in rising if all(b > a for a, b in itertools.pairwise(row))), None)


def _hexadecimal(paths: Sequence[Path]) -> dict[Path, int] | None:
    """What names count to the base 16; None unless they have such digits, and leave hardly any number out."""
    found = {}
    for path in paths:
        digits = re.search(r"[0-9a-f]+$", path.stem.lower())
        if digits is None:
            return None
        found[path] = int(digits.group(), 16)
    numbers = found.values()
    dense = len(set(numbers)) == len(found) and max(numbers) - min(numbers) < _DENSE * len(found)
    decimal = all(re.search(r"(?<![a-f])[0-9]+$", path.stem.lower()) for path in paths)
    return found if found and dense and not decimal else None


def _check_counter(paths: Sequence[Path], numbers: Sequence[int]) -> None:
    """Refuses images whose counter ran over: 0001 is then after 9999."""
    steps = [b - a for a, b in itertools.pairwise(numbers)]
    widest = max(steps, default=0)
    nines = re.fullmatch("9+", str(numbers[-1])) is not None and len(str(numbers[-1])) >= _LEAST_NINES
    if nines and numbers[0] <= 1 and widest > _DENSE * len(paths):
        last = steps.index(widest)
        raise DataError(
            f"The numbers of the images in {paths[0].parent} ran over, from {paths[-1].name} to "
            f"{paths[0].name}: {paths[last + 1].name} is the first; number them through."
        )
