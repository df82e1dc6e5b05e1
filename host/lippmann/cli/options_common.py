"""Parameter types and options that most commands share."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import click

from lippmann.cli.frame import Choice, option
from lippmann.errors import InputError
from lippmann.fixed.words import FRACTIONS, WIDEST

Point = tuple[float, float, float]


class Vector(click.ParamType[tuple[float, ...]]):
    """Comma-separated finite numbers, such as 0,0,600."""

    name = "vector"

    def __init__(self, size: int, form: str | None = None) -> None:
        self.size = size
        self.form = form or ",".join("XYZ"[:size])

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Parse the numbers."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != self.size or not all(math.isfinite(x) for x in numbers):
            self.fail(f"'{value}' is not {self.form}; give {self.size} finite numbers with commas", param, ctx)
        return numbers

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form for help texts."""
        return self.form


class Finite(click.types.FloatParamType):
    """A finite number, at least `least`."""

    def __init__(self, least: float = -math.inf) -> None:
        self.least = least

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse a number and refuse nan and inf."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"'{value}' is not a finite number", param, ctx)
        if number < self.least:
            self.fail(f"{value} is less than {self.least:g}", param, ctx)
        return number


DISPLAY = option("Display file (.toml).", flag="--display", metavar="FILE")
SCENES = option("The project's folder of scenes.", "scenes")
DEVICE = option("Where the fast engine and Mitsuba run.", "auto", Choice(["auto", "llvm", "cuda"]))
LENS_MODEL = option("Lens model.", "exact")
SEED = option("Random seed.", 0, click.IntRange(0, 2**32 - 1))
FRACTION_BITS = click.IntRange(FRACTIONS[0], FRACTIONS[-1])


def word_length(what: str, default: int = WIDEST) -> Any:
    """Declare the option --fraction-bits; `what` names the things whose word length it is."""
    return option(f"Word length of {what}.", default, FRACTION_BITS)


class Slot(click.ParamType[tuple[int, int]]):
    """Texels across and down of a slot, such as 256x192."""

    name = "slot"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Parse the numbers."""
        if isinstance(value, tuple):
            return value
        found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", str(value))
        if found is None:
            self.fail(f"'{value}' is not WIDTHxHEIGHT; give texels across and down, such as 256x192", param, ctx)
        return int(found[1]), int(found[2])

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form for help texts."""
        return "WIDTHxHEIGHT"


def shipped_scenes(path: str) -> Path:
    """Return the project's folder of scenes; refuse another folder."""
    if not (Path(path) / "displays/paper-square.toml").is_file():
        raise InputError(f"{path}: the project's scenes are not there; run in the project's top folder")
    return Path(path)
