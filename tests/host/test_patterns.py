"""Test patterns against the nearest lenslet by brute force, by the observer's eyes, and as a board's words."""

import dataclasses
import math

import numpy as np
import pytest
from lippmann.base.tones import encoded_values
from lippmann.cli import run
from lippmann.display.description import display_text
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.eye.test_patterns import ON_BOARD, draw
from lippmann.optics.rays import Status
from lippmann.optics.trace import trace_to_panel
from optics_cases import GRIDS, display_of
from scene_cases import focused_display, generator

SEED = 4021
WIDTH, HEIGHT = 150, 110


def display_for(rng, grid, eye, skewed=False, **others):
    """A display of 8 to 15 pixels a lenslet, turned and shifted, perhaps skewed and ending; 8 bits of a curve."""
    pitch = rng.uniform(0.6, 1.4)
    numbers = {"gap": rng.uniform(0.5, 3.0), "rotation": rng.uniform(-40, 40)}
    if skewed:
        rows = pitch * rng.uniform(0.8, 1.3)
        numbers |= {"shear": rng.uniform(-0.3, 0.3), "row_pitch": rows, "extent": (8 * pitch, 5 * pitch)}
    numbers |= {"offset": tuple(rng.uniform(-0.7, 0.7, 2)), "pixel_pitch": pitch / rng.uniform(8, 15)}
    made = display_of(grid, "panel", pitch=pitch, width_px=WIDTH, height_px=HEIGHT, **numbers)
    panel = dataclasses.replace(made.panel, **others)
    axis = tuple(rng.uniform(-3, 3, 2))
    return dataclasses.replace(made, panel=panel, viewing_distance_mm=eye, viewing_axis_mm=axis if eye else (0.0, 0.0))


