"""From pixels to the rays that leave the array, and back, in an engine's own arrays.

`lippmann.engines.trace` wraps these functions for numpy arrays. The renderer and the observer call them directly.
"""

from __future__ import annotations

from typing import NamedTuple

from lippmann.optics import exact, models
from lippmann.optics.aim import Ray
from lippmann.optics.backend import Arr, Backend
from lippmann.optics.rays import Model, Status, gets_through
from lippmann.optics.system import Exit, System

#: Squared cosine below which the fast engine traces a ray again in double precision: float32 turns a ray by about 0.2
#: microradian over its cosine to the face's normal, which stays below 1 microradian above it.
GRAZING_SQUARE = 0.15

#: Farthest place from the array's centre that rays are followed to, in lenslets: their indices fit into 32 bits.
FARTHEST_LENSLETS = 1 << 28
#: A ray flatter than this never comes to the array: below it, what it is divided by may be 0 in float32.
FLATTEST = 1e-30


class LocalRays(NamedTuple):
    """Rays in an engine's arrays, panel's axes: lens-local point and direction (real), lenslet's centre (double)."""

    ray: Ray
    centre_x: Arr
    centre_y: Arr
    i: Arr
    j: Arr
    status: Arr


def rays_from_pixels(
    b: Backend,
    system: System,
    u: Arr,
    v: Arr,
    aperture: tuple[Arr, Arr] | None,
    model: Model,
) -> LocalRays:
    """Trace from pixel coordinates (u, v), given as double, to the rays that leave the array.

    The aperture points are lens-local, mm, in the array's axes; None for chief rays.
    """
    frame = system.frame
    x, y = frame.array_from_panel(*frame.panel_from_pixel(u, v))
    i, j, x, y = system.lattice.locate(b, x, y)
    out = leave_panel(b, system, x, y, aperture, model)
    i, j = i + b.double(out.di), j + b.double(out.dj)
    centre_x, centre_y = frame.panel_from_array(*system.lattice.centre(i, j))
    ray = out.ray
    px, py = frame.turn(ray.x, ray.y)
    dx, dy = frame.turn(ray.dx, ray.dy)
    return LocalRays(
        Ray(px, py, ray.z, dx, dy, ray.dz),
        centre_x,
        centre_y,
        b.integer(i),
        b.integer(j),
        out.status,
    )


def leave_panel(b: Backend, system: System, x: Arr, y: Arr, aperture: tuple[Arr, Arr] | None, model: Model) -> Exit:
    """Trace rays from lens-local panel points (double); those that graze a face are traced in double throughout."""

    def traced(b: Backend, x: Arr, y: Arr, *aim: Arr) -> tuple[Arr, ...]:
        points = (aim[0], aim[1]) if aim else None
        if model == "exact":
            out = exact.leave_panel(b, system, x, y, points)
        else:
            out = models.leave_panel(b, system, x, y, points, model)
        return *out.ray, *out[1:]

    aim = aperture or ()
    coarse = traced(b, b.real(x), b.real(y), *(b.real(a) for a in aim))
    inputs = (x, y, *(b.double(a) for a in aim))
    done = b.refine(coarse[-1] < GRAZING_SQUARE, traced, inputs, coarse)
    return Exit(Ray(*done[:6]), *done[6:])


class PixelHits(NamedTuple):
    """Where rays from the world meet the panel: pixel coordinates (double), lenslet passed, status."""

    u: Arr
    v: Arr
    i: Arr
    j: Arr
    status: Arr


def pixels_from_rays(
    b: Backend, system: System, origin: tuple[Arr, ...], direction: tuple[Arr, ...], model: Model
) -> PixelHits:
    """Trace rays from the world (origins in mm and unit directions, double) to the panel."""
    frame = system.frame
    ox, oy, oz = origin
    dx, dy, dz = direction
    z = system.last_face_mm if model in ("paraxial", "exact") else 0.0
    heads_there = dz < -FLATTEST
    safe_z = b.where(heads_there, dz, -1.0)
    t = b.where(heads_there, (z - oz) / safe_z, 0.0)
    x, y = frame.array_from_panel(ox + t * dx, oy + t * dy)
    # What meets the array's plane out of all proportion does not meet the array; nothing may be computed from it.
    farthest = FARTHEST_LENSLETS * system.lattice.pitch_mm
    heads_there = heads_there & (b.maximum(b.absolute(x), b.absolute(y)) < farthest)
    x, y = b.where(heads_there, x, 0.0), b.where(heads_there, y, 0.0)
    safe_z = b.where(heads_there, safe_z, -1.0)
    i, j, x, y = system.lattice.locate(b, x, y)
    dx, dy = frame.turn_back(dx, dy)
    x, y = b.real(x), b.real(y)
    ray = Ray(x, y, 0.0 * x + z, b.real(dx), b.real(dy), b.real(safe_z))
    if model == "exact":
        landing = exact.reach_panel(b, system, ray)
    else:
        landing = models.reach_panel(b, system, ray, model)
    i, j = i + b.double(landing.di), j + b.double(landing.dj)
    cx, cy = system.lattice.centre(i, j)
    px, py = frame.panel_from_array(cx + b.double(landing.x), cy + b.double(landing.y))
    u, v = frame.pixel_from_panel(px, py)
    on_panel = (u >= 0.0) & (u < system.width_px) & (v >= 0.0) & (v < system.height_px)
    arrived = gets_through(landing.status)
    status = b.where(arrived & ~on_panel, int(Status.BLOCKED), landing.status)
    status = b.where(heads_there, status, int(Status.MISSED))
    return PixelHits(u, v, b.integer(i), b.integer(j), b.integer(status))
