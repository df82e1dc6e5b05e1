"""Trace rays from pixel to exit in integer arithmetic (rtl/optics/lipp_ray_pipeline.sv)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, in_words
from lippmann.fixed.lenslet_faces import (
    Meeting,
    cell_step,
    enter_dome,
    enter_flat,
    leave_dome,
    leave_flat,
    meet_dome,
    move_lenslet,
)
from lippmann.fixed.ray_start import (
    aim,
    blend,
    converge,
    extent,
    pixel_to_lenslet,
    shear,
    unit_slope,
)
from lippmann.fixed.words import INDEX_BITS, Bools, Ints, extra_bits, fits, wrapped
from lippmann.optics.rays import Status


class FixedRays(NamedTuple):
    """Exit rays: lenslet (i, j), origin in radii (F + 1 fraction bits), direction (near words) and status."""

    i: Ints
    j: Ints
    x: Ints
    y: Ints
    z: Ints
    dx: Ints
    dy: Ints
    dz: Ints
    status: Ints


#: Function that traces the words of pixels and aperture points through an RTL build.
Pipeline = Callable[[Ints, Ints, Ints, Ints, Configuration, Build], FixedRays]


def ray_pipeline(u: Ints, v: Ints, a: Ints, b: Ints, config: Configuration, build: Build) -> FixedRays:
    """Trace rays from pixels (u, v), 4 fraction bits, through aperture points (a, b), wide words.

    A ray is `missed` if one of its words, or a register, wraps or saturates.
    """
    f, grid = build.fraction_bits, build.grid
    config, unfit = in_words(config, build)
    near, local = build.near, build.local
    own_i, own_j, x, y, beyond = pixel_to_lenslet(u, v, config, grid, f)
    beyond |= unfit
    i, j = own_i, own_j
    none = stray = np.zeros(x.shape, np.bool_)
    if build.aims:
        i, j, x, y, a, b, stray, outside = aim(i, j, x, y, a, b, grid, f)
        beyond |= outside
    else:
        a = b = np.zeros_like(x)

    if build.converge:
        x, y, outside = converge(i, j, x, y, config.converge_share, config.converge_x, config.converge_y, grid, f)
        beyond |= outside
    if build.shear:
        x, outside = shear(x, y, config.shear_x, f, f + 4 if build.converge else near)
        beyond |= outside
        if build.aims:
            a, outside = shear(a, b, config.shear_x, f, near)
            beyond |= outside

    exact = build.model == "exact"
    from_x, from_y = (a - x, b - y) if exact and not build.converge else (x, y)
    if not build.converge:
        beyond |= ~fits(a - x, local) | ~fits(b - y, local)
        from_x, from_y = wrapped(from_x, local), wrapped(from_y, local)
    mx, my, hx, hy, outside = _sums(x, y, from_x, from_y, a, b, config, build)
    beyond |= outside
    ex, ey, ez, too_steep = unit_slope(mx, my, f, build.extra)
    beyond |= too_steep

    if exact:
        rays, missed, reflected, over = _through_lenslet(i, j, hx, hy, (ex, ey, ez), config, build)
        missed = missed | over
        blocked = rays.dz <= 0
        crosstalk = (rays.i != own_i) | (rays.j != own_j) if build.max_cell_steps else stray
    else:
        rays = FixedRays(i, j, hx << 1, hy << 1, np.full_like(x, config.exit_z), ex, ey, ez, np.zeros_like(x))
        missed, reflected, blocked, crosstalk = none, none, none, stray
    missed = missed | beyond
    fates = (Status.MISSED, Status.INTERNAL_REFLECTION, Status.BLOCKED, Status.CROSSTALK)
    status = np.select([missed, reflected, blocked, crosstalk], fates, Status.OK)
    for at in ((own_i, own_j), (rays.i, rays.j)):
        status = np.where(extent(*at, config.extent_i, config.extent_j, grid), Status.BLOCKED, status)
    return rays._replace(status=status)


def _sums(
    x: Ints, y: Ints, from_x: Ints, from_y: Ints, a: Ints, b: Ints, config: Configuration, build: Build
) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    f, near, bits = build.fraction_bits, build.near, (build.local, build.aim)
    to_a, to_b = (a, b) if build.slope_aims else (None, None)
    slope = near + build.extra, *bits, build.extra
    mx, beyond_x = blend(config.slope_x, from_x, config.slope_aim_x, to_a, f, *slope)
    my, beyond_y = blend(config.slope_y, from_y, config.slope_aim_y, to_b, f, *slope)
    beyond = beyond_x | beyond_y
    if build.model == "pinhole":
        return mx, my, np.zeros_like(x), np.zeros_like(y), beyond
    to_a, to_b = (a, b) if build.aims else (None, None)
    hx, beyond_x = blend(config.point_x, x, config.point_aim_x, to_a, f, near + 1, *bits)
    hy, beyond_y = blend(config.point_y, y, config.point_aim_y, to_b, f, near + 1, *bits)
    return mx, my, hx, hy, beyond | beyond_x | beyond_y


def _through_lenslet(
    i: Ints, j: Ints, hx: Ints, hy: Ints, air: tuple[Ints, Ints, Ints], config: Configuration, build: Build
) -> tuple[FixedRays, Bools, Bools, Bools]:
    """Trace rays of an exact build through both lenslet faces; `air` is the direction in air."""
    f, grid = build.fraction_bits, build.grid
    ex, ey, ez = air
    beyond = np.zeros(ex.shape, np.bool_)
    more = extra_bits(f)
    if build.viewer:
        dx, dy, dz = ex << more, ey << more, ez << 3 * more
    else:
        dx, dy, dz, beyond = enter_flat(ex, ey, config.index_inverse, f)

    def meet(hx: Ints, hy: Ints) -> Meeting:
        return meet_dome(hx, hy, dx, dy, dz, config.depth, config.depth_rest, f, not build.viewer)

    def step(met: Meeting) -> tuple[Ints, Ints, Bools]:
        cell = config.cell_half, config.cell_half_y, config.cell_rise, config.shear_lean
        return cell_step(met.nx, met.ny, *cell, grid, f, build.shear)

    met = meet(hx, hy)
    for _ in range(build.max_cell_steps):
        di, dj, _ = step(met)
        pitches = config.cell_pitch_x, config.cell_pitch_y, config.shear_row
        hx, hy, outside = move_lenslet(hx, hy, di, dj, *pitches, grid, f, build.shear)
        i, j = i + di, j + dj
        beyond = beyond | met.beyond | outside | ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
        i, j = wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS)
        met = meet(hx, hy)
    missed = met.missed
    beyond = beyond | met.beyond
    if build.aims or build.viewer or build.converge:
        missed = missed | ~step(met)[2]

    if build.viewer:
        inner = enter_dome(met, ex, ey, config.index_inverse, config.index_inverse_square, f)
        out = leave_flat(met, *inner[:2], config.depth, config.index, config.index_square, f)
        x, y, dx, dy, dz, reflected, over = out
        over = over | inner[2]
        z = np.full_like(x, config.exit_z)
    else:
        air_dx, air_dy, air_dz, reflected, over = leave_dome(met, ex, ey, dz, config.index, config.index_square, f)
        keeps = reflected | met.missed
        # Round the direction in the glass to near words.
        dx, dy = (wrapped((d + more) >> more, build.near) for d in (dx, dy))
        dz = np.minimum((dz + (1 << 3 * more >> 1)) >> 3 * more, (1 << (f + 1)) - 1)
        dx, dy, dz = np.where(keeps, dx, air_dx), np.where(keeps, dy, air_dy), np.where(keeps, dz, air_dz)
        x, y, z = met.nx, met.ny, met.nz - (1 << (f + 1))
    return FixedRays(i, j, x, y, z, dx, dy, dz, np.zeros_like(i)), missed, reflected, beyond | over
