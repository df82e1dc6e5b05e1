"""Command `lippmann inspect`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from lippmann.base import toml
from lippmann.base.images import check_output
from lippmann.base.tones import transfer_name
from lippmann.cli.frame import Choice, Name, argument, make_command, option
from lippmann.cli.options import Point
from lippmann.cli.output import emit
from lippmann.display.description import Display, load_display
from lippmann.optics.crosstalk_and_viewing_zone import Zone, viewing_distance
from lippmann.optics.display_properties import (
    DISTANCES,
    DisplayProperties,
    EyeView,
    axis_text,
    display_properties,
    eye_views,
    percent,
    table_of_views,
)

#: File extensions for --zones and --draw.
DRAWING_SUFFIXES = (".svg", ".png")
#: Module and class that declare each kind of TOML file, keyed by kind.
FILES = {
    "display": ("lippmann.display.description", "DisplayFile"),
    "setup": ("lippmann.capturing.capture_setup", "SetupFile"),
    "film": ("lippmann.motion.film", "FilmFile"),
    "layer_film": ("lippmann.motion.layer_film", "LayerFilmFile"),
    "placement": ("lippmann.scenes.placement", "PlacementFile"),
    "layers": ("lippmann.layers.layers_and_pictures", "LayersFile"),
    "pictures": ("lippmann.layers.layers_and_pictures", "PicturesFile"),
    "depth_picture": ("lippmann.scenes.depth_picture", "DepthPictureFile"),
}


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of TOML file (a key of `FILES`)."""
    module, declared = FILES[kind]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"Lippmann {kind} file"}
    return {**head, **toml.schema(getattr(import_module(module), declared))}


@make_command("inspect")
def command(
    display_path: Name | None = argument("DISPLAY.toml"),
    schema: str | None = option("Print the JSON Schema of this kind of TOML file.", kind=Choice(tuple(FILES))),
    eye: Point | None = option("Position of an eye, mm; also print its view's properties."),
    zones: Path | None = option("Draw the viewing zones, seen from above.", metavar="FILE.svg|.png"),
    draw: Path | None = option("Draw the panel and some lenslets.", metavar="FILE.svg|.png"),
) -> None:
    """Print a display's properties, warnings, and views from several distances.

    --schema prints a JSON Schema, with which editors check TOML files.

    Example: lippmann inspect scenes/displays/paper-square.toml
    """
    if schema:
        click.echo(json.dumps(schema_of(schema), indent=2))
        return
    if display_path is None:
        raise click.UsageError("Missing argument 'DISPLAY.toml'.")
    pictures = [check_output(path, DRAWING_SUFFIXES) for path in (zones, draw) if path]
    if len(set(pictures)) < len(pictures):
        raise click.UsageError("--zones and --draw name the same file; give two names")
    display = load_display(display_path)
    derived = display_properties(display)
    views = table_of_views(display)
    eye_view = None if eye is None else eye_views(display, [eye])[0]
    panel, array = display.panel, display.array
    result = {
        "name": display.name,
        "identity": display.identity,
        "panel": {**panel.keys, "width_mm": panel.width_mm, "height_mm": panel.height_mm},
        "array": array.keys,
        **{name: getattr(display, name) for name in ("gap_mm", "viewing_distance_mm", "viewing_axis_mm")},
        **asdict(derived),
        "distances": [_as_json(view) for view in views],
        "eye": eye_view and _as_json(eye_view),
    }
    if pictures:
        from lippmann.eye import display_drawing  # late import of the engines

        if zones:
            display_drawing.draw_zones(display, zones, eye)
        if draw:
            display_drawing.draw_display(display, draw)
    lines = [f"{name:<22}{value}" for name, value in _rows(display, derived, views[DISTANCES.index(1.0)].zone_mm)]
    if eye_view is not None:
        x, y, z = eye_view.eye_mm
        outside = "" if eye_view.sees_all else ": outside the zone, it sees crosstalk or dark lenslets somewhere"
        lines += ["", f"an eye at {x:g}, {y:g}, {z:g} mm{outside}", *_table(display, [eye_view])]
    lines += ["", "eyes in the middle", *_table(display, views)]
    emit(result, lines + [f"warning: {warning}" for warning in derived.warnings])


def _as_json(view: EyeView) -> dict[str, object]:
    return {**asdict(view), "zone_mm": view.zone_mm and view.zone_mm._asdict()}


