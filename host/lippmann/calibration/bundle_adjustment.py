"""The least squares over all positions: the array, its gap, the camera's lens and its poses.

The camera is a pinhole with radial distortion, the same for all positions. A point X, mm in the panel's frame, is at
x = R (X - C) from the camera, x to the right, y down, z forward. With (a, b) = (x, y) / z and r^2 = a^2 + b^2 its pixel
is (cx, cy) + f (1 + k1 r^2 + k2 r^4) (a, b).

Each lenslet that a position sees gives two points: that of the panel seen at a place of the photograph, and that of the
lenslet's middle in the photograph. The middle is found from the seams, where neighbours' light mixes: it tells where
the camera is, but not which point is seen. The point is expected at the place where it was read, by how points move
over the cell. Both are fitted at once, weighted by their own scatter. Weak priors keep what the data leave open where
it usually is; a parameter whose uncertainty is that of its prior was not determined.

A share of the scatter is taken as smooth over a whole position (`SmoothErrors`), in the weights and in the covariance.
That is one of blocks of neighbouring lenslets ("sandwich"): errors of neighbours are alike, as the panel's pixels are
coarse, so that single lenslets would promise too much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from lippmann.base import interrupts
from lippmann.calibration.lens_projection import FOLDS, LensProjection, powers
from lippmann.calibration.lenslet_measurement import Lenslets, regular
from lippmann.display.description import Display, Grid
from lippmann.optics.rays import Floats

#: The array's parameters, and the step of each for differences: mm, radians, shares.
ARRAY = {"pitch_x": 1e-5, "pitch_y": 1e-5, "shear": 1e-6, "rotation": 1e-6, "offset_x": 1e-4, "offset_y": 1e-4}
GAP = {"gap": 1e-4}
#: Height of the array over its mean, mm: tilts and curvatures, in half widths and half heights of the panel.
BOW = {"tilt_x": 1e-4, "tilt_y": 1e-4, "bow_xx": 1e-4, "bow_yy": 1e-4, "bow_xy": 1e-4}
#: What the lenslets' middles in a photograph lack, in pitches at the steepest slope: blur moves the seams of lenslets
#: that are seen aside. The degrees of its powers, and the step of each number. No panel point depends on it.
SEAMS, SEAMS_STEP = range(3, 10), 1e-4
LENS = {"focal": 1e-2, "middle_x": 1e-2, "middle_y": 1e-2, "k1": 1e-5, "k2": 1e-5}
POSE = {"turn_x": 1e-6, "turn_y": 1e-6, "turn_z": 1e-6, "place_x": 1e-2, "place_y": 1e-2, "place_z": 1e-2}
#: Step of the zoom of each view but the first: how much larger its focal length is, a share.
ZOOM = 1e-5
#: Beginnings of the names of parameters that change where a photograph shows a point, and not which rays it sees.
STILL = "seams_", "turn_", "zoom_", *LENS
#: Priors: standard deviations of the pitches (shares of the file's), of the gap and of the bow (shares of D), ...
PRIOR_PITCH, PRIOR_GAP, PRIOR_BOW = 0.01, 0.3, 0.1
#: ... of the focal length (of its logarithm), principal point (share of the photograph's longer side), and distortion.
PRIOR_FOCAL, PRIOR_MIDDLE, PRIOR_DISTORTION = 0.7, 0.02, 0.3
#: Prior of a zoom: its standard deviation.
PRIOR_ZOOM = 0.1
#: Prior of the numbers of the seams: their standard deviation, pitches.
PRIOR_SEAMS = 0.03
#: That of a gap that is held.
HELD_GAP = 1e-5
#: Most lenslets of a position in the least squares.
MOST_LENSLETS = 8000
#: Residuals beyond this many standard deviations are outliers.
OUTLIER = 4.5
#: Residual, in standard deviations, from which on the robust loss (scipy's soft_l1) is about linear.
ROBUST = 1.5
#: Most steps of the least squares, and the share by which the last one lowers the cost.
MOST_STEPS, SETTLED = 60, 1e-8
#: Blocks of lenslets along each side of the array, for the covariance.
BLOCKS = 9
#: Share of the scatter that is taken as smooth, in each of six polynomials over a position: panel, photograph.
SMOOTH = (0.12, 0.12, 0.2, 0.2)
#: What a residual counts within the interval in which a panel point is known to be.
WITHIN = 0.03
#: Least smooth errors, as measured on computed photographs: of panel points, in pixels, and of the lenslets' middles in
#: a photograph, in lenslets.
POINTS, MIDDLES = 0.001, 0.0003
#: Least scatter of a point, pixels, so that perfect data are not trusted blindly.
LEAST_SCATTER = 0.001
SEED = 1911


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


@dataclass(frozen=True)
class SmoothErrors:
    """Errors that are smooth over a position: what distortion, aberrations and seams leave, and no average removes.

    Of each of a position's four columns of residuals (panel points, photograph), with the scatter 1, the errors are
    taken as

        e = n + t B m,   n and m normal with deviation 1,

    where B are six polynomials of the place on the array up to the second degree, from -1 to 1 across it, and t is a
    share. Their covariance is I + t^2 B B^T. With B = U S V^T,

        W = I - U (1 - 1 / sqrt(1 + t^2 S^2)) U^T

    makes the covariance of W e the unit matrix: least squares of W e trusts no position's middle, scale or bend more
    than it deserves, however many lenslets it has (generalised least squares).

    The fields are those of N lenslets: B (N, 6), t (4,), U (N, 6), and of each column 1 - 1/sqrt(...), (4, 6).
    """

    modes: Floats
    shares: Floats
    basis: Floats
    lost: Floats

    @classmethod
    def of(cls, places: Floats, shares: Floats) -> SmoothErrors:
        """Return those of lenslets at places (N, 2) on the array, with a share for each column."""
        u, v = (2.0 * spread_out(places) - 1.0).T
        modes = np.stack([np.ones_like(u), u, v, u * u - 1.0 / 3.0, u * v, v * v - 1.0 / 3.0], axis=1)
        basis, values, _ = np.linalg.svd(modes, full_matrices=False)
        return cls(modes, shares, basis, 1.0 - 1.0 / np.sqrt(1.0 + np.outer(shares, values) ** 2))

    def whitened(self, values: Floats) -> Floats:
        """Return W times values (N, 4) or (N, 4, M)."""
        flat = values.reshape(len(values), 4, -1)
        part = np.einsum("nk,ncm->kcm", self.basis, flat) * self.lost.T[..., None]
        return np.asarray((flat - np.einsum("nk,kcm->ncm", self.basis, part)).reshape(values.shape))

    def whitened_rows(self, rows: Floats) -> Floats:
        """Return W times the rows (4 N, M) of a matrix of derivatives, four for each lenslet."""
        return self.whitened(rows.reshape(-1, 4, rows.shape[1])).reshape(rows.shape)


def spread_out(places: Floats) -> Floats:
    """Return places (N, 2) from 0 to 1 across all of them."""
    low, size = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    return np.asarray((places - low) / size)


def seam_powers(grid: Grid) -> tuple[tuple[int, int], ...]:
    """Return the powers (j, k) of slopes by which seams move the lenslets' middles in a photograph."""
    return powers(FOLDS[grid], SEAMS)


