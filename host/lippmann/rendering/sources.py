"""Sources of primary rays: a display's pixels through their lenslets, or an eye that looks through a window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from lippmann.base.variant import mitsuba
from lippmann.display.description import Display
from lippmann.display.subpixels import Layout, layout_of
from lippmann.engines import trace
from lippmann.fixed.words import PIXEL_FRACTION
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Engine, Model, gets_through
from lippmann.optics.sampling import square_to_cell
from lippmann.optics.system import System
from lippmann.optics.trace import rays_from_pixels

Aperture = Literal["chief", "full"]
APERTURES: tuple[Aperture, ...] = get_args(Aperture)


class Lines(NamedTuple):
    """Lines of sight in the display's frame."""

    #: Three Floats, a point of each line, mm.
    point: tuple[Any, Any, Any]
    #: Three Floats, unit vectors along the lines, from the display to the viewer.
    direction: tuple[Any, Any, Any]
    #: Which lines exist: a ray that the lenslets block has none.
    active: Any
    #: Which do not, for each of the reasons that the source tells apart.
    lost: tuple[Any, ...] = ()


@dataclass(frozen=True)
class RaySource:
    """A source of primary rays: the size of an image, and what its points see."""

    width_px: int
    height_px: int
    #: Returns the lines of sight; its arguments are a backend, pixel coordinates u and v (double), and for each of them
    #: a random point of the unit square (two Floats), for the lenslets' apertures.
    lines: Callable[[DrJitBackend, Any, Any, tuple[Any, Any]], Lines]
    #: Sub-pixels; None where a pixel emits its three colours alike.
    layout: Layout | None = None
    #: Whether `lines` stays in Dr.Jit, so that its program can be recorded.
    recordable: bool = True
    #: The finest detail that an eye sees in it, mm: the lenslets' pitch; None where there are none.
    detail_mm: float | None = None
    #: Returns numbers (UInt32) of the lenslets that own points; its arguments are the first three of `lines`. Without
    #: lenslets all points have the same number. Neighbouring pixels with the same owner share samples (`PixelFilter`);
    #: with None no pixels do.
    owner: Callable[[DrJitBackend, Any, Any], Any] | None = None


def owner_number(i: Any, j: Any) -> Any:
    """Return a number (UInt32) for each lenslet (i, j); neighbouring lenslets have different ones."""
    mi = mitsuba()
    return mi.UInt32(mi.Int32(i)) * 0x10001 + mi.UInt32(mi.Int32(j))


def lines_from_pixels(
    b: DrJitBackend, display: Display, u: Any, v: Any, aperture: tuple[Any, Any] | None, model: Model
) -> Lines:
    """Trace pixel coordinates (double) through a display's lenslets; aperture points as in `rays_from_pixels`."""
    mi = mitsuba()
    out = rays_from_pixels(b, System.of(display), u, v, aperture, model)
    point = (
        mi.Float(out.centre_x + b.double(out.ray.x)),
        mi.Float(out.centre_y + b.double(out.ray.y)),
        mi.Float(out.ray.z),
    )
    return Lines(point, (out.ray.dx, out.ray.dy, out.ray.dz), gets_through(out.status))


def display_source(
    display: Display,
    model: Model,
    samples: int = 1,
    aperture: Aperture = "chief",
    engine: Engine = "fast",
    fraction_bits: int | None = None,
) -> RaySource:
    """Return the rays of a display's pixels.

    `engine` traces them: "fast" inside the renderer's program, the others outside it, chunk by chunk. `fraction_bits`
    is for "twin" and "rtl". If a pixel has several samples, "fast" places them anywhere in it; the other engines place
    them on the same sixteenths of a pixel, which the RTL's words can express.
    """
    panel = display.panel

    def lines(b: DrJitBackend, u: Any, v: Any, square: tuple[Any, Any]) -> Lines:
        aperture_points = square_to_cell(b, *square, Lattice.of(display.array)) if aperture == "full" else None
        if engine == "fast":
            return lines_from_pixels(b, display, u, v, aperture_points, model)
        # An engine that takes and gives numpy arrays.
        mi = mitsuba()
        pixels = np.stack([np.asarray(u), np.asarray(v)], axis=1)
        if samples > 1:
            steps = 1 << PIXEL_FRACTION
            pixels = np.rint(pixels * steps) / steps
        aims = None if aperture_points is None else np.stack([np.asarray(a) for a in aperture_points], axis=1)
        rays = trace(display, pixels, aims, model, engine, fraction_bits=fraction_bits)
        x, y, z = (mi.Float(column) for column in rays.origin_mm.astype(np.float32).T)
        dx, dy, dz = (mi.Float(column) for column in rays.direction.astype(np.float32).T)
        return Lines((x, y, z), (dx, dy, dz), mi.Bool(gets_through(rays.status)))

    def owner(b: DrJitBackend, u: Any, v: Any) -> Any:
        return owner_number(*System.of(display).locate(b, u, v)[:2])

    layout, finest = layout_of(panel.subpixels), display.array.finest_mm
    # The other engines are there to be compared: their pixels are plain means.
    fast = engine == "fast"
    return RaySource(panel.width_px, panel.height_px, lines, layout, fast, finest, owner if fast else None)


@dataclass(frozen=True)
class Window:
    """The rectangle that a view covers, in the plane z = 0 and centred on the axis."""

    width_mm: float
    height_mm: float
    width_px: int
    height_px: int

    def point(self, u: Any, v: Any) -> tuple[Any, Any]:
        """Return x and y, mm, of pixel coordinates."""
        return (u / self.width_px - 0.5) * self.width_mm, (0.5 - v / self.height_px) * self.height_mm


def eye_source(
    eye_mm: tuple[float, float, float], window: Window, pupil_mm: float = 0.0, focus_z_mm: float = 0.0
) -> RaySource:
    """Return the rays from an eye (mm) through a window, without a display.

    With a pupil, a ray passes a random point of it, and the point at the depth in focus that the pupil's centre sees
    through the pixel.
    """

    def lines(b: DrJitBackend, u: Any, v: Any, square: tuple[Any, Any]) -> Lines:
        mi = mitsuba()
        import drjit as dr

        # Opaque, so that another eye or window needs no compilation.
        wide, high = (dr.opaque(mi.Float64, c) for c in (window.width_mm, window.height_mm))
        x, y = (mi.Float(c) for c in replace(window, width_mm=wide, height_mm=high).point(u, v))
        ex, ey, ez, radius, focus = (dr.opaque(mi.Float, c) for c in (*eye_mm, 0.5 * pupil_mm, focus_z_mm))
        z = mi.Float(0.0)
        if pupil_mm > 0.0:
            reach = (ez - focus) / ez
            x, y, z = ex + (x - ex) * reach, ey + (y - ey) * reach, focus
            disk = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(*square))
            ex, ey = ex + radius * disk.x, ey + radius * disk.y
        ray = dr.normalize(mi.Vector3f(ex - x, ey - y, ez - z))
        return Lines((x, y, z), (ray.x, ray.y, ray.z), mi.Bool(True))

    def owner(b: DrJitBackend, u: Any, v: Any) -> Any:
        return mitsuba().UInt32(0)

    return RaySource(window.width_px, window.height_px, lines, owner=owner)
