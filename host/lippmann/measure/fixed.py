"""`lippmann bench fixed`: error of the fixed-point pipeline against golden, and its budget by step.

The twin is measured: the RTL gives the same words, bit for bit. Golden gets the rays that the words stand for: pixel
coordinates of 1/16 pixel, aperture points in the configuration's own words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.display import Display
from lippmann.engines import trace
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.configurations import Named
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words, words_of_pixels
from lippmann.fixed.lenslet_hex import lenslet_hex
from lippmann.fixed.lenslet_square import lenslet_square
from lippmann.fixed.pixel_to_panel import pixel_to_panel
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import PIXEL_FRACTION, WIDEST, Ints
from lippmann.measure.stages import hybrid, stages_of
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import HALF_SQRT3, Lattice
from lippmann.optics.rays import Floats, Model, Rays, Status, gets_through
from lippmann.optics.system import System
from lippmann.report.tables import table

Bools = npt.NDArray[np.bool_]

#: Rays traced at a time.
CHUNK = 250_000
#: Rays of the adversarial sets, of a panel's sample where it is not traced whole, and of the budget.
ADVERSARIAL, SAMPLE, BUDGET = 200_000, 2_000_000, 200_000
#: Panels up to this many pixels are traced whole.
WHOLE = 2400 * 2400
#: Displacements that are tried in search of an edge: from a 64th of the stated one to 64 times it.
REACHES = tuple(2.0**k for k in range(-6, 7))


class Words(NamedTuple):
    """Rays as the pipeline takes them: pixels (u, v), aperture points (a, b), which are 0 for chief rays."""

    u: Ints
    v: Ints
    a: Ints
    b: Ints


@dataclass(frozen=True)
class Comparison:
    """Rays of twin and golden side by side, N of them.

    Attributes
    ----------
    turn_urad
        (N,) angle between the directions, microradian.
    weight
        (N,) min(1, 2 cos theta_t), theta_t the exit angle to the last face's normal in golden.
    shift_nm
        (N,) distance of the exit points, lens-local, nm.
    alive
        (N,) rays that leave in both, by the same way.
    status_differs, lenslet_differs
        (N,) rays of another status; rays that start in or leave from another lenslet.
    refused
        (N,) rays too slanted for the words, which the twin calls missed; they are not compared.
    """

    turn_urad: Floats
    weight: Floats
    shift_nm: Floats
    alive: Bools
    status_differs: Bools
    lenslet_differs: Bools
    refused: Bools

    @property
    def differs(self) -> Bools:
        """(N,) rays of another fate."""
        return self.status_differs | self.lenslet_differs


@dataclass(frozen=True)
class FixedError:
    """One row of the report: a configuration, a display, a set of rays.

    `rays` traced, of which `refused` were not compared; direction (microradian; `weighted`: times
    min(1, 2 cos theta_t)) and exit point (nm) over those that leave by the same way in both. `status_differs` and
    `lenslet_differs` count others: `lost` are those that the twin calls missed away from any edge, for they would meet
    more domes than the build tries, and `edge_nm` says how far the farthest of the rest is from the edge that parts its
    fate from golden's (infinite: further than was tried).
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
        """Whether the configuration's promise is kept; None when there is none."""
        if self.promise_urad is None:
            return None
        point = self.promise_nm if self.promise_nm is not None else stated_nm(self.fraction_bits)
        return self.max_weighted_urad <= self.promise_urad and self.max_point_nm <= point and self.edge_nm <= point


@dataclass(frozen=True)
class StageError:
    """One row of the budget: what a step moves the ray by, and the error of the whole when this step were exact."""

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


# ---- sets of rays ----


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
        yield Words(u, v, *_cell_aims(build, random, size))


