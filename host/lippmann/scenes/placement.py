"""Defines a scene's placement at the display: scale, rotation, offset, and depths of interest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.toml import check_fields, documented, key
from lippmann.base.variant import mi
from lippmann.display.description import Display
from lippmann.errors import InputError, check_choice, input_error, warn_user
from lippmann.optics.crosstalk_and_viewing_zone import viewing_distance
from lippmann.optics.display_properties import display_properties
from lippmann.optics.system import exact_rotation
from lippmann.scenes.formats import Kind, kind_of, usual_rotation

if TYPE_CHECKING:
    from lippmann.scenes.scene import Scene

Matrix = npt.NDArray[np.float64]
#: Number in a range where float32 scenes and cubic paths are accurate enough.
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
        near, far = self.near_mm, self.far_mm
        if near is not None and far is not None and near <= far:
            what = f"near_mm {near:g} is not in front of far_mm {far:g}"
            raise input_error("placement", what, "raise near_mm: +z is towards the eye")

    def __str__(self) -> str:
        rotate, offset = (
            ",".join(f"{round(x, 9) + 0.0:.6g}" for x in triple) for triple in (self.rotation_deg, self.offset_mm)
        )
        return f"--scale {self.scale:.6g} --rotate {rotate} --offset {offset}"

    @property
    def display_from_scene(self) -> Matrix:
        """Matrix (4, 4) that maps scene points to the display's frame."""
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
        """Inverse (4, 4) of the matrix `display_from_scene`."""
        return np.asarray(np.linalg.inv(self.display_from_scene), np.float64)

    def keeping_depths(self, before: Placement) -> Placement:
        """Return this placement with missing depths from `before`, moved with the scene."""
        # After a tilt, missing depths stay None: the bounding box replaces them.
        step = self.display_from_scene @ before.scene_from_display
        if np.abs(step[2, :2]).max() > 1e-9 * step[2, 2]:
            return self
        near, far = (
            own if own is not None or depth is None else float(step[2, 2] * depth + step[2, 3])
            for own, depth in ((self.near_mm, before.near_mm), (self.far_mm, before.far_mm))
        )
        return replace(self, near_mm=near, far_mm=far)

    def then(self, other: Placement) -> Placement:
        """Return this placement combined with a later one, `other`, which also moves the depths."""
        placed = Placement.of(other.display_from_scene @ self.display_from_scene, self.scale * other.scale)
        return placed.keeping_depths(self)

    @classmethod
    def of(cls, matrix: Matrix, scale: float) -> Placement:
        """Return the placement for a (4, 4) matrix that contains `scale`; it has no depths."""
        rotation = matrix[:3, :3] / scale
        # The rotation is Rz Ry Rx: about x, then y, then z.
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
    """The TOML file beside a scene; it can contain tables of other programs."""

    other_tables: ClassVar = True
    placement: Placement


def load_placement(path: Path) -> Placement:
    """Read `[placement]` from a TOML file; raise InputError with file, key and remedy."""
    return toml.read(PlacementFile, toml.load(path, "placement"), str(path)).placement


def placement_beside(path: Path) -> Placement:
    """Return the placement in NAME.toml beside a scene, else 1 mm per unit with `usual_rotation`."""
    file = _placement_file(path)
    return Placement(rotation_deg=usual_rotation(path)) if file is None else load_placement(file)


def usual_arrange(path: Path) -> Arrange | None:
    """Return the default arrangement of an unplaced scene from another tool; else None."""
    usual: dict[Kind | None, Arrange] = {"quilt": "fill", "views": "fill", "mesh": "fit", "splats": "fit"}
    usual["depth picture"] = "camera"
    return usual.get(kind_of(path)) if _placement_file(path) is None else None


def warn_if_unplaced(path: Path) -> None:
    """Warn if a scene has neither a placement nor units."""
    if usual_arrange(path) is not None:
        what = "its units are read as mm, its origin as the display's"
        warn_user(f"{path.name} has no placement: {what}; write {path.with_suffix('.toml').name}")


def _placement_file(path: Path) -> Path | None:
    """Return NAME.toml beside a scene; None if it describes only a film, display or depth picture."""
    file = path.with_suffix(".toml")
    keys = toml.load(file, "placement").keys() if file.exists() else {"panel"}
    return None if "placement" not in keys and {"depth_picture", "frames", "panel"} & keys else file


def front_of(low: Matrix, high: Matrix) -> float:
    """Return a depth z just in front of a box, where rays can start."""
    return float(high[2] + 1e-3 * max(1.0, high[2] - low[2]))


