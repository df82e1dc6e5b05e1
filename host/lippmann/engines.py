"""Engines of `trace`: golden and fast use `optics.trace`; twin and rtl use `trace_fixed`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import pixels_of_words, rays_of_words, words_of_aims, words_of_pixels
from lippmann.fixed.ray_pipeline import Pipeline, ray_pipeline
from lippmann.fixed.words import WIDEST, Ints
from lippmann.optics.rays import Engine, Floats, Model, Rays, check_fraction_bits
from lippmann.optics.trace import check_engine_device, checked_rays, trace_optics

#: Fixed-point words (N,) of pixels (u, v) and of aperture points (a, b).
Words = tuple[Ints, Ints, Ints, Ints]


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

    Raises InputError for a wrong shape, a value that is not finite or beyond
    `FARTHEST_LENSLETS`, an unknown model, engine or device, and a display outside the
    number formats of twin and rtl. Raises MissingLibraryError if an engine's library
    or tool is missing.

    Parameters
    ----------
    display, pixels
        Display: a file or a result of `load_display`. Pixels: (N, 2) coordinates, also
        outside the panel. The centre of pixel (c, r) is (c + 0.5, r + 0.5).
    aperture
        (N, 2) points at which the rays aim, mm, in the array's axes from the lenslet's
        centre. `None` selects chief rays.
    model, engine
        The model is "pinhole", "thin", "paraxial" or "exact". The engine is "golden",
        "fast", "twin" (the RTL's integers) or "rtl" (a simulation of the RTL).
    device, fraction_bits
        The engine fast runs on "llvm" (CPU), "cuda" (GPU) or "auto" (a GPU if present).
        Twin and rtl use 14 to 23 fraction bits; `None` means the maximum.
    """
    check_engine_device(engine, device)
    if engine in ("twin", "rtl"):
        from lippmann.simulation.harness import rtl_pipeline  # late import for a fast start of renders

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
    """Trace rays through a fixed-point pipeline; the result's `pixel` is rounded to 1/16 pixel.

    The parameters are those of `trace`. Raises InputError for a value outside the number formats.
    """
    build = Build.of(display, model, fraction_bits, aperture is not None, max_cell_steps)
    words, registers = words_of_rays(display, build, model, pixels, aperture)
    rays = pipeline(*words, registers, build)
    return rays_of_words(display, pixels_of_words(display, *words[:2]), rays, fraction_bits)


def words_of_rays(
    display: Display, build: Build, model: Model, pixels: Floats, aperture: Floats | None = None
) -> tuple[Words, Configuration]:
    """Convert rays to the words u, v, a, b and a build's registers.

    Raises the errors of `trace_fixed`.
    """
    reach = None if aperture is None or not len(aperture) else float(np.hypot(*aperture.T).max())
    registers = configuration(display, build, model, reach)
    u, v = words_of_pixels(display, pixels)
    if aperture is None or not build.aims:
        return (u, v, np.zeros_like(u), np.zeros_like(u)), registers
    return (u, v, *words_of_aims(display, aperture, build.fraction_bits)), registers
