"""Hard rays as lines of text, for a program that stands between `lippmann vectors` and `lippmann regress`.

A program copies each line that begins with #, and appends its answer to each other line. The notes carry all that the
judge needs, so that it needs no file:

    # lippmann-stream 1                     the format's version; the first line
    # made NOTE                             the command that made it
    # set NAME                              begins a set
    # numbers decimal MODEL                 or: numbers words MODEL FRACTION_BITS
    # display LINE                          a line of the display file
    # value NAME NUMBER                     what the display comes to, in mm, for programs that read no TOML
    # register HEX NAME                     words only: a register, as in registers.mem
    # rays COUNT HASH                       the questions follow: COUNT lines
    # end SETS HASH                         the last line

A question is `n u v a b`: the ray's number in its set, pixel coordinates and aperture point, mm along the array's axes
from the centre of the pixel's lenslet. In words it is `n HEX`, a line of inputs.mem. HASH is the SHA-256 of a set's
notes of the kinds `HASHED` and of its numbers, float64 in order, little-endian, or of its words' text; at the end that
of the sets' hashes. The same command of the same version makes the same stream.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from lippmann.conformance.engine_errors import fixed_words
from lippmann.conformance.hard_cases import Back, Out, hard_sets
from lippmann.conformance.ray_search import Floats, random_aims, random_pixels
from lippmann.conformance.vectors import INPUTS, REGISTER_BITS, memory_lines, widths
from lippmann.display.description import Display, display_text
from lippmann.errors import input_error
from lippmann.optics.rays import Model

NAME, VERSION = "lippmann-stream", 1
#: Kinds of notes that the hash of a set covers.
HASHED = ("numbers", "display", "value", "register")
#: Most random rays of a set: what is judged at once.
MOST_RANDOM = 100_000


@dataclass(frozen=True)
class Stream:
    """What a stream asks: the rays of a case or of all, with `random` more; in words of F = `fraction_bits`, or not."""

    display: Display
    case: str
    model: Model
    seed: int
    count: int
    random: int = 0
    fraction_bits: int | None = None

    def sets(self) -> Iterator[Out]:
        """Yield the sets of rays from the panel."""
        for rays in hard_sets(self.display, self.case, self.seed, self.count):
            if not isinstance(rays, Back):
                yield replace(rays, aperture=rays.aims, model=self.model)
        for number, first in enumerate(range(0, self.random, MOST_RANDOM)):
            random = np.random.default_rng([self.seed, number, 0x57E])
            size = min(MOST_RANDOM, self.random - first)
            pixels, aims = random_pixels(self.display, random, size), random_aims(self.display, random, size)
            yield Out(f"random/{number}", self.display, pixels, aims, self.model)

    def lines(self, made: str) -> Iterator[str]:
        """Yield the lines; sets that do not fit the words are left out. `made` is the command that makes them.

        Raises InputError, before the first line, when no set is left.
        """
        hashes: list[str] = []
        for rays in self.sets():
            asked = self._asked(rays)
            if asked is None:
                continue
            notes, questions, content = asked
            notes += [f"display {line}" for line in display_text(rays.display).splitlines() if line]
            notes += [f"value {name} {value}" for name, value in values(rays.display).items()]
            digest = digest_of_set(notes, content)
            if not hashes:
                yield f"# {NAME} {VERSION}"
                yield f"# made {made}"
            hashes.append(digest)
            yield f"# set {rays.name}"
            yield from (f"# {note}" for note in notes)
            yield f"# rays {len(questions)} {digest}"
            yield from (f"{n} {question}" for n, question in enumerate(questions))
        if not hashes:
            which = " that fit the words" * (self.fraction_bits is not None)
            what = f"has no rays from the panel{which} on {self.display.name}"
            raise input_error(f"--case {self.case}", what, "take another case or display")
        yield f"# end {len(hashes)} {digest_of_all(hashes)}"

    def _asked(self, rays: Out) -> tuple[list[str], list[str], bytes] | None:
        """Return notes, questions and what of these is hashed; None when no ray fits the words."""
        if self.fraction_bits is None:
            numbers = np.concatenate([rays.pixels, rays.aims], axis=1)
            questions = [f"{u!r} {v!r} {a!r} {b!r}" for u, v, a, b in numbers.tolist()]
            return [f"numbers decimal {rays.model}"], questions, numbers_as_bytes(numbers)
        fixed, _ = fixed_words(rays, self.fraction_bits)
        if fixed is None:
            return None
        questions = memory_lines(fixed.words, widths(INPUTS, self.fraction_bits))
        mask = (1 << REGISTER_BITS) - 1
        registers = asdict(fixed.registers).items()
        notes = [f"numbers words {rays.model} {self.fraction_bits}"]
        notes += [f"register {word & mask:0{REGISTER_BITS // 4}x} {name}" for name, word in registers]
        return notes, questions, words_as_bytes(questions)


def numbers_as_bytes(numbers: Floats) -> bytes:
    """Return what is hashed of the questions (N, 4) of a set."""
    return np.ascontiguousarray(numbers, "<f8").tobytes()


def words_as_bytes(questions: Iterable[str]) -> bytes:
    """Return what is hashed of the questions of a set in words."""
    return "\n".join(questions).encode()


def digest_of_set(notes: Iterable[str], content: bytes) -> str:
    """Return the hash of a set: its notes, each a line with single blanks, then its questions."""
    lines = "".join(" ".join(note.split()) + "\n" for note in notes)
    return hashlib.sha256(lines.encode() + content).hexdigest()


def digest_of_all(hashes: Iterable[str]) -> str:
    """Return the hash of a whole stream."""
    return hashlib.sha256("\n".join(hashes).encode()).hexdigest()


def values(display: Display) -> dict[str, str]:
    """Return what a display comes to, by name, as text: lengths in mm, angles in degrees."""
    panel, array = display.panel, display.array
    eye = display.viewing_distance_mm
    wide, high = array.extent_mm or (0.0, 0.0)
    named: dict[str, float | str] = {
        "width_px": panel.width_px, "height_px": panel.height_px,
        "pixel_x": panel.pitches_mm[0], "pixel_y": panel.pitches_mm[1],
        "grid": array.grid, "pitch_x": array.pitches_mm[0], "pitch_y": array.pitches_mm[1], "shear": array.shear,
        "rotation": array.rotation_deg, "offset_x": array.offset_mm[0], "offset_y": array.offset_mm[1],
        "extent_x": wide, "extent_y": high,
        "radius": array.radius_mm, "index": array.index, "thickness": array.thickness_mm, "plano": array.plano_side,
        "gap": display.gap_mm, "eye_distance": 0.0 if eye is None else eye,
        "eye_x": display.viewing_axis_mm[0], "eye_y": display.viewing_axis_mm[1],
    }  # fmt: skip
    return {name: value if isinstance(value, str) else repr(value) for name, value in named.items()}
