"""RTL against twin on the hard cases, and with registers at their largest and smallest words: 0 LSB.

The host never writes most of these words: it refuses slopes beyond 60 degrees, a negative half cell and the like
(`lippmann.fixed.configuration`). RTL and twin are equal for them, too. The case register-limits tests the ends of the
ranges that the host writes.
"""

import dataclasses

import numpy as np
import pytest
from lippmann.conformance.hard_cases import changed, hard_sets
from lippmann.conformance.ray_sets import PanelRays, fixed_words
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import OFFSET_BITS, SLOPE_BITS
from lippmann.optics.rays import gets_through
from lippmann.simulation.compilation import SHORT
from lippmann.simulation.harness import ray_harness
from lippmann.simulation.toolchain import repository
from random_cases import configured_display, random_rays
from test_batch import BUILDS, SEED, assert_equal, name
from wild_registers import any_rays, any_registers

#: Builds of the batch test whose rays have aims; they are compiled already.
AIMED = [build for build in BUILDS if build.aims and build.model == "exact"]


@pytest.mark.parametrize("build", AIMED, ids=name)
def test_rtl_equals_twin_on_hard_cases(build):
    print(f"seed {SEED}")
    base = load_display(repository() / f"scenes/displays/paper-{build.grid}.toml")
    side = "viewer" if build.viewer else "panel"
    base = changed(base, plano_side=side, gap_mm=base.array.focal_length_mm if build.viewer else base.gap_mm)
    base = dataclasses.replace(base, viewing_distance_mm=600.0 if build.converge else None)
    if build.shear:
        base = changed(base, shear=0.2)
    compared = 0
    for rays in hard_sets(base, "all", SEED, 24):
        case = fixed_words(rays, build.fraction_bits, build.max_cell_steps)[0] if isinstance(rays, PanelRays) else None
        # The case converged has displays of the other kind of build.
        if case is not None and (case.build.converge, case.build.shear) == (build.converge, build.shear):
            assert case.build == build
            twin = ray_pipeline(*case.words, case.registers, build)
            assert_equal(ray_harness(build, SHORT).trace(*case.words, case.registers), twin)
            compared += len(twin.status)
    assert compared > 500


def extremes(random: np.random.Generator, registers: Configuration, build: Build) -> Configuration:
    """Some registers at their largest or smallest word, whether or not a display could ask for them."""
    values = {}
    for field in dataclasses.fields(Configuration):
        if random.random() < 0.3:
            bits = width(field.name, build)
            values[field.name] = int(random.choice([(1 << (bits - 1)) - 1, 0, 1, -1, -(1 << (bits - 1))]))
    return dataclasses.replace(registers, **values)


def width(register: str, build: Build) -> int:
    """Bits of a register, as docs/generated/registers.md lists them."""
    near = build.near
    widths = {"index": near + 1, "depth_rest": build.fraction_bits + 9, "extent_i": 14, "extent_j": 13}
    far = ("index_square", "index_inverse_square", "depth", "exit_z", "cell_rise", "shear_x")
    if register in ("x_offset", "y_offset"):
        return OFFSET_BITS
    if "_from_" in register:
        return SLOPE_BITS
    return near + 2 if register in far else widths.get(register, near)


@pytest.mark.parametrize("build", BUILDS, ids=name)
def test_rtl_equals_twin_with_registers_at_their_ends(build):
    print(f"seed {SEED}")
    random = np.random.default_rng([SEED, 6, *name(build).encode()])
    for _ in range(30):
        display, registers = configured_display(random, build, build.model)
        registers = extremes(random, registers, build)
        words = random_rays(random, display, build, 100)
        assert_equal(ray_harness(build, SHORT).trace(*words, registers), ray_pipeline(*words, registers, build))


@pytest.mark.parametrize("build", BUILDS, ids=name)
def test_rtl_equals_twin_with_any_words_in_the_registers(build):
    """tests/host/test_fixed_wraps.py tells which of these rays the twin may call good."""
    print(f"seed {SEED}")
    random = np.random.default_rng([SEED, 7, *name(build).encode()])
    sets = dataclasses.asdict(any_registers(random, build, 300, 10))
    through = 0
    for k in range(300):
        registers = Configuration(**{field: int(values[k]) for field, values in sets.items()})
        words = any_rays(random, build, 30)
        twin = ray_pipeline(*words, registers, build)
        assert_equal(ray_harness(build, SHORT).trace(*words, registers), twin)
        through += int(gets_through(twin.status).sum())
    assert 300 < through < 8900
