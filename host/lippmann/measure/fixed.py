"""Error of the fixed-point pipeline against golden, and its budget by step (`lippmann bench fixed`).

The twin is measured: the RTL gives the same words, bit for bit. Golden traces the rays that the words represent: pixel
coordinates in 1/16 pixel, aperture points in the configuration's own words.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.conditioning.word_sets import (
    Words,
    aims_of,
    boundary_words,
    cell_aims,
    edge_distance_nm,
    edge_words,
    frame_words,
    golden_start,
    random_pixels,
    too_slanted,
    twin_start,
    wide_words,
)
from lippmann.display import Display
from lippmann.engines import trace
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import pixels_of_words, rays_of_words
from lippmann.fixed.named_builds import CONFIGURATIONS, Named, chosen
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import WIDEST, Ints
from lippmann.measure.figures import Figures, Measured
from lippmann.measure.plan import Plan
from lippmann.measure.stages import hybrid, stages_of
from lippmann.optics.rays import Floats, Rays, Status, gets_through
from lippmann.optics.system import System

Bools = npt.NDArray[np.bool_]

#: Rays of each adversarial set, and of the budget.
ADVERSARIAL, BUDGET = 200_000, 200_000
#: Panels up to this many pixels are traced whole.
WHOLE = 2400 * 2400


@dataclass(frozen=True)
class Comparison:
    """N rays of the twin compared with golden's."""

    #: (N,) angle between the directions, microradian.
    turn_urad: Floats
    #: (N,) min(1, 2 cos theta_t); theta_t is the angle between exit ray and last face's normal, by golden.
    weight: Floats
    #: (N,) distance between the exit points, lens-local, nm.
    shift_nm: Floats
    #: (N,) rays that leave through the same lenslet with the same status in both.
    alive: Bools
    #: (N,) rays whose status differs; rays whose first or last lenslet differs.
    status_differs: Bools
    lenslet_differs: Bools
    #: (N,) rays too slanted for the words. The twin calls them missed; they are not compared.
    refused: Bools

    @property
    def differs(self) -> Bools:
        """(N,) rays whose fate differs."""
        return self.status_differs | self.lenslet_differs


@dataclass(frozen=True)
class FixedError:
    """One row of the report: a configuration, a display, a set of rays.

    `refused` counts the rays that were not compared. The errors of direction (microradian; `weighted`: times
    min(1, 2 cos theta_t)) and exit point (nm) are over the rays that leave by the same lenslet in both.
    `status_differs` and `lenslet_differs` count the others. Of these, `lost` counts rays that the twin calls missed
    because they would meet more domes than the build tries. `edge_nm` is the distance of the farthest of the rest from
    the edge where golden's fate changes to the twin's (infinite: farther than was tried).
    """

    configuration: str
    fraction_bits: int
    display: str
    rays_of: str
    rays: int
    refused: int
    max_direction_urad: float
    rms_direction_urad: float
    max_weighted_urad: float
    max_point_nm: float
    rms_point_nm: float
    status_differs: int
    lenslet_differs: int
    lost: int
    edge_nm: float
    promise_urad: float | None
    promise_nm: float | None

    @property
    def kept(self) -> bool | None:
        """Whether the errors stay within the configuration's promise; None when it has none."""
        if self.promise_urad is None:
            return None
        point = self.promise_nm if self.promise_nm is not None else stated_nm(self.fraction_bits)
        return self.max_weighted_urad <= self.promise_urad and self.max_point_nm <= point and self.edge_nm <= point


@dataclass(frozen=True)
class StageError:
    """One row of the budget: how far a step's rounding moves the ray, and the whole error if this step were exact."""

    configuration: str
    display: str
    stage: str
    max_direction_urad: float
    rms_direction_urad: float
    max_point_nm: float
    rms_point_nm: float
    left_max_direction_urad: float
    left_rms_direction_urad: float
    left_max_point_nm: float
    left_rms_point_nm: float


def stated_nm(fraction_bits: int) -> float:
    """Return the exit point's stated error, nm: 2 at the widest, twice that for each bit less."""
    return float(2 ** (1 + WIDEST - fraction_bits))


# ---- comparison ----


