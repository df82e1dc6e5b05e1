"""The fixed-point pipeline against golden, within what is promised; and the error report's own tools.

u = 2^-F below, half of it the rounding of a wide word. What is promised of the exact model at F = 23, max(1, 0.5 /
cos theta_t) microradian and 2 nm, is asked of each F in proportion to u.
"""

import os

import click.testing
import numpy as np
import pytest
from lippmann.display.description import load_display
from lippmann.engines import trace, trace_fixed
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, words_of_aims, words_of_pixels
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.optics.rays import MODELS, gets_through
from lippmann.simulation.toolchain import repository
from optics_cases import random_in_cell, twin_errors
from tools import bench, fixed_errors, stage_errors
from tools.named_builds import CONFIGURATIONS, DISPLAYS, turned_over

SCENES = repository() / "scenes"
RAYS = 20_000
SEED = 7


def shipped(name, side):
    display = load_display(SCENES / "displays" / f"{name}.toml")
    return display if side == "panel" else turned_over(display)


def random_words(display, build, count=RAYS, seed=SEED):
    """Random pixels, and aims in the cell where the build has any, as words."""
    print(f"seed {seed}")
    random = np.random.default_rng(seed)
    panel = display.panel
    size = (panel.width_px, panel.height_px)
    u, v = words_of_pixels(display, random.uniform((0, 0), size, (count, 2)))
    if not build.aims:
        return fixed_errors.Words(u, v, 0 * u, 0 * u)
    points = random_in_cell(random, display, count)
    assert len(points) == count
    return fixed_errors.Words(u, v, *words_of_aims(display, points, build.fraction_bits))


def direction_bound(display, model, f):
    """Largest angle of an ideal model's direction, in radians.

    Each slope is k x + l a. k and l are words, u/2 off, times |x| < 0.6 and |a| < 0.6; x is u/2 off, times k; the sum
    is rounded, u/2, its products cut off, u/8 each. The slopes' errors turn the ray by their length at most. In
    `unit_slope` the root is a word off, u/2, and scales a vector of length 2 at most (slopes stay below sqrt(3)); its
    argument is 3u/8 off, half of which counts; the two products are rounded, u/4, and cut off, u/16.
    """
    k = display.array.pitch_mm / display.aperture_distance_mm
    sums = 1 if model == "pinhole" else 2
    slope = (0.3 * sums + 0.5 * k + 0.5 + 0.125 * sums) * np.sqrt(2.0)
    unit = 0.5 * 2.0 + 0.5 * 0.375 + (0.25 + 0.0625) * np.sqrt(2.0)
    return (slope + unit) * 2.0**-f


@pytest.mark.parametrize("f", [16, 23])
@pytest.mark.parametrize("side", ["panel", "viewer"])
@pytest.mark.parametrize("name", [*DISPLAYS["square"], *DISPLAYS["hex"]])
@pytest.mark.parametrize("aperture", ["chief", "full"])
@pytest.mark.parametrize("model", MODELS)
def test_against_golden(model, aperture, name, side, f):
    display = shipped(name, side)
    build = Build.of(display, model, f, aperture == "full")
    words = random_words(display, build)
    aims = aims_of_words(display, words.a, words.b, f) if build.aims else None
    # The pixels are words already: nothing is rounded away before the comparison.
    pixel = pixels_of_words(display, words.u, words.v)
    twin = trace_fixed(display, pixel, aims, model, f)
    golden = trace(display, twin.pixel, aims, model)
    assert (twin.pixel == pixel).all()

    same = (twin.status == golden.status) & (twin.lenslet == golden.lenslet).all(axis=1)
    active = same & gets_through(golden.status)
    assert active.sum() > 0.95 * RAYS
    turn = np.linalg.norm(twin.direction - golden.direction, axis=1)[active]
    angle, shift = (errors[active] for errors in twin_errors(display, twin, golden))
    stated_nm = 2.0 * 2 ** (23 - f)
    if model == "exact":
        assert angle.max() <= 2 ** (23 - f)
        assert shift.max() <= stated_nm
    else:
        assert turn.max() <= direction_bound(display, model, f)
        # Two coordinates: the rounding of two coefficients times 0.6, of x, of the sum, and its cut-off products.
        assert shift.max() <= np.sqrt(2.0) * (0.6 + 0.5 + 0.5 + 0.25) * 2.0**-f * display.array.radius_mm * 1e6
    # The bounds are no more than some times what there is: a pipeline of one bit less would be seen.
    assert turn.max() > 2.0**-f * 0.4

    differs = np.flatnonzero(~same)
    assert len(differs) < 0.001 * RAYS
    if len(differs):
        some = fixed_errors.Words(*(column[differs] for column in words))
        rows = fixed_errors.rows_of(twin, differs)
        away = fixed_errors.edge_distance_nm(display, build, some, rows, stated_nm, model)
        assert away.max() <= stated_nm


