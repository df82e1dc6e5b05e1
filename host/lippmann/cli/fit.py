"""`lippmann fit`: the cheapest model, samples and build of the RTL that meet a tolerance."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, Context

import click

from lippmann.cli.options.common import Finite, Vector, json_option
from lippmann.cli.output import emit
from lippmann.display import load_display
from lippmann.display_properties import display_properties
from lippmann.errors import input_error
from lippmann.select.build import MOST_SAMPLES, fit
from lippmann.select.model import TOLERANCE


@click.command("fit")
@click.argument("display_path", metavar="DISPLAY.toml")
@click.option(
    "--tolerance",
    type=Finite(),
    default=TOLERANCE,
    show_default=True,
    help="Largest error allowed, pixels of the reconstructed view; above 0.",
)
@click.option(
    "--depths", type=Vector(2, "FAR,NEAR"), help="The scene's range of z, mm.  [default: the display's own depth range]"
)
@json_option
def command(display_path: str, tolerance: float, depths: tuple[float, float] | None, as_json: bool) -> None:
    """Choose the cheapest lens model, number of samples and RTL build for a display's chief rays, with reasons.

    Example: lippmann fit scenes/displays/paper-square.toml --tolerance 0.25 --depths -40,30
    """
    display = load_display(display_path)
    far, near = depths or display_properties(display).depth_range_mm
    if not far <= near:
        raise input_error("--depths", f"{far:g} is nearer to the viewer than {near:g}", "give FAR,NEAR")
    chosen = fit(display, (far, near), tolerance)
    build = chosen.build
    result = {
        "display": display.name,
        "tolerance": tolerance,
        "depths_mm": [far, near],
        "model": chosen.choice.model,
        "model_errors": chosen.choice.error_px,
        "samples": chosen.samples,
        "sample_error": chosen.sample_error_px,
        "build": None if build is None else build.as_dict(),
        "build_error": chosen.build_error_px,
    }

    def text() -> None:
        click.echo(f"{display.name}, z = {far:.4g} to {near:.4g} mm; errors in pixels of the reconstructed view")
        click.echo(str(chosen.choice))
        if chosen.samples is None:
            enough = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(chosen.sample_error_px)
            click.echo(
                f"samples: {MOST_SAMPLES} a pixel, the most, are not enough for {tolerance:g} at these depths; "
                f"they are enough for --tolerance {enough:g}"
            )
        else:
            click.echo(
                f"samples {chosen.samples}: the fewest for each pixel whose rays pass within {tolerance:g} of all its "
                f"light (error {chosen.sample_error_px:.2g})"
            )
        if build is None and math.isinf(chosen.build_error_px):
            click.echo("RTL: no build can hold this display or give its rays")
        elif build is None:
            click.echo(f"RTL: no build is within {tolerance:g} (smallest error {chosen.build_error_px:.2g})")
        else:
            click.echo(
                f"RTL {build.model}, {build.grid}, F {build.fraction_bits}: the cheapest hardware and the shortest "
                f"words within {tolerance:g} (error {chosen.build_error_px:.2g})"
            )

    emit(result, as_json, text)
