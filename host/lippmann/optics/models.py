"""Traces a ray through a lenslet by one of the four models.

The models `pinhole`, `thin` and `paraxial` use slopes (tangents of angles in the x and
y sections) and lens-local heights, mm. The model `exact` applies Snell's law at both
faces. Where necessary, `exact` mirrors rays, so that domes bulge to +z: rays then leave
the glass upward or enter the glass downward. In plano-concave lenslets, rays leave the
glass downward: glass is above the dome, air below.
"""

from __future__ import annotations

import numpy as np

from lippmann.optics import faces
from lippmann.optics.backend import Arr, Backend, Point, State
from lippmann.optics.faces import Crossing, Ray, mirrored, refract_flat, transported, unit
from lippmann.optics.rays import Floats, Model, Status, gets_through
from lippmann.optics.system import Exit, Landing, System

#: Squared cosine below which the fast engine traces a ray in double precision. A
#: float32 error rotates a ray by about 0.2 microradian divided by the ray's cosine to
#: the normal: by less than 1 microradian above this limit.
GRAZING_SQUARE = 0.15


def ray_matrix(system: System) -> Floats:
    """Return the ABCD matrix (2, 2) from the panel to the last face's vertex plane, for (height mm, slope in air).

    The matrix combines the distances gap and thickness / n with the dome's power 1/f
    (Hecht, Optics, 6.2).
    """
    gap = np.array([[1.0, system.gap_mm], [0.0, 1.0]])
    glass = np.array([[1.0, system.thickness_mm / system.index], [0.0, 1.0]])
    dome = np.array([[1.0, 0.0], [-1.0 / system.focal_length_mm, 1.0]])
    matrix: Floats = dome @ glass @ gap if system.plano_to_panel else glass @ dome @ gap
    return matrix


def leave_panel(b: Backend, system: System, x: Arr, y: Arr, aperture: Point | None, model: Model) -> Exit:
    """Trace rays from the panel to the world, in double precision if they graze a face.

    The panel points (x, y; double) and the aperture points (None: chief rays) are in mm
    from the centre of the pixel's lenslet, in the array's axes.
    """

    def traced(b: Backend, x: Arr, y: Arr, *aim: Arr) -> State:
        out = _leave(b, system, x, y, (aim[0], aim[1]) if aim else None, model)
        return *out.ray, *out[1:]

    aim = aperture or ()
    coarse = traced(b, b.real(x), b.real(y), *(b.real(a) for a in aim))
    inputs = (x, y, *(b.double(a) for a in aim))
    fine = b.refine(coarse[-1] < GRAZING_SQUARE, traced, inputs, coarse)
    return Exit(Ray(*fine[:6]), *fine[6:])


def _leave(b: Backend, system: System, x: Arr, y: Arr, aperture: Point | None, model: Model) -> Exit:
    if model == "exact":
        return _leave_exact(b, system, x, y, aperture)
    zero = 0.0 * x
    di = dj = cx = cy = hx = hy = zero
    per_mm = 1.0 / system.aperture_distance_mm
    sx, sy = -x * per_mm, -y * per_mm
    z = 0.0
    if aperture is not None and model != "pinhole":
        # The lenslet whose cell contains the aperture point refracts the ray.
        sx, sy = (aperture[0] - x) * per_mm, (aperture[1] - y) * per_mm
        di, dj, hx, hy = system.lattice.locate(b, *aperture)
        cx, cy = aperture[0] - hx, aperture[1] - hy
    launch = 1.0 / (1.0 + sx * sx + sy * sy)
    if model == "thin":
        power = 1.0 / system.focal_length_mm
        sx, sy = sx - hx * power, sy - hy * power
    elif model == "paraxial":
        (m00, m01), (m10, m11) = ray_matrix(system).tolist()
        px, py = x - cx, y - cy
        hx, sx = m00 * px + m01 * sx, m10 * px + m11 * sx
        hy, sy = m00 * py + m01 * sy, m10 * py + m11 * sy
        z = system.last_face_mm
    dx, dy, dz = unit(b, sx, sy, zero + 1.0)
    grazing = b.minimum(launch, dz * dz)
    status = b.integer(b.where((di != 0.0) | (dj != 0.0), int(Status.CROSSTALK), int(Status.OK)))
    return Exit(Ray(hx, hy, zero + z, dx, dy, dz), di, dj, status, grazing)


def reach_panel(b: Backend, system: System, ray: Ray, model: Model) -> Landing:
    """Trace rays from the world to the panel.

    `ray` is local to the lenslet whose cell contains the ray's point, in the array's
    axes. The point has z = 0 for `pinhole` and `thin`, else z = `System.last_face_mm`.
    """
    if model == "exact":
        return _reach_exact(b, system, ray)
    zero = 0.0 * ray.x
    sx, sy = ray.dx / ray.dz, ray.dy / ray.dz
    if model == "paraxial":
        i00, i01 = np.linalg.inv(ray_matrix(system))[0].tolist()
        x, y = i00 * ray.x + i01 * sx, i00 * ray.y + i01 * sy
    else:
        hx, hy = (zero, zero) if model == "pinhole" else (ray.x, ray.y)
        power = 1.0 / system.focal_length_mm
        x = hx - system.aperture_distance_mm * (sx + hx * power)
        y = hy - system.aperture_distance_mm * (sy + hy * power)
    return Landing(x, y, zero, zero, b.integer(zero + int(Status.OK)))


