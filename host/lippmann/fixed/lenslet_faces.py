"""Compute steps 4 to 6 of a ray (rtl/optics): entry into the glass, dome, and exit from the glass.

In the glass, dx and dy are near words with E = `extra_bits` more bits, and dz has 3 E
more bits. Squared sines and cosines have F + 3 fraction bits; M is 2^(F+3) - 1. A ray
overflows if a value does not fit its word, or leaves its range by more than rounding.
"""

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
    """Intersection with the dome: unit normal N, cosine and squared sine of the ray's angle to N, misses, overflows."""

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
    """Intersect rays from (hx, hy, zc) with the unit sphere around the origin.

    For upward rays zc is `depth`, and `depth_rest` is 1 - zc^2. For downward rays zc is
    1, `dz` is |dz|, and products of `dz` are truncated, then subtracted. A ray that
    misses the sphere continues for half a radius from its point nearest to the centre.

        b    = ((hx dx >> F-4+E) + (hy dy >> F-4+E) + (zc dz >> F-4+3E) + 1) >> 1
        C    = (1 - zc^2) - (hx hx >> F-3) - (hy hy >> F-3) + (b b >> F+5)
        cos  = sqrt(min(max(C, 0), M)),  s = min(max(2^(F+3) - C, 0), M)
        l    = (8 cos - b + 8) >> 4,  downward (-8 cos - b + 8) >> 4, missed (2^(F+3) - b + 8) >> 4
        N_x  = saturate(((hx << 4) + (l dx >> F-3+E) + 4) >> 3),  N_y likewise
        N_z  = saturate(((zc << 4) + (l dz >> F-3+3E) + 4) >> 3).

    b has F + 4 fraction bits, l has F fraction bits. A ray misses if C < 0. A ray
    overflows if b or l does not fit its word, if C > 1 or, unless missed, if a
    coordinate of N is outside [-1, 1].
    """
    near, wide, far, foot = f + 2, f + 3, f + 4, f + 8
    extra = extra_bits(f)
    near_d, axial = near + extra, near + 3 * extra
    # b = V . d, with V = (hx, hy, zc); b has four bits more than the cosine
    drop = f - 1 - GUARD
    total = multiplier(hx, dx, wide, near_d, drop + extra) + multiplier(hy, dy, wide, near_d, drop + extra)
    along = multiplier(dz, depth, axial, far, drop + 3 * extra) if upward else -(dz << 4 >> 3 * extra)
    b = halved(total + along)
    over = ~fits(b, foot)
    b = wrapped(b, foot)

    # C = cos^2 = 1 - |V|^2 + b^2
    drop = f - 3
    h2 = multiplier(hx, hx, wide, wide, drop) + multiplier(hy, hy, wide, wide, drop)
    square = (depth_rest if upward else 0) - h2
    c = wrapped(square + multiplier(b, b, foot, foot, drop + 8), 2 * far - drop)
    top = (1 << (f + 3)) - 1
    cos = sqrt(np.clip(c, 0, top), f)
    s = np.clip((1 << (f + 3)) - c, 0, top)
    s = np.where(c > top, 0, s)

    # N = V + l d, where l is the length to the dome
    missed = c < 0
    length = ((8 * cos if upward else np.where(missed, 1 << (f + 3), -8 * cos)) - b + 8) >> 4
    over = over | ~fits(length, far) | above_one(c, f)
    length = wrapped(length, far)
    drop = f - GUARD
    lx, ly = (multiplier(length, d, far, near_d, drop + extra) for d in (dx, dy))
    lz = multiplier(length, dz, far, axial, drop + 3 * extra)
    z = (depth << (GUARD + 1)) + lz if upward else (1 << (f + 1 + GUARD)) - lz
    point = [guarded(n) for n in ((hx << (GUARD + 1)) + lx, (hy << (GUARD + 1)) + ly, z)]
    over = over | (~missed & np.any([beyond(n, near) for n in point], axis=0))
    nx, ny, nz = (saturate(n, near) for n in point)
    return Meeting(nx, ny, nz, cos, s, missed, over)