def arranged(scene: Scene, display: Display, arrange: Arrange) -> Scene:
    """Return a scene placed for a display. Only "fit" keeps the scene's rotation."""
    check_choice("arrange", arrange, get_args(Arrange))
    if arrange == "camera":
        return scene.placed(_by_camera(scene, display))
    if arrange == "fill":
        return scene.placed(_filling(scene, display))
    rotated = Placement(rotation_deg=scene.placement.rotation_deg)
    low, high = scene.box(rotated)
    if not np.isfinite(high - low).all() or not (high > low).any():
        raise InputError(f"{scene.path}: the scene has no bounded extent to fit; place it with a scale and an offset")
    return scene.placed(rotated.then(fitting(low, high, display)))


def fitting(low: Matrix, high: Matrix, display: Display) -> Placement:
    """Return the placement that fits a box (mm) into a display's depth range, or raise InputError."""
    # An eye in front of the panel's centre must see all of the box's front.
    panel, eye = display.panel, viewing_distance(display)
    far, near = display_properties(display).depth_range_mm
    middle = 0.5 * (far + near)
    x, y, z = (float(side) for side in high - low)
    # The box's front, z = middle + scale z / 2, must be in the pyramid from eye to panel.
    widths = ((side, panel_side) for side, panel_side in ((x, panel.width_mm), (y, panel.height_mm)))
    scales = [full * (1.0 - middle / eye) / (side + 0.5 * full * z / eye) for side, full in widths if side + z > 0.0]
    scale = min([*scales, (near - far) / z] if z > 0.0 else scales)
    if not SCALE_RANGE[0] <= scale <= SCALE_RANGE[1]:
        sides, limits = f"{x:.3g} x {y:.3g} x {z:.3g}", "{:g} to {:g}".format(*SCALE_RANGE)
        raise InputError(f"a scene of {sides} units needs the scale {scale:.3g}, outside {limits}; resize its file")
    offset = -0.5 * scale * (low + high)
    return Placement(scale, offset_mm=(float(offset[0]), float(offset[1]), float(offset[2]) + middle))


def _filling(scene: Scene, display: Display) -> Placement:
    low, high = scene.box(Placement())
    panel, (far, near) = display.panel, display_properties(display).depth_range_mm
    width, height = (float(side) for side in (high - low)[:2])
    scale = min(panel.width_mm / width, panel.height_mm / height)
    x, y, z = (float(place) for place in -0.5 * scale * (low + high))
    return Placement(scale, offset_mm=(x, y, z), near_mm=near, far_mm=far)


def _by_camera(scene: Scene, display: Display) -> Placement:
    # The camera is at the eye, and its picture is as wide as the panel.
    sensor = scene.mitsuba.sensors()[0] if scene.has_camera else None
    parameters = {} if sensor is None else mi.traverse(sensor)
    if sensor is None or "x_fov" not in parameters:
        what = "contains no camera with a field of view"
        own = scene.path.suffix.lower() == ".xml"
        remedy = "place it with --fit, or with a scale and an offset"
        raise input_error(scene.path, what, f'add a <sensor type="perspective">, or {remedy}' if own else remedy)
    x_fov = math.radians(float(np.array(parameters["x_fov"]).ravel()[0]))
    matrix = np.array(sensor.world_transform().matrix, np.float64).reshape(4, 4)
    origin, ahead, up = matrix[:3, 3], *(matrix[:3, k] / np.linalg.norm(matrix[:3, k]) for k in (2, 1))
    # Put the panel at the first surface on the camera's axis, else at the box's centre.
    hit = scene.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(ahead)))
    distance = float(np.array(hit.t).ravel()[0])
    if not math.isfinite(distance):
        low, high = scene.box(Placement())
        distance = float((0.5 * (low + high) - origin) @ ahead)
    if not 0.0 < distance < math.inf:
        raise input_error(scene.path, "the camera does not look at the scene", "rotate the camera, or use --fit")
    eye = 0.5 * display.panel.width_mm / math.tan(0.5 * x_fov)
    scale = eye / distance
    moved = np.eye(4)
    moved[:3, :3] = scale * np.stack([np.cross(ahead, up), up, -ahead])
    moved[:3, 3] = -moved[:3, :3] @ (origin + distance * ahead)
    placement = Placement.of(moved, scale)
    # Rays do not start behind the camera, because objects there would hide the scene.
    return replace(placement, near_mm=min(front_of(*scene.box(placement)), eye))
