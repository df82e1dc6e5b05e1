"""Error of the fixed-point pipeline against golden, and its budget by step (`tools.bench fixed`).

The twin is measured: the RTL gives the same words, bit for bit. Golden traces the rays that the words represent: pixel
coordinates in 1/16 pixel, aperture points in the configuration's own words.
"""

from __future__ import annotations

import dataclasses
import itertools
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from lippmann.conformance.figures import Figures, Measured
from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.fixed.build import CONFIGURATIONS, Build, Named, chosen
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import WIDEST, Bools, Ints
from lippmann.optics.rays import Floats, Rays, Status, gets_through
from lippmann.optics.system import System

from tools import word_sets
from tools.stage_errors import hybrids, steps_of
from tools.word_sets import Words

if TYPE_CHECKING:
    from tools.full_report import Plan

logger = logging.getLogger("lippmann.report")
#: Rays of each adversarial set, and of the budget.
ADVERSARIAL, BUDGET = 200_000, 200_000
#: Panels up to this many pixels are traced whole.
WHOLE = 2400 * 2400


class Comparison(NamedTuple):
    """N rays of the twin compared with golden's: the twin's rays, and arrays (N,)."""

    twin: Rays
    #: Angle between the directions, microradian, and its weight min(1, 2 cos theta_t); theta_t is the angle between
    #: exit ray and last face's normal, by golden.
    turn_urad: Floats
    weight: Floats
    #: Distance between the exit points, lens-local, nm.
    shift_nm: Floats
    #: Rays that leave through the same lenslet with the same status in both.
    alive: Bools
    #: Rays whose status differs; rays whose first or last lenslet differs.
    status_differs: Bools
    lenslet_differs: Bools
    #: Rays too slanted for the words. The twin calls them missed; they are not compared.
    refused: Bools


def stated_nm(fraction_bits: int) -> float:
    """Return the exit point's stated error, nm: 2 at the widest, twice that for each bit less."""
    return float(2 ** (1 + WIDEST - fraction_bits))


# ---- comparison ----


def compare(display: Display, build: Build, words: Words) -> Comparison:
    """Trace rays with the twin and with golden; return how they differ."""
    model, f = build.model, build.fraction_bits
    config = configuration(display, build, model)
    pixel = pixels_of_words(display, words.u, words.v)
    twin = rays_of_words(display, pixel, ray_pipeline(*words, config, build), f)
    golden = trace(display, pixel, word_sets.aims_of(display, build, words), model)
    refused = word_sets.too_slanted(display, build, words) & (twin.status == int(Status.MISSED))
    status = (twin.status != golden.status) & ~refused
    starts = np.stack(word_sets.twin_start(display, build, words.u, words.v), axis=1)
    same = (starts == word_sets.golden_start(display, pixel)) & (twin.lenslet == golden.lenslet)
    lenslet = ~same.all(axis=1) & ~refused
    return Comparison(
        twin=twin,
        turn_urad=np.linalg.norm(twin.direction - golden.direction, axis=1) * 1e6,
        weight=np.minimum(1.0, 2.0 * exit_cosine(display, golden, model == "exact")),
        shift_nm=np.linalg.norm(twin.local_mm - golden.local_mm, axis=1) * 1e6,
        alive=~status & ~lenslet & ~refused & gets_through(golden.status),
        status_differs=status,
        lenslet_differs=lenslet,
        refused=refused,
    )


def exit_cosine(display: Display, rays: Rays, domes: bool) -> Floats:
    """Return the cosine between exit rays and the last face's normal, (N,): the dome's, or else the axis."""
    if not domes or display.array.plano_side == "viewer":
        return np.abs(rays.direction[:, 2])
    normal = rays.local_mm / display.array.radius_mm + (0.0, 0.0, 1.0)
    cosine: Floats = np.abs((normal * rays.direction).sum(axis=1))
    return cosine


