"""The path of a captured ray, traced against the light: camera or sensor, array, imaging lens, object.

**One frame from the camera to the lens.** x is right and y up as the camera sees them, z runs from the camera to the
lens. This mirrors a right-handed frame, which changes nothing for lenslets and lenses. So the display's own
`leave_panel` traces the array, with the camera or sensor in place of the panel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from lippmann.capturing.setup import Pickup, Setup
from lippmann.optics.aim import Ray
from lippmann.optics.backend import Arr, Backend, DrJitBackend
from lippmann.optics.models import leave_panel
from lippmann.optics.rays import gets_through
from lippmann.optics.sampling import points_in_square, square_to_cell
from lippmann.optics.system import System
from lippmann.rendering.sources import Aperture, Lines
from lippmann.variant import mitsuba


class CapturedRays(NamedTuple):
    """Rays in the object's frame (double) towards the scene, and which passed the array and the lens."""

    ray: Ray
    through_array: Arr
    through_lens: Arr


def system_of(setup: Setup) -> System:
    """Return the array's optics during the capture."""
    return replace(System.of(setup.captured), concave=setup.concave)


def rays_from_picture(
    b: Backend, setup: Setup, u: Arr, v: Arr, aperture: tuple[Arr, Arr] | None = None
) -> CapturedRays:
    """Trace rays from the image's pixels to the object space.

    Parameters
    ----------
    b
        Backend.
    setup
        The set-up.
    u, v
        Pixel coordinates, double; see docs/reference/optics.md.
    aperture
        For a pickup: the points of the lenslets' apertures that rays pass, from the lenslet's centre, mm, array's axes;
        None for the centres. A camera's pinhole determines them.
    """
    system = system_of(setup)
    frame = system.frame
    px, py = frame.panel_from_pixel(u, v)
    i, j, x, y = system.lattice.locate(b, *frame.array_from_panel(px, py))
    if not isinstance(setup.pickup, Pickup):
        # The camera sees this point of the array's first principal plane, where the aperture points lie; the pinhole
        # is on the axis, at the distance L.
        to_camera = setup.camera_distance_mm
        assert to_camera is not None
        back = system.aperture_distance_mm / to_camera
        axis_x, axis_y = frame.turn_back(px, py)
        aperture = (x, y)
        x, y = x - axis_x * back, y - axis_y * back
    out = leave_panel(b, system, x, y, aperture, "exact")
    cx, cy = system.lattice.centre(i + b.double(out.di), j + b.double(out.dj))
    px, py = frame.panel_from_array(cx + b.double(out.ray.x), cy + b.double(out.ray.y))
    dx, dy = frame.turn(b.double(out.ray.dx), b.double(out.ray.dy))
    through = gets_through(out.status)
    return _through_lens(b, setup, Ray(px, py, b.double(out.ray.z), dx, dy, b.double(out.ray.dz)), through)


def _through_lens(b: Backend, setup: Setup, ray: Ray, through_array: Arr) -> CapturedRays:
    """Trace rays, given from the plane of the array's vertices, through the imaging lens to the object's frame."""
    lens = setup.lens
    object_z = setup.subject.distance_mm
    passed = ray.dz > 0.0
    if lens is not None:
        # A lost ray may have any direction; it is set along the axis.
        ray = ray._replace(z=ray.z - setup.array_distance_mm, dz=b.where(passed, ray.dz, 1.0))
        ray, inside = lens.trace(b, ray)
        passed = passed & inside
        object_z = object_z + lens.hiatus_mm
    return CapturedRays(ray._replace(z=object_z - ray.z, dz=-ray.dz), through_array, passed)


@dataclass(frozen=True)
class CaptureSource:
    """The rays of a captured image, as a `RaySource`; `aperture` is for a pickup."""

    setup: Setup
    samples: int
    aperture: Aperture
    seed: int
    device: str

    @property
    def width_px(self) -> int:
        """Image width."""
        return self.setup.display.panel.width_px

    @property
    def height_px(self) -> int:
        """Image height."""
        return self.setup.display.panel.height_px

    @property
    def stripes(self) -> None:
        """A camera has no colour stripes."""
        return

    def rays(self, pixel: Any, sample: Any) -> CapturedRays:
        """Trace samples of pixels, given by their numbers (UInt32)."""
        mi = mitsuba()
        b = DrJitBackend(self.device)
        row = pixel // self.width_px
        column = pixel - row * self.width_px
        jitter_x, jitter_y = mi.Float(0.5), mi.Float(0.5)
        if self.samples > 1:
            jitter_x, jitter_y = points_in_square(pixel, sample, self.seed, stream=0)
        aperture = None
        if self.aperture == "full" and isinstance(self.setup.pickup, Pickup):
            s, t = points_in_square(pixel, sample, self.seed, stream=1)
            x, y = square_to_cell(b, s, t, self.setup.array.grid, self.setup.array.pitch_mm)
            aperture = (b.double(x), b.double(y))
        u, v = b.double(column) + b.double(jitter_x), b.double(row) + b.double(jitter_y)
        return rays_from_picture(b, self.setup, u, v, aperture)

    def lines(self, pixel: Any, sample: Any, stripe: tuple[Any, float]) -> Lines:
        """Return the lines of sight of samples (see `RaySource`), in the object's frame."""
        return lines_of(self.rays(pixel, sample))


def lines_of(rays: CapturedRays) -> Lines:
    """Return captured rays as lines of sight in the object's frame."""
    mi = mitsuba()
    ray, through_array, through_lens = rays
    point = (mi.Float(ray.x), mi.Float(ray.y), mi.Float(ray.z))
    return Lines(point, (mi.Float(-ray.dx), mi.Float(-ray.dy), mi.Float(-ray.dz)), through_array & through_lens)
