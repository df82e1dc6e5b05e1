"""The optics of docs/reference/optics.md once more, in 50 digits, from first principles.

This is the independent leg for the golden engine: it imports nothing of `lippmann`, and its
formulation differs on purpose.

* Everything happens in world coordinates (the panel frame with z). A lenslet is a whole ball of
  glass, and its cell decides which part of the ball's surface counts.
* Snell's law is kept as what it says: the tangential part of the direction scales by n1 / n2.
* Brute force finds cells, and the first point of the height field along a ray: all balls near
  the path are intersected, a point counts in the cell of its own lenslet, the nearest wins.

Units: millimetres and radians. `Mpf` is a number of the private 50-digit context `mp`. Inputs may
be int, float (taken at their exact binary value) or mpf. Vectors are tuples of three.

`back_to_panel_many` is a second, separate implementation of the way back: numpy longdouble,
vectorised, one display a ray. It needs the 64-bit mantissa of x86.

Where optics.md leaves room this file reads it so:

* "Within 16 cells" is 16 pitches of horizontal way through the layer of the domes, from where the
  ray enters it. `margin` is 0 from 6 to 32 pitches.
* A ray from the world is the whole line through its origin.
* A blocked ray carries, other than in optics.md, the point on the neighbour's dome that stops it: a
  stricter check. A ray that does not head for the viewer carries the point where it left.
* The lenslet of a ray that fails at or after a dome is the dome's; the one of a ray that missed is
  the pixel's own.
* Light that enters a steep dome and leaves it again through a seam's valley, status 3 by optics.md,
  is traced as if the glass went on; `margin` is 0 there.
* With gap 0 the flat face is still a face towards air: from the world it can reflect totally.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt

#: A private context: no test can lower the precision by touching mpmath.mp.
mp = mpmath.mp.clone()
mp.dps = 50

Mpf = Any  # mpmath ships no types
Vec = tuple[Mpf, Mpf, Mpf]
Lenslet = tuple[int, int]
LongArray = npt.NDArray[np.longdouble]

OK, MISSED, REFLECTED, BLOCKED, CROSSTALK = range(5)

#: Horizontal reach of the search for a dome, in pitches, and the band around it in which "16 cells"
#: is open to interpretation.
REACH = 16
UNSURE_FROM, UNSURE_TO = 6, 32


@dataclass(frozen=True)
class Optics:
    """The numbers of one display that decide where rays go, named as in a display file.

    row_pitch_mm: pitch py that rows follow from (None: pitch_mm). extent_mm: (w, h).
    """

    width_px: int
    height_px: int
    pixel_pitch_mm: float
    grid: Literal["square", "hex"]
    pitch_mm: float
    radius_mm: float
    index: float
    thickness_mm: float
    gap_mm: float
    plano_side: Literal["panel", "viewer"]
    rotation_rad: float = 0.0
    offset_mm: tuple[float, float] = (0.0, 0.0)
    eye_mm: float | None = None
    axis_mm: tuple[float, float] = (0.0, 0.0)
    row_pitch_mm: float | None = None
    shear: float = 0.0
    extent_mm: tuple[float, float] | None = None


class Ray(NamedTuple):
    """What `trace` returns.

    origin: mm, panel frame, on the last face, or the last point reached when status is 1, 2, 3.
    direction: unit, there. cos_theta_t: between the ray that left and the last face's normal; 0
    when nothing left. margin: distance to the nearest edge between two statuses or two lenslets, the
    smallest of: cell edges and near misses in pitches, 1 - sin^2 of the refracted angle, z
    component of the direction.
    """

    status: int
    lenslet: Lenslet | None
    origin: Vec
    direction: Vec
    cos_theta_t: Mpf
    margin: Mpf


class PanelPoint(NamedTuple):
    """A panel point, mm, and the distance of the given origin from the last face."""

    x: Mpf
    y: Mpf
    off_mm: Mpf


class Landing(NamedTuple):
    """What `world_to_panel` returns.

    lenslet: None when it met none. pixel: None when the panel was not reached. point: the last one
    reached, mm. margin: as in `Ray`, with the panel's border in pitches of the lenslets.
    """

    status: int
    lenslet: Lenslet | None
    pixel: tuple[Mpf, Mpf] | None
    point: Vec
    direction: Vec
    margin: Mpf


def _dot(p: Vec, q: Vec) -> Mpf:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


def _minus(p: Vec, q: Vec) -> Vec:
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


def _along(p: Vec, d: Vec, t: Mpf) -> Vec:
    return (p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])


def _times(k: Mpf, p: Vec) -> Vec:
    return (k * p[0], k * p[1], k * p[2])


def _exact(p: Any) -> Vec:
    """Return three mpf of the exact value of three numbers of any kind."""
    x, y, z = (c if isinstance(c, mp.mpf) else mp.mpf(c) for c in p)
    return (x, y, z)


def _unit(p: Vec) -> Vec:
    return _times(1 / mp.sqrt(_dot(p, p)), p)


def _to_plane(p: Vec, d: Vec, z: Mpf) -> Vec:
    """Return the point where the line from p along d crosses the plane at height z."""
    x, y, _ = _along(p, d, (z - p[2]) / d[2])
    return (x, y, z)


def _refract(d: Vec, normal: Vec, ratio: Mpf) -> tuple[Vec | None, Mpf]:
    """Snell's law: the tangential part of a unit direction scales by ratio = n1 / n2.

    normal: unit, either side. Returns the refracted unit direction (None: total internal
    reflection) and its squared cosine to the normal.
    """
    across = _dot(d, normal)
    tangential = _times(ratio, _along(d, normal, -across))
    cos2 = 1 - _dot(tangential, tangential)
    if cos2 < 0:
        return None, cos2
    return _along(tangential, normal, mp.sqrt(cos2) * mp.sign(across)), cos2


def _into_glass(d: Vec, normal: Vec, index: Mpf) -> Vec:
    """Refract from air into glass: always possible."""
    bent, _ = _refract(d, normal, 1 / index)
    assert bent is not None
    return bent


_UP: Vec = (mp.mpf(0), mp.mpf(0), mp.mpf(1))


@lru_cache(maxsize=64)
def _model(optics: Optics) -> SimpleNamespace:
    """An `Optics` in mpf, with what follows from it; bulge is +1 when the domes bulge to the viewer, else -1."""
    p, R, T, gap = (mp.mpf(q) for q in (optics.pitch_mm, optics.radius_mm, optics.thickness_mm, optics.gap_mm))
    py = p if optics.row_pitch_mm is None else mp.mpf(optics.row_pitch_mm)
    shear = mp.mpf(optics.shear)
    # Corners of the regular cell of pitch 1, to the right and the left above, and a hexagon's top.
    corners = {"square": [(0.5, mp.mpf(0.5)), (-0.5, mp.mpf(0.5))]}.get(
        optics.grid, [(0.5, 1 / mp.sqrt(12)), (-0.5, 1 / mp.sqrt(12)), (0, 1 / mp.sqrt(3))]
    )
    rho = max(mp.hypot(p * x + shear * py * y, py * y) for x, y in corners)
    bulge = {"panel": 1, "viewer": -1}[optics.plano_side]
    turn = mp.mpf(optics.rotation_rad)
    made = SimpleNamespace(p=p, py=py, shear=shear, R=R, T=T, gap=gap, sag=R - mp.sqrt(R**2 - rho**2), bulge=bulge)
    made.pixel, made.n = mp.mpf(optics.pixel_pitch_mm), mp.mpf(optics.index)
    made.cos, made.sin = mp.cos(turn), mp.sin(turn)
    made.offset = mp.mpf(optics.offset_mm[0]), mp.mpf(optics.offset_mm[1])
    made.z_panel, made.z_flat = -(T + gap) if bulge > 0 else -gap, -bulge * T
    return made


def sag(optics: Optics) -> Mpf:
    """Return s, the depth of the dome at the corners of its cell, mm."""
    return _model(optics).sag


def panel_point(optics: Optics, u: Any, v: Any) -> Vec:
    """Return the point of the panel plane at continuous pixel coordinates: mpf triple, mm."""
    m = _model(optics)
    x = (mp.mpf(u) - mp.mpf(optics.width_px) / 2) * m.pixel
    y = (mp.mpf(optics.height_px) / 2 - mp.mpf(v)) * m.pixel
    return (x, y, m.z_panel)


def pixel_of(optics: Optics, x: Any, y: Any) -> tuple[Mpf, Mpf]:
    """Return the continuous pixel coordinates (u, v) of a panel-frame point in mm."""
    m = _model(optics)
    return (mp.mpf(x) / m.pixel + mp.mpf(optics.width_px) / 2, mp.mpf(optics.height_px) / 2 - mp.mpf(y) / m.pixel)


def projections(grid: str, u: Any, w: Any, lenslet: Lenslet) -> tuple[Any, ...]:
    """Return the projections q_k / p of a point, from a lenslet's centre: 2 for square, 3 for hex.

    u = X / p; w = Y / p (square) or sqrt(3) Y / p (hex), array frame. In these units the hex
    lattice is rational, so that `fractions.Fraction` decides edges and vertices exactly.
    """
    i, j = lenslet
    if grid == "square":
        return (u - i, w - j)
    du, dw = (2 * u - 2 * i - j) / 2, (2 * w - 3 * j) / 2
    # cos 60 = 1/2 and sin 60 = sqrt(3)/2, whose sqrt(3) sits in w already.
    return (du, (du + dw) / 2, (dw - du) / 2)


def cell_of(grid: str, u: Any, w: Any) -> Lenslet:
    """Return the lenslet whose half-open cell holds a point, by trying all lenslets around it."""
    j0 = round(float(w) if grid == "square" else float(w) * 2 / 3)
    i0 = round(float(u) if grid == "square" else float(u) - j0 / 2)
    around = [(i0 + di, j0 + dj) for di in range(-2, 3) for dj in range(-2, 3)]
    for lenslet in around:
        if all(-1 <= 2 * q < 1 for q in projections(grid, u, w, lenslet)):
            return lenslet
    # Reached only with mpf, a rounding error of 1e-50 beside an edge: the margin says so, any of
    # the neighbours will do.
    return max(around, key=lambda lenslet: _clearance(grid, u, w, lenslet))


def _clearance(grid: str, u: Any, w: Any, lenslet: Lenslet) -> Any:
    """Distance to the nearest edge line of a cell in pitches, negative outside."""
    return min((1 - abs(2 * q)) / 2 for q in projections(grid, u, w, lenslet))


def _lattice(optics: Optics, x: Mpf, y: Mpf) -> tuple[Mpf, Mpf]:
    """Return (u, w), as in `projections`, of a panel-frame point in mm."""
    m = _model(optics)
    dx, dy = x - m.offset[0], y - m.offset[1]
    X, Y = m.cos * dx + m.sin * dy, m.cos * dy - m.sin * dx
    u, w = (X - m.shear * Y) / m.p, Y / m.py
    return (u, w) if optics.grid == "square" else (u, w * mp.sqrt(3))


def lenslet_of(optics: Optics, x: Any, y: Any) -> Lenslet:
    """Return (i, j) of the lenslet whose cell holds a panel-frame point in mm."""
    return cell_of(optics.grid, *_lattice(optics, mp.mpf(x), mp.mpf(y)))


def seen_through(optics: Optics, x: Any, y: Any) -> tuple[Mpf, Mpf]:
    """Return where the straight line from the eye to a panel point crosses the aperture plane, mm."""
    x, y = mp.mpf(x), mp.mpf(y)
    if optics.eye_mm is None:
        return x, y
    plane = _model(optics).z_panel + aperture_distance(optics)
    eye = (mp.mpf(optics.axis_mm[0]), mp.mpf(optics.axis_mm[1]), plane + mp.mpf(optics.eye_mm))
    crossed = _to_plane(eye, _minus((x, y, _model(optics).z_panel), eye), plane)
    return crossed[0], crossed[1]


def owner_of(optics: Optics, x: Any, y: Any) -> Lenslet:
    """Return the lenslet that owns a panel-frame point: the one whose cell the line to the eye crosses."""
    return lenslet_of(optics, *seen_through(optics, x, y))


def _regular_centre(optics: Optics, lenslet: Lenslet) -> tuple[Mpf, Mpf]:
    """Return a lenslet's centre on the regular lattice of pitch 1."""
    i, j = lenslet
    return (mp.mpf(i), mp.mpf(j)) if optics.grid == "square" else (i + mp.mpf(j) / 2, j * mp.sqrt(3) / 2)


