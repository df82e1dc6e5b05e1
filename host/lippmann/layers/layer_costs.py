"""Computes the cost of layers and the PSNR of their views, and chooses the cheapest layers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base.images import Radiance
from lippmann.base.progress_protocol import Progress, report_each
from lippmann.base.tones import decode, psnr_db
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.fixed.scene_build import PALETTE_BYTES
from lippmann.layers.layer_drawing import FILTERS, Filter, draw_golden, exit_lines, panel_bytes
from lippmann.layers.scene_cutting import Cut, Reach, check_slot, cut_scene, reach_of
from lippmann.layers.stack import MAX_LAYERS, Bytes, Size
from lippmann.rendering.options import Settings
from lippmann.rendering.pixel_filter import MAX_SAMPLES
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.scene import Scene

#: Bytes of an ECP5's block RAM (DP16KD). A palette takes one block RAM.
BLOCK_RAM_BYTES = 2048
#: Bytes of the transfer curve's table for one colour.
CURVE_BYTES = 8192
#: Multipliers of each step in rtl/scene. The first layer needs no COMPOSITE.
EXIT_LINE, LAYER_COORDINATE, TEXEL_BLEND, COMPOSITE, BACKGROUND = 10, 6, 3, 4, 3
#: Positions of a moving eye, as fractions of `Reach.aside_mm`.
EYES = (-0.8, -0.4, 0.0, 0.4, 0.8)
#: Rays per pixel of the eye's view.
EYE_SAMPLES = 64
#: Samples per pixel of the full render; above MAX_SAMPLES, no pixel filter is used.
FULL_SAMPLES = MAX_SAMPLES + 1


@dataclass(frozen=True)
class Cost:
    """Cost of layers on a board: bytes to load, and hardware of an ECP5."""

    layers: int
    #: Bytes of texels and palettes, which the host sends once.
    load_bytes: int
    #: Block RAMs (DP16KD) for the transfer curve, one slot per layer, and a spare slot.
    block_rams: int
    #: Multipliers (MULT18X18D). Logic computes the cross terms of wide products.
    multipliers: int


def cost_of(layers: int, slot: Size, filter: Filter) -> Cost:
    """Return the cost of a number of layers; `slot` is the size of a slot in texels."""
    texels = slot[0] * slot[1]
    # The filter "bilinear" splits a slot into four banks, each with its own palette.
    banks = 4 if filter == "bilinear" else 1
    slot_rams = banks * (math.ceil(texels / banks / BLOCK_RAM_BYTES) + 1)
    block_rams = (layers + 1) * slot_rams + 3 * CURVE_BYTES // BLOCK_RAM_BYTES
    each = LAYER_COORDINATE + banks * TEXEL_BLEND
    multipliers = EXIT_LINE + BACKGROUND + layers * each + (layers - 1) * COMPOSITE
    return Cost(layers, layers * (texels + PALETTE_BYTES), block_rams, multipliers)


def eyes_of(reach: Reach) -> list[Eye]:
    """Return the positions `EYES` of an eye that moves from left to right."""
    x, y, z = reach.eye_mm
    return [Eye((x + share * reach.aside_mm, y, z)) for share in EYES]


def full_views(scene: Scene, display: Display, settings: Settings) -> list[Radiance]:
    """Return the moving eye's views of a full render with `FULL_SAMPLES`."""
    settings = replace(settings, samples=FULL_SAMPLES)
    return views_of(np.minimum(render_integral(scene, display, "exact", settings).radiance, 1.0), display)


def views_of(radiance: Radiance, display: Display) -> list[Radiance]:
    """Return a moving eye's views of a panel's radiance, with one pixel per lenslet."""
    window = whole_window(display)
    return [observe(radiance, display, eye, window, EYE_SAMPLES).radiance for eye in eyes_of(reach_of(display))]


def decibels(light: npt.NDArray[np.floating], display: Display, full: Sequence[Radiance]) -> list[float]:
    """Return the PSNR (dB) of the moving eye's views of a panel's light, compared with `full`."""
    views = views_of(light.astype(np.float32), display)
    return [psnr_db(view, reference) for view, reference in zip(views, full, strict=True)]


def streamed(scene: Scene, display: Display, full: Sequence[Radiance], settings: Settings) -> tuple[Bytes, list[float]]:
    """Return a frame (height, width, 3) as a host streams it, and the PSNR (dB) of the moving eye's views.

    The frame has one sample per pixel more than `full`, because renders that differ
    only in the seed share a part of their error.
    """
    again = replace(settings, samples=FULL_SAMPLES + 1, seed=(settings.seed + 1) % 2**32)
    frame = panel_bytes(display, render_integral(scene, display, "exact", again).radiance)
    return frame, decibels(decode(frame / np.float64(255.0), display.panel.transfer), display, full)


