"""What an experiment hands over, and the one writer of its files: NAME.png, NAME.csv, NAME.json, NAME.md."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from collabslam.formats.files import write_bytes, write_text
from collabslam.runs.results import write_summary
from collabslam_lab.report import markdown_table


@dataclass(frozen=True)
class Table:
    """A Markdown table with a line above it."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """The caption and the table."""
        return f"{self.caption}\n\n{markdown_table(self.header, self.rows)}"


@dataclass(frozen=True)
class Finding:
    """One experiment's result.

    Attributes
    ----------
    title : str
    figure : Figure
    tables : list of Table
        The first one has the paper's value or claim beside ours.
    verdict : str
        What differs from the paper, in a sentence or two.
    numbers : dict
        For the JSON file.
    columns : sequence of str
        Of the CSV file.
    rows : sequence of sequences
    """

    title: str
    figure: Figure
    tables: list[Table]
    verdict: str
    numbers: dict[str, Any]
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]] = field(repr=False)

    def markdown(self, name: str, how: str) -> str:
        """The whole page."""
        parts = [f"# {self.title}", f"![{self.title}]({name}.png)"]
        parts += [table.markdown() for table in self.tables]
        parts += [self.verdict, f"Made by `{how}`."]
        return "\n\n".join(parts) + "\n"


def hand_over(folder: Path, name: str, finding: Finding, how: str) -> dict[str, Any]:
    """Write an experiment's files, print its page, return its numbers.

    Raises
    ------
    DataError
        If the folder cannot be written.
    """
    write_finding(folder, name, finding, how)
    print(finding.markdown(name, how), flush=True)
    return finding.numbers


def write_finding(folder: Path, name: str, finding: Finding, how: str) -> None:
    """Write the four files of an experiment.

    Raises
    ------
    DataError
        If the folder cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(finding.columns)
    writer.writerows([[_cell(value) for value in row] for row in finding.rows])
    picture = io.BytesIO()
    finding.figure.savefig(picture, format="png", metadata={"Software": None})
    write_bytes(folder / f"{name}.png", picture.getvalue())
    write_text(folder / f"{name}.csv", text.getvalue())
    write_summary(folder / f"{name}.json", finding.numbers)
    write_text(folder / f"{name}.md", finding.markdown(name, how))


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.6g}"
    return str(value)