@lru_cache(maxsize=4096)
def centre_of(optics: Optics, lenslet: Lenslet) -> tuple[Mpf, Mpf]:
    """Return the panel-frame centre (x, y) of a lenslet, mm."""
    m = _model(optics)
    u, w = _regular_centre(optics, lenslet)
    X, Y = m.p * u + m.shear * m.py * w, m.py * w
    return (m.offset[0] + m.cos * X - m.sin * Y, m.offset[1] + m.sin * X + m.cos * Y)


def there(optics: Optics, lenslet: Lenslet) -> bool:
    """Tell whether a lenslet is one of the array's."""
    if optics.extent_mm is None:
        return True
    m, (u, w) = _model(optics), _regular_centre(optics, lenslet)
    return bool(2 * abs(u * m.p) <= optics.extent_mm[0] and 2 * abs(w * m.py) <= optics.extent_mm[1])


def _ball(optics: Optics, lenslet: Lenslet) -> Vec:
    """Return the centre of curvature of a lenslet's dome, panel frame, mm."""
    m = _model(optics)
    return (*centre_of(optics, lenslet), -m.bulge * m.R)


def _lenslets_near(optics: Optics, p: Vec, q: Vec) -> list[Lenslet]:
    """Return all lenslets whose cells come near the horizontal way from p to q, by floats: generous."""
    root3 = math.sqrt(3)
    ends = []
    for x, y, _ in (p, q):
        u, w = (float(c) for c in _lattice(optics, x, y))
        ends.append(complex(u, w if optics.grid == "square" else w / root3))
    a, b = ends
    way = b - a
    near = 0.5 + {"square": math.sqrt(1 / 2), "hex": math.sqrt(1 / 3)}[optics.grid]  # a half pitch to spare
    row = 1.0 if optics.grid == "square" else root3 / 2
    found = []
    for j in range(math.floor((min(a.imag, b.imag) - near) / row), math.ceil((max(a.imag, b.imag) + near) / row) + 1):
        shift = 0.0 if optics.grid == "square" else j / 2
        for i in range(
            math.floor(min(a.real, b.real) - near - shift), math.ceil(max(a.real, b.real) + near - shift) + 1
        ):
            to = complex(i + shift, j * row) - a
            foot = 0.0 if way == 0 else min(1.0, max(0.0, (to * way.conjugate()).real / abs(way) ** 2))
            if abs(to - foot * way) <= near:
                found.append((i, j))
    return found


