"""The placement of a scene in front of the display: scale, rotation, offset, and depths of interest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.toml import check_fields, documented, key
from lippmann.errors import InputError, warn_user
from lippmann.optics.system import exact_rotation
from lippmann.scenes.formats import Kind, kind_of, usual_rotation

Matrix = npt.NDArray[np.float64]
#: Number in the range in which float32 scenes and cubic paths are exact enough.
Number = Annotated[float, key("", low=-1e9, high=1e9)]
Triple = tuple[Number, Number, Number]
ORIGIN = (0.0, 0.0, 0.0)
#: "fit" scales and moves a scene into the depth range; "camera" uses the camera of the
#: scene's file; "fill" puts a picture into the panel's plane, as large as the panel.
Arrange = Literal["fit", "camera", "fill"]
SCALE_RANGE = (1e-9, 1e9)
Scale = Annotated[float, key("", low=SCALE_RANGE[0], high=SCALE_RANGE[1])]
Depth = Annotated[float | None, key("", default="the scene's bounding box")]


@documented
@dataclass(frozen=True)
class Placement:
    """A similarity transform from scene units to the display's frame (mm), and a depth range.

    Primary rays start at `near_mm`.
    """

    scale: Annotated[Scale, key("mm for each scene unit")] = 1.0
    rotation_deg: Annotated[Triple, key("rotation about x, then y, then z, after the scaling")] = ORIGIN
    offset_mm: Annotated[Triple, key("position of the scene's origin: x right, y up, z towards the viewer")] = ORIGIN
    near_mm: Annotated[Depth, key("depth z in front of every object of interest")] = None
    far_mm: Annotated[Depth, key("depth z of the farthest object of interest")] = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.near_mm is not None and self.far_mm is not None and self.near_mm <= self.far_mm:
            raise InputError(
                f"placement: near_mm {self.near_mm:g} is not in front of far_mm {self.far_mm:g}; +z is towards the eye"
            )

    def __str__(self) -> str:
        rotate, offset = (
            ",".join(f"{round(x, 9) + 0.0:.6g}" for x in triple) for triple in (self.rotation_deg, self.offset_mm)
        )
        return f"--scale {self.scale:.6g} --rotate {rotate} --offset {offset}"

    @property
    def display_from_scene(self) -> Matrix:
        """(4, 4) matrix from scene points to the display's frame."""
        rotation = np.eye(3)
        for axis, angle in enumerate(self.rotation_deg):
            c, s = exact_rotation(angle)
            k, m = (axis + 1) % 3, (axis + 2) % 3
            step = np.eye(3)
            step[k, k], step[k, m], step[m, k], step[m, m] = c, -s, s, c
            rotation = step @ rotation
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * rotation
        matrix[:3, 3] = self.offset_mm
        return matrix

    @property
    def scene_from_display(self) -> Matrix:
        """(4, 4) inverse of `display_from_scene`."""
        return np.asarray(np.linalg.inv(self.display_from_scene), np.float64)

    def keeping_depths(self, before: Placement) -> Placement:
        """Return this placement with the depths of an earlier placement, moved with the scene."""
        # If the scene is tilted in between, the bounding box gives the depths instead.
        step = self.display_from_scene @ before.scene_from_display
        if np.abs(step[2, :2]).max() > 1e-9 * step[2, 2]:
            return self
        near, far = (
            own if own is not None or depth is None else float(step[2, 2] * depth + step[2, 3])
            for own, depth in ((self.near_mm, before.near_mm), (self.far_mm, before.far_mm))
        )
        return replace(self, near_mm=near, far_mm=far)

    def then(self, other: Placement) -> Placement:
        """Return this placement followed by another placement, which also moves the depths."""
        placed = Placement.of(other.display_from_scene @ self.display_from_scene, self.scale * other.scale)
        return placed.keeping_depths(self)

    @classmethod
    def of(cls, matrix: Matrix, scale: float) -> Placement:
        """Return the placement that equals a (4, 4) matrix with this scale, without depths."""
        rotation = matrix[:3, :3] / scale
        # rotation = Rz Ry Rx.
        level = math.hypot(rotation[0, 0], rotation[1, 0])
        y = math.atan2(-rotation[2, 0], level)
        if level > 1e-9:
            x = math.atan2(rotation[2, 1], rotation[2, 2])
            z = math.atan2(rotation[1, 0], rotation[0, 0])
        else:
            x, z = math.atan2(-rotation[1, 2], rotation[1, 1]), 0.0
        shift = float(matrix[0, 3]), float(matrix[1, 3]), float(matrix[2, 3])
        return cls(scale, (math.degrees(x), math.degrees(y), math.degrees(z)), shift)


@dataclass(frozen=True)
class PlacementFile:
    """The file beside a scene; it may contain tables of other programs."""

    other_tables: ClassVar = True
    placement: Placement


def load_placement(path: Path) -> Placement:
    """Read `[placement]` of a TOML file; raises InputError with file, key and remedy."""
    return toml.read(PlacementFile, toml.load(path, "placement"), str(path)).placement


def placement_beside(path: Path) -> Placement:
    """Return the placement in NAME.toml beside a scene; by default 1 mm per unit and `usual_rotation`."""
    file = _placement_file(path)
    return Placement(rotation_deg=usual_rotation(path)) if file is None else load_placement(file)


def usual_arrange(path: Path) -> Arrange | None:
    """Return the default arrangement of another tool's scene without a placement; else None."""
    usual: dict[Kind | None, Arrange] = {"quilt": "fill", "views": "fill", "mesh": "fit", "splats": "fit"}
    usual["depth picture"] = "camera"
    return usual.get(kind_of(path)) if _placement_file(path) is None else None


def warn_if_unplaced(path: Path) -> None:
    """Warn of a scene that has neither a placement nor units."""
    if usual_arrange(path) is not None:
        what = "its units are taken as mm, its origin as the display's"
        warn_user(f"nothing places {path.name}: {what}; write {path.with_suffix('.toml').name}")


def _placement_file(path: Path) -> Path | None:
    """Return NAME.toml beside a scene, unless it describes only a film, display or depth picture."""
    file = path.with_suffix(".toml")
    keys = toml.load(file, "placement").keys() if file.exists() else {"panel"}
    return None if "placement" not in keys and {"depth_picture", "frames", "panel"} & keys else file
