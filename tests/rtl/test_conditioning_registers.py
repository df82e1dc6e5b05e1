"""RTL against twin on the hard cases, and with any words in the registers: 0 LSB.

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
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.optics.rays import gets_through
from lippmann.simulation.compilation import SHORT
from lippmann.simulation.harness import ray_harness
from lippmann.simulation.toolchain import repository
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