class _Meeting(NamedTuple):
    t: Mpf
    lenslet: Lenslet
    point: Vec
    normal: Vec  # unit, out of the glass


def _meet(optics: Optics, p: Vec, d: Vec, *, leaving: bool, after: Mpf | None = None) -> tuple[_Meeting | None, Mpf]:
    """Find the first point of the height field on the line from p along d, by brute force.

    leaving: from glass to air, the far side of a ball; else from air to glass, the near side.
    after: only points with a larger parameter t count; without it the whole line does, for no dome
    lies outside the layer between vertices and corners. Returns the meeting, or None, and the
    distance to the nearest other outcome in pitches.
    """
    m = _model(optics)
    t_first, t_last = sorted(((0 - p[2]) / d[2], (-m.bulge * m.sag - p[2]) / d[2]))
    if after is not None:
        if t_last <= after:
            return None, mp.inf
        t_first = max(t_first, after)
    horizontal = mp.hypot(d[0], d[1])
    fine = min(m.p, m.py)
    if (t_last - t_first) * horizontal > 2 * UNSURE_TO * fine:
        t_last = t_first + 2 * UNSURE_TO * fine / horizontal
    stopped: list[tuple[Mpf, Mpf]] = []  # t, margin
    met: list[tuple[Mpf, Mpf, _Meeting]] = []  # t, clearance in the cell, what
    missed: list[tuple[Mpf, Mpf]] = []  # t, distance in pitches
    walled = bool(m.shear) or m.p != m.py
    line = [_lattice(optics, *q[:2]) for q in (p, _along(p, d, mp.mpf(1)))] if walled else []
    for lenslet in _lenslets_near(optics, _along(p, d, t_first), _along(p, d, t_last)):
        ball = _ball(optics, lenslet)
        if walled:
            here, ahead = (projections(optics.grid, *q, lenslet) for q in line)
            for t, far, stops in _walls(optics, p, d, ball, here, ahead, (t_first, t_last), leaving):
                (stopped if stops else missed).append((t, far))
        t_foot = _dot(_minus(ball, p), d)
        from_ball = _minus(_along(p, d, t_foot), ball)
        h2 = _dot(from_ball, from_ball)
        if not leaving and t_first <= t_foot <= t_last:
            # How near the ray is to a tangent of this ball.
            missed.append((t_foot, abs(mp.sqrt(h2) - m.R) / m.p))
        if h2 > m.R**2:
            continue
        half_chord = mp.sqrt(m.R**2 - h2)
        t = t_foot + half_chord if leaving else t_foot - half_chord
        if after is not None and t <= after:
            continue
        point = _along(p, d, t)
        if m.bulge * (point[2] - ball[2]) <= 0:  # the half of the ball that is no dome
            continue
        u, w = _lattice(optics, point[0], point[1])
        clearance = _clearance(optics.grid, u, w, lenslet)
        if clearance > 0 or (clearance == 0 and cell_of(optics.grid, u, w) == lenslet):
            normal = _times(1 / m.R, _minus(point, ball))
            met.append((t, min(clearance, half_chord / m.p), _Meeting(t, lenslet, point, normal)))
        else:
            missed.append((t, -clearance))
    wall, sure = min(stopped, default=(mp.inf, mp.inf))
    if not met or wall < min(met, key=lambda entry: entry[0])[0]:
        far = min((far for t, far in missed if t <= wall), default=mp.inf)
        # A wall, marked by the ray's own direction in place of its normal.
        return (_Meeting(wall, (0, 0), _along(p, d, wall), d) if stopped else None), min(far, sure)
    t, margin, meeting = min(met, key=lambda entry: entry[0])
    return meeting, min([margin, *(far for t_other, far in missed if t_other <= t)])


