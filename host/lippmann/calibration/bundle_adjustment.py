"""Bundle adjustment: fit array, gap, camera lens and camera poses to all photographs.

All camera positions share one lens: a pinhole with radial distortion. For a camera at C
with rotation R, the point X (mm, panel's frame) is at (x, y, z) = R (X - C), with z
forward. With (a, b) = (x, y) / z and r^2 = a^2 + b^2, the pixel of X is

    (cx, cy) + f (1 + k1 r^2 + k2 r^4) (a, b).

Each lenslet that a camera sees gives two points: the panel point that it shows, and its
middle in the photograph. The fit divides point errors by their scatter. A part of the
errors is smooth over the array (`SmoothErrors`). Weak priors constrain parameters that
the photographs do not determine, and set their uncertainty. The covariance is a
sandwich estimate over blocks of lenslets, because errors of neighbours are correlated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from lippmann.base import interrupts
from lippmann.calibration.lenslet_measurement import Lenslets, regular
from lippmann.calibration.lenslet_projection import FOLDS, LensProjection, powers
from lippmann.display.description import Display, Pair
from lippmann.optics.rays import Bools, Floats

#: Array parameters and their finite-difference steps: mm, radians, shear as a ratio.
ARRAY = {"pitch_x": 1e-5, "pitch_y": 1e-5, "shear": 1e-6, "rotation": 1e-6, "offset_x": 1e-4, "offset_y": 1e-4}
GAP = {"gap": 1e-4}
#: Coefficients (mm) of the array's height above its mean, and their steps. The height
#: is a polynomial of coordinates in units of the panel's half width and half height.
BOW = {"tilt_x": 1e-4, "tilt_y": 1e-4, "bow_xx": 1e-4, "bow_yy": 1e-4, "bow_xy": 1e-4}
#: Degrees of the polynomial in the ray slope; it models how blur moves lenslet seams.
SEAMS = range(3, 10)
LENS = {"focal": 1e-2, "middle_x": 1e-2, "middle_y": 1e-2, "k1": 1e-5, "k2": 1e-5}
POSE = {"turn_x": 1e-6, "turn_y": 1e-6, "turn_z": 1e-6, "place_x": 1e-2, "place_y": 1e-2, "place_z": 1e-2}
#: Name prefixes of parameters that move photograph points but change no traced rays.
STILL = "seams_", "turn_", "zoom_", *LENS
#: Name prefixes of parameters that affect a single view.
OWN_VIEW = "turn_", "place_", "zoom_"
#: Minimum residual of an outlier, in standard deviations.
OUTLIER = 4.5
#: Lenslet blocks per side of the array, to estimate the covariance.
BLOCKS = 9
#: Factor for the part of a residual inside its panel point's measurement interval.
WITHIN = 0.03
#: Minimum scatter of a point, pixels. The minimum limits the weights of exact data.
LEAST_SCATTER = 0.001
SEED = 1911


def rotation_of(vector: Floats) -> Floats:
    """Return the rotation matrix (3, 3) of a rotation vector, radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, float))[0])


def projected(points_mm: Floats, lens: Floats, turn: Floats, place_mm: Floats) -> Floats:
    """Project points (N, 3) to pixels (N, 2); the lens is (f, cx, cy, k1, k2)."""
    x, y, z = rotation_of(turn) @ (points_mm - place_mm).T
    z = np.maximum(z, 1e-6)
    a, b = x / z, y / z
    square = a * a + b * b
    scale = lens[0] * (1.0 + square * (lens[3] + square * lens[4]))
    return np.stack([lens[1] + scale * a, lens[2] + scale * b], axis=1)


