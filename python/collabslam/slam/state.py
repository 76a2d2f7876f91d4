"""What the parts of the engine remember between frames: each says so itself, `Slam.save` asks them all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from collabslam.errors import DataError


class PersistentState:
    """A part of the engine with a memory.

    Every attribute that a frame leaves behind for the next one is in `PERSISTENT`; what is set once from the
    settings, and what only serves one frame, is not.  The values are such as `formats.container` takes.
    """

    PERSISTENT: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """The attributes of `PERSISTENT`, as they are: to be written before the next frame."""
        return {name: getattr(self, name) for name in self.PERSISTENT}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Takes over what `state` gave.

        Raises
        ------
        DataError
            If it is the state of something else.
        """
        if set(state) != set(self.PERSISTENT):
            raise DataError(f"The file holds no state of {type(self).__name__}; take an earlier one.")
        for name, value in state.items():
            setattr(self, name, value)


def persistent_parts(owner: object) -> dict[str, PersistentState]:
    """The parts with a memory among an object's attributes, by the attribute's name."""
    return {name: part for name, part in vars(owner).items() if isinstance(part, PersistentState)}
