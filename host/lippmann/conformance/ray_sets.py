"""Define ray sets as numbers and as RTL words, and create random inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.engines import Words, trace, words_of_rays
from lippmann.errors import InputError, input_error
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import FixedRays, Pipeline, ray_pipeline
from lippmann.fixed.words import INDEX_BITS, PIXEL_BITS, Ints
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import corners_mm, located, panel_size, pixels_from_cells
from lippmann.optics.rays import Engine, Floats, Model, Rays
from lippmann.optics.system import PanelFrame, System

Bools = npt.NDArray[np.bool_]
Random = np.random.Generator
#: Selection of rays: indices, a mask (N,) or a slice.
Selection = npt.NDArray[np.intp] | Bools | slice

#: Names of the words of input and output rays, most significant word first.
INPUTS = ("u", "v", "a", "b")
OUTPUTS = FixedRays._fields
#: Number of bits of the status, the only unsigned word.
STATUS_BITS = 3
#: Bits in a line of `registers.mem`.
REGISTER_BITS = 64


@dataclass(frozen=True)
class PanelRays:
    """N rays from `pixels` (N, 2) through `aperture` points (N, 2), mm; None means chief rays."""

    name: str
    display: Display
    pixels: Floats
    aperture: Floats | None
    model: Model = "exact"

    @property
    def aims(self) -> Floats:
        """Aperture points (N, 2) of the rays, mm; 0 for chief rays."""
        return np.zeros_like(self.pixels) if self.aperture is None else self.aperture

    def trace(self, engine: Engine = "golden", device: str = "llvm") -> Rays:
        """Trace the rays with an engine."""
        return trace(self.display, self.pixels, self.aperture, self.model, engine, device)

    def select(self, rays: Selection) -> PanelRays:
        """Return a set of the selected rays."""
        aperture = None if self.aperture is None else self.aperture[rays]
        return replace(self, pixels=self.pixels[rays], aperture=aperture)

    def steps(self) -> dict[str, Floats]:
        """Return the golden engine's intermediate values, (N, 2) each, keyed by name.

        `panel_mm` is the pixel's point in the panel frame. `home` contains the indices
        of the lenslet that owns the pixel's point. `start_mm` is the pixel's point, and
        `near_mm` the ray's point in the array's near plane; both are measured from the
        centre of lenslet `home`, in the array's axes.
        """
        panel = np.stack(PanelFrame.of(self.display).panel_from_pixel(*self.pixels.T), axis=1)
        home, start = located(self.display, self.pixels)
        near = start + self.display.gap_mm / self.display.aperture_distance_mm * (self.aims - start)
        return {"panel_mm": panel, "home": home, "start_mm": start, "near_mm": near}


@dataclass(frozen=True)
class WorldRays:
    """N rays from the world towards the display: origins (N, 3), mm, and unit directions (N, 3)."""

    name: str
    display: Display
    origin_mm: Floats
    direction: Floats

    def select(self, rays: Selection) -> WorldRays:
        """Return a set of the selected rays."""
        return replace(self, origin_mm=self.origin_mm[rays], direction=self.direction[rays])


def random_pixels(display: Display, random: Random, count: int) -> Floats:
    """Return random pixel coordinates (count, 2) on the panel."""
    return random.uniform(0.0, panel_size(display), (count, 2))


def random_aims(display: Display, random: Random, count: int, reach: float = 1.0) -> Floats:
    """Return random points (count, 2), mm, in a lenslet's cell scaled by `reach`."""
    array = display.array
    lattice = Lattice.of(array)
    points = random.uniform(-0.6, 0.6, (4 * count + 64, 2)) * array.pitches_mm
    points = np.stack(lattice.sheared(*points.T), axis=1)
    points = points[lattice.holds(points[:, 0], points[:, 1])]
    return np.asarray(points[:count] * reach, np.float64)


def random_directions(random: Random, count: int) -> Floats:
    """Return random unit vectors (count, 2); avoid sines, which depend on the machine."""
    x, y = random.uniform(-1.0, 1.0, (2, count))
    return np.asarray(np.stack([x, y], axis=1) / np.sqrt(x * x + y * y)[:, None])


