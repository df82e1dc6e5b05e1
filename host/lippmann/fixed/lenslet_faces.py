"""Steps 4 to 6: a ray at the faces of a lenslet: into the glass, its point on a dome, out of the glass (rtl/optics)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.words import (
    GUARD,
    Bools,
    Ints,
    above_one,
    beyond,
    extra_bits,
    fits,
    guarded,
    halved,
    multiplier,
    rsqrt,
    saturate,
    sqrt,
    wrapped,
)


class Meeting(NamedTuple):
    """Unit normal N at the point met (near words), cosine to it, squared sine (F + 3 fraction bits).

    `missed` where the ray passes the sphere by, `beyond` where a word wraps or saturates.
    """

    nx: Ints
    ny: Ints
    nz: Ints
    cos: Ints
    s: Ints
    missed: Bools
    beyond: Bools


def meet_dome(
    hx: Ints, hy: Ints, dx: Ints, dy: Ints, dz: Ints, depth: int, depth_rest: int, f: int, upward: bool
) -> Meeting:
    """Meet the unit sphere around the origin with rays from V = (hx, hy, zc).

        b    = ((hx dx >> F-4+E) + (hy dy >> F-4+E) + (zc dz >> F-4+3E) + 1) >> 1
        C    = (1 - zc^2) - (hx hx >> F-3) - (hy hy >> F-3) + (b b >> F+5)
        cos  = sqrt(min(max(C, 0), M)),  s = min(max(2^(F+3) - C, 0), M)
        l    = (8 cos - b + 8) >> 4,  downward (-8 cos - b + 8) >> 4, missed (2^(F+3) - b + 8) >> 4
        N_x  = saturate(((hx << 4) + (l dx >> F-3+E) + 4) >> 3),  N_y likewise
        N_z  = saturate(((zc << 4) + (l dz >> F-3+3E) + 4) >> 3)

    dx and dy are near words with E = `extra_bits` more fraction bits, dz has 3 E more. b has F + 4 fraction bits, C and
    s have F + 3, l has F. Missed: C < 0. Beyond: b or l outside its word, C above 1
    or, unless missed, a coordinate of N outside [-1, 1], by more than roundings. Upward zc is `depth` and `depth_rest`
    is 1 - zc^2. Downward zc = 1, and `dz` is |dz|: its products are cut, then subtracted.
    A ray that passes the sphere by downward goes on for half a radius from its point nearest to the centre.
    """
    near, wide, far, foot = f + 2, f + 3, f + 4, f + 8
    extra = extra_bits(f)
    near_d, axial = near + extra, near + 3 * extra
    drop = f - 1 - GUARD
    total = multiplier(hx, dx, wide, near_d, drop + extra) + multiplier(hy, dy, wide, near_d, drop + extra)
    along = (
        multiplier(np.int64(depth) + 0 * dz, dz, far, axial, drop + 3 * extra) if upward else -(dz << 4 >> 3 * extra)
    )
    b = halved(total + along)
    over = ~fits(b, foot)
    b = wrapped(b, foot)

    drop = f - 3
    h2 = multiplier(hx, hx, wide, wide, drop) + multiplier(hy, hy, wide, wide, drop)
    square = (depth_rest if upward else 0) - h2
    c = wrapped(square + multiplier(b, b, foot, foot, drop + 8), 2 * far - drop)
    top = (1 << (f + 3)) - 1
    cos = sqrt(np.clip(c, 0, top), f)
    s = np.clip((1 << (f + 3)) - c, 0, top)
    s = np.where(c > top, 0, s)

    missed = c < 0
    length = ((8 * cos if upward else np.where(missed, 1 << (f + 3), -8 * cos)) - b + 8) >> 4
    over = over | ~fits(length, far) | above_one(c, f)
    length = wrapped(length, far)
    drop = f - GUARD
    lx, ly = (multiplier(length, d, far, near_d, drop + extra) for d in (dx, dy))
    lz = multiplier(length, dz, far, axial, drop + 3 * extra)
    z = (np.int64(depth) << (GUARD + 1)) + lz if upward else (1 << (f + 1 + GUARD)) - lz
    point = [guarded(n) for n in ((hx << (GUARD + 1)) + lx, (hy << (GUARD + 1)) + ly, z)]
    over = over | (~missed & np.any([beyond(n, near) for n in point], axis=0))
    nx, ny, nz = (saturate(n, near) for n in point)
    return Meeting(nx, ny, nz, cos, s, missed, over)


def cell_step(
    nx: Ints, ny: Ints, half: int, half_y: int, rise: int, lean: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return the step (di, dj), and a mask of the points inside their own cell.

    Near words, `half` is px / (2 R), `half_y` py / (2 R); `rise` is h = (sqrt(3)/2) px / py - s / 2, a word of W + 2
    bits and F + 1 fraction bits; `lean` is the shear s, a wide word. Square: the sign of each of q0 and q1 = ny that is
    outside [-half, half) or [-half_y, half_y). Hexagonal: across the flat with the largest of |q0|, |q1|, |q2|, where
    q1 = nx / 2 + h ny, q2 = q1 - q0, and |q| is ~q below 0. q0 is nx, in a build with `shear` nx - s ny:

        q0   = ((nx << 3) - (ny s >> F-3) + 4) >> 3
        q1   = ((ny m >> F-2) + (nx << 2) + (n ny << 3) + 4) >> 3,  h = n 2^(F+1) + m

    with 0 <= m < 2^(F+1).
    """
    word = f + 2
    q0 = guarded((nx << GUARD) - multiplier(ny, lean, word, word, f - GUARD)) if shear else nx

    def side(q: Ints, half: int) -> Ints:
        return np.where(q >= half, 1, np.where(q < -half, -1, 0))

    if grid == "square":
        di, dj = side(q0, half), side(ny, half_y)
        return di, dj, (di == 0) & (dj == 0)
    units, part = rise >> (f + 1), rise & ((1 << (f + 1)) - 1)
    climb = multiplier(ny, part, word, word, f + 1 - GUARD) + (units * ny << GUARD)
    q = np.stack([q0, guarded(climb + (nx << (GUARD - 1))), np.zeros_like(nx)])
    q[2] = q[1] - q[0]
    inside = (np.stack([side(k, half) for k in q]) == 0).all(axis=0)
    size = np.where(q < 0, ~q, q)
    sign = np.where(q < 0, -1, 1)
    first = np.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, np.where(size[1] >= size[2], 1, 2))
    di = np.where(first == 0, sign[0], np.where(first == 2, -sign[2], 0))
    dj = np.where(first == 1, sign[1], np.where(first == 2, sign[2], 0))
    return np.where(inside, 0, di), np.where(inside, 0, dj), inside


