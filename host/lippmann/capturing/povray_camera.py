"""POV-Ray's cameras: a pinhole, and a camera with one given ray for each pixel.

Their rays go through the pixels' centres, as Lippmann's do with one sample. `right` has its own sign, so that x points
right although POV-Ray's frame is left-handed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lippmann.capturing.povray_text import block, rows, vector
from lippmann.optics.rays import Floats
from lippmann.scenes.placement import Triple

#: Size of the triangles that define rays, mm: POV-Ray stores their corners in float32, which 100 mm from the origin
#: rotates the normal of a triangle of 10 mm by a microradian.
FACE_MM = 10.0
#: POV-Ray 3.7 renders each row of such a camera one row too low, and the first row twice.
SPARE_ROWS = 1


def pinhole(position_mm: Triple, to_window: Triple, width_mm: float, height_mm: float) -> str:
    """Return a pinhole camera that looks through an upright window; `to_window` leads to the window's centre, mm."""
    return block(
        "camera",
        f"perspective location {vector(position_mm)}",
        f"right {vector((width_mm, 0, 0))} up {vector((0, height_mm, 0))} direction {vector(to_window)}",
    )


def write_rays(path: Path, origin_mm: Floats, direction: Floats) -> None:
    """Write a camera with one ray for each pixel: the ray of pixel k starts at the centre of face k, along its normal.

    The origins and the unit directions are (N, 3), row by row from the image's top left.
    """
    # Two unit vectors perpendicular to each ray; the first from the axis that is most perpendicular to it.
    helper = np.eye(3)[np.abs(direction).argmin(axis=1)]
    across = np.cross(direction, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(direction, across)
    # An equilateral triangle about the origin.
    corners = [
        origin_mm + FACE_MM * (np.cos(turn) * across + np.sin(turn) * other)
        for turn in 2.0 * np.pi / 3.0 * np.arange(3)
    ]
    points = np.stack(corners, axis=1).reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)[:, ::-1]
    mesh = f"#declare L_rays = mesh2 {{\nvertex_vectors {{ {rows(points)} }}\nface_indices {{ {rows(faces)} }}\n}}"
    path.write_text(f"{mesh}\ncamera {{ mesh_camera {{ 1 0 mesh {{ L_rays }} }} }}\n")