def _walls(
    optics: Optics, p: Vec, d: Vec, ball: Vec, here: Sequence[Mpf], ahead: Sequence[Mpf], span: tuple[Mpf, Mpf],
    leaving: bool,
) -> list[tuple[Mpf, Mpf, bool]]:  # fmt: skip
    """Return t where a line comes into a lenslet's cell, the margin, and whether a wall stops it.

    `here` and `ahead` are the projections of p and p + d; t lies in the span, without its begin.
    """
    m, found = _model(optics), []
    for k, (q, r) in enumerate(zip(here, ahead, strict=True)):
        if q == r:
            continue
        t = ((-1 if r > q else 1) / mp.mpf(2) - q) / (r - q)
        if not span[0] < t <= span[1]:
            continue
        point = _along(p, d, t)
        from_ball = _minus(point, ball)
        height = mp.sqrt(_dot(from_ball, from_ball)) - m.R
        others = (a + t * (b - a) for j, (a, b) in enumerate(zip(here, ahead, strict=True)) if j != k)
        inside = min(mp.mpf(1) / 2 - abs(other) for other in others)
        in_glass = height < 0 or m.bulge * from_ball[2] <= 0
        found.append((t, min(abs(height) / m.p, abs(inside)), bool(inside >= 0 and in_glass != leaving)))
    return found


