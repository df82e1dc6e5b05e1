"""Elemental images that converge on an eye, in fixed point: registers by hand, rays against golden, what is refused.

The largest display here is 1.2 m wide: an eye at 600 mm sees its corners at 49 degrees.
"""

import dataclasses
import itertools
import os
from fractions import Fraction

import numpy as np
import pytest
from lippmann.display.description import Array, Display, Panel
from lippmann.engines import trace, trace_fixed
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.optics.rays import MODELS, Status, gets_through
from optics_cases import GRIDS, SIDES, display_of, random_pixels, trace_both, twin_errors

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
RAYS = 20_000

#: Width and height in pixels, pixel pitch, viewing axis, offset, the eye's distance: a 15.6 inch panel, with eye and
#: array off its centre and for a far eye too, and one 1.2 m wide.
PANELS = {
    "15.6-inch": (3840, 2160, 0.08964, (0.0, 0.0), (0.0, 0.0), 600.0),
    "off-axis": (3840, 2160, 0.08964, (40.0, -25.0), (0.31, -0.22), 600.0),
    "far-eye": (3840, 2160, 0.08964, (40.0, -25.0), (0.31, -0.22), 1e9),
    "wide": (7680, 4320, 0.15625, (0.0, 0.0), (0.0, 0.0), 600.0),
}


def display_for(panel, grid, side="panel"):
    """1 mm lenslets, f 3 mm, turned by 0.37 degrees: in contact with the panel, or their domes 3 mm before it."""
    width, height, pixel, axis, offset, eye = PANELS[panel]
    thickness, gap = (4.5504, 0.0) if side == "panel" else (1.0, 3.0)
    array = Array(grid, 1.0, 3.0 * 0.5168, 1.5168, thickness, side, None, 0.37, offset)
    return Display(panel, Panel(width, height, pixel), array, gap, eye, axis)


@pytest.mark.parametrize("aperture", ["chief", "full"])
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("panel", PANELS)
def test_exact_rays_against_golden(panel, grid, side, aperture):
    """As is promised: max(1, 0.5 / cos) microradian and 2 nm.

    On the wide panel rays through a substrate at 49 degrees exceed it: twice that, and some in a thousand of them.
    """
    print(f"seed {SEED}")
    rng = np.random.default_rng([SEED, *f"{panel}{grid}{side}{aperture}".encode()])
    display = display_for(panel, grid, side)
    twin, golden = trace_both(rng, display, RAYS, aperture == "full")
    same = (twin.status == golden.status) & (twin.lenslet == golden.lenslet).all(axis=1)
    assert same.mean() > 0.9995
    active = same & gets_through(golden.status)
    assert active.mean() > 0.9
    angle, distance_nm = (errors[active] for errors in twin_errors(display, twin, golden))
    steep = panel == "wide" and side == "panel"
    assert angle.max() <= (2.0 if steep else 1.0)
    assert (angle > 1.0).mean() < 0.004
    assert distance_nm.max() <= 2.0
    # Chief rays of the wide panel leave through neighbours, where the substrate bends them less than the definition.
    strays = (twin.status == Status.CROSSTALK).mean()
    assert (strays > 0.01) == steep or aperture == "full"


@pytest.mark.parametrize("model", [model for model in MODELS if model != "exact"])
@pytest.mark.parametrize("grid", GRIDS)
def test_ideal_rays_against_golden(grid, model):
    """Each slope is k x + l a: as without an eye, but x is up to 1.8 pitches, and k a unit of 2^-24 off."""
    print(f"seed {SEED}")
    rng = np.random.default_rng([SEED, *f"{grid}{model}".encode()])
    display = display_for("off-axis", grid)
    twin, golden = trace_both(rng, display, RAYS, True, model)
    same = (twin.lenslet == golden.lenslet).all(axis=1)
    assert (same & (twin.status == golden.status)).mean() > 0.9995
    assert np.linalg.norm(twin.direction - golden.direction, axis=1)[same].max() < 10.0 * 2.0**-24
    assert twin_errors(display, twin, golden)[1][same].max() <= 2.0


def test_registers_by_hand():
    """D = 1.5 + 2.25 / 1.5 = 3 mm and E = 297 mm: s = 1/100, and all is 99 hundredths of what it is without an eye."""
    f, s = 20, Fraction(1, 100)
    display = display_of("square", "panel", radius=1.6, index=1.5, thickness=2.25, gap=1.5, offset=(0.3, -0.2))
    display = dataclasses.replace(display, viewing_distance_mm=297.0, viewing_axis_mm=(1.5, -0.75))
    config = configuration(display, Build.of(display, "exact", f, aims=True), "exact")
    # The pixel pitch is 1/16 mm, the lenslets' 1 mm; the eye's point in the array's frame is (1.2, -0.55).
    axis = (Fraction("1.2"), Fraction("-0.55"))
    half = 1 << (39 - f)
    wanted = {
        "x_from_u": (1 - s) / 16 * 2**36, "x_from_v": 0, "y_from_u": 0, "y_from_v": (1 - s) / 16 * 2**36,
        "x_offset": (Fraction("-0.3") * (1 - s) + axis[0] * s) * 2**40 + half,
        "y_offset": (Fraction("0.2") * (1 - s) + axis[1] * s) * 2**40 + half,
        "slope_x": Fraction(-1, 3) / (1 - s) * 2 ** (f + 1), "slope_y": Fraction(-1, 3) / (1 - s) * 2 ** (f + 1),
        "slope_aim_x": Fraction(1, 3) * 2 ** (f + 1), "slope_aim_y": Fraction(1, 3) * 2 ** (f + 1),
        "point_x": Fraction(1, 2) / Fraction("1.6") / (1 - s) * 2**f,
        "point_aim_x": Fraction(1, 2) / Fraction("1.6") * 2**f,
        "converge_share": s * 2 ** (f + 11),
        "converge_x": -s * axis[0] * 2 ** (f + 2), "converge_y": -s * axis[1] * 2 ** (f + 2),
    }  # fmt: skip
    for name, value in wanted.items():
        # Half of the last place; a float64 of the offsets is 2^-12 of it off.
        assert abs(getattr(config, name) - value) <= Fraction(501, 1000), name


