"""The models: paraxial and exact agree near the axis; crosstalk of all; what is refused."""

import inspect
import itertools
import math

import drjit
import lippmann
import numpy as np
import pytest
from lippmann.errors import MissingLibraryError
from lippmann.optics.rays import MODELS, Status
from lippmann.optics.trace import backend_of
from optics_cases import GRIDS, SIDES, display_of

SEED = 2005
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
        ([(1.0, 2.0)], {"aperture": [(0.0, 0.0), (0.0, 0.0)]}, "give one each"),
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
