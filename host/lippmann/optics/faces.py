"""Steps 4 and 5: a ray at the faces of a lenslet, refraction at the flat face and at the domes.

Snell's law at a plane keeps the tangential part of n d: with k = d_tangential n1/n2 the new direction is
(k, sqrt(1 - |k|^2)), and there is none (total internal reflection) when |k| > 1.

**Domes** are lens-local with the vertex at the origin, the dome bulging to +z, glass below:
curvature c = 1/R, sphere c (x^2 + y^2 + z^2) + 2 z = 0.

**Perpendicular-foot form.** The ray's point is first moved to the foot of the perpendicular from the vertex, Q with
Q . d = 0. Then with F = c |Q|^2 + 2 Q_z the sphere is met where c t^2 + 2 d_z t + F = 0, and the cosine between ray
and normal is the root of that equation's discriminant, sqrt(d_z^2 - c F). No term grows with the ray's
distance or with R: a flat face is c = 0.

**The height field.** The array's face is one surface made of caps, one for each cell. A ray meets the cap of its cell
or steps to the next cell. Neighbouring caps have equal heights on the flat between them, so the first cap met before
the ray leaves its cell is the first met at all, and no ray slips between two cells. On a sheared lattice, and on a
hexagonal one of two pitches, they have not: a wall stands there, and a ray that comes to it is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from lippmann.optics.backend import Arr, Backend
from lippmann.optics.lattice import Lattice


class Ray(NamedTuple):
    """Point (mm) and unit direction, six arrays of one length."""

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
    """Return the ray with its point moved to the plane at height z (mm); it must not run along that plane."""
    t = (z - ray.z) / ray.dz
    return ray._replace(x=ray.x + t * ray.dx, y=ray.y + t * ray.dy, z=z + 0.0 * ray.z)


def mirrored(ray: Ray) -> Ray:
    """Return the ray seen in the mirror z -> -z."""
    return ray._replace(z=-ray.z, dz=-ray.dz)


def refract_flat(b: Backend, ray: Ray, ratio: float) -> tuple[Ray, Arr]:
    """Refract rays at a plane z = constant through their points; `ratio` is n1 / n2, index before over index behind.

    Return the refracted rays and the squared cosine behind the face: not positive where the ray is totally reflected,
    and keeps its direction.
    """
    kx, ky = ray.dx * ratio, ray.dy * ratio
    k = b.sqrt(kx * kx + ky * ky)
    square = (1.0 - k) * (1.0 + k)
    reflected = square <= 0.0
    cosine = b.sqrt(b.maximum(square, 0.0))
    return (
        ray._replace(
            dx=b.where(reflected, ray.dx, kx),
            dy=b.where(reflected, ray.dy, ky),
            dz=b.where(reflected, ray.dz, b.where(ray.dz < 0.0, -cosine, cosine)),
        ),
        square,
    )


#: Largest number of cells that a ray is followed through; beyond, it counts as having missed.
MAX_CELLS = 16


@dataclass(frozen=True)
class Dome:
    """A cap of curvature 1/radius over each cell of a lattice; `sag_mm` deep at the cells' corners."""

    lattice: Lattice
    radius_mm: float
    sag_mm: float

    @property
    def curvature(self) -> float:
        """1 / R, 1/mm."""
        return 1.0 / self.radius_mm

    def height(self, x: Arr, y: Arr, z: Arr) -> Arr:
        """Return a number that is negative for points (lens-local) in the glass and positive for those in the air."""
        return self.curvature * (x * x + y * y + z * z) + 2.0 * z


class Crossing(NamedTuple):
    """Where a ray meets the height field: the ray there, local to the lenslet met, and its cosine |d . N| to the dome.

    That lenslet is (di, dj) steps, whole numbers in the real format, from the one that the incoming ray was local to.
    """

    ray: Ray
    di: Arr
    dj: Arr
    cosine: Arr
    missed: Arr