@dataclass(frozen=True)
class SmoothErrors:
    """Model of errors that vary smoothly over the array: distortion, aberrations and seam shifts.

    Residuals have four columns: two of panel points, two of photograph points. The
    model of each column e, scaled to scatter 1, is

        e = n + t B m, n and m normal with deviation 1,

    where B contains the six polynomials up to degree 2 of the position on the array,
    and t is the ratio of smooth to independent scatter. The covariance of e is I + t^2
    B B^T. With the SVD B = U S V^T, the matrix

        W = I - U (1 - 1 / sqrt(1 + t^2 S^2)) U^T

    makes the covariance of W e the unit matrix.

    For N lenslets, `modes` is B (N, 6), `shares` is t (4,), `basis` is U (N, 6), and
    `lost` is 1 - 1/sqrt(1 + t^2 S^2) (4, 6).
    """

    modes: Floats
    shares: Floats
    basis: Floats
    lost: Floats

    @classmethod
    def of(cls, places: Floats, shares: Floats) -> SmoothErrors:
        """Return the model for lenslets at lattice points (N, 2); `shares` is the ratio t (4,)."""
        u, v = (2.0 * spread_out(places) - 1.0).T
        modes = np.stack([np.ones_like(u), u, v, u * u - 1.0 / 3.0, u * v, v * v - 1.0 / 3.0], axis=1)
        basis, values, _ = np.linalg.svd(modes, full_matrices=False)
        return cls(modes, shares, basis, 1.0 - 1.0 / np.sqrt(1.0 + np.outer(shares, values) ** 2))

    def whitened(self, values: Floats) -> Floats:
        """Multiply values of shape (N, 4), (N, 4, M) or (4 N, M) by the matrix W."""
        flat = values.reshape(len(self.basis), 4, -1)
        part = np.einsum("nk,ncm->kcm", self.basis, flat) * self.lost.T[..., None]
        return np.asarray((flat - np.einsum("nk,kcm->ncm", self.basis, part)).reshape(values.shape))


def spread_out(places: Floats) -> Floats:
    """Return points (N, 2) scaled to the range from 0 to 1."""
    low, size = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    return np.asarray((places - low) / size)


class Rays(NamedTuple):
    """Outline middles (N, 3) and panel points (N, 2) of rays, mm, and seam polynomial terms (N, 2, M)."""

    middles: Floats
    points: Floats
    seam_terms: Floats


