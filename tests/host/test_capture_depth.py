"""Proof of depth on a small, fast configuration: signs and magnitudes against formulas written again here."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lippmann.capturing.capture import shown_depth
from lippmann.capturing.capture_setup import Pickup, load_setup
from lippmann.capturing.imaging_lens import ThinLens
from tools.depth import CENTRES, WIDE, depth_page, judged, measure_depths, strip_of
from tools.depth import SETUPS as FIGURE

SETUPS = Path(__file__).parents[2] / "scenes/setups"


def lens_equations(z, position, focal=3.3, gap=4.8, rotated=True):
    """Depth by hand for the paper's numbers: object at 1000 - z, f = 293.29, lenslet of 3.3 mm, n = 1.5."""
    f = 1000 * 415 / 1415
    image = 1 / (1 / f - 1 / (1000 - z))
    behind = image - (415 + position)
    # Thinnest lenslet of R = 1.65: its principal plane T/1.5 from the flat face.
    thickness = 1.65 - np.sqrt(1.65**2 - 0.5)
    g = gap + thickness / 1.5
    length = 1450 - (415 + position) - thickness / 3
    v = 1 / (1 / focal - 1 / length)
    depth = g / v * (behind + v) * length / (length - behind)
    return depth if rotated else -depth


@pytest.mark.parametrize(("name", "position"), [("fig8a", -60.0), ("fig8b", -40.0), ("fig8c", -20.0), ("fig8d", 10.0)])
def test_the_formula_is_the_one_of_the_equations(name, position):
    setup = load_setup(SETUPS / f"{name}.toml")
    z = np.array([50.0, 0.0, -120.0, -300.0])
    for rotated in (True, False):
        got = shown_depth(setup, z, rotated)
        gap = setup.display.gap_mm
        assert got == pytest.approx(lens_equations(z, position, gap=gap, rotated=rotated), rel=1e-9)
        # What stands nearer to the lens appears nearer to the eye when rotated, and farther off when not.
        assert (np.diff(got) < 0.0).all() == rotated


@pytest.mark.parametrize(
    ("name", "z", "sign"),
    [
        ("fig8a", 0.0, 1), ("fig8c", 0.0, 1), ("fig8c", -280.0, -1), ("fig8d", -100.0, -1),
        pytest.param("fig8b", -200.0, 1, marks=pytest.mark.full),
    ],
)  # fmt: skip
def test_an_eye_that_moves_sees_the_depth(mi, name, z, sign):
    setup = strip_of(load_setup(SETUPS / f"{name}.toml"))
    gap = setup.display.gap_mm
    for rotated in (True, False):
        (depth,) = measure_depths(setup, z, rotated)
        theory = lens_equations(z, setup.position_mm, gap=gap, rotated=rotated)
        assert np.sign(depth) == np.sign(theory) == (sign if rotated else -sign)
        assert depth == pytest.approx(theory, rel=0.05)


def test_an_ideal_lens_and_a_pickup(mi):
    """No aberration but the lenslets', and no camera's perspective: a pickup at the display's gap keeps depth as is."""
    setup = strip_of(load_setup(SETUPS / "pickup.toml"))
    setup = replace(setup, lens=ThinLens(1000 * 415 / 1415, 320.0))
    assert setup.pickup == Pickup(4.8)
    (depth,) = measure_depths(setup, 0.0, True)
    assert depth == pytest.approx(60.0, rel=0.03)
    assert float(shown_depth(setup, 0.0, True)) == pytest.approx(60.0)


@pytest.mark.parametrize(("name", "rotated"), [("fig8a", True), ("fig8a", False), ("pickup", True), ("pickup", False)])
def test_a_display_for_a_near_eye(mi, name, rotated):
    """Light of an elemental image leans towards the eye: 1/z = (1 + g/E) / z0 + 1/E behind a camera, z0 without an eye.

    A pickup's light leans as the display's; rotated it leans the other way, twice as much.
    """
    eye_mm = 250.0
    setup = strip_of(load_setup(SETUPS / f"{name}.toml"))
    z = float(shown_depth(setup, 0.0, rotated))
    setup = replace(setup, display=replace(setup.display, viewing_distance_mm=eye_mm))
    g = setup.display.aperture_distance_mm
    if name == "fig8a":
        expected = 1.0 / ((1.0 + g / eye_mm) / z + 1.0 / eye_mm)
    else:
        expected = 1.0 / (1.0 / z + 2.0 / eye_mm) if rotated else z
    assert float(shown_depth(setup, 0.0, rotated)) == pytest.approx(expected, rel=1e-12)
    (depth,) = measure_depths(setup, 0.0, rotated)
    assert depth == pytest.approx(expected, rel=0.05)
    assert abs(expected - z) > 0.1 * abs(z) or (name == "pickup" and not rotated)


def test_concave_lenslets_need_no_rotation(mi):
    setup = strip_of(load_setup(SETUPS / "concave.toml"))
    (depth,) = measure_depths(setup, 0.0, False)
    # Their pupil stands 3.3 mm behind the array, not before it.
    theory = -lens_equations(0.0, -60.0, focal=-3.3)
    assert theory > 0.0
    assert depth == pytest.approx(theory, rel=0.05)


def test_a_plain_array_converts_pseudoscopic_to_orthoscopic(mi):
    """No imaging lens, the object 120 mm before the array: real and inside out as captured, virtual when rotated."""
    setup = strip_of(load_setup(SETUPS / "plain.toml"))
    g = setup.display.aperture_distance_mm
    length = 1095 - setup.array.thickness_mm / 3
    v = 1 / (1 / 3.3 - 1 / length)
    for z in (0.0, 60.0):
        far = 120.0 - z
        theory = g / v * (far - v) * length / (length + far)
        (real,) = measure_depths(setup, z, False)
        (virtual,) = measure_depths(setup, z, True)
        assert real == pytest.approx(theory, rel=0.05)
        assert virtual == pytest.approx(-theory, rel=0.05)


def test_an_eye_that_moves_far_sees_aberrations(mi):
    """+-30 mm: through the pair of spherical lenses 2.7 to 9.5 % too near the display."""
    setup = strip_of(load_setup(SETUPS / "fig8a.toml"))
    near, wide = measure_depths(setup, 0.0, True, (CENTRES, WIDE))
    theory = lens_equations(0.0, -60.0)
    assert near == pytest.approx(theory, rel=0.005)
    assert -0.095 < wide / theory - 1.0 < -0.02


def test_the_report_says_how_far_its_eyes_move():
    found = {"array_position_mm": -60.0, "gap_mm": 4.8, "theory_mm": 50.0, "centres_mm": 50.5, "lenslets_mm": 51.0}
    rows = [
        judged({"setup": name, "rotated": rotated, **found, "wide_mm": 50.0 * (1.0 + error)})
        for name, error in zip(FIGURE, (-0.03, -0.05, -0.1, 0.2), strict=True)
        for rotated in (True, False)
    ]
    text = depth_page({}, rows).text()
    assert "4 of 4 objects appear on the correct side of the display, and within 5 %" in text
    assert "within 5 % of the depth by the lens equations, for an eye near the axis (-5 to +5 mm)" in " ".join(
        text.split()
    )
    assert "near the axis (-5 to +5 mm)" in text
    assert "moves -30 to +30 mm" in text
    assert "shift the depths by -5.0 to 10.0 mm" in text
    for name, shift in zip(FIGURE, ("-1.5", "-2.5", "-5.0", "+10.0"), strict=True):
        lines = [line for line in text.splitlines() if line.startswith(f"| {name} |")]
        assert sum(line.endswith(f"| {shift} to {shift} |") for line in lines) == 2
