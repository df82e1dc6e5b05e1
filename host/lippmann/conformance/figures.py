"""Measured values with their spread, in tables that are kept as CSV, so that the next run can be compared with them.

A column NAME with a neighbour NAME_spread holds measured values. The other columns name the row.
"""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.errors import InputError, input_error

#: Suffix of the column that holds a measured value's spread.
SPREAD = "_spread"


def row_of(row: Any) -> dict[str, Any]:
    """Return a dataclass as a table's row: its fields, then its properties."""
    properties = [name for name, value in vars(type(row)).items() if isinstance(value, property)]
    return {**dataclasses.asdict(row), **{name: getattr(row, name) for name in properties}}


@dataclass(frozen=True)
class Measured:
    """The median of some repeats, and their spread: the largest less the smallest.

    A value that every repeat would give again, such as an error over seeded rays, is measured once; its spread is 0.
    """

    median: float
    spread: float = 0.0

    @classmethod
    def of(cls, repeats: Iterable[float]) -> Measured:
        """Return the median and spread of some repeats, at least one."""
        values = list(repeats)
        return cls(float(np.median(values)), float(max(values) - min(values)))

    @classmethod
    def finite(cls, value: float) -> Measured | None:
        """Return a value without repeats; None when it is infinite, as the PSNR of equal pictures is."""
        return cls(value) if math.isfinite(value) else None


#: A row: text or numbers that name it, and measured values. None: does not apply to this row.
Row = Mapping[str, Any]


def groups(rows: Iterable[Row], *keys: str) -> list[list[Row]]:
    """Return the rows in groups that have the same values of some keys, in the order of their first rows."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(found.values())


@dataclass(frozen=True)
class Figures:
    """A table of measured values; `name` is that of its file, without extension."""

    name: str
    #: The columns that name a row. No two rows have the same keys.
    keys: tuple[str, ...]
    #: All rows have the same columns; those that are not keys hold `Measured` or None.
    rows: Sequence[Row]

    @property
    def figures(self) -> tuple[str, ...]:
        """The columns that hold measured values."""
        return tuple(key for key in (self.rows[0] if self.rows else ()) if key not in self.keys)

    def values(self) -> dict[tuple[str, ...], Measured]:
        """Return every measured value under the keys of its row (as text) and its column."""
        return {
            (*(str(row[key]) for key in self.keys), column): value
            for row in self.rows
            for column in self.figures
            if isinstance(value := row[column], Measured)
        }

    def flat(self) -> list[dict[str, Any]]:
        """Return the rows as the CSV holds them: for each measured value its median, then its spread."""
        return [{k: v for column in row for k, v in self._cells(column, row[column]).items()} for row in self.rows]

    def _cells(self, column: str, value: Any) -> dict[str, Any]:
        if column in self.keys:
            return {column: value}
        return {column: value and value.median, column + SPREAD: value and value.spread}


@dataclass(frozen=True)
class Stored:
    """A run that was kept: its origin (machine, date, command, ...), and its tables by name."""

    origin: dict[str, str]
    tables: dict[str, Figures]


def read_stored(folder: Path, names: Sequence[str]) -> Stored | None:
    """Read the tables that a run has left in a folder; None when there are none.

    Raises InputError when a file is not such a table, or belongs to another run than the others.
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
    """Read a table of measured values and its origin; raise InputError when the file is not such a table."""
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


def read_csv(path: Path) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """Read a report's CSV: its origin from the first lines (`# key: value`), and its rows.

    Numbers are read as numbers, empty cells as None. Raises InputError when the file cannot be read, or a row has
    another number of values than the heading.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise _broken(path, f"cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise _broken(path, "is not text") from None
    origin = [line[1:].partition(":") for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    if any(None in row or None in row.values() for row in rows):
        raise _broken(path, "has rows of another length than its heading")
    values = [{key: _value(text) for key, text in row.items()} for row in rows]
    return {key.strip(): value.strip() for key, _, value in origin}, values


def _value(text: str) -> Any:
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError:
        return text or None


def _broken(path: Path, what: str) -> InputError:
    return input_error(str(path), what, "remove it, or name another run's folder with --against")


def in_turn(works: Mapping[Any, Callable[[], float]], rounds: int) -> dict[Any, list[float]]:
    """Call all works one after the other, `rounds` times; return what each returned in each round.

    Other programs then slow all works alike: a ratio within one round is more reliable than a ratio of two medians.
    """
    found = [{name: work() for name, work in works.items()} for _ in range(rounds)]
    return {name: [times[name] for times in found] for name in works}
