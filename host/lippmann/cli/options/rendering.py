"""The options of rendering, which several commands share."""

from __future__ import annotations

import functools
from typing import Any

import click

from lippmann.cli.options.common import Command, fraction_bits_option, together
from lippmann.optics.rays import ENGINES
from lippmann.rendering.integral import MODEL_OPTIONS, RenderOptions
from lippmann.rendering.renderer import Settings
from lippmann.rendering.sources import APERTURES
from lippmann.select.model import TOLERANCE

_SAMPLES = click.option("--samples", default=4, show_default=True, help="Samples for each pixel, 1 to 65536.")
_INTEGRATOR = (
    click.option(
        "--integrator", default="lights", show_default=True,
        help="lights, any of Mitsuba's (direct, path, ...), or scene for the file's own.",
    ),
    click.option("--max-depth", default=4, show_default=True, help="Surfaces that a ray may meet, 1 to 1000."),
    click.option("--memory-mb", type=float, help="Memory limit.  [default: four fifths of the free memory]"),
)  # fmt: skip
_RENDER = together(
    click.option(
        "--model", type=click.Choice(MODEL_OPTIONS), default="auto", show_default=True,
        help="Lens model; auto chooses the cheapest within the tolerance.",
    ),
    click.option(
        "--tolerance", default=TOLERANCE, show_default=True,
        help="Error that auto allows, pixels of the reconstructed view; above 0.",
    ),
    click.option(
        "--engine", type=click.Choice(ENGINES), default="fast", show_default=True,
        help="Traces the rays through the lenslets; rtl shows what the FPGA would show.",
    ),
    fraction_bits_option("the engines twin and rtl", None),
    _SAMPLES,
    click.option(
        "--aperture", type=click.Choice(APERTURES), default="chief", show_default=True,
        help="Chief rays, or rays over the whole lenslet.",
    ),
    *_INTEGRATOR,
)  # fmt: skip
#: The options of a capture, which a command gets by their names.
capture_options = together(
    _SAMPLES,
    click.option(
        "--aperture",
        type=click.Choice(APERTURES),
        help="For a pickup: rays over the whole lenslet, or chief rays.  [default: full]",
    ),
    *_INTEGRATOR,
)


def render_options(command: Command) -> Command:
    """Give a command the options of a render, which it gets as `options`, a `RenderOptions`; it must have --seed."""

    @functools.wraps(command)
    def with_options(
        *, model: Any, tolerance: float, engine: Any, fraction_bits: int | None, samples: int, aperture: Any,
        integrator: str, max_depth: int, memory_mb: float | None, seed: int, **others: Any,
    ) -> Any:  # fmt: skip
        settings = Settings(samples, aperture, integrator, max_depth, seed, memory_mb)
        return command(options=RenderOptions(model, tolerance, engine, fraction_bits, settings), **others)

    return _RENDER(with_options)
