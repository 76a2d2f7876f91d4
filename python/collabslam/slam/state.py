"""What the parts of the engine remember between frames, and what a file may say of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from collabslam._core import LARGEST_PIXEL
from collabslam.formats.schema import Check, array, fields, instance, items, number, pose, refuse, text, whole
from collabslam.frontend.patch import Patch


class PersistentState:
    """A part of the engine with a memory.

    Every attribute that a frame leaves behind for the next one is in `PERSISTENT`, with what it may be; what
    is set once from the settings, and what only serves one frame, is not.  The values are such as
    `formats.container` takes.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {}

    def attributes(self) -> dict[str, Any]:
        """The attributes of `PERSISTENT` themselves.

        A frame may bind them to other values but changes none in place: with these the part can go back.
        """
        return {name: getattr(self, name) for name in self.PERSISTENT}

    def go_back(self, attributes: Mapping[str, Any]) -> None:
        """Takes over what `attributes` gave."""
        vars(self).update(attributes)

    def state(self) -> dict[str, Any]:
        """The same as `formats.container` takes it: to be written before the next frame."""
        return self.attributes()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Takes over what `state` gave.

        Raises
        ------
        DataError
            If it is the state of something else, or an attribute is not what it may be.
        """
        fields(**self.PERSISTENT)(state, type(self).__name__)
        for name, value in state.items():
            setattr(self, name, value)


def persistent_parts(owner: object) -> dict[str, PersistentState]:
    """The parts with a memory among an object's attributes, by the attribute's name."""
    return {name: part for name, part in vars(owner).items() if isinstance(part, PersistentState)}


_two = array("<f8", 2)
_grey = array("|u1", None, None)
_four = array("<f8", 4)


def check_pixel(value: Any, where: str) -> None:
    """(2,) pixels."""
    _two(value, where)
    if float(abs(value).max()) > LARGEST_PIXEL:
        refuse(where, "a pixel")


def _window(value: Any, where: str) -> None:
    _grey(value, where)
    if value.shape[0] != value.shape[1] or value.shape[0] % 2 == 0:
        refuse(where, "a square window with a centre")


def _check_inside(value: Any, where: str) -> None:
    _four(value, where)
    if not (value >= 0.0).all() or not (value <= LARGEST_PIXEL).all():
        refuse(where, "a part of the window")


PATCH = instance(Patch, pixels=_window, uv_ref=check_pixel, t_wc=pose, inside=_check_inside)
"""A `Patch` that can be warped."""


_CAMERA = (text(), whole(1, 10**5), whole(1, 10**5), items(number(), 4), items(number()))


def check_camera(value: Any, where: str) -> None:
    """Arguments of a `Camera`, which checks their ranges."""
    items(lambda part, name: None, len(_CAMERA))(value, where)
    for check, part in zip(_CAMERA, value, strict=True):
        check(part, where)
