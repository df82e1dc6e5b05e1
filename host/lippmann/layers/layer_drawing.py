"""Draws layers in float64, as the golden model of the FPGA's drawing.

A pixel's exit ray meets each layer's plane. The texels that it meets are composited
from front to back in linear light. Then the pixel's samples are averaged, and the
panel's transfer curve is applied. Rays that do not leave the lenslets are black.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from numbers import Integral
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from lippmann import __version__
from lippmann.base.images import Radiance
from lippmann.base.machine import processor_count
from lippmann.base.tones import decode, encoded_values
from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.errors import InputError, check_choice, input_error
from lippmann.fixed.build import Build
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import BLOCK_BYTES, MAX_TEXEL_BLOCKS, SceneBuild
from lippmann.fixed.words import WIDEST
from lippmann.layers.layers_and_pictures import check_for_display
from lippmann.layers.stack import Bytes, Floats, Layer, LayerStack, light_of, opacity_of
from lippmann.optics.rays import MODELS, Bools, Engine, Model, gets_through
from lippmann.rendering.integral_image import metadata_of
from lippmann.rendering.memory_estimate import bands_of
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.picture_hash import pixels_identity
from lippmann.rendering.plan import Plan
from lippmann.scenes.placement import Placement

Filter = Literal["nearest", "bilinear"]
FILTERS: tuple[Filter, ...] = get_args(Filter)
LAYER_ENGINES = ("golden", "twin", "rtl")
#: Sample positions relative to a pixel's centre, px, keyed by the number of samples.
SAMPLES = {
    1: ((0.0, 0.0),),
    2: ((-0.25, -0.25), (0.25, 0.25)),
    4: ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)),
}
#: Maximum slope, |dx/dz| and |dy/dz|, of a ray; pixels of steeper rays are black.
MAX_SLOPE = 4.0
#: Minimum texels in a row of a board's slot.
MIN_ROW = 32
#: Maximum bits of a panel value that a board sends.
BOARD_BITS = 8
CHUNK_RAYS = 1 << 18


class ExitLines(NamedTuple):
    """Exit rays: points at z = 0, mm (N, 2), slopes (N, 2), and the mask (N,) of rays that are not black."""

    places_mm: Floats
    slopes: Floats
    draws: Bools


def draw_golden(
    display: Display,
    stack: LayerStack,
    filter: Filter = "nearest",
    samples: int = 1,
    model: Model = "exact",
    lines: Iterable[ExitLines] | None = None,
) -> Floats:
    """Draw layers for a display, ignoring sub-pixels; return linear light (height, width, 3).

    `lines` are the display's exit rays (`exit_lines`), or the exit rays of the rows to
    draw. Raises InputError for a filter or a number of samples that no board has.
    """
    check_options(filter, samples)
    lines = exit_lines(display, samples, model) if lines is None else lines
    light = np.concatenate([composite(stack, some, filter) for some in lines])
    return np.asarray(light.reshape(-1, display.panel.width_px, samples, 3).mean(axis=2))


def scene_build_of(stack: LayerStack, filter: Filter, samples: int) -> SceneBuild:
    """Return the smallest build that draws a stack; refuse a layer too large for all builds."""
    widest = max(MIN_ROW, *(layer.width for layer in stack.layers))
    width = 1 << (widest - 1).bit_length()
    step = max(2, BLOCK_BYTES // width)
    height = -(-max(layer.height for layer in stack.layers) // step) * step
    try:
        return SceneBuild(len(stack.layers), None, width, height, filter == "bilinear", samples)
    except InputError:
        number, layer = max(enumerate(stack.layers), key=lambda one: one[1].width * one[1].height)
        what = f"{layer.width} x {layer.height} texels need slots of {width} x {height}, larger than a board can have"
        remedy = f"shrink the layers to slots of at most {MAX_TEXEL_BLOCKS * BLOCK_BYTES} texels"
        raise input_error(f"layers: layer[{number}]", what, f"{remedy}, or use the engine golden") from None


def check_options(filter: str, samples: object) -> None:
    """Refuse a filter or a number of samples that no board has."""
    check_choice("filter", filter, FILTERS)
    if isinstance(samples, bool) or not isinstance(samples, Integral) or samples not in SAMPLES:
        numbers = f"{', '.join(map(str, SAMPLES))} samples a pixel"
        raise InputError(f"layers are drawn with {numbers}, not {samples!r}; give one of these integers")


def panel_bytes(display: Display, light: npt.NDArray[np.floating]) -> Bytes:
    """Convert linear light (..., 3) to a panel's values, scaled to 8 bits."""
    panel = display.panel
    return encoded_values(light, panel.transfer, min(panel.bits, BOARD_BITS)).astype(np.uint8)