@dataclass(frozen=True)
class Problem:
    """Data of a fit. The vector x contains the parameters of all `blocks`, in order."""

    display: Display
    projections: Sequence[LensProjection]
    views: Sequence[Lenslets]
    #: Names of parameter blocks that are not fitted.
    fixed: frozenset[str] = frozenset({"bow", "zoom"})

    def freeing(self, block: str) -> Problem:
        """Return a copy of the problem that also fits this parameter block."""
        return replace(self, fixed=self.fixed - {block})

    @cached_property
    def seam_powers(self) -> tuple[tuple[int, int], ...]:
        """Exponents (j, k) of the seam polynomial's terms."""
        return powers(FOLDS[self.display.array.grid], SEAMS)

    @cached_property
    def blocks(self) -> dict[str, dict[str, float]]:
        """Names and finite-difference steps of each block's parameters."""
        views = range(len(self.views))
        seams = {f"seams_{j}{k}": 1e-4 for j, k in self.seam_powers}  # pitches
        poses = {f"{name}_{k}": step for k in views for name, step in POSE.items()}
        zooms = {f"zoom_{k}": 1e-5 for k in views[1:]}  # relative change of the focal length
        return {"array": ARRAY, "gap": GAP, "bow": BOW, "seams": seams, "lens": LENS, "pose": poses, "zoom": zooms}

    @cached_property
    def steps(self) -> dict[str, float]:
        """Finite-difference steps of all parameters x."""
        return {name: step for block in self.blocks.values() for name, step in block.items()}

    @cached_property
    def free(self) -> list[int]:
        """Indices of the fitted parameters in x."""
        fitted = {name for block, names in self.blocks.items() if block not in self.fixed for name in names}
        return [at for at, name in enumerate(self.steps) if name in fitted]

    @cached_property
    def spans(self) -> dict[str, slice]:
        """Indices in x of each block's parameters."""
        ends = accumulate(map(len, self.blocks.values()))
        return {name: slice(end - len(self.blocks[name]), end) for name, end in zip(self.blocks, ends, strict=True)}

    def part(self, x: Floats, block: str) -> Floats:
        """Return the parameters of one block, as a numpy view of x."""
        return x[self.spans[block]]

    def packed(self, **parts: npt.ArrayLike) -> Floats:
        """Build the vector x from these blocks; other parameters are 0."""
        zeros = {block: np.zeros(len(names)) for block, names in self.blocks.items()}
        return np.concatenate([np.ravel(part) for part in (zeros | parts).values()])

    @cached_property
    def places(self) -> list[Floats]:
        """Lattice points (N, 2) of each view's lenslets, in units of the pitch."""
        return [regular(self.display.array.grid, one.index) for one in self.views]

    def centres(self, x: Floats, places: Floats) -> Floats:
        """Return the centres (N, 2), mm, of lenslets at lattice points (N, 2)."""
        px, py, shear, turn, ox, oy = self.part(x, "array")
        down = py * places[:, 1]
        along = px * places[:, 0] + shear * down
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * along - s * down + ox, s * along + c * down + oy], axis=1)

    def pose(self, x: Floats, k: int) -> tuple[Floats, Floats, Floats]:
        """Return the lens, the rotation vector and the camera position, mm, of view k."""
        turn, place = self.part(x, "pose").reshape(-1, 2, 3)[k]
        zoom = self.part(x, "zoom")[k - 1] if k > 0 else 0.0
        return self.part(x, "lens") * [1.0 + zoom, 1.0, 1.0, 1.0, 1.0], turn, place

    def rays(self, x: Floats, k: int) -> Rays:
        """Trace rays from the camera of view k through the lenslets to the panel."""
        place = self.pose(x, k)[2]
        projection, centres = self.projections[k], self.centres(x, self.places[k])
        u, v = 2.0 * centres.T / [[self.display.panel.width_mm], [self.display.panel.height_mm]]
        high = np.asarray(self.part(x, "bow") @ [u, v, u * u - 1.0 / 3.0, v * v - 1.0 / 3.0, u * v])
        z = projection.outline_mm + high
        slope = (place[:2] - centres) / (place[2] - z)[:, None]
        outline, point, seam_terms = projection.traced(slope, self.part(x, "gap") + high, self.seam_powers)
        return Rays(np.column_stack([centres + outline, z]), centres + point, seam_terms)

    def aside(self, x: Floats, k: int, middles: Floats) -> Floats:
        """Return offsets (N, 2), pitches, of measured cells from traced `middles` (N, 3)."""
        return np.asarray((self.views[k].cell_px - projected(middles, *self.pose(x, k))) @ self.views[k].steps)

    def predict(self, x: Floats, k: int, rays: Rays | None = None) -> tuple[Floats, Floats]:
        """Return the predicted panel points (N, 2), mm, and photograph pixels (N, 2) of view k."""
        rays = rays or self.rays(x, k)
        moved = np.einsum("np,npa->na", self.aside(x, k, rays.middles), self.views[k].moves)
        middles = rays.middles.copy()
        middles[:, :2] += x[0] * (rays.seam_terms @ self.part(x, "seams"))
        return rays.points + moved, projected(middles, *self.pose(x, k))

    def residuals(self, x: Floats, k: int) -> Floats:
        """Return the residuals (N, 4) of view k: two in panel pixels, two in photograph pixels."""
        off = self.offsets(x, k)
        off[:, :2] -= (1.0 - WITHIN) * np.clip(off[:, :2], -self.views[k].half_px, self.views[k].half_px)
        return off

    def offsets(self, x: Floats, k: int, rays: Rays | None = None) -> Floats:
        """Return predicted minus measured points of view k, pixels (N, 4)."""
        panel, photo = self.predict(x, k, rays)
        view = self.views[k]
        return np.column_stack([(panel - view.panel_mm) / self.display.panel.pitches_mm, photo - view.photo_px])

    def priors(self, x: Floats) -> Floats:
        """Return the deviation of x from the priors, in standard deviations."""
        display, size = self.display, np.array(self.views[0].shape[::-1])
        depth, longer = display.aperture_distance_mm, float(size.max())
        focal, *middle = self.part(x, "lens")[:3]
        # Each divisor is a prior's standard deviation; `depth` is the aperture distance.
        parts: list[npt.ArrayLike] = [
            (x[:2] / display.array.pitches_mm - 1.0) / 0.01,
            (self.part(x, "gap") - display.gap_mm) / (0.3 * depth),
            self.part(x, "bow") / (0.1 * depth),
            [np.log(max(focal, 1.0) / longer) / 0.7],
            (middle - 0.5 * size) / (0.02 * longer),
            self.part(x, "lens")[3:] / 0.3,
            self.part(x, "seams") / 0.03,
            self.part(x, "zoom") / 0.1,
        ]
        return np.concatenate([np.asarray(part) for part in parts])

    def thinned(self, max_lenslets: int) -> Problem:
        """Return the problem with up to `max_lenslets` random lenslets per view."""
        rng = np.random.default_rng(SEED)
        fields, views = ("index", "photo_px", "panel_mm", "half_px", "cell_px", "moves"), []
        for view in self.views:
            at = np.sort(rng.permutation(len(view.index))[:max_lenslets])
            views.append(replace(view, readings=None, **{name: getattr(view, name)[at] for name in fields}))
        return replace(self, views=views)