def measure(
    named: Named,
    display: Display,
    rays_of: str,
    chunks: Iterator[Words],
) -> dict[str, Any]:
    """Measure a row of the report over chunks of a set of rays.

    `refused` counts the rays that were not compared. The errors of direction (microradian; `weighted`: times
    min(1, 2 cos theta_t)) and exit point (nm) are over the rays that leave by the same lenslet in both.
    `status_differs` and `lenslet_differs` count the others. Of these, `lost` counts rays that the twin calls missed
    because they would meet more domes than the build tries. `edge_nm` is the distance of the farthest of the rest from
    the edge where golden's fate changes to the twin's (infinite: farther than was tried). `kept` tells whether the
    errors stay within the configuration's promise; None when it has none.
    """
    parts = [_chunk(named.build, display, words) for words in chunks]
    found = {key: (max if key in MAXIMA else sum)(part[key] for part in parts) for key in parts[0]}
    for key in ("rms_direction_urad", "rms_point_nm"):
        found[key] = float(np.sqrt(found[key] / max(found["alive"], 1)))
    del found["alive"]
    kept = None
    if named.promise_urad is not None:
        point = stated_nm(named.build.fraction_bits) if named.promise_nm is None else named.promise_nm
        kept = (
            max(found["max_point_nm"], found["edge_nm"]) <= point and found["max_weighted_urad"] <= named.promise_urad
        )
    logger.info(
        "%s, %s, %s: %.3g urad, %.3g nm",
        named.name,
        display.name,
        rays_of,
        found["max_direction_urad"],
        found["max_point_nm"],
    )
    return {
        "configuration": named.name,
        "fraction_bits": named.build.fraction_bits,
        "display": display.name,
        "rays_of": rays_of,
        **found,
        "promise_urad": named.promise_urad,
        "promise_nm": named.promise_nm,
        "kept": kept,
    }


#: Columns of `measure` whose largest counts over several sets of rays. The others are counts, or root mean squares.
MAXIMA = ("max_direction_urad", "max_weighted_urad", "max_point_nm", "edge_nm")


def _chunk(build: Build, display: Display, words: Words) -> dict[str, Any]:
    """Return the columns of `measure` of one chunk, for each root mean square the sum of squares."""
    found = compare(display, build, words)
    turn, shift, weight = found.turn_urad[found.alive], found.shift_nm[found.alive], found.weight[found.alive]
    differs = np.flatnonzero(found.status_differs | found.lenslet_differs)
    lost, edge = 0, 0.0
    if len(differs):
        some, others = Words(*(column[differs] for column in words)), rows_of(found.twin, differs)
        stated = stated_nm(build.fraction_bits)
        away = word_sets.edge_distance_nm(display, build, some, others, stated)
        far = (away > stated) & (others.status == int(Status.MISSED)) & (build.aims or build.viewer or build.converge)
        lost, edge = int(far.sum()), float(away[~far].max(initial=0.0))
    return {
        "rays": len(words.u),
        "refused": int(found.refused.sum()),
        "max_direction_urad": float(turn.max(initial=0.0)),
        "rms_direction_urad": float((turn**2).sum()),
        "max_weighted_urad": float((turn * weight).max(initial=0.0)),
        "max_point_nm": float(shift.max(initial=0.0)),
        "rms_point_nm": float((shift**2).sum()),
        "status_differs": int(found.status_differs.sum()),
        "lenslet_differs": int(found.lenslet_differs.sum()),
        "lost": lost,
        "edge_nm": edge,
        "alive": len(turn),
    }


def rows_of(rays: Rays, rows: Ints) -> Rays:
    """Return some of the rays."""
    return Rays(*(getattr(rays, column.name)[rows] for column in dataclasses.fields(rays)))