def _meet_in_reach(optics: Optics, start: Vec, d: Vec, *, leaving: bool) -> tuple[_Meeting | None, Mpf]:
    """`_meet`, given up after 16 pitches of horizontal way in the domes' layer."""
    m = _model(optics)
    # In the glass the layer begins at the rims' plane, in the air at the vertices' plane.
    start = _to_plane(start, d, -m.bulge * m.sag if leaving else mp.mpf(0))
    meeting, margin = _meet(optics, start, d, leaving=leaving)
    if meeting is None or meeting.normal is d:
        return None, margin
    way = mp.hypot(meeting.point[0] - start[0], meeting.point[1] - start[1]) / min(m.p, m.py)
    if UNSURE_FROM < way < UNSURE_TO:
        margin = mp.mpf(0)
    return (None, margin) if way > REACH else (meeting, margin)


def _blocked(optics: Optics, p: Vec, d: Vec) -> tuple[Vec | None, Mpf]:
    """Return where a ray that left a dome at p is stopped (None: it gets away), and the margin."""
    m = _model(optics)
    heads = m.bulge * d[2]  # positive: away from the glass
    if heads <= 0:
        return p, -heads
    meeting, margin = _meet(optics, p, d, leaving=False, after=mp.mpf(0))
    if -p[2] / d[2] * mp.hypot(d[0], d[1]) > UNSURE_FROM * min(m.p, m.py):
        margin = mp.mpf(0)
    return (None if meeting is None else meeting.point), min(margin, heads)


def _leaves_the_shoulder(optics: Optics, p: Vec, d: Vec) -> bool:
    """Tell whether a ray that entered a dome at p meets the height field again from inside."""
    return _meet(optics, p, d, leaving=True, after=mp.mpf(0))[0] is not None


def aperture_distance(optics: Optics) -> Mpf:
    """Return D, the distance of the aperture plane from the panel, mm."""
    m = _model(optics)
    return m.gap + m.T / m.n if optics.plano_side == "panel" else max(m.gap, m.sag)


def chief_or_aperture_direction(optics: Optics, x: Any, y: Any, lenslet: Lenslet, a: Any = 0, b: Any = 0) -> Vec:
    """Return the unit direction in which a ray leaves the panel point (x, y), mm.

    a, b: aperture point, mm, from the lenslet's centre along the array's axes.
    """
    m = _model(optics)
    cx, cy = centre_of(optics, lenslet)
    a, b = mp.mpf(a), mp.mpf(b)
    aim_x, aim_y = cx + m.cos * a - m.sin * b, cy + m.sin * a + m.cos * b
    return _unit((aim_x - mp.mpf(x), aim_y - mp.mpf(y), aperture_distance(optics)))