class Weights(NamedTuple):
    """For each view, the scatter of panel and photograph points, and a mask (N,) of inliers."""

    scatter: list[Pair]
    inliers: list[Bools]

    @classmethod
    def equal(cls, problem: Problem, scatter: Pair) -> Weights:
        """Return weights that give each view the same scatter and exclude no lenslet."""
        return cls([scatter] * len(problem.views), [np.ones(len(one.index), bool) for one in problem.views])

    def measured(self, problem: Problem, x: Floats) -> Weights:
        """Return weights with the scatter estimated from the residuals at x."""
        return self._replace(scatter=[_scatter(problem.residuals(x, k)) for k in range(len(problem.views))])

    def rows(self) -> list[slice]:
        """Return each view's Jacobian rows; each inlier lenslet has four rows."""
        ends = [0, *accumulate(4 * int(one.sum()) for one in self.inliers)]
        return [slice(*both) for both in pairwise(ends)]


@dataclass(frozen=True)
class Solution:
    """Fitted parameters x, their covariance (0 for fixed parameters), and the weights."""

    problem: Problem
    x: Floats
    covariance: Floats
    weights: Weights

    def value(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.x[self._at(name)])

    def deviation(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        return math.sqrt(self.covariance[self._at(name), self._at(name)])

    def correlation(self, one: str, other: str) -> float:
        """Return the correlation of two parameters."""
        shared = float(self.covariance[self._at(one), self._at(other)])
        return shared / (self.deviation(one) * self.deviation(other))

    def _at(self, name: str) -> int:
        return list(self.problem.steps).index(name)

    def rms_px(self) -> Pair:
        """Return the RMS residuals of the inliers, in panel pixels and in photograph pixels."""
        counting = [self.problem.residuals(self.x, k)[inliers] for k, inliers in enumerate(self.weights.inliers)]
        columns, rows, *photo = (np.concatenate(counting) ** 2).mean(axis=0)
        return math.sqrt(columns + rows), math.sqrt(sum(photo))


def solve(problem: Problem, x: Floats, robust_only: bool = False) -> Solution:
    """Fit the parameters, starting at x; unless `robust_only`, fit again without outliers."""
    problem = problem.thinned(8000)
    weights = Weights.equal(problem, (1.0, 1.0))
    for _ in range(2):
        x = _minimise(problem, x, weights, True)
        weights = weights.measured(problem, x)
    limits = [OUTLIER * np.repeat(scatter, 2) for scatter in weights.scatter]
    inliers = [np.all(abs(problem.residuals(x, k)) < limit, axis=1) for k, limit in enumerate(limits)]
    weights = weights._replace(inliers=inliers)
    if not robust_only:
        x = _minimise(problem, x, weights, False)
        weights = weights.measured(problem, x)
        x = _minimise(problem, x, weights, False)
    return judged(problem, x, weights)


def first_fit(problem: Problem, x: Floats) -> Floats:
    """Fit only lens and poses of the camera, and return x."""
    lens_only = replace(problem, fixed=frozenset(problem.blocks) - {"lens", "pose"})
    return _minimise(lens_only, x, Weights.equal(problem, (1e3, 1.0)), True)


def _scatter(residuals: Floats) -> Pair:
    panel, photo = (1.4826 * float(np.median(abs(part))) for part in (residuals[:, :2], residuals[:, 2:]))
    return max(panel, LEAST_SCATTER), max(photo, LEAST_SCATTER)


def _weighted(problem: Problem, x: Floats, weights: Weights, k: int) -> Floats:
    return np.asarray(problem.residuals(x, k)[weights.inliers[k]] / np.repeat(weights.scatter[k], 2))


def _minimise(problem: Problem, x: Floats, weights: Weights, robust: bool) -> Floats:
    smooth = [] if robust else [_smooth(problem, weights, k) for k in range(len(problem.views))]

    def expand(part: Floats) -> Floats:
        at = x.copy()
        at[problem.free] = part
        return at

    def residuals(part: Floats) -> Floats:
        interrupts.check()
        at = expand(part)
        parts = [_weighted(problem, at, weights, k) for k in range(len(problem.views))]
        if smooth:
            parts = [one.whitened(part) for one, part in zip(smooth, parts, strict=True)]
        return np.concatenate([*map(np.ravel, parts), problem.priors(at)])

    def slopes(part: Floats) -> Floats:
        matrix = jacobian(problem, expand(part), weights)
        for rows, one in zip(weights.rows(), smooth, strict=False):
            matrix[rows] = one.whitened(matrix[rows])
        return matrix

    fit = least_squares(
        residuals,
        x[problem.free],
        slopes,
        x_scale="jac",
        loss="soft_l1" if robust else "linear",
        f_scale=1.5,  # standard deviations above which soft_l1 is nearly linear
        xtol=1e-12,
        ftol=1e-8,  # stop below this relative change of the cost
        gtol=1e-12,
        max_nfev=60,
    )
    return expand(fit.x)


def _smooth(problem: Problem, weights: Weights, k: int) -> SmoothErrors:
    places, view, (panel, photo) = problem.places[k][weights.inliers[k]], problem.views[k], weights.scatter[k]
    across = float(np.sqrt(np.prod(np.std(view.photo_px, axis=0)) / max(1e-9, float(np.prod(places.std(axis=0))))))
    # In simulations, smooth errors are at least 0.001 panel pixels and 0.0003 pitches.
    least = np.repeat([0.001 / panel, 0.0003 * across / photo], 2)
    # The tuple is the minimum ratio of smooth to independent scatter per residual column.
    return SmoothErrors.of(places, np.maximum((0.12, 0.12, 0.2, 0.2), least))


def jacobian(problem: Problem, x: Floats, weights: Weights) -> Floats:
    """Return the Jacobian by central differences of the smooth `offsets`."""
    scatter, inliers = weights
    every = range(len(inliers))
    factors = []
    for k in every:
        within = abs(problem.offsets(x, k)[:, :2]) < problem.views[k].half_px
        gains = np.column_stack([np.where(within, WITHIN, 1.0), np.ones_like(within, float)])
        factors.append(gains[inliers[k]] / np.repeat(scatter[k], 2))
    base_rays, steps = [problem.rays(x, k) for k in every], list(problem.steps.items())
    columns = []
    for at in problem.free:
        (name, step), up, down = steps[at], x.copy(), x.copy()
        up[at] += step
        down[at] -= step
        own = [int(name.rpartition("_")[2])] if name.startswith(OWN_VIEW) else every
        changes = [np.zeros_like(one) for one in factors]
        for k in own:
            rays = base_rays[k] if name.startswith(STILL) else None
            offsets = problem.offsets(up, k, rays) - problem.offsets(down, k, rays)
            changes[k] = factors[k] * offsets[inliers[k]]
        changes.append(problem.priors(up) - problem.priors(down))
        columns.append(np.concatenate([one.ravel() for one in changes]) / (2.0 * step))
    return np.stack(columns, axis=1)


def judged(problem: Problem, x: Floats, weights: Weights) -> Solution:
    """Return the solution at x; the covariance is estimated from blocks of lenslets."""
    matrix = jacobian(problem, x, weights)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    matrix /= scale
    count = len(problem.free)
    priors = matrix[weights.rows()[-1].stop :]
    meat, groups = priors.T @ priors, 0
    for k, rows in enumerate(weights.rows()):
        smooth = _smooth(problem, weights, k)
        matrix[rows] = smooth.whitened(matrix[rows])
        part = matrix[rows].reshape(-1, 4, count)
        residual = smooth.whitened(_weighted(problem, x, weights, k))
        places = spread_out(problem.places[k][weights.inliers[k]])
        block = np.minimum((BLOCKS * places).astype(int), BLOCKS - 1) @ [BLOCKS, 1]
        scores = np.zeros((BLOCKS * BLOCKS, count))
        np.add.at(scores, block, (part * residual[..., None]).sum(axis=1))
        errors = smooth.whitened(smooth.modes[:, None] * smooth.shares[:, None])
        moved = np.einsum("nrm,nrp->rmp", errors, part).reshape(-1, count)
        meat += scores.T @ scores + moved.T @ moved
        groups += len(np.unique(block))
    inverse = np.linalg.pinv(matrix.T @ matrix, hermitian=True)
    sandwich = groups / max(1.0, groups - float(count)) * inverse @ meat @ inverse
    # Raise variances that are below the estimate for independent lenslets.
    promised = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    estimated = np.sqrt(np.maximum(np.diag(sandwich), 0.0))
    raised = np.maximum(promised, estimated) / np.maximum(estimated, 1e-300) / scale
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(problem.free, problem.free)] = sandwich * np.outer(raised, raised)
    return Solution(problem, x, covariance, weights)