def move_lenslet(
    hx: Ints, hy: Ints, di: Ints, dj: Ints, cx: int, cy: int, rx: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return (hx - di cx - dj rx, hy - dj cy), F fraction bits, and where a word does not hold it.

    Without `shear` rx is 0 on a square grid, and floor(cx / 2) on a hexagonal one.
    """
    if not shear:
        rx = cx >> 1 if grid == "hex" else 0
    word = f + 3
    hx, hy = hx - di * cx - dj * rx, hy - dj * cy
    return wrapped(hx, word), wrapped(hy, word), ~fits(hx, word) | ~fits(hy, word)


def enter_flat(ex: Ints, ey: Ints, index_inverse: int, f: int) -> tuple[Ints, Ints, Ints, Bools]:
    """Return the direction in the glass from the direction (e_x, e_y) in the air, near words and E = `extra_bits` bits.

    dz has 3 E bits more. The mask tells where it is steeper than 60 degrees: M - g < 1/4, which `sqrt` does not take.

        t_x  = ((e_x i >> F-2) + 4) >> 3,  t_y likewise
        g    = max((t_x t_x >> F-3+2E) + (t_y t_y >> F-3+2E), 0) >> 2
        dz   = sqrt(M - g)

    i is 1/n, g has F + 3 fraction bits.
    """
    word, extra = f + 2, extra_bits(f)
    tx = guarded(multiplier(ex, index_inverse, word + extra, word, f + 1 - GUARD))
    ty = guarded(multiplier(ey, index_inverse, word + extra, word, f + 1 - GUARD))
    square, _ = left_of_unit(tx, ty, f, extra)
    return tx, ty, sqrt(square, f, normalise=False, extra=3 * extra), below_quarter(square, f)


def left_of_unit(dx: Ints, dy: Ints, f: int, extra: int = 0) -> tuple[Ints, Bools]:
    """Return M - g, M and g as in `enter_flat` and `leave_flat`, F + 3 fraction bits, and where g is 1 or more."""
    word, drop = f + 2 + extra, f - 3 + 2 * extra
    total = multiplier(dx, dx, word, word, drop) + multiplier(dy, dy, word, word, drop)
    g = np.maximum(total, 0) >> 2
    top = (1 << (f + 3)) - 1
    return (top - g) & top, g > top


def below_quarter(square: Ints, f: int) -> Bools:
    """Tell which squares, F + 3 fraction bits, are below 1/4."""
    return square < 1 << (f + 1)


def cosine_behind(s: Ints, ratio_square: int, f: int) -> tuple[Ints, Ints]:
    """Return C' = 2^(F+3) - (s r2 >> F) of a squared sine s, and sqrt(min(max(C', 0), M)), the cosine behind a face."""
    far = f + 4
    c = (1 << (f + 3)) - multiplier(s, ratio_square, far, far, f)
    return c, sqrt(np.clip(c, 0, (1 << (f + 3)) - 1), f)


def enter_dome(
    met: Meeting, ex: Ints, ey: Ints, index_inverse: int, index_inverse_square: int, f: int
) -> tuple[Ints, Ints, Bools]:
    """Return the lateral direction in the glass, near words, and a mask of overflow.

        C'   = 2^(F+3) - (s i2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos i >> F-1) + 4) >> 3
        d'_x = saturate(((e_x i >> F-2) - (k N_x >> F-3) + 4) >> 3),  d'_y likewise

    s = 1 - cos^2 and C' have F + 3 fraction bits, k is a wide word, i is 1/n and i2 is 1/n^2. Overflow: C'
    below 0 or above 1, or the direction outside [-1, 1], by more than roundings.
    """
    near = f + 2
    c, cos_glass = cosine_behind(met.s, index_inverse_square, f)
    bend = wrapped(guarded((cos_glass << 2) - multiplier(met.cos, index_inverse, near, near, f - 1)), near)

    def lateral(e: Ints, n: Ints) -> Ints:
        t = multiplier(e, index_inverse, near, near, f + 1 - GUARD)
        return guarded(t - multiplier(bend, n, near, near, f - GUARD))

    dx, dy = lateral(ex, met.nx), lateral(ey, met.ny)
    over = (c < 0) | above_one(c, f) | beyond(dx, near) | beyond(dy, near)
    return saturate(dx, near), saturate(dy, near), over


def leave_dome(
    met: Meeting, ex: Ints, ey: Ints, dz: Ints, index: int, index_square: int, f: int
) -> tuple[Ints, Ints, Ints, Bools, Bools]:
    """Return the direction in the air (near words), and masks of the rays that are totally reflected, and of overflow.

        C'   = 2^(F+3) - (s n2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos n >> F-2) + 4) >> 3
        d'_x = saturate(((e_x << 3-E) + (k N_x >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = saturate(((dz n >> F-3+3E) + (k N_z >> F-3) + 4) >> 3)

    e_x and e_y have E = `extra_bits` more fraction bits than near words, dz has 3 E more. s = 1 - cos^2 and C' have
    F + 3 fraction bits, k is a wide word, n2 is n^2. Totally reflected: C' <= 0. Overflow: C' above 1, or, unless
    reflected, k outside its word or the direction outside [-1, 1], by more than roundings.
    """
    near = f + 2
    c, cos_air = cosine_behind(met.s, index_square, f)
    glass = multiplier(met.cos, index, near, near + 1, f - 2)
    bend = guarded((cos_air << 2) - glass)
    over = ~fits(bend, near)
    bend = wrapped(bend, near)
    drop, extra = f - GUARD, extra_bits(f)
    kx, ky, kz = (multiplier(bend, n, near, near, drop) for n in (met.nx, met.ny, met.nz))
    axial = multiplier(dz, index, near + 3 * extra, near + 1, drop + 3 * extra)
    out = [guarded(d) for d in ((ex << (GUARD - extra)) + kx, (ey << (GUARD - extra)) + ky, axial + kz)]
    reflected = c <= 0
    over = above_one(c, f) | (~reflected & (over | np.any([beyond(d, near) for d in out], axis=0)))
    dx, dy, dz = (saturate(d, near) for d in out)
    return dx, dy, dz, reflected, over


class FlatExit(NamedTuple):
    """Point on the flat face (F + 1 fraction bits, far words' width), direction (near words), reflected, overflow."""

    x: Ints
    y: Ints
    dx: Ints
    dy: Ints
    dz: Ints
    reflected: Bools
    beyond: Bools


def leave_flat(met: Meeting, dx: Ints, dy: Ints, depth: int, index: int, index_square: int, f: int) -> FlatExit:
    """Carry rays in the glass from the dome to the flat face and refract them.

        g    = max((dx dx >> F-3) + (dy dy >> F-3), 0) >> 2
        y    = M - g
        r    = min(rsqrt(y), 2^(F+1) - 1)
        u    = (N_z + 1 - 2 zc) >> 1
        l    = ((u r >> F-1) + 1) >> 1
        X    = ((N_x << 3) + (l dx >> F-3) + 4) >> 3,  Y likewise
        C'   = 2^(F+3) - (g n2 >> F)
        d'_x = saturate(((dx n >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = sqrt(min(max(C', 0), M)),  reflected ((y r >> F+1) + 1) >> 1

    g, y and C' have F + 3 fraction bits, and rsqrt reads y as 4 y: r = 1 / (2 dz). u is the remaining depth and l the
    length, both far words; zc = 1 - T/R (`depth`), n2 is n^2 (`index_square`). Reflected where C' <= 0; such a ray
    keeps its direction in the glass. Overflow: g 1 or more, C' above 1, or, unless reflected, y below 1/4, which
    `rsqrt` does not take, u, l, X or Y outside its word, or d'_x or d'_y outside [-1, 1], by more than roundings.
    """
    near, far = f + 2, f + 4
    square, over = left_of_unit(dx, dy, f)
    half_inverse = np.minimum(rsqrt(square, f), (1 << (f + 1)) - 1)  # 1 does not fit a near word
    to_go = (met.nz + (1 - 2 * depth)) >> 1
    path = halved(multiplier(wrapped(to_go, far), half_inverse, far, near, f - 1))
    drop = f - GUARD
    x, y = (
        guarded((n << GUARD) + multiplier(wrapped(path, far), d, far, near, drop))
        for n, d in ((met.nx, dx), (met.ny, dy))
    )

    g = ((1 << (f + 3)) - 1) - square
    c, dz_air = cosine_behind(g, index_square, f)
    dx_air, dy_air = (guarded(multiplier(d, index, near, near + 1, drop)) for d in (dx, dy))
    dz_glass = wrapped(halved(multiplier(square, half_inverse, far, near, f + 1)), near)
    reflected = c <= 0
    lost = np.any([~fits(w, far) for w in (to_go, path, x, y)], axis=0) | below_quarter(square, f)
    over = over | above_one(c, f) | (~reflected & (lost | beyond(dx_air, near) | beyond(dy_air, near)))
    return FlatExit(
        wrapped(x, far),
        wrapped(y, far),
        np.where(reflected, dx, saturate(dx_air, near)),
        np.where(reflected, dy, saturate(dy_air, near)),
        np.where(reflected, dz_glass, dz_air),
        reflected,
        over,
    )
