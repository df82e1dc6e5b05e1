"""A ray through a lenslet by one of the four models: `exact` (exact.py), or the idealised lenslet, which is here.

The idealised models are `pinhole`, `thin` and `paraxial`. Their slopes are tangents of angles in the x and y sections;
heights are lens-local, mm.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lippmann.optics import exact
from lippmann.optics.aim import Ray, unit
from lippmann.optics.backend import Arr, Backend
from lippmann.optics.rays import Model, Status
from lippmann.optics.system import Exit, Landing, System

#: Squared cosine below which the fast engine traces a ray again in double precision. float32 turns a ray by about 0.2
#: microradian over its cosine to the face's normal: above this cosine, by less than 1 microradian.
GRAZING_SQUARE = 0.15


def ray_matrix(system: System) -> npt.NDArray[np.float64]:
    """Return the ABCD matrix (2, 2) from the panel to the last face's vertex plane, for (height mm, slope in air).

    Translations by gap and by thickness / n (the slope inside the glass is carried times n), refraction with power
    1/f at the dome and with none at the flat face (Hecht, Optics, section 6.2, matrix methods).
    """
    gap = np.array([[1.0, system.gap_mm], [0.0, 1.0]])
    glass = np.array([[1.0, system.thickness_mm / system.index], [0.0, 1.0]])
    dome = np.array([[1.0, 0.0], [-1.0 / system.focal_length_mm, 1.0]])
    matrix: npt.NDArray[np.float64] = dome @ glass @ gap if system.plano_to_panel else glass @ dome @ gap
    return matrix


def leave_panel(b: Backend, system: System, x: Arr, y: Arr, aperture: tuple[Arr, Arr] | None, model: Model) -> Exit:
    """Trace rays from the panel to the world; rays that graze a face, in double precision throughout.

    The panel points (x, y) are local to the lenslet that they belong to, array's axes, mm, double; the points aimed at
    likewise, None for chief rays.
    """

    def traced(b: Backend, x: Arr, y: Arr, *aim: Arr) -> tuple[Arr, ...]:
        points = (aim[0], aim[1]) if aim else None
        if model == "exact":
            out = exact.leave_panel(b, system, x, y, points)
        else:
            out = _leave_ideal(b, system, x, y, points, model)
        return *out.ray, *out[1:]

    aim = aperture or ()
    coarse = traced(b, b.real(x), b.real(y), *(b.real(a) for a in aim))
    inputs = (x, y, *(b.double(a) for a in aim))
    done = b.refine(coarse[-1] < GRAZING_SQUARE, traced, inputs, coarse)
    return Exit(Ray(*done[:6]), *done[6:])


def reach_panel(b: Backend, system: System, ray: Ray, model: Model) -> Landing:
    """Trace rays from the world to the panel.

    `ray` is local to the lenslet whose cell its point lies in, array's axes, heading for the panel. The point lies in
    the vertices' plane for `pinhole` and `thin`, on the last face's plane (dome vertices or flat) for the others.
    """
    return exact.reach_panel(b, system, ray) if model == "exact" else _reach_ideal(b, system, ray, model)


def _leave_ideal(b: Backend, system: System, x: Arr, y: Arr, aperture: tuple[Arr, Arr] | None, model: Model) -> Exit:
    zero = 0.0 * x
    di = dj = cx = cy = hx = hy = zero
    per_mm = 1.0 / system.aperture_distance_mm
    sx, sy = -x * per_mm, -y * per_mm
    z = 0.0
    if aperture is not None and model != "pinhole":
        # The lenslet whose cell the aperture point lies in bends the ray.
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
    other = (di != 0.0) | (dj != 0.0)
    status = b.integer(b.where(other, int(Status.CROSSTALK), int(Status.OK)))
    return Exit(Ray(hx, hy, zero + z, dx, dy, dz), di, dj, status, grazing)


def _reach_ideal(b: Backend, system: System, ray: Ray, model: Model) -> Landing:
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
