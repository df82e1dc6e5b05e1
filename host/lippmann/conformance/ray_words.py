"""Rays as words of the RTL: the bits of each word, a set's words and registers, and their lines in hexadecimal.

The files for `$readmemh` (`lippmann vectors`) and a stream in words hold the same lines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lippmann.conformance.ray_sets import Bools, PanelRays
from lippmann.display.description import Display
from lippmann.engines import Pipeline, Words, words_of_rays
from lippmann.errors import InputError, input_error
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import INDEX_BITS, PIXEL_BITS, Ints
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Floats, Model

#: Words of an input and of an output ray, in the order of their bits, most significant first.
INPUTS = ("u", "v", "a", "b")
OUTPUTS = FixedRays._fields
#: The one unsigned word.
STATUS_BITS = 3
#: Bits of a line of `registers.mem`.
REGISTER_BITS = 64


def formats(fraction_bits: int) -> dict[str, tuple[int, int]]:
    """Return the bits, and those of them behind the binary point, of each word of `INPUTS` and `OUTPUTS`."""
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
    """Return the bits of each of some words."""
    return tuple(formats(fraction_bits)[word][0] for word in words)


def hex_digits(widths: Sequence[int]) -> int:
    """Return how many hexadecimal digits a line of words has."""
    return (sum(widths) + 3) // 4


def memory_lines(words: Sequence[Ints], widths: Sequence[int]) -> list[str]:
    """Return a hexadecimal line for each ray: its words in turn, the first in the most significant bits."""
    rays: Any = 0
    for word, width in zip(words, widths, strict=True):
        rays = rays << width | word.astype(object) & ((1 << width) - 1)
    return [f"{ray:0{hex_digits(widths)}x}" for ray in rays]


def words_of_lines(lines: Sequence[str], widths: Sequence[int], where: Callable[[int], str]) -> list[Ints]:
    """Return the words of lines of hexadecimal digits, one a ray; `where` names a ray's line in errors.

    Raises InputError when a line is not hexadecimal or too long.
    """
    rays, total = [], sum(widths)
    for ray, text in enumerate(lines):
        try:
            bits = int(text, 16)
        except ValueError:
            bits = -1
        if bits < 0:
            raise input_error(where(ray), f"'{text[:20]}' is not hexadecimal", "give a line a ray")
        if bits >> total:
            raise input_error(where(ray), f"more than the {total} bits of a ray", "see vectors.json")
        rays.append(bits)
    remaining_bits, words = np.array(rays, object), []
    for width in reversed(widths):
        word = (remaining_bits & ((1 << width) - 1)).astype(np.int64)
        words.append(word - ((word >> (width - 1) << width) if width > STATUS_BITS else 0))
        remaining_bits = remaining_bits >> width
    return words[::-1]


@dataclass(frozen=True)
class FixedCase:
    """A set in the words of a build: inputs (u, v, a, b) and registers; `mask` tells which rays of the set they are."""

    build: Build
    words: Words
    registers: Configuration
    mask: Bools

    def trace(self, pipeline: Pipeline = ray_pipeline) -> FixedRays:
        """Trace the rays with the twin, or with another pipeline."""
        return pipeline(*self.words, self.registers, self.build)

    def count_differences(self, pipeline: Pipeline) -> int:
        """Return how many words of the rays another pipeline computes otherwise than the twin."""
        return int(sum((a != b).sum() for a, b in zip(self.trace(pipeline), self.trace(), strict=True)))

    @property
    def input_lines(self) -> list[str]:
        """The inputs as lines of `inputs.mem`."""
        return memory_lines(self.words, widths(INPUTS, self.build.fraction_bits))

    @property
    def register_lines(self) -> list[tuple[str, str]]:
        """The registers, each as its line of `registers.mem` and its name."""
        mask, digits = (1 << REGISTER_BITS) - 1, REGISTER_BITS // 4
        return [(f"{word & mask:0{digits}x}", name) for name, word in asdict(self.registers).items()]


def fixed_words(rays: PanelRays, fraction_bits: int, max_cell_steps: int | None = None) -> tuple[FixedCase | None, str]:
    """Return a set in words, None when no ray fits, and the reason of the last refusal.

    Aims beyond the word length are left out; if the registers refuse the rest, aims outside their own cell as well.
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
            words, registers = words_of_rays(display, build, rays.model, rays.pixels[mask], aims[mask])
        except InputError as error:
            why = str(error)
            continue
        return FixedCase(build, words, registers, mask), why
    return None, why


@dataclass(frozen=True)
class ForeignRays:
    """N rays to be judged: `inputs` holds their inputs, `fields` those arrays of `faults.FIELDS` that are known.

    `words` are the inputs in the RTL's words and the words of the rays, where the rays are words. `alone` (N,) marks
    rays of which the status alone is given; their other values are not judged.
    """

    inputs: PanelRays
    fields: dict[str, Floats]
    words: tuple[FixedCase, FixedRays] | None = None
    alone: Bools | None = None


def foreign_from_words(columns: dict[str, Ints], display: Display, model: Model, fraction_bits: int) -> ForeignRays:
    """Return rays whose inputs and outputs are words, a column of N for each."""
    u, v, a, b = (columns[name] for name in INPUTS)
    outputs = FixedRays(*(columns[name] for name in OUTPUTS))
    pixels, aims = pixels_of_words(display, u, v), aims_of_words(display, a, b, fraction_bits)
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