def edge_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return pixels on the edges and vertices of cells, within 1/16 pixel, and aims on edges and vertices likewise."""
    random = np.random.default_rng(seed)
    system = System.of(display)
    corners = _corners(build.grid)

    def on_edges(n: int) -> Floats:
        side = random.integers(0, len(corners), n)
        along = np.where(random.random(n) < 0.25, 0.0, random.random(n))[:, None]
        points: Floats = corners[side] * (1.0 - along) + corners[(side + 1) % len(corners)] * along
        return points

    u, v = _random_pixels(display, random, count)
    pixel = pixels_of_words(display, u, v)
    x, y = system.frame.array_from_panel(*system.frame.panel_from_pixel(*pixel.T))
    i, j, _, _ = system.lattice.locate(NumpyBackend(), x, y)
    cx, cy = system.lattice.centre(i, j)
    edge = on_edges(count) * display.array.pitch_mm
    at = system.frame.panel_from_array(cx + edge[:, 0], cy + edge[:, 1])
    u, v = words_of_pixels(display, np.stack(system.frame.pixel_from_panel(*at), axis=1))
    limit_u = display.panel.width_px << (PIXEL_FRACTION - 1)
    limit_v = display.panel.height_px << (PIXEL_FRACTION - 1)
    u = np.clip(u + random.integers(-1, 2, count), -limit_u, limit_u)
    v = np.clip(v + random.integers(-1, 2, count), -limit_v, limit_v)
    if not build.aims:
        return Words(u, v, 0 * u, 0 * u)
    aims = np.ldexp(on_edges(count) / (1.0, _row(build)), build.fraction_bits)
    near = np.floor(aims + 0.5).astype(np.int64) + random.integers(-2, 3, (count, 2))
    return Words(u, v, near[:, 0], near[:, 1])


def wide_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return random pixels with aims up to one and a half pitches away."""
    random = np.random.default_rng(seed)
    reach = 3 << (build.fraction_bits - 1)
    a, b = random.integers(-reach, reach + 1, (2, count))
    return Words(*_random_pixels(display, random, count), a, b)


def boundary_words(display: Display, build: Build, seed: int, count: int) -> Words:
    """Return rays on both sides of boundaries of golden's fates, down to one word of the aim.

    For pixels at random two aims of different fates are bisected: the boundary is a cell's edge on the dome, the
    critical angle, or whatever else parts the fates.
    """
    random = np.random.default_rng(seed)
    reach = 3 << (build.fraction_bits - 1)
    u, v = _random_pixels(display, random, count)
    low, high = random.integers(-reach, reach + 1, (2, 2, count))
    fate = fates(display, build, u, v, *low)
    for _ in range(build.fraction_bits + 2):
        middle = (low + high) >> 1
        like_low = (fates(display, build, u, v, *middle) == fate).all(axis=1)
        low = np.where(like_low, middle, low)
        high = np.where(like_low, high, middle)
    differ = (fates(display, build, u, v, *high) != fate).any(axis=1)
    both = [np.concatenate([u[differ], u[differ]]), np.concatenate([v[differ], v[differ]])]
    return Words(*both, *np.concatenate([low[:, differ], high[:, differ]], axis=1))


def _row(build: Build) -> float:
    return HALF_SQRT3 if build.grid == "hex" else 1.0


def _corners(grid: str) -> Floats:
    """Return a cell's vertices in order, in pitches, (n, 2)."""
    if grid == "square":
        return np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    turn = np.radians(30.0 + 60.0 * np.arange(6))
    hexagon: Floats = np.stack([np.cos(turn), np.sin(turn)], axis=1) / np.sqrt(3.0)
    return hexagon


def _random_pixels(display: Display, random: np.random.Generator, count: int) -> tuple[Ints, Ints]:
    """Return random words of pixels, anywhere on the panel."""
    panel = display.panel
    pixels = random.uniform((0.0, 0.0), (panel.width_px, panel.height_px), (count, 2))
    return words_of_pixels(display, pixels)