def by_brute_force(display):
    """Of each pixel: the nearest lenslet's (i, j) to its point q, q from that centre, whether that is doubtful, and
    whether the lenslet is there; and the panel's points, in pixel coordinates, at which an eye sees the centres of
    those lenslets, (N, 2). Nearest on the regular lattice of pitch 1, of which the array's is an image; q there too.
    """
    panel, array = display.panel, display.array
    p, px = array.finest_mm, panel.pixel_pitch_mm
    along, across = array.pitches_mm
    turn = np.exp(1j * math.radians(array.rotation_deg))
    origin = complex(*array.offset_mm)
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    x = (u - WIDTH / 2) * px + 1j * (HEIGHT / 2 - v) * px
    # The line from the eye, E before the axis point, to x, where it crosses the plane D before the panel.
    D = display.gap_mm + array.thickness_mm / array.index
    E, axis = display.viewing_distance_mm, complex(*display.viewing_axis_mm)
    s = 0.0 if E is None else D / (D + E)
    q = ((x - (x - axis) * s) - origin) / turn
    q = (q.real - array.shear * q.imag) / along + 1j * q.imag / across
    reach = math.ceil(math.hypot(WIDTH, HEIGHT) * px / p) + 3
    i, j = (n.ravel() for n in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    centre = i + 1j * j if array.grid == "square" else i + j / 2 + 1j * j * math.sqrt(0.75)
    c = centre.real * along + (array.shear + 1j) * centre.imag * across
    near = abs(c * turn + origin - np.median(x)) < math.hypot(WIDTH, HEIGHT) * px
    i, j, centre, c = i[near], j[near], centre[near], c[near]
    w, h = array.extent_mm or (math.inf, math.inf)
    there = (2 * abs(centre.real) * along <= w) & (2 * abs(centre.imag) * across <= h)
    owner, doubtful = np.empty(q.shape, int), np.empty(q.shape, bool)
    for row in range(HEIGHT):
        away = abs(q[row][:, None] - centre)
        two = np.partition(away, 1, axis=1)
        owner[row], doubtful[row] = away.argmin(axis=1), two[:, 1] - two[:, 0] < 1e-9
    c = (c * turn + origin)[there]
    seen = c if E is None else c + (c - axis) * D / E
    at = np.stack([seen.real / px + WIDTH / 2, HEIGHT / 2 - seen.imag / px], axis=1)
    return i[owner], j[owner], q - centre[owner], doubtful, there[owner], at


def levels(display, kind, **options):
    image = draw(display, kind, **options)
    return encoded_values(image.radiance, display.panel.transfer, display.panel.bits).astype(int)


@pytest.mark.parametrize(
    ("grid", "eye", "transfer"),
    [("square", None, "linear"), ("square", 90.0, "gamma2.2"), ("hex", None, "srgb"), ("hex", 90.0, "srgb")],
)
@pytest.mark.parametrize("skewed", [False, True])
def test_patterns_of_the_lenslets_by_brute_force(grid, eye, transfer, skewed):
    """Where the lenslet is missing they are black."""
    display = display_for(generator(SEED, grid, int(eye or 0), transfer), grid, eye, skewed, transfer=transfer)
    i, j, q, doubtful, there, at = by_brute_force(display)
    assert doubtful.mean() < 0.01
    assert 0.1 < there.mean() < 0.9 or not skewed
    sure = ~doubtful

    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]])
    wanted = np.where(there[..., None], colours[(i - j) % 3], 0)
    np.testing.assert_array_equal(levels(display, "cells")[sure], wanted[sure])

    row, column = np.argwhere(there)[there.sum() // 3]
    lens = int(i[row, column]), int(j[row, column])
    wanted = 255 * ((i == lens[0]) & (j == lens[1]))
    got = levels(display, "single-lens", lens=lens)
    np.testing.assert_array_equal(got[sure], np.repeat(wanted[..., None], 3, axis=2)[sure])
    assert 0 < wanted.mean() < 10

    got = levels(display, "view-numbers")
    assert not got[sure & ~there].any()
    for channel, place in enumerate((q.real, q.imag / (math.sqrt(4 / 3) if grid == "hex" else 1.0))):
        exact = np.clip(256 * (place + 0.5), 0, 255.999)
        error = got[..., channel] - np.floor(exact)
        clear = sure & there & (abs(exact - np.round(exact)) > 1e-6)
        assert clear.mean() > 0.98 * there.mean()
        assert not error[clear].any()
        assert np.ptp(got[..., channel]) > 240
    assert not got[..., 2].any()

    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    away = np.full(u.shape, np.inf)
    for cu, cv in at:
        away = np.minimum(away, np.maximum(abs(u - cu), abs(v - cv)))
    got = levels(display, "lens-centres")
    clear = abs(away - 17 / 32) > 1e-9
    np.testing.assert_array_equal(got[clear], np.repeat(255 * (away <= 17 / 32)[..., None], 3, axis=2)[clear])
    assert (got > 0).any()


@pytest.mark.parametrize(("grid", "steps"), [("square", [(1, 0), (0, 1)]), ("hex", [(1, 0), (0, 1), (-1, 1)])])
def test_two_cells_that_share_a_side_differ(grid, steps):
    display = display_for(generator(SEED, grid), grid, None)
    i, j, *_ = by_brute_force(display)
    shown = levels(display, "cells").reshape(-1, 3)
    colour = {(int(a), int(b)): tuple(c) for a, b, c in zip(i.flat, j.flat, shown, strict=True)}
    pairs = [(colour[a, b], colour.get((a + s, b + t))) for a, b in colour for s, t in steps]
    assert sum(other is not None for _, other in pairs) > 50
    assert all(one != other for one, other in pairs)


@pytest.mark.parametrize("bits", [6, 8, 10])
def test_ramps_and_checker_by_hand(bits):
    display = display_for(generator(SEED, bits), "square", None, bits=bits, transfer="gamma2.2")
    top = 255 if bits <= 8 else 65535
    spread = top / (2**bits - 1)
    column, row = np.arange(WIDTH), np.arange(HEIGHT)
    tiles = (column[None] // 32 + row[:, None] // 32) % 2 * top
    np.testing.assert_array_equal(levels(display, "checker"), np.repeat(tiles[..., None], 3, axis=2))
    got = levels(display, "ramp")
    assert (got == got[:1, :, :1]).all()
    np.testing.assert_allclose(got[0, :, 0] / top, column % 256 / 255, atol=0.5 / (2**bits - 1) + 1e-4)
    # Each band has each level that its columns have room for, in steps of the panel's own.
    got = levels(display, "ramps")
    top_level = 2**bits - 1
    wanted = column * 2**bits // WIDTH if top_level < WIDTH else column * top_level // (WIDTH - 1)
    assert (wanted[0], wanted[-1]) == (0, top_level)
    wanted = np.rint(wanted * spread)
    for band, channels in enumerate([(0, 1, 2), (0,), (1,), (2,)]):
        rows = row * 4 // HEIGHT == band
        assert 27 <= rows.sum() <= 28
        for k in range(3):
            expected = wanted if k in channels else np.zeros(WIDTH)
            np.testing.assert_array_equal(got[rows][..., k], np.tile(expected, (rows.sum(), 1)))


@pytest.mark.parametrize("eye", [None, 90.0])
@pytest.mark.parametrize("fraction_bits", [16, 23])
@pytest.mark.parametrize("grid", GRIDS)
def test_a_boards_words_round_the_same_definitions(grid, fraction_bits, eye):
    """At F = 16 a cell is 65536 units: a level changes where 256 of them round, one pixel in a hundred."""
    display = display_for(generator(SEED, grid, fraction_bits), grid, eye)
    for kind in ON_BOARD:
        exact, words = (levels(display, kind, fraction_bits=f) for f in (None, fraction_bits))
        differ = (exact != words).any(axis=2).mean()
        assert differ <= (0.02 if fraction_bits == 16 else 2e-3), kind
        if kind in ("checker", "ramp"):
            assert differ == 0
    assert (levels(display, "view-numbers") != levels(display, "view-numbers", fraction_bits=16)).any()


def eye_display(grid, side, eye):
    """21 x 13 lenslets, f/4, 13 pixels each: elemental images out to 7 degrees."""
    display = focused_display(grid, side, focal=4.0, pixel_pitch=1 / 13, width_px=273, height_px=169, rotation=3.0)
    return dataclasses.replace(display, viewing_distance_mm=eye)


@pytest.mark.parametrize(
    ("grid", "side", "eye_mm", "place", "crosstalk"),
    [
        # 21 mm at 70 mm: 8.5 degrees at the edges, beyond 7.
        ("square", "panel", None, (0.0, 0.0, 70.0), True),
        ("hex", "viewer", None, (4.0, -3.0, 600.0), False),
        # At 150 mm there is none only because the display converges there.
        ("square", "panel", 150.0, (4.0, -3.0, 150.0), False),
        ("hex", "viewer", 150.0, (4.0, -3.0, 150.0), False),
    ],
)
def test_an_eye_sees_white_and_by_crosstalk_black(mi, grid, side, eye_mm, place, crosstalk):
    display, eye = eye_display(grid, side, eye_mm), Eye(place)
    image = draw(display, "white-for-eye", eye).radiance
    white = image[..., 0]
    assert set(np.unique(white)) == {0.0, 1.0}
    own = observe(image, display, eye, whole_window(display, 105), samples=16, crosstalk=False)
    assert (own.status_share["crosstalk"] > 0.1) == crosstalk
    assert abs(own.radiance.mean() - own.status_share["ok"]) < 2e-3
    # By golden rays at random: the pixels that rays reach through their own lenslets are lit.
    count, panel = 300_000, display.panel
    points = np.pad(generator(SEED).uniform(-0.5, 0.5, (count, 2)) * (21.0, 13.0), ((0, 0), (0, 1)))
    rays = points - eye.position_mm
    hits = trace_to_panel(
        display, np.tile(eye.position_mm, (count, 1)), rays / np.linalg.norm(rays, axis=1, keepdims=True)
    )
    u, v = np.floor(hits.pixel).astype(int).T
    inside = (u >= 0) & (u < panel.width_px) & (v >= 0) & (v < panel.height_px)
    through_own = inside & (hits.status == Status.OK)
    reached = np.zeros_like(white, bool)
    reached[v[through_own], u[through_own]] = True
    # Grazed pixels differ. A pattern shifted by one pixel would differ in half of them.
    assert (reached != (white > 0)).sum() <= 0.07 * reached.sum()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["white-for-eye", "--eye", "0,0,-600"], "eye: z -600 mm is not in front of the display"),
        (["cells", "--lens", "0,0"], "--lens belongs to the pattern single-lens"),
        (["single-lens", "--lens", "900,0"], "lenslet 900,0 owns no pixel"),
        (["single-lens", "--lens", "0.5,0"], "give 2 whole numbers"),
        (["cells", "--fraction-bits", "16"], "--fraction-bits belongs to the patterns of a board, single-lens"),
        (["rings"], "'rings' is not one of 'lens-centres'"),
    ],
)
def test_bad_options(tmp_path, refusal_of, options, said):
    (tmp_path / "d.toml").write_text(display_text(eye_display("square", "panel", None)))
    assert said in refusal_of("pattern", *options, "--display", tmp_path / "d.toml", "-o", tmp_path / "p.png")
    assert not (tmp_path / "p.png").exists()


