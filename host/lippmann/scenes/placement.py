"""Where a scene stands relative to the display: scale, rotation, offset, and the depths of interest."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.toml import check_fields, documented, key
from lippmann.errors import InputError, LippmannWarning
from lippmann.optics.system import exact_rotation
from lippmann.scenes.formats import Kind, kind_of, usual_rotation

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
        """Refuse what a file could not give, and a near depth that is not in front of the far one."""
        if isinstance(self.scale, Real) and not SCALE_RANGE[0] <= self.scale <= SCALE_RANGE[1]:
            raise InputError(
                f"placement: scale {self.scale:g} is out of range; give mm per scene unit, "
                f"{SCALE_RANGE[0]:g} to {SCALE_RANGE[1]:g}"
            )
        check_fields(self)
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
        near, far = (
            own if own is not None or depth is None else float(step[2, 2] * depth + step[2, 3])
            for own, depth in ((self.near_mm, before.near_mm), (self.far_mm, before.far_mm))
        )
        return replace(self, near_mm=near, far_mm=far)

    def then(self, other: Placement) -> Placement:
        """Return the placement that stands a scene by this one, then moves it, and its depths, by another."""
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
    file = _placement_file(path)
    return Placement(rotation_deg=usual_rotation(path)) if file is None else load_placement(file)


def usual_arrange(path: Path) -> Arrange | None:
    """Return how a display places another tool's scene without a placement beside it; None for all other scenes."""
    usual: dict[Kind | None, Arrange] = {
        "quilt": "fill",
        "views": "fill",
        "mesh": "fit",
        "splats": "fit",
        "depth picture": "camera",
    }
    return usual.get(kind_of(path)) if _placement_file(path) is None else None


def warn_if_unplaced(path: Path) -> None:
    """Warn of a scene that is placed by its units alone, though they mean nothing here."""
    if usual_arrange(path) is not None:
        what = "its units are taken as mm, its origin as the display's"
        text = f"nothing places {path.name}: {what}; write {path.with_suffix('.toml').name}"
        warnings.warn(text, LippmannWarning, stacklevel=2)


def _placement_file(path: Path) -> Path | None:
    """Return NAME.toml beside a scene if it places the scene, or should: a film or a display need no placement."""
    file = path.with_suffix(".toml")
    keys = toml.load(file, "placement").keys() if file.exists() else {"panel"}
    return None if "placement" not in keys and {"depth_picture", "frames", "panel"} & keys else file
