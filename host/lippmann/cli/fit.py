"""`lippmann fit`: the cheapest model, samples and build of the RTL that meet a tolerance."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, Context

from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import Finite, Vector
from lippmann.cli.output import emit
from lippmann.display import load_display
from lippmann.display_properties import display_properties
from lippmann.errors import input_error
from lippmann.select.build import MOST_SAMPLES, Fit, fit
from lippmann.select.model import TOLERANCE


@make_command("fit")
def command(
    display_path: str = argument("DISPLAY.toml"),
    tolerance: float = option(
        "Largest error, in pixels of the reconstructed view; greater than 0.", TOLERANCE, Finite()
    ),
    depths: tuple[float, float] | None = option(
        "The scene's range of z, mm.  [default: the display's own depth range]", None, Vector(2, "FAR,NEAR")
    ),
) -> None:
    """Choose the cheapest lens model, samples and RTL build.

    Their errors stay within --tolerance for the display's chief rays. The reasons are printed.

    Example: lippmann fit scenes/displays/paper-square.toml --tolerance 0.25 --depths -40,30
    """
    display = load_display(display_path)
    far, near = depths or display_properties(display).depth_range_mm
    if not far <= near:
        raise input_error("--depths", f"{far:g} is nearer to the viewer than {near:g}", "give FAR,NEAR")
    chosen = fit(display, (far, near), tolerance)
    build = None if chosen.build is None else chosen.build.as_dict()
    result = {
        "display": display.name, "tolerance": tolerance, "depths_mm": [far, near],
        "model": chosen.choice.model, "model_errors": chosen.choice.error_px,
        "samples": chosen.samples, "sample_error": chosen.sample_error_px,
        "build": build, "build_error": chosen.build_error_px,
    }  # fmt: skip
    head = f"{display.name}, z = {far:.4g} to {near:.4g} mm; errors in pixels of the reconstructed view"
    emit(result, (head, str(chosen.choice), _samples(chosen, tolerance), _build(chosen, tolerance)))


def _samples(chosen: Fit, tolerance: float) -> str:
    if chosen.samples is None:
        enough = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(chosen.sample_error_px)
        return (
            f"samples: {MOST_SAMPLES} a pixel, the most, are not enough for {tolerance:g} at these depths; "
            f"they are enough for --tolerance {enough:g}"
        )
    return (
        f"samples {chosen.samples}: the fewest per pixel; its light is at most {chosen.sample_error_px:.2g} from a ray "
        f"(tolerance {tolerance:g})"
    )


def _build(chosen: Fit, tolerance: float) -> str:
    build, error = chosen.build, chosen.build_error_px
    if build is None and math.isinf(error):
        return "RTL: no build can hold this display or give its rays"
    if build is None:
        return f"RTL: no build is within {tolerance:g} (smallest error {error:.2g})"
    kind = f"{build.model}, {build.grid}" + ", near eye" * build.converge
    return (
        f"RTL {kind}, F {build.fraction_bits}: the cheapest hardware and the shortest words within {tolerance:g} "
        f"(error {error:.2g})"
    )
