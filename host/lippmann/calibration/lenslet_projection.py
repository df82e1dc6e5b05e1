"""Model which outline and which panel point of a lenslet a camera sees.

A camera at C sees a lenslet with vertex L. The outline is in the plane at the seams'
height h. With the slope s = (C - L) / (Cz - h), the outline's middle is at L + c(s) at
height h, and the rays through the inner cell meet the panel, on average, at L + w(s).
A cell has n-fold rotational symmetry (n = 4 or 6) and mirror symmetry, so c and w need
few powers. With s = x + i y along the array's axes, s* = x - i y, and real c, a, b,

    c(s) = sum of c_jk s^j (s*)^k,   w(s) = -sum of (a_jk + gap b_jk) s^j (s*)^k,   j - k = 1, 1 - n, 1 + n, ...

The coefficients are fitted to exact rays (Snell's law at each face), because a paraxial
model omits higher-order terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

from lippmann.calibration.lattice_search import NEAR, within
from lippmann.calibration.lenslet_measurement import INNER, MIDDLE
from lippmann.display.description import MAX_SIDE_PX, Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Bools, Floats, Hits, gets_through
from lippmann.optics.sample_points import R2_STEPS, square_to_cell
from lippmann.optics.system import PanelFrame
from lippmann.optics.trace import trace_to_panel

#: Mean height of a lenslet's outline, as a fraction of the sag at the cell's corners.
SEAM = {"square": 2.0 / 3.0, "hex": 5.0 / 6.0}
#: Order n of a cell's rotational symmetry.
FOLDS = {"square": 4, "hex": 6}
#: Degrees j + k of the sums for c and w; steep lenslets need the high degrees.
DEGREES = range(1, 12)
#: Number of rays across the inner cell, and of slope directions: a prime number, so that
#: no symmetry repeats a direction.
ACROSS, DIRECTIONS = 13, 17
#: Number of points on a lenslet's outline.
EDGE_POINTS = 96


def outline_mm(display: Display) -> float:
    """Return the height h, mm, of the plane of the lenslets' outlines."""
    array = display.array
    seam = SEAM[array.grid] * array.sag_mm
    if array.plano_side == "panel":
        return -seam
    return array.thickness_mm - (array.thickness_mm - seam) / array.index


@dataclass(frozen=True)
class LensProjection:
    """Coefficients a (`fixed`), b (`per_gap`), c (`aside`) of the module's formulas for slopes / `steepest`."""

    fixed: Floats
    per_gap: Floats
    aside: Floats
    #: Order of the cell's symmetry, and direction of the array's first axis, degrees.
    folds: int
    rotation_deg: float
    outline_mm: float
    steepest: float

    def traced(
        self, slope: Floats, gap_mm: Floats | float, others: Sequence[tuple[int, int]]
    ) -> tuple[Floats, Floats, Floats]:
        """Return c(s) and w(s) (N, 2), mm, and s^j (s*)^k (N, 2, M) for M exponents `others`; slopes s are (N, 2)."""
        every, turn = powers(self.folds, DEGREES), np.exp(1j * np.deg2rad(self.rotation_deg))
        each = turn * terms((slope[:, 0] + 1j * slope[:, 1]) / (self.steepest * turn), every)
        c, fixed, per_gap = (each @ np.stack([self.aside, self.fixed, self.per_gap], axis=1)).T
        w = -fixed - gap_mm * per_gap
        some = each[:, [every.index(one) for one in others]]
        outline, point, other_terms = (np.stack([one.real, one.imag], axis=1) for one in (c, w, some))
        return outline, point, other_terms


@cache
def powers(folds: int, degrees: range) -> tuple[tuple[int, int], ...]:
    """Return the exponents (j, k) that the symmetry allows, with j + k in `degrees`."""
    return tuple((n - k, k) for n in degrees for k in range(n + 1) if (n - 2 * k - 1) % folds == 0)


def terms(slope: npt.NDArray[np.complex128], exponents: Sequence[tuple[int, int]]) -> npt.NDArray[np.complex128]:
    """Return s^j (s*)^k (N, terms) for slopes s (N,) along the array's axes."""
    power = np.cumprod([np.ones_like(slope), *[slope] * max(map(sum, exponents))], axis=0)
    other = power.conj()
    return np.stack([power[j] * other[k] for j, k in exponents], axis=1)