def unit_vectors(vectors: Floats) -> Floats:
    """Return normalised vectors (N, 3); vectors of length 0 stay 0."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def random_sizes(random: Random, low: float, high: float, count: int) -> Floats:
    """Return random numbers (count, 1) of all magnitudes from `low` to `high`."""
    # Use binary exponents: the last bit of a power depends on the machine.
    (_, first), (_, last) = math.frexp(low), math.frexp(high)
    sizes = np.ldexp(random.uniform(0.5, 1.0, (count, 1)), random.integers(first, last + 1, (count, 1)))
    return np.clip(sizes, low, high)


def edge_points(display: Display, random: Random, count: int, vertices: float = 0.0) -> Floats:
    """Return random points (count, 2), mm, on a cell's edges, the fraction `vertices` at corners."""
    corners = corners_mm(display.array)
    side, along = random.integers(0, len(corners), count), random.random((count, 1))
    along = np.maximum(along - vertices, 0.0) / (1.0 - vertices)
    return corners[side] * (1.0 - along) + corners[(side + 1) % len(corners)] * along


def pixels_at(display: Display, local_mm: Floats, lenslet: tuple[int, int] = (0, 0)) -> tuple[Floats, Floats]:
    """Convert points (N, 2), mm from a lenslet's centre in the array's axes, to pixel coordinates (N, 2).

    The second result (N, 2), mm, is the centre of the cell that contains the point.
    Aperture points are relative to a cell's centre.
    """
    lattice = System.of(display).lattice
    i, j, _, _ = lattice.locate(NumpyBackend(), local_mm[:, 0], local_mm[:, 1])
    return pixels_from_cells(display, lenslet, local_mm), np.stack(lattice.centre(i, j), axis=1)


def cell_steps(display: Display, between: Floats) -> Floats:
    """Return the number of cell steps (N,) for lenslet index differences (N, 2)."""
    # Square grids allow diagonal steps. In the skewed hexagonal grid, (1, 1) is two
    # steps and (1, -1) is one step.
    i, j = np.abs(between).T
    steps = np.maximum(i, j)
    return np.asarray(np.maximum(steps, np.abs(between.sum(axis=1))) if display.array.grid == "hex" else steps)


def onset(inner: Floats, outer: Floats, has: Callable[[Floats], Bools]) -> Floats:
    """Bisect lines from `inner` to `outer` for the last aims (N, 2) for which `has` is false."""
    low, high = np.zeros(len(inner)), np.ones(len(inner))
    for _ in range(64):  # 64 bisections make any two floats adjacent
        middle = 0.5 * (low + high)
        has_it = has(inner + middle[:, None] * (outer - inner))
        low, high = np.where(has_it, low, middle), np.where(has_it, middle, high)
    return inner + low[:, None] * (outer - inner)


def formats(fraction_bits: int) -> dict[str, tuple[int, int]]:
    """Return (bits, fraction bits) of each word in `INPUTS` and `OUTPUTS`, keyed by word name."""
    near = fraction_bits + 2
    return {
        **dict.fromkeys("uv", (PIXEL_BITS, 4)),
        **dict.fromkeys("ab", (near, fraction_bits)),
        **dict.fromkeys("ij", (INDEX_BITS, 0)),
        **dict.fromkeys("xyz", (near + 2, fraction_bits + 1)),
        **dict.fromkeys(("dx", "dy", "dz"), (near, fraction_bits + 1)),
        "status": (STATUS_BITS, 0),
    }


def widths(words: Sequence[str], fraction_bits: int) -> tuple[int, ...]:
    """Return the number of bits of each named word."""
    return tuple(formats(fraction_bits)[word][0] for word in words)


def hex_digits(widths: Sequence[int]) -> int:
    """Return the number of hexadecimal digits of a line of words."""
    return (sum(widths) + 3) // 4


def memory_lines(words: Sequence[Ints], widths: Sequence[int]) -> list[str]:
    """Return a hexadecimal line per ray, with the first word in the most significant bits."""
    rays: Any = 0
    for word, width in zip(words, widths, strict=True):
        rays = rays << width | word.astype(object) & ((1 << width) - 1)
    return [f"{ray:0{hex_digits(widths)}x}" for ray in rays]


