"""From the pinhole to the exact lens each model refines the one before, and agrees near the axis."""

import functools
import inspect
import itertools
import math

import drjit
import lippmann
import numpy as np
import pytest
import scene_cases
import truth
from lippmann.display.description import parse_display
from lippmann.errors import MissingLibraryError
from lippmann.optics.rays import MODELS, Status
from lippmann.optics.trace import backend_of
from optics_cases import GRIDS, SIDES, display_of, random_in_cell, random_pixels

SEED = 2005
generator = functools.partial(scene_cases.generator, SEED)
everywhere = pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
#: The step in (i, j) and in mm to a neighbour, pitch 1 mm.
STEPS = {"square": [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1)], "hex": [(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1)]}


def centre(grid, i, j):
    """Centre of a lenslet of a lattice of 1 mm, mm."""
    return np.array([i, j]) if grid == "square" else np.array([i + j / 2, j * math.sqrt(0.75)])


def near_axis(display, scale, rng, n=40):
    """Pixels and aperture points within `scale` mm of the axis of lenslet (0, 0)."""
    half = 0.5 * np.array([display.panel.width_px, display.panel.height_px])
    points, aims = rng.uniform(-1, 1, (n, 2)), rng.uniform(-1, 1, (n, 2))
    return half + scale * points / display.panel.pixel_pitch_mm * (1, -1), scale * aims


def line_at(out, z):
    """Where the rays cross the plane at height z, (n, 2) mm, and their slopes (n, 2)."""
    slope = out.direction[:, :2] / out.direction[:, 2:]
    return out.origin_mm[:, :2] + (z - out.origin_mm[:, 2:]) * slope, slope


# --- agreement near the axis ----------------------------------------------------------------------


def disagreement(display, one, other, chief, scales, seed):
    """Largest differences of slopes and of the lines' crossings of the vertices' plane, for rays
    that shrink towards the axis.
    """
    rows = []
    for scale in scales:
        pixels, aims = near_axis(display, scale, np.random.default_rng(seed))
        aims = None if chief else aims
        (place, slope), (place_2, slope_2) = (
            line_at(lippmann.trace(display, pixels, aims, model), 0.0) for model in (one, other)
        )
        rows.append([np.abs(slope - slope_2).max(), np.abs(place - place_2).max()])
    return np.array(rows)


@pytest.mark.parametrize("chief", [True, False])
@everywhere
def test_paraxial_is_exact_to_third_order(grid, side, chief):
    """Halve the angles and the two part by an eighth; gap above the sag, so that chief rays of a
    dome that faces the panel go through its vertex.
    """
    display = display_of(grid, side, radius=1.5, thickness=1.2, gap=1.7)
    scales = np.array([0.04, 0.02, 0.01, 0.005])
    gaps = disagreement(display, "paraxial", "exact", chief, scales, SEED)
    print(gaps)
    if chief and side == "viewer":
        # Straight on at the vertex and through a plate: no angle is lost in any model.
        assert gaps[:, 0].max() < 1e-15
        gaps = gaps[:, 1:]
    assert (gaps[0] > 1e-9).all()  # they do differ
    ratios = gaps[:-1] / gaps[1:]
    assert np.abs(ratios - 8).max() < 0.25, ratios


@everywhere
def test_thin_is_paraxial_with_the_plano_side_to_the_panel(grid, side):
    """The second principal plane is the vertices' plane; with the plano side to the viewer it lies
    T (1 - 1/n) in front of it, and only slopes agree where the aperture is in the vertices' plane.
    """
    T, n = 1.2, 1.5
    display = display_of(grid, side, radius=1.5, index=n, thickness=T, gap=1.7)
    pixels, aims = near_axis(display, 0.3, generator(grid, side))
    thin, paraxial = (lippmann.trace(display, pixels, aims, m) for m in ("thin", "paraxial"))
    np.testing.assert_allclose(thin.direction, paraxial.direction, 0, 1e-15)
    place, slope = line_at(thin, 0.0)
    drawn, _ = line_at(paraxial, 0.0 if side == "panel" else T * (1 - 1 / n))
    np.testing.assert_allclose(place, drawn, 0, 2e-15)
    if side == "viewer":
        plain, _ = line_at(paraxial, 0.0)
        np.testing.assert_allclose(plain - place, -slope * T * (1 - 1 / n), 0, 2e-15)


@everywhere
def test_pinhole_is_the_thin_lens_for_chief_rays(grid, side):
    rng = generator(2, grid, side)
    display = display_of(grid, side, rotation=20.0, offset=(0.1, 0.2))
    pixels = random_pixels(rng, display, 200)
    pinhole, thin = (lippmann.trace(display, pixels, None, m) for m in ("pinhole", "thin"))
    np.testing.assert_array_equal(pinhole.direction, thin.direction)
    np.testing.assert_array_equal(pinhole.origin_mm, thin.origin_mm)
    # The pinhole takes no notice of an aperture point, the thin lens does.
    aims = random_in_cell(rng, display, 200)
    aimed = lippmann.trace(display, pixels, aims, "pinhole")
    np.testing.assert_array_equal(aimed.direction, pinhole.direction)
    np.testing.assert_array_equal(aimed.origin_mm, pinhole.origin_mm)
    moved = lippmann.trace(display, pixels, aims, "thin")
    assert (np.abs(moved.direction - thin.direction).max(axis=1) > 0).all()