def exit_lines(
    display: Display, samples: int = 1, model: Model = "exact", drawn_rows: range | None = None
) -> Iterator[ExitLines]:
    """Yield the exit rays of all rows or of `drawn_rows`, ordered by pixel, then by sample."""
    width = display.panel.width_px
    rows = max(1, CHUNK_RAYS // (width * samples))
    drawn_rows = range(display.panel.height_px) if drawn_rows is None else drawn_rows
    for first in range(drawn_rows.start, drawn_rows.stop, rows):
        v, u = np.mgrid[first : min(first + rows, drawn_rows.stop), :width] + 0.5
        pixels = (np.stack([u, v], axis=-1)[:, :, None] + np.array(SAMPLES[samples])).reshape(-1, 2)
        rays = trace(display, pixels, model=model)
        draws = np.asarray(gets_through(rays.status))
        origin, direction, exits = rays.origin_mm, rays.direction, draws[:, None]
        slopes = np.where(exits, direction[:, :2] / np.where(exits, direction[:, 2:], 1.0), 0.0)
        places_mm = np.where(exits, origin[:, :2] - origin[:, 2:] * slopes, 0.0)
        yield ExitLines(places_mm, slopes, draws & (abs(slopes) <= MAX_SLOPE).all(axis=1))


def composite(stack: LayerStack, lines: ExitLines, filter: Filter) -> Floats:
    """Return the linear light (N, 3) of rays through a stack."""
    light, through = np.zeros((len(lines.draws), 3)), np.ones(len(lines.draws))
    for layer in stack.layers:
        if layer.visible:
            s, t = texel_coordinates(layer, lines)
            colour, opacity = (_bilinear if filter == "bilinear" else _texels)(layer, s, t)
            light += (through * layer.brightness)[:, None] * colour
            through *= 1.0 - opacity
    light += through[:, None] * stack.background
    return np.where(lines.draws[:, None], light, 0.0)


def texel_coordinates(layer: Layer, lines: ExitLines) -> tuple[Floats, Floats]:
    """Return the texel coordinates where rays meet a layer."""
    x, y = (lines.slopes if layer.sky else lines.places_mm + layer.depth_mm * lines.slopes).T
    (a, b, s0), (c, d, t0) = layer.matrix
    return a * x + b * y + s0, c * x + d * y + t0


def _bilinear(layer: Layer, s: Floats, t: Floats) -> tuple[Floats, Floats]:
    column, row = np.floor(s - 0.5), np.floor(t - 0.5)
    across, down = s - 0.5 - column, t - 0.5 - row
    light, opacity = np.zeros((len(s), 3)), np.zeros(len(s))
    for j, height in ((row, 1.0 - down), (row + 1, down)):
        for i, width in ((column, 1.0 - across), (column + 1, across)):
            one_light, one_opacity = _texels(layer, i, j)
            light += (width * height)[:, None] * one_light
            opacity += width * height * one_opacity
    return light, opacity


def _texels(layer: Layer, s: Floats, t: Floats) -> tuple[Floats, Floats]:
    """Return premultiplied light (N, 3) and opacity (N,) of the texels at s, t; 0 outside the texture."""
    inside = (s >= 0.0) & (s < layer.width) & (t >= 0.0) & (t < layer.height)
    column, row = (np.where(inside, place, 0.0).astype(np.int64) for place in (s, t))
    index = layer.texels[row, column]
    opacity = np.where(inside, opacity_of(layer.palette[:, 3])[index], 0.0)
    return opacity[:, None] * light_of(layer.palette[:, :3])[index], opacity


@dataclass(frozen=True, eq=False)
class LayerPlan(Plan):
    """The plan of a picture that is drawn from layers, and the renderer of its bands."""

    stack: LayerStack
    filter: Filter
    name: str = "the layers"
    choices: dict[str, str] = field(default_factory=dict)

    @functools.cached_property
    def identity(self) -> str:
        """Hash of all inputs that determine the pixels."""
        digest = hashlib.sha256(repr(self.stack.background).encode())
        for layer in self.stack.layers:
            shape = layer.texels.shape, layer.depth_mm, layer.brightness, layer.visible
            digest.update(repr(shape).encode() + layer.matrix.tobytes())
            digest.update(layer.texels.tobytes() + layer.palette.tobytes())
        return pixels_identity(digest.hexdigest(), Placement(), self.display, self.options, filter=self.filter)

    @property
    def metadata(self) -> dict[str, str]:
        """The metadata of the picture's file."""
        options, count = self.options, str(len(self.stack.layers))
        choices = {"model": options.model, "engine": options.engine, "samples": str(self.rays), "filter": self.filter}
        return {**choices, "layers": count, "version": __version__, **metadata_of(self.display)}

    def start(self, worker: str | None = None) -> LayerPlan:
        """Return the plan, which draws its bands itself."""
        return self

    def prepare(self) -> float:
        """Return 0, because layers need no compilation."""
        return 0.0

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return a band's radiance (rows, width, 3), and no lost samples.

        The engines "twin" (integer model) and "rtl" (simulated RTL) draw bytes, decoded
        to radiance. Raises InputError for values outside registers' ranges.
        """
        display, options, rows = self.display, self.options, self.bands[number]
        model = options.model
        assert model != "auto"

        if options.engine == "golden":
            lines = exit_lines(display, self.rays, model, rows)
            return draw_golden(display, self.stack, self.filter, self.rays, model, lines).astype(np.float32), []
        build = Build.of(display, model, WIDEST if options.fraction_bits is None else options.fraction_bits, aims=False)
        args = (display, build, self.stack, scene_build_of(self.stack, self.filter, self.rays), model)
        if options.engine == "twin":
            panel = draw(*args, rows=rows)
        else:
            from lippmann.simulation import harness  # needed only for rtl

            # The simulators run outside Python's global lock.
            panel = draw(*args, harness.rtl_pipeline, harness.rtl_scene, processor_count(), rows)
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

    `fraction_bits` of the optics default to the maximum. Raises InputError for an
    unsupported engine, filter, model or number of samples, and for layers at or behind
    the eyes.
    """
    check_for_display(stack, display, where)
    check_options(filter, samples)
    check_choice("engine", engine, LAYER_ENGINES)
    check_choice("model", model, MODELS)
    options = RenderOptions(model, engine=engine, fraction_bits=fraction_bits, settings=Settings(samples))
    bands = tuple(bands_of(*display.panel.size_px, samples, "llvm"))
    return LayerPlan(display, options, bands, stack, filter)
