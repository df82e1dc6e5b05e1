"""One function over the four engines: display, pixels, aperture points, model and engine; rays come out.

Golden and fast share `lippmann.optics.pixel_rays`; twin and RTL share `lippmann.fixed.conversion`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from lippmann.display import MAX_LENGTH_MM, Display
from lippmann.errors import InputError, MissingLibraryError
from lippmann.fixed.conversion import trace_fixed
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import WIDEST
from lippmann.optics.backend import Arr, Backend, DrJitBackend, NumpyBackend
from lippmann.optics.pixel_rays import FARTHEST_LENSLETS, pixels_from_rays, rays_from_pixels
from lippmann.optics.rays import ENGINES, MODELS, Engine, Floats, Hits, Model, Rays
from lippmann.optics.system import System
from lippmann.sim.harness import rtl_pipeline

#: How far the length of a direction may be from 1: small steps aside of a unit vector pass, slopes do not.
UNIT_ERROR = 1e-3


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
    origin, way = _columns("origin_mm", origin_mm, 3, MAX_LENGTH_MM), _columns("direction", direction, 3, math.inf)
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
