"""Measures the twin's error against golden, over frames and adversarial sets of rays (`tools.bench fixed`)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from lippmann.conformance import ray_sets
from lippmann.conformance.engine_report import logger
from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words, words_of_aims, words_of_pixels
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.ray_start import lenslet_hex, lenslet_square, pixel_to_lattice
from lippmann.fixed.words import PIXEL_FRACTION, WIDEST, Bools, Ints
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.model_choice import in_cells_mm, located, panel_size, pixels_from_cells
from lippmann.optics.rays import Floats, Model, Rays, Status, gets_through
from lippmann.optics.system import System

from tools.named_builds import Named

#: Number of rays in each adversarial set, and number of rays for the error budget.
ADVERSARIAL, BUDGET = 200_000, 200_000
#: Maximum pixels of a completely traced panel; rays in the sample of a larger panel; rays traced at once.
WHOLE, SAMPLE, CHUNK = 2400 * 2400, 2_000_000, 250_000
#: Displacements of a ray that are tried to find an edge, in units of the stated error.
REACHES = tuple(2.0**k for k in range(-6, 7))


class Comparison(NamedTuple):
    """The comparison of N rays of the twin with golden's rays: the twin's rays, and arrays (N,)."""

    twin: Rays
    #: Angle between the directions, microradian, and the angle's weight min(1, 2 cos theta_t), where theta_t is the
    #: angle of golden's exit ray to the normal of the last face.
    turn_urad: Floats
    weight: Floats
    #: Distance between the lens-local exit points, nm.
    shift_nm: Floats
    #: Whether a ray leaves through the same lenslet, with the same status, in both engines.
    alive: Bools
    #: Whether a ray's status differs, and whether its first or last lenslet differs.
    status_differs: Bools
    lenslet_differs: Bools
    #: Whether a ray is too oblique for the words: the twin reports a miss, and the ray is not compared.
    refused: Bools


def stated_nm(fraction_bits: int) -> float:
    """Return the stated error of exit points, nm: 2 nm for the widest build, and twice as much for each bit less."""
    return float(2 ** (1 + WIDEST - fraction_bits))


def compare(display: Display, build: Build, words: Words) -> Comparison:
    """Trace rays with the twin and with golden, and return the comparison."""
    model, f = build.model, build.fraction_bits
    config = configuration(display, build, model)
    pixel = pixels_of_words(display, words.u, words.v)
    twin = rays_of_words(display, pixel, ray_pipeline(*words, config, build), f)
    golden = trace(display, pixel, aims_of(display, build, words), model)
    refused = too_slanted(display, build, words) & (twin.status == int(Status.MISSED))
    status = (twin.status != golden.status) & ~refused
    starts = np.stack(twin_start(display, build, words.u, words.v), axis=1)
    same = (starts == golden_start(display, pixel)) & (twin.lenslet == golden.lenslet)
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
    """Return the cosines (N,) of exit rays to the last face's normal."""
    if not domes or display.array.plano_side == "viewer":
        return np.abs(rays.direction[:, 2])
    normal = rays.local_mm / display.array.radius_mm + (0.0, 0.0, 1.0)
    return np.asarray(np.abs((normal * rays.direction).sum(axis=1)))