def _through_the_array(optics: Optics, p: Vec, d: Vec, margin: Mpf, *, flat_first: bool) -> Ray:
    """Take a ray from p along d through both faces, as far as it gets; the lenslet is None where it met none."""
    m, none = _model(optics), mp.mpf(0)
    if flat_first:
        p, d = _to_plane(p, d, m.z_flat), _into_glass(d, _UP, m.n)
    meeting, near = _meet_in_reach(optics, p, d, leaving=flat_first)
    margin = min(margin, near)
    if meeting is None:
        return Ray(MISSED, None, p, d, none, margin)
    lenslet, point, normal = meeting.lenslet, meeting.point, meeting.normal
    if not there(optics, lenslet):
        return Ray(BLOCKED, lenslet, point, d, none, margin)
    if not flat_first:
        d = _into_glass(d, normal, m.n)
        if _leaves_the_shoulder(optics, point, d):
            margin = none
        point, normal = _to_plane(point, d, m.z_flat), _UP
    out, cos2 = _refract(d, normal, m.n)
    margin = min(margin, abs(cos2))
    if out is None:
        return Ray(REFLECTED, lenslet, point, d, none, margin)
    if flat_first:
        stop, near = _blocked(optics, point, out)
        margin = min(margin, near)
        if stop is not None:
            return Ray(BLOCKED, lenslet, stop, out, mp.sqrt(cos2), margin)
    return Ray(OK, lenslet, point, out, mp.sqrt(cos2), margin)


def trace(optics: Optics, u: Any, v: Any, a: Any = 0, b: Any = 0) -> Ray:
    """Trace one ray of model `exact` from the pixel point (u, v) to the aperture point (a, b), mm."""
    start = panel_point(optics, u, v)
    home = owner_of(optics, start[0], start[1])
    margin = _clearance(optics.grid, *_lattice(optics, *seen_through(optics, start[0], start[1])), home)
    if not there(optics, home):
        return Ray(BLOCKED, home, start, _UP, mp.mpf(0), margin)
    d = chief_or_aperture_direction(optics, start[0], start[1], home, a, b)
    passage = _through_the_array(optics, start, d, margin, flat_first=optics.plano_side == "panel")
    if passage.lenslet is None:
        return passage._replace(lenslet=home)
    crosstalk = passage.status == OK and passage.lenslet != home
    return passage._replace(status=CROSSTALK) if crosstalk else passage


def back_to_panel(optics: Optics, origin: Any, direction: Any, lenslet: Lenslet) -> PanelPoint:
    """Trace an exit ray backwards through one given lenslet's last and first face to the panel.

    The ray's line is intersected with the last face anew, at the point nearest to `origin`. Nothing
    is asked about cells or blocking. Raises ValueError when no panel point leads to such a ray.
    """
    m = _model(optics)
    p, back = _exact(origin), _times(-1, _unit(_exact(direction)))
    ball = _ball(optics, lenslet)

    def dome(q: Vec, d: Vec) -> tuple[Mpf, Mpf]:
        """Both parameters at which the line from q along d meets this lenslet's ball."""
        foot = _dot(_minus(ball, q), d)
        to_foot = _minus(_along(q, d, foot), ball)
        chord2 = m.R**2 - _dot(to_foot, to_foot)
        if chord2 < 0:
            raise ValueError(f"the line through {origin} misses the dome of lenslet {lenslet}")
        return foot - mp.sqrt(chord2), foot + mp.sqrt(chord2)

    def into_air(d: Vec, normal: Vec) -> Vec:
        out, _ = _refract(d, normal, m.n)
        if out is None:
            raise ValueError(f"total internal reflection on the way back from {origin}")
        return out

    if optics.plano_side == "panel":
        from_ball = _minus(p, ball)
        off = abs(mp.sqrt(_dot(from_ball, from_ball)) - m.R)
        face = _along(p, back, min(dome(p, back), key=abs))
        back = _into_glass(back, _times(1 / m.R, _minus(face, ball)), m.n)
        face = _to_plane(face, back, m.z_flat)
        back = into_air(back, _UP)
    else:
        off = abs(p[2] - m.z_flat)
        face = _to_plane(p, back, m.z_flat)
        back = _into_glass(back, _UP, m.n)
        face = _along(face, back, dome(face, back)[1])  # inside the ball: the far side is the dome
        back = into_air(back, _times(1 / m.R, _minus(face, ball)))
    x, y, _ = _to_plane(face, back, m.z_panel)
    return PanelPoint(x, y, off)


