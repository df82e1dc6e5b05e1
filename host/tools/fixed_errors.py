"""Error of the fixed-point pipeline against golden, over easy and adversarial sets of rays (`tools.bench fixed`).

The twin is measured: the RTL gives the same words, bit for bit. Golden traces the rays that the words represent: pixel
coordinates in 1/16 pixel, aperture points in the configuration's own words.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from lippmann.conformance import ray_sets
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

logger = logging.getLogger("lippmann.report")
#: Rays of each adversarial set, and of the budget.
ADVERSARIAL, BUDGET = 200_000, 200_000
#: Panels up to this many pixels are traced whole.
WHOLE = 2400 * 2400
#: Rays traced at a time.
CHUNK = 250_000
#: Rays of the sample of a panel that is not traced whole.
SAMPLE = 2_000_000
#: Displacements that are tried in search of an edge: from 1/64 of the stated error to 64 times it.
REACHES = tuple(2.0**k for k in range(-6, 7))


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
    """Return the cosine between exit rays and the last face's normal, (N,): the dome's, or else the axis."""
    if not domes or display.array.plano_side == "viewer":
        return np.abs(rays.direction[:, 2])
    normal = rays.local_mm / display.array.radius_mm + (0.0, 0.0, 1.0)
    cosine: Floats = np.abs((normal * rays.direction).sum(axis=1))
    return cosine


def measure(named: Named, display: Display, rays_of: str, chunks: Iterator[Words]) -> dict[str, Any]:
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
    largest = found["max_direction_urad"], found["max_point_nm"]
    logger.info("%s, %s, %s: %.3g urad, %.3g nm", named.name, display.name, rays_of, *largest)
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
        away = edge_distance_nm(display, build, some, others, stated)
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
        "frame" if whole else "sample": frame_words(display, build, seed, WHOLE),
        "edges": iter([edge_words(display, build, seed + 1, count)]),
    }
    if build.aims:
        sets["wide aims"] = iter([wide_words(display, build, seed + 2, count)])
        sets["boundaries"] = iter([boundary_words(display, build, seed + 3, count // 4)])
    return sets


# ---- budget ----


class Words(NamedTuple):
    """Rays in the pipeline's words, each (N,): pixels (u, v), and aperture points (a, b), 0 for chief rays."""

    u: Ints
    v: Ints
    a: Ints
    b: Ints


def frame_words(display: Display, build: Build, seed: int, most: int) -> Iterator[Words]:
    """Yield a panel's pixel centres in chunks: all, or `SAMPLE` random ones of a panel of more than `most` pixels.

    A build with aims gets a random point of the lenslet's cell for each.
    """
    random = np.random.default_rng(seed)
    panel = display.panel
    count = panel.width_px * panel.height_px
    whole = count <= most
    total = count if whole else min(SAMPLE, most)
    for start in range(0, total, CHUNK):
        size = min(CHUNK, total - start)
        index = np.arange(start, start + size) if whole else random.integers(0, count, size)
        row, column = np.divmod(index, panel.width_px)
        u, v = words_of_pixels(display, np.stack([column, row], axis=1) + 0.5)
        yield Words(u, v, *cell_aims(display, build, random, size))


def edge_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return pixels on the edges and vertices of cells, within 1/16 pixel, and aims on edges and vertices likewise."""
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
    """Return random pixels with aims up to one and a half pitches away."""
    random = np.random.default_rng(seed)
    reach = 3 << (build.fraction_bits - 1)
    a, b = random.integers(-reach, reach + 1, (2, count))
    return Words(*random_pixels(display, random, count), a, b)


def boundary_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return rays on both sides of boundaries of golden's fates, down to one word of the aim.

    For random pixels, the segment between two aims of different fates is bisected. It ends at a cell's edge on the
    dome, at the critical angle, or at any other boundary of a fate.
    """
    random = np.random.default_rng(seed)
    reach = 3 << (build.fraction_bits - 1)
    u, v = random_pixels(display, random, count)
    low, high = random.integers(-reach, reach + 1, (2, 2, count))
    pixel = pixels_of_words(display, u, v)

    def fates_of(a: Ints, b: Ints) -> Ints:
        return fates(display, build.model, pixel, aims_of_words(display, a, b, build.fraction_bits))

    wanted = fates_of(*low)
    for _ in range(build.fraction_bits + 2):
        middle = (low + high) >> 1
        like_low = (fates_of(*middle) == wanted).all(axis=1)
        low = np.where(like_low, middle, low)
        high = np.where(like_low, high, middle)
    differ = (fates_of(*high) != wanted).any(axis=1)
    return Words(*np.tile([u[differ], v[differ]], 2), *np.concatenate([low[:, differ], high[:, differ]], axis=1))


