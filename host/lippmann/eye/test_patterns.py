"""Draws test patterns for a panel, among them those of a board's register `display.pattern`.

A pixel's position in its lenslet's cell is where the line from the pixel's centre to
the eye crosses the aperture plane (`optics.system`). Without a viewing distance, the
position is the pixel's centre.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from lippmann import __version__
from lippmann.base import interrupts
from lippmann.base.tones import BAND_ROWS, decode
from lippmann.base.variant import current_device, dr, mi
from lippmann.display.description import Display
from lippmann.errors import InputError, check_choice
from lippmann.eye.observer import CHUNK_RAYS, Eye, eye_rays
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import holds_centre, locate_pixels, places_in_cell
from lippmann.optics.backend import DrJitBackend, NumpyBackend
from lippmann.optics.rays import Bools, Indices, Status
from lippmann.optics.system import System
from lippmann.optics.trace import pixels_from_rays
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.sampling import Window

Kind = Literal["lens-centres", "cells", "view-numbers", "single-lens", "white-for-eye", "ramp", "ramps", "checker"]
#: Patterns that a board draws too, in the order of `display.pattern`'s values from 1.
ON_BOARD: tuple[Kind, ...] = ("single-lens", "lens-centres", "view-numbers", "checker", "ramp")
#: Side of the checker's tiles, pixels, also in a board.
TILE = 32
#: Half the width, pixels, of a pixel that holds a lenslet's centre, plus rounding error.
IN_PIXEL = 17 / 32
#: Panel values from 0 to 1 in an array that broadcasts to (rows, columns, 3).
Values = npt.NDArray[np.generic]


class Places(NamedTuple):
    """Pixels' lenslets (i, j), whether pixels contain lenslet centres, and positions in cells, 0 to 255."""

    i: npt.NDArray[np.number]
    j: npt.NDArray[np.number]
    centre: Bools
    right: npt.NDArray[np.number]
    up: npt.NDArray[np.number]
    #: Whether the pixel's lenslet exists; pixels behind the opaque mount stay black.
    present: Bools


@dataclass(frozen=True)
class Pixels:
    """Pixels of a display at columns (1, N) and rows (M, 1), with `draw`'s options `lens`, `fraction_bits`."""

    display: Display
    column: Indices
    row: Indices
    lens: tuple[int, int]
    fraction_bits: int | None

    @cached_property
    def places(self) -> Places:
        """Lenslets of the pixels, and positions in the lenslets' cells."""
        panel = self.display.panel
        grid = self.display.array.grid
        system = System.of(self.display)
        columns, rows = np.broadcast_arrays(self.column, self.row)
        if (f := self.fraction_bits) is not None:
            config = configuration(self.display, Build.of(self.display, "pinhole", f, aims=False), "pinhole")
            i, j, x, y = locate_pixels(config, grid, f, *panel.size_px, columns, rows)
            centre, views = holds_centre(config, f, x, y), places_in_cell(grid, f, x, y)
            return Places(i, j, centre, *views, system.lattice.present(NumpyBackend(), i, j))
        u, v = columns + 0.5, rows + 0.5
        i, j, x, y = system.locate(NumpyBackend(), u, v)
        cx, cy = system.lattice.centre(i, j)
        x, y = system.convergence.within_cell(x, y, cx, cy)
        to_x, to_y = system.convergence.on_panel(np.zeros_like(cx), np.zeros_like(cy), cx, cy)
        at_u, at_v = system.frame.pixel_from_panel(*system.frame.panel_from_array(cx + to_x, cy + to_y))
        centre = (abs(at_u - u) <= IN_PIXEL) & (abs(at_v - v) <= IN_PIXEL)
        # A hexagonal cell is four thirds of a row pitch high.
        high = self.display.array.row_pitch_mm * (4.0 / 3.0 if grid == "hex" else 1.0)
        sides = (x - system.lattice.shear * y) / self.display.array.pitches_mm[0], y / high
        right, up = (np.clip(np.floor(256.0 * (side + 0.5)), 0, 255) for side in sides)
        return Places(i, j, centre, right, up, system.lattice.present(NumpyBackend(), i, j))


def lens_centres(at: Pixels) -> Values:
    """Return white where the eye sees a lenslet's centre."""
    return np.asarray((at.places.centre & at.places.present)[..., None])


def cells(at: Pixels) -> Values:
    """Return red, green or blue by (i - j) modulo 3, so that cells with a common side differ."""
    colour = np.where(at.places.present, (at.places.i - at.places.j) % 3, -1)
    return np.asarray(colour[..., None] == np.arange(3))


def view_numbers(at: Pixels) -> Values:
    """Return pixels' positions in cells as colours: red grows to the right, green upwards; blue is 0."""
    right, up = at.places.right * at.places.present, at.places.up * at.places.present
    return np.stack([right, up, np.zeros_like(up)], axis=2) / 255.0


