"""Compute the optics block's register values (`optics_config_t`) for one display."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lippmann.display.description import Display, Pair
from lippmann.errors import InputError
from lippmann.fixed import words
from lippmann.fixed.build import Build, shift_mm
from lippmann.optics.lattice import HALF_SQRT3
from lippmann.optics.models import ray_matrix
from lippmann.optics.rays import Model
from lippmann.optics.system import System

#: Square of a ray's maximum slope (tan 60 degrees, see `unit_slope`).
MAX_SLOPE_SQUARE = 3.0
#: Maximum distance of a ray from the lenslet's axis on the first face, radii.
MAX_POINT = 4.0
#: Maximum distance of a pixel from its lenslet's centre in a `converge` build, pitches or rows.
MAX_LOCAL = 8.0
#: Range of the refractive index. In it, the factor k of a dome's normal is below 2, and
#: the flat face totally reflects rays in the glass steeper than 60 degrees.
INDEX_LIMITS = (1.16, 2.2)
#: Minimum half width of a cell, in units of the last bit. If no ray grazes the dome,
#: the error of an exit point is at most (5 + 1.2 (T/R)^2) R 2^-(F + 1) for radius R and
#: thickness T (measured): 1/1000 of the pitch for T <= 1.5 R.
LEAST_HALF = 1 << 12
#: Values of `extent_i` and `extent_j` for lenslets everywhere.
EVERYWHERE = (1 << (words.INDEX_BITS + 1)) - 1, (1 << words.INDEX_BITS) - 1
#: Maximum lattice steps from a pixel's lenslet to the ray's exit lenslet.
MAX_ASTRAY = 8

_PITCHES = "(array.pitch_mm, panel.pixel_pitch_mm)"
_RAISE_GAP = "raise gap_mm, or array.thickness_mm where the plano side faces the panel, or lower array.pitch_mm"
_TOO_NEAR = f"the panel stands too near for the pitch: {_RAISE_GAP}"
TOO_STEEP = "the lenslet is too steep: raise array.radius_mm or lower array.pitch_mm"
_PITCHES_ALIKE = "bring the numbers of array.pitch_mm nearer to each other, or lower array.shear"
_TOO_THICK = "the substrate is too thick for the curvature: lower array.thickness_mm or raise array.radius_mm"
_FARTHER = "the eye is too near: raise viewing_distance_mm, take a smaller panel, or bring viewing_axis_mm nearer to 0"
_INDEX = f"array.index must be {INDEX_LIMITS[0]} to {INDEX_LIMITS[1]}"


@dataclass(frozen=True)
class Configuration:
    """Register values of the optics block, named as the fields of `optics_config_t`."""

    x_from_u: int
    x_from_v: int
    y_from_u: int
    y_from_v: int
    x_offset: int
    y_offset: int
    slope_x: int
    slope_y: int
    slope_aim_x: int
    slope_aim_y: int
    point_x: int
    point_y: int
    point_aim_x: int
    point_aim_y: int
    index: int
    index_square: int
    index_inverse: int
    index_inverse_square: int
    depth: int
    depth_rest: int
    exit_z: int
    cell_half: int
    cell_pitch_x: int
    cell_pitch_y: int
    cell_half_y: int
    cell_rise: int
    converge_share: int
    converge_x: int
    converge_y: int
    extent_i: int
    extent_j: int
    shear_x: int
    shear_lean: int
    shear_row: int


class _Format(NamedTuple):
    bits: int
    fraction: int
    remedy: str
    is_read: bool


def nearest_word(
    value: float, bits: int, fraction: int, register: str, remedy: str, share: float = 1.0, unit: str = ""
) -> int:
    """Round a value to a word. Raises InputError if the value does not fit the register.

    The error contains value and limits, both multiplied by `share`, in `unit`.
    """
    word = math.floor(math.ldexp(value, fraction) + 0.5)
    if not -(1 << (bits - 1)) <= word < 1 << (bits - 1):
        limit = share * 2.0 ** (bits - 1 - fraction)
        what = f"{share * value:.6g}{unit} is outside its range [{-limit:g}, {limit:g}){unit}"
        raise InputError(f"{register}: {what}; {remedy}")
    return word


def _formats(build: Build) -> dict[str, _Format]:
    f, exact, aims, slope_aims = build.fraction_bits, build.model == "exact", build.aims, build.slope_aims
    near, far, share = f + 2, f + 4, words.share_bits(f)
    strays = exact and (aims or build.viewer or build.converge)
    walks, square, lens = build.max_cell_steps > 0, build.grid == "square", build.model != "pinhole"
    nearer = "bring array.offset_mm nearer to 0"
    table = (
        (words.SLOPE_BITS, words.SLOPE_FRACTION, f"give lenslets of more than 4 pixels {_PITCHES}", {
            "x_from_u": True, "x_from_v": True,
        }),
        (words.SLOPE_BITS, words.SLOPE_FRACTION, f"give rows of lenslets more than 4 pixels apart {_PITCHES}", {
            "y_from_u": True, "y_from_v": True,
        }),
        (words.OFFSET_BITS, words.OFFSET_FRACTION, nearer, {"x_offset": True, "y_offset": True}),
        (near + build.extra, f + build.extra, _TOO_NEAR, {
            "slope_x": True, "slope_y": True, "slope_aim_x": slope_aims, "slope_aim_y": slope_aims,
        }),
        (near, f, TOO_STEEP, {
            "point_x": lens, "point_y": lens, "point_aim_x": aims, "point_aim_y": aims,
            "cell_pitch_x": walks, "cell_pitch_y": walks,
            "shear_row": walks and build.shear, "shear_lean": strays and build.shear,
        }),
        (near, f + 1, TOO_STEEP, {"cell_half": strays, "cell_half_y": strays and square}),
        (far, f + 1, _PITCHES_ALIKE, {"cell_rise": strays and not square}),
        (far, f, _PITCHES_ALIKE, {"shear_x": build.shear}),
        (far, f, _TOO_THICK, {"depth": exact}),
        (far, f + 1, _TOO_THICK, {"exit_z": build.viewer or not exact}),
        (f + 9, f + 3, _TOO_THICK, {"depth_rest": exact and not build.viewer}),
        (near + 1, f, _INDEX, {"index": exact}),
        (far, f, _INDEX, {"index_square": exact, "index_inverse_square": build.viewer}),
        (near, f + 1, _INDEX, {"index_inverse": exact}),
        (share, f + 11, _FARTHER, {"converge_share": build.converge}),
        (share, f + 2, f"bring viewing_axis_mm and {nearer.removeprefix('bring ')}", {
            "converge_x": build.converge, "converge_y": build.converge,
        }),
    )  # fmt: skip
    return {
        name: _Format(bits, fraction, remedy, is_read)
        for bits, fraction, remedy, registers in table
        for name, is_read in registers.items()
    }


def in_words(config: Configuration, build: Build) -> tuple[Configuration, words.Bools | np.bool_]:
    """Truncate registers to a build's word lengths; also return whether a register does not fit.

    Affine coefficients and offsets have the same length in all builds.
    """
    narrow = {name: form for name, form in _formats(build).items() if form.bits < words.SLOPE_BITS}
    read = {name: (form.bits, form.is_read) for name, form in narrow.items()}
    read |= {"extent_i": (words.INDEX_BITS + 2, True), "extent_j": (words.INDEX_BITS + 1, True)}
    cut: dict[str, Any] = {}  # values are integers, or arrays in tests
    beyond: words.Bools | np.bool_ = np.False_
    for name, (bits, is_read) in read.items():
        value = getattr(config, name)
        cut[name] = words.wrapped(value, bits)
        if is_read:
            beyond = beyond | ~np.asarray(words.fits(value, bits))
    return dataclasses.replace(config, **cut), beyond


def configuration(display: Display, build: Build, model: Model, reach_mm: float | None = None) -> Configuration:
    """Return the register values with which an RTL build traces a display.

    `reach_mm` is the maximum distance of an aperture point from its lenslet's centre,
    by default that of a cell's corner. Raises InputError if the build does not fit this
    display, or a value does not fit its register.
    """
    _check_build(display, build, model)
    _check_panel(display)
    slope, point = _sums(display, build, model)
    # Check narrower ranges first: their messages are more specific.
    _check_lens(display, build)
    _check_reach(display, build, slope, point, reach_mm)
    numbers = _lattice_numbers(display) | _lens_numbers(display, build, model, slope, point)
    registers, formats = {}, _formats(build)
    for name, value in numbers.items():
        form = formats[name]
        registers[name] = nearest_word(value, form.bits, form.fraction, f"register {name}", form.remedy)
    # Add half a unit, so that the RTL's truncation rounds the lattice coordinates.
    half = 1 << (words.OFFSET_FRACTION - 1 - build.fraction_bits)
    registers["x_offset"] += half
    registers["y_offset"] += half
    along, across = EVERYWHERE
    if display.array.half_steps is not None:
        along, across = min(along, display.array.half_steps[0]), min(across, display.array.half_steps[1] // 2)
    return Configuration(**registers, extent_i=along, extent_j=across)


def _lattice_numbers(display: Display) -> dict[str, float]:
    (p, _), row, lean = display.array.pitches_mm, display.array.row_pitch_mm, display.array.shear
    system = System.of(display)
    frame, convergence = system.frame, system.convergence
    c, s = frame.cos, frame.sin
    px, py = (pitch * (1.0 - convergence.share) for pitch in frame.pitch_mm)
    zero_x, zero_y = convergence.towards_eye(*frame.array_from_panel(0.0, 0.0))
    return {
        "x_from_u": (px * c + lean * px * s) / p,
        "x_from_v": (py * s - lean * py * c) / p,
        "y_from_u": -px * s / row,
        "y_from_v": py * c / row,
        "x_offset": (zero_x - lean * zero_y) / p,
        "y_offset": zero_y / row,
    }


def _lens_numbers(display: Display, build: Build, model: Model, slope: Pair, point: Pair) -> dict[str, float]:
    array, f, exact = display.array, build.fraction_bits, build.model == "exact"
    (p, tall), row, R, lean = array.pitches_mm, array.row_pitch_mm, array.radius_mm, array.shear
    # Only exact builds read index and depth; other builds get values that fit.
    T, n = (array.thickness_mm, array.index) if exact else (R, 1.5)
    flat_exit, square = model in ("paraxial", "exact") and array.plano_side == "viewer", array.grid == "square"
    # Division by `shrink` compensates the factor 1 - share of `converge` builds.
    convergence = System.of(display).convergence
    share, shrink = convergence.share, 1.0 - convergence.share
    axis_x = convergence.axis_x - lean * convergence.axis_y
    depth = 1.0 - T / R
    rounded = math.ldexp(math.floor(math.ldexp(depth, f) + 0.5), -f)
    return {
        "slope_x": slope[0] * p / shrink,
        "slope_y": slope[0] * row / shrink,
        "slope_aim_x": slope[1] * p,
        "slope_aim_y": slope[1] * row,
        "point_x": point[0] * p / R / shrink,
        "point_y": point[0] * row / R / shrink,
        "point_aim_x": point[1] * p / R,
        "point_aim_y": point[1] * row / R,
        "cell_pitch_x": p / R,
        "cell_pitch_y": row / R,
        "converge_share": share,
        "converge_x": -share * axis_x / p,
        "converge_y": -share * convergence.axis_y / row,
        "cell_half": 0.5 * p / R,
        "cell_half_y": square * 0.5 * tall / R,
        "cell_rise": 0.0 if square else HALF_SQRT3 * (p / tall) - 0.5 * lean,
        "shear_x": lean * row / p,
        "shear_lean": lean,
        "shear_row": (lean * row + (0.0 if square else 0.5 * p)) / R,
        "depth": depth,
        "depth_rest": 1.0 - rounded**2,
        "exit_z": array.thickness_mm / R if flat_exit else 0.0,
        "index": n,
        "index_square": n * n,
        "index_inverse_square": 1.0 / n**2,
        "index_inverse": 1.0 / n,
    }


def _sums(display: Display, build: Build, model: Model) -> tuple[Pair, Pair]:
    """Return (k, l) of the slope k x + l a, and (k, l) of the point k x + l a, mm, on the first face.

    x is the pixel's point, a the aperture point. If `converge` is false, an exact ray
    has the slope k (a - x).
    """
    D = display.aperture_distance_mm
    share = display.gap_mm / D
    if build.model == "exact":
        return (-1.0 / D, 1.0 / D) if build.converge else (1.0 / D, 0.0), (1.0 - share, share)
    if model == "pinhole":
        return (-1.0 / D, 0.0), (0.0, 0.0)
    if model == "thin":
        return (-1.0 / D, 1.0 / D - 1.0 / display.array.focal_length_mm), (0.0, 1.0)
    (m00, m01), (m10, m11) = ray_matrix(System.of(display)).tolist()
    return (m10 - m11 / D, m11 / D), (m00 - m01 / D, m01 / D)


def _check_build(display: Display, build: Build, model: Model) -> None:
    if display.array.shear != 0.0 and not build.shear:
        frame = System.of(display).frame
        off = abs(display.array.shear) * max(abs(y) for _, y in frame.corners)
        pixels = math.hypot(off * frame.cos / frame.pitch_mm[0], off * frame.sin / frame.pitch_mm[1])
        raise InputError(
            f"this build is not for display '{display.name}': shear is False, but array.shear = "
            f"{display.array.shear:g} moves lenslets at the panel's corner by {off:.3g} mm ({pixels:.3g} pixels); "
            "build with shear = True"
        )
    converge = build.converge or display.viewing_distance_mm is not None
    sizes = build.fraction_bits, build.aims, build.max_cell_steps
    fitting = Build.of(display, model, *sizes, converge, build.shear)
    needs, has = dataclasses.asdict(fitting) | {"cross_cells": build.cross_cells}, dataclasses.asdict(build)
    if differ := [name for name in has if needs[name] != has[name]]:
        raise InputError(
            f"this build is not for display '{display.name}' and model {model}: "
            f"{', '.join(f'{name} is {has[name]}' for name in differ)}; "
            f"build with {', '.join(f'{name} = {needs[name]}' for name in differ)}"
        )


def _check_panel(display: Display) -> None:
    panel, array = display.panel, display.array
    limit = 1 << (words.PIXEL_BITS - words.PIXEL_FRACTION)
    if max(panel.size_px) >= limit:
        raise InputError(
            f"register raster_panel: a panel of {panel.width_px} x {panel.height_px} is outside its range, 1 to "
            f"{limit - 1} in each direction; lower panel.width_px and panel.height_px"
        )
    # Convert the panel's corners to lattice coordinates; the hexagonal i axis is oblique.
    system = System.of(display)
    x, y = system.convergence.towards_eye(*np.array(system.frame.corners).T)
    x, y = (x - array.shear * y) / array.pitches_mm[0], y / array.row_pitch_mm
    oblique = x - y / 2.0 if array.grid == "hex" else x
    lenslets = float(np.abs([x, y, oblique]).max())
    limit = (1 << (words.INDEX_BITS - 1)) - MAX_ASTRAY
    if lenslets >= limit:
        raise InputError(
            f"registers x_from_u to y_offset place the panel's corner {lenslets:.6g} lenslets from the axis, outside "
            f"the range [0, {limit}); raise array.pitch_mm, take a smaller panel, or bring array.offset_mm nearer to 0"
        )


def _check_reach(display: Display, build: Build, slope: Pair, point: Pair, reach_mm: float | None) -> None:
    array, exact = display.array, build.model == "exact"
    rho = array.half_diagonal_mm
    reach = rho if reach_mm is None else reach_mm
    # A ray aimed outside its pixel's cell belongs to a lenslet farther from the pixel.
    pixel = rho if reach <= rho * (1.0 + 1e-9) else 2.0 * rho + reach
    aim = rho if build.aims else 0.0
    # A large lenslet or a pixel's shift out of its cell may make rays too steep.
    shift = shift_mm(display)
    distances = math.hypot(1.0, array.shear) / array.pitches_mm[0], 1.0 / array.row_pitch_mm
    local = (pixel + shift) * (1.0 - System.of(display).convergence.share) * max(distances)
    if build.converge and local >= MAX_LOCAL:
        unit = "pitches" if distances[0] > distances[1] else "rows"
        raise InputError(
            f"registers converge_share, converge_x and converge_y place pixels up to {local:.3g} {unit} from the "
            f"centres of their lenslets, outside the range [0, {MAX_LOCAL:g}); {_FARTHER}"
        )

    def names(what: str) -> str:
        aims = build.slope_aims if what == "slope" else build.aims
        return f"{what}_x, {what}_y, {what}_aim_x and {what}_aim_y" if aims else f"{what}_x and {what}_y"

    between = rho + reach if build.aims else rho
    steepest = abs(slope[0]) * between if exact else abs(slope[0]) * pixel + abs(slope[1]) * aim
    remedy = f"the f-number is too small: {_RAISE_GAP}" if steepest**2 >= MAX_SLOPE_SQUARE else _FARTHER
    steepest += abs(slope[0]) * shift
    if steepest**2 >= MAX_SLOPE_SQUARE:
        raise InputError(
            f"registers {names('slope')}: a ray's slope is up to {steepest:.3g}, outside the range "
            f"[0, {math.sqrt(MAX_SLOPE_SQUARE):.3f}) of 60 degrees; {remedy}"
        )
    furthest = (abs(point[0]) * pixel + abs(point[1]) * aim) / array.radius_mm
    remedy = "raise array.radius_mm, or aim nearer to the lenslets' centres" if furthest >= MAX_POINT else _FARTHER
    furthest += abs(point[0]) * shift / array.radius_mm
    if furthest >= MAX_POINT:
        raise InputError(
            f"registers {names('point')}: a ray's point on the first face is up to {furthest:.3g} radii from the axis, "
            f"outside the range [0, {MAX_POINT:g}); {remedy}"
        )


def _check_lens(display: Display, build: Build) -> None:
    array, f, widest = display.array, build.fraction_bits, words.FRACTIONS[-1]
    half, least = 0.5 * array.finest_mm / array.radius_mm, math.ldexp(LEAST_HALF, -f - 1)
    if build.model != "pinhole" and half < least:
        more = f", or take more fraction bits, up to {widest}" if f < widest else ""
        remedy = f"the lenslet is too flat: lower array.radius_mm or raise array.pitch_mm{more}"
        limits = f"[{least:.6g}, 1) at F = {f}"
        raise InputError(f"register cell_half: {half:.6g} is outside its range {limits}; {remedy}")
    if build.model != "exact":
        return
    low, high = INDEX_LIMITS
    if not low <= array.index <= high:
        raise InputError(f"register index: {array.index:g} is outside its range [{low}, {high}]; {_INDEX}")
    limit = 4.0 if build.viewer else 6.0
    if array.thickness_mm >= limit * array.radius_mm:
        thickness = f"a thickness of {array.thickness_mm / array.radius_mm:.3g} radii"
        raise InputError(f"register depth: {thickness} is outside its range [0, {limit:g}); {_TOO_THICK}")
