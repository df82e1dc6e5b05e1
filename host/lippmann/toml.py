"""Reads TOML tables key by key: each key is checked where it is read, and none is left over."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

from lippmann.errors import input_error


class Table:
    """One TOML table.

    Every reading method raises InputError naming file, key and remedy. A default of None makes a key obligatory.
    """

    def __init__(self, raw: Mapping[str, Any], source: str, name: str) -> None:
        self.source = source
        self._raw = dict(raw)
        self._name = name
        self._read: set[str] = set()

    def where(self, key: str) -> str:
        """Name a key for an error message."""
        return f"{self.source}: {self._name + '.' if self._name else ''}{key}"

    def _take(self, key: str, default: Any = None) -> Any:
        self._read.add(key)
        if key not in self._raw:
            if default is not None:
                return default
            raise input_error(self.where(key), "the key is missing", "add it")
        return self._raw[key]

    def table(self, key: str) -> Table:
        """Return a table inside this one."""
        value = self._take(key)
        if not isinstance(value, dict):
            raise input_error(self.where(key), "is not a table", f"write it as [{key}]")
        return Table(value, self.source, f"{self._name}.{key}" if self._name else key)

    def optional_table(self, key: str) -> Table | None:
        """Return a table inside this one, or None where it is left out."""
        self._read.add(key)
        return self.table(key) if key in self._raw else None

    def tables(self, key: str) -> list[Table]:
        """Return the tables of a list, in their order; none where it is left out."""
        value = self._take(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise input_error(self.where(key), "is not a list of tables", f"write each as [[{key}]] or {{ ... }}")
        name = f"{self._name}.{key}" if self._name else key
        return [Table(item, self.source, f"{name}[{k}]") for k, item in enumerate(value)]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text."""
        value = self._take(key, default)
        if not isinstance(value, str):
            raise input_error(self.where(key), f"{value!r} is not text", "put it in quotes")
        return value

    def choice(self, key: str, options: tuple[str, ...], default: str | None = None) -> str:
        """Return one of the options."""
        value = self._take(key, default)
        if value not in options:
            quoted = ", ".join(f'"{option}"' for option in options)
            raise input_error(self.where(key), f"{value!r} is not known", f"choose from {quoted}")
        return cast(str, value)

    def number(
        self,
        key: str,
        default: float | None = None,
        above: float = -math.inf,
        at_least: float = -math.inf,
        at_most: float = math.inf,
    ) -> float:
        """Return a finite number within bounds."""
        return self._number(key, self._take(key, default), above, at_least, at_most)

    def optional_number(self, key: str, above: float = -math.inf) -> float | None:
        """Return a finite number, or None where the key is left out."""
        self._read.add(key)
        return self.number(key, above=above) if key in self._raw else None

    def _number(
        self,
        key: str,
        value: Any,
        above: float = -math.inf,
        at_least: float = -math.inf,
        at_most: float = math.inf,
    ) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise input_error(self.where(key), f"{value!r} is not a number", "give a number")
        try:
            number = float(value)
        except OverflowError:  # an integer beyond the largest float
            number = math.inf if value > 0 else -math.inf
        if not math.isfinite(number):
            raise input_error(self.where(key), f"{number} is not finite", "give a finite number")
        if not number > above:
            raise input_error(self.where(key), f"{number:g} is out of range", f"give more than {above:g}")
        if not number >= at_least:
            raise input_error(self.where(key), f"{number:g} is out of range", f"give at least {at_least:g}")
        if not number <= at_most:
            raise input_error(self.where(key), f"{number:g} is out of range", f"give at most {at_most:g}")
        return number

    def integer(self, key: str, low: int, high: int, default: int | None = None) -> int:
        """Return a whole number from low to high."""
        value = self._take(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise input_error(
                self.where(key),
                f"{value!r} is out of range",
                f"give a whole number from {low} to {high}",
            )
        return value

    def _vector(self, key: str, default: tuple[float, ...], form: str) -> list[float]:
        value = self._take(key, list(default))
        if not isinstance(value, list) or len(value) != len(default):
            raise input_error(self.where(key), f"{value!r} is not a vector", f"give {form}")
        return [self._number(key, item) for item in value]

    def pair(self, key: str, default: tuple[float, float]) -> tuple[float, float]:
        """Return two finite numbers."""
        x, y = self._vector(key, default, "[x, y]")
        return x, y

    def triple(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return three finite numbers."""
        x, y, z = self._vector(key, default, "[x, y, z]")
        return x, y, z

    def one_of(self, *keys: str) -> str:
        """Return which of several keys is there; exactly one must be."""
        self._read.update(keys)
        present = [key for key in keys if key in self._raw]
        if len(present) != 1:
            state = "several are given" if present else "none is given"
            raise input_error(self.where(" or ".join(keys)), state, "give exactly one of them")
        return present[0]

    def refuse_leftovers(self) -> None:
        """Raise for the first key that nothing has read."""
        for key in self._raw:
            if key not in self._read:
                known = ", ".join(sorted(self._read))
                raise input_error(self.where(key), "the key is unknown", f"known here: {known}")
