"""Parameter types and options that most commands share."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import click

from lippmann.fixed.words import FRACTIONS, WIDEST
from lippmann.optics.rays import MODELS

Command = Callable[..., Any]
Option = Callable[[Command], Command]


class Vector(click.ParamType[tuple[float, ...]]):
    """Comma-separated finite numbers, such as 0,0,600."""

    name = "vector"

    def __init__(self, size: int, form: str | None = None) -> None:
        self.size = size
        self.form = form or ",".join("XYZ"[:size])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Parse the numbers."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"'{value}' is not {self.form}; give {self.size} numbers with commas", param, ctx)
        if len(numbers) != self.size or not all(math.isfinite(x) for x in numbers):
            self.fail(f"'{value}' is not {self.form}; give {self.size} finite numbers with commas", param, ctx)
        return numbers

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form for help texts."""
        return self.form


class Finite(click.ParamType[float]):
    """A finite number, at least `least`."""

    name = "float"

    def __init__(self, least: float = -math.inf) -> None:
        self.least = least

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse a number and refuse nan and inf."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(f"'{value}' is not a finite number", param, ctx)
        if number < self.least:
            self.fail(f"{value} is less than {self.least:g}", param, ctx)
        return number


json_option = click.option("--json", "as_json", is_flag=True, help="One JSON object on stdout.")
display_option = click.option("--display", "display_path", required=True, metavar="FILE", help="Display file (.toml).")
device_option = click.option(
    "--device",
    default="auto",
    show_default=True,
    type=click.Choice(["auto", "llvm", "cuda"]),
    help="Where the fast engine and Mitsuba run.",
)


model_option = click.option(
    "--model", type=click.Choice(MODELS), default="exact", show_default=True, help="Lens model."
)
seed_option = click.option(
    "--seed", default=0, show_default=True, type=click.IntRange(0, 2**32 - 1), help="Random seed."
)


def fraction_bits_option(what: str, default: int | None = WIDEST) -> Option:
    """Return the option --fraction-bits; `what` names the things whose word length it is.

    With the default None a command sees whether the option was given; the help names the widest as default.
    """
    help_text = f"Word length of {what}." + ("" if default else f"  [default: {WIDEST}]")
    limits = click.IntRange(FRACTIONS[0], FRACTIONS[-1])
    return click.option("--fraction-bits", type=limits, default=default, show_default=True, help=help_text)


def together(*options: Option) -> Option:
    """Return a decorator that gives a command several options, in the order of the help text."""

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate
