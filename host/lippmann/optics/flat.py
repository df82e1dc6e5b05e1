"""Step 4: refraction at the flat face.

Snell's law at a plane keeps the tangential part of n d: with k = d_tangential n1/n2 the new direction is
(k, sqrt(1 - |k|^2)), and there is none (total internal reflection) when |k| > 1.
"""

from __future__ import annotations

from lippmann.optics.aim import Ray
from lippmann.optics.backend import Arr, Backend


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
