"""What the names of a folder's images tell: whether they are of one camera, and one kind."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from collabslam.datasets.gate import tell
from collabslam.errors import DataError

_LEAST = 3
"""So many images make a kind."""
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
    if len(kinds) == 1:
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