def fit_projection(display: Display, steepest: float, distance_mm: float) -> LensProjection:
    """Fit a lenslet's model to rays from cameras at `distance_mm` with slopes up to `steepest`."""
    plain = _plain(display)
    radii = np.linspace(0.0, max(steepest, 0.05), 10)[1:]
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS) + 0.1
    slopes = np.stack([np.outer(radii, f(angles)).ravel() for f in (np.cos, np.sin)], axis=1)
    height = outline_mm(display)

    middles = _middles(plain, slopes, height, distance_mm)
    folds = FOLDS[display.array.grid]
    each = terms((slopes[:, 0] + 1j * slopes[:, 1]) / radii[-1], powers(folds, DEGREES))
    parts = np.concatenate([each.real, each.imag])
    aside = np.linalg.lstsq(parts, middles.T.ravel(), rcond=None)[0]
    offset = (parts @ aside).reshape(2, -1).T

    gaps = display.gap_mm, display.gap_mm + 0.2 * display.aperture_distance_mm
    through = offset[:, None] + _cell(plain, INNER, ACROSS)
    fits = []
    for gap in gaps:
        arrives, at = _trace_rays(replace(plain, gap_mm=gap), slopes, through, height, distance_mm)
        fits.append(np.linalg.lstsq(-parts, means(at, arrives).T.ravel(), rcond=None)[0])
    per_gap = (fits[1] - fits[0]) / (gaps[1] - gaps[0])
    fixed = fits[0] - gaps[0] * per_gap
    return LensProjection(fixed, per_gap, aside, folds, display.array.rotation_deg, height, radii[-1])


def means(points: Floats, chosen_points: Bools) -> Floats:
    """Return the means (N, 2) of the points (N, M, 2) that the mask (N, M) selects."""
    count = np.maximum(chosen_points.sum(axis=1), 1)[:, None]
    return np.asarray((points * chosen_points[..., None]).sum(axis=1) / count)


def axes_at(angle_deg: float) -> Floats:
    """Return the matrix that converts rows (x, y) to axes rotated by an angle."""
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([[c, -s], [s, c]])


def movement(display: Display, slopes: Floats, distance_mm: float) -> float:
    """Return the mean derivative of panel points by position in the cell, for slopes (N, 2)."""
    inner, at, arrives = inner_rays(display, slopes, distance_mm)
    inner, at = (one - means(one, arrives)[:, None] for one in (np.broadcast_to(inner, at.shape), at))
    moves = np.linalg.lstsq(inner[arrives], at[arrives], rcond=None)[0]
    return 0.5 * float(np.trace(moves))


def inner_rays(display: Display, slopes: Floats, distance_mm: float) -> tuple[Floats, Floats, Bools]:
    """Trace rays from cameras in the directions of slopes (N, 2) through a lenslet's inner cell.

    Return the points in the cell (M, 2) and on the panel (N, M, 2), mm along the
    panel's axes, and a mask (N, M) of rays that reach the panel.
    """
    plain, height = _plain(display), outline_mm(display)
    axes = axes_at(display.array.rotation_deg)
    slopes = slopes @ axes
    inner = _cell(plain, INNER, ACROSS)
    through = _middles(plain, slopes, height, distance_mm)[:, None] + inner[None]
    arrives, at = _trace_rays(plain, slopes, through, height, distance_mm)
    return inner @ axes.T, at @ axes.T, arrives


def _plain(display: Display) -> Display:
    panel = replace(display.panel, width_px=MAX_SIDE_PX, height_px=MAX_SIDE_PX)
    array = replace(display.array, rotation_deg=0.0, offset_mm=(0.0, 0.0), extent_mm=None)
    return replace(display, panel=panel, array=array, viewing_distance_mm=None, viewing_axis_mm=(0.0, 0.0))


