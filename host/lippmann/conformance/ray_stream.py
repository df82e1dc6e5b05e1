"""Write text streams of rays, and read a tested program's answers (docs/reference/stream.md)."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import BinaryIO, NoReturn, cast

import numpy as np

from lippmann.conformance.hard_cases import hard_sets
from lippmann.conformance.ray_sets import (
    INPUTS,
    OUTPUTS,
    ForeignRays,
    PanelRays,
    WorldRays,
    fixed_words,
    foreign_from_words,
    hex_digits,
    memory_lines,
    random_aims,
    random_pixels,
    widths,
    words_of_lines,
)
from lippmann.display.description import Display, display_text, parse_display
from lippmann.errors import input_error
from lippmann.fixed.words import FRACTIONS, Ints
from lippmann.optics.rays import MODELS, Floats, Model, Status

NAME, VERSION = "lippmann-stream", 1
#: Maximum random rays in a set.
MAX_RANDOM = 100_000

#: Words in a question, a complete answer, and the answer for a lost ray.
ASKED, ANSWERED, LOST = 5, 9, 1
#: Maximum bytes per line, rays per set, and notes per set.
MAX_LINE, MAX_RAYS, MAX_NOTES = 4096, 200_000, 1000
#: Maximum absolute value of a status or an index.
MAX_INTEGER = 2.0**31
#: Regular expressions for a stream's first line and for the parsed notes.
FIRST = re.compile(rf"# {NAME} (\d{{1,9}})")
SET = re.compile(r"[\w.+/-]{1,100}", re.ASCII)
NUMBERS = re.compile("decimal (MODEL)|words (MODEL) (.+)".replace("MODEL", "|".join(MODELS)))
RAYS = re.compile(r"([0-9]{1,9}) (\S+)")
WHERE = "the stream"
REMEDY = "append status i j x y z dx dy dz"
AGAIN = "copy each line that begins with #, and append to each other line"


@dataclass(frozen=True)
class Stream:
    """A stream with the rays of one case or of all cases, and `random` more rays.

    The rays are fixed-point words, or decimal numbers if `fraction_bits` is None.
    """

    display: Display
    case: str
    model: Model
    seed: int
    count: int
    random: int = 0
    fraction_bits: int | None = None

    def sets(self) -> Iterator[PanelRays]:
        """Yield the stream's sets of rays from the panel."""
        for rays in hard_sets(self.display, self.case, self.seed, self.count):
            if not isinstance(rays, WorldRays):
                yield replace(rays, aperture=rays.aims, model=self.model)
        for number, first in enumerate(range(0, self.random, MAX_RANDOM)):
            random = np.random.default_rng([self.seed, number, 0x57E])
            size = min(MAX_RANDOM, self.random - first)
            pixels = random_pixels(self.display, random, size)
            aims = random_aims(self.display, random, size)
            yield PanelRays(f"random/{number}", self.display, pixels, aims, self.model)

    def lines(self, command: str) -> Iterator[str]:
        """Yield the stream's lines; skip sets that do not fit the words. Raises InputError if no set fits."""
        hashes: list[str] = []
        for rays in self.sets():
            if not (set_lines := self._questions(rays)):
                continue
            notes, questions, digest = set_lines
            if not hashes:
                yield f"# {NAME} {VERSION}"
                yield f"# made {command}"
            hashes.append(digest)
            yield f"# set {rays.name}"
            yield from (f"# {line}" for line in notes)
            yield f"# rays {len(questions)} {digest}"
            yield from (f"{n} {question}" for n, question in enumerate(questions))
        if not hashes:
            which = " that fit the words" * (self.fraction_bits is not None)
            what = f"has no rays from the panel of {self.display.name}{which}"
            raise input_error(f"--case {self.case}", what, "choose another case or display")
        yield f"# end {len(hashes)} {digest_of_all(hashes)}"

    def _questions(self, rays: PanelRays) -> tuple[list[str], list[str], str] | None:
        hashed: Floats | list[str]
        if self.fraction_bits is None:
            hashed = np.concatenate([rays.pixels, rays.aims], axis=1)
            questions = [" ".join(map(repr, row)) for row in hashed.tolist()]
            notes = [f"numbers decimal {rays.model}"]
        else:
            fixed, _ = fixed_words(rays, self.fraction_bits)
            if fixed is None:
                return None
            questions = hashed = fixed.input_lines
            notes = [f"numbers words {rays.model} {self.fraction_bits}"]
            notes += [f"register {word} {name}" for word, name in fixed.register_lines]
        notes += [f"display {line}" for line in display_text(rays.display).splitlines() if line]
        notes += [f"value {name} {value}" for name, value in values(rays.display).items()]
        return notes, questions, digest_of_set(notes, hashed)


