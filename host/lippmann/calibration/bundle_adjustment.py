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
from lippmann.calibration.lens_projection import FOLDS, LensProjection, powers
from lippmann.calibration.lenslet_measurement import Lenslets, regular
from lippmann.display.description import Display
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
#: Beginnings of the names of parameters that change their own view only.
OWN_VIEW = "turn_", "place_", "zoom_"
#: Priors: standard deviations of the pitches (shares of the file's), of the gap and of the bow (shares of D), ...
PRIOR_PITCH, PRIOR_GAP, PRIOR_BOW = 0.01, 0.3, 0.1
#: ... of the focal length (of its logarithm), principal point (share of the photograph's longer side), and distortion.
PRIOR_FOCAL, PRIOR_MIDDLE, PRIOR_DISTORTION = 0.7, 0.02, 0.3
#: Prior of a zoom: its standard deviation.
PRIOR_ZOOM = 0.1
#: Prior of the numbers of the seams: their standard deviation, pitches.
PRIOR_SEAMS = 0.03
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
        """Return W times values (N, 4), or (N, 4, M), or (4 N, M), whose rows are four for each lenslet."""
        flat = values.reshape(len(self.basis), 4, -1)
        part = np.einsum("nk,ncm->kcm", self.basis, flat) * self.lost.T[..., None]
        return np.asarray((flat - np.einsum("nk,kcm->ncm", self.basis, part)).reshape(values.shape))


def spread_out(places: Floats) -> Floats:
    """Return places (N, 2) from 0 to 1 across all of them."""
    low, size = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    return np.asarray((places - low) / size)


class Rays(NamedTuple):
    """Of N lenslets that a position sees: the middles of outlines (N, 3) and the panel points (N, 2), mm.

    `seam_terms` (N, 2, M) is what each number of the seams moves a middle by, in pitches.
    """

    middles: Floats
    points: Floats
    seam_terms: Floats


