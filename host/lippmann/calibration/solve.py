"""The whole calculation, from the folder of photographs to the calibration."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from lippmann.base.progress import Progress
from lippmann.calibration.bundle_adjustment import BOW, LENS, OUTLIER, Problem, Solution, first_fit, judged, solve
from lippmann.calibration.initial_estimate import starts
from lippmann.calibration.lattice_search import SeenLattice, find_lattice
from lippmann.calibration.lens_projection import axes_at, fit_projection, movement, outline_mm
from lippmann.calibration.lenslet_measurement import Lenslets, measure_lenslets
from lippmann.calibration.pattern_decoding import decode_position
from lippmann.calibration.photographs import pattern_set, positions
from lippmann.calibration.result import (
    OPEN,
    Calibration,
    ContradictionError,
    FoundCamera,
    Parameter,
    display_of,
    parameters_of,
    remarks_of,
)
from lippmann.calibration.subpixel_intervals import movement_of, refined
from lippmann.display.description import Display
from lippmann.errors import input_error
from lippmann.optics.rays import Floats

#: Range in which the radius is looked for, as factors of the file's.
RANGE = (0.75, 1.33)
#: Least radius, in half diagonals of a cell.
LEAST_RADIUS = 1.001
#: Lenslets of a position whose rays are traced.
TRACED = 48
#: Least standard deviation, as a share: what blur and aberrations leave on computed photographs.
LEAST_SHARE = 0.003
SEED = 1913


class Radius(NamedTuple):
    """A radius and its standard deviation, mm; `effect` is what this deviation changes in the parameters."""

    value_mm: float
    deviation_mm: float
    effect: Floats = np.zeros(0)


def radius_of(display: Display, solution: Solution) -> Radius:
    """Return the radius that the movements in each position give, for the display that was found without.

    Raises InputError when no radius near the file's gives a measured movement.
    """
    views = solution.problem.views
    found = np.array([_of_position(display, solution, k, view) for k, view in enumerate(views)])
    value = float(found.mean())
    scatter = float(found.std(ddof=1)) / np.sqrt(len(found)) if len(found) > 1 else 0.02 * value
    return Radius(value, float(np.hypot(scatter, LEAST_SHARE * value)))


def _of_position(display: Display, solution: Solution, k: int, view: Lenslets) -> float:
    place = np.array([solution.value(f"place_{axis}_{k}") for axis in "xyz"])
    centres = solution.problem.centres(solution.x, solution.problem.places[k])
    some = np.random.default_rng(SEED).permutation(len(centres))[:TRACED]
    slopes = (place[:2] - centres[some]) / place[2]
    old = display.array.radius_mm
    # The movement of the panel points over the aperture, mm a mm, the same in both directions.
    across = np.trace(view.spread @ axes_at(display.array.rotation_deg)) / 2.0
    measured = float(across / np.mean(display.array.pitches_mm))

    def off(radius_mm: float) -> float:
        array = replace(display.array, radius_mm=radius_mm)
        array = replace(array, thickness_mm=max(array.thickness_mm, array.sag_mm))
        return movement(replace(display, array=array), slopes, float(place[2])) - measured

    # A dome spans its cell.
    low, high = max(RANGE[0] * old, LEAST_RADIUS * display.array.half_diagonal_mm), RANGE[1] * old
    if off(low) * off(high) > 0.0:
        what = f"no radius from {low:.4g} to {high:.4g} mm moves the panel's points as photographed"
        raise input_error(view.name, what, "correct radius_mm, thickness_mm or index in the display file")
    return float(brentq(off, low, high, rtol=1e-5))


logger = logging.getLogger("lippmann")
#: Lenslets of each position in trial fits.
TRIAL = 400
#: Pixels of a position among which its lattice is looked for: tens for each of 100,000 lenslets.
MOST_POINTS = 3_000_000
#: Half of the gap's 95 % interval, as a share of D, beyond which the gap stays that of the file.
GAP_KNOWN = 0.1
#: Most scatter of the panel points of a result that is trusted, the larger of pixels and pitches; and most outliers.
#: Random displays scatter by up to 0.3 px.
MOST_SCATTER_PX, MOST_SCATTER = 0.5, 0.03
MOST_OUTLIERS = 0.35
#: A bow is told when it is this many standard deviations, and this high, mm.
BOW_DEVIATIONS, LEAST_BOW_MM = 6.0, 0.004
#: A zoom between positions is told when it is this many standard deviations, and this large. Unchanged lenses have
#: seemed to differ by 1 deviation, lenses that were changed by half a per cent by 5 and more.
ZOOM_DEVIATIONS, LEAST_ZOOM = 4.0, 0.002
#: Rounds in which panel points become finer than pixels.
REFINEMENTS = 3
#: Growth of the scatter, and pixels of it, from which on points have become worse: a gap that is not known moves points
#: over the cells otherwise than in the photographs.
COARSER, FINE_PX = 2.0, 0.02
#: Rounds in which the radius is found for the gap, and the gap for the radius.
RADIUS_ROUNDS = 2


def calibrate(
    folder: Path,
    nominal: Display,
    bow: bool = False,
    radius: bool = False,
    progress: Progress = lambda done, total: None,
) -> Calibration:
    """Return the calibration that the photographs of a folder give for a nominal display.

    With `bow` and `radius` tilts and curvatures of the array, and the lenslets' radius, are found too.

    Raises InputError for photographs that cannot be used, with the photograph and a remedy; ContradictionError when the
    photographs contradict each other or the display file.
    """
    patterns = pattern_set(folder, nominal)
    pitch_px = nominal.array.coarsest_mm / min(nominal.panel.pitches_mm)
    shape: tuple[int, int] | None = None
    views: list[Lenslets] = []
    seen: list[SeenLattice] = []
    for position in positions(folder, patterns):
        decoded = decode_position(position, patterns, pitch_px, shape, progress)
        shape = decoded.shape
        some = np.random.default_rng(1907).permutation(len(decoded.panel_px))[:MOST_POINTS]
        seen.append(find_lattice(position.name, decoded.points_mm(nominal)[some], nominal))
        views.append(measure_lenslets(decoded, seen[-1], nominal))
    whole, x = _number_lenslets(nominal, views, seen, progress)
    logger.info("least squares")
    progress(0, 3)
    whole, solution = _refine(whole, x)
    round_lens = None
    if radius:
        whole, solution, round_lens = _fit_radius(whole, solution)
    progress(1, 3)
    bowed = solve(solution.problem.without("bow"), solution.x)
    _check_zoom(bowed)
    progress(2, 3)
    if "gap" in whole.held:
        solution, bowed = (judged(one.problem.without("gap"), one.x, one.weights) for one in (solution, bowed))
    if round_lens is not None:
        solution, bowed = (
            replace(one, covariance=one.covariance + np.outer(round_lens.effect, round_lens.effect))
            for one in (solution, bowed)
        )
    remarks = _bow_remarks(bowed, bow)
    solution = bowed if bow else solution
    result = _result(nominal, replace(solution.problem, views=whole.views), solution, remarks, round_lens)
    progress(3, 3)
    return result


def _number_lenslets(
    nominal: Display, views: list[Lenslets], seen: list[SeenLattice], progress: Progress
) -> tuple[Problem, Floats]:
    """Return the problem with the likeliest numbering, and its first values."""
    logger.info("numbering")
    likely = starts(nominal, views, seen)
    trials = []
    for number, (problem, start) in enumerate(likely):
        progress(number, len(likely))
        sample = problem.thinned(TRIAL)
        trial = solve(sample, first_fit(sample, start), robust_only=True)
        trials.append((_cost(trial), problem, trial.x))
    _, problem, x = min(trials, key=lambda one: one[0])
    return problem, x


def _refine(whole: Problem, x: Floats) -> tuple[Problem, Solution]:
    """Solve, and make the panel points finer than pixels by what was found, as long as the fit gets no worse."""
    solution = solve(whole, x, robust_only=True)
    if 1.96 * solution.deviation("gap") > GAP_KNOWN * whole.display.aperture_distance_mm:
        # Left alone, it would follow what the model lacks, and take pitch and offset with it.
        whole, x = replace(whole, held=whole.held | {"gap"}), solution.x.copy()
        whole.part(x, "gap")[:] = whole.display.gap_mm
        solution = solve(whole, x, robust_only=True)
    for _ in range(REFINEMENTS):
        finer = seen_again(solution, whole)
        again = solve(finer, solution.x)
        if _scatter(again) > COARSER * _scatter(solution) + FINE_PX:
            break
        whole, solution = finer, again
    return whole, solution


def _fit_radius(whole: Problem, solution: Solution) -> tuple[Problem, Solution, Radius]:
    """Fit the radius too; return the problem, its solution, and the radius."""

    def with_radius(radius_mm: float) -> Problem:
        array = replace(nominal.array, radius_mm=radius_mm)
        return seen_again(solution, replace(whole, display=replace(nominal, array=array)))

    nominal = whole.display
    for _ in range(RADIUS_ROUNDS):
        found = radius_of(display_of(whole.display, solution), solution)
        whole = with_radius(found.value_mm)
        solution = solve(whole, solution.x)
    # What the radius leaves open, the other numbers leave open with it.
    wider = solve(with_radius(found.value_mm + found.deviation_mm), solution.x)
    return whole, solution, found._replace(effect=wider.x - solution.x)


def seen_again(solution: Solution, whole: Problem) -> Problem:
    """Return the problem with rays traced through the display that was found, from where each camera stands.

    The panel points become finer than pixels, too. The problem stays as it is when there can be no such display.
    """
    try:
        built = display_of(whole.display, solution)
    except ContradictionError:
        return whole
    height, projections, views = outline_mm(built), [], []
    for k, view in enumerate(whole.views):
        place = whole.pose(solution.x, k)[2]
        distance = max(1.0, float(place[2]))
        projections.append(fit_projection(built, whole.projections[k].steepest, distance))
        slopes = (place[:2] - whole.centres(solution.x, whole.places[k])) / (place[2] - height)
        aside = whole.aside(solution.x, k, whole.rays(solution.x, k).middles)
        views.append(refined(view, built, slopes, aside, movement_of(built, slopes, distance)))
    return replace(whole, projections=projections, views=views)


def _scatter(solution: Solution) -> float:
    """Return the scatter of panel points in the worst view, pixels."""
    return max(panel for panel, _ in solution.weights.scatter)


def _cost(solution: Solution) -> float:
    """Return what a numbering costs: the scatter of panel points and photograph, with outliers."""
    lost = 1.0 - float(np.mean(np.concatenate(solution.weights.kept)))
    return float(np.mean([math.hypot(*one) for one in solution.weights.scatter])) * (1.0 + 5.0 * lost)


def _check_zoom(solution: Solution) -> None:
    """Refuse positions whose photographs are magnified otherwise: one lens for all would put it into pitch and gap."""
    problem = solution.problem.without("zoom")
    zoomed = solve(problem, solution.x)
    zooms = {name: zoomed.value(name) for name in problem.blocks["zoom"]}
    sure = [
        name for name, zoom in zooms.items() if abs(zoom) > max(ZOOM_DEVIATIONS * zoomed.deviation(name), LEAST_ZOOM)
    ]
    if not sure:
        return
    views = [view.name for view in problem.views]
    # When all others differ from the first alike, it is the first.
    first = len(sure) == len(zooms) > 1 and len({zooms[name] > 0.0 for name in sure}) == 1
    worst = max(sure, key=lambda name: abs(zooms[name]))
    odd, zoom = (views[0], -zooms[worst]) if first else (views[list(zooms).index(worst) + 1], zooms[worst])
    raise ContradictionError(
        f"{odd}: the lens magnifies {100.0 * abs(zoom):.1f} % {'more' if zoom > 0.0 else 'less'} than in "
        f"{'the other positions' if first else views[0]}; fix zoom and focus, and take all positions again"
    )


def _bow_remarks(solution: Solution, asked: bool) -> tuple[str, ...]:
    """Return the remark on a bow that is sure: how much higher the array is at the corners than in the middle."""
    if not any(abs(solution.value(name)) > BOW_DEVIATIONS * solution.deviation(name) for name in BOW):
        return ()
    height = solution.value("bow_xx") + solution.value("bow_yy")
    if asked:
        return (f"bow: the array is {1000.0 * height:+.0f} um higher at the panel's corners than in its middle",)
    if abs(height) <= LEAST_BOW_MM:
        return ()
    return (f"the array is bowed or tilted ({1000.0 * height:+.0f} um at the corners); solve with --bow",)


def _result(
    nominal: Display, whole: Problem, solution: Solution, remarks: tuple[str, ...], radius: Radius | None
) -> Calibration:
    """Return the calibration; refuse one that the data contradict."""
    pitch_px = nominal.array.finest_mm / min(nominal.panel.pitches_mm)
    outliers = 1.0 - float(np.mean(np.concatenate(solution.weights.kept)))
    scatter = _scatter(solution)
    limit = max(MOST_SCATTER_PX, MOST_SCATTER * pitch_px)
    if scatter > limit or outliers > MOST_OUTLIERS:
        raise ContradictionError(
            f"the photographs do not fit a display like '{nominal.name}': panel points scatter by {scatter:.2f} px, "
            f"{100.0 * outliers:.0f} % are outliers; use one lens without zoom, and check plano_side, thickness_mm, "
            "index and focal length in the file"
        )
    display = display_of(whole.display, solution)
    parameters = parameters_of(nominal, solution)
    if radius is not None:
        half = 1.96 * radius.deviation_mm
        known = half < OPEN["radius"] * radius.value_mm
        parameters += (Parameter("radius", radius.value_mm, half, "mm", nominal.array.radius_mm, known),)
    lens = {name: solution.value(name) for name in LENS}
    cameras, rows = [], []
    for k, view in enumerate(whole.views):
        axes = [f"place_{axis}_{k}" for axis in "xyz"]
        place, uncertainty = (
            [factor * number(axis) for axis in axes]
            for factor, number in ((1.0, solution.value), (1.96, solution.deviation))
        )
        cameras.append(
            FoundCamera(
                name=view.name,
                place_mm=place,
                uncertainty_mm=uncertainty,
                lenslets=len(view.index),
                agree=view.agree,
                modulation=view.modulation,
            )
        )
        centres, residual = whole.centres(solution.x, whole.places[k]), whole.residuals(solution.x, k)
        kept = np.asarray((abs(residual[:, :2]) < OUTLIER * solution.weights.scatter[k][0]).all(axis=1))
        # Seen less expected; pixel rows count down.
        off = residual[:, :2] * [-1.0, 1.0]
        rows.append(np.column_stack([np.full(len(kept), k), view.index, centres, off, kept]))
    remarks = (*remarks, *remarks_of(parameters, solution))
    findings = parameters, remarks, tuple(cameras), lens, *solution.rms_px(), outliers
    return Calibration(*findings, display, nominal, np.concatenate(rows))
