"""The options of rendering, which several commands share."""

from __future__ import annotations

from lippmann.cli.frame import group, option
from lippmann.cli.options.common import FRACTION_BITS
from lippmann.fixed.words import WIDEST
from lippmann.optics.rays import Engine
from lippmann.rendering.integral import ModelOption, RenderOptions
from lippmann.rendering.renderer import Settings
from lippmann.rendering.sources import Aperture
from lippmann.select.model import TOLERANCE

SAMPLES = option("Samples for each pixel, 1 to 65536.", 4)
INTEGRATOR = option("lights, any of Mitsuba's (direct, path, ...), or scene for the file's own.", "lights")
MAX_DEPTH = option("Surfaces that a ray may meet, 1 to 1000.", 4)
MEMORY_MB = option("Memory limit.  [default: four fifths of the free memory]", None)


def _render_options(
    seed: int,
    model: ModelOption = option("Lens model; auto chooses the cheapest within the tolerance.", "auto"),
    tolerance: float = option("Error that auto allows, pixels of the reconstructed view; above 0.", TOLERANCE),
    engine: Engine = option("Traces the rays through the lenslets; rtl shows what the FPGA would show.", "fast"),
    fraction_bits: int | None = option(
        f"Word length of the engines twin and rtl.  [default: {WIDEST}]", None, FRACTION_BITS
    ),
    samples: int = SAMPLES,
    aperture: Aperture = option("Chief rays, or rays over the whole lenslet.", "chief"),
    integrator: str = INTEGRATOR,
    max_depth: int = MAX_DEPTH,
    memory_mb: float | None = MEMORY_MB,
) -> RenderOptions:
    settings = Settings(samples, aperture, integrator, max_depth, seed, memory_mb)
    return RenderOptions(model, tolerance, engine, fraction_bits, settings)


#: The options of a render; the command has --seed too.
RENDERING = group(_render_options)
