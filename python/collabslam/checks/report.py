"""What a check says."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Report:
    """What every check says.

    Attributes
    ----------
    findings : list of str
        What is wrong, the likeliest cause first, in sentences.
    notes : list of str
        What could not be checked, in sentences.
    """

    findings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def checked(self) -> bool:
        """Whether there was anything to hold the images against."""
        raise NotImplementedError

    @property
    def agrees(self) -> bool:
        """Whether that was so, and nothing is wrong."""
        return self.checked and not self.findings
