"""The path of a captured ray, traced against the light: camera or sensor, array, imaging lens, object.

**One frame from the camera to the lens.** x is right and y up as the camera sees them, z runs from the camera to the
lens. This frame is left-handed; lenslets and lenses are symmetric, so their formulas hold in it. The display's own
`leave_panel` traces the array, with the camera or sensor in place of the panel.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from lippmann.base.variant import mitsuba
from lippmann.capturing.setup import Pickup, Setup
from lippmann.optics.backend import Arr, Backend, DrJitBackend
from lippmann.optics.faces import Ray
from lippmann.optics.lattice import Lattice
from lippmann.optics.models import leave_panel
from lippmann.optics.rays import gets_through
from lippmann.optics.sampling import square_to_cell
from lippmann.optics.system import System
from lippmann.rendering.sources import Aperture, Lines, RaySource, owner_number


class CapturedRays(NamedTuple):
    """Rays in the object's frame towards the scene, and which passed the array and the lens."""

    ray: Ray
    through_array: Arr
    through_lens: Arr


def system_of(setup: Setup) -> System:
    """Return the array's optics during the capture; the pixels are the display's, and so are their lenslets."""
    convergence = System.of(setup.display).convergence
    return replace(System.of(setup.captured), concave=setup.concave, convergence=convergence)


def rays_from_picture(
    b: Backend, setup: Setup, u: Arr, v: Arr, aperture: tuple[Arr, Arr] | None = None
) -> CapturedRays:
    """Trace rays from the image's pixel coordinates u, v (double) to the object space.

    `aperture` is for a pickup: the points of the lenslets' apertures that rays pass, from the lenslet's centre, mm,
    array's axes; None for the centres. A camera's pinhole determines them.
    """
    system = system_of(setup)
    frame = system.frame
    if isinstance(setup.pickup, Pickup):
        i, j, x, y = system.locate(b, u, v)
    else:
        # The camera sees this point of the array's first principal plane, where the aperture points lie; the pinhole
        # is on the axis, at the distance L. Its picture is as large as the display's elemental images ask for.
        seen = system.convergence.towards_eye(*frame.array_from_panel(*frame.panel_from_pixel(u, v)))
        i, j, x, y = system.lattice.locate(b, *seen)
        px, py = frame.panel_from_array(*seen)
        to_camera = setup.camera_distance_mm
        assert to_camera is not None
        back = system.aperture_distance_mm / to_camera
        axis_x, axis_y = frame.turn_back(px, py)
        aperture = (x, y)
        x, y = x - axis_x * back, y - axis_y * back
    out = leave_panel(b, system, x, y, aperture, "exact")
    own = i, j
    i, j = i + b.double(out.di), j + b.double(out.dj)
    status = system.through_mount(b, out.status, (i, j), own)
    cx, cy = system.lattice.centre(i, j)
    px, py = frame.panel_from_array(cx + b.double(out.ray.x), cy + b.double(out.ray.y))
    dx, dy = frame.turn(out.ray.dx, out.ray.dy)
    # From the plane of the array's vertices through the imaging lens to the object's frame, in the engine's own format.
    ray = Ray(b.real(px), b.real(py), out.ray.z, dx, dy, out.ray.dz)
    lens = setup.lens
    object_z = setup.subject.distance_mm
    passed = ray.dz > 0.0
    if lens is not None:
        # A lost ray may have any direction; it is set along the axis.
        ray = ray._replace(z=ray.z - setup.array_distance_mm, dz=b.where(passed, ray.dz, 1.0))
        ray, inside = lens.trace(b, ray)
        passed = passed & inside
        object_z = object_z + lens.hiatus_mm
    return CapturedRays(ray._replace(z=object_z - ray.z, dz=-ray.dz), gets_through(status), passed)


def capture_source(setup: Setup, aperture: Aperture = "chief") -> RaySource:
    """Return the rays of a captured image, in the object's frame; `aperture` is for a pickup.

    The reasons for a loss are the lens, and the array.
    """
    panel, array = setup.display.panel, setup.array

    def lines(b: DrJitBackend, u: Any, v: Any, square: tuple[Any, Any]) -> Lines:
        mi = mitsuba()
        aims = None
        if aperture == "full" and isinstance(setup.pickup, Pickup):
            x, y = square_to_cell(b, *square, Lattice.of(array))
            aims = (b.double(x), b.double(y))
        ray, through_array, through_lens = rays_from_picture(b, setup, u, v, aims)
        point = (mi.Float(ray.x), mi.Float(ray.y), mi.Float(ray.z))
        direction = (mi.Float(-ray.dx), mi.Float(-ray.dy), mi.Float(-ray.dz))
        return Lines(
            point, direction, through_array & through_lens, (through_array & ~through_lens, mi.Bool(~through_array))
        )

    def owner(b: DrJitBackend, u: Any, v: Any) -> Any:
        return owner_number(*system_of(setup).locate(b, u, v)[:2])

    return RaySource(panel.width_px, panel.height_px, lines, detail_mm=array.finest_mm, owner=owner)
