"""Places a scene for a display: into its depth range, or as the scene's own camera sees it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np

from lippmann.base.variant import mitsuba
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.optics.display_properties import display_properties
from lippmann.optics.zones import viewing_distance
from lippmann.scenes.placement import SCALE_RANGE, Arrange, Matrix, Placement
from lippmann.scenes.scene import Scene, front_of


def arranged(scene: Scene, display: Display, arrange: Arrange) -> Scene:
    """Return a scene, placed for a display. "fit" keeps the rotation of the scene's own placement, "camera" nothing.

    Raises InputError for another arrangement, a scene without extent, or without a camera that can place it.
    """
    if arrange not in get_args(Arrange):
        raise input_error("arrange", f"'{arrange}' is unknown", f"choose from {', '.join(get_args(Arrange))}")
    if arrange == "camera":
        return scene.placed(_by_camera(scene, display))
    if arrange == "fill":
        return scene.placed(_filling(scene, display))
    rotated = Placement(rotation_deg=scene.placement.rotation_deg)
    low, high = scene.box(rotated)
    if not np.isfinite(high - low).all() or not (high > low).any():
        raise InputError(f"{scene.path}: the scene has no bounded extent to fit; place it with --scale and --offset")
    return scene.placed(rotated.then(fitting(low, high, display)))


def fitting(low: Matrix, high: Matrix, display: Display) -> Placement:
    """Return the placement that scales a box (corners (3,), mm) and moves it to the middle of a display's depth range.

    The box becomes as large as depth range and view allow: an eye in front of the panel's middle sees its whole front.
    Raises InputError for a box too small or large for any scale.
    """
    panel, eye = display.panel, viewing_distance(display)
    far, near = display_properties(display).depth_range_mm
    middle = 0.5 * (far + near)
    x, y, z = (float(side) for side in high - low)
    # The box's front, at the depth middle + scale z / 2, must lie in the pyramid from the eye to the panel's sides.
    widths = ((side, panel_side) for side, panel_side in ((x, panel.width_mm), (y, panel.height_mm)))
    scales = [full * (1.0 - middle / eye) / (side + 0.5 * full * z / eye) for side, full in widths if side + z > 0.0]
    scale = min([*scales, (near - far) / z] if z > 0.0 else scales)
    if not SCALE_RANGE[0] <= scale <= SCALE_RANGE[1]:
        sides = " x ".join(f"{side:.3g}" for side in (x, y, z))
        raise InputError(f"the scene is {sides} units, and cannot be fitted by a scale of {scale:.3g}; scale its file")
    offset = -0.5 * scale * (low + high)
    return Placement(scale, offset_mm=(float(offset[0]), float(offset[1]), float(offset[2]) + middle))


def _filling(scene: Scene, display: Display) -> Placement:
    """Return the placement of a flat scene that fills the panel, and is seen through it over the whole depth range."""
    low, high = scene.box(Placement())
    panel, (far, near) = display.panel, display_properties(display).depth_range_mm
    width, height = (float(side) for side in (high - low)[:2])
    scale = min(panel.width_mm / width, panel.height_mm / height)
    x, y, z = (float(place) for place in -0.5 * scale * (low + high))
    return Placement(scale, offset_mm=(x, y, z), near_mm=near, far_mm=far)


def _by_camera(scene: Scene, display: Display) -> Placement:
    """Return the placement with the eye where the scene's camera is, and the panel as wide as the camera's picture.

    The panel's middle is on the first surface on the camera's axis; without one, at the depth of the scene's middle.
    """
    mi = mitsuba()
    sensor = scene.mitsuba.sensors()[0] if scene.has_camera else None
    parameters = {} if sensor is None else mi.traverse(sensor)
    if sensor is None or "x_fov" not in parameters:
        what = "contains no camera with a field of view"
        own = scene.path.suffix.lower() == ".xml"
        remedy = "place it with --fit, --scale and --offset"
        raise input_error(str(scene.path), what, f'add a <sensor type="perspective">, or {remedy}' if own else remedy)
    x_fov = math.radians(float(np.array(parameters["x_fov"]).ravel()[0]))
    matrix = np.array(sensor.world_transform().matrix, np.float64).reshape(4, 4)
    origin, ahead, up = matrix[:3, 3], *(matrix[:3, k] / np.linalg.norm(matrix[:3, k]) for k in (2, 1))
    hit = scene.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(ahead)))
    distance = float(np.array(hit.t).ravel()[0])
    if not math.isfinite(distance):
        low, high = scene.box(Placement())
        distance = float((0.5 * (low + high) - origin) @ ahead)
    if not 0.0 < distance < math.inf:
        raise input_error(str(scene.path), "the camera does not look at the scene", "turn the camera, or use --fit")
    eye = 0.5 * display.panel.width_mm / math.tan(0.5 * x_fov)
    scale = eye / distance
    moved = np.eye(4)
    moved[:3, :3] = scale * np.stack([np.cross(ahead, up), up, -ahead])
    moved[:3, 3] = -moved[:3, :3] @ (origin + distance * ahead)
    placement = Placement.of(moved, scale)
    # Primary rays do not start behind the camera: objects there would hide everything.
    return replace(placement, near_mm=min(front_of(*scene.box(placement)), eye))
