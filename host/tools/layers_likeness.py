"""The eye's view of drawn layers, and of a streamed frame, against the full render (`tools.bench layers`)."""

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
from lippmann.layers.layer_choice import EYES, FULL_SAMPLES, decibels, eyes_of, full_views, row_of, streamed, views_of
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

#: Scenes, and the shapes that become a layer of their own, to move; displays.
SCENES: dict[str, tuple[str, str | None]] = {
    "fish": ("fish", None), "fish apart": ("fish", "fish-*"), "chart": ("chart", None),
}  # fmt: skip
DISPLAYS = ("vga-square", "vga-hex")
#: mm for each unit of the scenes: a quarter of their size, for these small displays.
SCALE = 0.25
#: Samples for each texel, as `lippmann layers` takes them; rays for each pixel of a view that tell what is seen there.
TEXEL_SAMPLES, SEEN_SAMPLES = 16, 16
#: Light from behind, as a share of a view's pixel, above which the pixel is a hole.
HOLE = 0.01
#: The serial line on which times are told, baud, and its bits for each byte.
BAUD, BITS_A_BYTE = 3_000_000, 10


def measure(folder: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Measure every scene on every display (see `measure_scene`)."""
    for display_name in DISPLAYS:
        display = load_display(folder / f"displays/{display_name}.toml")
        for name, (file, apart) in SCENES.items():
            path, place = folder / f"{file}/{file}.xml", Placement(SCALE)
            whole = load_scene(path, place)
            parts = [whole, None] if apart is None else [
                load_scene(path, place, part=Part(apart, kept)) for kept in (False, True)
            ]  # fmt: skip
            for row in measure_scene(whole, display, seed, parts=parts):
                yield {"display": display_name, "scene": name, **row}


def measure_scene(
    scene: Scene,
    display: Display,
    seed: int,
    counts: Iterable[int] = range(1, MAX_LAYERS + 1),
    slot: tuple[int, int] = SLOT,
    parts: Sequence[Scene | None] | None = None,
    settings: Settings | None = None,
) -> Iterator[dict[str, Any]]:
    """Measure a streamed frame of a scene, then its layers, by their number and filter.

    `parts` are what is cut by depths, and what becomes a layer of its own; None: the whole scene is cut.

    Columns: `drawn` ("streamed" or the filter), then as `lippmann.layers.layer_choice.row_of`; `line_bytes` on the
    line before the picture is there, and `frame_bytes` for each further one, in which one layer moves; `holes_percent`
    (`hole_percent`). Cells of a streamed frame that do not apply are None.
    """
    settings = Settings(TEXEL_SAMPLES, seed=seed) if settings is None else settings
    cut_by_depth, apart = (scene, None) if parts is None else parts
    assert cut_by_depth is not None
    full, lines = full_views(scene, display, settings), list(exit_lines(display))
    frame, seen = streamed(scene, display, full, settings)
    sent = tile_bytes(frame)
    nothing = dict.fromkeys(("load_bytes", "block_rams", "multipliers"))
    decibel = {"view_db": float(np.mean(seen)), "worst_db": min(seen)}
    yield {
        "drawn": "streamed", "layers": None, **decibel, **nothing, "line_bytes": sent, "frame_bytes": sent,
        "holes_percent": None,
    }  # fmt: skip
    # A layer that moves keeps its last word, its look.
    move = len(packed(Kind.WRITE, 0, ADDRESS.pack(0) + bytes(4 * (LAYER_WORDS - 1))))
    for count in counts:
        if count == 1 and apart is not None:
            continue
        cut = cut_scene(cut_by_depth, display, count, slot, settings, apart)
        if len(cut.stack.layers) < count:
            break  # the scene has no more depths
        for filter in FILTERS:
            seen = decibels(draw_golden(display, cut.stack, filter, lines=lines), display, full)
            yield {
                "drawn": filter, **row_of(cut, seen, slot, filter),
                "line_bytes": block_bytes(cut.stack, slot), "frame_bytes": move,
                "holes_percent": hole_percent(scene, cut, display, lines, filter, settings),
            }  # fmt: skip


def line_seconds(count: int) -> float:
    """Return the time, s, that so many bytes take on the line of `BAUD`."""
    return count * BITS_A_BYTE / BAUD


def tile_bytes(frame: Any) -> int:
    """Return the bytes on the line of the tiles of a frame (height, width, 3) uint8, each in its shortest coding."""
    grid = TileGrid(frame.shape[1], frame.shape[0])
    tiles = (code_tile(grid.cut(frame, tile)) for tile in range(grid.count))
    return sum(
        len(packed(Kind.TILE, 0, TILE_REQUEST.pack(0, number, tile.coding) + tile.data))
        for number, tile in enumerate(tiles)
    )


def block_bytes(stack: LayerStack, slot: tuple[int, int]) -> int:
    """Return the bytes on the line that load a stack's textures and palettes into slots of texels across and down."""
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
    """Return the share of the pixels of the moving eye's views, per cent, in which a hole shows.

    For each k: light from behind the first k layers shows, though every ray of the scene itself that the eye sees in
    the pixel and around it meets a surface of the first k slabs. Around: as far as layers move surfaces aside for the
    eye, and a pixel of the view blurs them. Of all layers with one apart, whose slabs overlap, only light from behind
    all layers counts.
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
            met = peel(scene, area, eye.position_mm, between, size, replace(settings, samples=SEEN_SAMPLES)).coverage
            solid = binary_erosion(met > 1.0 - 1e-6, np.ones((3, 3)), iterations=around, border_value=1)
            holes[place] |= solid & (view[..., 0] > HOLE)
    return 100.0 * float(holes.mean())


@measurement(page="layers")
def layers(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Measure the eye's view of drawn layers and of a streamed frame against the full render.

    Example: python -m tools.bench layers
    """
    rows = bench.collect(measure(bench.scenes, bench.seed))
    return {"layers": rows}, layers_page(bench.origin, rows)


def layers_page(origin: Mapping[str, str], rows: Rows) -> Page:
    """Return the page of `tools.bench layers`, of the rows of `measure`."""
    built, drawn = SceneBuild().layers, [row for row in rows if row["drawn"] != "streamed"]
    seen = [
        {**group[0], **{str(row["layers"]): f"{row['view_db']:.1f} ({row['worst_db']:.1f})" for row in group}}
        for group in groups(drawn, "display", "scene", "drawn")
    ]
    beside = []
    for row in where(rows, drawn="streamed"):
        cut = where(drawn, display=row["display"], scene=row["scene"], layers=built)
        decibels = {f"{one['drawn']}_db": one["view_db"] for one in cut}
        sent = {"sent_bytes": row["line_bytes"], "sent_seconds": line_seconds(row["line_bytes"])}
        beside.append({**row, **decibels, **sent, **{key: cut[0][key] for key in ("line_bytes", "frame_bytes")}})
        beside[-1]["line_seconds"] = line_seconds(cut[0]["line_bytes"])
    context = {
        "rows": drawn, "seen": seen, "beside": beside, "displays": DISPLAYS, "slot": SLOT, "built": built,
        "full_samples": FULL_SAMPLES, "baud": BAUD // 10**6,
    }  # fmt: skip
    return make_page("layers", origin, [draw_layers(rows)], {"layers": rows}, context)


def draw_layers(rows: Rows) -> Plot:
    """Draw the eye's view of layers over their number and block RAM, for each scene, and that of the streamed frame."""
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
