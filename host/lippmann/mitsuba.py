"""Mitsuba's sensor plugin `integral`: a display's integral image from plain Mitsuba, XML and all.

Import this module after `mitsuba.set_variant`; it registers the plugin for the variant that is set, which must be one
for arrays (`llvm_ad_rgb`, `cuda_ad_rgb` and their like). Call `register` again after a change of variant.
Parameters: docs/reference/mitsuba-sensor.md.
"""

from __future__ import annotations

from typing import Any, cast

from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.trace import MODELS, Model
from lippmann.render.sampling import square_to_cell
from lippmann.render.sources import APERTURES, STRIPES, lines_from_pixels
from lippmann.render.variant import device_of

#: Devices whose variants the fast engine computes with.
DEVICES = ("llvm", "cuda")


def register() -> None:
    """Make the sensor `integral` known to Mitsuba for the variant that is set.

    Raises
    ------
    InputError
        When no variant is set, or one that traces single rays.
    """
    import mitsuba as mi

    if mi.variant() is None or device_of(mi) not in DEVICES:
        raise InputError(
            f"sensor 'integral': variant {mi.variant()} is none for arrays of rays; "
            "call mitsuba.set_variant('llvm_ad_rgb') or 'cuda_ad_rgb' before"
        )
    mi.register_sensor("integral", _sensor_class(mi))


def _sensor_class(mi: Any) -> Any:
    import drjit as dr

    class IntegralSensor(mi.Sensor):  # type: ignore[misc]
        """See docs/reference/mitsuba-sensor.md."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            path = props.get("display", "")
            if not path:
                raise InputError("sensor 'integral': no display; give the path of a display file (.toml)")
            self.display = load_display(str(mi.file_resolver().resolve(path)))
            self.model = cast(Model, _choice(props, "model", "exact", MODELS))
            self.full = _choice(props, "aperture", "chief", APERTURES) == "full"
            self.near_mm = float(props.get("near_mm", 0.0))
            self.m_needs_sample_2 = True
            self.m_needs_sample_3 = self.full

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """Return rays through points of the film (sample2, 0 to 1 from the top left) and their weights."""
            b = DrJitBackend(device_of(mi))
            panel, array = self.display.panel, self.display.array
            u, v = b.double(sample2.x) * panel.width_px, b.double(sample2.y) * panel.height_px
            weight = mi.Color3f(1.0)
            stripes = STRIPES[panel.subpixels]
            if stripes is not None:
                # A point of a pixel lies in one stripe and has its one colour, three times as bright.
                third = mi.Float(u - dr.floor(u)) - 0.5
                weight = mi.Color3f([dr.select(dr.abs(third - offset) <= 1.0 / 6.0, 3.0, 0.0) for offset in stripes])
            aperture = square_to_cell(mi, sample3.x, sample3.y, array.grid, array.pitch_mm) if self.full else None
            point, way, alive = lines_from_pixels(mi, b, self.display, u, v, aperture, self.model)
            # Towards the display, from in front of everything, as the viewer looks.
            t = (self.near_mm - point[2]) / way[2]
            start = mi.Point3f(point[0] + t * way[0], point[1] + t * way[1], mi.Float(self.near_mm))
            to_scene = self.world_transform()
            ray = mi.Ray3f(to_scene @ start, dr.normalize(to_scene @ mi.Vector3f(*(-c for c in way))), time, [])
            return ray, mi.Spectrum(dr.select(alive & active, weight, 0.0))

        def sample_ray_differential(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """Return the rays of `sample_ray`: neighbours leave by other lenslets, so there are no differentials."""
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def bbox(self) -> Any:
            """Return nothing: the sensor takes no room in the scene."""
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            """Name the display."""
            return f"IntegralSensor[display={self.display.name}, model={self.model}]"

    return IntegralSensor


def _choice(props: Any, name: str, default: str, options: tuple[str, ...]) -> str:
    value = str(props.get(name, default))
    if value not in options:
        raise InputError(f"sensor 'integral': {name} '{value}' is not known; choose from {', '.join(options)}")
    return value


__all__ = ["register"]

register()
