"""What a check says."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Report:
    """What is wrong, the likeliest cause first, and what could not be checked; both in sentences."""

    findings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
