"""Creates primary rays from a display's pixels through lenslets, or from an eye through a window."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.display.description import Display, Panel, Point3
from lippmann.display.subpixels import COLOURS, Box, Layout, layout_of
from lippmann.engines import trace
from lippmann.fixed.words import PIXEL_FRACTION
from lippmann.optics.backend import DrJitBackend, Point
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Engine, Model, gets_through
from lippmann.optics.sample_points import GOLDEN_STEP, HASH_ROUNDS, points_in_pixel, points_in_square, square_to_cell
from lippmann.optics.system import System
from lippmann.optics.trace import rays_from_pixels
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene

Aperture = Literal["chief", "full"]
APERTURES: tuple[Aperture, ...] = get_args(Aperture)
TILE_PX = 8


class Lines(NamedTuple):
    """Lines of sight in the display's frame."""

    #: A point on each line of sight, three Floats, mm.
    point: tuple[Jit, Jit, Jit]
    #: Unit vectors from the display to the viewer along the lines, three Floats.
    direction: tuple[Jit, Jit, Jit]
    #: Mask of the rays that leave the lenslets.
    active: Jit
    #: Masks of lost rays, one for each reason.
    lost: tuple[Jit, ...] = ()


@dataclass(frozen=True)
class RaySource:
    """A source of primary rays for an image of `width_px` x `height_px` pixels."""

    width_px: int
    height_px: int
    #: Function that returns lines of sight. `lines` takes a backend, pixel coordinates
    #: u and v (double), and random points of the unit square (two Floats), which select
    #: points of the lenslet's aperture.
    lines: Callable[[DrJitBackend, Jit, Jit, Point], Lines]
    #: Sub-pixel layout, or None if a pixel emits all colours from its whole area.
    layout: Layout | None = None
    #: Whether `lines` uses only Dr.Jit, so that Dr.Jit can record it.
    recordable: bool = True
    #: Size of the finest visible detail, mm: the lenslet pitch, or None for an eye.
    detail_mm: float | None = None
    #: Function that returns a number (UInt32) for each pixel's lenslet. `owner` takes
    #: the first three arguments of `lines`. Neighbouring pixels of equal lenslet number
    #: share samples (`PixelFilter`). If `owner` is None, no pixels share samples.
    owner: Callable[[DrJitBackend, Jit, Jit], Jit] | None = None

    @property
    def colours(self) -> int:
        """Number of separately sampled colours: 3 with sub-pixels, else 1."""
        return 1 if self.layout is None else 3


def owner_number(i: Jit, j: Jit) -> Jit:
    """Return a number (UInt32) for lenslet (i, j); neighbouring lenslets have different numbers."""
    return mi.UInt32(mi.Int32(i)) * 0x10001 + mi.UInt32(mi.Int32(j))


def lines_from_pixels(b: DrJitBackend, display: Display, u: Jit, v: Jit, aperture: Point | None, model: Model) -> Lines:
    """Trace rays from pixels at u, v (double) through the lenslets; return lines of sight."""
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
    """Return the ray source of a display; only engines "twin" and "rtl" use `fraction_bits`.

    The engine "fast" traces rays inside the renderer's program, from any points of a
    pixel. Other engines trace one chunk of rays at a time. If `samples` is above 1, the
    other engines round sample points to 1/16 pixel, as the RTL's words do.
    """
    panel = display.panel

    def lines(b: DrJitBackend, u: Jit, v: Jit, square: Point) -> Lines:
        aperture_points = square_to_cell(b, *square, Lattice.of(display.array)) if aperture == "full" else None
        if engine == "fast":
            return lines_from_pixels(b, display, u, v, aperture_points, model)
        pixels = np.stack([np.asarray(u), np.asarray(v)], axis=1)
        if samples > 1:
            steps = 1 << PIXEL_FRACTION
            pixels = np.rint(pixels * steps) / steps
        aims = None if aperture_points is None else np.stack([np.asarray(a) for a in aperture_points], axis=1)
        rays = trace(display, pixels, aims, model, engine, fraction_bits=fraction_bits)
        x, y, z = (mi.Float(column) for column in rays.origin_mm.astype(np.float32).T)
        dx, dy, dz = (mi.Float(column) for column in rays.direction.astype(np.float32).T)
        return Lines((x, y, z), (dx, dy, dz), mi.Bool(gets_through(rays.status)))

    def owner(b: DrJitBackend, u: Jit, v: Jit) -> Jit:
        return owner_number(*System.of(display).locate(b, u, v)[:2])

    layout, finest = layout_of(panel.subpixels), display.array.finest_mm
    fast = engine == "fast"
    return RaySource(*panel.size_px, lines, layout, fast, finest, owner if fast else None)


