"""Reads the answers of a program that stands in a stream of rays; see `lippmann.conditioning.stream`.

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
from typing import NoReturn, get_args

import numpy as np
import numpy.typing as npt

from lippmann.conditioning.cases import Out
from lippmann.conditioning.stream import NAME, VERSION, digest_of_all, digest_of_numbers, digest_of_words
from lippmann.conditioning.vectors import INPUTS, OUTPUTS, memory_lines, widths, words_of_lines
from lippmann.diagnose.foreign import Foreign, foreign_words
from lippmann.display import Display, parse_display
from lippmann.errors import input_error
from lippmann.fixed.words import FRACTIONS, Ints
from lippmann.optics.rays import Model, Status

#: Numbers of a question, of a whole answer, and of the answer of a ray that is lost.
ASKED, ANSWERED, LOST = 5, 9, 1
#: Longest line, bytes; most rays of a set.
MOST_LINE, MOST_RAYS = 4096, 200_000
#: Most lines of a set's display file.
MOST_NOTES = 1000
#: Names of sets.
SET = re.compile(r"[\w.+/-]{1,100}", re.ASCII)
#: Greatest magnitude of a status or an index in an answer, so that it is an integer without rounding.
MOST_WHOLE = 2.0**31
REMEDY = "append status i j x y z dx dy dz"
AGAIN = "copy each line that begins with #, and append to each other line"


@dataclass
class _Set:
    """A set that is being read: what its notes say, and its lines."""

    name: str
    words: bool = False
    model: Model = "exact"
    fraction_bits: int = 0
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
        self._lines, self._where = lines, where
        self._hashes: list[str] = []

    def sets(self) -> Iterator[tuple[str, Foreign]]:
        """Yield each set's name, and its rays."""
        now: _Set | None = None
        begun = ended = False
        for raw in self._lines:
            self.number += 1
            if ended:  # a simulator's last words
                continue
            if len(raw) > MOST_LINE:
                self._refuse(f"has more than {MOST_LINE} bytes", AGAIN)
            if now is not None and not raw.startswith(b"#"):
                self._keep(now, raw)
                continue
            line = self._text(raw)
            kind, _, rest = line[1:].strip().partition(" ")
            if not begun:
                begun = self._begin(line)
            elif not line.startswith("#"):
                self._refuse("has a ray before the first set", AGAIN)
            elif kind in ("set", "end"):
                if now is not None:
                    yield now.name, self._read(now)
                ended = kind == "end"
                if ended:
                    self._end(rest)
                now = None if ended else self._started(rest)
            elif now is not None:
                self._note(now, kind, rest)
        if not begun:
            what = "is no stream of lippmann vectors" if self.number else "is empty: the program before gave nothing"
            self._refuse(what, "run lippmann vectors --stream | YOUR PROGRAM alone to see why")
        if not ended:
            where = "" if now is None else f" in the set {now.name}, after {len(now.lines)} of its rays"
            self._refuse(f"is cut{where}", "let the program answer until the line # end")

    def _refuse(self, what: str, remedy: str) -> NoReturn:
        raise input_error(f"{self._where}, line {self.number}" if self.number else self._where, what, remedy)

    def _text(self, raw: bytes) -> str:
        try:
            return raw.decode("utf-8").rstrip("\r\n")
        except UnicodeDecodeError:
            self._refuse("is not text", AGAIN)

    def _begin(self, line: str) -> bool:
        """Tell whether a line is the first one; a simulator may greet before it."""
        found = re.fullmatch(rf"# {NAME} (\d{{1,9}})", line.strip())
        if found and int(found[1]) != VERSION:
            self._refuse(f"has version {found[1]}, not {VERSION}", "use one version of lippmann for both commands")
        return found is not None

    def _started(self, name: str) -> _Set:
        if not SET.fullmatch(name):
            self._refuse("is no name of a set", AGAIN)
        return _Set(name)

    def _note(self, now: _Set, kind: str, rest: str) -> None:
        words = rest.split()
        if kind == "display":
            now.file.append(rest)
            if len(now.file) > MOST_NOTES:
                self._refuse(f"the set {now.name} has more than {MOST_NOTES} lines of display", AGAIN)
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
            now.expected, now.digest = int(words[0]), words[1]

    def _keep(self, now: _Set, raw: bytes) -> None:
        if len(now.lines) >= now.expected:
            what = "before its number" if now.expected < 0 else f"beyond its {now.expected}"
            self._refuse(f"the set {now.name} has a ray {what}", AGAIN)
        now.lines.append(raw)

    def _end(self, rest: str) -> None:
        if rest.split() != [str(len(self._hashes)), digest_of_all(self._hashes)]:
            self._refuse("sets are missing, or are of another stream", AGAIN)

    # ---- a whole set ----

    def _read(self, now: _Set) -> Foreign:
        if now.expected != len(now.lines):
            self._refuse(f"the set {now.name} has {len(now.lines)} of its {max(0, now.expected)} rays", AGAIN)
        display = parse_display("\n".join(now.file), f"{self._where}, the set {now.name}")
        now.first = self.number - len(now.lines)
        foreign, digest = (self._words if now.words else self._decimal)(now, display)
        if digest != now.digest:
            self._refuse(f"questions of the set {now.name} were changed", AGAIN)
        self._hashes.append(digest)
        return foreign

    def _decimal(self, now: _Set, display: Display) -> tuple[Foreign, str]:
        table = _whole(now.lines)
        if table is None:
            table = np.array([self._row(now, n, line) for n, line in enumerate(now.lines)])
        given = Out(now.name, display, table[:, :2], table[:, 2:4], now.model)
        status, lenslet, origin, direction = (
            np.ascontiguousarray(part) for part in np.split(table[:, 4:], [1, 3, 6], 1)
        )
        alone = np.isnan(direction[:, 0])
        fields = {"lenslet": lenslet, "origin_mm": origin, "direction": direction, "status": status}
        return Foreign(given, fields, alone=alone), digest_of_numbers(table[:, :4])

    def _row(self, now: _Set, n: int, line: bytes) -> list[float]:
        """Return the numbers of a line behind its ray's, filled up with NaN where a lost ray has its status alone."""
        words = self._columns(now, n, line)
        answered = len(words) - ASKED
        if answered not in (ANSWERED, LOST):
            self._wrong(now, n, f"has {answered} numbers behind its question", REMEDY)
        try:
            row = [float(word) for word in words[1:]]
        except ValueError:
            self._wrong(now, n, "has a word that is no number", REMEDY)
        if not all(map(math.isfinite, row)):
            self._wrong(now, n, "has a number that is not finite", "give the status alone for a ray that is lost")
        if any(abs(one) > MOST_WHOLE or one % 1.0 for one in row[ASKED - 1 : ASKED + 2]):
            self._wrong(now, n, "has a status or lenslet that is no integer", REMEDY)
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

    def _words(self, now: _Set, display: Display) -> tuple[Foreign, str]:
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
            words = words_of_lines(texts, widths(some, now.fraction_bits), partial(self._at, now))
            columns |= dict(zip(some, words, strict=True))
        asked = memory_lines([columns[name] for name in INPUTS], widths(INPUTS, now.fraction_bits))
        return foreign_words(columns, display, now.model, now.fraction_bits), digest_of_words(asked)

    def _at(self, now: _Set, n: int) -> str:
        return f"{self._where}, line {now.first + n}"

    def _wrong(self, now: _Set, n: int, what: str, remedy: str) -> NoReturn:
        raise input_error(self._at(now, n), what, remedy)


def _whole(lines: list[bytes]) -> npt.NDArray[np.float64] | None:
    """Return the numbers of lines that are all whole, each behind its ray's number; None: each is to be looked at."""
    columns = ASKED + ANSWERED
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of what is no number
        try:
            table = np.fromstring(b" ".join(lines), sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    if len(table) != len(lines) * columns or not all(len(line.split()) == columns for line in lines):
        return None
    table = table.reshape(len(lines), columns)
    whole = table[:, ASKED : ASKED + 3]
    good = (table[:, 0] == np.arange(len(lines))).all() and np.isfinite(table).all()
    return table[:, 1:] if good and (np.abs(whole) <= MOST_WHOLE).all() and (whole == np.round(whole)).all() else None