def _cell_aims(build: Build, random: np.random.Generator, count: int) -> tuple[Ints, Ints]:
    """Return words of random points of a cell; zeros for chief rays."""
    if not build.aims:
        return np.zeros(count, np.int64), np.zeros(count, np.int64)
    lattice = Lattice(build.grid, 1.0)
    # A random point of a period of the lattice, moved into the cell around the origin.
    x, y = random.uniform(0.0, 2.0, (2, count)) * np.array([[1.0], [_row(build)]])
    _, _, x, y = lattice.locate(NumpyBackend(), x, y)
    words = np.ldexp(np.stack([x, y / _row(build)]), build.fraction_bits)
    a, b = np.floor(words).astype(np.int64)
    return a, b


# ---- comparison ----


def compare(display: Display, build: Build, words: Words) -> tuple[Comparison, Rays]:
    """Trace rays with the twin and with golden; returns how they differ, and the twin's rays."""
    model, f = build.model, build.fraction_bits
    config = configuration(display, build, model)
    pixel = pixels_of_words(display, words.u, words.v)
    twin = rays_of_words(display, pixel, ray_pipeline(*words, config, build), f)
    golden = trace(display, pixel, _aims(display, build, words), model)
    refused = _too_slanted(display, build, words) & (twin.status == int(Status.MISSED))
    status = (twin.status != golden.status) & ~refused
    start = np.stack(_start(display, build, words.u, words.v), axis=1) != _golden_start(display, pixel)
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


def _too_slanted(display: Display, build: Build, words: Words) -> Bools:
    """Tell which rays the words do not hold, and the pipeline calls missed by definition (rtl/optics/aim.sv).

    Start and aim are 2 pitches or rows apart, or the start and the lenslet aimed at.
    """
    if not build.aims:
        return np.zeros(len(words.u), np.bool_)
    pixel = pixels_of_words(display, words.u, words.v)
    system = System.of(display)
    b = NumpyBackend()
    x, y = system.frame.array_from_panel(*system.frame.panel_from_pixel(*pixel.T))
    _, _, x, y = system.lattice.locate(b, x, y)
    aim_x, aim_y = aims_of_words(display, words.a, words.b, build.fraction_bits).T
    i, j, _, _ = system.lattice.locate(b, aim_x, aim_y)
    cx, cy = system.lattice.centre(i, j)
    slanted = np.zeros(len(pixel), np.bool_)
    # The outermost word may go either way.
    limit = 2.0 - np.ldexp(1.0, 2 - build.fraction_bits)
    for away, unit in ((aim_x - x, 1.0), (aim_y - y, _row(build)), (cx - x, 1.0), (cy - y, _row(build))):
        slanted |= np.abs(away) >= limit * unit * display.array.pitch_mm
    return slanted


def exit_cosine(display: Display, rays: Rays, domes: bool) -> Floats:
    """Return the cosine between exit rays and the last face's normal, (N,): the dome's, or else the axis."""
    if not domes or display.array.plano_side == "viewer":
        return np.abs(rays.direction[:, 2])
    normal = rays.local_mm / display.array.radius_mm + (0.0, 0.0, 1.0)
    cosine: Floats = np.abs((normal * rays.direction).sum(axis=1))
    return cosine


def _aims(display: Display, build: Build, words: Words) -> Floats | None:
    return aims_of_words(display, words.a, words.b, build.fraction_bits) if build.aims else None


def _golden(display: Display, model: Model, pixel: Floats, aims: Floats | None) -> Ints:
    """Return golden's fates, (N, 5): status, lenslet left through, lenslet started in."""
    rays = trace(display, pixel, aims, model)
    return np.column_stack([rays.status, rays.lenslet, _golden_start(display, pixel)]).astype(np.int64)


def _start(display: Display, build: Build, u: Ints, v: Ints) -> tuple[Ints, Ints]:
    """Return the lenslet in whose cell the twin sees a pixel."""
    c, f = configuration(display, build, build.model), build.fraction_bits
    x = pixel_to_panel(u, v, c.x_from_u, c.x_from_v, c.x_offset, f)
    y = pixel_to_panel(u, v, c.y_from_u, c.y_from_v, c.y_offset, f)
    i, j, _, _ = (lenslet_hex if build.grid == "hex" else lenslet_square)(x, y, f)
    return i, j


