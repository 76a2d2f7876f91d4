"""An attack, and what may become of it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class AttackOutcome(str, Enum):
    """What became of an attack; the first four may be right, the others never are."""

    REFUSED = "refused"
    """Exit status 2 and one sentence that names the fault."""
    TOLD = "not trusted"
    """Exit status 1: it went on to the end, and says that the result is not to be trusted."""
    HELD = "held"
    """Exit status 0."""
    ENDED = "ended"
    """Ended by a signal, with the status that belongs to it."""
    WRONG = "OK beside a wrong pose"
    """More than one in fifty poses say OK further than 5 sigma from the truth, whatever the exit status."""
    TRACEBACK = "traceback"
    HANG = "hang"
    LOST = "lost file"
    MEMORY = "memory"
    UNNAMED = "fault not named"
    CHANGED = "state changed"


MAY_BE_RIGHT = (AttackOutcome.REFUSED, AttackOutcome.TOLD, AttackOutcome.HELD, AttackOutcome.ENDED)
REFUSED = (AttackOutcome.REFUSED,)
HELD = (AttackOutcome.HELD,)
HELD_OR_TOLD = (AttackOutcome.HELD, AttackOutcome.TOLD)
READ_OR_REFUSED = (AttackOutcome.HELD, AttackOutcome.REFUSED)


@dataclass(frozen=True)
class Deed:
    """What is run.

    Attributes
    ----------
    words : list of str
        After ``python -m``: a module and its arguments.
    limits : dict
        Options of the shell's ``ulimit`` with their values, as ``{"n": 16}``.
    stdout, stderr : str
        ``kept``, ``closed`` (nobody reads) or ``full`` (a full device).
    environment : dict
        Variables besides those of this process.
    signals : list of (int, float or str)
        Each is sent after so many seconds, or after ``"frames"``: when three frames are done.
    """

    words: list[str]
    limits: dict[str, int] = field(default_factory=dict)
    stdout: str = "kept"
    stderr: str = "kept"
    environment: dict[str, str] = field(default_factory=dict)
    signals: list[tuple[signal.Signals, float | str]] = field(default_factory=list)


@dataclass(frozen=True)
class Attack:
    """An attack.

    Attributes
    ----------
    group, name, what : str
        The name is the group's own; ``what`` is a row of the documentation.
    make : callable
        Prepares a ``Scene``, and says what is run.
    good : tuple of AttackOutcome
        What may become of it.
    says : str
        What a refusal must contain.
    beyond : bool
        Whether no image can tell that the recording is wrong (the documentation says why), so that OK beside
        a wrong pose is to be expected; it is listed as that, and does not count as held.
    """

    group: str
    name: str
    what: str
    make: Callable[[Any], Deed]
    good: tuple[AttackOutcome, ...] = REFUSED
    says: str = ""
    beyond: bool = False


@dataclass(frozen=True)
class Result:
    """What became of an attack.

    Attributes
    ----------
    attack : Attack
    outcome : AttackOutcome
    status : int
        Exit status, negative of a signal's number where that ended the process.
    seconds, memory_mb : float
        That it took, and the most memory.
    said : str
        Its last words on standard error.
    ok_share, false_ok_share : float or None
        Of the run's summary.
    """

    attack: Attack
    outcome: AttackOutcome
    status: int
    seconds: float
    memory_mb: float
    said: str
    ok_share: float | None = None
    false_ok_share: float | None = None

    @property
    def good(self) -> bool:
        """Whether it is what may become of that attack."""
        return self.outcome in self.attack.good

    @property
    def beyond(self) -> bool:
        """Whether it went as it must where no image tells that the recording is wrong."""
        return self.attack.beyond and self.outcome is AttackOutcome.WRONG

    @property
    def succeeded(self) -> bool:
        """Whether the attack found a fault of ours."""
        return not self.good and not self.beyond

    def jsonable(self) -> dict[str, Any]:
        """As a row of ``reliability.json``."""
        return {
            "group": self.attack.group,
            "attack": self.attack.name,
            "what": self.attack.what,
            "outcome": self.outcome.value,
            "good": self.good,
            "beyond": self.beyond,
            "status": self.status,
            "seconds": round(self.seconds, 2),
            "memory_mb": round(self.memory_mb),
            "said": self.said,
            "ok_share": self.ok_share,
            "false_ok_share": self.false_ok_share,
        }
