"""Command `lippmann layers`."""

from __future__ import annotations

import csv
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from lippmann.base.files import replacing
from lippmann.base.images import check_output
from lippmann.base.variant import own_variant
from lippmann.cli.frame import Folder, Name, argument, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, FOLDER, SEED, TEXELS
from lippmann.cli.options_rendering import LIGHT, MOVED, Moved
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display
from lippmann.errors import InputError, LippmannWarning, input_error
from lippmann.fixed.scene_configuration import scene_words
from lippmann.layers.layer_costs import Row, measured_cuts, row_of
from lippmann.layers.layer_drawing import Filter, scene_build_of
from lippmann.layers.layers_and_pictures import (
    PICTURES_FILE,
    check_for_display,
    cut_pictures,
    is_layers,
    save_layers,
    warn_of_depths,
    warn_of_textures,
)
from lippmann.layers.scene_cutting import SLOT, Cut
from lippmann.layers.stack import MAX_LAYERS
from lippmann.rendering.options import Settings
from lippmann.scenes.scene import Part, Scene, check_scene_file, load_scene

#: Default number of layers.
COUNT = 4
#: Layer counts at which --costs measures PSNR.
MEASURED = (1, 2, 3, 4, 6, 8)


@make_command("layers")
def command(
    scene_path: Name = argument("SCENE"),
    display: Display = DISPLAY,
    output: Folder = FOLDER,
    count: int | None = option(f"Number of layers.  [default: {COUNT}]", kind=click.IntRange(1, MAX_LAYERS)),
    apart: str | None = option("Ids of shapes (wildcards `*`, `?`) to put into a separate movable layer."),
    slot: tuple[int, int] = option("Maximum size of a layer in texels.  [default: 256x192]", SLOT, TEXELS),
    samples: int = option("Samples per texel.", 16, click.IntRange(1, 4096)),
    filter: Filter = option("Texture filter for the printed hardware cost and PSNR.", "nearest"),
    costs: Path | None = option("Also write PSNR and costs for --count and fewer layers.", metavar="OUT.csv"),
    light: Settings = LIGHT,
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Convert a scene to flat layers that a board draws by itself.

    SCENE is a Mitsuba scene, or a folder with a pictures.toml, which lists pictures
    (with opacity) and their depths.

    Example: lippmann layers scenes/chart/chart.xml --display
    scenes/displays/vga-square.toml --scale 0.25 -o out/chart
    """
    table = None if costs is None else check_output(costs, (".csv",))
    cuts: list[tuple[Cut, list[float]]]
    if is_layers(scene_path, PICTURES_FILE):
        if moved.changes or apart is not None or table:
            raise InputError(f"{scene_path}: has fixed layers; leave out --apart, --costs and placement options")
        cut, names = cut_pictures(scene_path, display, slot)
        if count not in (None, len(names)):
            what = f"its {len(names)} pictures make {len(names)} layers, not {count}"
            raise input_error(scene_path, what, "leave out --count, or change the file")
        cuts = [(cut, [])]
    else:
        settings, path = replace(light, samples=samples), check_scene_file(scene_path)
        count = COUNT if count is None else count
        minimum = 1 if apart is None else 2
        counts = [k for k in MEASURED if table and minimum <= k < count] + [count]
        measured_filter = filter if table else None
        with progress_bar("layers") as progress, own_variant(device):
            placed = moved.load(path, display)
            parts = _split_parts(placed, apart)
            cuts = list(measured_cuts(placed, parts, display, counts, slot, settings, measured_filter, progress))
        cut = cuts[-1][0]
        names = tuple("apart" if k == cut.apart else f"layer_{k}" for k in range(len(cut.stack.layers)))
    check_for_display(cut.stack, display, scene_path)
    file = save_layers(output, cut.stack, names)
    rows = [row_of(one, decibels, slot, filter) for one, decibels in cuts]
    if table:
        _write_table(table, rows)
    depths = [(name, layer.depth_mm) for name, layer in zip(names, cut.stack.layers, strict=True)]
    warn_of_textures(cut.stack, names)
    warn_of_depths(depths, display)
    _warn_if_undrawable(cut, display, names)
    emit({"output": file, "layers": [*_json(cut, names)], "costs": rows}, _text(file, cut, names, rows), display)


def _split_parts(scene: Scene, apart: str | None) -> tuple[Scene, Scene | None]:
    if apart is None:
        return scene, None
    others = load_scene(scene.path, scene.placement, part=Part(apart, matching=False))
    return others, load_scene(scene.path, scene.placement, part=Part(apart))


def _write_table(path: Path, rows: list[Row]) -> None:
    with replacing(path) as partial, partial.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[-1])
        writer.writeheader()
        writer.writerows(rows)


def _json(cut: Cut, names: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    for name, layer, slab, palette_db in zip(names, cut.stack.layers, cut.slabs, cut.palette_db, strict=True):
        depths = {"depth_mm": layer.depth_mm, "front_mm": slab.front_mm, "back_mm": slab.back_mm}
        yield {"name": name, **depths, "width": layer.width, "height": layer.height, "palette_db": palette_db}


def _text(file: Path, cut: Cut, names: tuple[str, ...], rows: list[Row]) -> Iterator[str]:
    yield f"{file}: {_layers(len(names))}, front to back"
    for name, layer, palette_db in zip(names, cut.stack.layers, cut.palette_db, strict=True):
        where = "sky" if layer.sky else f"z = {layer.depth_mm:+.1f} mm"
        quality = "exact" if math.isinf(palette_db) else f"{palette_db:.1f} dB"
        yield f"{name:<16} {where:<14} {layer.width:>4} x {layer.height:<4} palette {quality}"
    for row in rows:
        view = f"the eye's view {row['view_db']:.1f} dB (at least {row['worst_db']:.1f}), " if "view_db" in row else ""
        cost = f"{row['load_bytes']} bytes, {row['block_rams']} block RAMs, {row['multipliers']} multipliers"
        yield f"{_layers(row['layers'])}: {view}{cost}"


def _warn_if_undrawable(cut: Cut, display: Display, names: tuple[str, ...]) -> None:
    try:
        scene_words(display, cut.stack, scene_build_of(cut.stack, "nearest", 1), names=names)
    except InputError as error:
        warnings.warn(f"no board can draw these layers: {error}", LippmannWarning, stacklevel=2)


def _layers(count: int) -> str:
    return f"{count} layer" + ("s" if count != 1 else "")
