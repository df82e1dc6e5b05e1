"""The models: `choose_model` against brute force, how they nest and where crosstalk begins, and what is refused."""

import dataclasses
import inspect
import itertools
import math

import drjit
import lippmann
import numpy as np
import pytest
from hypothesis import example, given, seed, settings
from hypothesis import strategies as st
from lippmann.conformance.ray_sets import random_aims, random_pixels
from lippmann.errors import MissingLibraryError
from lippmann.optics.model_choice import choose_model, reconstructed_pixel_mm
from lippmann.optics.rays import MODELS, Status
from lippmann.optics.trace import backend_of
from optics_cases import GRIDS, SIDES, display_of, random_display
from scene_cases import focused_display, generator

SEED = 9107
PANEL = {"width_px": 160, "height_px": 120, "pixel_pitch": 0.05}
COUNTED = (Status.OK, Status.CROSSTALK)


@st.composite
def displays(draw):
    """Displays of 8 x 6 mm with lenslets that span their cells."""
    grid, side = draw(st.sampled_from(["square", "hex"])), draw(st.sampled_from(["panel", "viewer"]))
    radius = draw(st.floats(0.75, 12.0))
    index = draw(st.floats(1.35, 1.9))
    focal = radius / (index - 1.0)
    thickness = None if draw(st.booleans()) else draw(st.floats(0.75, 3.0))
    gap = focal * draw(st.floats(0.3, 1.2))
    place = {
        "rotation": draw(st.sampled_from([0.0, 11.0, 45.0])),
        "offset": (draw(st.floats(-1.0, 1.0)), draw(st.floats(-1.0, 1.0))),
    }
    return display_of(grid, side, radius=radius, index=index, thickness=thickness, gap=gap, **place, **PANEL)


def brute_force(display, model, depths):
    """The largest distance from exact over every pixel's centre, in reconstructed pixels; inf where rays differ."""
    v, u = np.mgrid[0 : display.panel.height_px, 0 : display.panel.width_px] + 0.5
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    truth, rays = lippmann.trace(display, pixels, None, "exact"), lippmann.trace(display, pixels, None, model)
    if not np.isin(truth.status, COUNTED).all() or (truth.lenslet != rays.lenslet).any():
        return math.inf

    def at(rays, z):
        return (rays.origin_mm + ((z - rays.origin_mm[:, 2]) / rays.direction[:, 2])[:, None] * rays.direction)[:, :2]

    return max(
        np.linalg.norm(at(truth, z) - at(rays, z), axis=1).max()
        # A reconstructed pixel: the lenslet, or what a pixel spreads to at that depth.
        / max(display.array.pitch_mm, abs(z) * display.panel.pixel_pitch_mm / display.aperture_distance_mm)
        for z in depths
    )


@seed(SEED)
@settings(max_examples=30, deadline=None, derandomize=True, print_blob=True)
@given(
    display=displays(),
    far=st.floats(-200.0, 0.0),
    deep=st.floats(0.0, 300.0),
    tolerance=st.sampled_from([0.02, 0.25, 1.0]),
)
@example(
    # Within tolerance at both ends, twice as much where pixels begin to spread.
    display=display_of("square", "viewer", radius=0.75, index=1.375, thickness=1.0, gap=1.0, **PANEL),
    far=-52.0,
    deep=104.0,
    tolerance=0.02,
)
def test_the_choice_holds_over_the_whole_panel(display, far, deep, tolerance):
    ends = (far, far + deep)
    choice = choose_model(display, ends, tolerance=tolerance)
    # Depths between the ends count too: the error may be largest where a pixel begins to spread beyond the lenslet.
    depths = np.linspace(*ends, 25)
    true = {model: brute_force(display, model, depths) for model in MODELS[:-1]}
    if choice.model != "exact":
        assert true[choice.model] <= tolerance
        assert choice.error_px[choice.model] <= tolerance
    # No cheaper model is good enough. The probe's error is real: brute force over the few pixels of a small panel
    # and 25 depths must find at least half of it.
    for cheaper in MODELS[: MODELS.index(choice.model)]:
        assert choice.error_px[cheaper] > tolerance
        assert true[cheaper] > 0.5 * tolerance


