"""The configuration registers of a display, computed by the host; `optics_config_t` of rtl/optics/optics_pkg.sv.

What a format cannot hold is refused here, before anything runs, with the register's name and range.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from lippmann.display import Display
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.words import (
    FRACTIONS,
    INDEX_BITS,
    OFFSET_BITS,
    OFFSET_FRACTION,
    PIXEL_BITS,
    PIXEL_FRACTION,
    SLOPE_BITS,
    SLOPE_FRACTION,
)
from lippmann.optics.models import ray_matrix
from lippmann.optics.rays import Model
from lippmann.optics.system import System

#: Square of the largest slope to the axis, 60 degrees: what `unit_slope` takes.
MAX_SLOPE_SQUARE = 3.0
#: Furthest that a ray meets the first face from the axis, radii.
MAX_POINT = 4.0
#: Indices that the words hold: the bend at a dome stays below 2; above 1.16 a ray in the glass that is steeper than
#: 60 degrees is totally reflected at the flat face.
INDEX_LIMITS = (1.16, 2.2)
#: Least half of a cell, units of the last place: lengths are in radii, and exit points (5 + 1.2 (T/R)^2) R 2^-(F + 1)
#: off at most where no ray grazes the dome (measured), so a thousandth of the pitch with T up to one and a half radii.
LEAST_HALF = 1 << 12
#: Lenslets that a ray may leave from beyond the one that it starts in: aims of 1.5 pitches, and four further domes.
MAX_ASTRAY = 8


@dataclass(frozen=True)
class Configuration:
    """Integers for every field of `optics_config_t`, under the same names."""

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


def configuration(display: Display, build: Build, model: Model, reach_mm: float | None = None) -> Configuration:
    """Return the registers with which a build traces a display.

    `reach_mm` is how far from a lenslet's centre rays aim, the corner of its cell when left out.

    Raises
    ------
    InputError
        When the build is not for this kind of display, or a format cannot hold it: which register, and its range.
    """
    array = display.array
    _check_build(display, build, model)
    f = build.fraction_bits
    p, R = array.pitch_mm, array.radius_mm
    row = array.row_pitch_mm
    n, T = array.index, array.thickness_mm
    frame = System.of(display).frame
    _check_panel(display)
    _check_curvature(display, build)

    # array_from_pixel for columns to the right and rows upward from the panel's centre.
    c, s, px = frame.cos, frame.sin, frame.pitch_mm
    zero_x, zero_y = frame.array_from_panel(0.0, 0.0)
    values = {
        "x_from_u": _word("x_from_u", px * c / p, SLOPE_BITS, SLOPE_FRACTION),
        "x_from_v": _word("x_from_v", px * s / p, SLOPE_BITS, SLOPE_FRACTION),
        "y_from_u": _word("y_from_u", -px * s / row, SLOPE_BITS, SLOPE_FRACTION),
        "y_from_v": _word("y_from_v", px * c / row, SLOPE_BITS, SLOPE_FRACTION),
    }
    half = 1 << (OFFSET_FRACTION - 1 - f)
    values["x_offset"] = _word("x_offset", zero_x / p, OFFSET_BITS, OFFSET_FRACTION) + half
    values["y_offset"] = _word("y_offset", zero_y / row, OFFSET_BITS, OFFSET_FRACTION) + half

    slope, point = _sums(display, build, model)
    _check_reach(display, build, slope, point, reach_mm)
    near, wide, far = build.near, build.near, build.near + 2
    for axis, unit in (("x", p), ("y", row)):
        values[f"slope_{axis}"] = _word(f"slope_{axis}", slope[0] * unit, wide, f)
        values[f"slope_aim_{axis}"] = _word(f"slope_aim_{axis}", slope[1] * unit, wide, f)
        values[f"point_{axis}"] = _word(f"point_{axis}", point[0] * unit / R, wide, f)
        values[f"point_aim_{axis}"] = _word(f"point_aim_{axis}", point[1] * unit / R, wide, f)

    # The simpler models know of the lens only what is in those sums.
    exact = build.model == "exact"
    if exact:
        _check_index(display)
        _check_depth(display, build)
    zc = 1.0 - T / R if exact else 0.0
    zc_word = _word("depth", zc, far, f)
    values["depth"] = zc_word
    rest = 1.0 - (zc_word / (1 << f)) ** 2
    values["depth_rest"] = _word("depth_rest", rest, f + 9, f + 3)
    n = n if exact else 1.5  # any index that the words hold: the simpler models do not read it
    values["index"] = _word("index", n, near + 1, f)
    values["index_square"] = _word("index_square", n * n, far, f)
    values["index_inverse"] = _word("index_inverse", 1.0 / n, near, f + 1)
    values["index_inverse_square"] = _word("index_inverse_square", 1.0 / n**2, far, f)
    plane = model in ("paraxial", "exact") and array.plano_side == "viewer"
    values["exit_z"] = _word("exit_z", T / R if plane else 0.0, far, f + 1)
    values["cell_half"] = _word("cell_half", 0.5 * p / R, near, f + 1)
    values["cell_pitch_x"] = _word("cell_pitch_x", p / R, wide, f)
    values["cell_pitch_y"] = _word("cell_pitch_y", row / R, wide, f)
    return Configuration(**values)


def _sums(display: Display, build: Build, model: Model) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return slope and point (mm) as sums k x + l a over the pixel's point and the aperture point, mm.

    The exact ray's slope is k (a - x), its point where it crosses the first face's plane.
    """
    D = display.aperture_distance_mm
    share = display.gap_mm / D
    if build.model == "exact":
        return (1.0 / D, 0.0), (1.0 - share, share)
    if model == "pinhole":
        return (-1.0 / D, 0.0), (0.0, 0.0)
    if model == "thin":
        return (-1.0 / D, 1.0 / D - 1.0 / display.array.focal_length_mm), (0.0, 1.0)
    (m00, m01), (m10, m11) = ray_matrix(System.of(display)).tolist()
    return (m10 - m11 / D, m11 / D), (m00 - m01 / D, m01 / D)


