"""Traces rays from pixels to the panel's frame, and back, with the engines golden and fast."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.base.variant import available_device, check_device
from lippmann.display.description import MAX_LENGTH_MM, Display, display_at
from lippmann.errors import InputError, check_choice
from lippmann.optics.backend import Arr, Backend, DrJitBackend, NumpyBackend, Point
from lippmann.optics.faces import Ray
from lippmann.optics.models import leave_panel, reach_panel
from lippmann.optics.rays import ENGINES, MODELS, Engine, Floats, Hits, Model, Rays, Status, gets_through
from lippmann.optics.system import System

#: Maximum distance of rays from the array's centre in lenslets, for 32-bit indices.
FARTHEST_LENSLETS = 1 << 28
#: Minimum |dz| of a ray that reaches the array; a smaller |dz| may be 0 in float32.
FLATTEST = 1e-30


class LocalRays(NamedTuple):
    """Rays in the panel's axes: lens-local points and directions (real), lenslet centres (double)."""

    ray: Ray
    centre_x: Arr
    centre_y: Arr
    i: Arr
    j: Arr
    status: Arr


def rays_from_pixels(b: Backend, system: System, u: Arr, v: Arr, aperture: Point | None, model: Model) -> LocalRays:
    """Trace rays from pixel coordinates (u, v; double) until they leave the array (see `leave_panel`)."""
    own_i, own_j, x, y = system.locate(b, u, v)
    out = leave_panel(b, system, x, y, aperture, model)
    i, j = own_i + b.double(out.di), own_j + b.double(out.dj)
    status = system.through_mount(b, out.status, (i, j), (own_i, own_j))
    ray, turn = out.ray, system.frame.turn
    ray = Ray(*turn(ray.x, ray.y), ray.z, *turn(ray.dx, ray.dy), ray.dz)
    return LocalRays(ray, *system.centre(i, j), b.integer(i), b.integer(j), status)


class PixelHits(NamedTuple):
    """Ray hits on the panel: pixel coordinates (double), passed lenslets, statuses."""

    u: Arr
    v: Arr
    i: Arr
    j: Arr
    status: Arr


def pixels_from_rays(
    b: Backend, system: System, origin: tuple[Arr, ...], direction: tuple[Arr, ...], model: Model
) -> PixelHits:
    """Trace rays with origins (mm) and unit directions (double) from the world to the panel."""
    frame = system.frame
    ox, oy, oz = origin
    dx, dy, dz = direction
    z = system.last_face_mm if model in ("paraxial", "exact") else 0.0
    heads_there = dz < -FLATTEST
    safe_z = b.where(heads_there, dz, -1.0)
    t = b.where(heads_there, (z - oz) / safe_z, 0.0)
    x, y = frame.array_from_panel(ox + t * dx, oy + t * dy)
    # A ray that meets the array's plane too far out has missed; set its point to 0.
    farthest = FARTHEST_LENSLETS * min(system.lattice.pitches_mm)
    heads_there = heads_there & (b.maximum(b.absolute(x), b.absolute(y)) < farthest)
    x, y = b.where(heads_there, x, 0.0), b.where(heads_there, y, 0.0)
    safe_z = b.where(heads_there, safe_z, -1.0)
    i, j, x, y = system.lattice.locate(b, x, y)
    dx, dy = frame.turn_back(dx, dy)
    x, y = b.real(x), b.real(y)
    ray = Ray(x, y, 0.0 * x + z, b.real(dx), b.real(dy), b.real(safe_z))
    landing = reach_panel(b, system, ray, model)
    i, j = i + b.double(landing.di), j + b.double(landing.dj)
    cx, cy = system.lattice.centre(i, j)
    px, py = frame.panel_from_array(cx + b.double(landing.x), cy + b.double(landing.y))
    u, v = frame.pixel_from_panel(px, py)
    on_panel = (u >= 0.0) & (u < frame.width_px) & (v >= 0.0) & (v < frame.height_px)
    own = system.lattice.holds(*system.convergence.within_cell(landing.x, landing.y, cx, cy))
    arrival = b.where(on_panel, b.where(own, int(Status.OK), int(Status.CROSSTALK)), int(Status.BLOCKED))
    status = b.where(gets_through(landing.status), arrival, landing.status)
    status = system.through_mount(b, status, (i, j))
    status = b.where(heads_there, status, int(Status.MISSED))
    return PixelHits(u, v, b.integer(i), b.integer(j), b.integer(status))


#: Maximum error of a unit vector's length; a larger error means that slopes were given.
UNIT_ERROR = 1e-3


def backend_of(engine: Engine, device: str = "auto", rays: int = 1) -> Backend:
    """Return an engine's backend, or numpy's if there are no rays, because Dr.Jit has no empty arrays.

    Raises InputError for another engine or device, and the errors of `available_device`.
    """
    check_engine_device(engine, device)
    if engine not in ("golden", "fast"):
        raise InputError(f"engine {engine} traces from the panel to the world only; choose from golden, fast")
    return DrJitBackend(available_device(device)) if engine == "fast" and rays else NumpyBackend()


