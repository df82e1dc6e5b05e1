"""Elemental images that converge on an eye: where an eye sees them, who owns a pixel, and an eye far away.

The trace itself is held to 50 digits in test_golden_exact.py.
"""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import lippmann
import numpy as np
import pytest
import truth
from lippmann.capturing.elemental_rotation import rotation_map
from lippmann.conformance.fit import INSIDE, away_from_borders
from lippmann.display.description import load_display
from lippmann.optics.model_choice import choose_model, in_cells_mm, located, pixels_from_cells, probe
from lippmann.optics.rays import Status
from lippmann.optics.system import Convergence, System
from optics_cases import GRIDS, SIDES, display_of, optics_of, random_display, random_in_cell, random_pixels
from scene_cases import generator

SEED = 1406
DESKTOP = Path(__file__).parents[2] / "scenes/displays/desktop-hex.toml"

everywhere = pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))


def crosstalk(display, eye, model, across=60):
    """Share of crosstalk of the rays from an eye that land on the panel, to a net of points over it."""
    panel = display.panel
    steps = (np.arange(across) + 0.5) / across - 0.5
    x, y = (net.ravel() for net in np.meshgrid(steps * panel.width_mm, steps * panel.height_mm))
    eye = np.array(eye, float)
    way = np.column_stack([x, y, 0.0 * x]) - eye
    hits = lippmann.trace_to_panel(
        display, np.broadcast_to(eye, way.shape), way / np.linalg.norm(way, axis=1)[:, None], model
    )
    landed = np.isin(hits.status, (Status.OK, Status.CROSSTALK))
    assert landed.mean() > 0.5
    return np.mean(hits.status[landed] == Status.CROSSTALK)


@pytest.mark.parametrize("model", ["pinhole", "thin"])
@everywhere
def test_every_lenslet_flips_at_the_same_place_of_the_eye(grid, side, model):
    """Whatever the panel's width. By hand: the line from an eye at e through a lenslet's centre c ends D behind it, at
    x = c + D (c - e) / E. The line from there to the eye before a, at the same E, passes the array at

        q = x + (a - x) D / (D + E) = c + (a - e) D / (D + E),

    in the cell of c as long as |a - e| D / (D + E) is below p / 2: the zone is p (D + E) / (2 D) wide, either way.
    """
    rng = generator(SEED, grid, side, model)
    for width in (30.0, 300.0, 1200.0):
        turn, eye_mm = float(rng.uniform(-180, 180)), width * float(rng.uniform(0.5, 3.0))
        axis = rng.uniform(-0.2, 0.2, 2) * width
        display = display_of(
            grid, side, radius=1.5, thickness=None, gap=2.9, rotation=turn, offset=(0.31, -0.17),
            width_px=int(width / 0.1), height_px=int(0.6 * width / 0.1), pixel_pitch=0.1, eye=eye_mm, axis=tuple(axis),
        )  # fmt: skip
        D = float(truth.aperture_distance(optics_of(display)))
        # The array's rows, along which a cell is p wide.
        zone = 0.5 * (D + eye_mm) / D * np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn))])
        # Rays beside the lenslet's middle, by up to p / 2, differ in slope, by p / 2E; a thin lens that is not in focus
        # sends them elsewhere besides.
        blur = D / eye_mm + (abs(1.0 - D / 3.0) if model == "thin" else 0.0) + 1e-9
        for way, share in itertools.product((-1.0, 1.0), (0.0, 1.0 - blur)):
            assert crosstalk(display, (*(axis + way * share * zone), eye_mm), model) == 0.0
        for way, share in itertools.product((-1.0, 1.0), (1.0 + blur, 1.3)):
            assert crosstalk(display, (*(axis + way * share * zone), eye_mm), model) == 1.0


def test_without_the_key_no_number_changes():
    display = load_display(DESKTOP)
    straight = replace(display, viewing_distance_mm=None)
    assert straight.convergence == 0.0
    assert System.of(straight).convergence.share == 0.0
    # The numbers themselves, not only equal ones: negative zeros and all.
    x = np.array([-0.0, 5e-324, 0.1, 1e300])
    none = Convergence(axis_x=3.0)
    for same in (none.towards_eye(x, x), none.within_cell(x, x, 7.0, 7.0), none.on_panel(x, x, 7.0, 7.0)):
        assert same[0] is same[1] is x
    assert straight.identity != display.identity
    small = display_of("hex", "panel", width_px=90, height_px=70, rotation=3.0)
    np.testing.assert_array_equal(rotation_map(replace(small, viewing_distance_mm=1e12)), rotation_map(small))


@everywhere
def test_pixels_of_cells_against_50_digits(grid, side):
    """Where the eye sees a cell's point, and the way back."""
    rng = generator(SEED + 2, grid, side)
    for _ in range(5):
        display = random_display(rng, grid, side, kind="near")
        optics, local = optics_of(display), random_in_cell(rng, display, 20)
        cells = located(display, random_pixels(rng, display, len(local)))[0]
        pixels = pixels_from_cells(display, cells, local)
        np.testing.assert_allclose(in_cells_mm(display, pixels), local, 0, 1e-10)
        for pixel, cell, point in zip(pixels, cells.astype(int).tolist(), local, strict=True):
            x, y, _ = truth.panel_point(optics, *pixel)
            assert truth.owner_of(optics, x, y) == tuple(cell)
            centre, seen = truth.centre_of(optics, tuple(cell)), truth.seen_through(optics, x, y)
            turn = truth.mp.mpf(display.array.rotation_deg) * truth.mp.pi / 180
            c, s = truth.mp.cos(turn), truth.mp.sin(turn)
            dx, dy = seen[0] - centre[0], seen[1] - centre[1]
            assert abs(c * dx + s * dy - point[0]) < 1e-11
            assert abs(c * dy - s * dx - point[1]) < 1e-11


@everywhere
def test_auto_probes_the_elemental_images(grid, side):
    """The cells that are probed own the probe's pixels, corners too, as far as the panel goes; all models are tried."""
    rng = generator(SEED + 3, grid, side)
    display = display_of(
        grid, side, radius=1.5, thickness=1.0, gap=2.0, rotation=12.0, width_px=3000, height_px=2000,
        pixel_pitch=0.05, eye=150.0, axis=(30.0, -20.0),
    )  # fmt: skip
    pixels, _ = probe(display, "chief")
    across = np.abs(in_cells_mm(display, pixels)).max()
    assert 0.49 <= across <= 1 / math.sqrt(3)
    optics = optics_of(display)
    owners = [truth.owner_of(optics, *truth.panel_point(optics, *pixel)[:2]) for pixel in pixels.tolist()]
    np.testing.assert_array_equal(located(display, pixels)[0], owners)
    choice = choose_model(display, (-20.0, 20.0), tolerance=1e-9)
    assert choice.model == "exact"
    # An eye at 150 mm looks at the edges from 30 degrees, where paraxial rays are wrong.
    assert all(error > 0.01 for error in choice.error_px.values() if error)
    # Away from borders: no pixel changes its owner when it moves by a hundredth of a lenslet to any side.
    points = away_from_borders(display, random_pixels(rng, display, 400))
    assert 0.8 < len(points) / 400 < 1.0
    near = 0.5 * (1.0 - INSIDE) * 0.99 / 0.05
    for k in range(8):
        moved = points + near * np.array([math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)])
        np.testing.assert_array_equal(located(display, moved)[0], located(display, points)[0])