def test_a_build_tries_further_domes_where_chief_rays_stray():
    for panel, side, steps in (("15.6-inch", "panel", 0), ("wide", "panel", 2), ("wide", "viewer", 2)):
        display = display_for(panel, "hex", side)
        assert Build.of(display, "exact", 23, aims=False).max_cell_steps == steps, (panel, side)
        assert Build.of(display, "exact", 23, aims=False).converge
    # Without further domes the rays that stray, and no others, count as missed.
    rng = np.random.default_rng(7)
    display = display_for("wide", "hex")
    pixels = random_pixels(rng, display, RAYS)
    golden = trace(display, trace_fixed(display, pixels, None, "exact").pixel, None, "exact")
    none = trace_fixed(display, pixels, None, "exact", max_cell_steps=0)
    strays = (golden.lenslet != trace(display, golden.pixel, None, "pinhole").lenslet).any(axis=1)
    assert strays.mean() > 0.01
    np.testing.assert_array_equal(none.status[~strays], golden.status[~strays])
    assert (none.status[strays] == Status.MISSED).all()


#: By hand: half of the diagonal is 197.47 mm, and the half diagonal of a cell 0.5774 mm.
REFUSED = [
    (
        {"panel": Panel(40, 40, 0.08964), "viewing_distance_mm": 20.0}, {},  # 3 / 23
        r"register converge_share: 0\.130435 is outside its range \[-0\.125, 0\.125\); the eye is too near: raise",
    ),
    (
        {"viewing_distance_mm": 100.0}, {},  # (197.47 3 / 103 + 0.5774) / 3
        r"registers slope_x and slope_y: a ray's slope is up to 2\.11, .* of 60 degrees; the eye is too near",
    ),
    (
        {"viewing_distance_mm": 160.0, "gap_mm": 17.0}, {},  # (197.47 / 9 + 0.5774) 8 / 9 / 0.866
        r"registers converge_share, converge_x and converge_y .* up to 23\.1 rows .* \[0, 8\); the eye is too near",
    ),
    (
        {"viewing_distance_mm": 220.0}, {"radius_mm": 0.7, "thickness_mm": 4.0},  # (2.339 + 0.577) / 0.7
        r"registers point_x and point_y: .* up to 4\.17 radii from the axis, .* \[0, 4\); the eye is too near",
    ),
    (
        {"panel": Panel(40, 40, 0.08964), "viewing_distance_mm": 27.0}, {"offset_mm": (1000.0, 0.0)},  # 1000 / 10
        r"register converge_x: 99\.99\d+ is outside its range \[-64, 64\); bring viewing_axis_mm and array\.offset_mm",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("of_display", "of_array", "says"), REFUSED)
def test_what_the_words_do_not_hold_is_refused(of_display, of_array, says):
    display = display_for("15.6-inch", "hex")
    array = dataclasses.replace(display.array, **of_array)
    display = dataclasses.replace(display, array=array, **of_display)
    with pytest.raises(InputError, match=says) as refusal:
        configuration(display, Build.of(display, "exact", 23, aims=False), "exact")
    assert "\n" not in str(refusal.value)


def test_a_build_that_does_not_converge_and_pixels_beside_the_panel_are_refused():
    display = display_for("15.6-inch", "hex")
    with pytest.raises(InputError, match="converge is False"):
        configuration(display, Build(23, "hex"), "exact")

    corners = np.array(list(itertools.product((0.0, 3840.0), (0.0, 2160.0))))
    assert (trace_fixed(display, corners, None, "exact").status == Status.OK).all()
    for pixel in ((-0.04, 5.0), (3840.04, 5.0), (5.0, -0.04), (5.0, 2160.04)):
        with pytest.raises(InputError, match=r"pixels lie outside the panel; .* give .* pixels of the panel"):
            trace_fixed(display, np.array([pixel]), None, "exact")
    # Elsewhere a ray beside the panel is as any other.
    display = dataclasses.replace(display, viewing_distance_mm=None)
    assert (trace_fixed(display, np.array([(-0.04, 5.0)]), None, "exact").status == Status.OK).all()
