"""Defines the sensor plugin `integral`, with which Mitsuba renders a display's integral image.

Import this module after `mitsuba.set_variant`. The import registers the plugin for the
variant `llvm_ad_rgb` or `cuda_ad_rgb`. Call `register` after a change of the variant.
docs/reference/mitsuba-sensor.md lists the parameters.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from lippmann.base.variant import VARIANTS, current_device, dr, mi
from lippmann.display.description import Display, load_display
from lippmann.display.subpixels import layout_of
from lippmann.errors import input_error
from lippmann.optics.backend import Arr, DrJitBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import MODELS, Floats, Model
from lippmann.optics.sample_points import square_to_cell
from lippmann.rendering.sampling import APERTURES, lines_from_pixels

WHERE = "sensor 'integral'"
#: Maximum relative difference of `to_world`'s singular values, due to float32 rounding.
SAME_SCALE = 1e-4


def register() -> None:
    """Register the sensor for a vectorised RGB variant; raise InputError for other variants."""
    import mitsuba as mi

    if mi.variant() not in VARIANTS.values():
        what = f"the variant {mi.variant()} is not a vectorised RGB variant"
        raise input_error(WHERE, what, "call mitsuba.set_variant('llvm_ad_rgb') or 'cuda_ad_rgb' first")
    mi.register_sensor("integral", _sensor_class())


def _sensor_class() -> type:
    class IntegralSensor(mi.Sensor):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            path = props.get("display", "")
            if not path:
                raise input_error(WHERE, "display is missing", "give the path of a display file (.toml)")
            self.display = load_display(str(mi.file_resolver().resolve(path)))
            layout = layout_of(self.display.panel.subpixels)
            if layout is not None and layout.borrows:
                what = "pixels of this panel lack sub-pixels of a colour, which a Mitsuba film cannot express"
                raise input_error(WHERE, what, "use lippmann render, or a display with other subpixels")
            self.model = cast(Model, _choice("model", props.get("model", "exact"), MODELS))
            self.full = _choice("aperture", props.get("aperture", "chief"), APERTURES) == "full"
            self.near_mm = float(props.get("near_mm", 0.0))
            if not math.isfinite(self.near_mm):
                raise input_error(WHERE, f"near_mm is {self.near_mm}", "give a finite depth in mm")
            _check_pose(np.array(props.get("to_world", mi.ScalarTransform4f()).matrix, np.float64))
            self.m_needs_sample_2 = True
            self.m_needs_sample_3 = self.full

        def sample_ray(
            self, time: Arr, sample1: Arr, sample2: Arr, sample3: Arr, active: Arr = True
        ) -> tuple[Arr, Arr]:
            """Return rays and weights for points `sample2` of the film (0 to 1 from the top left)."""
            b = DrJitBackend(current_device())
            panel = self.display.panel
            u, v = b.double(sample2.x) * panel.width_px, b.double(sample2.y) * panel.height_px
            aperture = square_to_cell(b, sample3.x, sample3.y, Lattice.of(self.display.array)) if self.full else None
            point, direction, through, _ = lines_from_pixels(b, self.display, u, v, aperture, self.model)
            # Rays run in the viewing direction, from in front of the scene to the display.
            t = (self.near_mm - point[2]) / direction[2]
            start = mi.Point3f(point[0] + t * direction[0], point[1] + t * direction[1], mi.Float(self.near_mm))
            to_scene = self.world_transform()
            ray = mi.Ray3f(to_scene @ start, dr.normalize(to_scene @ mi.Vector3f(*(-c for c in direction))), time, [])
            weight = _subpixel_weight(b, self.display, u, v)
            return ray, mi.Spectrum(dr.select(through & active, weight, 0.0))

        def sample_ray_differential(
            self, time: Arr, sample1: Arr, sample2: Arr, sample3: Arr, active: Arr = True
        ) -> tuple[Arr, Arr]:
            """Return `sample_ray`'s rays without differentials: adjacent rays may pass different lenslets."""
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def bbox(self) -> Arr:
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            return f"IntegralSensor[display={self.display.name}, model={self.model}]"

    return IntegralSensor


def _subpixel_weight(b: DrJitBackend, display: Display, u: Arr, v: Arr) -> Arr:
    layout = layout_of(display.panel.subpixels)
    if layout is None:
        return mi.Color3f(1.0)
    weights = [mi.Float(0.0)] * 3
    for k, gain, inside in layout.emitters(b, u, v):
        if k < 3:
            weights[k] = weights[k] + dr.select(inside, mi.Float(gain), 0.0)
    return mi.Color3f(weights)


def _check_pose(to_world: Floats) -> None:
    if not np.isfinite(to_world).all():
        what = "to_world contains NaN or infinity"
        raise input_error(WHERE, what, "give a rotation, a translation and one scale")
    size = np.linalg.svd(to_world[:3, :3], compute_uv=False)
    if not size[0] - size[2] <= SAME_SCALE * size[0] or not size[2] > 0.0:
        what = "the scale of to_world is 0, or differs between directions"
        raise input_error(WHERE, what, "give one scale for all directions")
    if np.linalg.det(to_world[:3, :3]) < 0.0:
        raise input_error(WHERE, "to_world mirrors the display", "rotate the display instead")


def _choice(name: str, value: object, options: tuple[str, ...]) -> str:
    value = str(value)
    if value not in options:
        raise input_error(WHERE, f"unknown {name} '{value}'", f"choose from {', '.join(options)}")
    return value


register()
