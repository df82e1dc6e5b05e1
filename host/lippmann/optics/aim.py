"""Step 3: a ray, its unit direction, and its point on a plane."""

from __future__ import annotations

from typing import NamedTuple

from lippmann.optics.backend import Arr, Backend


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
    """Return the ray seen in the mirror z -> -z.

    The domes then always bulge to +z, whichever side the array turns to the panel.
    """
    return ray._replace(z=-ray.z, dz=-ray.dz)
