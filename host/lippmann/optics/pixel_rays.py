"""From pixel coordinates to rays in the panel's frame, and from such rays to pixel coordinates, in a backend's arrays.

Coordinates across the panel are double; each ray is traced local to its lenslet, in the engine's own format.
`lippmann.engines.trace` wraps these functions for numpy arrays. The renderer and the observer call them directly.
"""

from __future__ import annotations

from typing import NamedTuple

from lippmann.optics import models
from lippmann.optics.aim import Ray
from lippmann.optics.backend import Arr, Backend
from lippmann.optics.rays import Model, Status, gets_through
from lippmann.optics.system import System

#: Largest distance from the array's centre to which rays are followed, in lenslets: their indices fit into 32 bits.
FARTHEST_LENSLETS = 1 << 28
#: Least |dz| of a ray that can reach the array; a divisor below it may be 0 in float32.
FLATTEST = 1e-30


class LocalRays(NamedTuple):
    """Rays in a backend's arrays, panel's axes: lens-local point and direction (real), lenslet's centre (double)."""

    ray: Ray
    centre_x: Arr
    centre_y: Arr
    i: Arr
    j: Arr
    status: Arr


def rays_from_pixels(
    b: Backend, system: System, u: Arr, v: Arr, aperture: tuple[Arr, Arr] | None, model: Model
) -> LocalRays:
    """Trace from pixel coordinates (u, v), given as double, to the rays that leave the array.

    The aperture points are lens-local, mm, in the array's axes; None for chief rays.
    """
    i, j, x, y = system.locate(b, u, v)
    out = models.leave_panel(b, system, x, y, aperture, model)
    own = i, j
    i, j = i + b.double(out.di), j + b.double(out.dj)
    status = system.through_mount(b, out.status, (i, j), own)
    ray, turn = out.ray, system.frame.turn
    ray = Ray(*turn(ray.x, ray.y), ray.z, *turn(ray.dx, ray.dy), ray.dz)
    return LocalRays(ray, *system.centre(i, j), b.integer(i), b.integer(j), status)


class PixelHits(NamedTuple):
    """Hits of rays on the panel: pixel coordinates (double), the lenslet that each ray passed, status."""

    u: Arr
    v: Arr
    i: Arr
    j: Arr
    status: Arr


def pixels_from_rays(
    b: Backend, system: System, origin: tuple[Arr, ...], direction: tuple[Arr, ...], model: Model
) -> PixelHits:
    """Trace rays from the world, origins (mm) and unit directions in the panel's frame (double), to the panel."""
    frame = system.frame
    ox, oy, oz = origin
    dx, dy, dz = direction
    z = system.last_face_mm if model in ("paraxial", "exact") else 0.0
    heads_there = dz < -FLATTEST
    safe_z = b.where(heads_there, dz, -1.0)
    t = b.where(heads_there, (z - oz) / safe_z, 0.0)
    x, y = frame.array_from_panel(ox + t * dx, oy + t * dy)
    # A ray that meets the array's plane too far out has missed; its numbers are replaced, so that none overflows.
    farthest = FARTHEST_LENSLETS * min(system.lattice.pitches_mm)
    heads_there = heads_there & (b.maximum(b.absolute(x), b.absolute(y)) < farthest)
    x, y = b.where(heads_there, x, 0.0), b.where(heads_there, y, 0.0)
    safe_z = b.where(heads_there, safe_z, -1.0)
    i, j, x, y = system.lattice.locate(b, x, y)
    dx, dy = frame.turn_back(dx, dy)
    x, y = b.real(x), b.real(y)
    ray = Ray(x, y, 0.0 * x + z, b.real(dx), b.real(dy), b.real(safe_z))
    landing = models.reach_panel(b, system, ray, model)
    i, j = i + b.double(landing.di), j + b.double(landing.dj)
    cx, cy = system.lattice.centre(i, j)
    px, py = frame.panel_from_array(cx + b.double(landing.x), cy + b.double(landing.y))
    u, v = frame.pixel_from_panel(px, py)
    on_panel = (u >= 0.0) & (u < frame.width_px) & (v >= 0.0) & (v < frame.height_px)
    owned = b.where(system.owns(landing.x, landing.y, cx, cy), int(Status.OK), int(Status.CROSSTALK))
    arrival = b.where(on_panel, owned, int(Status.BLOCKED))
    status = b.where(gets_through(landing.status), arrival, landing.status)
    status = system.through_mount(b, status, (i, j))
    status = b.where(heads_there, status, int(Status.MISSED))
    return PixelHits(u, v, b.integer(i), b.integer(j), b.integer(status))