def _word(name: str, value: float, bits: int, fraction: int) -> int:
    """Return the nearest word of a value; refuse it where the register is too narrow."""
    limit = 2.0 ** (bits - 1 - fraction)
    word = math.floor(math.ldexp(value, fraction) + 0.5)
    if not -(1 << (bits - 1)) <= word < 1 << (bits - 1):
        raise InputError(
            f"register {name}: {value:.6g} is outside its range [{-limit:g}, {limit:g}); {_REMEDIES[name]}"
        )
    return word


_REMEDIES = {
    **dict.fromkeys(
        ("x_from_u", "x_from_v"), "give lenslets of more than 4 pixels (array.pitch_mm, panel.pixel_pitch_mm)"
    ),
    **dict.fromkeys(
        ("y_from_u", "y_from_v"),
        "give rows of lenslets more than 4 pixels apart (array.pitch_mm, panel.pixel_pitch_mm)",
    ),
    **dict.fromkeys(("x_offset", "y_offset"), "bring array.offset_mm nearer to the panel"),
    **dict.fromkeys(
        ("slope_x", "slope_y", "slope_aim_x", "slope_aim_y"),
        "the panel stands too near for the pitch: raise gap_mm, or array.thickness_mm where the plano side faces "
        "the panel, or lower array.pitch_mm",
    ),
    **dict.fromkeys(
        ("point_x", "point_y", "point_aim_x", "point_aim_y", "cell_half", "cell_pitch_x", "cell_pitch_y"),
        "the lenslet is too steep: raise array.radius_mm or lower array.pitch_mm",
    ),
    **dict.fromkeys(
        ("depth", "depth_rest", "exit_z"),
        "the substrate is too thick for the curvature: lower array.thickness_mm or raise array.radius_mm",
    ),
    **dict.fromkeys(
        ("index", "index_square", "index_inverse", "index_inverse_square"),
        f"array.index must be {INDEX_LIMITS[0]} to {INDEX_LIMITS[1]}",
    ),
}


def _check_build(display: Display, build: Build, model: Model) -> None:
    wanted = Build.of(display, model, build.fraction_bits, build.aims, build.walk)
    wanted = dataclasses.replace(wanted, cross_cells=build.cross_cells)
    if wanted != build:
        differ = [
            field.name
            for field in dataclasses.fields(Build)
            if getattr(wanted, field.name) != getattr(build, field.name)
        ]
        raise InputError(
            f"this build is not for display '{display.name}' and model {model}: "
            f"{', '.join(f'{name} is {getattr(build, name)}' for name in differ)}; "
            f"build with {', '.join(f'{name} = {getattr(wanted, name)}' for name in differ)}"
        )