def words_of_lines(lines: Sequence[str], widths: Sequence[int], where: Callable[[int], str]) -> list[Ints]:
    """Convert hexadecimal lines, one per ray, to words.

    Raises InputError for an invalid line; the message begins with `where(ray)`.
    """
    rays, total = [], sum(widths)
    for ray, text in enumerate(lines):
        try:
            bits = int(text, 16)
        except ValueError:
            bits = -1
        if bits < 0:
            raise input_error(where(ray), f"'{text[:20]}' is not hexadecimal", "give one hexadecimal line per ray")
        if bits >> total:
            remedy = "clear the high bits (see vectors.json), or change --fraction-bits"
            raise input_error(where(ray), f"exceeds the {total} bits of a ray", remedy)
        rays.append(bits)
    remaining_bits, words = np.array(rays, object), []
    for width in reversed(widths):
        word = (remaining_bits & ((1 << width) - 1)).astype(np.int64)
        words.append(word - ((word >> (width - 1) << width) if width > STATUS_BITS else 0))
        remaining_bits = remaining_bits >> width
    return words[::-1]


@dataclass(frozen=True)
class FixedCase:
    """Input words and registers for an RTL build; `mask` marks the set's rays that fit the words."""

    build: Build
    words: Words
    registers: Configuration
    mask: Bools

    def trace(self, pipeline: Pipeline = ray_pipeline) -> FixedRays:
        """Trace the rays with the twin or another pipeline."""
        return pipeline(*self.words, self.registers, self.build)

    def count_differences(self, pipeline: Pipeline) -> int:
        """Count the words in which another pipeline and the twin differ."""
        return int(sum((a != b).sum() for a, b in zip(self.trace(pipeline), self.trace(), strict=True)))

    @property
    def input_lines(self) -> list[str]:
        """Hexadecimal lines of the file `inputs.mem`."""
        return memory_lines(self.words, widths(INPUTS, self.build.fraction_bits))

    @property
    def register_lines(self) -> list[tuple[str, str]]:
        """Line in `registers.mem` (hexadecimal) and name of each register."""
        mask, digits = (1 << REGISTER_BITS) - 1, REGISTER_BITS // 4
        return [(f"{word & mask:0{digits}x}", name) for name, word in asdict(self.registers).items()]


def fixed_words(rays: PanelRays, fraction_bits: int, max_cell_steps: int | None = None) -> tuple[FixedCase | None, str]:
    """Convert rays to words, or None if no ray fits; also return why rays were left out.

    Rays with aperture points beyond the words' range are left out. If the registers
    refuse the others, rays with aperture points outside the cell are also left out.
    """
    display, array, aims = rays.display, rays.display.array, rays.aims
    build = Build.of(display, rays.model, fraction_bits, True, max_cell_steps)
    along = np.abs(np.stack([aims[:, 0] - array.shear * aims[:, 1], aims[:, 1]], axis=1))
    near: Bools = np.all(along <= 1.4 * np.array([array.pitches_mm[0], array.row_pitch_mm]), axis=1)
    inside: Bools = Lattice.of(array).holds(aims[:, 0], aims[:, 1])
    why = "aperture points beyond 1.4 pitches" if not near.all() else ""
    for mask in (near, near & inside):
        if not mask.any():
            continue
        try:
            words = words_of_rays(display, build, rays.model, rays.pixels[mask], aims[mask])
            return FixedCase(build, *words, mask), why
        except InputError as error:
            why = str(error)
    return None, why


@dataclass(frozen=True)
class ForeignRays:
    """N rays under test: their inputs, and some arrays of `tracer_faults.FIELDS` in `fields`.

    `words` contains the input and output words if the rays are fixed-point. `alone`
    (N,) marks rays of which only the status is known.
    """

    inputs: PanelRays
    fields: dict[str, Floats]
    words: tuple[FixedCase, FixedRays] | None = None
    alone: Bools | None = None


def foreign_from_words(columns: dict[str, Ints], display: Display, model: Model, fraction_bits: int) -> ForeignRays:
    """Convert columns (N,) of input and output words to rays under test."""
    u, v, a, b = (columns[name] for name in INPUTS)
    outputs = FixedRays(*(columns[name] for name in OUTPUTS))
    pixels = pixels_of_words(display, u, v)
    aims = aims_of_words(display, a, b, fraction_bits)
    build = Build.of(display, model, fraction_bits, True)
    registers = configuration(display, build, model, float(np.hypot(*aims.T).max()))
    rays = rays_of_words(display, pixels, outputs, fraction_bits)
    fields = {
        "lenslet": rays.lenslet.astype(np.float64),
        "local_mm": rays.local_mm,
        "direction": rays.direction,
        "status": rays.status.astype(np.float64)[:, None],
    }
    case = FixedCase(build, (u, v, a, b), registers, np.ones(len(u), bool))
    return ForeignRays(PanelRays("foreign", display, pixels, aims, model), fields, (case, outputs))