@dataclass(frozen=True)
class Window:
    """The rectangle that a view covers in the plane z = 0, centred on the display's axis."""

    width_mm: float
    height_mm: float
    width_px: int
    height_px: int

    def point(self, u: Jit, v: Jit) -> Point:
        """Return the position (x, y), mm, for pixel coordinates u, v."""
        return (u / self.width_px - 0.5) * self.width_mm, (0.5 - v / self.height_px) * self.height_mm


def eye_source(eye_mm: Point3, window: Window, pupil_mm: float = 0.0, focus_z_mm: float = 0.0) -> RaySource:
    """Return the source of rays from an eye (mm) through a window, without a display.

    If `pupil_mm` is above 0, a ray passes through a random point of the pupil. All rays
    through the same point of a pixel meet in the plane z = `focus_z_mm`.
    """

    def lines(b: DrJitBackend, u: Jit, v: Jit, square: Point) -> Lines:
        # Opaque values let another eye or window reuse the compiled program.
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

    return RaySource(window.width_px, window.height_px, lines, owner=lambda b, u, v: mi.UInt32(0))


def colours_of(panel: Panel) -> int:
    """Return `RaySource.colours` for the pixels of a panel."""
    return 1 if layout_of(panel.subpixels) is None else 3


def pixel_of(first_tile: Jit, place: Jit, width: int, height: int) -> tuple[Jit, Jit]:
    """Convert pixel indices from tile to image order; tell which pixels are inside."""
    tiles_across = -(-width // TILE_PX)
    tile = first_tile + place // (TILE_PX * TILE_PX)
    bits = place & (TILE_PX * TILE_PX - 1)
    x = (bits & 1) | ((bits >> 1) & 2) | ((bits >> 2) & 4)
    y = ((bits >> 1) & 1) | ((bits >> 2) & 2) | ((bits >> 3) & 4)
    tile_row = tile // tiles_across
    column = (tile - tile_row * tiles_across) * TILE_PX + x
    row = tile_row * TILE_PX + y
    inside = (column < width) & (row < height)
    return mi.UInt32(row * width + column), inside


@dataclass
class Parts:
    """The sampled area (`Box`) for each colour and each pixel of a sub-pixel layout."""

    box: tuple[Jit, Jit, Jit, Jit]
    #: Whether every sampled area is as high as its pixel.
    full_height: bool

    @classmethod
    def of(cls, layout: Layout | None) -> Parts:
        """Return a layout's areas as opaque values, so that another layout needs no compilation."""
        boxes = [Box(0.0, 0.0, 1.0, 1.0)]
        if layout is not None:
            boxes = [box for colour in COLOURS[:3] for box in layout.boxes(colour)]
        u, v, width, height = (mi.Float(list(column)) for column in zip(*boxes, strict=True))
        dr.make_opaque(u, v, width, height)
        return cls((u, v, width, height), all(box.v == 0.0 and box.height == 1.0 for box in boxes))


@dataclass
class Seeds:
    """The seeds (UInt32) of a render, as an argument of recorded functions."""

    image: Jit
    #: Index of the pass. A picture is the mean of its passes.
    number: Jit


def lines_of(
    source: RaySource, samples: int, seeds: Seeds, pixel: Jit, sample: Jit, parts: Parts, colour: Jit = 0
) -> Lines:
    """Return lines of sight for pixel, sample and colour indices (UInt32)."""
    b = DrJitBackend(current_device())
    x, y = points_in_pixel(pixel, sample, samples, seeds.image, seeds.number)
    row = pixel // source.width_px
    column = pixel - row * source.width_px
    box = Box(*parts.box)
    if source.layout is not None:
        number = (colour * source.layout.rows + row % source.layout.rows) * source.layout.columns
        number += column % source.layout.columns
        box = Box(*(dr.gather(mi.Float, values, number) for values in box))
    u = b.double(column) + b.double(0.5 + box.u + box.width * (x - 0.5))
    if not parts.full_height:
        y = 0.5 + box.v + box.height * (y - 0.5)
    return source.lines(b, u, b.double(row) + b.double(y), points_in_square(pixel, sample, seeds.image + seeds.number))


@dataclass
class Pose:
    """A placement as Dr.Jit values, so that a moved scene needs no new program."""

    near_mm: Jit
    #: The first three rows of `Placement.scene_from_display`; None for the identity.
    rows: list[list[Jit]] | None

    @classmethod
    def of(cls, placement: Placement) -> Pose:
        """Convert a placement to Dr.Jit values."""
        matrix = placement.scene_from_display
        moved = not np.array_equal(matrix, np.eye(4))
        rows = [[dr.opaque(mi.Float, float(x)) for x in line] for line in matrix[:3]] if moved else None
        return cls(dr.opaque(mi.Float, placement.near_mm), rows)

    def ray(self, lines: Lines) -> Jit:
        """Return rays in scene coordinates that start in front of the scene, towards the display."""
        point, direction, near = lines.point, lines.direction, self.near_mm
        t = (near - point[2]) / direction[2]
        start = mi.Point3f(point[0] + t * direction[0], point[1] + t * direction[1], near)
        back = mi.Vector3f(*(-c for c in direction))
        if self.rows is not None:
            m = self.rows
            start = mi.Point3f(*(line[0] * start.x + line[1] * start.y + line[2] * start.z + line[3] for line in m))
            back = dr.normalize(mi.Vector3f(*(line[0] * back.x + line[1] * back.y + line[2] * back.z for line in m)))
        ray = mi.RayDifferential3f(start, back)
        ray.wavelengths = []
        return ray


def first_hit(scene: Scene, lines: Lines, front_mm: float) -> tuple[Jit, Jit, Jit]:
    """Return rays that start at z = `front_mm`, the mask of rays that hit, and the hits' z, mm."""
    ray = Pose.of(replace(scene.placement, near_mm=front_mm, far_mm=None)).ray(lines)
    si = scene.mitsuba.ray_intersect(ray)
    front, scale = (dr.opaque(mi.Float, value) for value in (front_mm, scene.placement.scale))
    return ray, si.is_valid(), front - scale * si.t * lines.direction[2]


def first_depths(scene: Scene, eye_mm: Point3, window: Window) -> npt.NDArray[np.float32]:
    """Return the depths z that an eye sees, mm (height, width); -infinity if a ray hits nothing."""
    near = scene.placement.near_mm
    front = eye_mm[2] if near is None else min(near, eye_mm[2])
    number = dr.arange(mi.UInt32, window.width_px * window.height_px)
    lines = lines_of(eye_source(eye_mm, window), 1, Seeds(0, 0), number, dr.zeros(mi.UInt32, 1), Parts.of(None))
    _, valid, depth = first_hit(scene, lines, front)
    return np.asarray(dr.select(valid, depth, -dr.inf), np.float32).reshape(window.height_px, window.width_px)


def sampler_of(seeds: Seeds, pixel: Jit, sample: Jit) -> Jit:
    """Return a random sampler for integrators, seeded with pixel and sample indices (UInt32)."""
    # The random numbers do not depend on chunks, bands, workers or colours.
    sampler = _sampler_class(mi.variant())(mi.Properties())
    # `sample_points` uses the keys of the first four steps.
    key = seeds.image + seeds.number + (sample + 4) * GOLDEN_STEP
    state, stream = mi.sample_tea_32(pixel, key, HASH_ROUNDS)
    sampler.numbers = mi.PCG32(initstate=mi.UInt64(state), initseq=mi.UInt64(stream))
    return sampler


@functools.cache
def _sampler_class(variant: str) -> Jit:
    base: Jit = mi.Sampler

    class PixelSampler(base):  # type: ignore[misc]
        numbers: Jit

        def next_1d(self, active: Jit = True) -> Jit:
            return self.numbers.next_float32(active)

        def next_2d(self, active: Jit = True) -> Jit:
            return mi.Point2f(self.next_1d(active), self.next_1d(active))

    return PixelSampler