def test_a_board_refuses_what_its_registers_cannot_hold():
    display = display_for(generator(SEED, "wide"), "square", None, width_px=17000, height_px=1)
    with pytest.raises(InputError, match="register raster_panel"):
        draw(display, "lens-centres", fraction_bits=16)
    assert draw(display, "lens-centres").radiance.shape == (1, 17000, 3)


@pytest.mark.parametrize(("extent", "eye"), [((4.0, 3.0), "0,0,600"), (None, "500,0,300")])
def test_observe_says_where_rays_end(tmp_path, monkeypatch, capfd, extent, eye):
    """5 x 3 lenslets of 1 mm before a panel of 8 x 6 mm: 11 of 16 rays meet the mount."""
    display = focused_display("square", focal=3.0, width_px=80, height_px=60, pixel_pitch=0.1)
    display = dataclasses.replace(display, array=dataclasses.replace(display.array, extent_mm=extent))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "it.toml").write_text(display_text(display))
    assert run(["pattern", "checker", "--display", "it.toml", "-o", "it.png"]) == 0
    capfd.readouterr()
    assert run(["observe", "it.png", "--display", "it.toml", "--eye", eye, "--width", "80", "-o", "view.png"]) == 0
    (note,) = [line for line in capfd.readouterr().err.splitlines() if "rays end" in line]
    assert ("on the array's mount" in note) == (extent is not None)
    assert "outside the panel" in note
    if extent is not None:
        assert float(note.split("up to ")[1].split(" %")[0]) == pytest.approx(100 * 11 / 16, abs=1.0)
