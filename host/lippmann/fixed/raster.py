"""Compute a frame's jittered rays (rtl/optics/lipp_raster.sv), and pixel positions in cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from lippmann.base.toml import check_fields, documented, key
from lippmann.display.description import Grid
from lippmann.errors import InputError
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.ray_start import pixel_to_lenslet
from lippmann.fixed.words import MUL_BITS, PIXEL_BITS, PIXEL_FRACTION, SLOPE_BITS, Bools, Ints, wrapped

#: Sources of jitter, in the order of their codes in the register.
Jitter = Literal["off", "table", "lfsr"]

TABLE_ENTRIES = 64
#: Bits and fraction bits of an aperture coordinate in a jitter entry.
AIM_BITS = 12
AIM_FRACTION = 10
#: Maximum columns or rows of a panel, and maximum rays per pixel.
MAX_PANEL = (1 << (PIXEL_BITS - PIXEL_FRACTION)) - 1
MAX_SAMPLES = 1 << 16

#: x^32 modulo the LFSR's polynomial x^32 + x^22 + x^2 + x + 1; bit k is the coefficient of x^k.
POLYNOMIAL = 0x00400007


@documented
@dataclass(frozen=True)
class Raster:
    """A frame's window on a panel, and its jitter.

    Raises InputError if a value does not fit its register.
    """

    width: Annotated[int, key("columns of the panel", low=1, high=MAX_PANEL)]
    height: Annotated[int, key("rows of the panel", low=1, high=MAX_PANEL)]
    columns: Annotated[tuple[int, int], key("first and last column of the window; 0 is the leftmost")]
    rows: Annotated[tuple[int, int], key("first and last row of the window; 0 is the topmost")]
    samples: Annotated[int, key("rays for each pixel, 1 to 65536", low=1, high=MAX_SAMPLES)] = 1
    jitter: Annotated[Jitter, key("source of the offsets from the centres of pixel and lenslet")] = "off"
    table_first: Annotated[int, key("table entry of sample 0", low=0, high=TABLE_ENTRIES - 1)] = 0
    seed: Annotated[int, key("first random word, 32 bits; 0 counts as 1", low=0, high=(1 << 32) - 1)] = 1

    def __post_init__(self) -> None:
        check_fields(self)
        axes = ("columns", self.width, self.columns), ("rows", self.height, self.rows)
        for name, size, (first, last) in axes:
            if not 0 <= first <= last < size:
                raise InputError(
                    f"raster: {name} {first} to {last} are not a window of a panel of {size}; "
                    f"choose 0 <= first <= last <= {size - 1}"
                )

    @property
    def rays(self) -> int:
        """Number of rays of the frame."""
        pixels = (self.columns[1] - self.columns[0] + 1) * (self.rows[1] - self.rows[0] + 1)
        return pixels * self.samples


class RasterRays(NamedTuple):
    """A frame's rays (N,): words of pixel and aperture point, flags of first and last ray."""

    u: Ints
    v: Ints
    a: Ints
    b: Ints
    first: Bools
    last: Bools


def raster(frame: Raster, table: Ints, f: int) -> RasterRays:
    """Return a frame's rays in raster order; `table` (64,) is the jitter table."""
    (first_column, last_column), (first_row, last_row) = frame.columns, frame.rows
    window = np.mgrid[first_row : last_row + 1, first_column : last_column + 1, : frame.samples]
    rows, columns, sample = window.reshape(3, -1)
    if frame.jitter == "off":
        entry = np.zeros(frame.rays, np.int64)
    elif frame.jitter == "table":
        entry = table[(frame.table_first + sample) % TABLE_ENTRIES]
    else:
        entry = lfsr(frame.seed, frame.rays)
    du, dv, ja, jb = fields(entry)
    if frame.jitter == "lfsr":
        ja, jb = wrapped(ja, AIM_FRACTION), wrapped(jb, AIM_FRACTION)
    at = np.arange(frame.rays)
    scale = f - AIM_FRACTION
    u, v = 8 * (2 * columns + 1 - frame.width) + du, 8 * (frame.height - 2 * rows - 1) + dv
    return RasterRays(u, v, ja << scale, jb << scale, at == 0, at == frame.rays - 1)


def fields(entry: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Split jitter entries into du, dv (pixels, 4 fraction bits) and ja, jb (pitches, rows, 10 fraction bits)."""
    ja, jb = wrapped(entry >> 8, AIM_BITS), wrapped(entry >> 20, AIM_BITS)
    return wrapped(entry, 4), wrapped(entry >> 4, 4), ja, jb


def lfsr(seed: int, count: int) -> Ints:
    """Return the first random words (count,) of a seed: s_k = seed x^(32 k) modulo POLYNOMIAL.

    Each iteration doubles the number of words: s_(k + n) = s_k x^(32 n).
    """
    states, leap = np.array([seed or 1], np.int64), POLYNOMIAL  # x^32
    while len(states) < count:
        states = np.concatenate([states, _times(states[: count - len(states)], leap)])
        leap = int(_times(np.array([leap], np.int64), leap)[0])
    return states[:count]


def _times(states: Ints, factor: int) -> Ints:
    product = np.zeros_like(states)
    for bit in reversed(range(32)):
        product = (product << 1) ^ np.where(product >> 31, (1 << 32) | POLYNOMIAL, 0)
        if factor >> bit & 1:
            product ^= states
    return product


def locate_pixels(
    config: Configuration, grid: Grid, f: int, width: int, height: int, columns: Ints, rows: Ints
) -> tuple[Ints, Ints, Ints, Ints]:
    """Return the lenslets (i, j) of pixels, and positions from the lenslets' centres, x in pitches, y in rows."""
    u, v = 8 * (2 * columns + 1 - width), 8 * (height - 1 - 2 * rows)
    return pixel_to_lenslet(u, v, config, grid, f)[:4]


def holds_centre(config: Configuration, f: int, x: Ints, y: Ints) -> Bools:
    """Mark pixels that contain their lenslet's centre, at (-x, -y) from the pixel."""
    cut = SLOPE_BITS - MUL_BITS
    xu, xv = config.x_from_u >> cut, config.x_from_v >> cut
    yu, yv = config.y_from_u >> cut, config.y_from_v >> cut
    x, y = ((w << (MUL_BITS - 1)) >> f for w in (x, y))
    det = xu * yv - xv * yu
    limit = (det >> 3) + (det >> 7)
    return (abs(yv * x - xv * y) <= limit) & (abs(xu * y - yu * x) <= limit)


def places_in_cell(grid: Grid, f: int, x: Ints, y: Ints) -> tuple[Ints, Ints]:
    """Return positions of pixels in their cells, to the right and upward, 0 to 255."""
    up = y - (y >> 2) if grid == "hex" else y
    return np.clip((256 * x + (128 << f)) >> f, 0, 255), np.clip((256 * up + (128 << f)) >> f, 0, 255)