def _table(display: Display, views: list[EyeView]) -> Iterator[str]:
    form = "{:>8}  {:<12}{:<17}{:<18}{:<12}{:<10}{}"
    yield form.format("z, mm", "crosstalk", "zone, mm", "depth, mm", "view step", "lenslet", "moire")
    for view in views:
        zone, (far, near), moire = view.zone_mm, view.depth_range_mm, view.moire_lenslets
        size = "none" if zone is None else f"{zone.right_mm - zone.left_mm:.4g} x {zone.top_mm - zone.bottom_mm:.4g}"
        share = view.status_share
        crosstalk = percent(share["crosstalk"], not view.sees_all) if share["ok"] or share["crosstalk"] else "dark"
        yield form.format(
            f"{view.eye_mm[2]:g}",
            crosstalk,
            size,
            f"{far:+.4g} to {near:+.4g}",
            f"{view.view_step_mm:.3g} mm",
            f"{view.lenslet_arcmin:.3g}'",
            "none" if moire is None else f"every {moire * display.array.pitches_mm[0]:.3g} mm",
        )


def _rows(display: Display, derived: DisplayProperties, zone: Zone | None) -> Iterator[tuple[str, str]]:
    panel, array = display.panel, display.array
    across, down, total = derived.lenslets
    plane, (far, near) = derived.central_depth_plane_mm, derived.depth_range_mm
    side = f"plano side to the {array.plano_side}"
    place = "at infinity" if math.isinf(plane) else f"z = {plane:+.5g} mm ({'in front' if plane > 0 else 'behind'})"
    yield "display", f"{display.name}, identity {display.identity}"
    yield "panel", f"{panel.width_px} x {panel.height_px} px, {panel.width_mm:.5g} x {panel.height_mm:.5g} mm"
    layout = panel.subpixels if isinstance(panel.subpixels, str) else f"by a table of {len(panel.subpixels)}"
    details = f"sub-pixels {layout}, {panel.bits} bits, {transfer_name(panel.transfer)}"
    pitch = " x ".join(f"{side:.6g}" for side in dict.fromkeys(panel.pitches_mm))
    yield "pixel pitch", f"{pitch} mm, {details}"
    if panel.white_cd_m2 is not None:
        black = "" if panel.black_cd_m2 is None else f", black {panel.black_cd_m2:g} cd/m2"
        contrast = f": contrast {1.0 / panel.black:.4g} : 1" if panel.black else ""
        yield "white", f"{panel.white_cd_m2:g} cd/m2{black}{contrast}"
    pitches = " x ".join(f"{pitch:g}" for pitch in dict.fromkeys(array.pitches_mm))
    rows = "" if isinstance(array.pitch_mm, float) else f", rows {array.row_pitch_mm:.6g} mm apart"
    shear = f", shear {array.shear:g}" if array.shear else ""
    yield "array", f"{array.grid}, pitch {pitches} mm{rows}{shear}, {side}, rotation {array.rotation_deg:g} deg"
    if array.extent_mm is not None:
        yield "extent", f"{array.extent_mm[0]:g} x {array.extent_mm[1]:g} mm; no light beside it"
    yield "gap", f"{display.gap_mm:.6g} mm"
    if display.viewing_distance_mm is not None:
        x, y = display.viewing_axis_mm
        yield "viewing distance", f"{display.viewing_distance_mm:g} mm, in front of ({x:g}, {y:g}) mm"
    yield "index", f"{derived.index:.6g}" + (f" ({array.glass})" if array.glass else "")
    yield "radius R", f"{derived.radius_mm:.6g} mm"
    yield "sag", f"{derived.sag_mm:.6g} mm"
    yield "flat-face distance d", f"{derived.flat_distance_mm:.6g} mm"
    yield "thickness", f"{derived.thickness_mm:.6g} mm"
    yield "focal length", f"{derived.focal_length_mm:.6g} mm (f/{derived.f_number:.3g})"
    yield "back focal length", f"{derived.back_focal_length_mm:.6g} mm from the near face"
    yield "aperture distance D", f"{derived.aperture_distance_mm:.6g} mm"
    alternate = "" if across * down == total else ", one fewer in every other row,"
    yield "lenslets", f"{across} x {down}{alternate} = {total}"
    yield "elemental image", f"{derived.elemental_image_px:.6g} px across"
    yield "viewing angle", f"{derived.viewing_angle_deg:.5g} deg"
    yield "crosstalk", f"beyond {derived.crosstalk_angle_deg:.4g} deg off {axis_text(display)}"
    ends = "none" if zone is None else f"x = {zone.left_mm:+.4g} to {zone.right_mm:+.4g} mm"
    yield "viewing zone", f"{ends}, for eyes at {viewing_distance(display):g} mm: the whole panel without crosstalk"
    yield "central depth plane", place
    yield "depth range", f"z = {far:+.4g} to {near:+.4g} mm"
    yield "angular resolution", f"{derived.angular_resolution_deg:.4g} deg ({derived.views} views across)"
    yield "spatial resolution", f"{derived.spatial_resolution_mm:g} mm"