class Rays(NamedTuple):
    """Of N lenslets that a position sees: the middles of outlines (N, 3) and the panel points (N, 2), mm.

    `seam_terms` (N, 2, M) is what each number of the seams moves a middle by, in pitches.
    """

    middles: Floats
    points: Floats
    seam_terms: Floats


@dataclass(frozen=True)
class Problem:
    """What is fitted: a nominal display, and of each position the lenslets' projection and the lenslets."""

    display: Display
    projections: Sequence[LensProjection]
    views: Sequence[Lenslets]
    shape: tuple[int, int]
    bow: bool = False
    #: The gap stays that of the file: the photographs do not determine it.
    held: bool = False
    #: Each position has a focal length of its own.
    zoom: bool = False

    @cached_property
    def names(self) -> list[str]:
        """Names of the parameters, in order."""
        return list(self.steps)

    @property
    def zooms(self) -> list[str]:
        """Names of the zooms, which come last."""
        return [f"zoom_{k}" for k in range(1, len(self.views))] if self.zoom else []

    @cached_property
    def array_steps(self) -> dict[str, float]:
        """Names and steps of the parameters before the lens's."""
        seams = {f"seams_{j}{k}": SEAMS_STEP for j, k in seam_powers(self.display.array.grid)}
        return {**ARRAY, **GAP, **(BOW if self.bow else {}), **seams}

    @cached_property
    def steps(self) -> dict[str, float]:
        """The step of each parameter for differences, in order."""
        poses = {f"{name}_{k}": step for k in range(len(self.views)) for name, step in POSE.items()}
        return {**self.array_steps, **LENS, **poses, **dict.fromkeys(self.zooms, ZOOM)}

    @cached_property
    def shared(self) -> int:
        """Number of parameters before those of the poses."""
        return len(self.array_steps) + len(LENS)

    @cached_property
    def places(self) -> list[Floats]:
        """Of each view, the lenslets on the lattice of pitch 1."""
        return [regular(self.display.array.grid, one.index) for one in self.views]

    def centres(self, x: Floats, places: Floats) -> Floats:
        """Return lenslets' centres (N, 2), mm in the panel's frame."""
        px, py, shear, turn, ox, oy = x[:6]
        down = py * places[:, 1]
        along = px * places[:, 0] + shear * down
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * along - s * down + ox, s * along + c * down + oy], axis=1)

    def heights(self, x: Floats, centres: Floats) -> Floats | float:
        """Return the heights of lenslets over the array's mean, mm."""
        if not self.bow:
            return 0.0
        panel = self.display.panel
        u, v = 2.0 * centres[:, 0] / panel.width_mm, 2.0 * centres[:, 1] / panel.height_mm
        return np.asarray(x[7:12] @ np.stack([u, v, u * u - 1.0 / 3.0, v * v - 1.0 / 3.0, u * v]))

    def seams(self, x: Floats) -> Floats:
        """Return the numbers of `seam_powers`."""
        end = self.shared - len(LENS)
        return x[end - len(seam_powers(self.display.array.grid)) : end]

    def pose(self, x: Floats, k: int) -> tuple[Floats, Floats, Floats]:
        """Return the lens, and the turn and the place of view k."""
        lens, pose = x[self.shared - len(LENS) : self.shared], x[self.shared + 6 * k : self.shared + 6 * (k + 1)]
        if self.zoom and k > 0:
            lens = lens * [1.0 + x[self.names.index(f"zoom_{k}")], 1.0, 1.0, 1.0, 1.0]
        return lens, pose[:3], pose[3:]

    def rays(self, x: Floats, k: int) -> Rays:
        """Trace the rays of view k, which need neither the lens nor the camera's turn."""
        place = self.pose(x, k)[2]
        projection, centres = self.projections[k], self.centres(x, self.places[k])
        high = self.heights(x, centres)
        z = projection.outline_mm + high
        slope = (place[:2] - centres) / np.reshape(place[2] - z, (-1, 1))
        outline, point, seam_terms = projection.traced(slope, x[6] + high, seam_powers(self.display.array.grid))
        middles = np.column_stack([centres + outline, np.broadcast_to(z, len(centres))])
        return Rays(middles, centres + point, seam_terms)

    def aside(self, x: Floats, k: int, middles: Floats) -> Floats:
        """Return how far the places that were read are from the outlines' middles (N, 3), in cells of pitch 1."""
        return np.asarray((self.views[k].cell_px - projected(middles, *self.pose(x, k))) @ self.views[k].steps)

    def seen(self, x: Floats, k: int, rays: Rays | None = None) -> tuple[Floats, Floats]:
        """Return the panel points (N, 2) mm and the pixels (N, 2) of the lenslets of view k."""
        rays = rays or self.rays(x, k)
        moved = np.einsum("np,npa->na", self.aside(x, k, rays.middles), self.views[k].moves)
        middles = rays.middles.copy()
        middles[:, :2] += x[0] * (rays.seam_terms @ self.seams(x))
        return rays.points + moved, projected(middles, *self.pose(x, k))

    def residuals(self, x: Floats, k: int) -> Floats:
        """Return the residuals of view k, (N, 4): panel points in pixels of the panel, pixels of the photograph."""
        off = self.offsets(x, k)
        off[:, :2] -= (1.0 - WITHIN) * np.clip(off[:, :2], -self.views[k].half_px, self.views[k].half_px)
        return off

    def offsets(self, x: Floats, k: int, rays: Rays | None = None) -> Floats:
        """Return the residuals of view k as if the middle of each interval had been measured, (N, 4)."""
        panel, photo = self.seen(x, k, rays)
        view = self.views[k]
        return np.column_stack([(panel - view.panel_mm) / self.display.panel.pitches_mm, photo - view.photo_px])

    def gains(self, x: Floats, k: int) -> Floats:
        """Return the derivatives of the residuals of view k by its offsets, (N, 4)."""
        within = abs(self.offsets(x, k)[:, :2]) < self.views[k].half_px
        return np.column_stack([np.where(within, WITHIN, 1.0), np.ones_like(within, float)])

    def priors(self, x: Floats) -> Floats:
        """Return the residuals to the priors, in standard deviations."""
        display, longer = self.display, float(max(self.shape))
        depth = display.aperture_distance_mm
        focal, mx, my, k1, k2 = x[self.shared - len(LENS) : self.shared]
        bow = list(x[7:12] / (PRIOR_BOW * depth)) if self.bow else []
        return np.array([
            *(x[:2] / display.array.pitches_mm - 1.0) / PRIOR_PITCH,
            (x[6] - display.gap_mm) / ((HELD_GAP if self.held else PRIOR_GAP) * depth), *bow,
            np.log(max(focal, 1.0) / longer) / PRIOR_FOCAL,
            (mx - 0.5 * self.shape[1]) / (PRIOR_MIDDLE * longer), (my - 0.5 * self.shape[0]) / (PRIOR_MIDDLE * longer),
            k1 / PRIOR_DISTORTION, k2 / PRIOR_DISTORTION,
            *(self.seams(x) / PRIOR_SEAMS), *(x[len(x) - len(self.zooms) :] / PRIOR_ZOOM),
        ])  # fmt: skip

    def thinned(self, most: int) -> Problem:
        """Return the problem with at most so many lenslets of each view, chosen at random."""
        rng = np.random.default_rng(SEED)
        fields, views = ("index", "photo_px", "panel_mm", "half_px", "cell_px", "moves"), []
        for view in self.views:
            at = np.sort(rng.permutation(len(view.index))[:most])
            views.append(replace(view, readings=None, **{name: getattr(view, name)[at] for name in fields}))
        return replace(self, views=views)


