"""What layers cost in bytes and hardware, how near their views come to the full render's, and the cheapest that do."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base.images import Radiance
from lippmann.base.progress import Progress, report_each
from lippmann.base.toml import documented, key
from lippmann.base.tones import decode, psnr_db
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.fixed.scene_build import PALETTE_BYTES
from lippmann.layers.layer_drawing import FILTERS, Filter, draw_golden, exit_lines, panel_bytes
from lippmann.layers.scene_cutting import Cut, Reach, check_slot, cut_scene, reach_of
from lippmann.layers.stack import MAX_LAYERS
from lippmann.rendering.options import Settings
from lippmann.rendering.pixel_filter import MAX_SAMPLES
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.scene import Scene

#: Bytes of a block RAM of the ECP5 (DP16KD). A palette takes a whole one: it has half as many bytes, of 32-bit words.
BLOCK_RAM_BYTES = 2048
#: Bytes of the table of the panel's curve, of which each colour has a copy.
CURVE_BYTES = 8192
#: Multipliers of the steps of rtl/scene: of exit_line, of layer_coordinate, of texel_blend for each texel, of composite
#: for each layer behind the first, and of the background behind them.
EXIT_LINE, LAYER_COORDINATE, TEXEL_BLEND, COMPOSITE, BACKGROUND = 10, 6, 3, 4, 3
#: Places of a moving eye, as shares of the reach to each side, and rays for each pixel of its view.
EYES, EYE_SAMPLES = (-0.8, -0.4, 0.0, 0.4, 0.8), 64
#: Samples for each pixel of the full render: above `MAX_SAMPLES`, so that no pixel uses its neighbours'.
FULL_SAMPLES = MAX_SAMPLES + 1


@dataclass(frozen=True)
class Cost:
    """Bytes to load, and hardware of the drawing on an ECP5, of layers in slots."""

    layers: int
    #: Texels and palettes, sent once.
    load_bytes: int
    #: Block RAMs (DP16KD) of the build's slots, one more than layers, with their palettes and the panel's curve.
    block_rams: int
    #: Multipliers (MULT18X18D), with the cross terms of wide products in logic.
    multipliers: int


def cost_of(layers: int, slot: tuple[int, int], filter: Filter) -> Cost:
    """Return what a number of layers costs, each in a slot of texels across and down.

    A slot has one bank of texels, or for "bilinear" four, which have a quarter of them each; each bank has a palette of
    its own.
    """
    texels = slot[0] * slot[1]
    banks = 4 if filter == "bilinear" else 1
    one = banks * (math.ceil(texels / banks / BLOCK_RAM_BYTES) + 1)
    block_rams = (layers + 1) * one + 3 * CURVE_BYTES // BLOCK_RAM_BYTES
    multipliers = EXIT_LINE + BACKGROUND + layers * (LAYER_COORDINATE + banks * TEXEL_BLEND) + (layers - 1) * COMPOSITE
    return Cost(layers, layers * (texels + PALETTE_BYTES), block_rams, multipliers)


def eyes_of(reach: Reach) -> list[Eye]:
    """Return the places of an eye that moves from left to right as far as it sees the whole panel."""
    x, y, z = reach.eye_mm
    return [Eye((x + share * reach.aside_mm, y, z)) for share in EYES]


def full_views(scene: Scene, display: Display, settings: Settings) -> list[Radiance]:
    """Return the moving eye's views of a display that shows the full render of a scene, with `FULL_SAMPLES`."""
    settings = replace(settings, samples=FULL_SAMPLES)
    return views_of(np.minimum(render_integral(scene, display, "exact", settings).radiance, 1.0), display)


def views_of(radiance: Radiance, display: Display) -> list[Radiance]:
    """Return the moving eye's views of a display's panel that shows linear light, a pixel for each lenslet."""
    window = whole_window(display)
    return [observe(radiance, display, eye, window, EYE_SAMPLES).radiance for eye in eyes_of(reach_of(display))]


def decibels(light: npt.NDArray[np.floating], display: Display, full: Sequence[Radiance]) -> list[float]:
    """Return the PSNR (dB) of each view of the moving eye, of a panel's light, against the full render's."""
    views = views_of(light.astype(np.float32), display)
    return [psnr_db(view, reference) for view, reference in zip(views, full, strict=True)]


def streamed(
    scene: Scene, display: Display, full: Sequence[Radiance], settings: Settings
) -> tuple[npt.NDArray[np.uint8], list[float]]:
    """Return a frame (height, width, 3) as a host streams it, and the decibels of the moving eye's views of it.

    The frame is a full render of one sample more, because other seeds share a part of the error: its decibels are those
    of both renders' noise and the panel's bits.
    """
    again = replace(settings, samples=FULL_SAMPLES + 1, seed=(settings.seed + 1) % 2**32)
    frame = panel_bytes(display, render_integral(scene, display, "exact", again).radiance)
    return frame, decibels(decode(frame / np.float64(255.0), display.panel.transfer), display, full)


def measured_cuts(
    scene: Scene,
    parts: tuple[Scene, Scene | None],
    display: Display,
    counts: Sequence[int],
    slot: tuple[int, int],
    settings: Settings,
    filter: Filter | None = None,
    progress: Progress | None = None,
) -> Iterator[tuple[Cut, list[float]]]:
    """Yield the cut of a scene into each number of layers, and the decibels of the moving eye's views.

    `parts` are what is cut by depths, and what becomes a layer of its own, if anything (see `cut_scene`). Without a
    `filter` nothing is measured.
    """
    full = [] if filter is None else full_views(scene, display, settings)
    for count in report_each(counts, progress):
        cut = cut_scene(parts[0], display, count, slot, settings, parts[1])
        yield cut, [] if filter is None else decibels(draw_golden(display, cut.stack, filter), display, full)


