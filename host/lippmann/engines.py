"""The four engines: `trace` takes a display, pixels, aperture points, a model and an engine, and returns rays.

Golden and fast share `lippmann.optics.trace`; twin and RTL share `trace_fixed`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import pixels_of_words, rays_of_words, words_of_aims, words_of_pixels
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import WIDEST, Ints
from lippmann.optics.rays import Engine, Floats, Model, Rays, check_fraction_bits
from lippmann.optics.trace import checked_rays, trace_optics

#: Words of pixels u, v and of aperture points a, b, (N,) each.
Words = tuple[Ints, Ints, Ints, Ints]
#: A run of a build: words of pixels and aperture points to words of rays.
Pipeline = Callable[[Ints, Ints, Ints, Ints, Configuration, Build], FixedRays]


def trace(
    display: str | Path | Display,
    pixels: npt.ArrayLike,
    aperture: npt.ArrayLike | None = None,
    model: Model = "exact",
    engine: Engine = "golden",
    device: str = "auto",
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
        Of the fast engine: "llvm" (CPU), "cuda" (GPU) or "auto", the GPU when there is one.
    fraction_bits
        Of twin and rtl alone: F, 14 to 23; the widest when left out.

    Raises
    ------
    InputError
        For wrong shapes, values that are not finite or beyond `FARTHEST_LENSLETS`, an unknown model, engine or
        device; for a display that the formats of twin and rtl cannot hold.
    MissingLibraryError
        When an engine lacks a library or a tool.
    """
    if engine in ("twin", "rtl"):
        from lippmann.simulation.harness import rtl_pipeline  # not at the top: a render without it starts sooner

        display, pixel, points = checked_rays(display, pixels, aperture, model)
        pipeline = ray_pipeline if engine == "twin" else rtl_pipeline
        f = WIDEST if fraction_bits is None else fraction_bits
        return trace_fixed(display, pixel, points, model, f, pipeline)
    check_fraction_bits(fraction_bits, engine)
    return trace_optics(display, pixels, aperture, model, engine, device)


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
    words, registers = words_of_rays(display, build, model, pixels, aperture)
    rays = pipeline(*words, registers, build)
    return rays_of_words(display, pixels_of_words(display, *words[:2]), rays, fraction_bits)


def words_of_rays(
    display: Display, build: Build, model: Model, pixels: Floats, aperture: Floats | None = None
) -> tuple[Words, Configuration]:
    """Return what a pipeline of a build takes for rays: their words u, v, a, b, and the registers.

    Raises InputError as `trace_fixed` does.
    """
    reach = None if aperture is None or not len(aperture) else float(np.hypot(*aperture.T).max())
    registers = configuration(display, build, model, reach)
    u, v = words_of_pixels(display, pixels)
    if aperture is None or not build.aims:
        return (u, v, np.zeros_like(u), np.zeros_like(u)), registers
    return (u, v, *words_of_aims(display, aperture, build.fraction_bits)), registers