class Weights(NamedTuple):
    """Of each view: the scatter of panel points and of pixels, and which lenslets count, (N,)."""

    scatter: list[tuple[float, float]]
    kept: list[npt.NDArray[np.bool_]]

    @classmethod
    def equal(cls, problem: Problem, scatter: tuple[float, float]) -> Weights:
        """Return weights for which all lenslets count, with one scatter."""
        return cls([scatter] * len(problem.views), [np.ones(len(one.index), bool) for one in problem.views])

    def measured(self, problem: Problem, x: Floats) -> Weights:
        """Return the weights with the scatter that the residuals have."""
        return self._replace(scatter=[_scatter(problem.residuals(x, k)) for k in range(len(problem.views))])


@dataclass(frozen=True)
class Solution:
    """Parameters, their covariance, and the weights of the lenslets."""

    problem: Problem
    x: Floats
    covariance: Floats
    weights: Weights
    #: Root mean squares of the residuals that were kept, pixels.
    rms_panel_px: float
    rms_photo_px: float

    def value(self, name: str) -> float:
        """Return a parameter."""
        return float(self.x[self.problem.names.index(name)])

    def deviation(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        at = self.problem.names.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    def correlation(self, one: str, other: str) -> float:
        """Return the correlation of two parameters."""
        i, j = self.problem.names.index(one), self.problem.names.index(other)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i] * self.covariance[j, j]))


