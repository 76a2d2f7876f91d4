"""Why something was refused, in words, counted; errors that differ in their numbers alone are one."""

from __future__ import annotations

import re
from collections import Counter

MOST = 32
"""Reasons that are told apart; what comes after is `OTHERS`."""
OTHERS = "other reasons"
_NUMBER = re.compile(r"[-+]?\d[\w.+-]*")


class Refusals(Counter[str]):
    """How often, by reason; a reason is quoted as it was told first.  It grows by `MOST` at most."""

    def __init__(self) -> None:
        super().__init__()
        self._shown: dict[str, str] = {}

    def add(self, error: Exception) -> None:
        """One more."""
        text = str(error)
        kind = _NUMBER.sub("#", text)
        if kind not in self._shown and len(self._shown) < MOST:
            self._shown[kind] = text
        self[self._shown.get(kind, OTHERS)] += 1