@dataclass(frozen=True)
class Problem:
    """What is fitted: a nominal display, and of each position the lenslets' projection and the lenslets.

    The parameters x are one vector of blocks, whose order is that of `blocks`.
    """

    display: Display
    projections: Sequence[LensProjection]
    views: Sequence[Lenslets]
    #: Blocks that keep their values: no bow, one focal length for all positions, and perhaps the file's gap.
    held: frozenset[str] = frozenset({"bow", "zoom"})

    def without(self, *held: str) -> Problem:
        """Return the problem in which some blocks are fitted too."""
        return replace(self, held=self.held.difference(held))

    @cached_property
    def seam_powers(self) -> tuple[tuple[int, int], ...]:
        """The powers (j, k) of slopes by which seams move the lenslets' middles in a photograph."""
        return powers(FOLDS[self.display.array.grid], SEAMS)

    @cached_property
    def blocks(self) -> dict[str, dict[str, float]]:
        """Names of the parameters of each block, and their steps for differences, in order."""
        views = range(len(self.views))
        seams = {f"seams_{j}{k}": SEAMS_STEP for j, k in self.seam_powers}
        poses = {f"{name}_{k}": step for k in views for name, step in POSE.items()}
        zooms = {f"zoom_{k}": ZOOM for k in views[1:]}
        return {"array": ARRAY, "gap": GAP, "bow": BOW, "seams": seams, "lens": LENS, "pose": poses, "zoom": zooms}

    @cached_property
    def steps(self) -> dict[str, float]:
        """The step of each parameter for differences, in order."""
        return {name: step for block in self.blocks.values() for name, step in block.items()}

    @cached_property
    def free(self) -> list[int]:
        """Places of the parameters that are fitted."""
        fitted = {name for block, names in self.blocks.items() if block not in self.held for name in names}
        return [at for at, name in enumerate(self.steps) if name in fitted]

    def part(self, x: Floats, block: str) -> Floats:
        """Return the parameters of a block."""
        ends = dict(zip(self.blocks, accumulate(map(len, self.blocks.values())), strict=True))
        return x[ends[block] - len(self.blocks[block]) : ends[block]]

    def packed(self, **parts: npt.ArrayLike) -> Floats:
        """Return the parameters x of some blocks; those of the other blocks are 0."""
        zeros = {block: np.zeros(len(names)) for block, names in self.blocks.items()}
        return np.concatenate([np.ravel(part) for part in (zeros | parts).values()])

    @cached_property
    def places(self) -> list[Floats]:
        """Of each view, the lenslets on the lattice of pitch 1."""
        return [regular(self.display.array.grid, one.index) for one in self.views]

    def centres(self, x: Floats, places: Floats) -> Floats:
        """Return lenslets' centres (N, 2), mm in the panel's frame."""
        px, py, shear, turn, ox, oy = self.part(x, "array")
        down = py * places[:, 1]
        along = px * places[:, 0] + shear * down
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * along - s * down + ox, s * along + c * down + oy], axis=1)

    def heights(self, x: Floats, centres: Floats) -> Floats:
        """Return the heights of lenslets over the array's mean, mm."""
        u, v = 2.0 * centres.T / [[self.display.panel.width_mm], [self.display.panel.height_mm]]
        return np.asarray(self.part(x, "bow") @ [u, v, u * u - 1.0 / 3.0, v * v - 1.0 / 3.0, u * v])

    def pose(self, x: Floats, k: int) -> tuple[Floats, Floats, Floats]:
        """Return the lens, and the turn and the place of view k."""
        turn, place = self.part(x, "pose").reshape(-1, 2, 3)[k]
        zoom = self.part(x, "zoom")[k - 1] if k > 0 else 0.0
        return self.part(x, "lens") * [1.0 + zoom, 1.0, 1.0, 1.0, 1.0], turn, place

    def rays(self, x: Floats, k: int) -> Rays:
        """Trace the rays of view k, which need neither the lens nor the camera's turn."""
        place = self.pose(x, k)[2]
        projection, centres = self.projections[k], self.centres(x, self.places[k])
        high = self.heights(x, centres)
        z = projection.outline_mm + high
        slope = (place[:2] - centres) / (place[2] - z)[:, None]
        outline, point, seam_terms = projection.traced(slope, self.part(x, "gap") + high, self.seam_powers)
        return Rays(np.column_stack([centres + outline, z]), centres + point, seam_terms)

    def aside(self, x: Floats, k: int, middles: Floats) -> Floats:
        """Return how far the places that were read are from the outlines' middles (N, 3), in cells of pitch 1."""
        return np.asarray((self.views[k].cell_px - projected(middles, *self.pose(x, k))) @ self.views[k].steps)

    def seen(self, x: Floats, k: int, rays: Rays | None = None) -> tuple[Floats, Floats]:
        """Return the panel points (N, 2) mm and the pixels (N, 2) of the lenslets of view k."""
        rays = rays or self.rays(x, k)
        moved = np.einsum("np,npa->na", self.aside(x, k, rays.middles), self.views[k].moves)
        middles = rays.middles.copy()
        middles[:, :2] += x[0] * (rays.seam_terms @ self.part(x, "seams"))
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
        display, size = self.display, np.array(self.views[0].shape[::-1])
        depth, longer = display.aperture_distance_mm, float(size.max())
        focal, *middle = self.part(x, "lens")[:3]
        parts: list[npt.ArrayLike] = [
            (x[:2] / display.array.pitches_mm - 1.0) / PRIOR_PITCH,
            (self.part(x, "gap") - display.gap_mm) / (PRIOR_GAP * depth),
            self.part(x, "bow") / (PRIOR_BOW * depth),
            [np.log(max(focal, 1.0) / longer) / PRIOR_FOCAL],
            (middle - 0.5 * size) / (PRIOR_MIDDLE * longer),
            self.part(x, "lens")[3:] / PRIOR_DISTORTION,
            self.part(x, "seams") / PRIOR_SEAMS,
            self.part(x, "zoom") / PRIOR_ZOOM,
        ]
        return np.concatenate([np.asarray(part) for part in parts])

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

    def rows(self) -> list[slice]:
        """Return the rows of each view's residuals among those of all, four for each lenslet that counts."""
        ends = [0, *accumulate(4 * int(one.sum()) for one in self.kept)]
        return [slice(*both) for both in pairwise(ends)]


@dataclass(frozen=True)
class Solution:
    """Parameters, their covariance (0 for those that are held), and the weights of the lenslets."""

    problem: Problem
    x: Floats
    covariance: Floats
    weights: Weights

    def value(self, name: str) -> float:
        """Return a parameter."""
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

    def rms_px(self) -> tuple[float, float]:
        """Return the root mean squares of the residuals that count: panel's pixels, and photograph's."""
        counting = [self.problem.residuals(self.x, k)[kept] for k, kept in enumerate(self.weights.kept)]
        columns, rows, *photo = (np.concatenate(counting) ** 2).mean(axis=0)
        return math.sqrt(columns + rows), math.sqrt(sum(photo))


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
    return judged(problem, x, weights)


def first_fit(problem: Problem, x: Floats) -> Floats:
    """Fit lens and poses alone to the photographs, the array held at its first values."""
    lens_only = replace(problem, held=frozenset(problem.blocks) - {"lens", "pose"})
    return _minimised(lens_only, x, Weights.equal(problem, (1e3, 1.0)), True)


