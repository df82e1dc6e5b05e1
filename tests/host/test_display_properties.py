"""The moire warning against the reciprocal lattice, and against the phases of the pixels under each lenslet."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from lippmann.display.description import load_display
from lippmann.engines import trace
from lippmann.optics.display_properties import beats_in_lenslets, display_properties, eye_views
from lippmann.optics.rays import Status
from optics_cases import GRIDS, display_of
from scene_cases import generator

SEED = 4421


def lattice_vectors(display):
    """(2, 2): the lattice's basis in panel axes, in lenslet pitches."""
    array = display.array
    angles = np.radians(np.array([0.0, 60.0 if array.grid == "hex" else 90.0]))
    px, py = array.pitches_mm
    basis = np.stack([px * np.cos(angles) + array.shear * py * np.sin(angles), py * np.sin(angles)], axis=1) / px
    c, s = math.cos(math.radians(array.rotation_deg)), math.sin(math.radians(array.rotation_deg))
    return basis @ np.array([[c, s], [-s, c]])


def nearest_reciprocal(display, distance_mm=math.inf):
    """Distances of the pixels' two fundamental frequencies from the reciprocal lattice, cycles a lenslet: tries all."""
    ratio = display.array.pitches_mm[0] / display.panel.pixel_pitch_mm
    # An eye sees pixels through neighbouring lenslets (1 + D/z) pitches apart, by similar triangles.
    ratio *= 1.0 + display.aperture_distance_mm / distance_mm
    reach = math.ceil(1.5 * ratio) + 2
    counts = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    reciprocal = counts @ np.linalg.inv(lattice_vectors(display)).T  # b_i . a_j = delta_ij
    return [np.linalg.norm(reciprocal - frequency, axis=1).min() for frequency in ([ratio, 0.0], [0.0, ratio])]


def case(rng):
    """A random display with up to 60 pixels for each lenslet, turned or not, often almost commensurate."""
    grid = rng.choice(GRIDS)
    rotation = rng.choice([0.0, 30.0, 60.0, 90.0, rng.uniform(-180.0, 180.0), rng.uniform(-0.5, 0.5)])
    ratio = rng.choice([rng.uniform(2.5, 59.0), rng.integers(3, 59) + rng.uniform(-0.2, 0.2)])
    ratio *= rng.choice([1.0, 2.0 / math.sqrt(3.0)]) if grid == "hex" and ratio < 50.0 else 1.0
    more = {}
    if rng.random() < 0.3:
        more = {"shear": float(rng.uniform(-0.3, 0.3)), "row_pitch": float(rng.uniform(0.8, 1.2))}
    return display_of(grid, "panel", rotation=float(rotation), pixel_pitch=float(1.0 / ratio), width_px=2000, **more)


def moire_of(display):
    """The eye's distance and the period in the moire warning, mm; None without one."""
    found = [w for w in display_properties(display).warnings if w.startswith("moire: ")]
    said = r"to an eye at ([\d.e+]+) mm, pixels and lenslets beat every ([\d.e+]+) mm"
    return tuple(map(float, re.search(said, found[0]).groups())) if found else None


@pytest.mark.parametrize("viewing", [None, 300.0, 2000.0])
@pytest.mark.parametrize("number", range(30))
def test_moire_follows_from_the_reciprocal_lattice(number, viewing):
    display = dataclasses.replace(case(generator(SEED, number)), viewing_distance_mm=viewing)
    distance = viewing or 600.0
    for z in (math.inf, distance):
        frequencies = nearest_reciprocal(display, z)
        assert [1.0 / beat for beat in beats_in_lenslets(display, z)] == pytest.approx(frequencies, abs=1e-9)
    pitch = display.array.pitches_mm[0]
    visible = [1.0 / f for f in frequencies if f and 4.0 < 1.0 / f < display.panel.width_mm / pitch]
    # As the table of views has it at that distance.
    (view,) = eye_views(display, [(0.0, 0.0, distance)])
    assert view.moire_lenslets == (pytest.approx(max(visible), rel=1e-9) if visible else None)
    assert moire_of(display) == (pytest.approx((distance, max(visible) * pitch), rel=5e-3) if visible else None)


@pytest.mark.parametrize("number", range(40))
def test_lenslets_within_an_extent_are_those_that_pass_rays(number):
    """On a panel that is larger than the array: lenslets that own a ray through their centre, counted."""
    rng = generator(SEED, "extent", number)
    display = display_of(rng.choice(GRIDS), "panel", width_px=400, height_px=300, pixel_pitch=0.1)
    pitch = rng.choice([1.0, rng.uniform(0.8, 1.1)]), rng.uniform(0.8, 1.1)
    extent = tuple((rng.uniform(1.2, 20.0, 2) * rng.choice([1.0, 0.5])).round(int(rng.integers(0, 3))) + 1.0)
    array = dataclasses.replace(display.array, pitch_mm=pitch, extent_mm=extent, thickness_mm=2.0)
    display = dataclasses.replace(display, array=array)
    i, j = np.mgrid[-60:61, -60:61].reshape(2, -1)
    x = pitch[0] * (i + 0.5 * j if array.grid == "hex" else i)
    y = pitch[1] * (j * math.sqrt(0.75) if array.grid == "hex" else j)
    near = (abs(x) < 19.0) & (abs(y) < 14.0)
    rays = trace(display, np.stack([x[near] / 0.1 + 200.0, 150.0 - y[near] / 0.1], axis=1))
    passed = rays.status == Status.OK
    rows = np.round(y[near][passed], 6)
    across, down, total = display_properties(display).lenslets
    assert total == passed.sum()
    assert down == len(set(rows))
    assert across == max((rows == row).sum() for row in set(rows))


def test_lenslets_of_the_measured_display():
    """23 in the middle row, 24 in the next one, and so on: 11 x 23 + 10 x 24."""
    display = load_display(Path(__file__).parents[2] / "scenes/displays/measured-hex.toml")
    assert display_properties(display).lenslets == (24, 21, 493)


def test_hexagonal_rows_beat_with_their_own_pitch():
    """9.1 pixels a lenslet are 7.88 a row: 0.12 short of 8, a beat of 8.4 rows or 7.3 lenslets. Columns do not beat,
    because neighbouring rows are half a pitch apart.
    """
    columns, rows = beats_in_lenslets(display_of("hex", "panel", pixel_pitch=1.0 / 9.1))
    assert rows == pytest.approx(0.5 * math.sqrt(3.0) / (8.0 - 9.1 * 0.5 * math.sqrt(3.0)))
    assert columns < 2.0


@pytest.mark.parametrize("rotation", [0.0, 13.0, 30.0])
@pytest.mark.parametrize(("grid", "symmetry"), [("square", 90.0), ("hex", 60.0)])
@pytest.mark.parametrize("ratio", [9.1, 10.0, 15.2])
def test_a_turn_by_the_lattices_symmetry_changes_no_warning(grid, symmetry, ratio, rotation):
    warnings = []
    for turn in (rotation, rotation + symmetry, rotation - 2.0 * symmetry):
        display = display_of(grid, "panel", rotation=turn, pixel_pitch=1.0 / ratio)
        striped = dataclasses.replace(display, panel=dataclasses.replace(display.panel, subpixels="rgb"))
        warnings.append(display_properties(striped).warnings)
    assert warnings[0] == warnings[1] == warnings[2]
    # Stripes along a row of lenslets or across it: a hexagonal lattice has rows every 60 degrees.
    parallel = rotation == 0.0 or (grid == "hex" and rotation == 30.0)
    assert any(warning.startswith("colour moire") for warning in warnings[0]) == parallel
