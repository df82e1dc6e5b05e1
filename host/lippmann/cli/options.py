"""Parameter types and options that most commands share."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import click
from click.core import ParameterSource

from lippmann.cli.frame import KINDS, Choice, Kind, option, path_kind
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError
from lippmann.fixed.words import FRACTIONS, WIDEST

Point = tuple[float, float, float]
#: Maximum length of a list of numbers, and size of a number: mm, and seconds that Python can wait.
MAX_NUMBERS, MAX_NUMBER = 100, 1e9


def is_given(name: str) -> bool:
    """Tell whether the user gave a parameter of the command that runs."""
    return click.get_current_context().get_parameter_source(name) is not ParameterSource.DEFAULT


def vector(form: str, number: type[float] = float, remedy: str = "") -> Kind:
    """Return the type of finite numbers, separated as in `form`: 0,0,600 or 256x192."""
    separator = "," if "," in form else "x"
    size = form.count(separator) + 1

    def read(text: str) -> tuple[float, ...]:
        try:
            numbers = tuple(map(number, text.split(separator)))
            right = 1 <= len(numbers) <= MAX_NUMBERS if form.endswith("...") else len(numbers) == size
            right = right and all(map(math.isfinite, numbers))
        except (ValueError, OverflowError):  # an integer too large for a float
            right = False
        if not right:
            how = remedy or f"give {size} {'whole' if number is int else 'finite'} numbers with commas"
            raise ValueError(f"'{text}' is not {form}; {how}")
        return numbers

    return Kind(form, read)


def finite(least: float = -math.inf) -> Kind:
    """Return the type of a finite number from `least` on."""

    def read(text: str) -> float:
        number: float = click.FLOAT(text)
        if not math.isfinite(number):
            raise ValueError(f"'{text}' is not finite; give a number")
        if not max(least, -MAX_NUMBER) <= number <= MAX_NUMBER:
            low = f"less than {least:g}" if number < least else "too large"
            raise ValueError(f"{text} is {low}; give a number up to {MAX_NUMBER:g}")
        return number

    return Kind("FLOAT", read)


#: Texels of a slot, across and down.
TEXELS = vector("WIDTHxHEIGHT", int, "give texels across and down, such as 256x192")

KINDS |= {float: finite(), Point: vector("X,Y,Z")}
KINDS[Display] = path_kind(lambda text: functools.partial(load_display, text))
#: The path or the display, by the parameter's type.
DISPLAY = option("Display file (.toml).", flag="--display")
FOLDER = option("Output folder; made when missing.")
PICTURE = option(".exr or .tif linear, .png for the panel.", metavar="OUT")
SCENES = option("The project's folder of scenes.", "scenes", path_kind(str, "FOLDER"))
DEVICE = option("Where the fast engine and Mitsuba run.", "auto", Choice(["auto", "llvm", "cuda"]))
LENS_MODEL = option("Lens model.", "exact")
FORCE = option("Accept an image that was rendered for another display, or names none.")
SEED = option("Random seed.", 0, click.IntRange(0, 2**32 - 1))
FRACTION_BITS = click.IntRange(FRACTIONS[0], FRACTIONS[-1])

#: The word lengths of files, and of commands with --engine.
FILE_BITS = option("Word length of fixed-point files.", WIDEST, FRACTION_BITS)
ENGINE_BITS = option(f"Word length of the engines twin and rtl.  [default: {WIDEST}]", kind=FRACTION_BITS)


def shipped_scenes(path: str) -> Path:
    """Return the project's folder of scenes; refuse another folder."""
    if not (Path(path) / "displays/paper-square.toml").is_file():
        raise InputError(f"{path}: the project's scenes are not there; run in the project's top folder")
    return Path(path)