@everywhere
def test_all_models_agree_on_chief_rays_near_the_axis(grid, side):
    """Slopes of chief rays: pinhole = thin = paraxial, exact off by the third power; not even that
    where the chief ray goes straight through the vertex of a dome that faces the panel.
    """
    display = display_of(grid, side, radius=1.5, thickness=1.2, gap=1.7)
    for one, other in itertools.combinations(MODELS, 2):
        gaps = disagreement(display, one, other, True, np.array([0.02, 0.01]), SEED)[:, 0]
        if "exact" in (one, other) and side == "panel":
            assert abs(gaps[0] / gaps[1] - 8) < 0.1, (one, other)
            assert gaps[0] < 4 * 0.02**3
        else:
            assert gaps.max() < 1e-15, (one, other)


def test_each_model_is_nearer_to_exact_than_the_one_before():
    """Plano side to the viewer, half-aperture rays: errors at 100 mm fall from model to model."""
    display = display_of("square", "viewer", radius=2.5, thickness=2.0, gap=4.4)
    rng = generator(3)
    pixels, aims = near_axis(display, 0.25, rng, 500)
    exact = lippmann.trace(display, pixels, aims)
    assert (exact.status == Status.OK).all()
    errors = []
    for model in MODELS[:-1]:
        place, _ = line_at(lippmann.trace(display, pixels, aims, model), 100.0)
        errors.append(float(np.abs(place - line_at(exact, 100.0)[0]).max()))
    print(errors)
    assert errors[0] > 3 * errors[1] > 3 * errors[2] > 0


# --- crosstalk ------------------------------------------------------------------------------------


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


# --- dispersion -----------------------------------------------------------------------------------

TEXT = """
gap_mm = 1.0
[panel]
width_px = 200
height_px = 160
pixel_pitch_mm = 0.0625
[array]
grid = "hex"
pitch_mm = 1.0
radius_mm = 1.5
thickness_mm = 1.0
glass = "{glass}"
plano_side = "{side}"
"""


@pytest.mark.parametrize("model", ["thin", "paraxial", "exact"])
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("glass", ["PMMA", "N-BK7", "polycarbonate", "fused silica", "polystyrene"])
def test_blue_comes_to_its_focus_before_red(glass, side, model):
    display = parse_display(TEXT.format(glass=glass, side=side))
    h = 0.125
    focus = []
    for wavelength in (450.0, 550.0, 650.0):
        colour = display.at_wavelength(wavelength)
        assert colour.array.radius_mm == display.array.radius_mm
        out = lippmann.trace(colour, [(100 + 16 * h, 80)], [(h, 0)], model)
        assert out.status.tolist() == [Status.OK]
        slope = out.direction[0, 0] / out.direction[0, 2]
        focus.append(out.local_mm[0, 2] - out.local_mm[0, 0] / slope)
        first = {"panel": "flat", "viewer": "curved"}[side]
        ideal = truth.back_focal_length(1.5, colour.array.index, 1.0, first)
        if model == "paraxial":
            behind = focus[-1] - (0.0 if side == "panel" else 1.0)
            assert abs(behind - float(ideal)) < 1e-13
    assert focus[0] < focus[1] < focus[2]
    # The spread of f over the visible is about f / V, V the Abbe number, 28 to 68.
    assert 0.01 < (focus[2] - focus[0]) / focus[1] < 0.09


@pytest.mark.parametrize("side", SIDES)
def test_identity_is_that_of_the_thing_and_not_of_the_light_or_the_model(side):
    display = parse_display(TEXT.format(glass="PMMA", side=side))
    identity = display.identity
    for wavelength in (400.0, 587.5618, 700.0):
        assert display.at_wavelength(wavelength).identity == identity
    for model in MODELS:
        lippmann.trace(display, [(100.5, 80.5)], None, model)
    assert display.identity == identity
    assert parse_display(TEXT.format(glass="N-BK7", side=side)).identity != identity


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pixels", "options", "words"),
    [
        ([(1.0, 2.0, 3.0)], {}, "give (N, 2)"),
        ([1.0, 2.0], {}, "give (N, 2)"),
        ([(1.0, math.nan)], {}, "not finite"),
        ([(1.0, 2.0)], {"aperture": [(0.0, math.inf)]}, "not finite"),
        ([(1.0, 2.0)], {"aperture": [(0.0, 0.0), (0.0, 0.0)]}, "give one each"),
        ([(1.0, 2.0)], {"model": "wave"}, "choose from pinhole, thin, paraxial, exact"),
        ([(1.0, 2.0)], {"engine": "steam"}, "choose from golden, fast"),
        ([(1.0, 2.0)], {"device": "foo"}, "unknown device 'foo'; choose from auto, llvm, cuda"),
        ([(1.0, 2.0)], {"engine": "fast", "device": "foo"}, "unknown device 'foo'"),
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
