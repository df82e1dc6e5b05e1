"""Elemental images turned by 180 degrees: an involution, nothing lost or doubled inside a cell."""

import numpy as np
import pytest
from lippmann.capturing.elemental_rotation import cells_of, rotated, rotation_map
from lippmann.engines import trace
from optics_cases import display_of

CASES = [
    (grid, rotation, offset, ratio)
    for grid in ("square", "hex")
    for rotation, offset in (
        (0.0, (0.0, 0.0)), (11.0, (0.0, 0.0)), (0.0, (0.137, -0.41)), (90.0, (0.2, 0.1)), (-37.3, (3.3, 1.7))
    )
    for ratio in (2.0, 5.0, 23.6220472440945)
]  # fmt: skip
#: Without an eye, and with one so near that elemental images are a fifth wider than lenslets; distance and axis.
EYES = [(None, (0.0, 0.0)), (9.2, (1.3, -0.8))]
#: Regular, and of two pitches and a shear.
LATTICES = [{}, {"row_pitch": 1.17, "shear": 0.21}]
STRAIGHT = EYES[0], LATTICES[0]


def display_for(
    grid, rotation=0.0, offset=(0.0, 0.0), ratio=10.0, width_px=211, height_px=163, eye=EYES[0], lattice=LATTICES[0]
):
    return display_of(
        grid, "panel", radius=1.65, pixel_pitch=1.0 / ratio, rotation=rotation, offset=offset,
        width_px=width_px, height_px=height_px, eye=eye[0], axis=eye[1], **lattice,
    )  # fmt: skip


@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize(("grid", "rotation", "offset", "ratio"), CASES)
def test_involution_within_each_cell(grid, rotation, offset, ratio, eye, lattice):
    display = display_for(grid, rotation, offset, ratio, eye=eye, lattice=lattice)
    partner = rotation_map(display)
    cell, centre, _ = cells_of(display)
    assert np.array_equal(partner[partner], np.arange(len(partner)))
    assert np.array_equal(cell[partner], cell)
    # Those that change places land at most a pixel from the mirror image of their place in the lenslet's centre.
    place = np.stack(np.divmod(np.arange(len(partner)), display.panel.width_px)[::-1], axis=1) + 0.5
    moved = partner != np.arange(len(partner))
    off = np.abs(place[partner] - (2.0 * centre[cell] - place))[moved]
    assert off.max() <= 1.0 + 1e-9
    # Cells that lie wholly in the picture: what stays is at most a rim, a pixel wide, of part of the cell.
    reach = 1.21 * display.array.half_diagonal_mm / display.panel.pixel_pitch_mm
    end = np.array([display.panel.width_px, display.panel.height_px]) - reach
    whole = ((centre > reach) & (centre < end)).all(axis=1)
    still = np.bincount(cell, ~moved, len(centre))[whole]
    size = np.bincount(cell, minlength=len(centre))[whole]
    assert whole.any()
    # Unturned squares leave nothing but the pixel on the centre itself; others part of their rim.
    if grid == "square" and rotation % 90.0 == 0.0 and not lattice:
        assert (still <= 1).all()
    elif ratio > 10.0:
        assert still.sum() < 0.05 * size.sum()


@pytest.mark.parametrize("grid", ["square", "hex"])
def test_wide_elemental_images_are_cut_by_the_picture_s_edge(grid):
    """Half as wide again as lenslets: pixels that would leave the picture stay, and none changes with another row's."""
    for offset in np.linspace(0.0, 1.0, 12):
        display = display_for(
            grid, 45.0 if grid == "square" else 30.0, (offset, 0.37 * offset), ratio=60.0, eye=(4.0, (0.0, 0.0))
        )
        partner = rotation_map(display)
        assert np.array_equal(partner[partner], np.arange(len(partner)))
        cell, _, _ = cells_of(display)
        assert np.array_equal(cell[partner], cell)