def _golden_start(display: Display, pixel: Floats) -> Ints:
    """Return the lenslet in whose cell golden sees a pixel, (N, 2)."""
    system = System.of(display)
    x, y = system.frame.array_from_panel(*system.frame.panel_from_pixel(*pixel.T))
    i, j, _, _ = system.lattice.locate(NumpyBackend(), x, y)
    return np.stack([i, j], axis=1).astype(np.int64)


def fates(display: Display, build: Build, u: Ints, v: Ints, a: Ints, b: Ints) -> Ints:
    """Return golden's fates of rays given in words, (N, 5): status, lenslet left through, lenslet started in."""
    aims = aims_of_words(display, a, b, build.fraction_bits)
    return _golden(display, build.model, pixels_of_words(display, u, v), aims)


def edge_distance_nm(
    display: Display, build: Build, words: Words, twin: Rays, stated: float, model: Model | None = None
) -> Floats:
    """Return how far rays are, in golden, from the edge that parts their fate from the twin's, (N,), nm.

    A ray is moved on the panel, at the aperture, or both, in eight directions, until golden gives it the twin's fate:
    the distance to the cell's edge, or to the critical angle, measured as a length. Golden calls next to no ray
    missed; a ray that the twin calls missed is moved until it meets any other dome, or has any other fate.
    Infinite where 64 times the stated error does not do. `model` is the build's when left out.
    """
    pixel = pixels_of_words(display, words.u, words.v)
    aims = _aims(display, build, words)
    model = model or build.model
    own = _golden(display, model, pixel, aims)
    wanted = np.column_stack([twin.status, twin.lenslet, *_start(display, build, words.u, words.v)])
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
                moved = pixel + on_panel * step_mm / display.panel.pixel_pitch_mm * way * (1.0, -1.0)
                fate = _golden(display, model, moved, None if aims is None else aims + at_aim * step_mm * way)
                same = np.where(lost, (fate != own).any(axis=1), (fate == wanted).all(axis=1))
                distance[same] = np.minimum(distance[same], reach * stated)
    return distance


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
    return Rays(
        rays.pixel[rows],
        rays.lenslet[rows],
        rays.centre_mm[rows],
        rays.local_mm[rows],
        rays.direction[rows],
        rays.status[rows],
    )


