"""RTL against twin through the batch harness: 0 LSB, over random displays, rays and stalls."""

import os
from collections.abc import Sequence

import numpy as np
import pytest
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import words_of_pixels
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import WIDEST
from lippmann.optics.rays import Status
from lippmann.simulation.compilation import FAST, SHORT
from lippmann.simulation.harness import ray_harness
from lippmann.simulation.toolchain import repository
from random_cases import configured_display, random_rays

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))

#: Few enough to compile on every commit; each module of the RTL is in one of them.
BUILDS = [
    Build(16, "hex"),
    Build(20, "hex", "paraxial", aims=True),
    Build(23, "hex", max_cell_steps=1, converge=True),
    Build(18, "square", viewer=True, aims=True, max_cell_steps=1, converge=True),
    Build(22, "hex", aims=True, max_cell_steps=1, shear=True),
    Build(17, "square", viewer=True, max_cell_steps=2, shear=True, converge=True, cross_cells=True),
    Build(14, "square", "pinhole"),
]
GRIDS = ("square", "hex")
#: Every kind of build.
ALL_BUILDS = [
    *(Build(f, grid) for f in (14, 16, 22, 23) for grid in GRIDS),
    *(Build(f, grid, cross_cells=True) for f in (19, 23) for grid in GRIDS),
    *(Build(23, grid, aims=True, max_cell_steps=steps) for grid in GRIDS for steps in (0, 1, 2, 4)),
    *(
        Build(f, grid, viewer=True, aims=aims, max_cell_steps=2)
        for f in (16, 23)
        for grid in GRIDS
        for aims in (False, True)
    ),
    *(Build(f, grid, "paraxial", aims=aims) for f in (16, 23) for grid in GRIDS for aims in (False, True)),
    *(Build(23, grid, "pinhole") for grid in GRIDS),
    *(Build(f, grid, converge=True) for f in (16, 23) for grid in GRIDS),
    *(
        Build(23, grid, viewer=viewer, aims=aims, max_cell_steps=2, converge=True)
        for viewer, aims in ((False, False), (False, True), (True, False), (True, True))
        for grid in GRIDS
    ),
    Build(19, "hex", aims=True, max_cell_steps=2, cross_cells=True, converge=True),
    *(Build(23, grid, "paraxial", aims=True, converge=True) for grid in GRIDS),
    *(Build(23, grid, "pinhole", converge=True) for grid in GRIDS),
    *(Build(f, grid, shear=True) for f in (16, 23) for grid in GRIDS),
    *(
        Build(23, grid, viewer=viewer, aims=aims, max_cell_steps=2, converge=converge, shear=True)
        for viewer, aims, converge in (
            (False, True, False), (False, False, True), (False, True, True), (True, False, False),
            (True, True, False), (True, True, True),
        )
        for grid in GRIDS
    ),
    Build(19, "square", aims=True, max_cell_steps=2, cross_cells=True, shear=True),
    *(Build(23, grid, "paraxial", aims=True, shear=True) for grid in GRIDS),
    *(Build(23, grid, "pinhole", shear=True) for grid in GRIDS),
]  # fmt: skip


def name(build: Build) -> str:
    parts = [build.grid, build.model, f"F{build.fraction_bits}"]
    parts += ["viewer"] * build.viewer + ["aims"] * build.aims
    parts += [f"steps{build.max_cell_steps}"] * (build.max_cell_steps > 0)
    parts += ["cells"] * build.cross_cells + ["converge"] * build.converge
    return "-".join(parts + ["shear"] * build.shear)


def assert_equal(rtl: FixedRays, twin: FixedRays) -> None:
    for field, got, wanted in zip(FixedRays._fields, rtl, twin, strict=True):
        wrong = np.flatnonzero(got != wanted)
        assert not len(wrong), (
            f"{field} differs in {len(wrong)} rays, first ray {wrong[0]}: {got[wrong[0]]}, twin {wanted[wrong[0]]}"
        )


def compare(build: Build, displays: int, rays: int, flags: Sequence[str]) -> np.ndarray:
    """Trace through both, the RTL compiled with some flags; returns how often each status came up."""
    print(f"seed {SEED}")
    random = np.random.default_rng([SEED, *name(build).encode()])
    seen = np.zeros(len(Status), np.int64)
    for number in range(displays):
        # The paraxial hardware is also that of the model thin.
        model = "thin" if build.model == "paraxial" and number % 2 else build.model
        display, config = configured_display(random, build, model)
        while number == 0 and display.array.extent_mm is None:  # rays beside an array are in every comparison
            display, config = configured_display(random, build, model)
        words = random_rays(random, display, build, rays)
        idle, stall = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.4), (0.5, 0.5), (0.02, 0.9)][number % 5]
        rtl = ray_harness(build, flags).trace(
            *words, config, seed=int(random.integers(1 << 62)), idle=idle, stall=stall
        )
        twin = ray_pipeline(*words, config, build)
        assert_equal(rtl, twin)
        seen += np.bincount(twin.status, minlength=len(Status))
    return seen


@pytest.mark.parametrize("build", BUILDS, ids=name)
def test_rtl_equals_twin(build):
    seen = compare(build, 10, 3000, SHORT)
    assert seen[Status.OK] > 0
    assert seen[Status.BLOCKED] > 0
    if build.aims:
        assert seen[Status.CROSSTALK] > 0


#: Displays for each kind of build, and rays for each display: ten million in all.
DISPLAYS, RAYS = 40, 10_000_000 // len(ALL_BUILDS) // 40 + 1


@pytest.mark.full
@pytest.mark.parametrize("build", ALL_BUILDS, ids=name)
def test_rtl_equals_twin_over_ten_million_rays(build):
    compare(build, DISPLAYS, RAYS, FAST)


def test_the_reference_says_how_much_is_compared():
    page = (repository() / "docs/reference/rtl.md").read_text()
    assert f"{len(ALL_BUILDS)} kinds of build, each with {DISPLAYS * RAYS:,} rays" in page


@pytest.mark.full
@pytest.mark.parametrize("display_name", ["paper-square", "paper-hex"])
@pytest.mark.parametrize("fraction_bits", [16, WIDEST])
def test_whole_frame(display_name, fraction_bits):
    display = load_display(f"scenes/displays/{display_name}.toml")
    build = Build(fraction_bits, display.array.grid, cross_cells=True)
    config = configuration(display, build, "exact")
    rows, columns = np.divmod(np.arange(display.panel.width_px * display.panel.height_px), display.panel.width_px)
    u, v = words_of_pixels(display, np.stack([columns + 0.5, rows + 0.5], axis=1))
    zero = np.zeros_like(u)
    rtl = ray_harness(build).trace(u, v, zero, zero, config)
    for part in np.array_split(np.arange(len(u)), 20):
        assert_equal(
            FixedRays(*(field[part] for field in rtl)),
            ray_pipeline(u[part], v[part], zero[part], zero[part], config, build),
        )


def test_one_ray_a_clock():
    """Nothing stalls: as many clocks as rays, and the way of the last."""
    build = BUILDS[-1]
    random = np.random.default_rng(SEED)
    display, config = configured_display(random, build, "pinhole")
    words = random_rays(random, display, build, 10_000)
    engine = ray_harness(build, SHORT)
    clocks = []
    for count in (5_000, 10_000):
        engine.trace(*(word[:count] for word in words), config)
        clocks.append(engine.clocks)
    assert clocks[1] - clocks[0] == 5_000
