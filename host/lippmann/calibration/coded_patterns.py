"""Draw pictures that encode panel coordinates for a camera by Gray code and phase shift.

In phase picture n of N with period T, the light at the coordinate u (column or row;
pixel centres are at 1/2) is

    I = 1/2 + 1/2 cos(2 pi (u / T - n / N)).

The Gray code encodes the index floor(u / (T/2)) of the half period. Phase and half
period give u, even if a half period is misread near its edge. With N = 8, harmonics of
the camera's tone curve up to the sixth do not change the phase.

The first and the last picture show marks for aiming the camera. If the camera did not
move, both photographs of the marks are equal.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from lippmann import __version__
from lippmann.base import toml
from lippmann.base.files import make_folder, write_file
from lippmann.base.toml import key, toml_text
from lippmann.base.tones import encoded_values
from lippmann.display.description import Display, Side
from lippmann.errors import InputError, input_error
from lippmann.rendering.integral_image import IntegralImage

Kind = Literal["marks", "white", "black", "gray", "phase"]
#: Period of the phase pictures in panel pixels, and their number per axis.
PERIOD_PX = 16
STEPS = 8
#: File that describes a set of patterns.
FILE = "patterns.toml"
Floats = npt.NDArray[np.floating]
Singles = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Pattern:
    """A picture: index in the set, kind, axis (0 columns, 1 rows), and number of the bit or phase step."""

    place: int
    kind: Kind
    axis: int = 0
    number: int = 0

    @property
    def stem(self) -> str:
        """File name of the picture without extension."""
        coded = f"-{'xy'[self.axis]}-{self.number}" if self.kind in ("gray", "phase") else ""
        again = "-again" if self.kind == "marks" and self.number > 0 else ""
        return f"{self.place:02d}-{self.kind}{coded}{again}"


@dataclass(frozen=True)
class PatternsFile:
    """Contents of the file `patterns.toml`."""

    display: Annotated[str, key("display name")]
    identity: Annotated[str, key("hash of the display for which the pictures were drawn")]
    width_px: Annotated[Side, key("panel width, px")]
    height_px: Annotated[Side, key("panel height, px")]
    code: Annotated[Literal["gray+phase"], key("type of code")]
    period_px: Annotated[int, key("period of the phase pictures, pixels", low=4, high=256)]
    steps: Annotated[int, key("number of phase pictures per axis", low=3, high=64)]
    files: Annotated[tuple[str, ...], key("file names of the pictures in order", shape="a list of file names")]


@dataclass(frozen=True)
class PatternSet:
    """The set of pictures for a panel of this size."""

    width_px: int
    height_px: int
    period_px: int = PERIOD_PX
    steps: int = STEPS

    @classmethod
    def of(cls, display: Display) -> PatternSet:
        """Return the set of pictures for a display's panel."""
        return cls(*display.panel.size_px)

    @property
    def sides_px(self) -> tuple[int, int]:
        """Panel width and height in pixels."""
        return self.width_px, self.height_px

    @property
    def half_px(self) -> float:
        """Half a period, pixels: the width of the Gray code's finest stripes."""
        return 0.5 * self.period_px

    def bits(self, axis: int) -> int:
        """Return the number of Gray code pictures for columns (0) or rows (1)."""
        return max(1, int(np.ceil(self.sides_px[axis] / self.half_px) - 1).bit_length())

    @cached_property
    def patterns(self) -> tuple[Pattern, ...]:
        """All pictures of the set, in order."""
        kinds: list[tuple[Kind, int, int]] = [("marks", 0, 0), ("white", 0, 0), ("black", 0, 0)]
        for axis in (0, 1):
            kinds += [("gray", axis, bit) for bit in reversed(range(self.bits(axis)))]
        for axis in (0, 1):
            kinds += [("phase", axis, step) for step in range(self.steps)]
        kinds.append(("marks", 0, 1))
        return tuple(Pattern(place, *one) for place, one in enumerate(kinds))

    def level(self, pattern: Pattern, at_px: Floats) -> Floats:
        """Return a coded picture's light, 0 to 1, at coordinates along its axis."""
        if pattern.kind == "phase":
            turns = at_px / self.period_px - pattern.number / self.steps
            return np.asarray(0.5 + 0.5 * np.cos(2.0 * np.pi * turns))
        half = np.floor(at_px / self.half_px).astype(np.int64)
        return np.asarray(((half ^ (half >> 1)) >> pattern.number) & 1, np.float32)

    def turn(self, pattern: Pattern) -> complex:
        """Return exp(2 pi i n / N) for phase picture n of N."""
        return complex(np.exp(2j * np.pi * pattern.number / self.steps))

    def half_of(self, code: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
        """Convert Gray codes to half-period indices."""
        half = code.copy()
        for shift in (8, 4, 2, 1):
            half ^= half >> half.dtype.type(shift)
        return half

    def point(self, phase: Floats, half: npt.NDArray[np.integer]) -> Singles:
        """Return the coordinates, px, with these phases (radians) nearest to the middles of half periods `half`."""
        fine = (phase * np.float32(self.period_px / (2.0 * np.pi))).astype(np.float32)
        near = (half.astype(np.float32) + np.float32(0.5)) * np.float32(self.half_px)
        periods = np.round((near - fine) * np.float32(1.0 / self.period_px))
        return np.asarray(fine + periods * np.float32(self.period_px), np.float32)

    def light(self, pattern: Pattern) -> Singles:
        """Return a picture's light (height, width), 0 to 1, possibly as a read-only broadcast."""
        shape = self.height_px, self.width_px
        if pattern.kind == "marks":
            return _marks(*shape)
        if pattern.kind in ("white", "black"):
            return np.broadcast_to(np.float32(pattern.kind == "white"), shape)
        along = np.arange(self.sides_px[pattern.axis]) + 0.5
        line = self.level(pattern, along).astype(np.float32)
        return np.broadcast_to(line[None] if pattern.axis == 0 else line[:, None], shape)

    def panel_values(self, pattern: Pattern, display: Display) -> Pixels:
        """Return a picture as panel values (height, width, 3) uint8."""
        panel = display.panel
        values = encoded_values(self.light(pattern), panel.transfer, min(panel.bits, 8)).astype(np.uint8)
        return np.ascontiguousarray(np.broadcast_to(values[..., None], (*values.shape, 3)))

    @property
    def files(self) -> tuple[str, ...]:
        """File names of all pictures, in order."""
        return tuple(f"{one.stem}.png" for one in self.patterns)

    def text(self, display: Display) -> str:
        """Return the text of `patterns.toml`."""
        head = display.name, display.identity, self.width_px, self.height_px
        file = PatternsFile(*head, "gray+phase", self.period_px, self.steps, self.files)
        return toml_text(vars(file), one_line=False)


class AxisCode:
    """Gray code, doubtful bit count and complex phase sum of each camera pixel for one axis."""

    def __init__(self, patterns: PatternSet, axis: int, shape: tuple[int, ...]) -> None:
        self.patterns, self.axis = patterns, axis
        self.code, self.doubtful = np.zeros(shape, np.uint16), np.zeros(shape, np.uint8)
        self.wave = np.zeros(shape, np.complex64)

    def add(self, pattern: Pattern, share: Floats) -> None:
        """Add a pattern's photograph; `share` is its light, scaled to -1/2 for black, 1/2 for white."""
        if pattern.kind == "gray":
            self.code |= (share > 0.0).astype(np.uint16) << np.uint16(pattern.number)
            self.doubtful += abs(share) < 0.12  # light near the mean of black and white
        else:
            self.wave += share * np.complex64(self.patterns.turn(pattern))

    @property
    def amplitude(self) -> Singles:
        """Amplitude of each pixel's phase cosine; 1 spans the range from black to white."""
        return abs(self.wave) * np.float32(4.0 / self.patterns.steps)

    def points(self) -> tuple[Singles, npt.NDArray[np.bool_]]:
        """Return each camera pixel's panel coordinate, pixels, and whether it is reliable."""
        points = self.patterns.point(np.angle(self.wave), self.patterns.half_of(self.code))
        # A weaker cosine is noise. At a Gray code edge, one bit is doubtful.
        good = (self.amplitude > 0.2) & (self.doubtful <= 1)
        return points, good & (points >= 0.0) & (points <= self.patterns.sides_px[self.axis])


def _marks(height: int, width: int) -> Singles:
    light = np.ones((height, width), np.float32)
    y, x = np.arange(height)[:, None], np.arange(width)[None]
    line = max(1, min(height, width) // 24)
    light[(np.minimum(x, width - 1 - x) < line) | (np.minimum(y, height - 1 - y) < line)] = 0.0
    light[(abs(2 * x + 1 - width) < line) | (abs(2 * y + 1 - height) < line)] = 0.0
    light[(x < width // 4) & (y < height // 4)] = 0.0
    return light


def write_patterns(patterns: PatternSet, display: Display, folder: Path) -> list[Path]:
    """Write the pictures and `patterns.toml`; return the pictures' paths. Raises the errors of `make_folder`."""
    make_folder(folder)
    files = [folder / name for name in patterns.files]
    with contextlib.ExitStack() as unfinished:
        for pattern, file in zip(patterns.patterns, files, strict=True):
            light = np.broadcast_to(patterns.light(pattern)[..., None], (patterns.height_px, patterns.width_px, 3))
            unfinished.callback(file.unlink, missing_ok=True)
            IntegralImage(light, display, {"pattern": pattern.stem, "version": __version__}).save(file)
        write_file(folder / FILE, patterns.text(display))
        unfinished.pop_all()
    return files


def read_patterns(path: Path, display: Display) -> PatternSet:
    """Read `patterns.toml`; raise InputError if the patterns were drawn for another panel size."""
    raw = toml.read(PatternsFile, toml.load(path, "patterns"), str(path))
    panel = display.panel
    if (raw.width_px, raw.height_px) != panel.size_px:
        what = (
            f"the patterns of '{raw.display}' are {raw.width_px} x {raw.height_px} pixels, but the panel of "
            f"'{display.name}' has {panel.width_px} x {panel.height_px}"
        )
        raise input_error(path, what, "give the display file of the patterns")
    patterns = PatternSet(raw.width_px, raw.height_px, raw.period_px, raw.steps)
    if raw.files != patterns.files:
        raise InputError(f"{path}: files: the list does not match period_px and steps; draw the patterns again")
    return patterns