def measure_configuration(
    named: Named, scenes: Path, seed: int, log: Callable[[str], None] | None = None
) -> list[FixedError]:
    """Measure a configuration on its displays: frames (panels of up to `WHOLE` pixels whole), and adversarial rays."""
    most = WHOLE
    rows = []
    build = named.build
    for display in named.displays(scenes):
        count = min(ADVERSARIAL, most)
        whole = display.panel.width_px * display.panel.height_px <= most
        rows.append(
            measure(named, display, "frame" if whole else "sample", frame_words(display, build, seed, most), log)
        )
        rows.append(measure(named, display, "edges", iter([edge_words(display, build, seed + 1, count)]), log))
        if build.aims:
            rows.append(measure(named, display, "wide aims", iter([wide_words(display, build, seed + 2, count)]), log))
            words = boundary_words(display, build, seed + 3, count // 4)
            rows.append(measure(named, display, "boundaries", iter([words]), log))
    return rows


# ---- budget ----


def budget(named: Named, display: Display, seed: int, count: int = BUDGET) -> list[StageError]:
    """Return what each step adds to the error of an exact configuration, over random pixels (and aims in the cell).

    The rows are in the order of the ray. The first is the rounding of the configuration's words, the last the whole.
    """
    build, f = named.build, named.build.fraction_bits
    random = np.random.default_rng(seed)
    count = min(count, WHOLE)
    words = Words(*_random_pixels(display, random, count), *_cell_aims(build, random, count))
    config = configuration(display, build, build.model)
    stages = stages_of(build, config)
    start = {"u": words.u, "v": words.v, **({"a": words.a, "b": words.b} if build.aims else {})}

    pixel = pixels_of_words(display, words.u, words.v)
    golden = trace(display, pixel, _aims(display, build, words), build.model)
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
        return float(turn.max()), float(_rms(turn)), float(shift.max()), float(_rms(shift))

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


def _rms(values: Floats) -> np.float64:
    return np.float64(np.sqrt((values**2).mean()))


# ---- report ----


def report_text(errors: list[FixedError], shares: list[StageError]) -> str:
    """Return the page of the report."""
    budgets = "".join(
        f"\n### {name}, {display}\n\n{_budget_table([s for s in shares if (s.configuration, s.display) == key])}"
        for key in dict.fromkeys((share.configuration, share.display) for share in shares)
        for name, display in [key]
    )
    return f"""# Error of the fixed-point pipeline
The integer twin, which the RTL equals bit for bit, against golden in float64. Golden traces the rays that the words
stand for. Angles in microradian, lengths in nm, lens-local. `weighted` is the angle times min(1, 2 cos theta_t), with
theta_t the exit angle to the normal of the last face: the widest configurations promise max(1, 0.5 / cos theta_t)
microradian, `weighted` at most 1, and 2 nm. The compact ones promise 60 microradian. Near the critical angle the angle
itself grows without bound, as the derivative of the arcsine does; that is what the weight takes out.

## Rays

| set | rays |
|---|---|
| frame | every pixel's centre of the panel; with aims, to a random point of its cell |
| sample | the same for {SAMPLE} random pixels, of a panel of more than {WHOLE} |
| edges | pixels within 1/16 pixel of edges and vertices of cells; with aims, to edges and vertices within 2 words |
| wide aims | random pixels, aims up to 1.5 pitches and rows from the centre of the own lenslet |
| boundaries | such aims, bisected to neighbouring words at which golden's fate changes: edges, the critical angle |

Counts of rays: `status`, of another status; `lenslet`, that start in or leave from another lenslet; `refused`, with 2
pitches or more from start to aim, which the words do not hold; `lost`, that would meet more domes than the build's Walk
allows. The last two are missed by definition. `edge` is the farthest distance of another ray that differs to the edge
that parts the two fates, measured in golden by moving the ray; twice the next smaller one that was tried.

## Against golden

{_error_table(errors)}
## Budget by step

A ray's first steps are taken in the twin's integers, the others in float64. What moves the ray that leaves when one
step more is taken in integers is that step's share; the shares add up to the whole, ray by ray. `left` is the error of
the whole without this share: the error with this step exact. {BUDGET} random pixels (with aims in the cell).
{budgets}"""


def _error_table(errors: list[FixedError]) -> str:
    return table(
        {
            "configuration": [e.configuration for e in errors],
            "F": [e.fraction_bits for e in errors],
            "display": [e.display for e in errors],
            "set": [e.rays_of for e in errors],
            "rays": [e.rays for e in errors],
            "direction max": [e.max_direction_urad for e in errors],
            "rms": [e.rms_direction_urad for e in errors],
            "weighted max": [e.max_weighted_urad for e in errors],
            "point max": [e.max_point_nm for e in errors],
            "point rms": [e.rms_point_nm for e in errors],
            "status": [e.status_differs for e in errors],
            "lenslet": [e.lenslet_differs for e in errors],
            "edge": [e.edge_nm for e in errors],
            "refused": [e.refused for e in errors],
            "lost": [e.lost for e in errors],
            "promise kept": [e.kept for e in errors],
        }
    )


def _budget_table(shares: list[StageError]) -> str:
    return table(
        {
            "step": [s.stage for s in shares],
            "direction max": [s.max_direction_urad for s in shares],
            "rms": [s.rms_direction_urad for s in shares],
            "left max": [s.left_max_direction_urad for s in shares],
            "left rms": [s.left_rms_direction_urad for s in shares],
            "point max": [s.max_point_nm for s in shares],
            "point rms": [s.rms_point_nm for s in shares],
            "point left max": [s.left_max_point_nm for s in shares],
            "point left rms": [s.left_rms_point_nm for s in shares],
        }
    )