def single_lens(at: Pixels) -> Values:
    """Return white in the cell of one lenslet."""
    its = (at.places.i == at.lens[0]) & (at.places.j == at.lens[1])
    return np.asarray((its & at.places.present)[..., None])


def checker(at: Pixels) -> Values:
    """Return black and white tiles; the tile at the top left is black."""
    return ((at.column // TILE + at.row // TILE) % 2)[..., None]


def ramp(at: Pixels) -> Values:
    """Return grey levels: (column modulo 256) / 255."""
    return (at.column % 256)[..., None] / 255.0


def ramps(at: Pixels) -> Values:
    """Return bands of grey, red, green and blue from the top; each starts black at the left.

    Each band has all levels of the panel, or one level per column if columns are fewer.
    """
    panel = at.display.panel
    columns, top = panel.width_px, (1 << panel.bits) - 1
    fine = columns > top
    value = (at.column * (top + 1) // columns if fine else at.column * top // max(1, columns - 1)) / top
    colours = np.array([[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return np.asarray(value[..., None] * colours[4 * at.row[:, 0] // panel.height_px][:, None])


PATTERNS: dict[Kind, Callable[[Pixels], Values]] = {
    "lens-centres": lens_centres,
    "cells": cells,
    "view-numbers": view_numbers,
    "single-lens": single_lens,
    "ramp": ramp,
    "ramps": ramps,
    "checker": checker,
}


def white_for_eye(display: Display, eye: Eye) -> Values:
    """Return 1 for pixels that an eye sees through their own lenslets, else 0, (height, width)."""
    panel, b, system = display.panel, DrJitBackend(current_device()), System.of(display)
    # A lenslet spreads its rays on the panel: trace one ray per half pixel of the spread.
    spread = abs(1.0 - display.aperture_distance_mm / display.array.focal_length_mm)
    samples = min(2 + int(np.ceil(2.0 * spread)), 8) ** 2
    window = Window(panel.width_mm, panel.height_mm, *panel.size_px)
    total = panel.width_px * panel.height_px
    white, chunk = dr.zeros(mi.Float, total), max(1, CHUNK_RAYS // samples)
    for start in range(0, total, chunk):
        interrupts.check()
        index = dr.arange(mi.UInt32, min(chunk, total - start) * samples)
        pixel = dr.opaque(mi.UInt32, start) + index // samples
        hits = pixels_from_rays(b, system, *eye_rays(b, eye, window, pixel, index % samples, 0), "exact")
        at = mi.UInt32(dr.clip(dr.floor(hits.v), 0, panel.height_px - 1)) * panel.width_px
        at += mi.UInt32(dr.clip(dr.floor(hits.u), 0, panel.width_px - 1))
        dr.scatter(white, 1.0, at, hits.status == int(Status.OK))
        dr.eval(white)
    return np.asarray(white).reshape(panel.shape[:2])


def draw(
    display: Display,
    kind: Kind,
    eye: Eye | None = None,
    lens: tuple[int, int] | None = None,
    fraction_bits: int | None = None,
) -> IntegralImage:
    """Return a test pattern for a display.

    The pattern "white-for-eye" needs an `eye`. `lens` is the lenslet (i, j) of
    "single-lens", by default (0, 0). With `fraction_bits`, the pattern is computed in
    fixed point, as in a board. Raises InputError for an option of another pattern, and
    for a display that does not fit a board's registers.
    """
    check_choice("pattern", kind, get_args(Kind))
    if eye is None and kind == "white-for-eye":
        raise InputError("the pattern white-for-eye needs an eye; give its position, --eye X,Y,Z in mm")
    if eye is not None and kind != "white-for-eye":
        raise InputError("--eye belongs to the pattern white-for-eye; leave it out")
    if lens is not None and kind != "single-lens":
        raise InputError("--lens belongs to the pattern single-lens; leave it out")
    if fraction_bits is not None and kind not in ON_BOARD:
        raise InputError(f"--fraction-bits belongs to the patterns of a board, {', '.join(ON_BOARD)}; leave it out")
    panel = display.panel
    light = np.empty(panel.shape, np.float32)
    white = None if eye is None else white_for_eye(display, eye)
    for first in range(0, panel.height_px, BAND_ROWS):
        rows = np.arange(first, min(first + BAND_ROWS, panel.height_px))[:, None]
        at = Pixels(display, np.arange(panel.width_px)[None], rows, lens or (0, 0), fraction_bits)
        values = PATTERNS[kind](at) if white is None else white[rows[:, 0], :, None]
        light[rows[:, 0]] = decode(values, panel.transfer)
    if lens is not None and not light.any():
        raise InputError(f"lenslet {lens[0]:g},{lens[1]:g} owns no pixel; give another one, such as 0,0 in the middle")
    metadata = {"pattern": kind, "version": __version__}
    if eye is not None:
        metadata["eye_mm"] = str(eye.position_mm)
    return IntegralImage(light, display, metadata)