def cap(b: Backend, dome: Dome, ray: Ray, upward: bool) -> tuple[Arr, Arr, Ray, Arr]:
    """Intersect rays with the sphere of the lenslet that they are local to; of the dome, its curvature alone counts.

    A ray in the glass going up (`upward`) meets the sphere where it leaves it, one in the air where it enters.
    Returns (hit, t from the ray's point, ray with its point on the sphere, cosine).
    """
    c = dome.curvature
    s = ray.x * ray.dx + ray.y * ray.dy + ray.z * ray.dz
    qx, qy, qz = ray.x - s * ray.dx, ray.y - s * ray.dy, ray.z - s * ray.dz
    f = c * (qx * qx + qy * qy + qz * qz) + 2.0 * qz
    square = ray.dz * ray.dz - c * f
    hit = square >= 0.0
    cosine = b.sqrt(b.maximum(square, 0.0))
    if upward:
        # The larger root (cosine - d_z) / c, written so that nothing cancels where d_z > 0.
        t = -f / b.maximum(ray.dz + cosine, 1e-30)
    else:
        # The smaller root (-d_z - cosine) / c, likewise for d_z < 0.
        t = f / b.maximum(cosine - ray.dz, 1e-30)
    on_dome = ray._replace(x=qx + t * ray.dx, y=qy + t * ray.dy, z=qz + t * ray.dz)
    return hit, t - s, on_dome, cosine


def meet(b: Backend, dome: Dome, ray: Ray, upward: bool) -> Crossing:
    """Find where rays first meet the height field, from below through the glass (`upward`) or from above through air.

    A ray is lens-local to the lenslet in whose cell its point lies, at the rims' plane or lower when it comes through
    the glass, at the vertices' plane or higher when it comes through the air.
    """
    hit, _, at, cosine = cap(b, dome, ray, upward)
    zero = 0.0 * ray.x
    settled = hit & dome.lattice.holds(at.x, at.y)

    def unsettled(*state: Arr) -> Arr:
        return ~state[0] & (state[1] < MAX_CELLS)

    def step(settled: Arr, steps: Arr, di: Arr, dj: Arr, *tail: Arr) -> tuple[Arr, ...]:
        # `rest`: the ray (x, y, z, dx, dy, dz) in its present cell, then the point on the dome and the cosine there.
        local = Ray(*tail[:6])
        hit, t, at, cosine = cap(b, dome, local, upward)
        t_flat, (step_i, step_j), (to_x, to_y) = dome.lattice.leave(b, local.x, local.y, local.dx, local.dy)
        settled = hit & (t <= t_flat)
        if dome.lattice.stepped:
            # Through the wall between two domes: the glass ends there, or begins.
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
    state = b.loop(unsettled, step, state)
    is_met, _, di, dj, *tail = state
    # A ray that met nothing keeps its last point.
    x, y, z = (b.where(is_met, tail[6 + k], tail[k]) for k in range(3))
    return Crossing(Ray(x, y, z, *ray[3:]), di, dj, b.where(is_met, tail[9], cosine), ~is_met)


def refract_dome(b: Backend, dome: Dome, ray: Ray, cosine: Arr, ratio: float, upward: bool) -> tuple[Ray, Arr]:
    """Refract rays at the sphere through their points.

    Vector form of Snell's law: d' = r d + (cos t - r cos i) N, with r = n1/n2 and cos^2 t = 1 - r^2 (1 - cos^2 i).
    Return as `refract_flat` does.
    """
    c = dome.curvature
    square = 1.0 - (ratio * ratio) * (1.0 - cosine) * (1.0 + cosine)
    reflected = square <= 0.0
    cosine_out = b.sqrt(b.maximum(square, 0.0))
    bend = cosine_out - ratio * cosine
    if not upward:
        bend = -bend
    dx = ratio * ray.dx + bend * (c * ray.x)
    dy = ratio * ray.dy + bend * (c * ray.y)
    dz = ratio * ray.dz + bend * (1.0 + c * ray.z)
    # Unit but for the rounding of the normal, which the ratio magnifies.
    dx, dy, dz = unit(b, dx, dy, dz)
    return ray._replace(
        dx=b.where(reflected, ray.dx, dx), dy=b.where(reflected, ray.dy, dy), dz=b.where(reflected, ray.dz, dz)
    ), square