def _middles(display: Display, slopes: Floats, height_mm: float, distance_mm: float) -> Floats:
    """Return the outline's middles (N, 2), mm, for cameras with slopes (N, 2).

    An outline's middle is the mean of the points that belong to the lenslet.
    """
    lattice = Lattice.of(display.array)
    axes = np.array([lattice.centre(1.0, 0.0), lattice.centre(0.0, 1.0)])
    to_steps, grown = np.linalg.inv(axes), 1.0 + display.aperture_distance_mm / distance_mm
    inside = _cell(display, MIDDLE, 12)
    # Each slope uses different edge directions.
    angles = 2.0 * np.pi / EDGE_POINTS * (np.arange(EDGE_POINTS) + R2_STEPS[0] * np.arange(len(slopes))[:, None] % 1.0)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    middles = np.zeros_like(slopes)
    for _ in range(3):
        arrives, at = _trace_rays(display, slopes, middles[:, None] + inside, height_mm, distance_mm)
        fits = [_movement(inside[one] @ to_steps, at[k, one] @ to_steps / grown) for k, one in enumerate(arrives)]
        centre, moves, shift = (np.array(part) for part in zip(*fits, strict=True))
        # The edge is within 1.2 pitches of the middle.
        low, high = np.zeros(angles.shape), np.full(angles.shape, 1.2 * display.array.coarsest_mm)
        for _ in range(11):  # bisections
            half = 0.5 * (low + high)
            points = ways * half[..., None]
            arrives, at = _trace_rays(display, slopes, middles[:, None] + points, height_mm, distance_mm)
            own = (at @ to_steps / grown - centre[:, None] - points @ to_steps @ moves) @ np.linalg.inv(
                np.eye(2) - moves
            )
            there = arrives & within(own - shift[:, None], display.array.grid, NEAR)  # ray on this lenslet?
            low, high = np.where(there, half, low), np.where(there, high, half)
        edge = 0.5 * (low + high)
        area = 0.5 * (edge**2).sum(axis=1)
        middles = middles + (ways * edge[..., None] ** 3).sum(axis=1) / 3.0 / np.maximum(area, 1e-300)[:, None]
    return middles


def _movement(across: Floats, landed: Floats) -> tuple[Floats, Floats, Floats]:
    """Return median, derivative by cell position and mean offset of panel points, in lattice steps."""
    if len(across) < 3:
        return np.zeros(2), np.zeros((2, 2)), np.zeros(2)
    centre = np.asarray(np.median(landed, axis=0))
    moves = np.asarray(np.linalg.lstsq(across, landed - centre, rcond=None)[0])
    own = (landed - centre - across @ moves) @ np.linalg.inv(np.eye(2) - moves)
    return centre, moves, np.asarray(own.mean(axis=0))


def _cell(display: Display, share: float, across: int) -> Floats:
    side = (np.arange(across) + 0.5) / across
    s, t = (one.ravel() for one in np.meshgrid(side, side))
    if display.array.grid == "hex":  # three rhombi of equal area
        s, t = (np.repeat(np.arange(3), len(s)) + np.tile(s, 3)) / 3.0, np.tile(t, 3)
    return share * np.stack(square_to_cell(NumpyBackend(), s, t, Lattice.of(display.array)), axis=1)


def _trace_rays(
    display: Display, slopes: Floats, through: Floats, height_mm: float, distance_mm: float
) -> tuple[Bools, Floats]:
    """Trace cameras' rays through points (N, M, 2) on the plane of lenslets' outlines.

    Return a mask (N, M) of rays through lenslet (0, 0), and panel points (N, M, 2), mm.
    """
    camera = np.column_stack([slopes * distance_mm, np.full(len(slopes), height_mm + distance_mm)])[:, None]
    to = np.concatenate([through, np.full((*through.shape[:2], 1), height_mm)], axis=2)
    direction = to - camera
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    origin = np.broadcast_to(camera, direction.shape)
    hits: Hits = trace_to_panel(display, origin.reshape(-1, 3), direction.reshape(-1, 3))
    x, y = PanelFrame.of(display).panel_from_pixel(*hits.pixel.T)
    arrives = gets_through(hits.status) & (hits.lenslet == 0).all(axis=1)
    return arrives.reshape(through.shape[:2]), np.stack([x, y], axis=1).reshape(through.shape)
