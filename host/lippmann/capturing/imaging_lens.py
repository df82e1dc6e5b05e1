"""Traces rays through the imaging lens: two thick plano-convex lenses, or an ideal thin lens.

**Frame.** Rays run from the array to the scene. z is 0 in the image-side principal
plane H' and increases along the axis towards the object. The object-side principal
plane is H. A face with vertex z and curvature c has its centre of curvature at z + 1/c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from lippmann.optics.backend import Arr, Backend
from lippmann.optics.faces import Dome, Ray, cap, refract_dome, refract_flat, transported, unit
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Floats

#: Direction of a lens pair's curved faces: inwards, outwards, to image or to object.
Convex = Literal["in", "out", "image", "object"]


class Face(NamedTuple):
    """A lens face: vertex z (mm), curvature (1/mm, 0 if flat), indices before and behind it."""

    z_mm: float
    curvature: float
    index_before: float
    index_behind: float


@dataclass(frozen=True)
class ThinLens:
    """An ideal lens, which changes the slope of each ray by -height / f, without aberrations."""

    focal_length_mm: float
    aperture_mm: float

    #: A thin lens has H, H' and both outermost vertices at 0.
    hiatus_mm: ClassVar[float] = 0.0
    extent_mm: ClassVar[tuple[float, float]] = (0.0, 0.0)

    def trace(self, b: Backend, ray: Ray) -> tuple[Ray, Arr]:
        """Trace rays in the lens's frame, towards the object (dz > 0).

        Returns rays from the last face, and a mask of rays that passed all faces inside
        the aperture, not totally reflected. Blocked rays have finite values.
        """
        x, y = ray.x - ray.z * (ray.dx / ray.dz), ray.y - ray.z * (ray.dy / ray.dz)
        power = 1.0 / self.focal_length_mm
        dx, dy, dz = unit(b, ray.dx / ray.dz - x * power, ray.dy / ray.dz - y * power, 1.0)
        return Ray(x, y, 0.0 * x, dx, dy, dz), _inside(x, y, self.aperture_mm)


@dataclass(frozen=True)
class LensPair:
    """Two equal plano-convex lenses on one axis, as `LensKeys` describes them."""

    radius_mm: float
    index: float
    thickness_mm: float
    separation_mm: float
    aperture_mm: float
    convex: Convex = "in"

    def with_focal_length(self, focal_length_mm: float) -> LensPair:
        """Return the pair with the radius that gives a focal length f; raise ValueError if d > f.

        1/f = 2/F - d/F^2 for lenses of focal length F = R / (n - 1) whose inner
        principal planes are d apart (Hecht, Optics, section 6.1). With radius R, index
        n and thickness T, these planes are at a curved face's vertex, and T/n inside a
        flat face.
        """
        flats_inside = {"in": 0, "out": 2, "image": 1, "object": 1}[self.convex]
        d = self.separation_mm + flats_inside * self.thickness_mm / self.index
        single = focal_length_mm * (1.0 + math.sqrt(1.0 - d / focal_length_mm))
        return replace(self, radius_mm=(self.index - 1.0) * single)

    @property
    def sag_mm(self) -> float:
        """Sag of a curved face over the aperture, mm."""
        half = 0.5 * self.aperture_mm
        return half**2 / (self.radius_mm + math.sqrt((self.radius_mm - half) * (self.radius_mm + half)))

    @property
    def _first_vertex(self) -> tuple[Face, ...]:
        c, n = 1.0 / self.radius_mm, self.index
        first = (0.0, -c) if self.convex in ("in", "object") else (c, 0.0)
        second = (c, 0.0) if self.convex in ("in", "image") else (0.0, -c)
        start = self.thickness_mm + self.separation_mm
        return (
            Face(0.0, first[0], 1.0, n),
            Face(self.thickness_mm, first[1], n, 1.0),
            Face(start, second[0], 1.0, n),
            Face(start + self.thickness_mm, second[1], n, 1.0),
        )

    @cached_property
    def _matrix(self) -> Floats:
        """ABCD matrix from first to last vertex, for rays (height in mm, index times slope)."""
        matrix = np.eye(2)
        z = 0.0
        for face in self._first_vertex:
            matrix = np.array([[1.0, (face.z_mm - z) / face.index_before], [0.0, 1.0]]) @ matrix
            power = (face.index_behind - face.index_before) * face.curvature
            matrix = np.array([[1.0, 0.0], [-power, 1.0]]) @ matrix
            z = face.z_mm
        return matrix

    @property
    def focal_length_mm(self) -> float:
        """Focal length -1/C of the pair, mm, from the ABCD matrix."""
        return float(-1.0 / self._matrix[1, 0])

    @cached_property
    def _image_principal(self) -> float:
        """Distance (D - 1)/C of H' behind the first vertex, mm (see `_matrix`)."""
        return float((self._matrix[1, 1] - 1.0) / self._matrix[1, 0])

    @property
    def hiatus_mm(self) -> float:
        """Distance from H' to H, mm; H is (1 - A)/C behind the last vertex (see `_matrix`)."""
        last = self._first_vertex[-1].z_mm
        return float(last + (1.0 - self._matrix[0, 0]) / self._matrix[1, 0] - self._image_principal)

    @property
    def faces(self) -> tuple[Face, ...]:
        """The four faces in the lens's frame."""
        return tuple(face._replace(z_mm=face.z_mm - self._image_principal) for face in self._first_vertex)

    @property
    def extent_mm(self) -> tuple[float, float]:
        """Positions z of the first and the last vertex, mm."""
        return self.faces[0].z_mm, self.faces[-1].z_mm

    def trace(self, b: Backend, ray: Ray) -> tuple[Ray, Arr]:
        """Trace rays through the four faces; see `ThinLens.trace`."""
        through = ray.dz > 0.0
        for face in self.faces:
            ray, passed = refract_face(b, face, ray, self.aperture_mm)
            through = through & passed
        return ray, through


ImagingLens = ThinLens | LensPair


def refract_face(b: Backend, face: Face, ray: Ray, aperture_mm: float) -> tuple[Ray, Arr]:
    """Refract rays with dz > 0 at a face; return rays and a mask of those that passed."""
    ratio = face.index_before / face.index_behind
    if face.curvature == 0.0:
        new, behind = refract_flat(b, transported(ray, face.z_mm), ratio)
        passed = (ray.dz > 0.0) & (behind > 0.0)
    else:
        dome = Dome(Lattice("square", aperture_mm), -1.0 / face.curvature, 0.0)
        hit, _, met, cosine = cap(b, dome, ray._replace(z=ray.z - face.z_mm), upward=True)
        new, behind = refract_dome(b, dome, met, cosine, ratio, upward=True)
        new = new._replace(z=new.z + face.z_mm)
        passed = hit & (behind > 0.0)
    passed = passed & _inside(new.x, new.y, aperture_mm)
    return Ray(*(b.where(passed, fresh, stale) for fresh, stale in zip(new, ray, strict=True))), passed


def _inside(x: Arr, y: Arr, aperture_mm: float) -> Arr:
    return x * x + y * y <= 0.25 * aperture_mm * aperture_mm
