"""The options that say how pictures are rendered: of `render` and of `animate`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from lippmann.errors import InputError
from lippmann.fixed.words import FRACTIONS, WIDEST
from lippmann.optics.rays import ENGINES, MODELS, Engine
from lippmann.rendering.sources import APERTURES
from lippmann.select.model import TOLERANCE

Command = Callable[..., Any]

#: In the order of the help text.
_OPTIONS = (
    click.option(
        "--model",
        type=click.Choice(["auto", *MODELS]),
        default="auto",
        show_default=True,
        help="Lens model; auto takes the cheapest that is good enough.",
    ),
    click.option(
        "--tolerance",
        default=TOLERANCE,
        show_default=True,
        help="Error that auto allows, pixels of the reconstructed view; above 0.",
    ),
    click.option(
        "--engine",
        type=click.Choice(ENGINES),
        default="fast",
        show_default=True,
        help="Who traces the rays through the lenslets; rtl shows what the FPGA would show.",
    ),
    click.option(
        "--fraction-bits",
        type=click.IntRange(FRACTIONS[0], FRACTIONS[-1]),
        help=f"Word length of the engines twin and rtl.  [default: {WIDEST}]",
    ),
    click.option("--samples", default=4, show_default=True, help="Samples for each pixel, 1 to 65536."),
    click.option(
        "--aperture",
        type=click.Choice(APERTURES),
        default="chief",
        show_default=True,
        help="Chief rays, or rays over the whole lenslet.",
    ),
    click.option(
        "--integrator",
        default="lights",
        show_default=True,
        help="lights, any of Mitsuba's (direct, path, ...), or scene for the file's own.",
    ),
    click.option("--max-depth", default=4, show_default=True, help="Surfaces that a ray may meet, 1 to 1000."),
    click.option("--memory-mb", type=float, help="Memory limit.  [default: four fifths of what is free]"),
)


def render_options(command: Command) -> Command:
    """Give a command the options."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def check_fraction_bits(engine: Engine, fraction_bits: int | None) -> None:
    """Refuse a word length for an engine that has none.

    Raises
    ------
    InputError
        Naming the engines that have one.
    """
    if fraction_bits is not None and engine in ("golden", "fast"):
        raise InputError(f"--fraction-bits belongs to the engines twin and rtl; leave it out with {engine}")
