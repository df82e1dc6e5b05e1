"""One lenslet on its axis, traced by rayoptics (0.9.8): a second opinion of another house, in float64.

Rays are given and returned lens-local, z = 0 in the plane of the vertices, as in docs/reference/optics.md. There is
one lens here, without edges: no lattice, no cells, no blocking. Compare rays of status 0 only.

`trace_raw` takes the path as plain tuples, so no OpticalModel and no glass is made, and neither Qt nor matplotlib is
loaded. How rayoptics differs from a tracer of ours: it starts each intersection from the ray's point nearest to the
vertex, uses Welford's form of the quadratic with the curvature 1 / R, and bends with unnormalised normals.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


def surface(curvature, distance, index, mode="transmit"):
    """One step of a path: a spherical surface, then a distance in mm along the axis through a medium."""
    from rayoptics.elem.profiles import Spherical
    from rayoptics.elem.surface import Surface

    shift = np.eye(3), np.array([0.0, 0.0, distance])
    return Surface(profile=Spherical(c=curvature), interact_mode=mode), None, shift, index, 1.0


def last_point(path, start, direction):
    """Where a ray meets the last surface of a path, from that surface's vertex, and its direction behind it."""
    from rayoptics.raytr.raytrace import trace_raw

    segments, _, _ = trace_raw(iter(path), start, direction, 550.0, intersect_obj=False)
    return segments[-1][:2]


@dataclass(frozen=True)
class SequentialLenslet:
    """Panel plane, first face, last face; z_last: where the last face's vertex lies, mm, the vertices' plane at 0."""

    path: tuple[tuple[Any, ...], ...]
    z_last: float

    def trace(self, point, direction):
        """Trace n rays from points (n, 2), mm, in the panel plane along unit directions (n, 3).

        Returns the points on the last face (n, 3), mm; the directions behind it (n, 3); the status (n,): 0 ok, 1
        missed surface, 2 total internal reflection. Rows of a status other than 0 hold zeros.
        """
        from rayoptics.raytr.traceerror import TraceMissedSurfaceError, TraceTIRError

        points, directions = np.asarray(point, np.float64), np.asarray(direction, np.float64)
        origin, leaving = np.zeros((len(points), 3)), np.zeros((len(points), 3))
        status = np.zeros(len(points), np.int64)
        for ray, (xy, d) in enumerate(zip(points, directions, strict=True)):
            try:
                origin[ray], leaving[ray] = last_point(self.path, np.append(xy, 0.0), d)
            except TraceMissedSurfaceError:
                status[ray] = 1
            except TraceTIRError:
                status[ray] = 2
            else:
                origin[ray, 2] += self.z_last
        return origin, leaving, status


def sequential_lenslet(optics):
    """Build one lenslet of a display (`truth.Optics`), with its axis as z, for rayoptics."""
    # With the dome to the viewer the centre of curvature is on the panel's side: a negative radius for rayoptics.
    to_viewer = optics.plano_side == "panel"
    first, last = (0.0, -1.0 / optics.radius_mm) if to_viewer else (1.0 / optics.radius_mm, 0.0)
    path = (
        surface(0.0, float(optics.gap_mm), 1.0, "dummy"),
        surface(first, float(optics.thickness_mm), float(optics.index)),
        surface(last, 0.0, 1.0),
    )
    return SequentialLenslet(path, 0.0 if to_viewer else float(optics.thickness_mm))
