"""The four engines: `trace` takes a display, pixels, aperture points, a model and an engine, and returns rays.

Golden and fast share `lippmann.optics.pixel_rays`; twin and RTL share `trace_fixed`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.display import MAX_LENGTH_MM, Display, display_at
from lippmann.errors import InputError, MissingLibraryError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import pixels_of_words, rays_of_words, words_of_aims, words_of_pixels
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import WIDEST, Ints
from lippmann.optics.backend import Arr, Backend, DrJitBackend, NumpyBackend
from lippmann.optics.pixel_rays import FARTHEST_LENSLETS, LocalRays, PixelHits, pixels_from_rays, rays_from_pixels
from lippmann.optics.rays import ENGINES, MODELS, Engine, Floats, Hits, Model, Rays
from lippmann.optics.system import System

#: Largest error of a direction's length: a unit vector with a small step added passes, a slope does not.
UNIT_ERROR = 1e-3
#: A run of a build: words of pixels and aperture points to words of rays.
Pipeline = Callable[[Ints, Ints, Ints, Ints, Configuration, Build], FixedRays]


def backend_of(engine: Engine, device: str = "llvm") -> Backend:
    """Return the array library of an engine.

    Raises InputError for an engine that has none, and MissingLibraryError when Dr.Jit or libLLVM cannot be loaded.
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
    """Return values as (N, width) float64; refuse other shapes, and values that are not finite or beyond `most`."""
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} is not an array of numbers; give shape (N, {width})") from None
    if array.ndim != 2 or array.shape[1] != width:
        raise InputError(f"{name} has shape {array.shape}; give (N, {width})")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds values that are not finite; remove them")
    if (np.abs(array) > most).any():
        raise InputError(f"{name} holds values beyond {most:.6g}, outside every array; remove them")
    return array


def trace(
    display: str | Path | Display,
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
        A display file, or what `load_display` returned.
    pixels
        (N, 2) pixel coordinates; (c + 0.5, r + 0.5) is the centre of pixel (c, r). Beyond its edges the panel goes on.
    aperture
        (N, 2) aperture points that the rays aim at, lens-local, mm, array's axes; left out, chief rays.
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
    display = display_at(display)
    array, panel = display.array, display.panel
    farthest = FARTHEST_LENSLETS * array.finest_mm
    if max(abs(x) for x in array.offset_mm) > farthest:
        raise InputError(f"array.offset_mm is beyond {farthest:.6g}; bring the array nearer to the panel")
    pixel = _columns("pixels", pixels, 2, farthest / panel.coarsest_mm)
    points = None if aperture is None else _columns("aperture", aperture, 2, farthest)
    if points is not None and len(points) != len(pixel):
        raise InputError(f"aperture has {len(points)} rows for {len(pixel)} pixels; give one each")
    if engine in ("twin", "rtl"):
        from lippmann.sim.harness import rtl_pipeline  # not at the top: a render without it starts sooner

        pipeline = ray_pipeline if engine == "twin" else rtl_pipeline
        return trace_fixed(display, pixel, points, model, fraction_bits or WIDEST, pipeline)
    b = _backend_for(len(pixel), engine, device)
    aims = None if points is None else (b.double(points[:, 0]), b.double(points[:, 1]))
    out = rays_from_pixels(b, System.of(display), b.double(pixel[:, 0]), b.double(pixel[:, 1]), aims, model)
    return rays_of(pixel, out)


def trace_fixed(
    display: Display,
    pixels: Floats,
    aperture: Floats | None,
    model: Model,
    fraction_bits: int = WIDEST,
    pipeline: Pipeline = ray_pipeline,
    max_cell_steps: int | None = None,
) -> Rays:
    """Trace rays through a fixed-point pipeline: the twin, unless another is given (parameters as in `trace`).

    Pixel coordinates are rounded to 1/16 pixel; `pixel` of the result holds the rounded ones. Raises InputError for a
    display, pixels or aperture points that the formats cannot hold.
    """
    build = Build.of(display, model, fraction_bits, aperture is not None, max_cell_steps)
    reach = None if aperture is None or not len(aperture) else float(np.hypot(*aperture.T).max())
    registers = configuration(display, build, model, reach)
    u, v = words_of_pixels(display, pixels)
    a = b = np.zeros_like(u)
    if aperture is not None and build.aims:
        a, b = words_of_aims(display, aperture, fraction_bits)
    rays = pipeline(u, v, a, b, registers, build)
    return rays_of_words(display, pixels_of_words(display, u, v), rays, fraction_bits)


def trace_to_panel(
    display: str | Path | Display,
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
    origins = _columns("origin_mm", origin_mm, 3, MAX_LENGTH_MM)
    directions = _columns("direction", direction, 3, math.inf)
    if (np.abs(np.linalg.norm(directions, axis=1) - 1.0) > UNIT_ERROR).any():
        raise InputError("direction holds vectors that are not of length 1; divide them by their lengths")
    n = len(origins)
    b = _backend_for(n, engine, device)
    origin, unit = (tuple(b.double(column) for column in array.T.copy()) for array in (origins, directions))
    hits = pixels_from_rays(b, System.of(display_at(display)), origin, unit, model)
    return hits_of(n, hits)


def _backend_for(n: int, engine: Engine, device: str) -> Backend:
    """Return the backend of an engine for n rays: numpy for none, since Dr.Jit does not compute with empty arrays."""
    backend = backend_of(engine, device)
    return backend if n else NumpyBackend()


def rays_of(pixel: Floats, out: LocalRays, number: npt.DTypeLike = np.float64) -> Rays:
    """Return the traced rays of pixel coordinates (N, 2) as numpy arrays, their reals in the type `number`."""
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
    """Return the hits of n rays as numpy arrays, their reals in the type `number`."""
    status = _stack(n, np.uint8, hits.status)[:, 0]
    return Hits(_stack(n, number, hits.u, hits.v), _stack(n, np.int64, hits.i, hits.j), status)


def _stack(n: int, number: npt.DTypeLike, *columns: Arr) -> Any:
    """Gather an engine's arrays (or constants) as the columns of one (n, k) array of a type."""
    gathered = np.empty((n, len(columns)), number)
    for k, column in enumerate(columns):
        gathered[:, k] = np.asarray(column)
    return gathered
