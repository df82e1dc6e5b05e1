"""Refracts rays at the flat face and at the domes (steps 4 and 5 of a ray).

Snell's law at a plane keeps the tangential part of n d (index times direction). With k
= d_tangential n1/n2, a ray leaves along (k, sqrt(1 - |k|^2)) or, if |k| > 1, reflects.

**Domes** use lens-local coordinates: the vertex is the origin, the dome bulges to +z,
and the glass is below. With the curvature c = 1/R, a dome of radius R is part of the
sphere c (x^2 + y^2 + z^2) + 2 z = 0.

**Perpendicular-foot form.** The ray's point is first moved along the direction d to the
foot Q of the perpendicular from the vertex, Q . d = 0. With F = c |Q|^2 + 2 Q_z, the
ray meets the sphere at Q + t d, where c t^2 + 2 d_z t + F = 0. The ray's cosine to the
normal is sqrt(d_z^2 - c F). No term grows with the ray's distance or with R.

**The height field.** The array's face is a spherical cap over each cell. A ray meets
the cap of its cell, or steps to the next cell. Neighbouring caps have equal heights at
their common side, so no ray passes between two caps. A sheared lattice, or a hexagonal
lattice with two pitches, has walls between its caps; a ray that meets a wall is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from lippmann.optics.backend import Arr, Backend, Operation, State
from lippmann.optics.lattice import Lattice


class Ray(NamedTuple):
    """Rays, each with a point (mm) and a unit direction: six arrays of equal length."""

    x: Arr
    y: Arr
    z: Arr
    dx: Arr
    dy: Arr
    dz: Arr


def unit(b: Backend, x: Arr, y: Arr, z: Arr) -> tuple[Arr, Arr, Arr]:
    """Return the vector scaled to length 1."""
    scale = 1.0 / b.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


def transported(ray: Ray, z: float) -> Ray:
    """Return the ray with its point moved to the height z, mm; the ray must reach z."""
    t = (z - ray.z) / ray.dz
    return ray._replace(x=ray.x + t * ray.dx, y=ray.y + t * ray.dy, z=z + 0.0 * ray.z)


def mirrored(ray: Ray) -> Ray:
    """Return the ray mirrored by z -> -z."""
    return ray._replace(z=-ray.z, dz=-ray.dz)


def refract_flat(b: Backend, ray: Ray, ratio: float) -> tuple[Ray, Arr]:
    """Refract rays at the planes z = constant through the rays' points; `ratio` is n1 / n2.

    Return rays and their squared cosine behind the face (at most 0 if reflected).
    """
    kx, ky = ray.dx * ratio, ray.dy * ratio
    k = b.sqrt(kx * kx + ky * ky)
    square = (1.0 - k) * (1.0 + k)
    cosine = b.sqrt(b.maximum(square, 0.0))
    return _redirect(b, ray, (kx, ky, b.where(ray.dz < 0.0, -cosine, cosine)), square)


def _redirect(b: Backend, ray: Ray, direction: State, square: Arr) -> tuple[Ray, Arr]:
    """Return rays, with new directions where `square` is positive, and `square` itself."""
    pairs = zip(ray[3:], direction, strict=True)
    return Ray(*ray[:3], *(b.where(square <= 0.0, old, new) for old, new in pairs)), square


#: Maximum cells that a ray visits before it counts as missed.
MAX_CELLS = 16


@dataclass(frozen=True)
class Dome:
    """Spherical caps of one radius over the cells of a lattice, `sag_mm` deep at the corners."""

    lattice: Lattice
    radius_mm: float
    sag_mm: float

    @property
    def curvature(self) -> float:
        """Curvature 1 / R, 1/mm."""
        return 1.0 / self.radius_mm

    def height(self, x: Arr, y: Arr, z: Arr) -> Arr:
        """Return a number for lens-local points: negative in glass, positive in air."""
        return self.curvature * (x * x + y * y + z * z) + 2.0 * z


class Crossing(NamedTuple):
    """A ray at the dome that it meets, the steps (di, dj) to that lenslet, and the cosine |d . N|."""

    ray: Ray
    di: Arr
    dj: Arr
    cosine: Arr
    missed: Arr


def cap(b: Backend, dome: Dome, ray: Ray, upward: bool) -> tuple[Arr, Arr, Ray, Arr]:
    """Intersect rays with their lenslet's sphere; return (hit, distance t, ray at the sphere, cosine)."""
    c = dome.curvature
    s = ray.x * ray.dx + ray.y * ray.dy + ray.z * ray.dz
    qx, qy, qz = ray.x - s * ray.dx, ray.y - s * ray.dy, ray.z - s * ray.dz
    f = c * (qx * qx + qy * qy + qz * qz) + 2.0 * qz
    square = ray.dz * ray.dz - c * f
    hit = square >= 0.0
    cosine = b.sqrt(b.maximum(square, 0.0))
    if upward:
        # The ray exits at (cosine - d_z) / c; this form is precise for d_z > 0.
        t = -f / b.maximum(ray.dz + cosine, 1e-30)
    else:
        # The ray enters at (-d_z - cosine) / c; this form is precise for d_z < 0.
        t = f / b.maximum(cosine - ray.dz, 1e-30)
    on_dome = ray._replace(x=qx + t * ray.dx, y=qy + t * ray.dy, z=qz + t * ray.dz)
    return hit, t - s, on_dome, cosine


