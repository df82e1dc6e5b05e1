"""Tables and the CSV files that keep them."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lippmann.images import replacing
from lippmann.measure.figures import Measured


def figure(value: Any) -> str:
    """Return a value as a table shows it: numbers in three digits, counts whole, the median of repeats, None as "-"."""
    if isinstance(value, Measured):
        value = value.median
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "**no**"
    if isinstance(value, float):
        if math.isinf(value):
            return "further"
        return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
    if isinstance(value, list | tuple):
        return ", ".join(figure(one) for one in value)
    return str(value)


def table(columns: Mapping[str, Sequence[Any]]) -> str:
    """Return a Markdown table of columns of equal length under their headings."""
    rows = [list(columns), ["---"] * len(columns)]
    rows += [[figure(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def plain_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a terminal shows them: padded columns under their names."""
    names = column_names(rows)
    cells = [names, *([figure(row.get(name)) for name in names] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(names))]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
    return "\n".join(line.rstrip() for line in lines)


def column_names(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the names of all columns, in the order in which rows have them first."""
    return list(dict.fromkeys(name for row in rows for name in row))


def write_csv(path: Path, origin: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows, after lines `# key: value` with their origin. A column that a row lacks stays empty."""
    with replacing(path) as partial, partial.open("w", newline="") as stream:
        stream.writelines(f"# {key}: {value}\n" for key, value in origin.items())
        writer = csv.DictWriter(stream, column_names(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
