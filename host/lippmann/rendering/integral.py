"""Integral images: the options of a render, and the render that returns an `IntegralImage`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Literal

import numpy as np

from lippmann import __version__
from lippmann.base.progress import Progress
from lippmann.base.provenance import pixel_versions
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.fixed.words import WIDEST
from lippmann.optics.model_choice import TOLERANCE, choose_model
from lippmann.optics.rays import ENGINES, MODELS, Engine, Model
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.remarks import remarks
from lippmann.rendering.renderer import Renderer, Settings, render_integral
from lippmann.rendering.sources import display_source
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene

ModelOption = Literal["auto", Model]
MODEL_OPTIONS: tuple[ModelOption, ...] = ("auto", *MODELS)


@dataclass(frozen=True)
class RenderOptions:
    """Lens model, engine and settings of a render."""

    #: "auto": the cheapest whose error stays below `tolerance` (see `lippmann.optics.model_choice`).
    model: ModelOption = "auto"
    #: Error that "auto" allows, pixels of the reconstructed view.
    tolerance: float = TOLERANCE
    #: What traces the rays through the lenslets.
    engine: Engine = "fast"
    #: Word length of the engines twin and rtl; None: the longest.
    fraction_bits: int | None = None
    #: Samples, aperture, integrator, seed.
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        """Refuse unknown names, and a word length for an engine that has none."""
        for what, name, names in (("model", self.model, MODEL_OPTIONS), ("engine", self.engine, ENGINES)):
            if name not in names:
                raise InputError(f"unknown {what} '{name}'; choose from {', '.join(names)}")
        if self.fraction_bits is not None and self.engine in ("golden", "fast"):
            raise InputError(f"fraction bits belong to the engines twin and rtl; leave them out with {self.engine}")


def chosen_model(
    scene: Scene, display: Display, options: RenderOptions, note: Callable[[str], None] | None = None
) -> Model:
    """Return the lens model of a render; `note` is called with remarks, and which model "auto" chose.

    Raises InputError as `choose_model`.
    """
    settings = options.settings
    if note is not None:
        for remark in remarks(scene, display, settings, options.engine):
            note(remark)
    if options.model != "auto":
        return options.model
    choice = choose_model(display, scene.depth_range_mm, settings.aperture, options.tolerance)
    if note is not None:
        note(str(choice))
    return choice.model


def render_image(
    scene: Scene,
    display: Display,
    options: RenderOptions,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
) -> IntegralImage:
    """Render the integral image of a loaded scene.

    `progress` is called with (tiles done, tiles in all), `note` with remarks: those of `remarks`, and which model was
    chosen.

    Raises InputError and MissingLibraryError as `render_integral` and `choose_model`.
    """
    settings, model = options.settings, chosen_model(scene, display, options, note)
    rendered = render_integral(scene, display, model, settings, progress, options.engine, options.fraction_bits, note)
    settings = replace(settings, shading=rendered.shading)
    carried = image_metadata(model, settings, scene.path, options.engine, options.fraction_bits)
    # Its own memory, for other threads (`radiance_of`).
    return IntegralImage(np.require(rendered.radiance, requirements="O"), display, carried, rendered.measured)


def renderer_of(
    scene: Scene, display: Display, options: RenderOptions, bands: Sequence[range] | None = None
) -> Renderer:
    """Return what renders the integral image of a loaded scene, not prepared yet; `bands` are as for `Renderer`.

    Raises InputError as `render_image`.
    """
    settings, model = options.settings, chosen_model(scene, display, options)
    source = display_source(display, model, settings.samples, settings.aperture, options.engine, options.fraction_bits)
    return Renderer(scene, source, settings, bands)


def pixels_identity(
    digest: str, placement: Placement, display: Display, options: RenderOptions, **others: object
) -> str:
    """Return the hash, 16 hexadecimal digits, of all that a picture's pixels depend on.

    `digest` is the scene's; `others` are what else they depend on, as JSON holds it.
    """
    given = asdict(options)
    del given["settings"]["memory_mb"]
    parts = {
        "scene": digest,
        "placement": asdict(placement),
        "display": display.identity,
        "options": given,
        "versions": list(pixel_versions().values()),
        **others,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def image_metadata(
    model: Model, settings: Settings, scene_path: Path, engine: Engine = "fast", fraction_bits: int | None = None
) -> dict[str, str]:
    """Return how an image was made, as metadata; `IntegralImage` adds the display."""
    bits = {} if engine in ("golden", "fast") else {"fraction_bits": str(fraction_bits or WIDEST)}
    return {
        "model": model,
        "engine": engine,
        **bits,
        "aperture": settings.aperture,
        "integrator": settings.integrator,
        "samples": str(settings.samples),
        "max_depth": str(settings.max_depth),
        "seed": str(settings.seed),
        "shading": settings.shading,
        "scene": scene_path.name,
        "version": __version__,
        "mitsuba": metadata.version("mitsuba"),
        "drjit": metadata.version("drjit"),
    }