@pytest.mark.parametrize("aperture", ["chief", "full"])
@pytest.mark.parametrize(("grid", "side"), list(itertools.product(("square", "hex"), ("panel", "viewer"))))
def test_a_long_focus_needs_little_and_a_steep_dome_needs_exact(grid, side, aperture):
    gentle = focused_display(grid, side, focal=40.0, width_px=100, height_px=80, pixel_pitch=0.1)
    choice = choose_model(gentle, (-20.0, 20.0), aperture)
    # Chief rays of a long lens are straight; the whole lenslet bends them, which the pinhole does not know.
    assert choice.model != "exact"
    if aperture == "full":
        assert choice.error_px["pinhole"] > choice.tolerance
    steep = display_of(grid, side, radius=0.72, index=1.9, thickness=None, gap=0.5)
    choice = choose_model(steep, (-100.0, 100.0), "full")
    assert choice.model == "exact"
    assert list(choice.error_px) == list(MODELS)
    assert choice.error_px["exact"] == 0.0


def disagreeing(display, model, rng, count=20_000):
    """Return which random rays over whole cells differ from exact, and their aims' reach (1: the border)."""
    pixels, aims = random_pixels(display, rng, count), random_aims(display, rng, count)
    pixels = pixels[: len(aims)]
    truth, rays = lippmann.trace(display, pixels, aims), lippmann.trace(display, pixels, aims, model)
    there, same = np.isin(truth.status, COUNTED), (truth.lenslet == rays.lenslet).all(axis=1)
    turns = 2 * np.pi * np.arange(6 if display.array.grid == "hex" else 4) / (6 if display.array.grid == "hex" else 4)
    reach = (aims @ np.stack([np.cos(turns), np.sin(turns)])).max(axis=1) / (0.5 * display.array.pitch_mm)
    return (there != np.isin(rays.status, COUNTED)) | (there & ~same), reach


@pytest.mark.parametrize(
    ("grid", "side"),
    [
        ("square", "panel"),
        ("hex", "viewer"),
        pytest.param("square", "viewer", marks=pytest.mark.full),
        pytest.param("hex", "panel", marks=pytest.mark.full),
    ],
)
def test_over_the_full_aperture_only_the_very_rim_may_leave_elsewhere(grid, side):
    """Probed to 97 % of the corners, models were taken that had up to 2 % of the rays in the wrong lenslet."""
    taken, worst = 0, 0.0
    for number in range(60):
        rng = generator(SEED, grid, side, number)
        display = random_display(rng, grid, side, steepest=1.2, widest_mm=60.0)
        reach = display.array.pitch_mm * display.aperture_distance_mm / display.panel.pixel_pitch_mm
        far, near = sorted(rng.uniform(-2.0, 2.0, 2) * reach)
        model = choose_model(display, (far, near), "full", float(rng.choice([0.25, 1.0, 4.0]))).model
        if model == "exact":
            continue
        taken += 1
        bad, reach = disagreeing(display, model, rng)
        assert (reach[bad] > 0.995).all(), (number, model, reach[bad].min())
        worst = max(worst, bad.mean())
    print(f"{taken} of 60 take a simpler model; worst {100 * worst:.2f} %")
    assert taken > 4
    assert worst < 0.005


def test_tolerance_decides_and_the_message_says_why():
    display = focused_display("square", focal=4.0, width_px=200, height_px=160, pixel_pitch=0.05)
    chosen = [choose_model(display, (-60.0, 60.0), "full", t).model for t in (1e-9, 0.01, 0.25, 1.0, 10.0, 1e3)]
    ranks = [MODELS.index(model) for model in chosen]
    assert ranks == sorted(ranks, reverse=True)
    assert chosen[0] == "exact"
    assert chosen[-1] == "pinhole"
    choice = choose_model(display, (-60.0, 60.0))
    assert str(choice).startswith(f"model {choice.model}: the cheapest within 0.25 pixel")
    assert all(f"{model} {error:.2g}" in str(choice) for model, error in choice.error_px.items())
    # At 80 mm a pixel of 0.05 mm behind D = 4 mm spreads to the lenslet's pitch, beyond that to more.
    assert [reconstructed_pixel_mm(display, depth) for depth in (0.0, 20.0, -160.0)] == pytest.approx([1.0, 1.0, 2.0])


