"""Give lenslets the same numbers in all camera positions; estimate initial parameters.

Each camera position numbers the lenslets from its own origin. A panel point is offset
from its lenslet's centre by roughly the gap times the slope to the camera. The search
tries gaps around the nominal: with the correct gap, all positions' lattices agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from lippmann.calibration.bundle_adjustment import Problem, rotation_of
from lippmann.calibration.lattice_search import SeenLattice
from lippmann.calibration.lenslet_measurement import Lenslets
from lippmann.calibration.lenslet_projection import fit_projection
from lippmann.display.description import Display, Grid
from lippmann.optics.lattice import HALF_SQRT3
from lippmann.optics.rays import Floats

#: Minimum and maximum focal length, in units of the photograph's longer side.
FOCALS = (0.4, 8.0)


def first_lens(planes_mm: list[Floats], photos_px: list[Floats], shape: tuple[int, int]) -> Floats:
    """Estimate the lens (f, cx, cy, k1, k2), px, from each view's points (N, 3), mm, and pixels (N, 2)."""
    size = shape[1], shape[0]
    objects, images = ([one.astype(np.float32) for one in many] for many in (planes_mm, photos_px))
    focal = float(cv2.initCameraMatrix2D(objects, images, size, 1.0)[0, 0])
    longer = max(size)
    if not (np.isfinite(focal) and FOCALS[0] * longer < focal < FOCALS[1] * longer):
        focal = float(longer)  # typical of a telephone's main camera
    return np.array([focal, 0.5 * size[0], 0.5 * size[1], 0.0, 0.0])


def first_pose(plane_mm: Floats, photo_px: Floats, lens: Floats) -> tuple[Floats, Floats]:
    """Estimate rotation vector and position, mm, of a camera that sees points (N, 3) at pixels (N, 2)."""
    matrix = np.array([[lens[0], 0, lens[1]], [0, lens[0], lens[2]], [0, 0, 1]])
    _, turn, shift = cv2.solvePnP(plane_mm, photo_px, matrix, np.zeros(5), flags=cv2.SOLVEPNP_IPPE)
    vector = np.array(turn, np.float64).ravel()
    return vector, -rotation_of(vector).T @ np.array(shift, np.float64).ravel()


#: Differences of tried gaps from the nominal gap, relative to the aperture distance.
GAPS = np.linspace(-0.35, 0.35, 57)


def array_of(grid: Grid, steps: Floats, offset: Floats) -> Floats:
    """Return pitches, shear, rotation (radians) and offset of a lattice with the basis `steps`."""
    turn = math.atan2(steps[1, 0], steps[0, 0])
    c, s = math.cos(turn), math.sin(turn)
    along, up = np.array([[c, s], [-s, c]]) @ steps[:, 1]
    px = float(np.hypot(*steps[:, 0]))
    hexagonal = grid == "hex"
    py = up / HALF_SQRT3 if hexagonal else up
    shear = (along - 0.5 * px * hexagonal) / up
    return np.array([px, py, shear, turn, *offset])


def starts(
    display: Display, views: Sequence[Lenslets], view_lattices: Sequence[SeenLattice]
) -> list[tuple[Problem, Floats]]:
    """Return up to three lenslet numberings with their initial parameters, the most likely first."""
    planes = [
        np.column_stack([one.points(view.index), np.zeros(len(view.index))])
        for one, view in zip(view_lattices, views, strict=True)
    ]
    lens = first_lens(planes, [view.photo_px for view in views], views[0].shape)
    poses = [first_pose(plane, view.photo_px, lens) for plane, view in zip(planes, views, strict=True)]
    places = [place for _, place in poses]
    slopes = [(place[:2] - plane[:, :2]) / place[2] for plane, place in zip(planes, places, strict=True)]
    steepest = 1.1 * max(float(np.hypot(*slope.T).max()) for slope in slopes)
    projection = fit_projection(display, min(steepest, 2.0), float(np.mean([place[2] for place in places])))
    gaps = np.maximum(0.0, display.gap_mm + GAPS * display.aperture_distance_mm)
    lattices = []
    for one, place in zip(view_lattices, places, strict=True):
        aside = place[:2] - one.origin
        moved = projection.traced(np.tile(aside / place[2], (len(gaps), 1)), gaps, ())[1]
        grown = projection.traced(np.tile([-1e-3, 0.0], (len(gaps), 1)), gaps, ())[1][:, :1] / 1e-3 / place[2] + 1.0
        zero = one.origin - moved
        # The pose was fitted to panel points; their lattice is `grown` times as large as the array's.
        true_place = np.hstack([zero + aside / grown, place[2] / grown])
        lattices.append((zero, one.basis / grown[..., None], true_place))
    zeros, bases, true_places = (np.stack(part, axis=1) for part in zip(*lattices, strict=True))
    basis = bases.mean(axis=1)
    inverse = np.linalg.inv(basis)
    off = (zeros - zeros[:, :1]) @ inverse.swapaxes(1, 2)
    shift = np.round(off).astype(np.int64)
    # Prefer gaps near the nominal gap.
    rank = np.sqrt(((off - shift) ** 2).sum(axis=2).mean(axis=1)) + 0.02 * abs(GAPS)
    order = np.argsort(rank)
    _, first_of_each = np.unique(shift[order].reshape(len(gaps), -1), axis=0, return_index=True)
    likely = []
    # Return at most three numberings, with errors within 0.2 pitches of the best.
    for g in order[np.sort(first_of_each)[:3]]:
        if rank[g] >= rank.min() + 0.2:
            break
        first = np.round(inverse[g] @ (display.array.offset_mm - zeros[g, 0])).astype(np.int64)
        renumbered = [replace(view, index=view.index + shift[g, k] - first) for k, view in enumerate(views)]
        problem = Problem(display, [projection] * len(views), renumbered)
        offset = np.mean(zeros[g] - shift[g] @ basis[g].T, axis=0) + basis[g] @ first
        array = array_of(display.array.grid, basis[g], offset)
        camera_poses = [[turn, place] for (turn, _), place in zip(poses, true_places[g], strict=True)]
        likely.append((problem, problem.packed(array=array, gap=gaps[g], lens=lens, pose=camera_poses)))
    return likely