def solve(problem: Problem, x: Floats, robust_only: bool = False) -> Solution:
    """Fit the parameters, from first values on, to at most `MOST_LENSLETS` of each position."""
    problem = problem.thinned(MOST_LENSLETS)
    weights = Weights.equal(problem, (1.0, 1.0))
    for _ in range(2):
        x = _minimised(problem, x, weights, True)
        weights = weights.measured(problem, x)
    limits = [OUTLIER * np.repeat(scatter, 2) for scatter in weights.scatter]
    kept = [np.all(abs(problem.residuals(x, k)) < limit, axis=1) for k, limit in enumerate(limits)]
    weights = weights._replace(kept=kept)
    if not robust_only:
        x = _minimised(problem, x, weights, False)
        weights = weights.measured(problem, x)
        x = _minimised(problem, x, weights, False)
    return _judged(problem, x, weights)


def released(solution: Solution) -> Solution:
    """Return a solution with the covariance that its gap has when it is not held."""
    problem = replace(solution.problem, held=False)
    return _judged(problem, solution.x, solution.weights)


def first_fit(problem: Problem, x: Floats) -> Floats:
    """Fit lens and poses alone to the photographs, the array held at its first values."""
    first = problem.shared - len(LENS)
    return _minimised(problem, x, Weights.equal(problem, (1e3, 1.0)), True, np.arange(len(x)) >= first)