def test_panels_smaller_than_a_lenslet_have_a_choice():
    display = focused_display("hex", focal=3.0, width_px=3, height_px=2, pixel_pitch=0.1)
    tiny = dataclasses.replace(display, array=dataclasses.replace(display.array, offset_mm=(0.4, 0.4)))
    assert choose_model(tiny, (-10.0, 10.0)).model in MODELS


everywhere = pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
#: The step in (i, j) and in mm to a neighbour, pitch 1 mm.
STEPS = {"square": [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1)], "hex": [(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1)]}


def centre(grid, i, j):
    return np.array([i, j]) if grid == "square" else np.array([i + j / 2, j * math.sqrt(0.75)])


def line_of(display, pixels, aims, model):
    """Slopes (n, 2) of the rays, and where they cross z = 0, (n, 2) mm."""
    out = lippmann.trace(display, pixels, aims, model)
    slope = out.direction[:, :2] / out.direction[:, 2:]
    return slope, out.origin_mm[:, :2] - out.origin_mm[:, 2:] * slope


@pytest.mark.parametrize("chief", [True, False])
@everywhere
def test_paraxial_is_exact_to_third_order(grid, side, chief):
    """Halve the angles and the two part by an eighth; gap above the sag, so that chief rays of a
    dome that faces the panel go through its vertex.
    """
    display = display_of(grid, side, radius=1.5, thickness=1.2, gap=1.7)
    half = 0.5 * np.array([display.panel.width_px, display.panel.height_px])
    points, aims = np.random.default_rng(SEED).uniform(-1, 1, (2, 40, 2))
    gaps = []
    for scale in (0.04, 0.02, 0.01, 0.005):
        pixels = half + scale * points / display.panel.pixel_pitch_mm * (1, -1)
        one, other = (line_of(display, pixels, None if chief else scale * aims, m) for m in ("paraxial", "exact"))
        gaps.append([np.abs(a - b).max() for a, b in zip(one, other, strict=True)])
    gaps = np.array(gaps)
    if chief and side == "viewer":
        # Straight on at the vertex and through a plate: no angle is lost in any model.
        assert gaps[:, 0].max() < 1e-15
        gaps = gaps[:, 1:]
    assert (gaps[0] > 1e-9).all()  # they do differ
    ratios = gaps[:-1] / gaps[1:]
    assert np.abs(ratios - 8).max() < 0.25, ratios


@everywhere
def test_aperture_points_in_the_neighbours_cells(grid, side):
    """Thin and paraxial: the neighbour's lens bends the ray, whatever the physics between."""
    display = display_of(grid, side, radius=2.0, thickness=1.0, gap=2.0)
    f, D = 4.0, 2.0 + (1.0 / 1.5 if side == "panel" else 0.0)
    pixel = [(100 + 16 * 0.125, 80 - 16 * 0.0625)]
    for step in STEPS[grid]:
        c = centre(grid, *step)
        aim = np.add(c, (0.125, -0.0625))
        for model in ("thin", "paraxial"):
            out = lippmann.trace(display, pixel, [aim], model)
            assert out.status.tolist() == [Status.CROSSTALK]
            assert tuple(out.lenslet[0]) == step
            np.testing.assert_allclose(out.centre_mm[0], c, 0, 1e-15)
            # (aim - point) / D less the power of the neighbour's lens at the height on it.
            slope = (aim - (0.125, 0.0625)) / D - np.array([0.125, -0.0625]) / f
            got = out.direction[0, :2] / out.direction[0, 2]
            np.testing.assert_allclose(got, slope, 0, 3e-15)
        own = lippmann.trace(display, pixel, [aim], "pinhole")
        assert own.status.tolist() == [Status.OK]
        assert tuple(own.lenslet[0]) == (0, 0)
        exact = lippmann.trace(display, pixel, [aim])
        assert exact.status.tolist() == [Status.CROSSTALK]
        # A ray that aims well into a neighbour's cell of a shallow lens passes it there.
        assert tuple(exact.lenslet[0]) == step