def digest_of_set(notes: Iterable[str], questions: Floats | list[str]) -> str:
    """Return the hash of a set's notes (with single blanks) and of its questions: numbers (N, 4) or words."""
    lines = "".join(" ".join(line.split()) + "\n" for line in notes)
    numbers = np.ascontiguousarray(questions, "<f8").tobytes() if isinstance(questions, np.ndarray) else None
    return hashlib.sha256(lines.encode() + (numbers or "\n".join(questions).encode())).hexdigest()


def digest_of_all(hashes: Iterable[str]) -> str:
    """Return the hash of a complete stream from its sets' hashes."""
    return hashlib.sha256("\n".join(hashes).encode()).hexdigest()


def values(display: Display) -> dict[str, str]:
    """Return a display's parameters as text, keyed by name, in mm and degrees."""
    panel, array = display.panel, display.array
    numbers: dict[str, float | str | tuple[float, ...]] = {
        "width_px": panel.width_px,
        "height_px": panel.height_px,
        "pixel": panel.pitches_mm,
        "grid": array.grid,
        "pitch": array.pitches_mm,
        "shear": array.shear,
        "rotation": array.rotation_deg,
        "offset": array.offset_mm,
        "extent": array.extent_mm or (0.0, 0.0),
        "radius": array.radius_mm,
        "index": array.index,
        "thickness": array.thickness_mm,
        "plano": array.plano_side,
        "gap": display.gap_mm,
        "eye_distance": display.viewing_distance_mm or 0.0,
        "eye": display.viewing_axis_mm,
    }
    texts: dict[str, str] = {}
    for name, value in numbers.items():
        pair = {f"{name}_x": value[0], f"{name}_y": value[1]} if isinstance(value, tuple) else {name: value}
        texts |= {key: one if isinstance(one, str) else repr(one) for key, one in pair.items()}
    return texts


@dataclass
class _Set:
    name: str
    model: Model | None = None
    fraction_bits: int | None = None
    notes: list[str] = field(default_factory=list)
    file: list[str] = field(default_factory=list)
    lines: list[bytes] = field(default_factory=list)
    #: Line number of the set's first ray in the stream.
    first: int = 0