def world_to_panel(optics: Optics, origin: Any, direction: Any) -> Landing:
    """Trace a ray of model `exact` to the panel from the world; `origin` is any point of the ray's line."""
    p, d = _exact(origin), _unit(_exact(direction))
    if d[2] >= 0:
        return Landing(MISSED, None, None, p, d, d[2])
    passage = _through_the_array(optics, p, d, -d[2], flat_first=optics.plano_side == "viewer")
    status, lenslet, face, out, _, margin = passage
    if status != OK:
        return Landing(status, lenslet, None, face, out, margin)
    m = _model(optics)
    point = _to_plane(face, out, m.z_panel)
    u, v = pixel_of(optics, point[0], point[1])
    margin = min(margin, *(abs(q) * m.pixel / m.p for q in (u, v, u - optics.width_px, v - optics.height_px)))
    if not (0 <= u < optics.width_px and 0 <= v < optics.height_px):
        return Landing(BLOCKED, lenslet, (u, v), point, out, margin)
    u_cell, w_cell = _lattice(optics, *seen_through(optics, point[0], point[1]))
    owner = cell_of(optics.grid, u_cell, w_cell)
    margin = min(margin, _clearance(optics.grid, u_cell, w_cell, owner))
    return Landing(OK if owner == lenslet else CROSSTALK, lenslet, (u, v), point, out, margin)


def lensmaker_focal_length(radius_mm: Any, index: Any) -> Mpf:
    """Return f of a plano-convex lens in air, mm, for any thickness.

    The lensmaker's equation `1/f = (n - 1) (1/R1 - 1/R2 + (n - 1) t / (n R1 R2))` with R2 infinite
    (E. Hecht, Optics, ch. 6).
    """
    return mp.mpf(radius_mm) / (mp.mpf(index) - 1)


def back_focal_length(radius_mm: Any, index: Any, thickness_mm: Any, first: Literal["curved", "flat"]) -> Mpf:
    """Return the paraxial distance from the last vertex to the focus of parallel light, mm.

    Curved face first: the sphere's focus lies n f behind its vertex; the flat face brings the rest,
    n f - T, to (n f - T) / n. Flat face first: parallel light passes it unbent.
    """
    f = lensmaker_focal_length(radius_mm, index)
    return f - mp.mpf(thickness_mm) / mp.mpf(index) if first == "curved" else f


def third_order_longitudinal_aberration(
    radius_mm: Any, index: Any, thickness_mm: Any, height_mm: Any, first: Literal["curved", "flat"]
) -> Mpf:
    """Return the third-order longitudinal spherical aberration (Seidel) for parallel light, mm.

    That is the term in h^2 of L(h) - L(0): L(h) is the distance behind the last vertex at which a
    ray that came in parallel to the axis at height h crosses it. With x = h / R:

    Flat face first. The ray leaves the sphere turned by delta = (n - 1) x + (n^3 - 1) x^3 / 6 and
    crosses the axis at L = h / tan(delta) - (R - sqrt(R^2 - h^2)):

        LSA = -f n^2 x^2 / 2,    whatever the thickness.

    Curved face first. The ray aims at the depth z1 = n f (1 - x^2 / (2 n^2)) under the slope
    delta = (n - 1) x / n. The flat face turns delta into theta, sin(theta) = n sin(delta), so that
    L = (z1 - T) tan(delta) / tan(theta):

        LSA = -x^2 / (2 n^2) (f + (n f - T) (n^2 - 1) (n - 1)^2 / n).

    For T = 0 both are the formula of F. A. Jenkins and H. E. White, Fundamentals of Optics, 4th
    edition, chapter 9: 4.5 and 7/6 times h^2 / f for n = 1.5.
    """
    n, T = mp.mpf(index), mp.mpf(thickness_mm)
    f = lensmaker_focal_length(radius_mm, index)
    x2 = (mp.mpf(height_mm) / mp.mpf(radius_mm)) ** 2
    if first == "flat":
        return -f * n**2 * x2 / 2
    return -x2 / (2 * n**2) * (f + (n * f - T) * (n**2 - 1) * (n - 1) ** 2 / n)


def has_long_longdouble() -> bool:
    """Tell whether longdouble has the 64 bits of mantissa that `back_to_panel_many` needs here."""
    return bool(np.finfo(np.longdouble).eps < 2e-19)