def _check_panel(display: Display) -> None:
    panel, array = display.panel, display.array
    limit = 1 << (PIXEL_BITS - PIXEL_FRACTION)
    if max(panel.width_px, panel.height_px) >= limit:
        raise InputError(
            f"register raster_panel: a panel of {panel.width_px} x {panel.height_px} is outside its range, 1 to "
            f"{limit - 1} either way; lower panel.width_px and panel.height_px"
        )
    # What the sum of x_from_u, x_from_v and x_offset (y likewise) makes of the panel's corners; a hexagonal lenslet's
    # index counts along oblique axes.
    half = np.array([panel.width_mm, panel.height_mm]) / 2.0
    corner = half * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    x, y = System.of(display).frame.array_from_panel(*corner.T)
    x, y = x / array.pitch_mm, y / array.row_pitch_mm
    oblique = x - y / 2.0 if array.grid == "hex" else x
    lenslets = float(np.abs([x, y, oblique]).max())
    limit = (1 << (INDEX_BITS - 1)) - MAX_ASTRAY
    if lenslets >= limit:
        raise InputError(
            f"registers x_from_u, x_from_v and x_offset, and those of y: they place the panel's corner {lenslets:.6g} "
            f"lenslets from the axis, outside the range (-{limit}, {limit}) of their sum; raise array.pitch_mm, take a "
            "smaller panel, or bring array.offset_mm nearer to it"
        )


def _check_curvature(display: Display, build: Build) -> None:
    """Refuse a dome so flat that its cell has too few significant bits in radii; a pinhole has no dome."""
    half = 0.5 * display.array.pitch_mm / display.array.radius_mm
    least = math.ldexp(LEAST_HALF, -build.fraction_bits - 1)
    if build.model != "pinhole" and half < least:
        most = FRACTIONS[-1]
        remedy = "lower array.radius_mm or raise array.pitch_mm"
        if build.fraction_bits < most:
            remedy = f"lower array.radius_mm, raise array.pitch_mm, or take more fraction bits, up to {most}"
        raise InputError(
            f"register cell_half: {half:.6g} is outside its range [{least:.6g}, 1) at F = {build.fraction_bits}; the "
            f"lenslet is too flat: {remedy}"
        )


def _check_reach(
    display: Display, build: Build, slope: tuple[float, float], point: tuple[float, float], reach_mm: float | None
) -> None:
    """Refuse rays steeper than 60 degrees, and those that meet the first face too far from the lenslet aimed at."""
    array = display.array
    rho = array.half_diagonal_mm
    reach = rho if reach_mm is None else reach_mm
    # Measured from the lenslet aimed at, whose cell is another than the pixel's when the aim lies out of that.
    pixel, aim = (rho, rho) if reach <= rho * (1.0 + 1e-9) else (2.0 * rho + reach, rho)
    aim = aim if build.aims else 0.0

    def names(what: str) -> str:
        """Tell which registers' sum it is."""
        alone = not build.aims or (build.model == "exact" and what == "slope")
        return f"{what}_x and {what}_y" if alone else f"{what}_x, {what}_y, {what}_aim_x and {what}_aim_y"

    steepest = abs(slope[0]) * ((rho + reach if build.aims else rho) if build.model == "exact" else pixel)
    steepest += abs(slope[1]) * aim
    if steepest**2 >= MAX_SLOPE_SQUARE:
        raise InputError(
            f"registers {names('slope')}: they make slopes of a ray up to {steepest:.3g}, outside the range "
            f"[0, {math.sqrt(MAX_SLOPE_SQUARE):.3f}) of 60 degrees; the f-number is too small: raise gap_mm, or "
            "array.thickness_mm where the plano side faces the panel, or lower array.pitch_mm"
        )
    furthest = (abs(point[0]) * pixel + abs(point[1]) * aim) / array.radius_mm
    if furthest >= MAX_POINT:
        raise InputError(
            f"registers {names('point')}: they make points on the first face up to {furthest:.3g} radii from the axis, "
            f"outside the range [0, {MAX_POINT:g}); raise array.radius_mm, or aim nearer"
        )


def _check_index(display: Display) -> None:
    low, high = INDEX_LIMITS
    if not low <= display.array.index <= high:
        raise InputError(
            f"register index: {display.array.index:g} is outside its range [{low}, {high}]; {_REMEDIES['index']}"
        )


def _check_depth(display: Display, build: Build) -> None:
    """Lengths along the ray must fit into far words, below 8 radii."""
    array = display.array
    limit = 4.0 if build.viewer else 6.0
    if array.thickness_mm >= limit * array.radius_mm:
        raise InputError(
            f"register depth: a thickness of {array.thickness_mm / array.radius_mm:.3g} radii is outside its range, "
            f"below {limit:g}; {_REMEDIES['depth']}"
        )