class StreamReader:
    """Reads the answers of a program under test, set by set.

    Raises InputError for an invalid line; the message names the line.
    """

    def __init__(self, lines: Iterable[bytes]) -> None:
        self.number = 0
        #: Command that wrote the stream, and the hash at the stream's end.
        self.command, self.hash = "", ""
        self._lines, self._hashes = self._counted(lines), list[str]()

    def _counted(self, lines: Iterable[bytes]) -> Iterator[bytes]:
        for self.number, raw in enumerate(lines, 1):
            yield raw

    def sets(self) -> Iterator[tuple[str, ForeignRays]]:
        """Yield the name and the rays of each set."""
        self._begin()
        now: _Set | None = None
        while True:
            raw = self._read_line(now)
            if not raw.startswith(b"#"):
                if now is None:
                    self._refuse("has a ray before the first set")
                where = f"beyond its {len(now.lines)}" if now.lines else "before its # rays line"
                self._refuse(f"the set {now.name} has a ray {where}")
            kind, _, text = self._text(raw)[1:].strip().partition(" ")
            if kind in ("set", "end"):
                if now is not None and not now.lines:
                    self._refuse(f"the set {now.name} has no rays")
                if kind == "end":
                    self._end(text)
                    return
                if not SET.fullmatch(text):
                    self._refuse("is not the name of a set")
                now = _Set(text)
            elif kind == "rays" and now is not None:
                yield now.name, self._read_set(now, " ".join(text.split()))
            elif now is not None:
                self._read_note(now, kind, text)
            elif kind == "made":
                self.command = text

    def _refuse(self, what: str, remedy: str = AGAIN, number: int | None = None) -> NoReturn:
        raise input_error(f"{WHERE}, line {self.number if number is None else number}", what, remedy)

    def _read_line(self, now: _Set | None) -> bytes:
        raw = next(self._lines, None)
        if raw is None:
            where = "" if now is None else f" in the set {now.name}, after {len(now.lines)} of its rays"
            self._refuse(f"is truncated{where}", "let the program answer until the line # end")
        if len(raw) > MAX_LINE:
            self._refuse(f"has more than {MAX_LINE} bytes")
        return raw

    def _text(self, raw: bytes, encoding: str = "utf-8", number: int | None = None) -> str:
        try:
            return raw.decode(encoding).rstrip("\r\n")
        except UnicodeDecodeError:
            self._refuse("is not text", number=number)

    def _begin(self) -> None:
        for raw in self._lines:
            first = FIRST.fullmatch(raw[:MAX_LINE].decode("utf-8", "replace").strip())
            if first and int(first[1]) != VERSION:
                self._refuse(f"has version {first[1]}, not {VERSION}", "run both commands with the same version")
            if first:
                return
        what = f"none of its {self.number} lines is # {NAME} {VERSION}" if self.number else "is empty"
        raise input_error(WHERE, what, "run only lippmann vectors --stream | YOUR PROGRAM to see the program's error")

    def _read_note(self, now: _Set, kind: str, text: str) -> None:
        words = " ".join(text.split())
        if kind in ("numbers", "display", "value", "register"):  # the hash covers these notes
            now.notes.append(f"{kind} {words}")
            if now.lines or len(now.notes) > MAX_NOTES:
                excess = "a note after its rays" if now.lines else f"more than {MAX_NOTES} notes"
                self._refuse(f"the set {now.name} has {excess}")
        if kind == "display":
            now.file.append(text)
        elif kind == "numbers":
            numbers = NUMBERS.fullmatch(words)
            if numbers is None:
                self._refuse("is not a valid # numbers line")
            bits = numbers[3]
            if bits is not None and bits not in map(str, FRACTIONS):
                self._refuse(f"has no word length {bits[:9]}", f"give F = {FRACTIONS[0]} to {FRACTIONS[-1]}")
            now.model, now.fraction_bits = cast(Model, numbers[1] or numbers[2]), None if bits is None else int(bits)

    def _end(self, text: str) -> None:
        if not self._hashes:
            self._refuse("ends a stream without a set")
        self.hash = digest_of_all(self._hashes)
        if text.split() != [str(len(self._hashes)), self.hash]:
            self.hash = ""
            self._refuse("sets are missing, or are of another stream")
        for raw in self._lines:
            if raw.startswith(f"# {NAME} ".encode()):
                self._refuse("begins another stream", "check each stream with its own command")

    # ---- the rays of a set ----

    def _read_set(self, now: _Set, numbers: str) -> ForeignRays:
        rays = RAYS.fullmatch(numbers)
        if rays is None or not 0 < int(rays[1]) <= MAX_RAYS or now.lines:
            self._refuse("is not a valid # rays line")
        if now.model is None:
            self._refuse(f"the set {now.name} has no # numbers line")
        now.first = self.number + 1
        while len(now.lines) < int(rays[1]):
            raw = self._read_line(now)
            if raw.startswith(b"#"):
                for n in range(len(now.lines)):  # report an invalid earlier line first
                    self._columns(now, n)
                self._refuse(f"comes after {len(now.lines)} of the {rays[1]} rays of the set {now.name}")
            now.lines.append(raw)
        display = parse_display("\n".join(now.file), f"{WHERE}, the set {now.name}")
        questions: Floats | list[str]
        if now.fraction_bits is None:
            table = _complete_rows(now.lines)
            if table is None:
                table = np.array([self._row(now, n) for n in range(len(now.lines))])
            questions = table[:, :4]
            status, lenslet, origin, direction = map(np.ascontiguousarray, np.split(table[:, 4:], [1, 3, 6], 1))
            fields = {"lenslet": lenslet, "origin_mm": origin, "direction": direction, "status": status}
            inputs = PanelRays(now.name, display, table[:, :2], table[:, 2:4], now.model)
            foreign = ForeignRays(inputs, fields, alone=np.isnan(direction[:, 0]))
        else:
            columns = self._words(now, now.fraction_bits)
            questions = memory_lines([columns[name] for name in INPUTS], widths(INPUTS, now.fraction_bits))
            foreign = foreign_from_words(columns, display, now.model, now.fraction_bits)
        digest = digest_of_set(now.notes, questions)
        if digest != rays[2]:
            self._refuse(f"questions or notes of the set {now.name} were changed")
        self._hashes.append(digest)
        return foreign

    def _row(self, now: _Set, n: int) -> list[float]:
        words, refuse = self._columns(now, n), partial(self._refuse, number=now.first + n)
        answered = len(words) - ASKED
        if answered not in (ANSWERED, LOST):
            refuse(f"has {answered} numbers after its question", REMEDY)
        try:
            # Refuse underscores, because Python reads 1_0 as 10.
            row = [float(word.replace("_", "?")) for word in words[1:]]
        except ValueError:
            refuse("has a word that is not a number", REMEDY)
        if not all(map(math.isfinite, row)):
            refuse("has a number that is not finite", "give only the status for a lost ray")
        if any(abs(one) > MAX_INTEGER or one % 1.0 for one in row[ASKED - 1 : ASKED + 2]):
            refuse("has a status or lenslet index that is too large or not an integer", REMEDY)
        if answered == LOST and row[-1] not in (Status.MISSED, Status.INTERNAL_REFLECTION, Status.BLOCKED):
            refuse("has only a status, which is not that of a lost ray", REMEDY)
        return row + [math.nan] * (ANSWERED - answered)

    def _columns(self, now: _Set, n: int) -> list[str]:
        words = self._text(now.lines[n], "ascii", now.first + n).split()
        if not words or words[0] != str(n):
            what = f"has ray {words[0][:20] if words else 'none'} where {n} is next"
            self._refuse(what, number=now.first + n)
        return words

    def _words(self, now: _Set, fraction_bits: int) -> dict[str, Ints]:
        rows = [self._columns(now, n) for n in range(len(now.lines))]
        for n, row in enumerate(rows):
            if len(row) != 3:
                what = f"has {len(row) - 2} words after its question"
                self._refuse(what, "append the bits of a line of expected.mem", now.first + n)
        columns: dict[str, Ints] = {}
        for place, names in enumerate((INPUTS, OUTPUTS), 1):
            texts, bits = [row[place] for row in rows], widths(names, fraction_bits)
            digits = hex_digits(bits)
            for n, text in enumerate(texts):
                if len(text) != digits or not re.fullmatch("[0-9a-fA-F]+", text):
                    what = f"has '{text[:40]}' for {digits} hexadecimal digits"
                    self._refuse(what, "give leading zeros too", now.first + n)
            words = words_of_lines(texts, bits, lambda n: f"{WHERE}, line {now.first + n}")
            columns |= dict(zip(names, words, strict=True))
        return columns


def bounded_lines(file: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of a file as they arrive; split a line beyond MAX_LINE into parts."""
    return iter(partial(file.readline, MAX_LINE + 1), b"")


def _complete_rows(lines: list[bytes]) -> Floats | None:
    if lines[0].isspace():  # numpy would warn about a blank line
        return None
    try:
        table = np.loadtxt(lines, comments=None, ndmin=2)
    except ValueError:
        return None
    if table.shape != (len(lines), ASKED + ANSWERED):
        return None
    integers = table[:, ASKED : ASKED + 3]
    good = (table[:, 0] == np.arange(len(lines))).all() and np.isfinite(table).all()
    good &= (np.abs(integers) <= MAX_INTEGER).all() and (integers == np.round(integers)).all()
    return table[:, 1:] if good else None
