"""Compares eyes' views of drawn layers, and of a streamed frame, with a full render (`tools.bench layers`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.board.drawn_scene import BLOCK_REQUEST, LAYER_WORDS
from lippmann.board.packets import Kind, packed
from lippmann.board.session import ADDRESS
from lippmann.board.streaming import TILE_REQUEST
from lippmann.board.tiles import TileGrid, code_tile
from lippmann.conformance.figures import Rows, groups, where
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.display.description import Display, load_display
from lippmann.eye.observer import whole_window
from lippmann.fixed.scene_build import BLOCK_BYTES, SceneBuild
from lippmann.fixed.scene_configuration import slot_bytes
from lippmann.layers.layer_costs import EYES, FULL_SAMPLES, decibels, eyes_of, full_views, row_of, streamed, views_of
from lippmann.layers.layer_drawing import FILTERS, ExitLines, Filter, draw_golden, exit_lines
from lippmann.layers.scene_cutting import SLOT, Area, Cut, cut_scene, disparity, peel, reach_of
from lippmann.layers.stack import MAX_LAYERS, LayerStack
from lippmann.optics.model_choice import reconstructed_pixel_mm
from lippmann.rendering.options import Settings
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Part, Scene, load_scene
from scipy.ndimage import binary_erosion

from tools.bench import MeasurementRun, measurement
from tools.report_plots import draw_lines, make_page

#: Scenes, each with its file and the shapes that become a separate layer (None: no separate layer).
SCENES: dict[str, tuple[str, str | None]] = {
    "fish": ("fish", None), "fish apart": ("fish", "fish-*"), "chart": ("chart", None),
}  # fmt: skip
DISPLAYS = ("vga-square", "vga-hex")
#: Scale of the scenes on the small `DISPLAYS`, mm per unit.
SCALE = 0.25
#: Samples per texel, as in `lippmann layers`, and rays per pixel of a view.
TEXEL_SAMPLES, VIEW_SAMPLES = 16, 16
#: A view's pixel counts as a hole if a larger fraction of its light comes from behind the layers.
HOLE = 0.01
#: Baud rate of the serial line, and number of bits on the line per byte.
BAUD, BITS_A_BYTE = 3_000_000, 10


def measure(folder: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of every scene on every display (see `measure_scene`)."""
    for display_name in DISPLAYS:
        display = load_display(folder / f"displays/{display_name}.toml")
        for name, (file, apart) in SCENES.items():
            path, place = folder / f"{file}/{file}.xml", Placement(SCALE)
            parts = [Part(apart, is_apart) for is_apart in (False, True)] if apart is not None else []
            scene_parts = [load_scene(path, place, part=part) for part in parts]
            for row in measure_scene(load_scene(path, place), display, seed, parts=scene_parts or None):
                yield {"display": display_name, "scene": name, **row}


def measure_scene(
    scene: Scene,
    display: Display,
    seed: int,
    counts: Iterable[int] = range(1, MAX_LAYERS + 1),
    slot: tuple[int, int] = SLOT,
    parts: Sequence[Scene] | None = None,
    settings: Settings | None = None,
) -> Iterator[dict[str, Any]]:
    """Measure a streamed frame of a scene, then its layers for each number of layers and filter.

    `parts` (default: only the scene) contains the scene that is cut by depths, and a separate layer. `drawn` is
    "streamed" or a filter. The first picture takes `line_bytes` on the line; each further picture, in which a layer
    moves, takes `frame_bytes`. `lippmann.layers.layer_costs.row_of` describes the other columns; they are None for a
    streamed frame if they do not apply.
    """
    settings = Settings(TEXEL_SAMPLES, seed=seed) if settings is None else settings
    cut_by_depth, apart = (scene, None) if parts is None else parts
    full, lines = full_views(scene, display, settings), list(exit_lines(display))
    frame, views_db = streamed(scene, display, full, settings)
    size = tile_bytes(frame)
    yield {
        "drawn": "streamed", "layers": None, "view_db": float(np.mean(views_db)), "worst_db": min(views_db),
        **dict.fromkeys(("load_bytes", "block_rams", "multipliers")), "line_bytes": size, "frame_bytes": size,
        "holes_percent": None,
    }  # fmt: skip
    # A move does not write a layer's last word, which has brightness and visibility.
    move = len(packed(Kind.WRITE, 0, ADDRESS.pack(0) + bytes(4 * (LAYER_WORDS - 1))))
    for count in counts:
        if count == 1 and apart is not None:
            continue
        cut = cut_scene(cut_by_depth, display, count, slot, settings, apart)
        if len(cut.stack.layers) < count:
            # The scene cannot be cut into more layers.
            break
        for filter in FILTERS:
            views_db = decibels(draw_golden(display, cut.stack, filter, lines=lines), display, full)
            yield {
                "drawn": filter, **row_of(cut, views_db, slot, filter),
                "line_bytes": block_bytes(cut.stack, slot), "frame_bytes": move,
                "holes_percent": hole_percent(scene, cut, display, lines, filter, settings),
            }  # fmt: skip


def line_seconds(count: int) -> float:
    """Return the time, s, that `count` bytes take on a line at `BAUD`."""
    return count * BITS_A_BYTE / BAUD


def tile_bytes(frame: Any) -> int:
    """Return the number of bytes that stream a frame, (height, width, 3) uint8, each tile in its shortest coding."""
    grid = TileGrid(frame.shape[1], frame.shape[0])
    tiles = (code_tile(grid.cut(frame, tile)) for tile in range(grid.count))
    return sum(
        len(packed(Kind.TILE, 0, TILE_REQUEST.pack(0, number, tile.coding) + tile.data))
        for number, tile in enumerate(tiles)
    )