def _scatter(residuals: Floats) -> tuple[float, float]:
    """Return the standard deviations of panel points and of pixels, by the median."""
    panel, photo = (1.4826 * float(np.median(abs(part))) for part in (residuals[:, :2], residuals[:, 2:]))
    return max(panel, LEAST_SCATTER), max(photo, LEAST_SCATTER)


def _weighted(problem: Problem, x: Floats, weights: Weights, k: int) -> Floats:
    return np.asarray(problem.residuals(x, k)[weights.kept[k]] / np.repeat(weights.scatter[k], 2))


def _minimised(problem: Problem, x: Floats, weights: Weights, robust: bool) -> Floats:
    """Return the parameters of least squares; `robust` weighs a large residual by its size, not by its square.

    Otherwise smooth errors are in the weights. Robust weights are those of single lenslets.
    """
    smooth = [] if robust else [_smooth(problem, weights, k) for k in range(len(problem.views))]

    def whole(part: Floats) -> Floats:
        at = x.copy()
        at[problem.free] = part
        return at

    def residuals(part: Floats) -> Floats:
        interrupts.check()
        at = whole(part)
        parts = [_weighted(problem, at, weights, k) for k in range(len(problem.views))]
        if smooth:
            parts = [one.whitened(part) for one, part in zip(smooth, parts, strict=True)]
        return np.concatenate([*map(np.ravel, parts), problem.priors(at)])

    def slopes(part: Floats) -> Floats:
        matrix = jacobian(problem, whole(part), weights)
        for rows, one in zip(weights.rows(), smooth, strict=False):
            matrix[rows] = one.whitened(matrix[rows])
        return matrix

    fit = least_squares(
        residuals,
        x[problem.free],
        slopes,
        x_scale="jac",
        loss="soft_l1" if robust else "linear",
        f_scale=ROBUST,
        ftol=SETTLED,
        xtol=1e-12,
        gtol=1e-12,
        max_nfev=MOST_STEPS,
    )
    return whole(fit.x)


def _smooth(problem: Problem, weights: Weights, k: int) -> SmoothErrors:
    """Return the smooth errors of view k."""
    places, view, (panel, photo) = problem.places[k][weights.kept[k]], problem.views[k], weights.scatter[k]
    across = float(np.sqrt(np.prod(np.std(view.photo_px, axis=0)) / max(1e-9, float(np.prod(places.std(axis=0))))))
    least = np.repeat([POINTS / panel, MIDDLES * across / photo], 2)
    return SmoothErrors.of(places, np.maximum(SMOOTH, least))


def jacobian(problem: Problem, x: Floats, weights: Weights) -> Floats:
    """Return the derivatives by the free parameters, by central differences.

    The differences are those of the offsets: across an end of an interval, they would be those of neither side.
    """
    scatter, kept = weights
    every = range(len(kept))
    factors = [problem.gains(x, k)[kept[k]] / np.repeat(scatter[k], 2) for k in every]
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
            changes[k] = factors[k] * offsets[kept[k]]
        changes.append(problem.priors(up) - problem.priors(down))
        columns.append(np.concatenate([one.ravel() for one in changes]) / (2.0 * step))
    return np.stack(columns, axis=1)


def judged(problem: Problem, x: Floats, weights: Weights) -> Solution:
    """Return the solution with its covariance by blocks of lenslets."""
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
        places = spread_out(problem.places[k][weights.kept[k]])
        block = np.minimum((BLOCKS * places).astype(int), BLOCKS - 1) @ [BLOCKS, 1]
        scores = np.zeros((BLOCKS * BLOCKS, count))
        np.add.at(scores, block, (part * residual[..., None]).sum(axis=1))
        errors = smooth.whitened(smooth.modes[:, None] * smooth.shares[:, None])
        moved = np.einsum("nrm,nrp->rmp", errors, part).reshape(-1, count)
        meat += scores.T @ scores + moved.T @ moved
        groups += len(np.unique(block))
    inverse = np.linalg.pinv(matrix.T @ matrix, hermitian=True)
    sandwich = groups / max(1.0, groups - float(count)) * inverse @ meat @ inverse
    # Never less than the scatter of single lenslets promises.
    promised = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    estimated = np.sqrt(np.maximum(np.diag(sandwich), 0.0))
    raised = np.maximum(promised, estimated) / np.maximum(estimated, 1e-300) / scale
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(problem.free, problem.free)] = sandwich * np.outer(raised, raised)
    return Solution(problem, x, covariance, weights)
