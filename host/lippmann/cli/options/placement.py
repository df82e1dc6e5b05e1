"""The options that place a scene before the display."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from lippmann.cli.options.common import Command, Vector, together
from lippmann.rendering.placement import Placement
from lippmann.rendering.scene import placement_beside

_OPTIONS = together(
    click.option("--scale", type=float, help="mm for each scene unit."),
    click.option("--rotate", type=Vector(3), help="Degrees about x, then y, then z."),
    click.option("--offset", type=Vector(3), help="Position of the scene's origin, mm."),
    click.option("--depth", type=float, help="Moves the scene towards the viewer, mm."),
    click.option("--near", type=float, help="Depth z where primary rays start, mm."),
    click.option("--far", type=float, help="Farthest depth of interest, mm."),
)
_NAMES = ("scale", "rotate", "offset", "depth", "near", "far")


def placement_options(command: Command) -> Command:
    """Give a command the options, which it gets as `moved`: those that are given, by name (see `placement_of`)."""

    @functools.wraps(command)
    def with_placement(**values: Any) -> Any:
        moved = {name: values.pop(name) for name in _NAMES}
        return command(moved={name: value for name, value in moved.items() if value is not None}, **values)

    return _OPTIONS(with_placement)


def placement_of(scene_path: Path, moved: dict[str, Any]) -> Placement:
    """Return the placement beside the scene, changed by the options."""
    placement = placement_beside(scene_path)
    changed: dict[str, Any] = {}
    if not moved.keys().isdisjoint(("scale", "rotate", "offset", "depth")):
        # The depths in the file are valid for the file's own placement only.
        changed |= {"near_mm": None, "far_mm": None}
    names = {"scale": "scale", "rotate": "rotation_deg", "offset": "offset_mm", "near": "near_mm", "far": "far_mm"}
    changed |= {names[name]: value for name, value in moved.items() if name in names}
    if "depth" in moved:
        x, y, z = changed.get("offset_mm", placement.offset_mm)
        changed["offset_mm"] = (x, y, z + moved["depth"])
    return replace(placement, **changed)