def row_of(cut: Cut, views_db: Sequence[float], slot: tuple[int, int], filter: Filter) -> dict[str, Any]:
    """Return what a cut costs and is worth, by name: decibels of the eye's view, their mean and least, if measured."""
    cost = cost_of(len(cut.stack.layers), slot, filter)
    quality = {"view_db": float(np.mean(views_db)), "worst_db": min(views_db)} if views_db else {}
    return {"layers": cost.layers, **quality, **dataclasses.asdict(cost)}


#: Default tolerance, dB.
TOLERANCE_DB = 25.0
#: Slots that are tried, texels across and down.
SLOTS = ((64, 48), (128, 96), (256, 192), (512, 384))
#: Block RAMs and multipliers of an ECP5-85 that the board leaves with optics of the configuration compact-square, of
#: which 43 multipliers are the optics', 14 the patterns'.
BLOCK_RAMS, MULTIPLIERS = 208 - 47, 156 - 57

Limit = Literal["render", "hardware", "depths", "sizes"]
#: What layers cost and are worth, by name (`row_of`), and of those that were tried `filter` and `slot`.
Row = dict[str, Any]


@documented
@dataclass(frozen=True)
class LayerChoice:
    """The chosen layers; those that were tried, from the cheapest on, and if none suffices the reason."""

    chosen: Annotated[Row | None, key("the cheapest layers within the tolerance; None: none suffices")]
    tried: Annotated[list[Row], key("`filter`, `slot` and the cost of all that were drawn")]
    limit: Annotated[Limit | None, key("what keeps the best from the tolerance; None when one is chosen")]
    render_db: Annotated[
        float | None, key("worst view of a full render with other samples; None when layers are chosen")
    ]

    @property
    def best(self) -> Row:
        """The layers with the best view at the eye's worst place."""
        return max(self.tried, key=lambda row: row["worst_db"])


def choose_layers(
    scene: Scene,
    display: Display,
    tolerance_db: float = TOLERANCE_DB,
    slots: Sequence[tuple[int, int]] = SLOTS,
    block_rams: int = BLOCK_RAMS,
    multipliers: int = MULTIPLIERS,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> LayerChoice:
    """Choose the cheapest layers of a placed scene, and the build that draws them; `fit_layers` tells the parameters.

    Costs are block RAMs first, then bytes, then multipliers. From the cheapest on, layers are cut, drawn, and looked at
    by an eye that moves: the first ones whose view is within the tolerance at every place of the eye are chosen.

    Raises InputError for a tolerance that is not positive and finite, slots that no board has, too little hardware for
    a layer, and a scene of which no eye sees anything.
    """
    if not 0.0 < tolerance_db < math.inf:
        raise InputError(f"tolerance {tolerance_db:g} dB is not positive and finite; give dB, such as {TOLERANCE_DB:g}")
    for slot in slots:
        check_slot(slot)
    settings = Settings(samples=16) if settings is None else settings
    affordable, dearer = _candidates(slots, block_rams, multipliers)
    full, lines = full_views(scene, display, settings), list(exit_lines(display))
    cut_into = cache(lambda count, slot: cut_scene(scene, display, count, slot, settings))
    tried, depths = list[Row](), MAX_LAYERS
    for cost, slot, filter in report_each(affordable, progress):
        if cost.layers > depths:
            continue
        cut = cut_into(cost.layers, slot)
        if len(cut.stack.layers) < cost.layers:
            depths = len(cut.stack.layers)  # more layers than the scene has depths would be these again
        else:
            views_db = decibels(draw_golden(display, cut.stack, filter, lines=lines), display, full)
            tried.append({"filter": filter, "slot": list(slot), **row_of(cut, views_db, slot, filter)})
            if min(views_db) >= tolerance_db:
                return LayerChoice(tried[-1], tried, None, None)
    render_db = min(streamed(scene, display, full, settings)[1])
    larger = any(cost.layers <= depths for cost, _, _ in dearer)
    limit: Limit = "hardware" if larger else "depths" if depths < MAX_LAYERS else "sizes"
    return LayerChoice(None, tried, "render" if render_db < tolerance_db else limit, render_db)


Candidate = tuple[Cost, tuple[int, int], Filter]


def _candidates(
    slots: Sequence[tuple[int, int]], block_rams: int, multipliers: int
) -> tuple[list[Candidate], list[Candidate]]:
    """Return the layers and builds that take at most so many of both, the cheapest first, and those that take more."""
    every = [
        (cost_of(count, slot, filter), slot, filter)
        for slot in dict.fromkeys(slots)
        for filter in FILTERS
        if filter == "nearest" or slot[1] % 2 == 0  # the banks of bilinear take pairs of rows
        for count in range(1, MAX_LAYERS + 1)
    ]
    every.sort(key=lambda one: (one[0].block_rams, one[0].load_bytes, one[0].multipliers))
    affordable = [one for one in every if one[0].block_rams <= block_rams and one[0].multipliers <= multipliers]
    if not affordable:
        what = f"no layer fits {block_rams} block RAMs and {multipliers} multipliers"
        raise InputError(f"{what}; give at least {every[0][0].block_rams} and {every[0][0].multipliers}")
    return affordable, [one for one in every if one not in affordable]
