"""One function for the trace: display, pixels, aperture points, model, engine; rays come out.

`trace` works on numpy arrays whatever the engine. The renderer and the observer stay inside an engine's own arrays
and call `rays_from_pixels` and `pixels_from_rays`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from lippmann.display import LENGTHS, Display
from lippmann.errors import InputError, MissingLibraryError
from lippmann.optics import exact, models
from lippmann.optics.aim import Ray
from lippmann.optics.backend import Arr, Backend, DrJitBackend, NumpyBackend
from lippmann.optics.status import Status, gets_through
from lippmann.optics.system import Exit, System

Model = Literal["pinhole", "thin", "paraxial", "exact"]
Engine = Literal["golden", "fast", "twin", "rtl"]
#: From the cheapest to the dearest.
MODELS: tuple[Model, ...] = get_args(Model)
ENGINES: tuple[Engine, ...] = get_args(Engine)

#: Squared cosine below which the fast engine traces a ray again in double precision: float32 turns a ray by about 0.2
#: microradian over its cosine to the face's normal, which stays below 1 microradian above it.
GRAZING_SQUARE = 0.15

#: Farthest place from the array's centre that rays are followed to, in lenslets: their indices fit into 32 bits.
FARTHEST_LENSLETS = 1 << 28
#: A ray flatter than this never comes to the array: below it, what it is divided by may be 0 in float32.
FLATTEST = 1e-30
#: How far the length of a direction may be from 1: small steps aside of a unit vector pass, slopes do not.
UNIT_ERROR = 1e-3

Floats = npt.NDArray[np.float64]


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

    def work(b: Backend, x: Arr, y: Arr, *aim: Arr) -> tuple[Arr, ...]:
        points = (aim[0], aim[1]) if aim else None
        if model == "exact":
            out = exact.leave_panel(b, system, x, y, points)
        else:
            out = models.leave_panel(b, system, x, y, points, model)
        return *out.ray, *out[1:]

    aim = aperture or ()
    rough = work(b, b.real(x), b.real(y), *(b.real(a) for a in aim))
    inputs = (x, y, *(b.double(a) for a in aim))
    done = b.redo(rough[-1] < GRAZING_SQUARE, work, inputs, rough)
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


@dataclass(frozen=True)
class Rays:
    """Rays that leave a display, N of them.

    Attributes
    ----------
    pixel
        (N, 2) float64, pixel coordinates (column, row; continuous) that they start from.
    lenslet
        (N, 2) int64, (i, j) of the lenslet that they leave through.
    centre_mm
        (N, 2) float64, that lenslet's centre, panel frame.
    local_mm
        (N, 3) float64, their origins from that centre, panel's axes; z = 0 is the vertices' plane.
    direction
        (N, 3) float64, unit.
    status
        (N,) uint8, see `Status`.
    """

    pixel: Floats
    lenslet: npt.NDArray[np.int64]
    centre_mm: Floats
    local_mm: Floats
    direction: Floats
    status: npt.NDArray[np.uint8]

    @property
    def origin_mm(self) -> Floats:
        """(N, 3) float64, the origins in the panel frame."""
        origin = self.local_mm.copy()
        origin[:, :2] += self.centre_mm
        return origin


@dataclass(frozen=True)
class Hits:
    """Where N rays from the world meet the panel: pixel (N, 2), lenslet passed (N, 2), status (N,)."""

    pixel: Floats
    lenslet: npt.NDArray[np.int64]
    status: npt.NDArray[np.uint8]


def backend_of(engine: Engine, device: str = "llvm") -> Backend:
    """Return the array library of an engine.

    Raises
    ------
    InputError
        For an unknown engine.
    MissingLibraryError
        When Dr.Jit or the libLLVM that it needs cannot be loaded.
    """
    if engine == "golden":
        return NumpyBackend()
    if engine == "fast":
        try:
            backend = DrJitBackend(device)
            backend.real(0.0)
        except (ImportError, RuntimeError) as error:
            raise MissingLibraryError(
                f"the fast engine cannot start ({' '.join(str(error).split())}); run make setup, which installs libLLVM"
            ) from None
        return backend
    if engine in ENGINES:
        raise InputError(f"engine {engine} traces from the panel to the world only; choose from golden, fast")
    raise InputError(f"unknown engine '{engine}'; choose from {', '.join(ENGINES)}")


def _check_model(model: str) -> None:
    if model not in MODELS:
        raise InputError(f"unknown model '{model}'; choose from {', '.join(MODELS)}")


def _columns(name: str, values: npt.ArrayLike, width: int, most: float) -> Floats:
    """Return values as (N, width); refuse others, and those beyond `most`."""
    array = np.asarray(values, np.float64)
    if array.ndim != 2 or array.shape[1] != width:
        raise InputError(f"{name} has shape {array.shape}; give (N, {width})")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds values that are not finite; remove them")
    if (np.abs(array) > most).any():
        raise InputError(f"{name} holds values beyond {most:.6g}, where no lenslet stands; remove them")
    return array


def trace(
    display: Display,
    pixels: npt.ArrayLike,
    aperture: npt.ArrayLike | None = None,
    model: Model = "exact",
    engine: Engine = "golden",
    device: str = "llvm",
    fraction_bits: int | None = None,
) -> Rays:
    """Trace rays from the panel through the lenslets.

    Parameters
    ----------
    display
        The display.
    pixels
        (N, 2) pixel coordinates; (c + 0.5, r + 0.5) is the centre of pixel (c, r).
    aperture
        (N, 2) points that the rays aim at, lens-local, mm, array's axes; left out, chief rays.
    model
        "pinhole", "thin", "paraxial" or "exact".
    engine
        "golden", "fast", "twin" (the RTL's fixed point in integers) or "rtl" (the RTL itself, simulated).
    device
        Of the fast engine: "llvm" (CPU) or "cuda".
    fraction_bits
        Of twin and rtl: F, 14 to 23; the widest when left out.

    Raises
    ------
    InputError
        For wrong shapes, values that are not finite or beyond `FARTHEST_LENSLETS`, an unknown model or engine; for a
        display that the formats of twin and rtl cannot hold.
    MissingLibraryError
        When an engine lacks a library or a tool.
    """
    _check_model(model)
    array, panel = display.array, display.panel
    farthest = FARTHEST_LENSLETS * array.pitch_mm
    if max(abs(x) for x in array.offset_mm) > farthest:
        raise InputError(f"array.offset_mm is beyond {farthest:.6g}; bring the array nearer to the panel")
    pixel = _columns("pixels", pixels, 2, farthest / panel.pixel_pitch_mm)
    chosen = None
    if aperture is not None:
        chosen = _columns("aperture", aperture, 2, farthest)
        if len(chosen) != len(pixel):
            raise InputError(f"aperture has {len(chosen)} rows for {len(pixel)} pixels; give one each")
    if engine in ("twin", "rtl"):
        return _trace_fixed(display, pixel, chosen, model, engine, fraction_bits)
    b = backend_of(engine, device)
    if not len(pixel):
        b = NumpyBackend()  # Dr.Jit does not compute with empty arrays
    u, v = b.double(pixel[:, 0]), b.double(pixel[:, 1])
    points = None if chosen is None else (b.double(chosen[:, 0]), b.double(chosen[:, 1]))
    out = rays_from_pixels(b, System.of(display), u, v, points, model)
    n = len(pixel)
    return Rays(
        pixel=pixel,
        lenslet=_stack(n, out.i, out.j).astype(np.int64),
        centre_mm=_stack(n, out.centre_x, out.centre_y),
        local_mm=_stack(n, out.ray.x, out.ray.y, out.ray.z),
        direction=_stack(n, out.ray.dx, out.ray.dy, out.ray.dz),
        status=np.broadcast_to(np.asarray(out.status), (n,)).astype(np.uint8),
    )


def _trace_fixed(
    display: Display, pixel: Floats, aperture: Floats | None, model: Model, engine: Engine, fraction_bits: int | None
) -> Rays:
    """Trace through the twin or the RTL; both build on this module, so they are imported when asked for."""
    from lippmann.fixed.ray_pipeline import ray_pipeline
    from lippmann.fixed.trace import WIDEST, trace_fixed
    from lippmann.sim.harness import rtl_pipeline

    pipeline = ray_pipeline if engine == "twin" else rtl_pipeline
    return trace_fixed(display, pixel, aperture, model, fraction_bits or WIDEST, pipeline)


def trace_to_panel(
    display: Display,
    origin_mm: npt.ArrayLike,
    direction: npt.ArrayLike,
    model: Model = "exact",
    engine: Engine = "golden",
    device: str = "llvm",
) -> Hits:
    """Trace rays from the world, (N, 3) origins in mm and (N, 3) unit directions, to the panel.

    A ray flatter than `FLATTEST`, or that meets the array's plane beyond `FARTHEST_LENSLETS`, has missed. Raises as
    `trace` does, and for directions that are not of length 1.
    """
    _check_model(model)
    b = backend_of(engine, device)
    origin, way = _columns("origin_mm", origin_mm, 3, LENGTHS["at_most"]), _columns("direction", direction, 3, math.inf)
    if (np.abs(np.linalg.norm(way, axis=1) - 1.0) > UNIT_ERROR).any():
        raise InputError("direction holds vectors that are not of length 1; divide them by their lengths")
    if not len(origin):
        b = NumpyBackend()  # as above
    hits = pixels_from_rays(
        b,
        System.of(display),
        tuple(b.double(origin[:, k]) for k in range(3)),
        tuple(b.double(way[:, k]) for k in range(3)),
        model,
    )
    n = len(origin)
    return Hits(
        pixel=_stack(n, hits.u, hits.v),
        lenslet=_stack(n, hits.i, hits.j).astype(np.int64),
        status=np.broadcast_to(np.asarray(hits.status), (n,)).astype(np.uint8),
    )


def _stack(n: int, *columns: Arr) -> Floats:
    """Gather an engine's arrays (or constants) as the columns of one (n, k) float64 array."""
    return np.stack([np.broadcast_to(np.asarray(c, np.float64), (n,)) for c in columns], axis=1)
