"""Where the panel is met by the rays that a camera sends through the inner cell of a lenslet, on average.

The camera at C sees the outline of the lenslet at L on the plane z = h: the outline's sides are seams, which are below
the vertices of domes that face the viewer, and behind glass else. With the slope s = (C - L) / (Cz - h) the rays land,
on average over the inner cell, at L + w(s), and by symmetry w is close to

    w(s) = -s (a0 + a1 |s|^2 + a2 |s|^4 + gap (b0 + b1 |s|^2 + b2 |s|^4)).

The numbers are fitted to exact rays: Snell's law at each face. They contain what a paraxial D leaves out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lippmann.calibration.lenslets import INNER
from lippmann.display import Display
from lippmann.engines import trace_to_panel
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.optics.rays import gets_through
from lippmann.optics.sampling import square_to_cell

Floats = npt.NDArray[np.float64]
#: Height of an outline in sags of the corners: the mean over the cell's sides, as they move the outline's middle.
SEAM = {"square": 2.0 / 3.0, "hex": 5.0 / 6.0}
#: Rays across the inner cell, slopes from 0 to the steepest, and directions of the slope.
ACROSS, SLOPES, DIRECTIONS = 7, 9, 8


def outline_mm(display: Display) -> float:
    """Return the height z of the plane on which a camera sees the lenslets' outlines, mm."""
    array = display.array
    seam = SEAM[array.grid] * array.sag_mm
    if array.plano_side == "panel":
        return -seam
    return array.thickness_mm - (array.thickness_mm - seam) / array.index


@dataclass(frozen=True)
class Landing:
    """The numbers a and b of the module's formula, and the plane of outlines, mm."""

    fixed: Floats
    per_gap: Floats
    outline_mm: float
    #: Largest distance of exact means from the formula, mm.
    error_mm: float

    def point(self, slope: Floats, gap_mm: Floats | float) -> Floats:
        """Return w for slopes (N, 2) and a gap for all or for each, (N, 2) mm."""
        square = (slope**2).sum(axis=1)
        powers = np.stack([np.ones_like(square), square, square**2])
        reach = self.fixed @ powers + gap_mm * (self.per_gap @ powers)
        return np.asarray(-slope * reach[:, None])


def landing_of(display: Display, steepest: float, distance_mm: float) -> Landing:
    """Trace a display's lenslet from cameras at a distance, with slopes up to `steepest`."""
    array = replace(display.array, rotation_deg=0.0, offset_mm=(0.0, 0.0), extent_mm=None)
    plain = replace(display, array=array, viewing_distance_mm=None, viewing_axis_mm=(0.0, 0.0))
    radii = np.linspace(0.0, max(steepest, 0.05), SLOPES)[1:]
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS) + 0.1
    slopes = np.stack([np.outer(radii, f(angles)).ravel() for f in (np.cos, np.sin)], axis=1)
    gaps = display.gap_mm, display.gap_mm + 0.2 * display.aperture_distance_mm
    height = outline_mm(display)
    powers = np.stack([(slopes**2).sum(axis=1) ** k for k in range(3)], axis=1)
    design = -(slopes[:, :, None] * powers[:, None, :]).reshape(-1, 3)
    fits, errors = [], []
    for gap in gaps:
        # A panel so large that every ray meets it.
        at = _means(replace(plain, gap_mm=gap), slopes, height, distance_mm)
        numbers = np.linalg.lstsq(design, at.ravel(), rcond=None)[0]
        fits.append(numbers)
        errors.append(float(np.hypot(*(at - (design @ numbers).reshape(-1, 2)).T).max()))
    per_gap = (fits[1] - fits[0]) / (gaps[1] - gaps[0])
    return Landing(fits[0] - gaps[0] * per_gap, per_gap, height, max(errors))


def _means(display: Display, slopes: Floats, height_mm: float, distance_mm: float) -> Floats:
    """Return the mean landing points of the lenslet (0, 0) for slopes (N, 2), mm from its centre."""
    side = (np.arange(ACROSS) + 0.5) / ACROSS
    s, t = (one.ravel() for one in np.meshgrid(side, side))
    if display.array.grid == "hex":  # equal areas of the three rhombi
        s = (np.repeat(np.arange(3), len(s)) + np.tile(s, 3)) / 3.0
        t = np.tile(t, 3)
    across = INNER * np.stack(square_to_cell(NumpyBackend(), s, t, Lattice.of(display.array)), axis=1)
    camera = np.column_stack([slopes * distance_mm, np.full(len(slopes), height_mm + distance_mm)])
    to = np.column_stack([across, np.full(len(across), height_mm)])
    direction = to[None] - camera[:, None]
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    origin = np.broadcast_to(camera[:, None], direction.shape)
    hits = trace_to_panel(display, origin.reshape(-1, 3), direction.reshape(-1, 3))
    x, y = PanelFrame.of(display).panel_from_pixel(*hits.pixel.T)
    # Off the panel counts as blocked, and may be far aside here.
    good = (gets_through(hits.status) | (hits.status == 3)) & (hits.lenslet == 0).all(axis=1)
    shape = direction.shape[:2]
    weight = good.reshape(shape).astype(float)
    total = np.maximum(weight.sum(axis=1), 1.0)
    return np.stack([(one.reshape(shape) * weight).sum(axis=1) / total for one in (x, y)], axis=1)