def compare(display: Display, build: Build, words: Words) -> tuple[Comparison, Rays]:
    """Trace rays with the twin and with golden; returns how they differ, and the twin's rays."""
    model, f = build.model, build.fraction_bits
    config = configuration(display, build, model)
    pixel = pixels_of_words(display, words.u, words.v)
    twin = rays_of_words(display, pixel, ray_pipeline(*words, config, build), f)
    golden = trace(display, pixel, aims_of(display, build, words), model)
    refused = too_slanted(display, build, words) & (twin.status == int(Status.MISSED))
    status = (twin.status != golden.status) & ~refused
    start = np.stack(twin_start(display, build, words.u, words.v), axis=1) != golden_start(display, pixel)
    lenslet = (start | (twin.lenslet != golden.lenslet)).any(axis=1) & ~refused
    return Comparison(
        turn_urad=np.linalg.norm(twin.direction - golden.direction, axis=1) * 1e6,
        weight=np.minimum(1.0, 2.0 * exit_cosine(display, golden, model == "exact")),
        shift_nm=np.linalg.norm(twin.local_mm - golden.local_mm, axis=1) * 1e6,
        alive=~status & ~lenslet & ~refused & gets_through(golden.status),
        status_differs=status,
        lenslet_differs=lenslet,
        refused=refused,
    ), twin


def exit_cosine(display: Display, rays: Rays, domes: bool) -> Floats:
    """Return the cosine between exit rays and the last face's normal, (N,): the dome's, or else the axis."""
    if not domes or display.array.plano_side == "viewer":
        return np.abs(rays.direction[:, 2])
    normal = rays.local_mm / display.array.radius_mm + (0.0, 0.0, 1.0)
    cosine: Floats = np.abs((normal * rays.direction).sum(axis=1))
    return cosine


def measure(
    named: Named, display: Display, rays_of: str, chunks: Iterator[Words], log: Callable[[str], None] | None = None
) -> FixedError:
    """Measure one row over chunks of rays."""
    build = named.build
    stated = stated_nm(build.fraction_bits)
    count = refused = alive = status = lenslet = lost = 0
    most = np.zeros(3)
    squares = np.zeros(2)
    edge = 0.0
    for words in chunks:
        found, twin = compare(display, build, words)
        good, differs = found.alive, np.flatnonzero(found.differs)
        turn, shift = found.turn_urad[good], found.shift_nm[good]
        count, alive = count + len(words.u), alive + len(turn)
        refused += int(found.refused.sum())
        status, lenslet = status + int(found.status_differs.sum()), lenslet + int(found.lenslet_differs.sum())
        if len(turn):
            most = np.maximum(most, [turn.max(), (turn * found.weight[good]).max(), shift.max()])
            squares += (turn**2).sum(), (shift**2).sum()
        if len(differs):
            some, others = Words(*(column[differs] for column in words)), _rows(twin, differs)
            away = edge_distance_nm(display, build, some, others, stated)
            far = (away > stated) & (others.status == int(Status.MISSED)) & (build.aims or build.viewer)
            lost += int(far.sum())
            edge = max(edge, float(away[~far].max(initial=0.0)))
    rms = np.sqrt(squares / max(alive, 1))
    row = FixedError(
        configuration=named.name,
        fraction_bits=build.fraction_bits,
        display=display.name,
        rays_of=rays_of,
        rays=count,
        refused=refused,
        max_direction_urad=float(most[0]),
        rms_direction_urad=float(rms[0]),
        max_weighted_urad=float(most[1]),
        max_point_nm=float(most[2]),
        rms_point_nm=float(rms[1]),
        status_differs=status,
        lenslet_differs=lenslet,
        lost=lost,
        edge_nm=edge,
        promise_urad=named.promise_urad,
        promise_nm=named.promise_nm,
    )
    if log is not None:
        log(f"{named.name}, {display.name}, {rays_of}: {row.max_direction_urad:.3g} urad, {row.max_point_nm:.3g} nm")
    return row


def _rows(rays: Rays, rows: Ints) -> Rays:
    return Rays(*(getattr(rays, column.name)[rows] for column in dataclasses.fields(rays)))