@everywhere
@pytest.mark.parametrize("model", ["thin", "paraxial"])
def test_crosstalk_begins_at_the_cells_edge(grid, side, model):
    display = display_of(grid, side, radius=2.0, thickness=1.0, gap=2.0, rotation=90.0)
    pixels = [(100, 80)] * 4
    # Two units in the last place inside and outside: at one, x / p + 1/2 rounds to the edge.
    aims = [(0.5, 0), (0.5 - 2.0**-52, 0), (-0.5, 0), (-0.5 - 2.0**-52, 0)]
    out = lippmann.trace(display, pixels, aims, model)
    assert out.status.tolist() == [4, 0, 0, 4]
    assert out.lenslet.tolist() == [[1, 0], [0, 0], [0, 0], [-1, 0]]
    # Turned by 90 degrees, lenslet (1, 0) lies above (0, 0).
    np.testing.assert_allclose(out.centre_mm[0], (0, 1), 0, 1e-15)


@everywhere
@pytest.mark.parametrize("model", MODELS)
def test_world_rays_that_land_in_another_cell(grid, side, model):
    """Down through the vertex of lenslet (0, 0), ever more slanted: at last beside its cell."""
    display = display_of(grid, side, radius=2.0, thickness=1.0, gap=2.0)
    n = 60
    slope = np.linspace(0, 0.6, n)
    direction = np.column_stack([slope, np.zeros(n), -np.ones(n)])
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    out = lippmann.trace_to_panel(display, np.zeros((n, 3)), direction, model)
    if (side, model) in {("panel", "exact"), ("panel", "paraxial")} or model in {"pinhole", "thin"}:
        own = out.lenslet[:, 0] == 0
        assert own.all()
    else:
        own = (out.lenslet == 0).all(axis=1)  # through the flat face, beside the vertex
        assert own[:20].all()
    aside = (out.pixel[:, 0] - 100) / 16
    assert (np.diff(aside[own]) > 0).all()
    np.testing.assert_array_equal(out.status[own] == Status.CROSSTALK, (aside >= 0.5)[own])
    assert {Status.OK, Status.CROSSTALK} <= set(out.status.tolist())


@pytest.mark.parametrize(
    ("pixels", "options", "words"),
    [
        ([(1.0, 2.0, 3.0)], {}, "give (N, 2)"),
        ([1.0, 2.0], {}, "give (N, 2)"),
        ([(1.0, math.nan)], {}, "not finite"),
        ([(1.0, 2.0)], {"aperture": [(0.0, math.inf)]}, "not finite"),
        ([(1.0, 2.0)], {"aperture": [(0.0, 0.0), (0.0, 0.0)]}, "give one row per pixel"),
        ([(1.0, 2.0)], {"model": "wave"}, "choose from pinhole, thin, paraxial, exact"),
        ([(1.0, 2.0)], {"engine": "steam"}, "choose from golden, fast"),
        ([(1.0, 2.0)], {"device": "foo"}, "unknown device 'foo'; choose from auto, llvm, cuda"),
        ([(1.0, 2.0)], {"engine": "twin", "fraction_bits": 0}, "fraction_bits: 0 is not valid"),
    ],
)
def test_bad_arguments_are_named(pixels, options, words):
    with pytest.raises(lippmann.display.description.InputError) as error:
        lippmann.trace(display_of("hex", "panel"), pixels, **options)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_bad_world_rays_and_devices():
    display = display_of("hex", "panel")
    with pytest.raises(lippmann.display.description.InputError, match=r"origin_mm.*\(N, 3\)"):
        lippmann.trace_to_panel(display, [(0, 0)], [(0, 0, -1)])
    with pytest.raises(lippmann.display.description.InputError, match="finite"):
        lippmann.trace_to_panel(display, [(0, 0, 0)], [(0, 0, math.nan)])
    assert type(backend_of("golden")).__name__ == "NumpyBackend"
    with pytest.raises(lippmann.display.description.InputError, match="unknown device 'foo'"):
        lippmann.trace_to_panel(display, [(0, 0, 9)], [(0, 0, -1)], device="foo")


@pytest.mark.skipif(drjit.has_backend(drjit.JitBackend.CUDA), reason="a GPU is there")
def test_a_gpu_that_is_not_there():
    with pytest.raises(MissingLibraryError, match=r"device 'cuda' is not available"):
        lippmann.trace(display_of("hex", "panel"), [(1.0, 2.0)], engine="fast", device="cuda")


def test_devices_are_the_same_everywhere():
    """trace and trace_to_panel took the processor by default, where all else takes the GPU when there is one."""
    takers = (lippmann.trace, lippmann.trace_to_panel, lippmann.render, lippmann.load_scene, backend_of)
    assert {inspect.signature(function).parameters["device"].default for function in takers} == {"auto"}
