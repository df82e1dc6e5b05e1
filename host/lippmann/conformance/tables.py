"""Tables and the CSV files that keep them."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lippmann.base.files import replacing
from lippmann.conformance.figures import Measured

Rows = Sequence[Mapping[str, Any]]


def where(rows: Rows, **wanted: Any) -> list[Mapping[str, Any]]:
    """Return the rows whose columns have the wanted values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def values(rows: Sequence[Any], key: str, unit: float = 1.0) -> list[Any]:
    """Return a column of rows or dataclasses, measured values as their medians; numbers are divided by the unit."""
    plain = (row.get(key) if isinstance(row, Mapping) else getattr(row, key) for row in rows)
    medians = (value.median if isinstance(value, Measured) else value for value in plain)
    return [value if unit == 1.0 or value is None else value / unit for value in medians]


def columns(rows: Rows, names: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return columns for a table: `names` has a key, or a key and its unit, under each heading."""
    return {heading: values(rows, *([key] if isinstance(key, str) else key)) for heading, key in names.items()}


def spanned(numbers: Sequence[float | None], digits: int = 1) -> str:
    """Return the range of the numbers that are not None, such as "21.5 to 23.3"; "-" when there are none."""
    given = [number for number in numbers if number is not None]
    ends = [f"{number:.{digits}f}" for number in (min(given), max(given))] if given else ["-"]
    return " to ".join(dict.fromkeys(ends))


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


def plain_table(rows: Rows) -> str:
    """Return rows as a terminal shows them: padded columns under their names."""
    names = column_names(rows)
    cells = [names, *([figure(row.get(name)) for name in names] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(names))]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
    return "\n".join(line.rstrip() for line in lines)


def column_names(rows: Rows) -> list[str]:
    """Return the names of all columns, in the order in which rows have them first."""
    return list(dict.fromkeys(name for row in rows for name in row))


def write_csv(path: Path, origin: Mapping[str, str], rows: Rows) -> None:
    """Write rows, after lines `# key: value` with their origin. A column that a row lacks stays empty."""
    with replacing(path) as partial, partial.open("w", newline="") as stream:
        stream.writelines(f"# {key}: {value}\n" for key, value in origin.items())
        writer = csv.DictWriter(stream, column_names(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
