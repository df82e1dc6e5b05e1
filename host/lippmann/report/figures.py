"""Figures with their spread, in tables that are kept as CSV: what a run measures and the next one compares itself with.

A column whose neighbour has its name and `_spread` holds figures; the other columns name the row.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.errors import InputError, input_error

#: What the column of a figure's spread is called after the figure.
SPREAD = "_spread"


@dataclass(frozen=True)
class Measured:
    """A figure: the median of its repeats, and its spread, the largest less the smallest.

    What comes out alike each time, such as an error over seeded rays, is taken once and has no spread.
    """

    median: float
    spread: float = 0.0

    @classmethod
    def of(cls, repeats: Iterable[float]) -> Measured:
        """Return the figure of some repeats, at least one."""
        values = list(repeats)
        return cls(float(np.median(values)), float(max(values) - min(values)))


#: A row's name, as text or number in each of its columns, or figures; None: does not apply here.
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Figures:
    """A table.

    Attributes
    ----------
    name
        Of its file, without extension.
    keys
        Columns that name a row; no two rows are alike in all of them.
    rows
        All with the same columns, of which those that are no keys hold `Measured` or None.
    """

    name: str
    keys: tuple[str, ...]
    rows: Sequence[Row]

    @property
    def figures(self) -> tuple[str, ...]:
        """Columns that hold figures."""
        return tuple(key for key in (self.rows[0] if self.rows else ()) if key not in self.keys)

    def values(self) -> dict[tuple[str, ...], Measured]:
        """Return the figures there are, each under its row's keys, as text, and its column."""
        return {
            (*(str(row[key]) for key in self.keys), column): value
            for row in self.rows
            for column in self.figures
            if isinstance(value := row[column], Measured)
        }

    def flat(self) -> list[dict[str, Any]]:
        """Return the rows as a CSV holds them: each figure's median, then its spread."""
        return [
            {
                key: value
                for column, content in row.items()
                for key, value in (((column, content),) if column in self.keys else _pair(column, content))
            }
            for row in self.rows
        ]


def _pair(column: str, value: Measured | None) -> tuple[tuple[str, float | None], tuple[str, float | None]]:
    median, spread = (None, None) if value is None else (value.median, value.spread)
    return (column, median), (column + SPREAD, spread)


@dataclass(frozen=True)
class Stored:
    """A run that was kept: what its files say of where they come from, and its tables by name."""

    origin: dict[str, str]
    tables: dict[str, Figures]


def read_stored(folder: Path, names: Sequence[str]) -> Stored | None:
    """Read the tables that a run has left in a folder; None when there is none.

    Raises
    ------
    InputError
        When a file cannot be read as such a table, or is of another run than the others.
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
    """Read a table, and the lines before it that say where it comes from.

    Raises
    ------
    InputError
        When the file cannot be read, or is no such table.
    """
    origin, rows = read_csv(path)
    columns = list(rows[0]) if rows else []
    figures = [column for column in columns if column + SPREAD in columns]
    keys = tuple(c for c in columns if c not in figures and c.removesuffix(SPREAD) not in figures)
    if not (figures and keys):
        raise _broken(path, "holds no figures with their spread")
    try:
        return origin, Figures(
            path.stem,
            keys,
            [
                {c: row[c] if c in keys else _measured(row[c], row[c + SPREAD]) for c in (*keys, *figures)}
                for row in rows
            ],
        )
    except ValueError as error:
        raise _broken(path, str(error)) from None


def _measured(median: str, spread: str) -> Measured | None:
    if not median:
        return None
    value = Measured(float(median), float(spread))
    if not (math.isfinite(value.median) and value.spread >= 0.0):
        raise ValueError(f"{median} with the spread {spread} is no figure")
    return value


def read_csv(path: Path) -> tuple[dict[str, str], list[dict[str, str]]]:
    """Read a report's CSV: the keys and values of its first lines (`# key: value`), and its rows, all of text.

    Raises
    ------
    InputError
        When the file cannot be read, or its rows have not as many values as there are columns.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise _broken(path, f"cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise _broken(path, "is no text") from None
    said = [line[1:].partition(":") for line in lines if line.startswith("#")]
    reader = csv.DictReader(line for line in lines if not line.startswith("#"))
    rows = list(reader)
    if any(None in row or None in row.values() for row in rows):
        raise _broken(path, "has rows of another length than its heading")
    return {key.strip(): value.strip() for key, _, value in said}, rows


def _broken(path: Path, what: str) -> InputError:
    return input_error(str(path), what, "remove it, or name another run's folder with --against")


def in_turn(works: Mapping[Any, Callable[[], float]], rounds: int) -> dict[Any, list[float]]:
    """Do some works one after the other, all of them `rounds` times; return what each returned in each round.

    What else the machine does then meets all of them: the ratio of two within a round says more than of two medians.
    """
    found: dict[Any, list[float]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            found[name].append(work())
    return found
