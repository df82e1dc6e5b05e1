"""Generate hard cases: named sets of numerically difficult rays, some on extreme displays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np

from lippmann.conformance.ray_sets import (
    Bools,
    PanelRays,
    Random,
    WorldRays,
    cell_steps,
    edge_points,
    onset,
    pixels_at,
    random_aims,
    random_directions,
    random_pixels,
    random_sizes,
    unit_vectors,
)
from lippmann.display.description import MAX_SIDE_PX, Display, Pair
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import corners_mm, pixels_from_cells
from lippmann.optics.rays import Floats, Status
from lippmann.optics.system import PanelFrame
from lippmann.optics.trace import FARTHEST_LENSLETS

#: Distances of an aperture point from the point where the status changes, in ulps.
ULPS = (-64, -16, -4, -2, -1, 0, 1, 2, 4, 16, 64)

Sets = Iterator[PanelRays | WorldRays]
Generator = Callable[[Display, Random, int], Sets]


#: Generators of all cases, keyed by name; each docstring describes a case.
CASES: dict[str, Generator] = {}


def _case(make: Generator) -> Generator:
    CASES[make.__name__.replace("_", "-")] = make
    return make


def _of_displays(displays: Callable[[Display], Mapping[str, Display]]) -> Generator:
    @wraps(displays)
    def make(display: Display, random: Random, count: int) -> Sets:
        variants, case = displays(display), displays.__name__.replace("_", "-")
        each = count if len(variants) <= 10 else max(4, count // 3)  # many variants get fewer rays
        for variant, other in variants.items():
            pixels = random_pixels(other, random, each)
            yield PanelRays(f"{case}/{variant}", other, pixels, random_aims(other, random, each))

    return _case(make)


def hard_sets(display: Display, name: str = "all", seed: int = 0, count: int = 24) -> Sets:
    """Yield the sets of the case `name` (or of "all" cases), with about `count` rays each.

    Raises InputError for an unknown case.
    """
    if name != "all" and name not in CASES:
        raise InputError(f"unknown case '{name}'; choose from all, {', '.join(CASES)}")
    for number, (each, case) in enumerate(CASES.items()):
        if name in ("all", each):
            yield from case(display, np.random.default_rng([seed, number]), count)


def changed(display: Display, *, gap_mm: float | None = None, **array: Any) -> Display:
    """Return the display with changed array keys, no glass, and valid thickness and eye distance."""
    thickness_mm = array.pop("thickness_mm", display.array.thickness_mm)
    domes = replace(display.array, **{"glass": None, **array})
    domes = replace(domes, thickness_mm=max(thickness_mm, domes.sag_mm))
    display = replace(display, array=domes, gap_mm=display.gap_mm if gap_mm is None else gap_mm)
    eye_mm = display.viewing_distance_mm
    return display if eye_mm is None else replace(display, viewing_distance_mm=max(eye_mm, display.nearest_eye_mm))


def without_eye(display: Display) -> Display:
    """Return the display for an eye at infinity."""
    return replace(display, viewing_distance_mm=None, viewing_axis_mm=(0.0, 0.0))


def steep(display: Display, share: float = 1.02) -> Display:
    """Return the display with thin, nearly hemispherical lenslets, one pitch from the panel."""
    array = display.array
    return changed(display, radius_mm=share * array.half_diagonal_mm, thickness_mm=0.0, gap_mm=array.coarsest_mm)


def _nudged(points: Floats, random: Random) -> Floats:
    return points + random.integers(-2, 3, points.shape) * np.spacing(points)


def _near_onset(name: str, display: Display, pixels: Floats, aims: Floats) -> PanelRays:
    near = aims[:, None] + np.array(ULPS)[:, None] * np.spacing(np.abs(aims))[:, None]
    return PanelRays(name, display, np.repeat(pixels, len(ULPS), axis=0), near.reshape(-1, 2))


@_case
def chief_ray(display: Display, random: Random, count: int) -> Sets:
    """Test chief rays from the centres of elemental images; for an eye at infinity they are not refracted."""
    lenslets = random.integers(-3, 4, (count, 2))
    at = pixels_from_cells(display, lenslets, np.zeros((count, 2)))
    yield PanelRays("chief-ray", display, np.concatenate([at, _nudged(at, random)]), None)


@_case
def cell_edges(display: Display, random: Random, count: int) -> Sets:
    """Test pixels and aperture points within a few ulps of cell edges: a ray has exactly one lenslet."""
    yield from _on_border("cell-edges", display, random, edge_points(display, random, 2 * count), (1, -2))


@_case
def cell_corners(display: Display, random: Random, count: int) -> Sets:
    """Test pixels and aperture points within a few ulps of cell corners."""
    corners = corners_mm(display.array)
    points = corners[random.integers(0, len(corners), 2 * count)]
    yield from _on_border("cell-corners", display, random, points, (-1, 3))


def _on_border(case: str, display: Display, random: Random, points: Floats, lenslet: tuple[int, int]) -> Sets:
    count = len(points) // 2
    pixels, _ = pixels_at(display, points[:count], lenslet)
    yield PanelRays(f"{case}/pixels", display, _nudged(pixels, random), None)
    aims = _nudged(points[count:], random)
    yield PanelRays(f"{case}/aims", display, random_pixels(display, random, count), aims)


@_case
def cell_ties(display: Display, random: Random, count: int) -> Sets:
    """Test pixels exactly on the edges and corners of cells: the tie rule decides the lenslet."""
    del random
    square = replace(display.panel, width_px=400, height_px=320, pixel_pitch_mm=0.0625)
    plain = changed(display, shear=0.0, extent_mm=None, rotation_deg=0.0, offset_mm=(0.0, 0.0))
    tied = replace(without_eye(changed(plain, pitch_mm=1.0, radius_mm=1.5, gap_mm=0.5)), panel=square)
    steps = np.arange(-math.isqrt(count), math.isqrt(count) + 1) / 2.0
    rows = steps if display.array.grid == "square" else steps / 16.0
    x, y = (axis.ravel() for axis in np.meshgrid(steps, rows))
    yield PanelRays("cell-ties", tied, np.stack([200.0 + 16.0 * x, 160.0 - 16.0 * y], axis=1), None)


@_case
def grazing_launch(display: Display, random: Random, count: int) -> Sets:
    """Test rays that leave the panel at ever smaller angles to it, down to twice the engines' limit."""
    pixels = random_pixels(display, random, count)
    # Half of FARTHEST_LENSLETS leaves room for rounding and tolerances.
    farthest = 0.5 * FARTHEST_LENSLETS * display.array.finest_mm / display.aperture_distance_mm
    far = display.aperture_distance_mm * random_sizes(random, 1.0, min(1e8, farthest), count)
    yield PanelRays("grazing-launch", display, pixels, far * random_directions(random, count))


