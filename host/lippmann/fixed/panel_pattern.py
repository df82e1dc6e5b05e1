"""The board's test patterns that follow the lenslets (rtl/panel/lipp_test_pattern.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.lenslet_hex import lenslet_hex
from lippmann.fixed.lenslet_square import lenslet_square
from lippmann.fixed.pixel_to_lattice import pixel_to_lattice
from lippmann.fixed.words import MUL_BITS, SLOPE_BITS, Bools, Ints


def located(
    config: Configuration, grid: Grid, f: int, width: int, height: int, columns: Ints, rows: Ints
) -> tuple[Ints, Ints, Ints, Ints]:
    """Return lenslets i, j of pixels, and the points x (pitches), y (rows) from their centres, F fraction bits."""
    u, v = 8 * (2 * columns + 1 - width), 8 * (height - 1 - 2 * rows)
    x, _ = pixel_to_lattice(u, v, config.x_from_u, config.x_from_v, config.x_offset, f)
    y, _ = pixel_to_lattice(u, v, config.y_from_u, config.y_from_v, config.y_offset, f)
    i, j, x, y, _ = (lenslet_hex if grid == "hex" else lenslet_square)(x, y, f)
    return i, j, x, y


def centres(config: Configuration, f: int, x: Ints, y: Ints) -> Bools:
    """Tell whether a lenslet's centre lies in the pixel, from the point x, y from it."""
    cut = SLOPE_BITS - MUL_BITS
    xu, xv, yu, yv = (w >> cut for w in (config.x_from_u, config.x_from_v, config.y_from_u, config.y_from_v))
    x, y = ((w << (MUL_BITS - 1)) >> f for w in (x, y))
    det = xu * yv - xv * yu
    limit = (det >> 3) + (det >> 7)
    return np.asarray((abs(yv * x - xv * y) <= limit) & (abs(xu * y - yu * x) <= limit))


def views(grid: Grid, f: int, x: Ints, y: Ints) -> tuple[Ints, Ints]:
    """Return the place in the lenslet, to the right and upward, 0 to 255."""
    up = y - (y >> 2) if grid == "hex" else y
    return np.clip((256 * x + (128 << f)) >> f, 0, 255), np.clip((256 * up + (128 << f)) >> f, 0, 255)