def measure_configuration(
    named: Named, scenes: Path, seed: int, log: Callable[[str], None] | None = None
) -> list[FixedError]:
    """Measure a configuration on its displays: frames (panels of up to `WHOLE` pixels whole), and adversarial rays."""
    build, rows = named.build, []
    count = min(ADVERSARIAL, WHOLE)
    for display in named.displays(scenes):
        whole = display.panel.width_px * display.panel.height_px <= WHOLE
        sets = {
            "frame" if whole else "sample": frame_words(display, build, seed, WHOLE),
            "edges": iter([edge_words(display, build, seed + 1, count)]),
        }
        if build.aims:
            sets["wide aims"] = iter([wide_words(display, build, seed + 2, count)])
            sets["boundaries"] = iter([boundary_words(display, build, seed + 3, count // 4)])
        rows += [measure(named, display, name, chunks, log) for name, chunks in sets.items()]
    return rows


# ---- budget ----


def budget(named: Named, display: Display, seed: int, count: int = BUDGET) -> list[StageError]:
    """Return what each step adds to the error of an exact configuration, over random pixels (and aims in the cell).

    The rows are in the order of the ray. The first is the rounding of the configuration's words, the last the whole.
    """
    build, f = named.build, named.build.fraction_bits
    random = np.random.default_rng(seed)
    count = min(count, WHOLE)
    words = Words(*random_pixels(display, random, count), *cell_aims(build, random, count))
    config = configuration(display, build, build.model)
    stages = stages_of(build, config)
    start = {"u": words.u, "v": words.v, **({"a": words.a, "b": words.b} if build.aims else {})}

    pixel = pixels_of_words(display, words.u, words.v)
    golden = trace(display, pixel, aims_of(display, build, words), build.model)
    frame = System.of(display).frame
    place = np.column_stack([*frame.turn_back(*golden.local_mm.T[:2]), golden.local_mm[:, 2]])
    way = np.column_stack([*frame.turn_back(*golden.direction.T[:2]), golden.direction[:, 2]])
    runs = [(way, place)]
    alive = compare(display, build, words)[0].alive
    for cut in range(len(stages) + 1):
        out = hybrid(stages, cut, start, f)
        runs.append(
            (
                np.column_stack([out[f"out_d{axis}"] for axis in "xyz"]),
                np.column_stack([out[f"out_{axis}"] for axis in "xyz"]) * display.array.radius_mm,
            )
        )
        alive &= (out["i"] == golden.lenslet[:, 0]) & (out["j"] == golden.lenslet[:, 1])

    def figures(move: tuple[Floats, Floats]) -> tuple[float, float, float, float]:
        turn, shift = (np.linalg.norm(vector[alive], axis=1) * 1e6 for vector in move)
        largest, squares = (turn.max(), shift.max()), ((turn**2).mean(), (shift**2).mean())
        return float(largest[0]), float(squares[0] ** 0.5), float(largest[1]), float(squares[1] ** 0.5)

    total = (runs[-1][0] - way, runs[-1][1] - place)
    rows = []
    for name, before, after in zip(
        ["configuration", *(stage.name for stage in stages)], runs[:-1], runs[1:], strict=True
    ):
        share = (after[0] - before[0], after[1] - before[1])
        left = (total[0] - share[0], total[1] - share[1])
        rows.append(StageError(named.name, display.name, name, *figures(share), *figures(left)))
    rows.append(StageError(named.name, display.name, "all", *figures(total), 0.0, 0.0, 0.0, 0.0))
    return rows


def measure_all(
    names: tuple[str, ...], scenes: Path, seed: int, log: Callable[[str], None]
) -> tuple[list[FixedError], list[StageError]]:
    """Measure named configurations (all when none is named) on their displays, and the budgets of the exact ones."""
    errors, steps = [], []
    for named in chosen(names):
        errors += measure_configuration(named, scenes, seed, log)
        for display in named.displays(scenes) if named.build.model == "exact" else []:
            steps += budget(named, display, seed)
    return errors, steps


#: Fields of `StageError` in the report's budget. Its columns leave out "direction" and "point".
BUDGETED = (
    *("max_direction_urad", "rms_direction_urad", "max_point_nm", "rms_point_nm"),
    *("left_max_direction_urad", "left_max_point_nm"),
)


def measure_budget(scenes: Path, plan: Plan, seed: int, log: Callable[[str], None]) -> Figures:
    """Measure the budgets of the plan's configurations, each on the founding paper's display with its grid."""
    columns = {re.sub("direction_|point_", "", name): name for name in BUDGETED}
    rows = []
    for name in plan.budget:
        log(f"error budget: {name} ...")
        named = CONFIGURATIONS[name]
        for step in budget(named, named.displays(scenes)[0], seed, min(BUDGET, plan.rays)):
            values = {column: Measured(getattr(step, field)) for column, field in columns.items()}
            rows.append({"configuration": name, "display": step.display, "step": step.stage, **values})
    return Figures("report-budget", ("configuration", "display", "step"), rows)
