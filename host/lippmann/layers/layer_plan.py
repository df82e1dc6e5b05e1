"""The plan of a picture of layers: by it any process draws any of the picture's bands."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lippmann import __version__
from lippmann.base.images import Radiance
from lippmann.display.description import Display
from lippmann.layers.layer_drawing import Filter, check_drawing, draw_layers
from lippmann.layers.layers_folder import check_for_display
from lippmann.layers.stack import LayerStack
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.bands import bands_of
from lippmann.rendering.cache_key import pixels_identity
from lippmann.rendering.integral_image import metadata_of
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.scenes.placement import Placement


@dataclass(frozen=True, eq=False)
class LayerPlan:
    """The picture of layers for a display, as an engine draws it."""

    stack: LayerStack
    display: Display
    filter: Filter
    model: Model
    engine: Engine
    fraction_bits: int | None
    settings: Settings
    bands: tuple[range, ...]
    name: str = "the layers"
    #: As a `BandRenderer`: nothing is compiled, and nothing was open.
    prepare_seconds: float = 0.0
    choices: dict[str, str] = field(default_factory=dict)

    @cached_property
    def identity(self) -> str:
        """Hash of all that the pixels depend on, 16 hexadecimal digits."""
        digest = hashlib.sha256(repr(self.stack.background).encode())
        for layer in self.stack.layers:
            shape = layer.texels.shape, layer.depth_mm, layer.brightness, layer.visible
            digest.update(repr(shape).encode() + layer.matrix.tobytes())
            digest.update(layer.texels.tobytes() + layer.palette.tobytes())
        options = RenderOptions(self.model, 1.0, self.engine, self.fraction_bits, self.settings)
        return pixels_identity(digest.hexdigest(), Placement(), self.display, options, filter=self.filter)

    @property
    def metadata(self) -> dict[str, str]:
        """What the picture's file carries."""
        return {
            "model": self.model,
            "engine": self.engine,
            "samples": str(self.rays),
            "filter": self.filter,
            "layers": str(len(self.stack.layers)),
            "version": __version__,
            **metadata_of(self.display),
        }

    @property
    def rays(self) -> int:
        """Rays for each pixel."""
        return self.settings.samples

    def start(self, worker: str | None = None) -> LayerPlan:
        """Return the plan, which draws its bands itself."""
        return self

    def prepare(self) -> float:
        """Compile nothing."""
        return 0.0

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return the radiance (rows, width, 3) of a band; no sample is lost.

        Raises InputError for what the engine's registers cannot hold.
        """
        light = draw_layers(
            self.display, self.stack, self.filter, self.rays, self.model, self.engine, self.fraction_bits,
            self.bands[number],
        )  # fmt: skip
        return light.astype(np.float32), []


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

    Raises InputError for an engine, filter, model or number of samples that does not draw layers, and for layers at or
    behind the display's eyes.
    """
    check_for_display(stack, display, where)
    check_drawing(filter, samples, model, engine)
    if engine == "golden":
        fraction_bits = None
    panel = display.panel
    bands = tuple(bands_of(panel.width_px, panel.height_px, samples, "llvm"))
    return LayerPlan(stack, display, filter, model, engine, fraction_bits, Settings(samples), bands)
