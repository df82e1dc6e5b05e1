"""Defines and checks the options of a render, such as lens model, engine and samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from lippmann.errors import InputError, as_number, check_choice, whole_number
from lippmann.optics.model_choice import TOLERANCE, check_tolerance
from lippmann.optics.rays import ENGINES, MODELS, Engine, Model, check_fraction_bits
from lippmann.rendering.sampling import APERTURES, Aperture

Shading = Literal["auto", "each", "shared"]
SHADINGS: tuple[Shading, ...] = get_args(Shading)
MAX_SAMPLES = 65536


@dataclass(frozen=True)
class Settings:
    """Settings of the renderer."""

    #: Samples per (sub-)pixel. A single sample is at the centre, several fill the area.
    samples: int = 1
    #: Rays pass through a lenslet's centre ("chief") or its whole cell ("full").
    aperture: Aperture = "chief"
    #: Integrator's name ("lights" or Mitsuba's), or "scene" for the file's integrator.
    integrator: str = "lights"
    #: Maximum surfaces that a ray meets.
    max_depth: int = 4
    #: Random seed; the same seed, machine and versions give the same pixels.
    seed: int = 0
    #: Memory limit, MB. None means 80 % of the free memory.
    memory_mb: float | None = None
    #: Diffuse light is from an irradiance cache ("shared") or computed per ray ("each").
    #: "auto" uses the cache if it is faster and a trial finds it accurate.
    shading: Shading = "auto"
    #: Maximum points of the cache. None means 2^22, or fewer with shading "auto".
    light_points: int | None = None

    def __post_init__(self) -> None:
        for name, low, high in (("samples", 1, MAX_SAMPLES), ("max_depth", 1, 1000), ("seed", 0, 2**32 - 1)):
            object.__setattr__(self, name, whole_number(name.replace("_", " "), getattr(self, name), low, high))
        check_choice("aperture", self.aperture, APERTURES)
        check_choice("shading", self.shading, SHADINGS)
        if not isinstance(self.integrator, str):
            raise InputError(f"unknown integrator '{self.integrator}'; choose lights, direct, path or scene")
        if self.memory_mb is not None and not as_number(self.memory_mb) > 0.0:
            raise InputError(f"memory_mb {self.memory_mb} is not a limit; give a number above 0")


ModelOption = Literal["auto", Model]
MODEL_OPTIONS: tuple[ModelOption, ...] = ("auto", *MODELS)


@dataclass(frozen=True)
class RenderOptions:
    """Lens model, engine and settings of a render."""

    #: Lens model. "auto" chooses the fastest model with an error below `tolerance`.
    model: ModelOption = "auto"
    #: Maximum error for the model "auto", in pixels of the reconstructed view.
    tolerance: float = TOLERANCE
    #: Engine that traces the rays through the lenslets.
    engine: Engine = "fast"
    #: Fraction bits in words of the engines twin and rtl; `None` means the maximum.
    fraction_bits: int | None = None
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        check_choice("model", self.model, MODEL_OPTIONS)
        check_choice("engine", self.engine, ENGINES)
        check_tolerance(self.tolerance)
        check_fraction_bits(self.fraction_bits, self.engine)