def cell_step(
    nx: Ints, ny: Ints, half: int, half_y: int, rise: int, lean: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return the step (di, dj) to the next cell to try, and a mask of the points inside their own cell.

    `half` is px / (2 R) and `half_y` is py / (2 R), near words, for pitches px, py and
    radius R. `lean` is the shear s, a wide word. `rise` is h = (sqrt(3)/2) px / py - s
    / 2, W + 2 bits, F + 1 of them fraction bits. q0, q1 and q2 = q1 - q0 are the point's
    coordinates across the cell's sides; q0 = nx without `shear`, q1 = ny on the square
    grid. A step on the hexagonal grid is along the largest |q|, which is ~q for q < 0:

        q0   = ((nx << 3) - (ny s >> F-3) + 4) >> 3
        q1   = ((ny m >> F-2) + (nx << 2) + (n ny << 3) + 4) >> 3,  h = n 2^(F+1) + m.

    m is in [0, 2^(F+1)).
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
    inside = (side(q, half) == 0).all(axis=0)
    first = np.argmax(np.where(q < 0, ~q, q), axis=0)
    sign = np.where(inside, 0, np.where(np.choose(first, q) < 0, -1, 1))
    # Steps to the cells beyond the three sides with q > 0.
    di, dj = sign * np.array([(1, 0, -1), (0, 1, 1)])[:, first]
    return di, dj, inside


def move_lenslet(
    hx: Ints, hy: Ints, di: Ints, dj: Ints, cx: int, cy: int, rx: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return (hx - di cx - dj rx, hy - dj cy), points relative to the next lenslet, F fraction bits, and overflows."""
    if not shear:
        rx = cx >> 1 if grid == "hex" else 0
    word = f + 3
    hx, hy = hx - di * cx - dj * rx, hy - dj * cy
    return wrapped(hx, word), wrapped(hy, word), ~fits(hx, word) | ~fits(hy, word)


def enter_flat(ex: Ints, ey: Ints, index_inverse: int, f: int) -> tuple[Ints, Ints, Ints, Bools]:
    """Refract directions (ex, ey) at the flat face into the glass; mark directions over 60 degrees.

        t_x  = ((e_x i >> F-2) + 4) >> 3,  t_y likewise
        g    = max((t_x t_x >> F-3+2E) + (t_y t_y >> F-3+2E), 0) >> 2
        dz   = sqrt(M - g)

    i is 1/n for the index n. g has F + 3 fraction bits, and dz has 3 E extra bits. A
    direction is steeper than 60 degrees if M - g < 1/4.
    """
    word, extra = f + 2, extra_bits(f)
    tx = guarded(multiplier(ex, index_inverse, word + extra, word, f + 1 - GUARD))
    ty = guarded(multiplier(ey, index_inverse, word + extra, word, f + 1 - GUARD))
    square, _ = axial_square(tx, ty, f, extra)
    return tx, ty, sqrt(square, f, normalise=False, extra=3 * extra), below_quarter(square, f)


def axial_square(dx: Ints, dy: Ints, f: int, extra: int = 0) -> tuple[Ints, Bools]:
    """Return dz^2 = 1 - dx^2 - dy^2, and a mask of directions with dx^2 + dy^2 >= 1."""
    word, drop = f + 2 + extra, f - 3 + 2 * extra
    total = multiplier(dx, dx, word, word, drop) + multiplier(dy, dy, word, word, drop)
    g = np.maximum(total, 0) >> 2
    top = (1 << (f + 3)) - 1
    return (top - g) & top, g > top


def below_quarter(square: Ints, f: int) -> Bools:
    """Mark squares (F + 3 fraction bits) below 1/4, which the root functions do not accept."""
    return square < 1 << (f + 1)


def cosine_behind(s: Ints, ratio_square: int, f: int) -> tuple[Ints, Ints]:
    """Return a refracted ray's squared cosine and clipped cosine; `s` is the squared sine before refraction."""
    far = f + 4
    c = (1 << (f + 3)) - multiplier(s, ratio_square, far, far, f)
    return c, sqrt(np.clip(c, 0, (1 << (f + 3)) - 1), f)


def enter_dome(
    met: Meeting, ex: Ints, ey: Ints, index_inverse: int, index_inverse_square: int, f: int
) -> tuple[Ints, Ints, Bools]:
    """Refract directions (ex, ey) at the dome into the glass; return dx, dy (near words) and overflow.

        C'   = 2^(F+3) - (s i2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos i >> F-1) + 4) >> 3
        d'_x = saturate(((e_x i >> F-2) - (k N_x >> F-3) + 4) >> 3),  d'_y likewise.

    k is a wide word, i is 1/n, i2 is 1/n^2. A ray overflows if C' is below 0 or above
    1, or if d'_x or d'_y is outside [-1, 1].
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
    """Refract rays at the dome into air; return directions (near words), reflection and overflow.

        C'   = 2^(F+3) - (s n2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos n >> F-2) + 4) >> 3
        d'_x = saturate(((e_x << 3-E) + (k N_x >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = saturate(((dz n >> F-3+3E) + (k N_z >> F-3) + 4) >> 3).

    e is the direction in air before the flat face. k is a wide word, and n2 is n^2. A
    ray is reflected if C' <= 0. A ray overflows if C' > 1 or, unless reflected, if k
    does not fit its word or d' exceeds 1.
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
    """Exit points (F + 4 bits, F + 1 fraction bits) on the flat face, directions (near words), masks."""

    x: Ints
    y: Ints
    dx: Ints
    dy: Ints
    dz: Ints
    reflected: Bools
    beyond: Bools


def leave_flat(met: Meeting, dx: Ints, dy: Ints, depth: int, index: int, index_square: int, f: int) -> FlatExit:
    """Trace rays in the glass from the dome to the flat face, and refract them there.

    A reflected ray keeps its direction in the glass.

        g    = max((dx dx >> F-3) + (dy dy >> F-3), 0) >> 2
        y    = M - g
        r    = min(rsqrt(y), 2^(F+1) - 1)
        u    = (N_z + 1 - 2 zc) >> 1
        l    = ((u r >> F-1) + 1) >> 1
        X    = ((N_x << 3) + (l dx >> F-3) + 4) >> 3,  Y likewise
        C'   = 2^(F+3) - (g n2 >> F)
        d'_x = saturate(((dx n >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = sqrt(min(max(C', 0), M)),  reflected ((y r >> F+1) + 1) >> 1.

    y has F + 3 fraction bits; `rsqrt` reads y as 4 y, so r = 1 / (2 dz). u is the depth
    to the flat face and l the path length, both far words. zc is `depth`, 1 - T/R, and
    n2 is n^2. A ray is reflected if C' <= 0. A ray overflows if g >= 1, if C' > 1, or,
    unless reflected, if y is below 1/4, u, l, X or Y does not fit its word, or d'_x or
    d'_y is outside [-1, 1].
    """
    near, far = f + 2, f + 4
    square, over = axial_square(dx, dy, f)
    half_inverse = np.minimum(rsqrt(square, f), (1 << (f + 1)) - 1)  # the value 1 does not fit a near word.
    # `to_go` is the depth to the flat face, `path` the length of the path to the face.
    to_go = (met.nz + (1 - 2 * depth)) >> 1
    path = halved(multiplier(wrapped(to_go, far), half_inverse, far, near, f - 1))
    drop = f - GUARD
    x, y = (
        guarded((n << GUARD) + multiplier(wrapped(path, far), d, far, near, drop))
        for n, d in ((met.nx, dx), (met.ny, dy))
    )

    # g is the squared sine in the glass.
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
