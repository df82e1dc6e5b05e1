"""POV-Ray's cameras: a pinhole, and a camera with one given ray for each pixel.

Their rays go through the pixels' centres, as Lippmann's do with one sample. `right` has its own sign, so that x points
right although POV-Ray's frame is left-handed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.povray.text import block, rows, vector

Floats = npt.NDArray[np.float64]

#: Size of the triangles that define rays, mm: POV-Ray stores their corners in float32, which 100 mm from the origin
#: rotates the normal of a triangle of 10 mm by a microradian.
FACE_MM = 10.0
#: POV-Ray 3.7 renders each row of such a camera one row too low, and the first row twice.
SPARE_ROWS = 1


def pinhole(
    position_mm: tuple[float, float, float],
    to_window: tuple[float, float, float],
    right_mm: tuple[float, float, float],
    up_mm: tuple[float, float, float],
) -> str:
    """Return a pinhole camera that looks through a window.

    Parameters
    ----------
    position_mm
        The pinhole.
    to_window
        From the pinhole to the window's centre, mm.
    right_mm, up_mm
        The window's width and height, along its sides.
    """
    return block(
        "camera",
        f"perspective location {vector(position_mm)}",
        f"right {vector(right_mm)} up {vector(up_mm)} direction {vector(to_window)}",
    )


def write_rays(path: Path, origin_mm: Floats, direction: Floats) -> None:
    """Write a camera with one ray for each pixel: the ray of pixel k starts at the centre of face k, along its normal.

    Parameters
    ----------
    path
        The file.
    origin_mm
        (N, 3), row by row from the image's top left.
    direction
        (N, 3), unit.
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
