"""The options that place a scene before the display."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from lippmann.cli.frame import group, option
from lippmann.cli.options.common import Point, Vector
from lippmann.rendering.placement import Placement
from lippmann.rendering.scene import placement_beside


@dataclass(frozen=True)
class Moved:
    """The changes of a scene's placement that a command's options ask for."""

    scale: float | None = option("mm for each scene unit.", None)
    rotate: Point | None = option("Degrees about x, then y, then z.", None, Vector(3))
    offset: Point | None = option("Position of the scene's origin, mm.", None, Vector(3))
    depth: float | None = option("Moves the scene towards the viewer, mm.", None)
    near: float | None = option("Depth z where primary rays start, mm.", None)
    far: float | None = option("Farthest depth of interest, mm.", None)

    @property
    def given(self) -> dict[str, Any]:
        """The options that are given, by name."""
        return {field.name: value for field in fields(self) if (value := getattr(self, field.name)) is not None}

    def placement(self, scene_path: Path) -> Placement:
        """Return the placement beside the scene, changed by the options."""
        placement, given = placement_beside(scene_path), self.given
        changed: dict[str, Any] = {}
        if not given.keys().isdisjoint(("scale", "rotate", "offset", "depth")):
            # The depths in the file are valid for the file's own placement only.
            changed |= {"near_mm": None, "far_mm": None}
        names = {"scale": "scale", "rotate": "rotation_deg", "offset": "offset_mm", "near": "near_mm", "far": "far_mm"}
        changed |= {names[name]: value for name, value in given.items() if name in names}
        if self.depth is not None:
            x, y, z = self.offset or placement.offset_mm
            changed["offset_mm"] = (x, y, z + self.depth)
        return replace(placement, **changed)


#: The options of a scene's placement, as a `Moved`.
MOVED = group(Moved)