def _flips(
    display: Display, random: Random, count: int, status: Status, reach: float = 1.5, centres: bool = False
) -> tuple[Floats, Floats, Floats]:
    def has(aims: Floats) -> Bools:
        return np.asarray(trace(display, pixels, aims).status == int(status))

    many = 400 * count
    pixels = pixels_at(display, random_aims(display, random, many))[0]
    if centres:  # pixel centres are exact in every word length
        pixels = np.floor(pixels) + 0.5
    inner = random_aims(display, random, many)
    outer = random_aims(display, random, many, reach)
    mixed = np.flatnonzero(~has(inner) & has(outer))[:count]
    pixels, inner = pixels[mixed], inner[mixed]
    return pixels, onset(inner, outer[mixed], has), inner


@_case
def total_reflection(display: Display, random: Random, count: int) -> Sets:
    """Test aperture points within 64 ulps of total reflection, in steep, high-index lenslets."""
    dense = changed(steep(display), index=1.9)
    pixels, aims, _ = _flips(dense, random, max(2, count // 4), Status.INTERNAL_REFLECTION)
    yield _near_onset("total-reflection", dense, pixels, aims)


@_case
def grazing_exit(display: Display, random: Random, count: int) -> Sets:
    """Test rays that leave the last face at ever smaller angles to it, almost at total internal reflection.

    Rays of the second set start at pixel centres, as near to total reflection as
    fixed-point words allow.
    """
    dense = changed(steep(display), index=1.9)
    for name, nearest, farthest, centres in (("", 1e-15, 0.1, False), ("/words", 3e-8, 3e-6, True)):
        pixels, last, inner = _flips(dense, random, count, Status.INTERNAL_REFLECTION, centres=centres)
        share = random_sizes(random, nearest, farthest, len(pixels))
        yield PanelRays(f"grazing-exit{name}", dense, pixels, last + share * (inner - last))


@_case
def far_cells(display: Display, random: Random, count: int) -> Sets:
    """Test rays aimed up to 1.4 pitches from their lenslet's centre that leave a steep dome two lenslets away.

    If the domes face the viewer, the set is empty: this would need farther aperture points.
    """
    far = changed(steep(display), gap_mm=1.5 * display.array.coarsest_mm)
    many = 400 * count
    aims = display.array.finest_mm * random.uniform(1.1, 1.4, (many, 1)) * random_directions(random, many)
    rays = PanelRays("far-cells", far, random_pixels(far, random, many), aims)
    traced = rays.trace()
    far_off = cell_steps(far, traced.lenslet - rays.steps()["home"]) >= 2
    crossed = np.flatnonzero(far_off & (traced.status == int(Status.CROSSTALK)))
    if len(crossed):
        yield rays.select(crossed[:count])


@_case
def fates(display: Display, random: Random, count: int) -> Sets:
    """Test rays on both sides of the limits of crosstalk, blocking by a dome, and missing the domes."""
    array = display.array
    thin = changed(display, radius_mm=1.02 * array.half_diagonal_mm, index=1.25, thickness_mm=0.0, gap_mm=0.0)
    canyon = changed(display, radius_mm=400.0 * array.coarsest_mm, thickness_mm=0.0, gap_mm=0.0)
    kinds = ((Status.CROSSTALK, steep(display), 1.5), (Status.BLOCKED, thin, 6.0), (Status.MISSED, canyon, 200.0))
    for status, extreme, reach in kinds:
        pixels, aims, _ = _flips(extreme, random, max(2, count // 8), status, reach)
        if len(aims):
            yield _near_onset(f"fates/{status.name.lower()}", extreme, pixels, aims)


@_case
def losses(display: Display, random: Random, count: int) -> Sets:
    """Test random rays of each status, at domes, walls or array ends that stop rays."""
    array, panel = display.array, display.panel
    domes = changed(display, radius_mm=1.02 * array.half_diagonal_mm, index=1.25, thickness_mm=0.0, gap_mm=0.0)
    walls = changed(domes, shear=1.0, radius_mm=1.02 * replace(array, shear=1.0).half_diagonal_mm)
    # Let the array end between two lenslet centres.
    sides = ((panel.width_mm, array.pitches_mm[0]), (panel.height_mm, array.row_pitch_mm))
    extent_mm = tuple(2.0 * (math.floor(0.3 * side / pitch) + 0.7) * pitch for side, pitch in sides)
    ends = changed(steep(without_eye(display)), shear=0.0, offset_mm=(0.0, 0.0), extent_mm=extent_mm)
    many = 400 * count
    for name, extreme, reach in (("domes", domes, 6.0), ("walls", walls, 6.0), ("ends", ends, 3.0)):
        pixels = random_pixels(extreme, random, many)
        aims = random_aims(extreme, random, many, reach)
        rays = PanelRays(f"losses/{name}", extreme, pixels, aims)
        status = rays.trace().status
        if name == "ends":  # use only rays whose own lenslet exists
            there = Lattice.of(extreme.array).present(NumpyBackend(), *rays.steps()["home"].T)
            status = np.where(there, status, len(Status))
        yield rays.select(np.concatenate([np.flatnonzero(status == int(one))[:count] for one in Status]))


@_case
def tangent(display: Display, random: Random, count: int) -> Sets:
    """Test rays in air almost tangent to a dome: the discriminant is near zero, of either sign."""
    hilly = without_eye(steep(display, 1.001))
    R = hilly.array.radius_mm
    # Points near a dome that bulges to +z, and tangent directions, in lens coordinates.
    foot = random_aims(hilly, random, 40 * count)
    slope = np.hypot(*foot.T) / R
    foot = foot[slope > 0.75][: 2 * count]
    normal = np.column_stack([foot / R, np.sqrt(1.0 - (foot**2).sum(axis=1) / R**2)])
    # Take the steepest descent, then rotate this direction to either side.
    down = unit_vectors(np.column_stack([foot, np.zeros(len(foot))]))
    down = unit_vectors(down - (down * normal).sum(axis=1)[:, None] * normal)
    turn = random.uniform(-0.6, 0.6, (len(foot), 1))
    direction = np.cos(turn) * down + np.sin(turn) * np.cross(normal, down)
    lift = random.choice((0, 1, 2, 4, 16, 64, 1 << 10, 1 << 20, 1 << 30), (len(foot), 1)) * 2.0**-52 * R
    lift *= random.choice((-1.0, 1.0), (len(foot), 1))
    point = R * normal - (0.0, 0.0, R) + lift * normal
    if display.array.plano_side == "panel":
        # The rays start in the world, because the domes face away from the panel.
        frame = PanelFrame.of(hilly)
        x, y, z = (point - 10.0 ** random.uniform(0.0, 2.0, (len(point), 1)) * direction).T
        origin = np.column_stack([*frame.panel_from_array(x, y), z])
        yield WorldRays("tangent", hilly, origin, np.column_stack([*frame.turn(*direction[:, :2].T), direction[:, 2]]))
        return
    # The rays start on the panel, which is above the mirrored dome.
    start = point + (hilly.gap_mm - point[:, 2:]) / direction[:, 2:] * direction
    aim = point + (hilly.gap_mm - hilly.aperture_distance_mm - point[:, 2:]) / direction[:, 2:] * direction
    pixels, own = pixels_at(hilly, start[:, :2])
    yield PanelRays("tangent", hilly, pixels, aim[:, :2] - own)


@_of_displays
def flat_domes(display: Display) -> dict[str, Display]:
    """Test nearly flat domes, with radii R from 10 mm to 10^6 mm: errors must not grow with R."""
    least = 1.1 * display.array.half_diagonal_mm
    return {f"1e{k}-mm": changed(display, radius_mm=max(10.0**k, least)) for k in range(1, 7)}


@_of_displays
def full_spheres(display: Display) -> dict[str, Display]:
    """Test nearly hemispherical domes, with radii 10 % down to 1 ulp above the cell's half diagonal."""
    rho = display.array.half_diagonal_mm
    radii = {f"1e-{k}": rho * (1.0 + 10.0**-k) for k in (1, 3, 6, 12)} | {"1-ulp": math.nextafter(rho, math.inf)}
    return {name: changed(display, radius_mm=radius) for name, radius in radii.items()}


@_of_displays
def indices(display: Display) -> dict[str, Display]:
    """Test refractive indices from 1 + 10^-9 (almost air) to 2.4 (diamond, which reflects most steep rays)."""
    return {f"{n:.10g}": changed(display, index=n) for n in (1.0 + 1e-9, 1.0 + 1e-6, 1.001, 1.16, 2.2, 2.4)}


@_of_displays
def f_numbers(display: Display) -> dict[str, Display]:
    """Test focal lengths of 0.6 to 50 pitches, panel in focus; the shortest needs index 2.0 (hex) or 2.2 (square)."""
    array, displays = display.array, {}
    for number in (0.6, 0.8, 1.0, 2.0, 10.0, 50.0):
        focal = number * array.coarsest_mm
        index = max(array.index, 1.0 + 1.01 * array.half_diagonal_mm / focal)
        faster = changed(display, index=index, radius_mm=focal * (index - 1.0), thickness_mm=0.0)
        to_panel = focal - faster.array.thickness_mm / index if array.plano_side == "panel" else focal
        displays[f"{number:g}"] = changed(faster, gap_mm=max(0.0, to_panel))
    return displays


@_of_displays
def gaps(display: Display) -> dict[str, Display]:
    """Test panels in contact with the array, almost in contact, and within 10^-6 of the focal distance."""
    array = display.array
    focus = array.focal_length_mm - (array.thickness_mm / array.index if array.plano_side == "panel" else 0.0)
    focus = focus if focus > 0.0 else array.focal_length_mm
    distances = {"0": 0.0, "smallest": 5e-324, "1e-12-mm": 1e-12, "f-less-1e-6": focus * (1.0 - 1e-6)}
    distances |= {"f-less-1-ulp": math.nextafter(focus, 0.0), "f": focus}
    return {name: changed(display, gap_mm=gap) for name, gap in distances.items()}


@_of_displays
def rotations(display: Display) -> dict[str, Display]:
    """Test arrays rotated by 30, 45 and 90 degrees, exactly and with errors of 1 ulp to 10^-4 degrees."""
    turns: dict[str, float] = {}
    for angle in (30.0, 45.0, 90.0):
        up, down = math.nextafter(angle, 360.0), math.nextafter(angle, 0.0)
        near = {"": angle, "+1ulp": up, "-1ulp": down, "+1e-9": angle + 1e-9, "-1e-4": angle - 1e-4}
        turns |= {f"{angle:g}{name}": turn for name, turn in near.items()}
    return {name: changed(display, rotation_deg=turn) for name, turn in turns.items()}


@_of_displays
def offsets(display: Display) -> dict[str, Display]:
    """Test array offsets of half a lenslet, a third of a lenslet, 1 m, and 10^-300 mm."""
    p, row = display.array.pitches_mm[0], display.array.row_pitch_mm
    moves = {"half": (0.5 * p, 0.5 * row), "third": (p / 3.0, -row / 3.0)}
    moves |= {"metre": (1e3, -1e3), "1e-300": (1e-300, -1e-300)}
    # An offset of 1 m would move a finite array off the panel.
    ends = dict.fromkeys(moves, display.array.extent_mm) | {"metre": None}
    return {name: changed(display, offset_mm=offset, extent_mm=ends[name]) for name, offset in moves.items()}


@_case
def huge_panels(display: Display, random: Random, count: int) -> Sets:
    """Test the corners of panels of 65,535 x 65,535 pixels, where float32 resolves only a few micrometres."""
    pitch = min(display.panel.coarsest_mm, 0.4)
    panel = replace(display.panel, width_px=MAX_SIDE_PX, height_px=MAX_SIDE_PX, pixel_pitch_mm=pitch)
    wide = replace(display, panel=panel)
    corner = random.choice((0.0, float(MAX_SIDE_PX)), (count, 2))
    pixels = np.abs(corner - random.uniform(0.0, 300.0, (count, 2)))
    yield PanelRays("huge-panels", wide, pixels, random_aims(wide, random, count))


@_case
def tiny_values(display: Display, random: Random, count: int) -> Sets:
    """Test coordinates that are 0, -0 or subnormal, or whose squares underflow."""
    tiny = np.array([0.0, -0.0, 5e-324, -5e-324, 1e-310, -1e-310, 1e-160, -1e-160, 1e-20, -1e-20])
    aims = random.choice(tiny, (count, 2))
    yield PanelRays("tiny-values/aims", display, random_pixels(display, random, count), aims)
    yield PanelRays("tiny-values/pixels", display, np.abs(random.choice(tiny, (count, 2))), None)
    direction = np.column_stack([random.choice(tiny, (count, 2)), -np.ones(count)])
    origin = np.column_stack([random.choice(tiny, (count, 2)), np.full(count, 100.0)])
    yield WorldRays("tiny-values/world", display, origin, direction)


@_case
def far_origins(display: Display, random: Random, count: int) -> Sets:
    """Test rays from the world that start 1 m away (like an eye) or 1 km away (a distant source)."""
    panel = display.panel
    for name, distance in (("1-m", 1e3), ("1-km", 1e6)):
        half = 0.45 * np.array([panel.width_mm, panel.height_mm])
        target = np.column_stack([random.uniform(-half, half, (count, 2)), np.zeros(count)])
        slope = random.uniform(-0.3, 0.3, (count, 2))
        direction = unit_vectors(np.column_stack([slope, -np.ones(count)]))
        yield WorldRays(f"far-origins/{name}", display, target - distance * direction, direction)


@_of_displays
def register_limits(display: Display) -> dict[str, Display]:
    """Test displays with registers at their limits; displays beyond the limits are refused."""
    array, p, rho = display.array, display.array.finest_mm, display.array.half_diagonal_mm
    deepest = 3.999 if array.plano_side == "viewer" else 5.999
    limits = {
        "index-low": changed(display, index=1.16),
        "index-high": changed(display, index=2.2),
        "cell-half-high": changed(display, radius_mm=1.000001 * rho),
        "cell-half-low": changed(display, radius_mm=2047.9 * p),
        "depth-high": changed(display, radius_mm=1.5 * rho, thickness_mm=deepest * 1.5 * rho),
        "slope-high": changed(display, gap_mm=0.0, radius_mm=3.0 * p, thickness_mm=1.3 * rho * array.index),
    }
    # Just above 4 pixels per lenslet, and as many lenslets as 12-bit indices allow.
    widest = 4.001 if array.grid == "square" else 6.0
    panel = replace(display.panel, width_px=8000, height_px=8000, pixel_pitch_mm=p / widest)
    limits["x-from-u-high"] = replace(display, panel=panel)
    limits["x-from-u-low"] = changed(display, rotation_deg=180.0, offset_mm=(40.0 * p, -40.0 * p), extent_mm=None)
    return limits


@_of_displays
def converged(display: Display) -> dict[str, Display]:
    """Test elemental images that converge on an eye: near, far, off the axis, or at steep lenslets."""
    panel = display.panel

    def converge(display: Display, eye_mm: float, axis_mm: Pair = (0.0, 0.0)) -> Display:
        return replace(display, viewing_distance_mm=max(eye_mm, display.nearest_eye_mm), viewing_axis_mm=axis_mm)

    return {
        "near": converge(display, 0.0),
        "near-corner": converge(display, 0.0, (0.5 * panel.width_mm, -0.5 * panel.height_mm)),
        "metre-aside": converge(display, 600.0, (-1e3, 1e3)),
        "steep": converge(steep(display), 0.5 * panel.width_mm),
        "far": converge(display, 1e12),
        "beside": converge(display, 2.0 * panel.width_mm, (0.6 * panel.width_mm, 0.0)),
    }


@_of_displays
def skewed(display: Display) -> dict[str, Display]:
    """Test arrays with two pitches and a shear, up to their limits, and an array smaller than the panel."""
    array, panel = display.array, display.panel
    px, py = array.pitches_mm

    def skew(pitch_mm: Pair, shear: float, **other: Any) -> Display:
        domes = replace(array, pitch_mm=pitch_mm, shear=shear)
        radius_mm = max(array.radius_mm, 1.01 * domes.half_diagonal_mm)
        return changed(display, pitch_mm=pitch_mm, shear=shear, radius_mm=radius_mm, **other)

    edges = (0.4 * panel.width_mm, 2.0 * (round(0.2 * panel.height_mm / array.row_pitch_mm) * array.row_pitch_mm))
    return {
        "measured": skew((1.0004 * px, 0.9991 * py), 0.0012),
        "shear-1e-12": skew((px, py), 1e-12),
        "shear-1": skew((px, py), 1.0),
        "shear--1": skew((px, py), -1.0),
        "narrow": skew((px, 4.0 * px), 0.3),
        "wide": skew((px, 0.25 * px), -0.3),
        "extent": skew((px, py), 0.0, extent_mm=edges),
    }