def meet(b: Backend, dome: Dome, ray: Ray, upward: bool) -> Crossing:
    """Find where rays first meet the domes, upward through the glass or downward through the air.

    A ray is local to the lenslet whose cell contains its point. A ray in glass starts
    at or below the rims' plane, a ray in air at or above the vertices' plane.
    """
    hit, _, at, cosine = cap(b, dome, ray, upward)
    zero = 0.0 * ray.x
    settled = hit & dome.lattice.holds(at.x, at.y)

    def step(settled: Arr, steps: Arr, di: Arr, dj: Arr, *tail: Arr) -> State:
        # `tail` has the ray in its cell, its point on the dome, and its cosine.
        local = Ray(*tail[:6])
        hit, t, at, cosine = cap(b, dome, local, upward)
        t_flat, (step_i, step_j), (to_x, to_y) = dome.lattice.leave(b, local.x, local.y, local.dx, local.dy)
        settled = hit & (t <= t_flat)
        if dome.lattice.stepped:
            # A ray that meets the wall between two domes is lost.
            x, y, z = (p + t_flat * d for p, d in zip(local[:3], local[3:], strict=True))
            depth = dome.height(x - to_x, y - to_y, z) * (1.0 if upward else -1.0)
            steps = b.where(settled | (depth <= 0.0), steps, MAX_CELLS)
        return (
            settled,
            steps + 1,
            b.where(settled, di, di + step_i),
            b.where(settled, dj, dj + step_j),
            b.where(settled, local.x, local.x - to_x),
            b.where(settled, local.y, local.y - to_y),
            *local[2:],
            *at[:3],
            cosine,
        )

    state = (settled, b.integer(zero), zero, zero, *ray, at.x, at.y, at.z, cosine)
    state = b.loop(lambda *state: ~state[0] & (state[1] < MAX_CELLS), step, state)
    is_met, _, di, dj, *tail = state
    # A ray that missed keeps its last point.
    x, y, z = (b.where(is_met, tail[6 + k], tail[k]) for k in range(3))
    return Crossing(Ray(x, y, z, *ray[3:]), di, dj, b.where(is_met, tail[9], cosine), ~is_met)


def refract_dome(b: Backend, dome: Dome, ray: Ray, cosine: Arr, ratio: float, upward: bool) -> tuple[Ray, Arr]:
    """Refract rays at the dome on which their points are; return rays and squared cosines.

    Snell's law in vector form is d' = r d + (cos t - r cos i) N, with r = n1/n2, the
    normal N, and cos^2 t = 1 - r^2 (1 - cos^2 i).
    """
    c = dome.curvature
    square = 1.0 - (ratio * ratio) * (1.0 - cosine) * (1.0 + cosine)
    cosine_out = b.sqrt(b.maximum(square, 0.0))
    bend = cosine_out - ratio * cosine
    if not upward:
        bend = -bend
    dx = ratio * ray.dx + bend * (c * ray.x)
    dy = ratio * ray.dy + bend * (c * ray.y)
    dz = ratio * ray.dz + bend * (1.0 + c * ray.z)
    # Normalize the direction, because the ratio magnifies rounding errors.
    return _redirect(b, ray, unit(b, dx, dy, dz), square)


