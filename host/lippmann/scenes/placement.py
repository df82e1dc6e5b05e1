"""Where a scene stands relative to the display: scale, rotation, offset, and the depths of interest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.errors import InputError, input_error
from lippmann.optics.panel_frame import exact_rotation
from lippmann.scenes.formats import kind_of, usual_rotation

Matrix = npt.NDArray[np.float64]
#: Lengths and angles that float32 scenes and the cubics of paths survive.
Number = Annotated[float, key("", low=-1e9, high=1e9)]
Triple = tuple[Number, Number, Number]
ORIGIN = (0.0, 0.0, 0.0)
#: "fit": the scene is scaled and moved into the depth range; "camera": placed as the camera in its file sees it;
#: "fill": a picture's plane becomes the panel's, as large as the panel.
Arrange = Literal["fit", "camera", "fill"]
#: Scales that float32 scenes survive.
SCALE_RANGE = (1e-9, 1e9)
Scale = Annotated[float, key("", low=SCALE_RANGE[0], high=SCALE_RANGE[1])]
Depth = Annotated[float | None, key("", default="the scene's bounding box")]


@documented
@dataclass(frozen=True)
class Placement:
    """A similarity from scene units to the display's frame (mm), and a depth range.

    Primary rays start at `near_mm`. A depth of None is that of the scene's bounding box.
    """

    scale: Annotated[Scale, key("mm for each scene unit")] = 1.0
    rotation_deg: Annotated[Triple, key("rotation about x, then y, then z, after the scaling")] = ORIGIN
    offset_mm: Annotated[Triple, key("position of the scene's origin: x right, y up, z towards the viewer")] = ORIGIN
    near_mm: Annotated[Depth, key("depth z in front of every object of interest")] = None
    far_mm: Annotated[Depth, key("depth z of the farthest object of interest")] = None

    def __post_init__(self) -> None:
        """Refuse what is not a similarity, naming the key; keep plain numbers."""
        for name in ("rotation_deg", "offset_mm"):
            given = getattr(self, name)
            triple = tuple(given) if isinstance(given, tuple | list | np.ndarray) else ()
            if len(triple) != 3:
                raise input_error(f"placement: {name}", f"{given!r} is not three numbers", "give (x, y, z)")
            object.__setattr__(self, name, tuple(_finite(name, value) for value in triple))
        for name in ("scale", "near_mm", "far_mm"):
            value = getattr(self, name)
            if name == "scale" or value is not None:
                object.__setattr__(self, name, _finite(name, value))
        if not SCALE_RANGE[0] <= self.scale <= SCALE_RANGE[1]:
            raise InputError(
                f"placement: scale {self.scale:g} is out of range; give mm per scene unit, "
                f"{SCALE_RANGE[0]:g} to {SCALE_RANGE[1]:g}"
            )
        if self.near_mm is not None and self.far_mm is not None and self.near_mm <= self.far_mm:
            raise InputError(
                f"placement: near_mm {self.near_mm:g} is not in front of far_mm {self.far_mm:g}; +z is towards the eye"
            )

    def __str__(self) -> str:
        """The options of a command that place a scene so."""
        rotate, offset = (
            ",".join(f"{round(x, 9) + 0.0:.6g}" for x in triple) for triple in (self.rotation_deg, self.offset_mm)
        )
        return f"--scale {self.scale:.6g} --rotate {rotate} --offset {offset}"

    @property
    def display_from_scene(self) -> Matrix:
        """(4, 4) matrix from scene points to the display's frame."""
        turn = np.eye(3)
        for axis, angle in enumerate(self.rotation_deg):
            c, s = exact_rotation(angle)
            k, m = (axis + 1) % 3, (axis + 2) % 3
            step = np.eye(3)
            step[k, k], step[k, m], step[m, k], step[m, m] = c, -s, s, c
            turn = step @ turn
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * turn
        matrix[:3, 3] = self.offset_mm
        return matrix

    @property
    def scene_from_display(self) -> Matrix:
        """(4, 4) inverse of `display_from_scene`."""
        return np.asarray(np.linalg.inv(self.display_from_scene), np.float64)

    def keeping_depths(self, before: Placement) -> Placement:
        """Return this placement with the depths of another one of the scene, moved as the scene is.

        A depth that this one has stays. A turn that tilts the scene leaves its bounding box to tell the depths.
        """
        step = self.display_from_scene @ before.scene_from_display
        if np.abs(step[2, :2]).max() > 1e-9 * step[2, 2]:
            return self

        def depth(own: float | None, moved: float | None) -> float | None:
            if own is None and moved is not None:
                return float(step[2, 2] * moved + step[2, 3])
            return own

        return replace(self, near_mm=depth(self.near_mm, before.near_mm), far_mm=depth(self.far_mm, before.far_mm))

    def then(self, other: Placement) -> Placement:
        """Return the placement that stands a scene by this one and then moves all of it by another.

        Its depths go with it (`keeping_depths`).
        """
        placed = Placement.of(other.display_from_scene @ self.display_from_scene, self.scale * other.scale)
        return placed.keeping_depths(self)

    @classmethod
    def of(cls, matrix: Matrix, scale: float) -> Placement:
        """Return the placement, without depths, of a (4, 4) matrix of this scale from scene points to the display."""
        turn = matrix[:3, :3] / scale
        # Turns about x, then y, then z: turn = Rz Ry Rx.
        level = math.hypot(turn[0, 0], turn[1, 0])
        about_y = math.atan2(-turn[2, 0], level)
        if level > 1e-9:
            about_x, about_z = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
        else:
            about_x, about_z = math.atan2(-turn[1, 2], turn[1, 1]), 0.0
        return cls(
            scale=scale,
            rotation_deg=(math.degrees(about_x), math.degrees(about_y), math.degrees(about_z)),
            offset_mm=(float(matrix[0, 3]), float(matrix[1, 3]), float(matrix[2, 3])),
        )


