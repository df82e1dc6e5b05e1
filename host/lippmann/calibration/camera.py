"""The photographer's camera: a pinhole with radial distortion, the same for all positions.

A point X, mm in the panel's frame, is at x = R (X - C) from the camera, x to the right, y down, z forward. With
(a, b) = (x, y) / z and r^2 = a^2 + b^2 its pixel is (cx, cy) + f (1 + k1 r^2 + k2 r^4) (a, b).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
#: Focal length that is assumed first, in longer sides of the photograph: that of a telephone's main camera.
USUAL_FOCAL = 1.0
#: Focal lengths outside this range, in longer sides, are not believed.
FOCALS = (0.4, 8.0)


@dataclass(frozen=True)
class Lens:
    """What all positions share: focal length and principal point, pixels, and the radial distortion."""

    focal_px: float
    middle_px: tuple[float, float]
    distortion: tuple[float, float] = (0.0, 0.0)


def rotation_of(vector: Floats) -> Floats:
    """Return the matrix (3, 3) of a rotation vector, radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, float))[0])


def projected(points_mm: Floats, lens: Floats, turn: Floats, place_mm: Floats) -> Floats:
    """Return the pixels (N, 2) of points (N, 3); `lens` is (f, cx, cy, k1, k2), `turn` a rotation vector."""
    x, y, z = rotation_of(turn) @ (points_mm - place_mm).T
    z = np.maximum(z, 1e-6)
    a, b = x / z, y / z
    square = a * a + b * b
    scale = lens[0] * (1.0 + square * (lens[3] + square * lens[4]))
    return np.stack([lens[1] + scale * a, lens[2] + scale * b], axis=1)


def first_lens(planes_mm: list[Floats], photos_px: list[Floats], shape: tuple[int, int]) -> Lens:
    """Return a first guess of the lens from points of a plane (N, 3) and their pixels (N, 2) in each position."""
    size = shape[1], shape[0]
    middle = 0.5 * size[0], 0.5 * size[1]
    objects, images = ([one.astype(np.float32) for one in many] for many in (planes_mm, photos_px))
    matrix = cv2.initCameraMatrix2D(objects, images, size, 1.0)
    focal = float(matrix[0, 0])
    longer = max(size)
    if not (np.isfinite(focal) and FOCALS[0] * longer < focal < FOCALS[1] * longer):
        focal = USUAL_FOCAL * longer
    return Lens(focal, middle)


def first_pose(plane_mm: Floats, photo_px: Floats, lens: Lens) -> tuple[Floats, Floats]:
    """Return the rotation vector and the place, mm, of a camera that sees points of a plane at pixels."""
    matrix = np.array([[lens.focal_px, 0, lens.middle_px[0]], [0, lens.focal_px, lens.middle_px[1]], [0, 0, 1]])
    _, turn, shift = cv2.solvePnP(plane_mm, photo_px, matrix, np.zeros(5), flags=cv2.SOLVEPNP_IPPE)
    vector = np.array(turn, np.float64).ravel()
    return vector, -rotation_of(vector).T @ np.array(shift, np.float64).ravel()
