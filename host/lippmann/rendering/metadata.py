"""What an integral image tells of itself."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from lippmann import __version__
from lippmann.display import Display
from lippmann.fixed.words import WIDEST
from lippmann.optics.rays import Engine
from lippmann.rendering.renderer import Settings


def image_metadata(
    display: Display,
    model: str,
    settings: Settings,
    scene_path: str | Path,
    engine: Engine = "fast",
    fraction_bits: int | None = None,
) -> dict[str, str]:
    """Return what an image carries: display, identity, model, engine, seed, settings, versions."""
    bits = {} if engine in ("golden", "fast") else {"fraction_bits": str(fraction_bits or WIDEST)}
    return {
        "display": display.name,
        "identity": display.identity,
        "model": model,
        "engine": engine,
        **bits,
        "aperture": settings.aperture,
        "integrator": settings.integrator,
        "samples": str(settings.samples),
        "max_depth": str(settings.max_depth),
        "seed": str(settings.seed),
        "scene": Path(scene_path).name,
        "version": __version__,
        "mitsuba": metadata.version("mitsuba"),
        "drjit": metadata.version("drjit"),
    }
