"""Sources of primary rays: a display's pixels through their lenslets, or an eye that looks through a window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np

from lippmann.display import Display
from lippmann.engines import trace
from lippmann.fixed.words import PIXEL_FRACTION
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.pixel_rays import rays_from_pixels
from lippmann.optics.rays import Engine, Model, gets_through
from lippmann.optics.sampling import points_in_square, square_to_cell
from lippmann.optics.system import System
from lippmann.variant import mitsuba

Aperture = Literal["chief", "full"]
APERTURES: tuple[Aperture, ...] = get_args(Aperture)

#: Centres of the colour stripes, in pixels from the pixel's centre, for red, green and blue.
STRIPES = {"none": None, "rgb": (-1.0 / 3.0, 0.0, 1.0 / 3.0), "bgr": (1.0 / 3.0, 0.0, -1.0 / 3.0)}


class Lines(NamedTuple):
    """Lines of sight in the display's frame.

    point
        Three Floats, a point of each line, mm.
    direction
        Three Floats, unit vectors along the lines, from the display to the viewer.
    active
        Which lines exist: a ray that the lenslets block has none.
    """

    point: tuple[Any, Any, Any]
    direction: tuple[Any, Any, Any]
    active: Any


class RaySource(Protocol):
    """A source of primary rays."""

    @property
    def width_px(self) -> int:
        """Image width."""

    @property
    def height_px(self) -> int:
        """Image height."""

    @property
    def stripes(self) -> tuple[float, float, float] | None:
        """Centres of the colour stripes for red, green and blue, pixels from the pixel's centre; None without."""

    def lines(self, pixel: Any, sample: Any, stripe: tuple[Any, float]) -> Lines:
        """Return the lines of sight of samples.

        Parameters
        ----------
        pixel, sample
            UInt32, pixel numbers row by row, and the numbers of the samples within their pixel.
        stripe
            Centre (Float) and width of the sampled part of the pixel, in pixels from the pixel's centre.
        """


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


@dataclass(frozen=True)
class IntegralSource:
    """The rays of a display's pixels.

    `engine` traces them: "fast" inside the renderer's program, the others outside it, chunk by chunk. `fraction_bits`
    is for "twin" and "rtl". If a pixel has several samples, "fast" places them anywhere in it; the other engines place
    them on the same sixteenths of a pixel.
    """

    display: Display
    model: Model
    samples: int
    aperture: Aperture
    seed: int
    device: str
    engine: Engine = "fast"
    fraction_bits: int | None = None

    @property
    def width_px(self) -> int:
        """Panel width."""
        return self.display.panel.width_px

    @property
    def height_px(self) -> int:
        """Panel height."""
        return self.display.panel.height_px

    @property
    def stripes(self) -> tuple[float, float, float] | None:
        """Colour stripes of the panel."""
        return STRIPES[self.display.panel.subpixels]

    def lines(self, pixel: Any, sample: Any, stripe: tuple[Any, float]) -> Lines:
        """Trace pixel samples through the lenslets (see `RaySource`)."""
        mi = mitsuba()
        b = DrJitBackend(self.device)
        row = pixel // self.width_px
        column = pixel - row * self.width_px
        offset, width = stripe
        jitter_x, jitter_y = mi.Float(0.5), mi.Float(0.5)
        if self.samples > 1:
            jitter_x, jitter_y = points_in_square(pixel, sample, self.seed, stream=0)
        u = b.double(column) + b.double(0.5 + offset + width * (jitter_x - 0.5))
        v = b.double(row) + b.double(jitter_y)
        aperture = None
        if self.aperture == "full":
            s, t = points_in_square(pixel, sample, self.seed, stream=1)
            array = self.display.array
            aperture = square_to_cell(b, s, t, array.grid, array.pitch_mm)
        if self.engine != "fast":
            return self._traced_outside(u, v, aperture)
        return lines_from_pixels(b, self.display, u, v, aperture, self.model)

    def _traced_outside(self, u: Any, v: Any, aperture: tuple[Any, Any] | None) -> Lines:
        """Trace by an engine that takes and gives numpy arrays."""
        mi = mitsuba()
        pixels = np.stack([np.asarray(u), np.asarray(v)], axis=1)
        if self.samples > 1:
            # All engines take the places that the RTL's words can express, so that they trace the same rays.
            steps = 1 << PIXEL_FRACTION
            pixels = np.rint(pixels * steps) / steps
        aims = None if aperture is None else np.stack([np.asarray(a) for a in aperture], axis=1)
        rays = trace(self.display, pixels, aims, self.model, self.engine, fraction_bits=self.fraction_bits)
        x, y, z = (mi.Float(column) for column in rays.origin_mm.astype(np.float32).T)
        dx, dy, dz = (mi.Float(column) for column in rays.direction.astype(np.float32).T)
        return Lines((x, y, z), (dx, dy, dz), mi.Bool(gets_through(rays.status)))


@dataclass(frozen=True)
class Window:
    """The rectangle that a view covers, in the plane z = 0 and centred on the axis."""

    width_mm: float
    height_mm: float
    width_px: int
    height_px: int


@dataclass(frozen=True)
class PerspectiveSource:
    """The rays from an eye (mm) through a window, without a display."""

    eye_mm: tuple[float, float, float]
    window: Window
    samples: int
    seed: int
    stripes: tuple[float, float, float] | None = None

    @property
    def width_px(self) -> int:
        """View width."""
        return self.window.width_px

    @property
    def height_px(self) -> int:
        """View height."""
        return self.window.height_px

    def lines(self, pixel: Any, sample: Any, stripe: tuple[Any, float]) -> Lines:
        """Join window points and eye (see `RaySource`)."""
        mi = mitsuba()
        import drjit as dr

        window = self.window
        row = pixel // window.width_px
        column = pixel - row * window.width_px
        jitter_x, jitter_y = mi.Float(0.5), mi.Float(0.5)
        if self.samples > 1:
            jitter_x, jitter_y = points_in_square(pixel, sample, self.seed, stream=0)
        x = ((mi.Float(column) + jitter_x) / window.width_px - 0.5) * window.width_mm
        y = (0.5 - (mi.Float(row) + jitter_y) / window.height_px) * window.height_mm
        ray = dr.normalize(mi.Vector3f(self.eye_mm[0] - x, self.eye_mm[1] - y, mi.Float(self.eye_mm[2])))
        return Lines((x, y, mi.Float(0.0)), (ray.x, ray.y, ray.z), mi.Bool(True))