def measure(variant: Named, display: Display, rays_of: str, chunks: Iterator[Words]) -> dict[str, Any]:
    """Measure a set of rays, given in chunks; return the set's row.

    `refused` rays were not compared. The errors of direction (microradian; `weighted`: times min(1, 2 cos theta_t)) and
    exit point (nm) are those of rays that leave through the same lenslet in both engines; `status_differs` and
    `lenslet_differs` count differing rays. The twin reports a miss for `lost` rays, which would meet more domes than
    the build tries. `edge_nm` is the largest distance of a differing ray that is not lost to the edge where golden's
    fate (see `fates`) becomes the twin's. `kept`: whether errors are within the configuration's promise, or None.
    """
    parts = [_chunk(variant.build, display, words) for words in chunks]
    row = {key: (max if key in MAXIMA else sum)(part[key] for part in parts) for key in parts[0]}
    alive = max(row.pop("alive"), 1)
    for key in ("rms_direction_urad", "rms_point_nm"):
        row[key] = float(np.sqrt(row[key] / alive))
    is_kept = None
    if variant.promise_urad is not None:
        point = stated_nm(variant.build.fraction_bits) if variant.promise_nm is None else variant.promise_nm
        is_kept = max(row["max_point_nm"], row["edge_nm"]) <= point and row["max_weighted_urad"] <= variant.promise_urad
    largest = row["max_direction_urad"], row["max_point_nm"]
    logger.info("%s, %s, %s: %.3g urad, %.3g nm", variant.name, display.name, rays_of, *largest)
    keys = {"configuration": variant.name, "fraction_bits": variant.build.fraction_bits, "display": display.name}
    promise = {"promise_urad": variant.promise_urad, "promise_nm": variant.promise_nm, "kept": is_kept}
    return {**keys, "rays_of": rays_of, **row, **promise}


#: Columns of `measure` whose values for several sets of rays are combined by maximum, not by sum.
MAXIMA = ("max_direction_urad", "max_weighted_urad", "max_point_nm", "edge_nm")


def _chunk(build: Build, display: Display, words: Words) -> dict[str, Any]:
    """Return the columns of `measure` for one chunk of rays, with sums of squares instead of root mean squares."""
    result = compare(display, build, words)
    turn, shift, weight = (column[result.alive] for column in (result.turn_urad, result.shift_nm, result.weight))
    differs = np.flatnonzero(result.status_differs | result.lenslet_differs)
    lost, edge = 0, 0.0
    if len(differs):
        some, others = Words(*(column[differs] for column in words)), rows_of(result.twin, differs)
        stated = stated_nm(build.fraction_bits)
        away = edge_distance_nm(display, build, some, others, stated)
        far = (away > stated) & (others.status == int(Status.MISSED)) & (build.aims or build.viewer or build.converge)
        lost, edge = int(far.sum()), float(away[~far].max(initial=0.0))
    row: dict[str, Any] = {"rays": len(words.u), "refused": int(result.refused.sum())}
    row |= {"max_direction_urad": float(turn.max(initial=0.0))}
    row |= {"rms_direction_urad": float((turn**2).sum()), "max_weighted_urad": float((turn * weight).max(initial=0.0))}
    row |= {"max_point_nm": float(shift.max(initial=0.0)), "rms_point_nm": float((shift**2).sum())}
    row |= {"status_differs": int(result.status_differs.sum()), "lenslet_differs": int(result.lenslet_differs.sum())}
    return {**row, "lost": lost, "edge_nm": edge, "alive": len(turn)}


def rows_of(rays: Rays, rows: Ints) -> Rays:
    """Return the rays with the given indices."""
    return Rays(*(getattr(rays, column.name)[rows] for column in dataclasses.fields(rays)))


