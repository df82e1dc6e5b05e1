"""What a section of the report is made of, whatever it is written as."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lippmann.report.figures import Figures, Measured


@dataclass(frozen=True)
class Plot:
    """A picture: its file's name, its PNG, what it shows, and the same for those who do not see it."""

    name: str
    png: bytes
    caption: str
    alt: str


@dataclass(frozen=True)
class Shown:
    """A table as the page shows it: headings over equally long columns."""

    caption: str
    columns: Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class Section:
    """A section.

    Attributes
    ----------
    title
        Its heading.
    text
        Paragraphs; words between backticks are code.
    tables, plots
        What is shown, in this order.
    data
        Tables whose figures are kept.
    """

    title: str
    text: Sequence[str]
    tables: Sequence[Shown]
    plots: Sequence[Plot]
    data: Sequence[Figures]


def column(rows: Sequence[Mapping[str, Any]], key: str, unit: float = 1.0) -> list[Any]:
    """Return a column of rows as a table shows it: figures by their medians, in a unit; None where there is none."""
    values = (row[key] for row in rows)
    return [value.median / unit if isinstance(value, Measured) else value for value in values]
