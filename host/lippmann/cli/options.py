"""Parameter types and options that many commands share."""

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
#: Maximum length of a list of numbers, and magnitude of a number. Python accepts a
#: time-out of this magnitude, in seconds.
MAX_NUMBERS, MAX_NUMBER = 100, 1e9


def is_given(name: str) -> bool:
    """Return whether the user set a parameter of the running command."""
    return click.get_current_context().get_parameter_source(name) is not ParameterSource.DEFAULT


def vector(form: str, number: type[float] = float, remedy: str = "") -> Kind:
    """Return the option type of finite numbers, separated as in `form`: 0,0,600 or 256x192."""
    separator = "," if "," in form else "x"
    size = form.count(separator) + 1

    def read(text: str) -> tuple[float, ...]:
        try:
            numbers = tuple(map(number, text.split(separator)))
            right = 1 <= len(numbers) <= MAX_NUMBERS if form.endswith("...") else len(numbers) == size
            right = right and all(map(math.isfinite, numbers))
        except (ValueError, OverflowError):  # OverflowError: too large for a float
            right = False
        if not right:
            how = remedy or f"give {size} {'whole' if number is int else 'finite'} numbers separated by commas"
            raise ValueError(f"'{text}' is not {form}; {how}")
        return numbers

    return Kind(form, read)


def finite(least: float = -math.inf) -> Kind:
    """Return the option type of a finite number of at least `least`."""

    def read(text: str) -> float:
        number: float = click.FLOAT(text)
        if not math.isfinite(number):
            raise ValueError(f"'{text}' is not finite; give a finite number")
        if not max(least, -MAX_NUMBER) <= number <= MAX_NUMBER:
            raise ValueError(f"{text} is out of range; give {max(least, -MAX_NUMBER):g} to {MAX_NUMBER:g}")
        return number

    return Kind("FLOAT", read)


#: Option type for the size of a slot in texels.
TEXELS = vector("WIDTHxHEIGHT", int, "give texels across and down, such as 256x192")

KINDS |= {float: finite(), Point: vector("X,Y,Z")}
KINDS[Display] = path_kind(lambda text: functools.partial(load_display, text))
#: Option --display; the parameter's type selects the path or the loaded display.
DISPLAY = option("Display file (.toml).", flag="--display")
FOLDER = option("Output folder; created if missing.")
PICTURE = option("Output file: linear .exr or .tif, or .png for the panel.", metavar="OUT")
SCENES = option("Folder of the project's scenes.", "scenes", path_kind(str, "FOLDER"))
DEVICE = option("Device on which the fast engine and Mitsuba run.", "auto", Choice(["auto", "llvm", "cuda"]))
LENS_MODEL = option("Lens model.", "exact")
FORCE = option("Accept an image of another or an unknown display.")
SEED = option("Random seed.", 0, click.IntRange(0, 2**32 - 1))
FRACTION_BITS = click.IntRange(FRACTIONS[0], FRACTIONS[-1])

#: Options for fraction bits: of fixed-point files, and of the engines twin and rtl.
FILE_BITS = option("Fraction bits of words in fixed-point files.", WIDEST, FRACTION_BITS)
ENGINE_BITS = option(f"Fraction bits of words in the engines twin and rtl.  [default: {WIDEST}]", kind=FRACTION_BITS)


def shipped_scenes(path: str) -> Path:
    """Return the folder of the project's scenes; raise InputError for another folder."""
    if not (Path(path) / "displays/paper-square.toml").is_file():
        raise InputError(f"{path}: lacks the project's scenes; correct --scenes, or run in the project's top folder")
    return Path(path)