def back_to_panel_many(
    origin: npt.ArrayLike,
    direction: npt.ArrayLike,
    lenslet: npt.ArrayLike,
    *,
    hexagonal: npt.ArrayLike,
    plano_viewer: npt.ArrayLike,
    pitch_mm: npt.ArrayLike,
    radius_mm: npt.ArrayLike,
    index: npt.ArrayLike,
    thickness_mm: npt.ArrayLike,
    gap_mm: npt.ArrayLike,
    rotation_rad: npt.ArrayLike = 0.0,
    offset_mm: npt.ArrayLike = (0.0, 0.0),
    row_pitch_mm: npt.ArrayLike | None = None,
    shear: npt.ArrayLike = 0.0,
) -> tuple[LongArray, LongArray]:
    """Trace n exit rays backwards to the panel, each through its own display, in longdouble.

    Shares no code with the rest of this file. Each of a display's numbers may be an array, (n,) or
    (n, 2). Returns the panel points (n, 2) and the distance of each origin from its last face (n,),
    mm; NaN where no panel point leads to the ray.
    """
    if not has_long_longdouble():
        raise RuntimeError("back_to_panel_many needs a longdouble of 64 bits of mantissa or more")

    def long(values: npt.ArrayLike) -> LongArray:
        return np.asarray(values).astype(np.longdouble)

    o, d, ij = long(origin), long(direction), long(lenslet)
    p, R, n, T, gap, turn = (long(q) for q in (pitch_mm, radius_mm, index, thickness_mm, gap_mm, rotation_rad))
    hexagonal, viewer = np.asarray(hexagonal, bool), np.asarray(plano_viewer, bool)
    shift = long(offset_mm)

    # Move the lenslet's vertex to the origin and, where the domes point to the panel, mirror z:
    # then every dome points up.
    i, j = ij[:, 0], ij[:, 1]
    Y = (
        (p if row_pitch_mm is None else long(row_pitch_mm))
        * j
        * np.where(hexagonal, np.sqrt(np.longdouble(3)) / 2, np.longdouble(1))
    )
    X = p * np.where(hexagonal, i + j / 2, i) + long(shear) * Y
    cx = shift[..., 0] + (np.cos(turn) * X - np.sin(turn) * Y)
    cy = shift[..., 1] + (np.sin(turn) * X + np.cos(turn) * Y)
    mirror = np.where(viewer, np.longdouble(-1), np.longdouble(1))
    x, y, z = o[:, 0] - cx, o[:, 1] - cy, mirror * o[:, 2]
    length = np.sqrt((d * d).sum(axis=1))
    dx, dy, dz = -d[:, 0] / length, -d[:, 1] / length, -mirror * d[:, 2] / length

    def to_dome(x: LongArray, y: LongArray, z: LongArray, dx: LongArray, dy: LongArray, dz: LongArray) -> LongArray:
        """Parameter of the line's nearest point on x^2 + y^2 + z^2 + 2 R z = 0."""
        b = x * dx + y * dy + (z + R) * dz
        c = x * x + y * y + z * (z + 2 * R)
        t: LongArray = -c / (b + np.copysign(np.sqrt(b * b - c), b))
        return t

    def bend(
        dx: LongArray, dy: LongArray, dz: LongArray, a: LongArray, b: LongArray, c: LongArray, ratio: LongArray
    ) -> tuple[LongArray, LongArray, LongArray]:
        """Refract (dx, dy, dz) at the unit normal (a, b, c): d' = ratio d + gamma normal."""
        cos_i = dx * a + dy * b + dz * c
        gamma = np.copysign(np.sqrt(1 - ratio * ratio * (1 - cos_i * cos_i)), cos_i) - ratio * cos_i
        return ratio * dx + gamma * a, ratio * dy + gamma * b, ratio * dz + gamma * c

    zero, one = np.zeros_like(x), np.ones_like(x)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Last face: the dome, or the flat one at depth T under the mirrored vertices' plane.
        depth = np.hypot(np.hypot(x, y), z + R)
        off = np.where(viewer, np.abs(z + T), np.abs((x * x + y * y + z * (z + 2 * R)) / (depth + R)))
        t = np.where(viewer, (-T - z) / dz, to_dome(x, y, z, dx, dy, dz))
        x, y, z = x + t * dx, y + t * dy, z + t * dz
        normal = (np.where(viewer, zero, x / R), np.where(viewer, zero, y / R), np.where(viewer, one, z / R + 1))
        dx, dy, dz = bend(dx, dy, dz, *normal, 1 / n)
        # First face. Seen from the flat face the dome ahead is not always the nearer side of the
        # ball, for a ball smaller than the glass is thick: start from where the ray crosses the
        # vertices' plane, which is always nearer to the dome.
        to_vertices = -z / dz
        xv, yv = x + to_vertices * dx, y + to_vertices * dy
        t = np.where(viewer, to_vertices + to_dome(xv, yv, zero, dx, dy, dz), (-T - z) / dz)
        x, y, z = x + t * dx, y + t * dy, z + t * dz
        normal = (np.where(viewer, x / R, zero), np.where(viewer, y / R, zero), np.where(viewer, z / R + 1, one))
        dx, dy, dz = bend(dx, dy, dz, *normal, n * one)
        # The panel: below the flat face, or above the domes' vertices in the mirrored frame.
        t = (np.where(viewer, gap, -(T + gap)) - z) / dz
        return np.stack([x + t * dx + cx, y + t * dy + cy], axis=1), off
