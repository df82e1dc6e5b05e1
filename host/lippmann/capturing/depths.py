"""Depth at which a captured point appears on the display, by the lens equations.

To first order, with distances along the axis (mm):

1. The imaging lens: 1/s' = 1/f - 1/s, and heights times m = -s'/s (Hecht, Optics, section 5.2).
2. The point's image is at z = a - s' before the array, a being the array's distance from the lens; z < 0 when the
   array intercepts the light before it converges.
3. Each lenslet images the pinhole of a camera, L from the array, to v before the array: 1/v = 1/f' - 1/L. The pixel at
   u from the lenslet's centre c shows the ray with slope c/L - u/v through c + u. A pickup at D behind the array shows
   the ray with slope -u/D through c.
4. The display emits the pixel with slope -u/g through c, g being its aperture distance; with +u/g when elemental images
   are rotated.

The rays of all lenslets then meet at z' = (g/v) (z - v) L / (L + z), x' = x L / (L + z) for a camera, and at
z' = (g/D) z, x' = x for a pickup; rotation inverts the sign of z'. v is negative for concave lenslets.

On a display whose elemental images converge on an eye at E, u is 1 + g/E times as large, and all rays of a lenslet lean
towards the eye, by c/E: 1/z'' = (1 + g/E)/z' + 1/E. The pixels of a pickup lie where the display's do, and rays arrive
there that lean so too: as captured, z'' = z'; rotated they lean the other way, and 1/z'' = 1/z' + 2/E.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lippmann.capturing.setup import Setup
from lippmann.optics.rays import Floats


def shown_depth(setup: Setup, z_mm: npt.ArrayLike, rotated: bool) -> Floats:
    """Return the depths, mm, positive in front of the display, that show depths z (mm, object's frame).

    Their images must all be before the camera (L + z > 0), which `check_placement` guarantees.
    """
    z = setup.array_distance_mm - setup.image_distance(z_mm)
    g = setup.display.aperture_distance_mm
    distance = setup.camera_distance_mm
    if distance is None:
        depth = z * g / setup.captured.aperture_distance_mm
    else:
        focal = setup.array.focal_length_mm * (-1.0 if setup.concave else 1.0)
        v = 1.0 / (1.0 / focal - 1.0 / distance)
        depth = (g / v) * (z - v) * distance / (distance + z)
    depth = -depth if rotated else depth
    eye_mm = setup.display.viewing_distance_mm
    if eye_mm is None or (distance is None and not rotated):
        return depth
    wider, lean = (1.0, 2.0 / eye_mm) if distance is None else (1.0 + g / eye_mm, 1.0 / eye_mm)
    # 1 / (wider / depth + lean), also for a depth of 0.
    with np.errstate(divide="ignore"):
        return np.asarray(depth / (wider + lean * depth))
