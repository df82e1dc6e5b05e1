"""Remarks on layers for a display: what will not be sharp, and what will not be seen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from lippmann.display.description import Display
from lippmann.layers.stack import LayerStack
from lippmann.optics.display_properties import depth_reach_mm

#: Texels across or down below which a layer is remarked upon.
FEW_TEXELS = 4


def texture_remarks(stack: LayerStack, names: Sequence[str]) -> Iterator[str]:
    """Yield a line for each layer of so few texels that its place is in doubt, and for each one without a picture."""
    for name, layer in zip(names, stack.layers, strict=True):
        if min(layer.width, layer.height) < FEW_TEXELS:
            size = f"{layer.width} x {layer.height} texels"
            yield f"note: layer '{name}' has {size} only: check the size and place of what it shows"
        if not layer.palette[layer.texels, 3].any():
            yield f"note: layer '{name}' is transparent all over: it shows nothing"


def depth_remarks(depths_mm: Iterable[tuple[str, float]], display: Display) -> Iterator[str]:
    """Yield a line with the layers that leave the display's depth range, and how far each one goes.

    `depths_mm` are (name, z), mm; of a layer that moves one for each place. A sky, at infinity, is meant to be far.
    """
    far, near = depth_reach_mm(display)
    worst: dict[str, float] = {}
    for name, depth in depths_mm:
        if not (far <= depth <= near or math.isinf(depth)):
            worst[name] = max(worst.get(name, 0.0), depth, key=abs)
    if worst:
        places = ", ".join(f"'{name}' ({depth:+.4g} mm)" for name, depth in worst.items())
        yield f"note: fine detail is lost in {places}: the display's depth range is z = {far:.4g} to {near:.4g} mm"
