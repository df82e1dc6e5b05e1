"""Store and compare tables of measured values with their spreads (columns NAME_spread)."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.base.files import replacing
from lippmann.errors import InputError, input_error, reason

#: Suffix of the name of a column of spreads.
SPREAD = "_spread"


@dataclass(frozen=True)
class Measured:
    """Median and spread (maximum minus minimum) of repeats; a single measurement has spread 0."""

    median: float
    spread: float = 0.0

    @classmethod
    def of(cls, repeats: Iterable[float]) -> Measured:
        """Return the median and spread of one or more repeated measurements."""
        values = list(repeats)
        return cls(float(np.median(values)), float(np.ptp(values)))

    @classmethod
    def finite(cls, value: float) -> Measured | None:
        """Return a single measurement, or None if infinite, such as the PSNR of equal images."""
        return cls(value) if math.isfinite(value) else None


#: A table cell: text, number, bool, sequence of values, `Measured`, or None.
Value = Any
Row = Mapping[str, Value]
Rows = Sequence[Row]


def groups(rows: Iterable[Row], *keys: str) -> list[list[Row]]:
    """Group rows that have equal values in the columns `keys`."""
    rows_of: dict[tuple[Value, ...], list[Row]] = {}
    for row in rows:
        rows_of.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(rows_of.values())


@dataclass(frozen=True)
class Figures:
    """A table of measured values; `name` is the table's file name without extension."""

    name: str
    #: Names of the columns that identify a row.
    keys: tuple[str, ...]
    #: Rows with the same columns; columns that are not keys contain `Measured` or None.
    rows: Rows

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the columns with measured values."""
        return tuple(key for key in (self.rows[0] if self.rows else ()) if key not in self.keys)

    def values(self) -> dict[tuple[str, ...], Measured]:
        """Return the measured values, keyed by row keys (texts) and column name."""
        return {
            (*(str(row[key]) for key in self.keys), column): value
            for row in self.rows
            for column in self.figures
            if isinstance(value := row[column], Measured)
        }

    def flat(self) -> Rows:
        """Return rows for a CSV file; a measured value has two columns, median and spread."""
        return [{k: v for column in row for k, v in self._cells(column, row[column]).items()} for row in self.rows]

    def _cells(self, column: str, value: Value) -> dict[str, Value]:
        if column in self.keys:
            return {column: value}
        return {column: value and value.median, column + SPREAD: value and value.spread}


@dataclass(frozen=True)
class Stored:
    """An earlier run: origin (machine, date, ...), and tables keyed by name."""

    origin: dict[str, str]
    tables: dict[str, Figures]


def read_stored(folder: Path, names: Sequence[str]) -> Stored | None:
    """Read the tables of a run from a folder; return None for a folder without tables.

    Raises InputError for an invalid table, or for tables of different runs.
    """
    paths = [path for path in (folder / f"{name}.csv" for name in names) if path.exists()]
    read = [read_figures(path) for path in paths]
    if not read:
        return None
    origin = read[0][0]
    for path, (other, _) in zip(paths, read, strict=True):
        if other != origin:
            raise _broken(path, f"is from another run than {paths[0].name}")
    return Stored(origin, {table.name: table for _, table in read})


def read_figures(path: Path) -> tuple[dict[str, str], Figures]:
    """Read a table of measured values and its origin from a CSV file.

    Raises InputError for an invalid file.
    """
    origin, rows = read_csv(path)
    columns = list(rows[0]) if rows else []
    figures = [column for column in columns if column + SPREAD in columns]
    keys = tuple(c for c in columns if c not in figures and c.removesuffix(SPREAD) not in figures)
    if not (figures and keys):
        raise _broken(path, "contains no pair of columns NAME and NAME_spread")
    try:
        values = [{c: row[c] if c in keys else _measured(row, c) for c in (*keys, *figures)} for row in rows]
    except (TypeError, ValueError) as error:
        raise _broken(path, str(error)) from None
    return origin, Figures(path.stem, keys, values)


def _measured(row: Row, column: str) -> Measured | None:
    if row[column] is None:
        return None
    value = Measured(float(row[column]), float(row[column + SPREAD]))
    if not (math.isfinite(value.median) and value.spread >= 0.0):
        raise ValueError(f"{row[column]} with the spread {row[column + SPREAD]} is not a measured value")
    return value


def read_csv(path: Path) -> tuple[dict[str, str], list[dict[str, Value]]]:
    """Read a report's CSV file; return its origin (lines `# key: value`) and rows. Empty cells become None.

    Raises InputError for an unreadable file, or a row not as long as the heading.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _broken(path, f"cannot be read ({reason(error)})") from None
    origin = [line[1:].partition(":") for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    if any(None in row or None in row.values() for row in rows):
        raise _broken(path, "has rows of another length than the heading")
    values = [{key: _value(text) for key, text in row.items()} for row in rows]
    return {key.strip(): value.strip() for key, _, value in origin}, values


def _value(text: str) -> Value:
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError:
        return text or None


def _broken(path: Path, what: str) -> InputError:
    return input_error(path, what, "remove it, or name another run's folder with --against")


@dataclass(frozen=True)
class Move:
    """A measured value that changed; `row` lists the keys of its row."""

    table: str
    row: str
    figure: str
    before: Measured
    now: Measured

    @property
    def ratio(self) -> float | None:
        """Ratio of the new to the old value; None if the old value is 0."""
        return self.now.median / self.before.median if self.before.median else None

    def flat(self) -> Row:
        """Return the change as a row of a CSV file."""
        before = {"before": self.before.median, "spread_before": self.before.spread}
        now = {"now": self.now.median, "spread_now": self.now.spread, "ratio": self.ratio}
        return {"table": self.table, "row": self.row, "figure": self.figure, **before, **now}


@dataclass(frozen=True)
class Comparison:
    """Result of comparing two runs; `before` is the earlier run's origin."""

    before: Mapping[str, str]
    #: The keys `command` and `seed`, if they differ; then no values are compared.
    differs: tuple[str, ...] = ()
    #: The keys `machine` and `versions`, if they differ.
    changed: tuple[str, ...] = ()
    #: Number of values present in both runs.
    compared: int = 0
    moved: tuple[Move, ...] = ()
    #: Numbers of values only in the new run, and only in the earlier run.
    new: int = 0
    gone: int = 0


def has_moved(before: Measured, now: Measured) -> bool:
    """Return whether a value changed by more than the sum of both spreads."""
    apart = abs(now.median - before.median)
    return apart > max(before.spread + now.spread, 1e-6 * abs(before.median))  # 1e-6 allows for rounding


def compare(origin: Mapping[str, str], tables: Sequence[Figures], before: Stored | None) -> Comparison:
    """Compare a run's origin and tables with an earlier run's, if one exists."""
    if before is None:
        return Comparison({})
    differs = tuple(key for key in ("command", "seed") if origin[key] != before.origin.get(key))
    if differs:
        return Comparison(before.origin, differs)
    earlier = [before.tables[table.name] for table in tables if table.name in before.tables]
    now, old = (
        {(table.name, *key): value for table in run for key, value in table.values().items()}
        for run in (tables, earlier)
    )
    both = [key for key in now if key in old]
    moved = [
        Move(key[0], ", ".join(key[1:-1]), key[-1], old[key], now[key]) for key in both if has_moved(old[key], now[key])
    ]
    changed = tuple(key for key in ("machine", "versions") if origin[key] != before.origin.get(key))
    counts = (len(both), tuple(moved), len(now) - len(both), len(old) - len(both))
    return Comparison(before.origin, (), changed, *counts)


def where(rows: Rows, **requested: Value) -> list[Row]:
    """Return the rows whose columns have the requested values."""
    return [row for row in rows if all(row[key] == value for key, value in requested.items())]


def values(rows: Sequence[Value], key: str, unit: float = 1.0) -> list[Value]:
    """Return a column divided by `unit`; a measured value becomes its median."""
    plain = (row.get(key) if isinstance(row, Mapping) else getattr(row, key) for row in rows)
    medians = (value.median if isinstance(value, Measured) else value for value in plain)
    return [value if unit == 1.0 or value is None else value / unit for value in medians]


def columns(rows: Rows, names: Mapping[str, str | tuple[str, float]]) -> dict[str, list[Value]]:
    """Return columns keyed by heading; `names` maps a heading to a key, or to a key and a unit."""
    return {heading: values(rows, *([key] if isinstance(key, str) else key)) for heading, key in names.items()}


def spanned(numbers: Sequence[float | None], digits: int = 1) -> str:
    """Format a range of numbers, such as "21.5 to 23.3"; return "-" if all are None."""
    present = [number for number in numbers if number is not None]
    ends = [f"{number:.{digits}f}" for number in (min(present), max(present))] if present else ["-"]
    return " to ".join(dict.fromkeys(ends))


def figure(value: Value) -> str:
    """Format a table cell: three digits for floats, the median for measured values, "-" for None."""
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


def table(columns: Mapping[str, Sequence[Value]]) -> str:
    """Format columns of equal length as a Markdown table."""
    rows = [list(columns), ["---"] * len(columns)]
    rows += [[figure(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def column_names(rows: Rows) -> list[str]:
    """Return the column names of all rows, in order of occurrence."""
    return list(dict.fromkeys(name for row in rows for name in row))


def write_csv(path: Path, origin: Mapping[str, str], rows: Rows) -> None:
    """Write a CSV file: the origin as lines `# key: value`, then the rows; missing cells are empty."""
    with replacing(path) as partial, partial.open("w", newline="") as stream:
        stream.writelines(f"# {key}: {value}\n" for key, value in origin.items())
        writer = csv.DictWriter(stream, column_names(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