def random_pixels(display: Display, random: np.random.Generator, count: int) -> tuple[Ints, Ints]:
    """Return random words of pixels, anywhere on the panel."""
    return words_of_pixels(display, ray_sets.random_pixels(display, random, count))


def cell_aims(display: Display, build: Build, random: np.random.Generator, count: int) -> tuple[Ints, Ints]:
    """Return words of random points of a cell; zeros for chief rays."""
    points = ray_sets.random_aims(display, random, count) if build.aims else np.zeros((count, 2))
    return words_of_aims(display, points, build.fraction_bits)


def too_slanted(display: Display, build: Build, words: Words) -> ray_sets.Bools:
    """Tell which rays the words cannot hold: the pipeline calls them missed by definition (rtl/optics/lipp_aim.sv).

    The start is 2 pitches or rows or more from the aim, or from the centre of the lenslet aimed at. In a build with
    `converge` the latter alone counts, of the point that the line to the eye has in the cell.
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
    # The outermost word may go either way.
    limit = (2.0 - np.ldexp(1.0, 2 - build.fraction_bits)) * np.array([array.pitches_mm[0], array.row_pitch_mm])
    apart = centre - start
    found = np.abs(apart - np.outer(apart[:, 1], (array.shear, 0.0))) >= limit
    # Behind `shear` the words hold four times as much, and points are measured upright.
    upright = 4.0 * limit if build.shear else limit
    return np.asarray((found | (np.abs(apart) >= upright) | (np.abs(aim - start) >= upright)).any(axis=1))


def aims_of(display: Display, build: Build, words: Words) -> Floats | None:
    """Return the aperture points of words, (N, 2), mm; None for a build without aims."""
    return aims_of_words(display, words.a, words.b, build.fraction_bits) if build.aims else None


def fates(display: Display, model: Model, pixel: Floats, aims: Floats | None) -> Ints:
    """Return golden's fates of rays, (N, 5): status, lenslet left through, lenslet started in."""
    rays = trace(display, pixel, aims, model)
    return np.column_stack([rays.status, rays.lenslet, golden_start(display, pixel)]).astype(np.int64)


def twin_start(display: Display, build: Build, u: Ints, v: Ints) -> tuple[Ints, Ints]:
    """Return the lenslet in whose cell the twin sees a pixel."""
    c, f = configuration(display, build, build.model), build.fraction_bits
    x, _ = pixel_to_lattice(u, v, c.x_from_u, c.x_from_v, c.x_offset, f)
    y, _ = pixel_to_lattice(u, v, c.y_from_u, c.y_from_v, c.y_offset, f)
    i, j, *_ = (lenslet_hex if build.grid == "hex" else lenslet_square)(x, y, f)
    return i, j


def golden_start(display: Display, pixel: Floats) -> Ints:
    """Return the lenslet in whose cell golden sees a pixel, (N, 2)."""
    return located(display, pixel)[0].astype(np.int64)


def edge_distance_nm(
    display: Display, build: Build, words: Words, twin: Rays, stated: float, model: Model | None = None
) -> Floats:
    """Return how far rays are, by golden, from the edge where their fate changes to the twin's, (N,), nm.

    Each ray is moved on the panel, at the aperture, or both, in eight directions, until golden gives it the twin's
    fate: the distance to a cell's edge, or to the critical angle, as a length. Golden calls next to no ray missed: a
    ray that the twin calls missed is moved until golden gives it any other fate. The distance is infinite where a
    displacement of 64 times the stated error changes nothing. `model` is the build's by default.
    """
    pixel = pixels_of_words(display, words.u, words.v)
    aims = aims_of(display, build, words)
    model = model or build.model
    own = fates(display, model, pixel, aims)
    wanted = np.column_stack([twin.status, twin.lenslet, *twin_start(display, build, words.u, words.v)])
    lost = twin.status == int(Status.MISSED)
    distance = np.full(len(pixel), np.inf)
    turn = np.radians(22.5 + 45.0 * np.arange(8))
    ways = [(p, q) for p, q in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)) if p or aims is not None]
    for reach in REACHES:
        step_mm = reach * stated * 1e-6
        for angle in turn:
            way = np.array([np.cos(angle), np.sin(angle)])
            for on_panel, at_aim in ways:
                # Rows of pixels go down.
                moved = pixel + on_panel * step_mm / np.array(display.panel.pitches_mm) * way * (1.0, -1.0)
                fate = fates(display, model, moved, None if aims is None else aims + at_aim * step_mm * way)
                same = np.where(lost, (fate != own).any(axis=1), (fate == wanted).all(axis=1))
                distance[same] = np.minimum(distance[same], reach * stated)
    return distance
