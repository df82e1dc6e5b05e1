"""Compute a calibration from a folder of photographs."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from lippmann.base.progress_protocol import Progress
from lippmann.calibration.bundle_adjustment import BOW, LENS, OUTLIER, Problem, Solution, first_fit, judged, solve
from lippmann.calibration.initial_estimate import starts
from lippmann.calibration.lattice_search import SeenLattice, find_lattice
from lippmann.calibration.lenslet_measurement import Lenslets, measure_lenslets
from lippmann.calibration.lenslet_projection import axes_at, fit_projection, movement, outline_mm
from lippmann.calibration.pattern_decoding import decode_position
from lippmann.calibration.photographs import pattern_set, positions
from lippmann.calibration.result import (
    OPEN,
    Calibration,
    ContradictionError,
    FoundCamera,
    Parameter,
    display_of,
    find_warnings,
    parameters_of,
)
from lippmann.calibration.subpixel_intervals import movement_of, refined
from lippmann.display.description import Display
from lippmann.errors import input_error
from lippmann.optics.rays import Floats


class Radius(NamedTuple):
    """A lenslet radius and its deviation, mm; `effect` is the parameters' change for one deviation."""

    value_mm: float
    deviation_mm: float
    effect: Floats = np.zeros(0)


def radius_of(display: Display, solution: Solution) -> Radius:
    """Return the lenslet radius that explains the panel points' movement over a cell.

    Raises InputError if no radius fits.
    """
    views = solution.problem.views
    radii = np.array([_of_position(display, solution, k, view) for k, view in enumerate(views)])
    value = float(radii.mean())
    scatter = float(radii.std(ddof=1)) / np.sqrt(len(radii)) if len(radii) > 1 else 0.02 * value
    # In simulations, blur and aberrations add an error of 0.3 %.
    return Radius(value, float(np.hypot(scatter, 0.003 * value)))


def _of_position(display: Display, solution: Solution, k: int, view: Lenslets) -> float:
    place = np.array([solution.value(f"place_{axis}_{k}") for axis in "xyz"])
    centres = solution.problem.centres(solution.x, solution.problem.places[k])
    some = np.random.default_rng(1913).permutation(len(centres))[:48]
    slopes = (place[:2] - centres[some]) / place[2]
    old = display.array.radius_mm
    # Panel point movement per shift in the cell, mm per mm, mean of both axes.
    across = np.trace(view.spread @ axes_at(display.array.rotation_deg)) / 2.0
    measured = float(across / np.mean(display.array.pitches_mm))

    def off(radius_mm: float) -> float:
        array = replace(display.array, radius_mm=radius_mm)
        array = replace(array, thickness_mm=max(array.thickness_mm, array.sag_mm))
        return movement(replace(display, array=array), slopes, float(place[2])) - measured

    # Search from 3/4 to 4/3 of the given radius; the lens must span its cell.
    low, high = max(0.75 * old, 1.001 * display.array.half_diagonal_mm), 1.33 * old
    if off(low) * off(high) > 0.0:
        what = f"no lenslet radius from {low:.4g} to {high:.4g} mm fits the photographs"
        raise input_error(view.name, what, "correct radius_mm, thickness_mm or index in the display file")
    return float(brentq(off, low, high, rtol=1e-5))


logger = logging.getLogger("lippmann")
#: Maximum scatter of panel points (the larger of `MAX_SCATTER_PX` pixels and
#: `MAX_SCATTER` pitches), and maximum fraction of outliers, of a valid result.
#: Simulated displays had a scatter of at most 0.3 px.
MAX_SCATTER_PX, MAX_SCATTER, MAX_OUTLIERS = 0.5, 0.03, 0.35


