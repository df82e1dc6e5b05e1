"""Registers written by hand: whatever words the bus accepts, no ray in a wrong direction has the status of a good one.

The twin is compared with the same steps over the reals: the formulas of rtl/optics/ in float64, without any word that
could wrap, saturate or be clamped, and a running bound of the rounding errors. tests/rtl compares RTL and twin.
"""

import dataclasses
import os
from typing import NamedTuple

import numpy as np
import pytest
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.optics.rays import gets_through
from wild_registers import any_rays, any_registers, bits_and_fraction

#: Units of the last place beyond a word's range at which a clamped square, or a saturated word, counts as rounded.
CLAMPED, SATURATED = 64, 32

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))

#: Each step of the ray is in one of them, with every width of word.
BUILDS = [
    Build(23, "square"),
    Build(16, "hex"),
    Build(23, "hex", aims=True, max_cell_steps=1),
    Build(19, "square", viewer=True, aims=True, max_cell_steps=2),
    Build(20, "hex", viewer=True, max_cell_steps=1),
    Build(22, "hex", converge=True),
    Build(18, "square", aims=True, max_cell_steps=4, converge=True, shear=True),
    Build(23, "hex", viewer=True, aims=True, max_cell_steps=1, converge=True, shear=True),
    Build(17, "hex", "paraxial", aims=True, shear=True),
    Build(21, "square", "paraxial", aims=True, converge=True),
    Build(14, "square", "pinhole"),
]


def name(build: Build) -> str:
    flags = [key for key in ("viewer", "aims", "converge", "shear") if getattr(build, key)]
    return "-".join([build.grid, build.model, f"F{build.fraction_bits}", *flags])


class Ideal(NamedTuple):
    """Exit rays over the reals, and how far roundings may turn and shift the twin's; `lost`: no such ray."""

    direction: np.ndarray
    origin: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    lost: np.ndarray


def nearest(x: np.ndarray, y: np.ndarray, grid: str) -> tuple[np.ndarray, np.ndarray]:
    """The lenslet in whose cell points are, in pitches and rows; by the half-open rule of docs/reference/optics.md."""
    if grid == "square":
        return np.floor(x + 0.5), np.floor(y + 0.5)
    found_i, found_j = np.full_like(x, np.nan), np.full_like(y, np.nan)
    for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1)):
        i, j = np.floor(x - y / 2) + di, np.floor(y) + dj
        q0, q1 = x - i - j / 2, (x - i - j / 2) / 2 + 0.75 * (y - j)
        q = np.stack([q0, q1, q1 - q0])
        inside = ((q >= -0.5) & (q < 0.5)).all(axis=0)
        found_i, found_j = np.where(inside, i, found_i), np.where(inside, j, found_j)
    assert not np.isnan(found_i).any()
    return found_i, found_j