def measured_cuts(
    scene: Scene,
    parts: tuple[Scene, Scene | None],
    display: Display,
    counts: Sequence[int],
    slot: Size,
    settings: Settings,
    filter: Filter | None,
    progress: Progress | None,
) -> Iterator[tuple[Cut, list[float]]]:
    """For each number of layers, cut a scene; yield the cut and, if `filter` is set, its views' PSNR.

    `parts` are the arguments `scene` and `apart` of `cut_scene`.
    """
    full = [] if filter is None else full_views(scene, display, settings)
    for count in report_each(counts, progress):
        cut = cut_scene(parts[0], display, count, slot, settings, parts[1])
        yield cut, [] if filter is None else decibels(draw_golden(display, cut.stack, filter), display, full)


def row_of(cut: Cut, views_db: Sequence[float], slot: Size, filter: Filter) -> Row:
    """Return a cut's cost and its views' mean and minimum PSNR, if any, keyed by name."""
    cost = cost_of(len(cut.stack.layers), slot, filter)
    quality = {"view_db": float(np.mean(views_db)), "worst_db": min(views_db)} if views_db else {}
    return {"layers": cost.layers, **quality, **dataclasses.asdict(cost)}


TOLERANCE_DB = 25.0
#: Default sizes of slots, texels across and down.
SLOTS = ((64, 48), (128, 96), (256, 192), (512, 384))
#: Block RAMs of an ECP5-85, minus those of the rest of the design.
BLOCK_RAMS = 208 - 47
#: Multipliers of an ECP5-85, minus those of the optics (43 in the build compact-square)
#: and of the test patterns (14).
MULTIPLIERS = 156 - 57

Limit = Literal["render", "hardware", "depths", "sizes"]
#: Cost and PSNR of layers, keyed by name, and a candidate's filter and slot.
Row = dict[str, Any]


@dataclass(frozen=True)
class LayerChoice:
    """The cheapest layers within the tolerance, or the reason why no layers suffice."""

    cheapest: Row | None
    #: All candidates that were drawn, cheapest first.
    candidates: list[Row]
    #: Reason why the best candidate misses the tolerance.
    limit: Limit | None
    #: Minimum PSNR of a second full render's views, dB; None if layers suffice.
    render_db: float | None

    @property
    def best(self) -> Row:
        """The candidate whose worst view has the highest PSNR."""
        return max(self.candidates, key=lambda row: row["worst_db"])


def choose_layers(
    scene: Scene,
    display: Display,
    tolerance_db: float = TOLERANCE_DB,
    slots: Sequence[Size] = SLOTS,
    block_rams: int = BLOCK_RAMS,
    multipliers: int = MULTIPLIERS,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> LayerChoice:
    """Choose the cheapest layers of a placed scene that keep a moving eye's views within the tolerance.

    Costs are compared by block RAMs, then bytes, then multipliers. Raises InputError if
    the tolerance is not positive and finite, if one of `slots` fits no board, if a layer
    exceeds the hardware, or if no eye sees the scene.
    """
    if not 0.0 < tolerance_db < math.inf:
        raise InputError(f"tolerance {tolerance_db:g} dB is not positive and finite; give dB, such as {TOLERANCE_DB:g}")
    for slot in slots:
        check_slot(slot)
    settings = Settings(samples=16) if settings is None else settings

    affordable, dearer = _candidates(slots, block_rams, multipliers)
    full, lines = full_views(scene, display, settings), list(exit_lines(display))
    cut_into = cache(lambda count, slot: cut_scene(scene, display, count, slot, settings))
    rows, depths = list[Row](), MAX_LAYERS
    for cost, slot, filter in report_each(affordable, progress):
        if cost.layers > depths:
            continue
        cut = cut_into(cost.layers, slot)
        if len(cut.stack.layers) < cost.layers:
            depths = len(cut.stack.layers)  # more layers give the same cut
        else:
            views_db = decibels(draw_golden(display, cut.stack, filter, lines=lines), display, full)
            rows.append({"filter": filter, "slot": list(slot), **row_of(cut, views_db, slot, filter)})
            if min(views_db) >= tolerance_db:
                return LayerChoice(rows[-1], rows, None, None)
    render_db = min(streamed(scene, display, full, settings)[1])
    larger = any(cost.layers <= depths for cost, _, _ in dearer)
    limit: Limit = "hardware" if larger else "depths" if depths < MAX_LAYERS else "sizes"
    return LayerChoice(None, rows, "render" if render_db < tolerance_db else limit, render_db)


Candidate = tuple[Cost, Size, Filter]


def _candidates(slots: Sequence[Size], block_rams: int, multipliers: int) -> tuple[list[Candidate], list[Candidate]]:
    every = [
        (cost_of(count, slot, filter), slot, filter)
        for slot in dict.fromkeys(slots)
        for filter in FILTERS
        if filter == "nearest" or slot[1] % 2 == 0  # bilinear needs an even number of rows
        for count in range(1, MAX_LAYERS + 1)
    ]
    every.sort(key=lambda one: (one[0].block_rams, one[0].load_bytes, one[0].multipliers))
    affordable = [one for one in every if one[0].block_rams <= block_rams and one[0].multipliers <= multipliers]
    if not affordable:
        what = f"no layer fits {block_rams} block RAMs and {multipliers} multipliers"
        raise InputError(f"{what}; give {every[0][0].block_rams} block RAMs and {every[0][0].multipliers} multipliers")
    return affordable, [one for one in every if one not in affordable]
