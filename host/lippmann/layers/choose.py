"""`fit`: the cheapest layers of a scene, and build of the drawing, whose views stay within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from lippmann.base.progress import Progress
from lippmann.base.toml import documented, key
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.layers.cost import Cost, cost_of, decibels, full_views, row_of, streamed
from lippmann.layers.cut import Cut, check_slot, cut_scene
from lippmann.layers.drawing import FILTERS, Filter, exit_lines
from lippmann.layers.stack import MAX_LAYERS
from lippmann.rendering.renderer import Settings
from lippmann.scenes.scene import Scene

#: Default tolerance, dB.
TOLERANCE_DB = 25.0
#: Slots that are tried, texels across and down.
SLOTS = ((64, 48), (128, 96), (256, 192), (512, 384))
#: Block RAMs and multipliers of an ECP5-85 that the board leaves with optics of the configuration compact-square, of
#: which 43 multipliers are the optics', 14 the patterns'.
BLOCK_RAMS, MULTIPLIERS = 208 - 47, 156 - 57

Limit = Literal["render", "hardware", "depths", "sizes"]


@documented
@dataclass(frozen=True)
class LayerChoice:
    """The chosen layers; those that were tried, from the cheapest on, and if none suffices the reason."""

    chosen: Annotated[dict[str, Any] | None, key("the cheapest layers within the tolerance; None: none suffices")]
    tried: Annotated[list[dict[str, Any]], key("`filter`, `slot` and the cost of all that were drawn")]
    limit: Annotated[Limit | None, key("what keeps the best from the tolerance; None when one is chosen")]
    render_db: Annotated[
        float | None, key("worst view of a full render with other samples; None when layers are chosen")
    ]

    @property
    def best(self) -> dict[str, Any]:
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
    """Choose the cheapest layers of a placed scene, and the build that draws them.

    Costs are block RAMs first, then bytes, then multipliers. From the cheapest on, layers are cut, drawn, and looked at
    by an eye that moves: the first ones whose view is within the tolerance at every place of the eye are chosen.

    Parameters
    ----------
    scene, display
        The scene, placed, and the display.
    tolerance_db
        Least PSNR, dB, of the drawn layers' view against the full render's.
    slots
        Sizes of slots that are tried, texels across and down.
    block_rams, multipliers
        Most of each (DP16KD, MULT18X18D) that the drawing may take.
    settings
        How each texel is rendered: samples, integrator, seed.
    progress
        Called with (builds tried, builds in all).

    Raises
    ------
    InputError
        For a tolerance that is not positive and finite, slots that no board has, too little hardware for a layer, and a
        scene of which no eye sees anything.
    """
    if not 0.0 < tolerance_db < math.inf:
        raise InputError(f"tolerance {tolerance_db:g} dB is not positive and finite; give dB, such as {TOLERANCE_DB:g}")
    for slot in slots:
        check_slot(slot)
    settings = Settings(samples=16) if settings is None else settings
    every = sorted(_candidates(slots), key=lambda one: (one[0].block_rams, one[0].load_bytes, one[0].multipliers))
    fitting = [one for one in every if one[0].block_rams <= block_rams and one[0].multipliers <= multipliers]
    if not fitting:
        what = f"no layer fits {block_rams} block RAMs and {multipliers} multipliers"
        raise InputError(f"{what}; give at least {every[0][0].block_rams} and {every[0][0].multipliers}")
    full, lines = full_views(scene, display, settings), list(exit_lines(display))
    cuts: dict[tuple[int, tuple[int, int]], Cut] = {}
    tried: list[dict[str, Any]] = []
    depths = MAX_LAYERS
    for number, (cost, slot, filter) in enumerate(fitting, 1):
        if cost.layers <= depths:
            place = cost.layers, slot
            cut = cuts[place] = cuts.get(place) or cut_scene(scene, display, cost.layers, slot, settings)
            depths = min(depths, len(cut.stack.layers)) if len(cut.stack.layers) < cost.layers else depths
        if cost.layers <= depths:  # more layers than the scene has depths would be these again
            seen = decibels(cut.stack, display, full, filter, lines)
            tried.append({"filter": filter, "slot": list(slot), **row_of(cut, seen, slot, filter)})
            if min(seen) >= tolerance_db:
                return LayerChoice(tried[-1], tried, None, None)
        if progress is not None:
            progress(number, len(fitting))
    render_db = min(streamed(scene, display, full, settings)[1])
    larger = any(one not in fitting and one[0].layers <= depths for one in every)
    limit: Limit = "hardware" if larger else "depths" if depths < MAX_LAYERS else "sizes"
    return LayerChoice(None, tried, "render" if render_db < tolerance_db else limit, render_db)


def _candidates(slots: Sequence[tuple[int, int]]) -> Iterator[tuple[Cost, tuple[int, int], Filter]]:
    for slot in dict.fromkeys(slots):
        for filter in FILTERS:
            if filter == "nearest" or slot[1] % 2 == 0:  # the banks of bilinear take pairs of rows
                for count in range(1, MAX_LAYERS + 1):
                    yield cost_of(count, slot, filter), slot, filter