def root(square: np.ndarray, error: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """The root of a number with an error, and the root's error."""
    value = np.sqrt(np.maximum(square, 0.0))
    return value, np.minimum(error / np.maximum(value, 1e-30), np.sqrt(error)) + unit


def ideal(words: tuple[np.ndarray, ...], config: Configuration, build: Build, twin: FixedRays) -> Ideal:
    """Trace rays over the reals; the lenslet that a ray leaves through is the twin's, and where it fits is checked."""
    f, grid = build.fraction_bits, build.grid
    ulp = 2.0**-f
    u, v, a, b = words
    c = {
        key: value * 2.0 ** -bits_and_fraction(key, build)[1]
        for key, value in dataclasses.asdict(config).items()
    }  # fmt: skip
    half_row = 0.5 if grid == "hex" else 0.0
    # Exact: the sum of a coordinate takes less than 55 bits. The twin rounds it to F fraction bits.
    lattice = []
    for axis in "xy":
        from_u, from_v, offset = (getattr(config, f"{axis}_{name}") for name in ("from_u", "from_v", "offset"))
        lattice.append(((u * from_u + v * from_v + offset) >> (40 - f)) * ulp)
    own_i, own_j = nearest(*lattice, grid)
    x, y = lattice[0] - own_i - half_row * own_j, lattice[1] - own_j
    lost = np.zeros(len(u), bool)
    i, j, a, b = own_i, own_j, a * ulp, b * ulp
    if build.aims:
        di, dj = nearest(a, b, grid)
        i, j = i + di, j + dj
        x, y, a, b = x - di - half_row * dj, y - dj, a - di - half_row * dj, b - dj
    rounding = 0.0
    if build.converge:
        x = x + c["converge_share"] * (i + half_row * j) + c["converge_x"]
        y = y + c["converge_share"] * j + c["converge_y"]
        rounding += ulp
    if build.shear:
        x, a = x + c["shear_x"] * y, a + c["shear_x"] * b
        rounding += 2 * ulp * (1.0 + np.abs(c["shear_x"]))
    exact = build.model == "exact"

    def sums(what: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        (k, l), (p, q) = ((c[f"{what}_{axis}"], c[f"{what}_aim_{axis}"]) for axis in "xy")  # noqa: E741
        error = 2 * ulp + rounding * (np.abs(k) + np.abs(l) + np.abs(p) + np.abs(q))
        if what == "slope" and exact and not build.converge:
            return k * (a - x), p * (b - y), error
        if what == "slope" and not (build.aims and (build.converge or build.model == "paraxial")):
            return k * x, p * y, error
        return k * x + build.aims * l * a, p * y + build.aims * q * b, error

    mx, my, m_error = sums("slope")
    hx, hy, h_error = sums("point")
    norm = np.sqrt(1.0 + mx**2 + my**2)
    ex, ey, ez = mx / norm, my / norm, 1.0 / norm
    e_error = m_error + 2 * ulp
    if not exact:
        lost |= (twin.i != i) | (twin.j != j)
        if build.model == "pinhole":
            hx, hy = 0 * hx, 0 * hy
        return Ideal(np.stack([ex, ey, ez]), np.stack([hx, hy, c["exit_z"]]), e_error, h_error, lost)

    # The dome that the twin says: the way to it is a whole number of lenslets.
    di, dj = twin.i - i, twin.j - j
    lost |= (np.abs(di) > build.max_cell_steps) | (np.abs(dj) > build.max_cell_steps)
    if build.shear:
        per_row = c["shear_row"]
    else:
        per_row = (config.cell_pitch_x >> 1) * ulp if grid == "hex" else 0.0
    hx, hy = hx - di * c["cell_pitch_x"] - dj * per_row, hy - dj * c["cell_pitch_y"]
    if build.viewer:
        dx, dy, dz, d_error = ex, ey, -ez, e_error
        zc, rest, up = np.ones_like(x), np.zeros_like(x), -1.0
    else:
        dx, dy = ex * c["index_inverse"], ey * c["index_inverse"]
        square = 1.0 - dx**2 - dy**2
        lost |= square <= 0.0
        d_error = e_error + ulp
        dz, z_error = root(square, 4 * d_error, ulp)
        d_error = d_error + z_error
        zc, rest, up = c["depth"], c["depth_rest"], 1.0
    foot = hx * dx + hy * dy + zc * dz
    size = np.abs(hx) + np.abs(hy) + np.abs(zc)
    foot_error = size * d_error + 2 * h_error + 2 * ulp
    square = rest - hx**2 - hy**2 + foot**2
    square_error = 4 * size * h_error + 2 * np.abs(foot) * foot_error + 2 * ulp
    lost |= square < -square_error
    cos, cos_error = root(np.minimum(square, 1.0), square_error + np.clip(square - 1.0, 0.0, CLAMPED * ulp), ulp)
    lost |= square > 1.0 + square_error + CLAMPED * ulp
    length, length_error = up * cos - foot, cos_error + foot_error + ulp
    n = np.stack([hx + length * dx, hy + length * dy, zc + length * dz])
    n_error = h_error + np.abs(length) * d_error + length_error + SATURATED * ulp
    lost |= (np.abs(n) > 1.0 + n_error).any(axis=0)
    if build.aims or build.viewer or build.converge:
        lost |= outside(n, n_error, c, build)
    sine = 1.0 - np.minimum(square, 1.0)
    if build.viewer:
        return _through_flat(n, n_error, (dx, dy), d_error, cos, cos_error, sine, square_error, c, build, lost)

    below = 1.0 - c["index_square"] * sine
    below_error = np.abs(c["index_square"]) * square_error + 2 * ulp
    lost |= (below <= -below_error) | (below > 1.0 + below_error + CLAMPED * ulp)
    cos_air, air_error = root(np.minimum(below, 1.0), below_error + np.clip(below - 1.0, 0.0, CLAMPED * ulp), ulp)
    bend = cos_air - c["index"] * cos
    bend_error = air_error + np.abs(c["index"]) * cos_error + 2 * ulp
    out = np.stack([ex, ey, c["index"] * dz]) + bend * n
    error = e_error + np.abs(c["index"]) * d_error + bend_error + np.abs(bend) * n_error + SATURATED * ulp
    lost |= (np.abs(out) > 1.0 + error).any(axis=0)
    n[2] -= 1.0
    return Ideal(out, n, error, n_error, lost)


def _through_flat(n, n_error, e, e_error, cos, cos_error, sine, sine_error, c, build, lost) -> Ideal:
    """The rest of the way with the plano side to the viewer."""
    ulp = 2.0**-build.fraction_bits
    inverse, index = c["index_inverse"], c["index"]
    below = 1.0 - c["index_inverse_square"] * sine
    below_error = np.abs(c["index_inverse_square"]) * sine_error + 2 * ulp
    lost |= (below < -below_error) | (below > 1.0 + below_error + CLAMPED * ulp)
    inner, inner_error = root(np.minimum(below, 1.0), below_error + np.clip(below - 1.0, 0.0, CLAMPED * ulp), ulp)
    bend = inner - cos * inverse
    bend_error = inner_error + cos_error + 2 * ulp
    dx, dy = (inverse * k - bend * m for k, m in zip(e, n[:2], strict=True))
    d_error = e_error + bend_error + np.abs(bend) * n_error + SATURATED * ulp
    lateral, lateral_error = dx**2 + dy**2, 4 * d_error
    lost |= (lateral >= 1.0 + lateral_error) | (np.maximum(np.abs(dx), np.abs(dy)) > 1.0 + d_error)
    dz, dz_error = root(1.0 - lateral, lateral_error, ulp)
    path = (n[2] - c["depth"]) / np.maximum(dz, 1e-9)
    x, y = n[0] + path * dx, n[1] + path * dy
    path_error = (n_error + np.abs(path) * dz_error) / np.maximum(dz, 1e-9) + 4 * ulp
    shift = n_error + path_error + np.abs(path) * d_error + 2 * ulp
    above = 1.0 - c["index_square"] * lateral
    above_error = np.abs(c["index_square"]) * lateral_error + 2 * ulp
    lost |= (above <= -above_error) | (above > 1.0 + above_error + CLAMPED * ulp)
    out_z, z_error = root(np.minimum(above, 1.0), above_error + np.clip(above - 1.0, 0.0, CLAMPED * ulp), ulp)
    turn = np.abs(index) * d_error + z_error + SATURATED * ulp
    lost |= np.maximum(np.abs(index * dx), np.abs(index * dy)) > 1.0 + turn
    return Ideal(np.stack([index * dx, index * dy, out_z]), np.stack([x, y, c["exit_z"]]), turn, shift, lost)


def outside(n: np.ndarray, error: np.ndarray, c: dict[str, np.ndarray], build: Build) -> np.ndarray:
    """Which points on the dome are not in its cell."""
    q0 = n[0] - c["shear_lean"] * n[1] if build.shear else n[0]
    slack = 12 * error
    if build.grid == "square":
        return (np.abs(q0) > c["cell_half"] + slack) | (np.abs(n[1]) > c["cell_half_y"] + slack)
    q1 = n[0] / 2 + c["cell_rise"] * n[1]
    return np.max(np.abs([q0, q1, q1 - q0]), axis=0) > c["cell_half"] + slack


def wrong(random: np.random.Generator, build: Build, count: int, displays: int) -> tuple[np.ndarray, ...]:
    """Trace rays, each with its own registers; tell which get through, are wrong, are checked closely."""
    config = any_registers(random, build, count, displays)
    words = any_rays(random, build, count)
    twin = ray_pipeline(*words, config, build)
    with np.errstate(invalid="ignore", over="ignore"):
        real = ideal(words, config, build, twin)
    unit = 2.0 ** -(build.fraction_bits + 1)
    direction = np.stack([twin.dx, twin.dy, twin.dz]) * unit
    origin = np.stack([twin.x, twin.y, twin.z]) * unit
    through = gets_through(twin.status)
    turned = np.abs(direction - real.direction).max(axis=0) > real.turn
    shifted = np.abs(origin - real.origin).max(axis=0) > real.shift
    checked = through & (real.turn < 0.05) & (real.shift < 0.05)
    return through, through & (real.lost | turned | shifted), checked


@pytest.mark.parametrize("count", [20_000, pytest.param(100_000, marks=pytest.mark.full)])
@pytest.mark.parametrize("build", BUILDS, ids=name)
def test_no_register_set_gives_a_wrong_direction_unsaid(build, count):
    print(f"seed {SEED}")
    random = np.random.default_rng([SEED, *name(build).encode()])
    through, bad, checked = wrong(random, build, count, 20)
    print(
        f"{through.sum()} rays get through, {checked.sum()} of them checked within a twentieth of a radian and radius"
    )
    assert not bad.any(), f"{bad.sum()} of {through.sum()} rays, first {np.flatnonzero(bad)[0]}"
    assert checked.sum() > 0.2 * count
