"""One lenslet on its axis, traced by rayoptics: a second opinion of another house, in float64.

Rays are given and returned lens-local, z = 0 in the plane of the vertices, as in
docs/reference/optics.md. There is one lens here, without edges: no lattice, no cells, no
blocking. Compare rays of status 0 only.

What is imported of rayoptics (0.9.8): `rayoptics.raytr.raytrace.trace_raw`,
`rayoptics.raytr.traceerror`, `rayoptics.elem.surface.Surface` and
`rayoptics.elem.profiles.Spherical`. They pull in `rayoptics.seq.interface`,
`rayoptics.optical.model_constants`, `rayoptics.optical.model_enums` and
`rayoptics.util.misc_math`, and from outside numpy, scipy and transforms3d: no Qt, no matplotlib,
no opticalglass. `trace_raw` takes the path as plain tuples, so no OpticalModel, no Gap and no
glass is made.

How rayoptics differs from a tracer of ours: it starts each intersection from the ray's point
nearest to the vertex, uses Welford's form of the quadratic with the curvature 1 / R, and bends with
unnormalised normals. Some 40,000 rays a second.
"""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class OpticsNumbers(Protocol):
    """What is read of a display: `truth.Optics` has it. Millimetres; index in air."""

    @property
    def radius_mm(self) -> float: ...
    @property
    def index(self) -> float: ...
    @property
    def thickness_mm(self) -> float: ...
    @property
    def gap_mm(self) -> float: ...
    @property
    def plano_side(self) -> Literal["panel", "viewer"]: ...


@dataclass(frozen=True)
class SequentialLenslet:
    """Panel plane, first face, last face as rayoptics sees them.

    path: (interface, gap, transform to the next, index behind, z direction) a surface, as
    `trace_raw` wants it. z_last: where the last face's vertex lies, mm; 0 is the vertices' plane.
    """

    path: tuple[tuple[Any, ...], ...]
    z_last: float

    def trace(
        self, point: npt.ArrayLike, direction: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
        """Trace n rays from the panel.

        point: (n, 2) float64, mm, lens-local, in the panel plane. direction: (n, 3) float64, unit.
        Returns the points on the last face (n, 3), mm, lens-local; the directions behind it
        (n, 3); the status (n,): 0 ok, 1 missed surface, 2 total internal reflection. Rows of a
        status other than 0 hold zeros.
        """
        from rayoptics.raytr.raytrace import trace_raw
        from rayoptics.raytr.traceerror import TraceMissedSurfaceError, TraceTIRError

        points = np.asarray(point, np.float64)
        directions = np.asarray(direction, np.float64)
        origin, leaving = np.zeros((len(points), 3)), np.zeros((len(points), 3))
        status = np.zeros(len(points), np.int64)
        for ray, (xy, d) in enumerate(zip(points, directions, strict=True)):
            start = np.array([xy[0], xy[1], 0.0])
            try:
                segments, _, _ = trace_raw(iter(self.path), start, d, 550.0, intersect_obj=False)
            except TraceMissedSurfaceError:
                status[ray] = 1
            except TraceTIRError:
                status[ray] = 2
            else:
                origin[ray], leaving[ray] = segments[-1][0], segments[-1][1]
                origin[ray, 2] += self.z_last
        return origin, leaving, status


def sequential_lenslet(optics: OpticsNumbers) -> SequentialLenslet:
    """Build one lenslet of a display, with its axis as z, for rayoptics."""
    try:
        from rayoptics.elem.profiles import Spherical
        from rayoptics.elem.surface import Surface
    except ImportError as missing:
        raise ImportError(
            "the independent trace needs: pip install --no-deps rayoptics, and scipy, transforms3d"
        ) from missing

    flat = Surface(profile=Spherical(c=0.0))
    if optics.plano_side == "panel":
        # Centre of curvature on the panel's side: a negative radius for rayoptics.
        first, last, z_last = flat, Surface(profile=Spherical(c=-1.0 / optics.radius_mm)), 0.0
    else:
        first, last = Surface(profile=Spherical(c=1.0 / optics.radius_mm)), flat
        z_last = float(optics.thickness_mm)

    def behind(surface: Any, distance: float, index: float) -> tuple[Any, ...]:
        """One step of the path: a surface, then a distance in mm through a medium."""
        return (surface, None, (np.eye(3), np.array([0.0, 0.0, distance])), index, 1.0)

    panel = Surface(profile=Spherical(c=0.0), interact_mode="dummy")
    path = (
        behind(panel, float(optics.gap_mm), 1.0),
        behind(first, float(optics.thickness_mm), float(optics.index)),
        behind(last, 0.0, 1.0),
    )
    return SequentialLenslet(path, z_last)