def block_bytes(stack: LayerStack, slot: tuple[int, int]) -> int:
    """Return the number of bytes that load the textures and palettes of a stack into slots."""
    build = SceneBuild(len(stack.layers), None, *slot)
    contents = (slot_bytes(layer, build).tobytes() for layer in stack.layers)
    return sum(
        len(packed(Kind.BLOCK, 0, BLOCK_REQUEST.pack(0, 0) + content[at : at + BLOCK_BYTES]))
        for content in contents
        for at in range(0, len(content), BLOCK_BYTES)
    )


def hole_percent(
    scene: Scene, cut: Cut, display: Display, lines: Sequence[ExitLines], filter: Filter, settings: Settings
) -> float:
    """Return the percentage of pixels that show a hole, over the views of a moving eye.

    A pixel shows a hole if light comes from behind the first k layers, although every ray through the pixel and
    its surroundings meets a surface in the scene's first k slabs. The surroundings extend as far as layers displace
    surfaces in the eye's view, plus one pixel. With a separate layer, whose slab overlaps others, only light from
    behind all layers shows a hole.
    """
    reach, window = reach_of(display), whole_window(display)
    half = 0.5 * window.width_mm, 0.5 * window.height_mm
    area = Area(0.0, -half[0], -half[1], *half)
    size, pixel_mm = (window.width_px, window.height_px), window.width_mm / window.width_px
    black = [replace(layer, palette=layer.palette * np.array([0, 0, 0, 1], np.uint8)) for layer in cut.stack.layers]
    eye_z, (front, *_) = reach.eye_mm[2], cut.slabs
    holes = np.zeros((len(EYES), window.height_px, window.width_px), np.bool_)
    aside_mm = blur_mm = 0.0
    for k, slab in enumerate(cut.slabs, 1):
        last = k == len(cut.slabs)
        if not last:
            u = disparity([slab.front_mm, slab.depth_mm, slab.back_mm], eye_z)
            aside_mm = max(aside_mm, float(np.abs(np.diff(u)).max()) * max(EYES) * reach.aside_mm)
            blur_mm = max(blur_mm, *(reconstructed_pixel_mm(display, z) for z in (slab.front_mm, slab.back_mm)))
        if cut.apart is not None and not last:
            continue
        around = max(size) if last else 1 + math.ceil((aside_mm + blur_mm) / pixel_mm)
        light = draw_golden(display, LayerStack(tuple(black[:k]), np.ones(3)), filter, lines=lines)
        views = views_of(light.astype(np.float32), display)
        between = front.front_mm, -math.inf if last else slab.back_mm
        for place, (eye, view) in enumerate(zip(eyes_of(reach), views, strict=True)):
            rays = replace(settings, samples=VIEW_SAMPLES)
            met = peel(scene, area, eye.position_mm, between, size, rays).coverage
            solid = binary_erosion(met > 1.0 - 1e-6, np.ones((3, 3)), iterations=around, border_value=1)
            holes[place] |= solid & (view[..., 0] > HOLE)
    return 100.0 * float(holes.mean())


@measurement(page="layers")
def layers(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Compare eyes' views of drawn layers, and of a streamed frame, with a full render.

    Example: python -m tools.bench layers
    """
    rows = bench.collect(measure(bench.scenes, bench.seed))
    return {"layers": rows}, layers_page(bench.origin, rows)


def layers_page(origin: Mapping[str, str], rows: Rows) -> Page:
    """Return the page of `tools.bench layers`."""
    built, drawn = SceneBuild().layers, [row for row in rows if row["drawn"] != "streamed"]
    views = [
        {**group[0], **{str(row["layers"]): f"{row['view_db']:.1f} ({row['worst_db']:.1f})" for row in group}}
        for group in groups(drawn, "display", "scene", "drawn")
    ]
    pairs = []
    for row in where(rows, drawn="streamed"):
        cut = where(drawn, display=row["display"], scene=row["scene"], layers=built)
        pair = {**row, **{f"{one['drawn']}_db": one["view_db"] for one in cut}}
        pair |= {"sent_bytes": row["line_bytes"], "sent_seconds": line_seconds(row["line_bytes"])}
        pair |= {key: cut[0][key] for key in ("line_bytes", "frame_bytes")}
        pairs.append({**pair, "line_seconds": line_seconds(cut[0]["line_bytes"])})
    context = {
        "rows": drawn, "seen": views, "beside": pairs, "displays": DISPLAYS, "slot": SLOT, "built": built,
        "full_samples": FULL_SAMPLES, "baud": BAUD // 10**6,
    }  # fmt: skip
    return make_page("layers", origin, [draw_layers(rows)], {"layers": rows}, context)


def draw_layers(rows: Rows) -> Plot:
    """Draw each scene's PSNR against the numbers of layers and of block RAMs, and the streamed frame's PSNR."""
    scenes = groups(rows, "scene")
    picture, axes = make_axes(2, len(scenes), (4.4, 3.2))
    for across, scene in enumerate(scenes):
        for axis, key, label in zip(axes[:, across], ("layers", "block_rams"), ("layers", "block RAMs"), strict=True):
            cuts = [{**row, "line": f"{row['display']}, {row['drawn']}"} for row in scene if row["drawn"] != "streamed"]
            draw_lines(axis, cuts, "line", key, "view_db")
            for row, colour in zip(where(scene, drawn="streamed"), COLOURS[::2], strict=False):
                axis.axhline(row["view_db"], linestyle="--", color=colour, label=f"{row['display']}, streamed")
            axis.get_legend().remove()
            axis.set(xlabel=label, ylabel="the eye's view, dB", title=scene[0]["scene"])
    picture.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return Plot("layers", finish_picture(picture))