def sets_of(build: Build, display: Display, seed: int) -> dict[str, Iterator[Words]]:
    """Return the sets of rays: the frame (of a panel of more than `WHOLE` pixels a sample), and adversarial rays."""
    whole = display.panel.width_px * display.panel.height_px <= WHOLE
    count = min(ADVERSARIAL, WHOLE)
    sets = {
        "frame" if whole else "sample": word_sets.frame_words(display, build, seed, WHOLE),
        "edges": iter([word_sets.edge_words(display, build, seed + 1, count)]),
    }
    if build.aims:
        sets["wide aims"] = iter([word_sets.wide_words(display, build, seed + 2, count)])
        sets["boundaries"] = iter([word_sets.boundary_words(display, build, seed + 3, count // 4)])
    return sets


# ---- budget ----


def budget(named: Named, display: Display, seed: int, count: int = BUDGET) -> list[dict[str, Any]]:
    """Return what each step adds to the error of an exact configuration, over random pixels (and aims in the cell).

    The rows are in the order of the ray. The first is the rounding of the configuration's words, the last the whole.
    Each has how far the step's rounding moves the ray, and under `left_` the error that is left if it were exact.
    """
    build = named.build
    random = np.random.default_rng(seed)
    count = min(count, WHOLE)
    words = Words(*word_sets.random_pixels(display, random, count), *word_sets.cell_aims(display, build, random, count))
    config = configuration(display, build, build.model)
    pixel = pixels_of_words(display, words.u, words.v)
    golden = trace(display, pixel, word_sets.aims_of(display, build, words), build.model)
    turn_back = System.of(display).frame.turn_back
    # Points and directions, in nm and microradian: golden's, and those of each hybrid run.
    runs = [
        np.stack([np.column_stack([*turn_back(*v.T[:2]), v[:, 2]]) * 1e6 for v in (golden.direction, golden.local_mm)])
    ]
    alive = compare(display, build, words).alive
    steps = steps_of(build)
    for point, direction, lenslet in hybrids(build, config, words):
        runs.append(np.stack([direction * 1e6, point * display.array.radius_mm * 1e6]))
        alive &= (lenslet == golden.lenslet).all(axis=1)
    runs = [run[:, alive] for run in runs]

    def row(step: str, share: Floats, left: Floats) -> dict[str, Any]:
        found: dict[str, Any] = {"configuration": named.name, "display": display.name, "stage": step}
        for prefix, moves in (("", share), ("left_", left)):
            for quantity, move in zip(("direction_urad", "point_nm"), moves, strict=True):
                length = np.linalg.norm(move, axis=1)
                found[f"{prefix}max_{quantity}"] = float(length.max())
                found[f"{prefix}rms_{quantity}"] = float((length**2).mean() ** 0.5)
        return found

    total = runs[-1] - runs[0]
    shares = (after - before for before, after in itertools.pairwise(runs))
    rows = [row(step, share, total - share) for step, share in zip(["configuration", *steps], shares, strict=True)]
    return [*rows, row("all", total, 0.0 * total)]


def measure_all(names: tuple[str, ...], scenes: Path, seed: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Measure named configurations (all when none is named) on their displays, and the budgets of the exact ones."""
    errors, steps = [], []
    for named in chosen(names):
        for display in named.displays(scenes):
            sets = sets_of(named.build, display, seed)
            errors += [measure(named, display, rays_of, chunks) for rays_of, chunks in sets.items()]
            steps += budget(named, display, seed) if named.build.model == "exact" else []
    return errors, steps


#: Columns of the report's budget, and those of `budget`.
BUDGETED = {
    "max_urad": "max_direction_urad",
    "rms_urad": "rms_direction_urad",
    "max_nm": "max_point_nm",
    "rms_nm": "rms_point_nm",
    "left_max_urad": "left_max_direction_urad",
    "left_max_nm": "left_max_point_nm",
}


def measure_budget(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Measure the budgets of the plan's configurations, each on the founding paper's display with its grid."""
    rows = []
    for name in plan.budget:
        logger.info("error budget: %s ...", name)
        named = CONFIGURATIONS[name]
        for step in budget(named, named.displays(scenes)[0], seed, min(BUDGET, plan.rays)):
            values = {column: Measured(step[key]) for column, key in BUDGETED.items()}
            rows.append({"configuration": name, "display": step["display"], "step": step["stage"], **values})
    return Figures("report-budget", ("configuration", "display", "step"), rows)
