"""Models `pinhole`, `thin` and `paraxial`: the lenslet idealised, for scenes that need no more.

Slopes are tangents of angles in the x and y sections; heights are lens-local, mm.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lippmann.optics.aim import Ray, unit
from lippmann.optics.backend import Arr, Backend
from lippmann.optics.rays import Status
from lippmann.optics.system import Exit, Landing, System


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


def leave_panel(
    b: Backend,
    system: System,
    x: Arr,
    y: Arr,
    aperture: tuple[Arr, Arr] | None,
    model: str,
) -> Exit:
    """Trace rays from the panel to the world (parameters as in `exact.leave_panel`)."""
    zero = 0.0 * x
    di = dj = cx = cy = hx = hy = zero
    sx, sy = -x * (1.0 / system.aperture_distance_mm), -y * (1.0 / system.aperture_distance_mm)
    z = 0.0
    if aperture is not None and model != "pinhole":
        # The lenslet whose cell the aperture point lies in bends the ray.
        sx = (aperture[0] - x) * (1.0 / system.aperture_distance_mm)
        sy = (aperture[1] - y) * (1.0 / system.aperture_distance_mm)
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
    return Exit(Ray(hx, hy, zero + z, dx, dy, dz), di, dj, cx, cy, status, grazing)


def reach_panel(b: Backend, system: System, ray: Ray, model: str) -> Landing:
    """Trace rays from the world to the panel (parameters as in `exact.reach_panel`).

    For `pinhole` and `thin` the ray stands in the vertices' plane, for `paraxial` on the last face's vertex plane.
    """
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
    own = b.where(system.lattice.holds(x, y), int(Status.OK), int(Status.CROSSTALK))
    return Landing(x, y, zero, zero, zero, zero, b.integer(own))