def _scatter(residuals: Floats) -> tuple[float, float]:
    """Return the standard deviations of panel points and of pixels, by the median."""
    panel, photo = (1.4826 * float(np.median(abs(part))) for part in (residuals[:, :2], residuals[:, 2:]))
    return max(panel, LEAST_SCATTER), max(photo, LEAST_SCATTER)


def _weighted(problem: Problem, x: Floats, weights: Weights, k: int) -> Floats:
    return np.asarray((problem.residuals(x, k)[weights.kept[k]] / np.repeat(weights.scatter[k], 2)).ravel())


def _minimised(
    problem: Problem, x: Floats, weights: Weights, robust: bool, free: npt.NDArray[np.bool_] | None = None
) -> Floats:
    """Return the parameters of least squares; `robust` weighs a large residual by its size, not by its square.

    Otherwise smooth errors are in the weights. Robust weights are those of single lenslets.
    """
    chosen = np.arange(len(x)) if free is None else np.flatnonzero(free)
    smooth = [] if robust else [_smooth(problem, weights, k) for k in range(len(problem.views))]

    def whole(part: Floats) -> Floats:
        at = x.copy()
        at[chosen] = part
        return at

    def residuals(part: Floats) -> Floats:
        interrupts.check()
        at = whole(part)
        parts = [_weighted(problem, at, weights, k) for k in range(len(problem.views))]
        if smooth:
            parts = [one.whitened(part.reshape(-1, 4)).ravel() for one, part in zip(smooth, parts, strict=True)]
        return np.concatenate([*parts, problem.priors(at)])

    def slopes(part: Floats) -> Floats:
        matrix = jacobian(problem, whole(part), weights)[:, chosen]
        row = 0
        for one in smooth:
            rows = slice(row, row := row + 4 * len(one.modes))
            matrix[rows] = one.whitened_rows(matrix[rows])
        return matrix

    fit = least_squares(
        residuals, x[chosen], slopes, x_scale="jac",
        loss="soft_l1" if robust else "linear", f_scale=ROBUST, ftol=SETTLED, xtol=1e-12, gtol=1e-12,
        max_nfev=MOST_STEPS,
    )  # fmt: skip
    return whole(fit.x)