def calibrate(
    folder: Path, nominal: Display, bow: bool = False, radius: bool = False, progress: Progress = lambda *_: None
) -> Calibration:
    """Calibrate a nominal display from a folder of photographs.

    `bow` also fits the array's tilts and curvatures, `radius` the lenslets' radius.

    Raises InputError for unusable photographs, and ContradictionError if photographs
    contradict each other or the display file.
    """
    patterns = pattern_set(folder, nominal)
    pitch_px = nominal.array.coarsest_mm / min(nominal.panel.pitches_mm)
    shape: tuple[int, int] | None = None
    views: list[Lenslets] = []
    lattices: list[SeenLattice] = []
    for position in positions(folder, patterns):
        decoded = decode_position(position, patterns, pitch_px, shape, progress)
        shape = decoded.shape
        some = np.random.default_rng(1907).permutation(len(decoded.panel_px))[:3_000_000]
        lattices.append(find_lattice(position.name, decoded.points_mm(nominal)[some], nominal))
        views.append(measure_lenslets(decoded, lattices[-1], nominal))
    problem, x = _number_lenslets(nominal, views, lattices, progress)
    logger.info("fitting by least squares")
    progress(0, 3)
    problem, solution = _refine(problem, x)
    lens_radius = None
    if radius:
        problem, solution, lens_radius = _fit_radius(problem, solution)
    progress(1, 3)
    bowed = solve(solution.problem.freeing("bow"), solution.x)
    _check_zoom(bowed)
    progress(2, 3)
    if "gap" in problem.fixed:
        solution, bowed = (judged(one.problem.freeing("gap"), one.x, one.weights) for one in (solution, bowed))
    if lens_radius is not None:
        spread = np.outer(lens_radius.effect, lens_radius.effect)
        solution, bowed = (replace(one, covariance=one.covariance + spread) for one in (solution, bowed))
    warnings = _bow_warnings(bowed, bow)
    solution = bowed if bow else solution
    result = _result(nominal, replace(solution.problem, views=problem.views), solution, warnings, lens_radius)
    progress(3, 3)
    return result


def _number_lenslets(
    nominal: Display, views: list[Lenslets], lattices: list[SeenLattice], progress: Progress
) -> tuple[Problem, Floats]:
    logger.info("numbering lenslets")
    likely = starts(nominal, views, lattices)
    trials = []
    for number, (problem, start) in enumerate(likely):
        progress(number, len(likely))
        sample = problem.thinned(400)
        trial = solve(sample, first_fit(sample, start), robust_only=True)
        scatter = float(np.mean([math.hypot(*one) for one in trial.weights.scatter]))
        trials.append((scatter * (1.0 + 5.0 * _outliers(trial)), problem, trial.x))
    _, problem, x = min(trials, key=lambda one: one[0])
    return problem, x


def _refine(problem: Problem, x: Floats) -> tuple[Problem, Solution]:
    solution = solve(problem, x, robust_only=True)
    if 1.96 * solution.deviation("gap") > 0.1 * problem.display.aperture_distance_mm:
        # An undetermined gap would absorb model errors, and falsify pitch and offset.
        problem, x = replace(problem, fixed=problem.fixed | {"gap"}), solution.x.copy()
        problem.part(x, "gap")[:] = problem.display.gap_mm
        solution = solve(problem, x, robust_only=True)
    for _ in range(3):
        finer = trace_again(solution, problem)
        again = solve(finer, solution.x)
        if _scatter(again) > 2.0 * _scatter(solution) + 0.02:  # a wrong gap adds scatter
            break
        problem, solution = finer, again
    return problem, solution


def _fit_radius(problem: Problem, solution: Solution) -> tuple[Problem, Solution, Radius]:
    def with_radius(radius_mm: float) -> Problem:
        array = replace(nominal.array, radius_mm=radius_mm)
        return trace_again(solution, replace(problem, display=replace(nominal, array=array)))

    nominal = problem.display
    for _ in range(2):  # radius and gap depend on each other
        radius = radius_of(display_of(problem.display, solution), solution)
        problem = with_radius(radius.value_mm)
        solution = solve(problem, solution.x)
    # Measure how the radius's uncertainty changes the other parameters.
    wider = solve(with_radius(radius.value_mm + radius.deviation_mm), solution.x)
    return problem, solution, radius._replace(effect=wider.x - solution.x)


def trace_again(solution: Solution, problem: Problem) -> Problem:
    """Return the problem with the fitted display's rays, or `problem` if that display is impossible."""
    try:
        built = display_of(problem.display, solution)
    except ContradictionError:
        return problem
    height, projections, views = outline_mm(built), [], []
    for k, view in enumerate(problem.views):
        place = problem.pose(solution.x, k)[2]
        distance = max(1.0, float(place[2]))
        projections.append(fit_projection(built, problem.projections[k].steepest, distance))
        slopes = (place[:2] - problem.centres(solution.x, problem.places[k])) / (place[2] - height)
        aside = problem.aside(solution.x, k, problem.rays(solution.x, k).middles)
        views.append(refined(view, built, slopes, aside, movement_of(built, slopes, distance)))
    return replace(problem, projections=projections, views=views)