def _finite(name: str, value: object) -> float:
    """Return a number of a placement; refuse what is not finite or not a number."""
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise input_error(f"placement: {name}", f"{value!r} is not a finite number", "give one")
    return float(value)


@dataclass(frozen=True)
class PlacementFile:
    """The file beside a scene; other programs may keep tables of their own in it."""

    other_tables: ClassVar = True
    placement: Placement


def load_placement(path: Path) -> Placement:
    """Read the table `[placement]` of a TOML file and no other; InputError names file, key and remedy."""
    return toml.read(PlacementFile, toml.load(path, "placement"), str(path)).placement


def placement_beside(path: Path) -> Placement:
    """Return the placement in NAME.toml beside a scene; without that file, scene units are millimetres, and y is up."""
    beside = path.with_suffix(".toml")
    if beside.exists() and _is_placed(beside):
        return load_placement(beside)
    return Placement(rotation_deg=usual_rotation(path))


def usual_arrange(path: Path) -> Arrange | None:
    """Return how a scene is placed of which nothing tells it: another tool's, without a placement beside it."""
    beside = path.with_suffix(".toml")
    if beside.exists() and _is_placed(beside):
        return None
    kind = kind_of(path)
    if kind in ("quilt", "views"):
        return "fill"
    return {"mesh": "fit", "splats": "fit", "depth picture": "camera"}.get(str(kind))  # type: ignore[return-value]


def unplaced_note(path: Path) -> str | None:
    """Return what to tell of a scene that is placed by its units alone, though they mean nothing here."""
    if usual_arrange(path) is None:
        return None
    beside = path.with_suffix(".toml").name
    return f"note: nothing places {path.name}: its units are taken as mm, its origin as the display's; write {beside}"


def _is_placed(path: Path) -> bool:
    """Tell whether a TOML file has a placement, or should: a picture with depths, a film or a display need none."""
    told = toml.load(path, "placement")
    return "placement" in told or not {"depth_picture", "frames", "panel"} & told.keys()
