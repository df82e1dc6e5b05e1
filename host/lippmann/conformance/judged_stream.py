"""Reads the answers of a program that stands in a stream of rays; see `lippmann.conformance.vector_stream`.

An answer in numbers is `status i j x y z dx dy dz` behind its question: the status, the lenslet through which the ray
left, the exit point and the unit direction in the panel's frame, mm. A ray that is lost (status 1 to 3) may have its
status alone. An answer in words is the hexadecimal number of a line of expected.mem.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import BinaryIO, NoReturn, get_args

import msgspec
import numpy as np
import numpy.typing as npt

from lippmann.conformance.foreign_rays import Foreign, foreign_words
from lippmann.conformance.hard_cases import Out
from lippmann.conformance.vector_stream import (
    HASHED,
    NAME,
    VERSION,
    digest_of_all,
    digest_of_set,
    numbers_as_bytes,
    words_as_bytes,
)
from lippmann.conformance.vectors import INPUTS, OUTPUTS, hex_digits, memory_lines, widths, words_of_lines
from lippmann.display.description import Display, parse_display
from lippmann.errors import input_error
from lippmann.fixed.words import FRACTIONS, Ints
from lippmann.optics.rays import Model, Status

#: Numbers of a question, of a whole answer, and of the answer of a ray that is lost.
ASKED, ANSWERED, LOST = 5, 9, 1
#: Longest line, bytes; most rays of a set.
MOST_LINE, MOST_RAYS = 4096, 200_000
#: Lines that are read together.
PART = 2048
#: Most lines of a set's display file.
MOST_NOTES = 1000
#: Names of sets.
SET = re.compile(r"[\w.+/-]{1,100}", re.ASCII)
#: Greatest magnitude of a status or an index in an answer, so that it is an integer without rounding.
MOST_WHOLE = 2.0**31
#: How the first line begins.
FIRST = f"# {NAME} ".encode()
HEXADECIMAL = re.compile(r"[0-9a-fA-F]+")
REMEDY = "append status i j x y z dx dy dz"
AGAIN = "copy each line that begins with #, and append to each other line"


@dataclass
class _Set:
    """A set that is being read: what its notes say, and its lines."""

    name: str
    words: bool | None = None
    model: Model = "exact"
    fraction_bits: int = 0
    notes: list[str] = field(default_factory=list)
    file: list[str] = field(default_factory=list)
    expected: int = -1
    digest: str = ""
    lines: list[bytes] = field(default_factory=list)
    #: Number of the first ray's line in the stream.
    first: int = 0


class StreamReader:
    """Yields the sets of a stream of answers as they come.

    InputError names the line of what cannot be judged: not a stream or of another version, a stream that is cut, a ray
    out of turn, a question that was changed, an answer that is not one.
    """

    def __init__(self, lines: Iterable[bytes], where: str = "the stream") -> None:
        self.number = 0
        #: The command that made the stream, and at its end the hash that names it.
        self.made, self.hash = "", ""
        self._lines, self._where = lines, where
        self._hashes: list[str] = []

    def sets(self) -> Iterator[tuple[str, Foreign]]:
        """Yield each set's name, and its rays."""
        lines = iter(self._lines)
        self._begin(lines)
        now: _Set | None = None
        for raw in lines:
            self.number += 1
            self._check_length(raw)
            if not raw.startswith(b"#"):
                self._stray(now)
            kind, _, rest = self._text(raw)[1:].strip().partition(" ")
            if kind in ("set", "end"):
                if now is not None:
                    yield now.name, self._read(now)
                if kind == "end":
                    self._end(rest, lines)
                    return
                now = self._started(rest)
            elif now is None and kind == "made":
                self.made = rest
            elif now is not None:
                self._note(now, kind, rest)
                if kind == "rays":
                    self._take(now, lines)
        where = "" if now is None else f" in the set {now.name}, after {len(now.lines)} of its rays"
        self._refuse(f"is cut{where}", "let the program answer until the line # end")

    def _check_length(self, raw: bytes) -> None:
        if len(raw) > MOST_LINE:
            self._refuse(f"has more than {MOST_LINE} bytes", AGAIN)

    def _refuse(self, what: str, remedy: str) -> NoReturn:
        raise input_error(f"{self._where}, line {self.number}" if self.number else self._where, what, remedy)

    def _text(self, raw: bytes) -> str:
        try:
            return raw.decode("utf-8").rstrip("\r\n")
        except UnicodeDecodeError:
            self._refuse("is not text", AGAIN)

    def _begin(self, lines: Iterator[bytes]) -> None:
        """Read up to the first line of the stream; a simulator may greet before it, in any text."""
        for raw in lines:
            self.number += 1
            found = re.fullmatch(rf"# {NAME} (\d{{1,9}})", raw[:MOST_LINE].decode("utf-8", "replace").strip())
            if found and int(found[1]) != VERSION:
                self._refuse(f"has version {found[1]}, not {VERSION}", "use one version of lippmann for both commands")
            if found:
                return
        what = f"none of its {self.number} lines is # {NAME} {VERSION}" if self.number else "is empty"
        raise input_error(self._where, what, "run lippmann vectors --stream | YOUR PROGRAM alone to see why")

    def _started(self, name: str) -> _Set:
        if not SET.fullmatch(name):
            self._refuse("is no name of a set", AGAIN)
        return _Set(name)

    def _note(self, now: _Set, kind: str, rest: str) -> None:
        words = rest.split()
        if kind in HASHED:
            now.notes.append(f"{kind} {' '.join(words)}")
            if len(now.notes) > MOST_NOTES:
                self._refuse(f"the set {now.name} has more than {MOST_NOTES} notes", AGAIN)
        if kind == "display":
            now.file.append(rest)
        elif kind == "numbers":
            good = len(words) in (2, 3) and words[0] in ("decimal", "words") and words[1] in get_args(Model)
            if not good or (words[0] == "words") != (len(words) == 3):
                self._refuse("is no note of numbers", AGAIN)
            now.words, now.model = words[0] == "words", words[1]  # type: ignore[assignment]  # checked above
            if now.words:
                if words[2] not in map(str, FRACTIONS):
                    self._refuse(f"has no word length {words[2][:9]}", f"give F = {FRACTIONS[0]} to {FRACTIONS[-1]}")
                now.fraction_bits = int(words[2])
        elif kind == "rays":
            if len(words) != 2 or not words[0].isdigit() or not 0 < int(words[0]) <= MOST_RAYS:
                self._refuse("is no number of rays and hash", AGAIN)
            if now.words is None:
                self._refuse(f"the set {now.name} has no note of numbers", AGAIN)
            now.expected, now.digest = int(words[0]), words[1]

    def _take(self, now: _Set, lines: Iterator[bytes]) -> None:
        """Keep as many lines as the set has rays, at once; look at each when one is too long or a note."""
        now.first = self.number + 1
        some = list(islice(lines, now.expected))
        noted = any(b"#" in b"".join(part) for _, part in _parts(some))
        if max(map(len, some), default=0) <= MOST_LINE and not noted:
            now.lines, self.number = some, self.number + len(some)
            return
        for raw in some:
            self.number += 1
            self._check_length(raw)
            if raw.startswith(b"#"):
                self._check(now)
                self._refuse(f"comes after {len(now.lines)} of the {now.expected} rays of the set {now.name}", AGAIN)
            now.lines.append(raw)

    def _stray(self, now: _Set | None) -> NoReturn:
        """Refuse a ray that no set expects; when an earlier line was none, that line."""
        if now is None:
            self._refuse("has a ray before the first set", AGAIN)
        self._check(now)
        what = "before its number" if now.expected < 0 else f"beyond its {now.expected}"
        self._refuse(f"the set {now.name} has a ray {what}", AGAIN)

    def _check(self, now: _Set) -> None:
        """Refuse the first line that is not the next ray's."""
        for n, line in enumerate(now.lines):
            self._columns(now, n, line)

    def _end(self, rest: str, lines: Iterator[bytes]) -> None:
        """Check the last line; a simulator's last words may follow, another stream may not."""
        if not self._hashes:
            self._refuse("ends a stream without a set", AGAIN)
        if rest.split() != [str(len(self._hashes)), digest_of_all(self._hashes)]:
            self._refuse("sets are missing, or are of another stream", AGAIN)
        self.hash = rest.split()[1]
        for raw in lines:
            self.number += 1
            if raw.startswith(FIRST):
                self._refuse("begins another stream", "judge each stream by a command of its own")

    # ---- a whole set ----

    def _read(self, now: _Set) -> Foreign:
        if now.expected != len(now.lines):
            self._refuse(f"the set {now.name} has {len(now.lines)} of its {max(0, now.expected)} rays", AGAIN)
        display = parse_display("\n".join(now.file), f"{self._where}, the set {now.name}")
        foreign, questions = (self._words if now.words else self._decimal)(now, display)
        digest = digest_of_set(now.notes, questions)
        if digest != now.digest:
            self._refuse(f"questions or notes of the set {now.name} were changed", AGAIN)
        self._hashes.append(digest)
        return foreign

    def _decimal(self, now: _Set, display: Display) -> tuple[Foreign, bytes]:
        table = _whole(now.lines)
        if table is None:
            table = np.array([self._row(now, n, line) for n, line in enumerate(now.lines)])
        given = Out(now.name, display, table[:, :2], table[:, 2:4], now.model)
        status, lenslet, origin, direction = (
            np.ascontiguousarray(part) for part in np.split(table[:, 4:], [1, 3, 6], 1)
        )
        alone = np.isnan(direction[:, 0])
        fields = {"lenslet": lenslet, "origin_mm": origin, "direction": direction, "status": status}
        return Foreign(given, fields, alone=alone), numbers_as_bytes(table[:, :4])

    def _row(self, now: _Set, n: int, line: bytes) -> list[float]:
        """Return the numbers of a line behind its ray's, filled up with NaN where a lost ray has its status alone."""
        words = self._columns(now, n, line)
        answered = len(words) - ASKED
        if answered not in (ANSWERED, LOST):
            self._wrong(now, n, f"has {answered} numbers behind its question", REMEDY)
        try:
            # Python takes 1_0 for 10.
            row = [float(word.replace("_", "?")) for word in words[1:]]
        except ValueError:
            self._wrong(now, n, "has a word that is no number", REMEDY)
        if not all(map(math.isfinite, row)):
            self._wrong(now, n, "has a number that is not finite", "give the status alone for a ray that is lost")
        if any(abs(one) > MOST_WHOLE or one % 1.0 for one in row[ASKED - 1 : ASKED + 2]):
            self._wrong(now, n, "has a status or lenslet that is no integer, or too large", REMEDY)
        if answered == LOST and row[-1] not in (Status.MISSED, Status.INTERNAL_REFLECTION, Status.BLOCKED):
            self._wrong(now, n, "has its status alone, and is not lost", REMEDY)
        return row + [math.nan] * (ANSWERED - answered)

    def _columns(self, now: _Set, n: int, line: bytes) -> list[str]:
        """Return the words of a line, the first of which is the ray's number."""
        try:
            words = line.decode("ascii").split()
        except UnicodeDecodeError:
            self._wrong(now, n, "is not text", AGAIN)
        if not words or words[0] != str(n):
            self._wrong(now, n, f"has ray {words[0][:20] if words else 'none'} where {n} is next", AGAIN)
        return words

    def _words(self, now: _Set, display: Display) -> tuple[Foreign, bytes]:
        rows = [self._columns(now, n, line) for n, line in enumerate(now.lines)]
        for n, row in enumerate(rows):
            if len(row) != 3:
                self._wrong(
                    now, n, f"has {len(row) - 2} words behind its question", "append the bits of a line of expected.mem"
                )
        names = (INPUTS, OUTPUTS)
        columns: dict[str, Ints] = {}
        for place, some in enumerate(names, 1):
            texts = [row[place] for row in rows]
            digits = hex_digits(widths(some, now.fraction_bits))
            for n, text in enumerate(texts):
                if len(text) != digits or not HEXADECIMAL.fullmatch(text):
                    self._wrong(now, n, f"has '{text[:40]}' for {digits} hexadecimal digits", "give leading zeros too")
            words = words_of_lines(texts, widths(some, now.fraction_bits), partial(self._at, now))
            columns |= dict(zip(some, words, strict=True))
        asked = memory_lines([columns[name] for name in INPUTS], widths(INPUTS, now.fraction_bits))
        return foreign_words(columns, display, now.model, now.fraction_bits), words_as_bytes(asked)

    def _at(self, now: _Set, n: int) -> str:
        return f"{self._where}, line {now.first + n}"

    def _wrong(self, now: _Set, n: int, what: str, remedy: str) -> NoReturn:
        raise input_error(self._at(now, n), what, remedy)