def _scatter(solution: Solution) -> float:
    return max(panel for panel, _ in solution.weights.scatter)


def _outliers(solution: Solution) -> float:
    return 1.0 - float(np.mean(np.concatenate(solution.weights.inliers)))


def _check_zoom(solution: Solution) -> None:
    problem = solution.problem.freeing("zoom")
    zoomed = solve(problem, solution.x)
    zooms = {name: zoomed.value(name) for name in problem.blocks["zoom"]}
    # In simulations, the fitted zoom of an unchanged lens is about 1 standard deviation, and that of a
    # lens whose focal length changed by 0.5 % is at least 5.
    limits = {name: max(4.0 * zoomed.deviation(name), 0.002) for name in zooms}
    sure = [name for name, zoom in zooms.items() if abs(zoom) > limits[name]]
    if not sure:
        return
    views = [view.name for view in problem.views]
    # If all zooms relative to the first position are sure, of one sign, report that position.
    first = len(sure) == len(zooms) > 1 and len({zooms[name] > 0.0 for name in sure}) == 1
    worst = max(sure, key=lambda name: abs(zooms[name]))
    odd, zoom = (views[0], -zooms[worst]) if first else (views[list(zooms).index(worst) + 1], zooms[worst])
    raise ContradictionError(
        f"{odd}: the camera lens magnifies {100.0 * abs(zoom):.1f} % {'more' if zoom > 0.0 else 'less'} than in "
        f"{'the other positions' if first else views[0]}; fix zoom and focus, and take all positions again"
    )


def _bow_warnings(solution: Solution, is_fitted: bool) -> tuple[str, ...]:
    # Warn only if a coefficient exceeds 6 standard deviations.
    if not any(abs(solution.value(name)) > 6.0 * solution.deviation(name) for name in BOW):
        return ()
    height = solution.value("bow_xx") + solution.value("bow_yy")
    if is_fitted:
        return (f"bow: the array is {1000.0 * height:+.0f} um higher at the panel's corners than in its middle",)
    if abs(height) <= 0.004:  # mm
        return ()
    return (f"the array is bowed or tilted ({1000.0 * height:+.0f} um at the corners); solve with --bow",)


def _result(
    nominal: Display, problem: Problem, solution: Solution, warnings: tuple[str, ...], radius: Radius | None
) -> Calibration:
    pitch_px = nominal.array.finest_mm / min(nominal.panel.pitches_mm)
    outliers, scatter = _outliers(solution), _scatter(solution)
    if scatter > max(MAX_SCATTER_PX, MAX_SCATTER * pitch_px) or outliers > MAX_OUTLIERS:
        raise ContradictionError(
            f"the photographs do not fit the display '{nominal.name}': panel points scatter by {scatter:.2f} px, "
            f"{100.0 * outliers:.0f} % are outliers; do not zoom between photographs, and correct plano_side, "
            "thickness_mm, index or focal length in the display file"
        )
    display = display_of(problem.display, solution)
    parameters = parameters_of(nominal, solution)
    if radius is not None:
        half = 1.96 * radius.deviation_mm
        determined = half < OPEN["radius"] * radius.value_mm
        parameters += (Parameter("radius", radius.value_mm, half, "mm", nominal.array.radius_mm, determined),)
    lens = {name: solution.value(name) for name in LENS}
    cameras, rows = [], []
    for k, view in enumerate(problem.views):
        axes = [f"place_{axis}_{k}" for axis in "xyz"]
        cameras.append(
            FoundCamera(
                name=view.name,
                place_mm=[solution.value(axis) for axis in axes],
                uncertainty_mm=[1.96 * solution.deviation(axis) for axis in axes],
                lenslets=len(view.index),
                agree=view.agree,
                modulation=view.modulation,
            )
        )
        centres, residual = problem.centres(solution.x, problem.places[k]), problem.residuals(solution.x, k)
        inliers = np.asarray((abs(residual[:, :2]) < OUTLIER * solution.weights.scatter[k][0]).all(axis=1))
        # Measured minus expected values; y is flipped, as pixel rows count down.
        off = residual[:, :2] * [-1.0, 1.0]
        rows.append(np.column_stack([np.full(len(inliers), k), view.index, centres, off, inliers]))
    warnings = (*warnings, *find_warnings(parameters, solution))
    findings = parameters, warnings, tuple(cameras), lens, *solution.rms_px(), outliers
    return Calibration(*findings, display, nominal, np.concatenate(rows))