@pytest.mark.parametrize("name", ["compact-square", "compact-hex"])
def test_compact_configurations_promise_60_microradian_on_the_papers_displays(name):
    named = CONFIGURATIONS[name]
    display = named.displays(SCENES)[0]
    found = fixed_errors.compare(display, named.build, random_words(display, named.build, 200_000))
    assert found.alive.mean() > 0.999
    assert found.turn_urad[found.alive].max() <= 60.0


@pytest.mark.parametrize("name", ["widest-aims-square", "widest-aims-hex"])
def test_the_promise_holds_beyond_the_owners_cell(name):
    """Aims up to one and a half pitches away: long ways through the glass magnify what is rounded before them."""
    named, seed = CONFIGURATIONS[name], int(os.environ.get("LIPPMANN_SEED", SEED))
    print(f"seed {seed}")
    for display in named.displays(SCENES):
        wide = fixed_errors.wide_words(display, named.build, seed, 100_000)
        # Pairs of rays, a word of the aim apart, on both sides of golden's boundaries.
        onsets = fixed_errors.boundary_words(display, named.build, seed, 5_000)
        for words in (wide, onsets):
            row = fixed_errors.measure(named, display, "wide", iter([words]))
            assert row["kept"], row
            assert row["rays"] - row["refused"] > 1_000
        assert row["status_differs"] > 0


BUDGETED = ["widest-square", "widest-hex", "widest-aims-hex", "converged-hex"]
#: Of these budgets at every commit: each grid, both sides, one with aims.
USUAL = ["widest-aims-square", "compact-hex", "viewer-square"]


@pytest.mark.parametrize("name", [*BUDGETED, *USUAL])
def test_steps_in_integers_are_the_twin(name):
    build = CONFIGURATIONS[name].build
    for display in CONFIGURATIONS[name].displays(SCENES):
        config = configuration(display, build, "exact")
        words = random_words(display, build)
        twin = ray_pipeline(*words, config, build)
        point, direction, lenslet = next(stage_errors.hybrids(build, config, words, len(stage_errors.steps_of(build))))
        active = gets_through(twin.status)
        assert active.mean() > 0.95
        out = np.ldexp(np.column_stack([point, direction]), build.fraction_bits + 1)
        assert (out == np.column_stack([twin.x, twin.y, twin.z, twin.dx, twin.dy, twin.dz]))[active].all()
        assert (lenslet == np.column_stack([twin.i, twin.j]))[active].all()


@pytest.mark.parametrize("name", [*USUAL, *(pytest.param(name, marks=pytest.mark.full) for name in BUDGETED)])
def test_steps_in_float64_are_golden_but_for_the_configuration(name):
    """Of the configuration's words, each u/2 off or less, some twenty count, each less than once in radii."""
    named = CONFIGURATIONS[name]
    f = named.build.fraction_bits
    for display in named.displays(SCENES):
        rows = {row["stage"]: row for row in stage_errors.budget(named, display, SEED)}
        first, last = rows["configuration"], rows["all"]
        assert 0.0 < first["rms_direction_urad"] < 10.0 * 2.0**-f * 1e6
        assert 0.0 < first["max_point_nm"] < 10.0 * 2.0**-f * display.array.radius_mm * 1e6
        # What only adds integers adds no error.
        assert rows[f"lenslet_{named.build.grid}"]["max_direction_urad"] < 1e-3
        # Shares are of one size, and independent: their squares add up, within a factor of two.
        squares = sum(row["rms_direction_urad"] ** 2 for stage, row in rows.items() if stage != "all")
        assert 0.25 < squares / last["rms_direction_urad"] ** 2 < 4.0


def test_report(monkeypatch, tmp_path):
    for name in ("WHOLE", "ADVERSARIAL"):
        monkeypatch.setattr(fixed_errors, name, 5_000)
    arguments = ["fixed", "--scenes", str(SCENES), "--configuration", "widest-square", "--report", str(tmp_path)]
    result = click.testing.CliRunner().invoke(bench.command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    page = (tmp_path / "fixed-point-error.md").read_text()
    for said in ("machine: ", "date: ", "command: python -m tools.bench fixed", "--seed 0", "| widest-square | 23 |"):
        assert said in page
    assert "**no**" not in page
    rows = (tmp_path / "fixed-point-error.csv").read_text().splitlines()
    assert rows[-1].startswith("widest-square,23,uhd-8k,edges,")
    assert (tmp_path / "fixed-point-budget.csv").exists()
    assert (tmp_path / "fixed-point-error.png").exists()
