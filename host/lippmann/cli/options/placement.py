"""The options that say where a scene stands before the display: of `render` and of `view`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from lippmann.cli.options.common import Vector
from lippmann.rendering.placement import Placement
from lippmann.rendering.scene import placement_beside

Command = Callable[..., Any]
Triple = tuple[float, float, float]

#: In the order of the help text.
_OPTIONS = (
    click.option("--scale", type=float, help="mm for each scene unit."),
    click.option("--rotate", type=Vector(3), help="Degrees about x, then y, then z."),
    click.option("--offset", type=Vector(3), help="Where the scene's origin comes to stand, mm."),
    click.option("--depth", type=float, help="Moves the scene towards the viewer, mm."),
    click.option("--near", type=float, help="Depth z where primary rays start, mm."),
    click.option("--far", type=float, help="Farthest depth of interest, mm."),
)


def placement_options(command: Command) -> Command:
    """Give a command the options; it gets them by their names."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def placement_of(
    scene_path: str,
    scale: float | None = None,
    rotate: Triple | None = None,
    offset: Triple | None = None,
    depth: float | None = None,
    near: float | None = None,
    far: float | None = None,
) -> Placement:
    """Return the placement beside the scene with the options laid over it."""
    placement = placement_beside(Path(scene_path))
    moved = scale is not None or rotate is not None or offset is not None or depth is not None
    if moved:
        # The file's depths belong to the file's own stand.
        placement = replace(placement, near_mm=None, far_mm=None)
    if scale is not None:
        placement = replace(placement, scale=scale)
    if rotate is not None:
        placement = replace(placement, rotation_deg=rotate)
    if offset is not None:
        placement = replace(placement, offset_mm=offset)
    if depth is not None:
        x, y, z = placement.offset_mm
        placement = replace(placement, offset_mm=(x, y, z + depth))
    if near is not None:
        placement = replace(placement, near_mm=near)
    if far is not None:
        placement = replace(placement, far_mm=far)
    return placement
