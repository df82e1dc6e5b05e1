"""The plan of a picture of layers: by it any process draws any of the picture's bands."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lippmann import __version__
from lippmann.base.images import Radiance
from lippmann.base.machine import processor_count
from lippmann.base.tones import decode
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.words import WIDEST
from lippmann.layers.layer_drawing import Filter, check_options, draw_golden, exit_lines, scene_build_of
from lippmann.layers.layers_folder import check_for_display
from lippmann.layers.stack import LayerStack
from lippmann.optics.rays import MODELS, Engine, Model
from lippmann.rendering.bands import bands_of
from lippmann.rendering.cache_key import pixels_identity
from lippmann.rendering.integral_image import metadata_of
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.plan import Plan
from lippmann.scenes.placement import Placement

#: What draws layers.
LAYER_ENGINES = ("golden", "twin", "rtl")


@dataclass(frozen=True, eq=False)
class LayerPlan(Plan):
    """The picture of layers for a display, as an engine draws it; its own `BandRenderer`."""

    stack: LayerStack
    filter: Filter
    name: str = "the layers"
    #: Nothing was open.
    choices: dict[str, str] = field(default_factory=dict)

    @cached_property
    def identity(self) -> str:
        """Hash of all that the pixels depend on, 16 hexadecimal digits."""
        digest = hashlib.sha256(repr(self.stack.background).encode())
        for layer in self.stack.layers:
            shape = layer.texels.shape, layer.depth_mm, layer.brightness, layer.visible
            digest.update(repr(shape).encode() + layer.matrix.tobytes())
            digest.update(layer.texels.tobytes() + layer.palette.tobytes())
        return pixels_identity(digest.hexdigest(), Placement(), self.display, self.options, filter=self.filter)

    @property
    def metadata(self) -> dict[str, str]:
        """What the picture's file carries."""
        return {
            "model": self.options.model,
            "engine": self.options.engine,
            "samples": str(self.rays),
            "filter": self.filter,
            "layers": str(len(self.stack.layers)),
            "version": __version__,
            **metadata_of(self.display),
        }

    def start(self, worker: str | None = None) -> LayerPlan:
        """Return the plan, which draws its bands itself."""
        return self

    def prepare(self) -> float:
        """Compile nothing."""
        return 0.0

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return the radiance (rows, width, 3) of a band; no sample is lost.

        That of "twin", the RTL's integers, and of "rtl", the RTL simulated, is of the panel's bytes. Raises InputError
        for what their registers cannot hold.
        """
        display, options, rows, model = self.display, self.options, self.bands[number], self.options.model
        assert model != "auto"
        if options.engine == "golden":
            lines = exit_lines(display, self.rays, model, rows)
            return draw_golden(display, self.stack, self.filter, self.rays, model, lines).astype(np.float32), []
        build = Build.of(display, model, WIDEST if options.fraction_bits is None else options.fraction_bits, aims=False)
        arguments = (display, build, self.stack, scene_build_of(self.stack, self.filter, self.rays), model)
        if options.engine == "twin":
            panel = draw(*arguments, rows=rows)
        else:
            from lippmann.simulation import harness  # not at the top: golden starts sooner without

            # The simulators run outside of Python's lock.
            panel = draw(*arguments, harness.rtl_pipeline, harness.rtl_scene, processor_count(), rows)
        return decode(panel / np.float64(255.0), display.panel.transfer), []


def plan_layers(
    stack: LayerStack,
    display: Display,
    filter: Filter = "nearest",
    samples: int = 1,
    model: Model = "exact",
    engine: Engine = "golden",
    fraction_bits: int | None = None,
    where: str = "layers",
) -> LayerPlan:
    """Return the plan of a picture of layers for a display; `where` names the layers in messages.

    `fraction_bits` is the optics' word length, the widest when left out. Raises InputError for an engine, filter, model
    or number of samples that does not draw layers, and for layers at or behind the display's eyes.
    """
    check_for_display(stack, display, where)
    check_options(filter, samples)
    if engine not in LAYER_ENGINES:
        raise InputError(f"layers are not drawn by engine '{engine}'; choose from {', '.join(LAYER_ENGINES)}")
    if model not in MODELS:
        raise InputError(f"unknown model '{model}'; choose from {', '.join(MODELS)}")
    bits = None if engine == "golden" else fraction_bits
    options = RenderOptions(model, engine=engine, fraction_bits=bits, settings=Settings(samples))
    bands = tuple(bands_of(display.panel.width_px, display.panel.height_px, samples, "llvm"))
    return LayerPlan(display, options, bands, stack, filter)
