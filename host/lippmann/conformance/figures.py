"""Tables of measured values, their spreads (columns NAME_spread), and comparisons of runs."""

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

#: Suffix of a column of spreads.
SPREAD = "_spread"


@dataclass(frozen=True)
class Measured:
    """The median of repeats, and their spread, maximum minus minimum; 0 for a single measurement."""

    median: float
    spread: float = 0.0

    @classmethod
    def of(cls, repeats: Iterable[float]) -> Measured:
        """Return the median and spread of at least one repeat."""
        values = list(repeats)
        return cls(float(np.median(values)), float(np.ptp(values)))

    @classmethod
    def finite(cls, value: float) -> Measured | None:
        """Return a value without repeats; None for infinity, as of equal pictures' PSNR."""
        return cls(value) if math.isfinite(value) else None


#: A value of a table: text, number, truth value, several, `Measured`, or None.
Value = Any
Row = Mapping[str, Value]
Rows = Sequence[Row]


def groups(rows: Iterable[Row], *keys: str) -> list[list[Row]]:
    """Return the rows grouped by their values of some keys."""
    rows_of: dict[tuple[Value, ...], list[Row]] = {}
    for row in rows:
        rows_of.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(rows_of.values())


@dataclass(frozen=True)
class Figures:
    """A table of measured values; `name` is its file's name without extension."""

    name: str
    #: The columns that identify a row.
    keys: tuple[str, ...]
    #: All rows have the same columns; those that are not keys hold `Measured` or None.
    rows: Rows

    @property
    def figures(self) -> tuple[str, ...]:
        """The columns that hold measured values."""
        return tuple(key for key in (self.rows[0] if self.rows else ()) if key not in self.keys)

    def values(self) -> dict[tuple[str, ...], Measured]:
        """Return the measured values by the texts of their row's keys and column."""
        return {
            (*(str(row[key]) for key in self.keys), column): value
            for row in self.rows
            for column in self.figures
            if isinstance(value := row[column], Measured)
        }

    def flat(self) -> Rows:
        """Return the rows of the CSV, with each measured value's median and spread."""
        return [{k: v for column in row for k, v in self._cells(column, row[column]).items()} for row in self.rows]

    def _cells(self, column: str, value: Value) -> dict[str, Value]:
        if column in self.keys:
            return {column: value}
        return {column: value and value.median, column + SPREAD: value and value.spread}


@dataclass(frozen=True)
class Stored:
    """An earlier run: its origin (machine, date, ...), and its tables by name."""

    origin: dict[str, str]
    tables: dict[str, Figures]


def read_stored(folder: Path, names: Sequence[str]) -> Stored | None:
    """Read the tables of a run from a folder; None when there are none.

    Raises InputError for a file that is not such a table, or is of another run than the
    others.
    """
    paths = [path for path in (folder / f"{name}.csv" for name in names) if path.exists()]
    read = [read_figures(path) for path in paths]
    if not read:
        return None
    origin = read[0][0]
    for path, (other, _) in zip(paths, read, strict=True):
        if other != origin:
            raise _broken(path, f"is of another run than {paths[0].name}")
    return Stored(origin, {table.name: table for _, table in read})