def _leave_exact(b: Backend, system: System, x: Arr, y: Arr, aperture: Point | None) -> Exit:
    zero = 0.0 * x
    aim_x, aim_y = (zero, zero) if aperture is None else aperture
    towards_x, towards_y = aim_x - x, aim_y - y
    depth = system.aperture_distance_mm
    dx, dy, dz = unit(b, towards_x, towards_y, depth)
    # Find the ray's point in the array's plane next to the panel (flat face or
    # vertices). With a near eye, a pixel may be far off the lenslet's axis:
    # interpolation from the nearer end of the ray then has a smaller rounding error.
    share, other = system.gap_mm / depth, (depth - system.gap_mm) / depth
    if system.convergence.share == 0.0 or share < 0.5:
        near_x, near_y = x + share * towards_x, y + share * towards_y
    else:
        near_x, near_y = aim_x - other * towards_x, aim_y - other * towards_y
    # With a viewing distance, a pixel may be under a neighbour of its lenslet.
    strays = aperture is not None or system.convergence.share > 0.0
    if system.plano_to_panel:
        ray = Ray(near_x, near_y, zero - system.thickness_mm, dx, dy, dz)
        ray, _ = refract_flat(b, ray, 1.0 / system.index)
        if system.concave:
            # After mirroring, the domes bulge to +z; glass is above them and air below.
            exit_ = _out_of_glass(b, system, mirrored(ray), 0.0, upward=False)
            exit_ = exit_._replace(ray=mirrored(exit_.ray))
        else:
            # An oblique ray may leave its cell below the rims' plane.
            exit_ = _out_of_glass(b, system, ray, -system.dome.sag_mm if strays else None)
    else:
        exit_ = _downward(b, system, Ray(near_x, near_y, zero, dx, dy, -dz), strays)
        exit_ = exit_._replace(ray=mirrored(exit_.ray))
    return exit_._replace(grazing=b.minimum(exit_.grazing, dz * dz))


def _reach_exact(b: Backend, system: System, ray: Ray) -> Landing:
    if system.plano_to_panel:
        exit_ = _downward(b, system, ray, strays=False)
        panel_z = -(system.thickness_mm + system.gap_mm)
    else:
        ray = mirrored(ray)
        inside, _ = refract_flat(b, ray._replace(z=0.0 * ray.z - system.thickness_mm), 1.0 / system.index)
        exit_ = _out_of_glass(b, system, inside, -system.dome.sag_mm)
        panel_z = system.gap_mm
    active = gets_through(exit_.status)
    last = exit_.ray
    t = b.where(active, (panel_z - last.z) / b.where(active, last.dz, 1.0), 0.0)
    return Landing(last.x + t * last.dx, last.y + t * last.dy, exit_.di, exit_.dj, exit_.status)


def _out_of_glass(b: Backend, system: System, ray: Ray, plane: float | None, upward: bool = True) -> Exit:
    """Trace rays in glass through a dome; if `plane` is set, find their lenslets at z = `plane`."""
    start = (0.0, 0.0)
    if plane is not None:
        ray, start = _relocated(b, system, transported(ray, plane))
    crossing = faces.meet(b, system.dome, ray, upward)
    out, square = _through_dome(b, system, crossing, system.index, upward)
    reflected = square <= 0.0
    is_blocked = faces.blocked_above if upward else faces.blocked_below
    blocked = is_blocked(b, system.dome, out, ~crossing.missed & ~reflected)
    return _exit(b, out, start, crossing, reflected, blocked, square)


def _downward(b: Backend, system: System, ray: Ray, strays: bool) -> Exit:
    start = (0.0, 0.0)
    if strays:
        ray, start = _relocated(b, system, ray)
    crossing = faces.meet(b, system.dome, ray, upward=False)
    inside, _ = _through_dome(b, system, crossing, 1.0 / system.index, upward=False)
    blocked = faces.blocked_below(b, system.dome, inside, ~crossing.missed)
    passes = ~crossing.missed & ~blocked
    at_flat = transported(inside._replace(dz=b.where(passes, inside.dz, -1.0)), -system.thickness_mm)
    at_flat = at_flat._replace(dz=inside.dz)
    out, square = refract_flat(b, at_flat, system.index)
    out = Ray(*(b.where(passes, new, old) for new, old in zip(out, inside, strict=True)))
    # A ray can graze the dome or the flat face; rounding rotates it most at the smaller cosine.
    grazing = b.minimum(square, crossing.cosine * crossing.cosine)
    return _exit(b, out, start, crossing, passes & (square <= 0.0), blocked, grazing)


def _through_dome(b: Backend, system: System, crossing: Crossing, ratio: float, upward: bool) -> tuple[Ray, Arr]:
    """Refract rays where they meet a dome; a ray that meets a wall keeps its direction."""
    ray = crossing.ray
    out, square = faces.refract_dome(b, system.dome, ray, crossing.cosine, ratio, upward)
    if system.lattice.stepped:
        out = Ray(*(b.where(crossing.missed, old, new) for old, new in zip(ray, out, strict=True)))
    return out, square


def _relocated(b: Backend, system: System, ray: Ray) -> tuple[Ray, Point]:
    """Make rays local to the lenslets whose cells contain their points; also return these lenslets (i, j)."""
    i, j, x, y = system.lattice.locate(b, ray.x, ray.y)
    return ray._replace(x=x, y=y), (i, j)


def _exit(b: Backend, ray: Ray, start: Point, crossing: Crossing, reflected: Arr, blocked: Arr, grazing: Arr) -> Exit:
    di, dj = start[0] + crossing.di, start[1] + crossing.dj
    status = b.where((di != 0.0) | (dj != 0.0), int(Status.CROSSTALK), int(Status.OK))
    status = b.where(blocked, int(Status.BLOCKED), status)
    status = b.where(reflected, int(Status.INTERNAL_REFLECTION), status)
    status = b.where(crossing.missed, int(Status.MISSED), status)
    return Exit(ray, di, dj, b.integer(status), grazing)