def bounded_lines(file: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of a file as they come; of one that is too long its first part, and then the next."""
    return iter(partial(file.readline, MOST_LINE + 1), b"")


_NUMBERS = msgspec.json.Decoder(list[float])
#: All characters but blanks and ends of lines; these as commas.
_OTHERS = bytes(set(range(256)) - set(b" \n"))
_COMMAS = bytes.maketrans(b" \n", b",,")


def _by_json(text: bytes) -> npt.NDArray[np.float64] | None:
    """Return the numbers between single blanks; None: numpy, which takes more than twice as long, is to read them."""
    listed = text.rstrip().translate(_COMMAS)
    if b"-0," in listed or listed.endswith(b"-0"):  # a whole number without a sign here
        return None
    try:
        return np.array(_NUMBERS.decode(b"[%b]" % listed))
    except (msgspec.DecodeError, RecursionError):
        return None


def _by_numpy(text: bytes) -> npt.NDArray[np.float64] | None:
    """Return the numbers between blanks; None where something is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _rows(lines: list[bytes]) -> npt.NDArray[np.float64] | None:
    """Return the numbers (N, 14) of N lines that have so many each; None where one has not."""
    columns, text = ASKED + ANSWERED, b"".join(lines)
    # Of lines with so many blanks none has more numbers, so each has as many when all together have.
    single = text.translate(None, _OTHERS) == (b" " * (columns - 1) + b"\n") * len(lines) and b"\t" not in text
    table = _by_json(text) if single else None
    if table is None:
        table = _by_numpy(text)
    if table is None or len(table) != len(lines) * columns:
        return None
    if not single and any(len(line.split()) != columns for line in lines):
        return None
    return table.reshape(len(lines), columns)


def _whole(lines: list[bytes]) -> npt.NDArray[np.float64] | None:
    """Return the numbers of lines that are all whole, each behind its ray's number; None: each is to be looked at."""
    table = np.empty((len(lines), ASKED + ANSWERED))
    for first, some in _parts(lines):
        rows = _rows(some)
        if rows is None:
            return None
        table[first : first + len(some)] = rows
    whole = table[:, ASKED : ASKED + 3]
    good = (table[:, 0] == np.arange(len(lines))).all() and np.isfinite(table).all()
    return table[:, 1:] if good and (np.abs(whole) <= MOST_WHOLE).all() and (whole == np.round(whole)).all() else None


def _parts(lines: list[bytes]) -> Iterator[tuple[int, list[bytes]]]:
    """Yield lines in parts that stay in a processor's cache, each behind the number of its first."""
    return ((first, lines[first : first + PART]) for first in range(0, len(lines), PART))
