"""`lippmann inspect`: what follows from a display file."""

from __future__ import annotations

import dataclasses
import json
import math
from importlib import import_module
from typing import Any

import click

from lippmann.cli.options.common import json_option
from lippmann.cli.output import emit
from lippmann.display import load_display
from lippmann.display_properties import VIEWING_DISTANCE_MM, display_properties
from lippmann.toml import schema

#: Kind of TOML file -> module and class that declare it.
FILES = {
    "display": ("lippmann.display", "DisplayFile"),
    "setup": ("lippmann.capturing.setup", "SetupFile"),
    "film": ("lippmann.film.film", "FilmFile"),
    "placement": ("lippmann.rendering.placement", "PlacementFile"),
}


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of TOML file (a name of `FILES`)."""
    module, declared = FILES[kind]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"Lippmann {kind} file"}
    return {**head, **schema(getattr(import_module(module), declared))}


@click.command("inspect")
@click.argument("display_path", metavar="DISPLAY.toml", required=False)
@click.option("--schema", "kind", type=click.Choice(tuple(FILES)), help="Print the JSON Schema of a kind of TOML file.")
@json_option
def command(display_path: str | None, kind: str | None, as_json: bool) -> None:
    """Print the numbers that follow from a display file, with units and warnings.

    With --schema no display is read: an editor checks TOML files against what is printed.

    Example: lippmann inspect scenes/displays/paper-square.toml
    """
    if kind is not None:
        click.echo(json.dumps(schema_of(kind), indent=2))
        return
    if display_path is None:
        raise click.UsageError("Missing argument 'DISPLAY.toml'.")
    display = load_display(display_path)
    derived = display_properties(display)
    panel, array = display.panel, display.array
    result = {
        "name": display.name,
        "identity": display.identity,
        "panel": {
            **dataclasses.asdict(panel),
            "width_mm": panel.width_mm,
            "height_mm": panel.height_mm,
        },
        "array": dataclasses.asdict(array),
        "gap_mm": display.gap_mm,
        **dataclasses.asdict(derived),
    }

    def text() -> None:
        across, down, total = derived.lenslets
        plane = derived.central_depth_plane_mm
        rows = [
            ("display", f"{display.name}, identity {display.identity}"),
            (
                "panel",
                f"{panel.width_px} x {panel.height_px} px, {panel.width_mm:.5g} x {panel.height_mm:.5g} mm",
            ),
            (
                "pixel pitch",
                f"{panel.pixel_pitch_mm:.6g} mm, sub-pixels {panel.subpixels}, {panel.bits} bits, {panel.transfer}",
            ),
            (
                "array",
                f"{array.grid}, pitch {array.pitch_mm:g} mm, plano side to the {array.plano_side}, "
                f"rotation {array.rotation_deg:g} deg",
            ),
            ("gap", f"{display.gap_mm:.6g} mm"),
            ("index", f"{derived.index:.6g}" + (f" ({array.glass})" if array.glass else "")),
            ("radius R", f"{derived.radius_mm:.6g} mm"),
            ("sag", f"{derived.sag_mm:.6g} mm"),
            ("flat-face distance d", f"{derived.flat_distance_mm:.6g} mm"),
            ("thickness", f"{derived.thickness_mm:.6g} mm"),
            ("focal length", f"{derived.focal_length_mm:.6g} mm (f/{derived.f_number:.3g})"),
            ("back focal length", f"{derived.back_focal_length_mm:.6g} mm from the near face"),
            ("aperture distance D", f"{derived.aperture_distance_mm:.6g} mm"),
            ("lenslets", f"{across} x {down} = {total}"),
            ("elemental image", f"{derived.elemental_image_px:.6g} px across"),
            ("viewing angle", f"{derived.viewing_angle_deg:.5g} deg"),
            ("crosstalk", f"beyond {derived.crosstalk_angle_deg:.4g} deg off a lenslet's axis"),
            (
                "viewing zone",
                f"eyes at {VIEWING_DISTANCE_MM:g} mm see the whole panel without crosstalk within "
                f"{derived.viewing_zone_mm:.3g} mm of the axis",
            ),
            (
                "central depth plane",
                "at infinity"
                if math.isinf(plane)
                else f"z = {plane:+.5g} mm ({'in front' if plane > 0 else 'behind'})",
            ),
            (
                "depth range",
                f"z = {derived.depth_range_mm[0]:+.4g} to {derived.depth_range_mm[1]:+.4g} mm",
            ),
            (
                "angular resolution",
                f"{derived.angular_resolution_deg:.4g} deg ({derived.views} views across)",
            ),
            ("spatial resolution", f"{derived.spatial_resolution_mm:g} mm"),
        ]
        for name, value in rows:
            click.echo(f"{name:<22}{value}")
        for warning in derived.warnings:
            click.echo(f"warning: {warning}")

    emit(result, as_json, text)