def blocked_above(b: Backend, dome: Dome, ray: Ray, suspect: Arr) -> Arr:
    """Return which `suspect` rays meet a neighbour's dome after they leave their own dome upward."""

    def meets_cap(steps: Arr, local: Ray, t: Arr, t_flat: Arr, t_top: Arr) -> Arr:
        # The ray enters a neighbour's cap from outside, at the smaller root; this form
        # has no cancellation. The ray cannot meet its own dome (step 0) again.
        hit, _, _, cosine = cap(b, dome, local, upward=True)
        foot = local.x * local.dx + local.y * local.dy + local.z * local.dz
        t_cap = -(local.dz + cosine) * dome.radius_mm - foot
        return (steps > 0) & hit & (t_cap > t) & (t_cap <= b.minimum(t_flat, t_top))

    # A ray that reaches the vertices' plane above its own cell meets no other dome.
    return _blocked(b, dome, ray, suspect, 0.0, 1.0, meets_cap)


def blocked_below(b: Backend, dome: Dome, ray: Ray, suspect: Arr) -> Arr:
    """Return which `suspect` rays enter a dome, but leave its glass again in the valley between domes."""

    def leaves_glass(_steps: Arr, local: Ray, _t: Arr, t_flat: Arr, t_rim: Arr) -> Arr:
        x, y, z = local.x + t_flat * local.dx, local.y + t_flat * local.dy, local.z + t_flat * local.dz
        return (t_flat < t_rim) & (dome.height(x, y, z) > 0.0)

    # A ray that reaches the rims' plane inside its own cell stays in the glass.
    return _blocked(b, dome, ray, suspect, -dome.sag_mm, -1.0, leaves_glass)


def _blocked(b: Backend, dome: Dome, ray: Ray, suspect: Arr, plane: float, up: float, meets: Operation) -> Arr:
    """Return which rays are blocked before the height `plane`, upward (`up` = 1) or downward (-1).

    A ray that reaches the plane in its own cell is not blocked; a ray that moves away
    from the plane is blocked. Other rays step from cell to cell until `meets(steps,
    ray, t at the cell's entry, t at its exit, t at the plane)` is true.
    """
    away = up * ray.dz <= 0.0
    t_plane = (plane - ray.z) / (up * b.maximum(up * ray.dz, 1e-30))
    clear = ~away & dome.lattice.holds(ray.x + t_plane * ray.dx, ray.y + t_plane * ray.dy)

    def active(searching: Arr, steps: Arr, *_: Arr) -> Arr:
        return searching & (steps < MAX_CELLS)

    def step(_: Arr, steps: Arr, blocked: Arr, t: Arr, *state: Arr) -> State:
        local = Ray(*state)
        t_flat, _, (to_x, to_y) = dome.lattice.leave(b, local.x, local.y, local.dx, local.dy)
        t_plane = (plane - local.z) / local.dz
        met = meets(steps, local, t, t_flat, t_plane)
        if dome.lattice.stepped:
            # The ray may meet the wall where it enters this cell.
            x, y, z = local.x + t * local.dx, local.y + t * local.dy, local.z + t * local.dz
            met = met | ((steps > 0) & (up * dome.height(x, y, z) < 0.0))
        searching = ~met & (t_flat < t_plane)
        x = b.where(searching, local.x - to_x, local.x)
        y = b.where(searching, local.y - to_y, local.y)
        return searching, steps + 1, blocked | met, t_flat, x, y, *local[2:]

    zero = 0.0 * ray.x
    start = suspect & ~clear & ~away, b.integer(zero), away, zero, *ray
    searching, _, blocked, *_ = b.loop(active, step, start)
    return suspect & (blocked | searching)