def check_engine_device(engine: str, device: str) -> None:
    """Refuse an unknown engine or device, and a GPU for an engine that computes without Dr.Jit."""
    check_choice("engine", engine, ENGINES)
    check_device(device)
    if device == "cuda" and engine != "fast":
        raise InputError(f"device cuda belongs to the engine fast; leave it out with {engine}")


def columns(name: str, values: npt.ArrayLike, width: int, limit: float) -> Floats:
    """Return values as (N, width) float64; refuse other shapes, NaN, infinity and values beyond `limit`."""
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is not an array of numbers; give shape (N, {width})") from None
    if array.ndim != 2 or array.shape[1] != width:
        raise InputError(f"{name} has shape {array.shape}; give (N, {width})")
    if not np.isfinite(array).all():
        raise InputError(f"{name} contains values that are not finite; remove them")
    if (np.abs(array) > limit).any():
        raise InputError(f"{name} contains values beyond {limit:.6g}, outside every array; remove them")
    return array


def trace_optics(
    display: str | Path | Display,
    pixels: npt.ArrayLike,
    aperture: npt.ArrayLike | None = None,
    model: Model = "exact",
    engine: Engine = "golden",
    device: str = "auto",
) -> Rays:
    """Trace rays from the panel with the engine golden or fast.

    Parameters and errors are those of `engines.trace`.
    """
    display, pixel, points = checked_rays(display, pixels, aperture, model)
    b = backend_of(engine, device, len(pixel))
    aims = None if points is None else (b.double(points[:, 0]), b.double(points[:, 1]))
    out = rays_from_pixels(b, System.of(display), b.double(pixel[:, 0]), b.double(pixel[:, 1]), aims, model)
    return rays_of(pixel, out)


def checked_rays(
    display: str | Path | Display, pixels: npt.ArrayLike, aperture: npt.ArrayLike | None, model: Model
) -> tuple[Display, Floats, Floats | None]:
    """Check and return rays' display, pixel coordinates and aperture points, (N, 2) each."""
    check_choice("model", model, MODELS)
    display = display_at(display)
    array, panel = display.array, display.panel
    farthest = FARTHEST_LENSLETS * array.finest_mm
    if max(abs(x) for x in array.offset_mm) > farthest:
        raise InputError(f"array.offset_mm is beyond {farthest:.6g} mm; bring array.offset_mm nearer to 0")
    pixel = columns("pixels", pixels, 2, farthest / panel.coarsest_mm)
    points = None if aperture is None else columns("aperture", aperture, 2, farthest)
    if points is not None and len(points) != len(pixel):
        raise InputError(f"aperture has {len(points)} rows for {len(pixel)} pixels; give one row per pixel")
    return display, pixel, points


def trace_to_panel(
    display: str | Path | Display,
    origin_mm: npt.ArrayLike,
    direction: npt.ArrayLike,
    model: Model = "exact",
    engine: Engine = "golden",
    device: str = "auto",
) -> Hits:
    """Trace rays from the world, (N, 3) origins in mm and (N, 3) unit directions, to the panel.

    A ray has missed if dz is above -`FLATTEST`, or if it meets the array beyond
    `FARTHEST_LENSLETS`. Raises `trace`'s errors, and InputError for directions not of
    length 1.
    """
    check_choice("model", model, MODELS)
    origins = columns("origin_mm", origin_mm, 3, MAX_LENGTH_MM)
    directions = columns("direction", direction, 3, math.inf)
    if (np.abs(np.linalg.norm(directions, axis=1) - 1.0) > UNIT_ERROR).any():
        raise InputError("direction contains vectors that are not of length 1; divide them by their lengths")
    n = len(origins)
    b = backend_of(engine, device, n)
    origin = tuple(map(b.double, origins.T.copy()))
    unit = tuple(map(b.double, directions.T.copy()))
    return hits_of(n, pixels_from_rays(b, System.of(display_at(display)), origin, unit, model))


def rays_of(pixel: Floats, out: LocalRays, number: npt.DTypeLike = np.float64) -> Rays:
    """Return traced rays as numpy arrays; `number` is the type of coordinates and directions."""
    n, ray = len(pixel), out.ray
    return Rays(
        pixel=pixel,
        lenslet=_stack(n, np.int64, out.i, out.j),
        centre_mm=_stack(n, number, out.centre_x, out.centre_y),
        local_mm=_stack(n, number, ray.x, ray.y, ray.z),
        direction=_stack(n, number, ray.dx, ray.dy, ray.dz),
        status=_stack(n, np.uint8, out.status)[:, 0],
    )


def hits_of(n: int, hits: PixelHits, number: npt.DTypeLike = np.float64) -> Hits:
    """Return panel hits of n rays as numpy arrays (see `rays_of`)."""
    status = _stack(n, np.uint8, hits.status)[:, 0]
    return Hits(_stack(n, number, hits.u, hits.v), _stack(n, np.int64, hits.i, hits.j), status)


def _stack(n: int, number: npt.DTypeLike, *columns: Arr) -> Arr:
    gathered = np.empty((n, len(columns)), number)
    for k, column in enumerate(columns):
        gathered[:, k] = np.asarray(column)
    return gathered