def sets_of(build: Build, display: Display, seed: int) -> dict[str, Iterator[Words]]:
    """Return sets of rays: all pixels of the frame (above `WHOLE` pixels, a sample), and adversarial rays."""
    is_small = display.panel.width_px * display.panel.height_px <= WHOLE
    count = min(ADVERSARIAL, WHOLE)
    sets = {
        "frame" if is_small else "sample": frame_words(display, build, seed, WHOLE),
        "edges": iter([edge_words(display, build, seed + 1, count)]),
    }
    if build.aims:
        sets["wide aims"] = iter([wide_words(display, build, seed + 2, count)])
        sets["boundaries"] = iter([boundary_words(display, build, seed + 3, count // 4)])
    return sets


class Words(NamedTuple):
    """N rays in the pipeline's words: pixels (u, v) and aperture points (a, b), which are 0 for chief rays."""

    u: Ints
    v: Ints
    a: Ints
    b: Ints


def frame_words(display: Display, build: Build, seed: int, max_pixels: int) -> Iterator[Words]:
    """Yield chunks of words of all pixel centres or, above `max_pixels` pixels, of `SAMPLE` random centres."""
    random = np.random.default_rng(seed)
    panel = display.panel
    count = panel.width_px * panel.height_px
    is_small = count <= max_pixels
    total = count if is_small else min(SAMPLE, max_pixels)
    for start in range(0, total, CHUNK):
        size = min(CHUNK, total - start)
        index = np.arange(start, start + size) if is_small else random.integers(0, count, size)
        row, column = np.divmod(index, panel.width_px)
        u, v = words_of_pixels(display, np.stack([column, row], axis=1) + 0.5)
        yield Words(u, v, *cell_aims(display, build, random, size))


def edge_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return rays from pixels within 1/16 pixel of edges and vertices of cells, with aims near edges and vertices."""
    random = np.random.default_rng(seed)
    lenslets, _ = located(display, pixels_of_words(display, *random_pixels(display, random, count)))
    edge, aimed = (ray_sets.edge_points(display, random, count, vertices=0.25) for _ in range(2))
    size = panel_size(display)
    near = words_of_pixels(display, np.clip(pixels_from_cells(display, lenslets, edge), 0.0, size))
    limit = size.astype(np.int64)[:, None] << (PIXEL_FRACTION - 1)
    u, v = np.clip(near + random.integers(-1, 2, (2, count)), -limit, limit)
    if not build.aims:
        return Words(u, v, 0 * u, 0 * u)
    a, b = words_of_aims(display, aimed, build.fraction_bits) + random.integers(-2, 3, (2, count))
    return Words(u, v, a, b)


def wide_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return rays from random pixels, with aims up to 1.5 pitches from the lenslet's centre."""
    random = np.random.default_rng(seed)
    reach = 3 << (build.fraction_bits - 1)
    a, b = random.integers(-reach, reach + 1, (2, count))
    return Words(*random_pixels(display, random, count), a, b)


def boundary_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Find by bisection aims at which golden's `fates` change; return pairs of rays whose aims are one unit apart."""
    random = np.random.default_rng(seed)
    reach = 3 << (build.fraction_bits - 1)
    u, v = random_pixels(display, random, count)
    low, high = random.integers(-reach, reach + 1, (2, 2, count))
    pixel = pixels_of_words(display, u, v)

    def fates_of(a: Ints, b: Ints) -> Ints:
        return fates(display, build.model, pixel, aims_of_words(display, a, b, build.fraction_bits))

    fate_of_low = fates_of(*low)
    for _ in range(build.fraction_bits + 2):
        middle = (low + high) >> 1
        like_low = (fates_of(*middle) == fate_of_low).all(axis=1)
        low, high = np.where(like_low, (middle, high), (low, middle))
    differ = (fates_of(*high) != fate_of_low).any(axis=1)
    return Words(*np.tile([u[differ], v[differ]], 2), *np.concatenate([low[:, differ], high[:, differ]], axis=1))


def random_pixels(display: Display, random: np.random.Generator, count: int) -> tuple[Ints, Ints]:
    """Return the words (u, v) of random pixels."""
    return words_of_pixels(display, ray_sets.random_pixels(display, random, count))


def cell_aims(display: Display, build: Build, random: np.random.Generator, count: int) -> tuple[Ints, Ints]:
    """Return words of random points of a cell, or zeros for a build without aims."""
    points = ray_sets.random_aims(display, random, count) if build.aims else np.zeros((count, 2))
    return words_of_aims(display, points, build.fraction_bits)


def too_slanted(display: Display, build: Build, words: Words) -> ray_sets.Bools:
    """Return which rays are too oblique for the words, so that the twin reports a miss (rtl/optics/lipp_aim.sv).

    Such rays start at least 2 pitches or rows from the aimed lenslet's centre or, without `converge`, from the aim.
    """
    if not build.aims:
        return np.zeros(len(words.u), np.bool_)
    array, lattice = display.array, System.of(display).lattice
    start = in_cells_mm(display, pixels_of_words(display, words.u, words.v))
    aim = aims_of_words(display, words.a, words.b, build.fraction_bits)
    i, j, _, _ = lattice.locate(NumpyBackend(), *aim.T)
    centre = np.stack(lattice.centre(i, j), axis=1)
    if build.converge:
        aim = centre
    # On the boundary, the twin may trace a ray or report it as missed.
    limit = (2.0 - np.ldexp(1.0, 2 - build.fraction_bits)) * np.array([array.pitches_mm[0], array.row_pitch_mm])
    apart = centre - start
    beyond = np.abs(apart - np.outer(apart[:, 1], (array.shear, 0.0))) >= limit
    # After the step `shear`, words have four times the range, and points are measured along perpendicular axes.
    upright = 4.0 * limit if build.shear else limit
    return np.asarray((beyond | (np.abs(apart) >= upright) | (np.abs(aim - start) >= upright)).any(axis=1))


def aims_of(display: Display, build: Build, words: Words) -> Floats | None:
    """Return the aperture points of words, (N, 2), mm, or None for a build without aims."""
    return aims_of_words(display, words.a, words.b, build.fraction_bits) if build.aims else None


def fates(display: Display, model: Model, pixel: Floats, aims: Floats | None) -> Ints:
    """Return the fates of rays in golden, (N, 5): status, exit lenslet (i, j), start lenslet (i, j)."""
    rays = trace(display, pixel, aims, model)
    return np.column_stack([rays.status, rays.lenslet, golden_start(display, pixel)]).astype(np.int64)


def twin_start(display: Display, build: Build, u: Ints, v: Ints) -> tuple[Ints, Ints]:
    """Return the lenslets (i, j) whose cells contain pixels, as the twin computes them."""
    c, f = configuration(display, build, build.model), build.fraction_bits
    x, _ = pixel_to_lattice(u, v, c.x_from_u, c.x_from_v, c.x_offset, f)
    y, _ = pixel_to_lattice(u, v, c.y_from_u, c.y_from_v, c.y_offset, f)
    i, j, *_ = (lenslet_hex if build.grid == "hex" else lenslet_square)(x, y, f)
    return i, j


def golden_start(display: Display, pixel: Floats) -> Ints:
    """Return the lenslets (N, 2) whose cells contain pixels, as golden computes them."""
    return located(display, pixel)[0].astype(np.int64)


def edge_distance_nm(
    display: Display, build: Build, words: Words, twin: Rays, stated: float, model: Model | None = None
) -> Floats:
    """Return the distances (N,), nm, of rays from the edge where golden's fate (see `fates`) becomes the twin's.

    Each ray is moved on the panel, at the aperture, or both, in eight directions, until golden's fate equals the
    twin's. The edge is a cell's edge or the critical angle. A ray for which the twin reports a miss, which golden
    almost never does, is moved until golden's fate changes in any way. The distance is infinite if no displacement
    changes the fate. `model` is the build's model by default.
    """
    pixel = pixels_of_words(display, words.u, words.v)
    aims = aims_of(display, build, words)
    model = model or build.model
    own = fates(display, model, pixel, aims)
    theirs = np.column_stack([twin.status, twin.lenslet, *twin_start(display, build, words.u, words.v)])
    lost = twin.status == int(Status.MISSED)
    distance = np.full(len(pixel), np.inf)
    turn = np.radians(22.5 + 45.0 * np.arange(8))
    ways = [(p, q) for p, q in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)) if p or aims is not None]
    for reach in REACHES:
        step_mm = reach * stated * 1e-6
        for angle in turn:
            unit = np.array([np.cos(angle), np.sin(angle)])
            for on_panel, at_aim in ways:
                # Pixel rows are numbered downwards.
                moved = pixel + on_panel * step_mm / np.array(display.panel.pitches_mm) * unit * (1.0, -1.0)
                fate = fates(display, model, moved, None if aims is None else aims + at_aim * step_mm * unit)
                same = np.where(lost, (fate != own).any(axis=1), (fate == theirs).all(axis=1))
                distance[same] = np.minimum(distance[same], reach * stated)
    return distance