@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("grid", ["square", "hex"])
def test_cells_of_a_near_eye_are_those_of_the_trace(grid, lattice):
    """A cell is what one lenslet owns by golden; its centre is where the line from the eye through the lenslet ends."""
    display = display_for(grid, 11.0, (0.137, -0.41), eye=EYES[1], lattice=lattice)
    panel = display.panel
    row, column = np.mgrid[0 : panel.height_px, 0 : panel.width_px]
    rays = trace(display, np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=1), None, "pinhole")
    cell, centre, _ = cells_of(display)
    _, owner = np.unique(rays.lenslet, axis=0, return_inverse=True)
    assert len(set(zip(owner.tolist(), cell.tolist(), strict=True))) == len(centre) == owner.max() + 1
    eye_mm, axis_mm = EYES[1]
    # D = 0.5 + 2 / 1.5 by hand; the eye stands at D + 9.2 before the panel.
    depth = 0.5 + 2.0 / 1.5
    at = np.array(axis_mm) + (rays.centre_mm - axis_mm) * (depth + eye_mm) / eye_mm
    pixel = np.array([panel.width_px, panel.height_px]) / 2 + at / panel.pixel_pitch_mm * (1, -1)
    assert np.abs(centre[cell] - pixel).max() < 1e-9
    assert display.convergence == pytest.approx(0.2, abs=0.01)


def test_by_hand():
    """Cells of 3 pixels, centred on the picture: 3 x 3 blocks turned about their middle pixel."""
    display = display_for("square", ratio=3.0, width_px=9, height_px=3)
    picture = np.arange(27.0).reshape(3, 9, 1)
    expected = [
        [20, 19, 18, 23, 22, 21, 26, 25, 24],
        [11, 10, 9, 14, 13, 12, 17, 16, 15],
        [2, 1, 0, 5, 4, 3, 8, 7, 6],
    ]
    turned = rotated(picture, rotation_map(display))
    assert turned[:, :, 0].tolist() == expected
    assert np.array_equal(rotated(turned, rotation_map(display)), picture)


@pytest.mark.parametrize(
    ("grid", "rotation", "ratio", "eye", "lattice"),
    [
        ("square", 0.0, 6.3, *STRAIGHT), ("square", 7.0, 6.3, *STRAIGHT), ("square", 180.0, 6.3, *STRAIGHT),
        ("square", 0.0, 4.7, EYES[1], {}), ("square", 0.0, 6.3, EYES[0], {"row_pitch": 1.17}),
        ("square", 0.0, 0.7, *STRAIGHT), ("square", 0.0, 1.5, *STRAIGHT),
        ("hex", 0.0, 6.3, *STRAIGHT), ("hex", -20.0, 6.3, *STRAIGHT),
    ],
)  # fmt: skip
def test_each_cell_takes_the_best_centre(grid, rotation, ratio, eye, lattice):
    """By the rule, cell by cell: no integer pair within 1 of the one asked for keeps more pixels in the cell."""
    display = display_for(grid, rotation, (0.31, -0.12), ratio, width_px=61, height_px=47, eye=eye, lattice=lattice)
    partner, (cell, centre, _) = rotation_map(display), cells_of(display)
    width = display.panel.width_px
    for k, asked in enumerate(2.0 * centre - 1.0):
        own = {(int(p % width), int(p // width)) for p in np.flatnonzero(cell == k)}
        kept = {
            (m, n): sum((m - c, n - r) in own for c, r in own)
            for m in range(int(np.floor(asked[0])) - 1, int(np.ceil(asked[0])) + 2)
            for n in range(int(np.floor(asked[1])) - 1, int(np.ceil(asked[1])) + 2)
            if max(abs(m - asked[0]), abs(n - asked[1])) <= 1.0 + 1e-9
        }
        most = max(kept.values())
        best = [pair for pair, count in kept.items() if count == most]
        m, n = min(best, key=lambda pair: np.hypot(*(pair - asked)))
        for c, r in own:
            to = (m - c, n - r) if (m - c, n - r) in own else (c, r)
            assert partner[r * width + c] == to[1] * width + to[0]