def blocked_above(b: Backend, dome: Dome, ray: Ray, suspect: Arr) -> Arr:
    """Tell which rays, leaving a dome upward through the air, meet a neighbour's dome.

    `ray` is local to the lenslet left, its point on that dome. Only rays of `suspect` are examined.
    """

    def meets_cap(steps: Arr, local: Ray, t: Arr, t_flat: Arr, t_top: Arr) -> Arr:
        # This cell's cap, entered from the side: both roots are behind the vertex's foot, nothing cancels.
        # The dome just left cannot be met again, so step 0 skips it.
        hit, _, _, cosine = cap(b, dome, local, upward=True)
        foot = local.x * local.dx + local.y * local.dy + local.z * local.dz
        t_cap = -(local.dz + cosine) * dome.radius_mm - foot
        return (steps > 0) & hit & (t_cap > t) & (t_cap <= b.minimum(t_flat, t_top))

    # At the vertices' plane still above its own cell: clear, because a dome cannot be met twice from outside.
    return _blocked(b, dome, ray, suspect, 0.0, 1.0, meets_cap)


def blocked_below(b: Backend, dome: Dome, ray: Ray, suspect: Arr) -> Arr:
    """Tell which rays, entering a dome downward through the glass, leave it again through the valley of a seam.

    `ray` is local to the lenslet entered, its point on that dome. Only rays of `suspect` are examined.
    """

    def leaves_glass(_steps: Arr, local: Ray, _t: Arr, t_flat: Arr, t_rim: Arr) -> Arr:
        x, y, z = local.x + t_flat * local.dx, local.y + t_flat * local.dy, local.z + t_flat * local.dz
        return (t_flat < t_rim) & (dome.height(x, y, z) > 0.0)

    # At the rims' plane still inside its own cell: a chord of one sphere, all in the glass.
    return _blocked(b, dome, ray, suspect, -dome.sag_mm, -1.0, leaves_glass)


def _blocked(b: Backend, dome: Dome, ray: Ray, suspect: Arr, plane: float, up: float, meets: Callable[..., Arr]) -> Arr:
    """Follow rays from cell to cell to the plane at height `plane`; tell which are blocked before they reach it.

    A ray that reaches the plane over its own cell is clear; one that heads away from it is blocked. The others step
    from cell to cell until `meets(steps, ray, t of the cell's near flat, t of its far flat, t of the plane)`.
    `up` is 1 for a plane above the rays and -1 for one below.
    """
    away = up * ray.dz <= 0.0
    t_plane = (plane - ray.z) / (up * b.maximum(up * ray.dz, 1e-30))
    clear = ~away & dome.lattice.holds(ray.x + t_plane * ray.dx, ray.y + t_plane * ray.dy)

    def active(searching: Arr, steps: Arr, *_: Arr) -> Arr:
        return searching & (steps < MAX_CELLS)

    def step(_: Arr, steps: Arr, blocked: Arr, t: Arr, *state: Arr) -> tuple[Arr, ...]:
        local = Ray(*state)
        t_flat, _, (to_x, to_y) = dome.lattice.leave(b, local.x, local.y, local.dx, local.dy)
        t_plane = (plane - local.z) / local.dz
        met = meets(steps, local, t, t_flat, t_plane)
        if dome.lattice.stepped:
            # The wall where the ray has come into this cell.
            x, y, z = local.x + t * local.dx, local.y + t * local.dy, local.z + t * local.dz
            met = met | ((steps > 0) & (up * dome.height(x, y, z) < 0.0))
        searching = ~met & (t_flat < t_plane)
        x, y = b.where(searching, local.x - to_x, local.x), b.where(searching, local.y - to_y, local.y)
        return searching, steps + 1, blocked | met, t_flat, x, y, *local[2:]

    zero = 0.0 * ray.x
    searching, _, blocked, *_ = b.loop(active, step, (suspect & ~clear & ~away, b.integer(zero), away, zero, *ray))
    return suspect & (blocked | searching)
