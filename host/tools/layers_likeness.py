"""The eye's view of drawn layers, and of a streamed frame, against the full render (`tools.bench layers`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.board.drawn_scene import BLOCK_REQUEST, MOVE_WORDS
from lippmann.board.packets import Kind, packed
from lippmann.board.session import ADDRESS
from lippmann.board.streaming import TILE_REQUEST
from lippmann.board.tiles import TileGrid, code_tile
from lippmann.display.description import Display, load_display
from lippmann.eye.observer import whole_window
from lippmann.fixed.scene_build import BLOCK_BYTES, SceneBuild
from lippmann.fixed.scene_configuration import slot_bytes
from lippmann.layers.layer_choice import EYES, decibels, eyes_of, full_views, row_of, streamed, views_of
from lippmann.layers.layer_drawing import FILTERS, ExitLines, Filter, draw_golden, exit_lines
from lippmann.layers.scene_cutting import SLOT, Area, Cut, cut_scene, peel, reach_of
from lippmann.layers.slab_depths import disparity
from lippmann.layers.stack import MAX_LAYERS, LayerStack
from lippmann.optics.model_choice import reconstructed_pixel_mm
from lippmann.rendering.renderer import Settings
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Part, Scene, load_scene
from scipy.ndimage import binary_erosion

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
    move = len(packed(Kind.WRITE, 0, ADDRESS.pack(0) + bytes(4 * MOVE_WORDS)))
    for count in counts:
        if count == 1 and apart is not None:
            continue
        cut = cut_scene(cut_by_depth, display, count, slot, settings, apart)
        if len(cut.stack.layers) < count:
            break  # the scene has no more depths
        for filter in FILTERS:
            seen = decibels(cut.stack, display, full, filter, lines)
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
        light = draw_golden(display, LayerStack(tuple(black[:k]), np.ones(3)), filter, lines=lines).light
        views = views_of(light.astype(np.float32), display)
        between = front.front_mm, -math.inf if last else slab.back_mm
        for place, (eye, view) in enumerate(zip(eyes_of(reach), views, strict=True)):
            met = peel(scene, area, eye.position_mm, between, size, replace(settings, samples=SEEN_SAMPLES)).coverage
            solid = binary_erosion(met > 1.0 - 1e-6, np.ones((3, 3)), iterations=around, border_value=1)
            holes[place] |= solid & (view[..., 0] > HOLE)
    return 100.0 * float(holes.mean())
