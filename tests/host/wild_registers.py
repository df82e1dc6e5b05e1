"""Registers written by hand: any words that the bus accepts, and rays for them."""

import dataclasses

import numpy as np
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.words import OFFSET_BITS, PIXEL_BITS, SLOPE_BITS
from random_cases import configured_display


def bits_and_fraction(register: str, build: Build) -> tuple[int, int]:
    """Bits of a register's word, and its fraction bits, as rtl/optics/lipp_optics_pkg.sv lists them."""
    f = build.fraction_bits
    if register in ("x_offset", "y_offset"):
        return OFFSET_BITS, 40
    if "_from_" in register:
        return SLOPE_BITS, 36
    wide, near, far = (f + 2, f), (f + 2, f + 1), (f + 4, f)
    special = {
        "index": (f + 3, f), "index_square": far, "index_inverse": near, "index_inverse_square": far, "depth": far,
        "depth_rest": (f + 9, f + 3), "exit_z": (f + 4, f + 1), "cell_half": near, "cell_half_y": near,
        "cell_rise": (f + 4, f + 1), "converge_share": (f + 9, f + 11), "converge_x": (f + 9, f + 2),
        "converge_y": (f + 9, f + 2), "extent_i": (14, 0), "extent_j": (13, 0), "shear_x": far,
    }  # fmt: skip
    if register.startswith("slope_"):
        more = build.model == "exact" and not build.viewer and f > 16
        return f + 2 + more, f + more
    return special.get(register, wide)


def wild(random: np.random.Generator, bits: int, accepted: int, count: int) -> np.ndarray:
    """Words of so many bits: uniform, of any magnitude, at the ends; a few of all `accepted` bits of the bus."""
    top = 1 << (bits - 1)
    uniform = random.integers(-top, top, count)
    magnitude = (2.0 ** random.uniform(0, bits - 1, count)).astype(np.int64) * random.choice([-1, 1], count)
    ends = random.choice([-top, -top + 1, top - 1, 0, 1, -1], count)
    words = np.choose(random.choice(3, count, p=[0.4, 0.4, 0.2]), [uniform, magnitude, ends])
    beyond = random.integers(-(1 << (accepted - 1)), 1 << (accepted - 1), count)
    return np.where(random.random(count) < 0.03, beyond, np.clip(words, -top, top - 1))


def any_registers(random: np.random.Generator, build: Build, count: int, displays: int) -> Configuration:
    """`count` sets of registers, a field an array: those of random displays, a random share of the words replaced.

    Some indices and depths come with their squares and inverses, so that rays get far. Some sets have large points and
    pitches and the widest cells, some lie at the ends of the lattice's words.
    """
    f = build.fraction_bits
    bases = [dataclasses.astuple(configured_display(random, build, build.model)[1]) for _ in range(displays)]
    names = [field.name for field in dataclasses.fields(Configuration)]
    table = np.array(bases, np.int64)[random.integers(0, displays, count)].T
    made = dict(zip(names, table.copy(), strict=True))
    share = random.choice([0.0, 0.03, 0.1, 0.3, 1.0], count, p=[0.1, 0.4, 0.3, 0.15, 0.05])
    for register in names:
        bits, _ = bits_and_fraction(register, build)
        accepted = bits if bits > 32 else 32
        made[register] = np.where(random.random(count) < share, wild(random, bits, accepted, count), made[register])
    low, one = 2.0**-f, 1 << f
    index = np.floor(np.exp(random.uniform(0.0, np.log(3.999), count)) * one) * low
    depth = np.floor(random.uniform(-7.99, 1.0, count) * one) * low
    extent = random.random(count) < 0.9
    for which, values in (
        (random.random(count) < 0.2, {
            "index": index * one, "index_square": index**2 * one, "index_inverse": 2 * one / index,
            "index_inverse_square": one / index**2,
        }),
        (random.random(count) < 0.2, {"depth": depth * one, "depth_rest": (1.0 - depth**2) * 8 * one}),
        (random.random(count) < 0.1, {
            **{f"{which}_{axis}": random.uniform(-2.0, 2.0, count) * one
               for which in ("point", "point_aim", "cell_pitch") for axis in "xy"},
            "shear_row": random.uniform(-2.0, 2.0, count) * one, "cell_half": np.full(count, 2.0 * one),
            "cell_half_y": np.full(count, 2.0 * one), "index_inverse": random.uniform(0.5, 1.0, count) * 2 * one,
        }),
        (random.random(count) < 0.05, {
            f"{axis}_offset": (2046.5 * random.choice([-1, 1], count) + random.uniform(-2, 2, count)) * 2.0**40
            for axis in "xy"
        }),
        (extent, {"extent_i": np.full(count, 8191.0), "extent_j": np.full(count, 4095.0)}),
    ):  # fmt: skip
        for register, value in values.items():
            bits, _ = bits_and_fraction(register, build)
            top = 1 << (bits - 1)
            made[register] = np.where(
                which, np.clip(np.floor(value + 0.5), -top, top - 1).astype(np.int64), made[register]
            )
    return Configuration(**made)


def any_rays(random: np.random.Generator, build: Build, count: int) -> tuple[np.ndarray, ...]:
    """Pixels and aims of any words; half of the pixels near the panel's centre, half of the aims in the own cell."""
    top, one = 1 << (PIXEL_BITS - 1), 1 << build.fraction_bits
    u, v = random.integers(-top, top, (2, count)) >> random.choice([0, 0, 4, 8], count)
    a, b = random.integers(-2 * one, 2 * one, (2, count)) >> random.choice([0, 1, 2, 2, 4], count)
    return (u, v, a, b) if build.aims else (u, v, 0 * a, 0 * b)