def _smooth(problem: Problem, weights: Weights, k: int) -> SmoothErrors:
    """Return the smooth errors of view k."""
    places, view, (panel, photo) = problem.places[k][weights.kept[k]], problem.views[k], weights.scatter[k]
    across = float(np.sqrt(np.prod(np.std(view.photo_px, axis=0)) / max(1e-9, float(np.prod(places.std(axis=0))))))
    least = np.repeat([POINTS / panel, MIDDLES * across / photo], 2)
    return SmoothErrors.of(places, np.maximum(SMOOTH, least))


def jacobian(problem: Problem, x: Floats, weights: Weights) -> Floats:
    """Return the derivatives by central differences; a pose and a zoom change their own view only.

    The differences are those of the offsets: across an end of an interval, they would be those of neither side.
    """
    scatter, kept = weights
    sizes = [4 * int(one.sum()) for one in kept]
    factors = [problem.gains(x, k)[kept[k]] / np.repeat(scatter[k], 2) for k in range(len(sizes))]
    first = np.concatenate([[0], np.cumsum(sizes)])
    matrix = np.zeros((first[-1] + len(problem.priors(x)), len(x)))
    base_rays = [problem.rays(x, k) for k in range(len(sizes))]
    for at, (name, step) in enumerate(problem.steps.items()):
        up, down = x.copy(), x.copy()
        up[at] += step
        down[at] -= step
        own = range(len(sizes)) if at < problem.shared else [int(name.rpartition("_")[2])]
        for k in own:
            rays = base_rays[k] if name.startswith(STILL) else None
            change = problem.offsets(up, k, rays)[kept[k]] - problem.offsets(down, k, rays)[kept[k]]
            matrix[first[k] : first[k + 1], at] = (factors[k] * change / (2.0 * step)).ravel()
        if at < problem.shared or problem.zoom:
            matrix[first[-1] :, at] = (problem.priors(up) - problem.priors(down)) / (2.0 * step)
    return matrix


def _judged(problem: Problem, x: Floats, weights: Weights) -> Solution:
    """Return the solution with its covariance by blocks of lenslets."""
    matrix = jacobian(problem, x, weights)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    matrix /= scale
    priors = matrix[matrix.shape[0] - len(problem.priors(x)) :]
    meat, row, groups = priors.T @ priors, 0, 0
    squares, count = np.zeros(2), 0
    for k in range(len(problem.views)):
        residual = _weighted(problem, x, weights, k).reshape(-1, 4)
        rows = slice(row, row := row + residual.size)
        plain = residual * np.repeat(weights.scatter[k], 2)
        squares += (plain[:, :2] ** 2).sum(), (plain[:, 2:] ** 2).sum()
        count += len(plain)
        smooth = _smooth(problem, weights, k)
        matrix[rows] = smooth.whitened_rows(matrix[rows])
        part = matrix[rows].reshape(-1, 4, len(x))
        scores = (part * smooth.whitened(residual)[..., None]).sum(axis=1)
        places = spread_out(problem.places[k][weights.kept[k]])
        block = np.minimum((BLOCKS * places).astype(int), BLOCKS - 1) @ [BLOCKS, 1]
        for one in np.unique(block):
            score = scores[block == one].sum(axis=0)
            meat += np.outer(score, score)
            groups += 1
        for mode in smooth.modes.T:
            errors = smooth.whitened(np.outer(mode, smooth.shares))
            moved = np.einsum("nr,nrp->rp", errors, part)
            meat += moved.T @ moved
    inverse = np.linalg.pinv(matrix.T @ matrix, hermitian=True)
    correction = groups / max(1.0, groups - float(len(x)))
    sandwich = correction * inverse @ meat @ inverse
    # Never less than the scatter of single lenslets promises.
    promised = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    estimated = np.sqrt(np.maximum(np.diag(sandwich), 0.0))
    raised = np.maximum(promised, estimated) / np.maximum(estimated, 1e-300)
    covariance = sandwich * np.outer(raised, raised) / np.outer(scale, scale)
    rms_panel_px, rms_photo_px = np.sqrt(squares / max(1, count)).tolist()
    return Solution(problem, x, covariance, weights, rms_panel_px, rms_photo_px)