def read_figures(path: Path) -> tuple[dict[str, str], Figures]:
    """Read a table of measured values and its origin, or raise InputError."""
    origin, rows = read_csv(path)
    columns = list(rows[0]) if rows else []
    figures = [column for column in columns if column + SPREAD in columns]
    keys = tuple(c for c in columns if c not in figures and c.removesuffix(SPREAD) not in figures)
    if not (figures and keys):
        raise _broken(path, "holds no measured values with their spread")
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
    """Read a report's CSV: origin (lines `# key: value`) and rows, with empty cells as None.

    Raises InputError for an unreadable file, or a row of another length than the
    heading.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _broken(path, f"cannot be read ({reason(error)})") from None
    origin = [line[1:].partition(":") for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    if any(None in row or None in row.values() for row in rows):
        raise _broken(path, "has rows of another length than its heading")
    values = [{key: _value(text) for key, text in row.items()} for row in rows]
    return {key.strip(): value.strip() for key, _, value in origin}, values


def _value(text: str) -> Value:
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError:
        return text or None


def _broken(path: Path, what: str) -> InputError:
    return input_error(str(path), what, "remove it, or name another run's folder with --against")


# ---- comparison of two runs ----


@dataclass(frozen=True)
class Move:
    """A value that moved; `row` has the keys of its row."""

    table: str
    row: str
    figure: str
    before: Measured
    now: Measured

    @property
    def ratio(self) -> float | None:
        """Now over before; None when it was 0 before."""
        return self.now.median / self.before.median if self.before.median else None

    def flat(self) -> Row:
        """Return the move as a row of a CSV."""
        before = {"before": self.before.median, "spread_before": self.before.spread}
        now = {"now": self.now.median, "spread_now": self.now.spread, "ratio": self.ratio}
        return {"table": self.table, "row": self.row, "figure": self.figure, **before, **now}


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison."""

    before: Mapping[str, str]
    #: Of command and seed, those that differ; then nothing was compared.
    differs: tuple[str, ...] = ()
    #: Other entries of the origin that differ: machine, versions.
    changed: tuple[str, ...] = ()
    #: Number of values of both runs, and those of them that moved.
    compared: int = 0
    moved: tuple[Move, ...] = ()
    #: Number of values of this run only, and of the earlier run only.
    new: int = 0
    gone: int = 0


def has_moved(before: Measured, now: Measured) -> bool:
    """Tell whether a value moved by more than the noise."""
    apart = abs(now.median - before.median)
    return apart > max(before.spread + now.spread, 1e-6 * abs(before.median))  # beyond rounding errors


def compare(origin: Mapping[str, str], tables: Sequence[Figures], before: Stored | None) -> Comparison:
    """Compare the origin and tables of a run with those of an earlier one, if any."""
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


# ---- tables ----


def where(rows: Rows, **requested: Value) -> list[Row]:
    """Return the rows whose columns have the requested values."""
    return [row for row in rows if all(row[key] == value for key, value in requested.items())]


def values(rows: Sequence[Value], key: str, unit: float = 1.0) -> list[Value]:
    """Return a column of rows or dataclasses, in a unit; measured values are medians."""
    plain = (row.get(key) if isinstance(row, Mapping) else getattr(row, key) for row in rows)
    medians = (value.median if isinstance(value, Measured) else value for value in plain)
    return [value if unit == 1.0 or value is None else value / unit for value in medians]


def columns(rows: Rows, names: Mapping[str, str | tuple[str, float]]) -> dict[str, list[Value]]:
    """Return a table's columns; `names` maps headings to a key, or to key and unit."""
    return {heading: values(rows, *([key] if isinstance(key, str) else key)) for heading, key in names.items()}


def spanned(numbers: Sequence[float | None], digits: int = 1) -> str:
    """Return the range of numbers, such as "21.5 to 23.3", without None; "-" if empty."""
    present = [number for number in numbers if number is not None]
    ends = [f"{number:.{digits}f}" for number in (min(present), max(present))] if present else ["-"]
    return " to ".join(dict.fromkeys(ends))


def figure(value: Value) -> str:
    """Return a value's text in a table: three digits, full counts, medians, "-" for None."""
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
    """Return a Markdown table of columns of equal length."""
    rows = [list(columns), ["---"] * len(columns)]
    rows += [[figure(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def plain_table(rows: Rows) -> str:
    """Return rows as padded columns for a terminal."""
    names = column_names(rows)
    columns = [[name, *(figure(row.get(name)) for row in rows)] for name in names]
    padded = [[cell.ljust(max(map(len, cells))) for cell in cells] for cells in columns]
    return "\n".join("  ".join(line).rstrip() for line in zip(*padded, strict=True))


def column_names(rows: Rows) -> list[str]:
    """Return the names of all columns, in their first order."""
    return list(dict.fromkeys(name for row in rows for name in row))


def write_csv(path: Path, origin: Mapping[str, str], rows: Rows) -> None:
    """Write the origin as lines `# key: value`, then rows; missing cells stay empty."""
    with replacing(path) as partial, partial.open("w", newline="") as stream:
        stream.writelines(f"# {key}: {value}\n" for key, value in origin.items())
        writer = csv.DictWriter(stream, column_names(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
