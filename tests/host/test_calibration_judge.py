"""The judge of a calibration: displays whose errors are known, and the random displays that it is given."""

import math

import numpy as np
import pytest
from lippmann.calibration.result import Calibration, Parameter
from lippmann.display.description import load_display
from lippmann.optics.system import PanelFrame
from tools.calibration_accuracy import GAP, deviations, eye_difference, judge, random_case
from tools.simulated_bench import corners_mm


@pytest.fixture(params=["square", "hex"])
def display(request):
    return load_display(request.config.rootpath / f"scenes/displays/vga-{request.param}.toml")


def test_the_same_lattice_has_no_error(display):
    errors = judge(display, display)
    assert errors.worst_px < 1e-9
    assert errors[2:] == (0.0, 0.0, 0.0, 0.0)
    # Moved by a whole lenslet, or turned by a symmetry of the grid, it is the same.
    pitch = display.array.pitches_mm[0]
    turn = 90.0 if display.array.grid == "square" else 60.0
    again = judge(display.misaligned(rotation_deg=turn, offset_mm=(pitch, 0.0)), display)
    assert again.worst_px < 1e-6
    assert again.rotation_deg < 1e-9


def test_a_shift_a_turn_and_a_stretch_are_measured(display):
    pixel = display.panel.pitches_mm[0]
    moved = judge(display.misaligned(offset_mm=(0.3 * pixel, 0.4 * pixel)), display)
    assert (moved.rms_px, moved.worst_px) == pytest.approx((0.5, 0.5))
    turned = judge(display.misaligned(rotation_deg=-0.01), display)
    assert turned.rotation_deg == pytest.approx(0.01)
    # The farthest lenslet is a little nearer to the middle than the panel's corner, 400 px.
    assert turned.worst_px == pytest.approx(400.0 * math.radians(0.01), rel=0.1)
    stretched = judge(display.misaligned(pitch_scale=1.0001), display)
    assert stretched.pitch_ppm == pytest.approx(100.0)
    assert stretched.worst_px == pytest.approx(0.04, rel=0.1)
    assert stretched.rms_px == pytest.approx(1e-4 * math.sqrt((640**2 + 480**2) / 12.0), rel=0.05)
    depth = display.aperture_distance_mm
    assert judge(display.misaligned(gap_mm=0.02 * depth), display).gap_percent == pytest.approx(2.0)


def test_an_eye_sees_the_same_of_displays_that_it_cannot_tell_apart(display):
    """In paraxial optics the point seen is L (1 + D/z) - C D/z: a larger gap and a smaller pitch may cancel."""
    eye = (5.0, -8.0, 200.0)
    assert eye_difference(display, display, eye).max() < 1e-9
    deeper = display.misaligned(gap_mm=0.05)
    old, new = (1.0 + one.aperture_distance_mm / eye[2] for one in (display, deeper))
    shift = 0.05 / eye[2] / new
    alike = display.misaligned(gap_mm=0.05, pitch_scale=old / new, offset_mm=(eye[0] * shift, eye[1] * shift))
    assert eye_difference(deeper, display, eye).max() > 0.05
    assert eye_difference(alike, display, eye).max() < 0.02
    # Seen from elsewhere they differ.
    assert eye_difference(alike, display, (45.0, -8.0, 200.0)).max() > 0.2


def test_errors_are_told_in_units_of_the_intervals(display):
    """Numbers of a result that are off by known shares of their intervals; the offset, by whole lenslets beside."""
    truth = display.misaligned(rotation_deg=2.0, offset_mm=(0.1, -0.2), pitch_scale=1.003)
    array, pitch = truth.array, truth.array.pitches_mm[0]
    aside = np.array(PanelFrame.of(truth).turn(3.0 * pitch, 0.0)) + array.offset_mm
    values = {
        "pitch_x": array.pitches_mm[0] + 0.5e-4, "pitch_y": array.pitches_mm[1] - 2e-4, "shear": array.shear,
        "rotation": 2.0 + 1.5e-4, "offset_x": aside[0] + 1e-5, "offset_y": aside[1] - 3e-5, "gap": truth.gap_mm,
    }  # fmt: skip
    parameters = tuple(Parameter(name, value, 1e-4, "", 0.0, True) for name, value in values.items())
    found = Calibration(parameters, (), (), {}, 0.0, 0.0, 0.0, truth, display, np.zeros((0, 8)))
    expected = {
        "pitch_x": 0.5, "pitch_y": -2.0, "shear": 0.0, "rotation": 1.5, "offset_x": 0.1, "offset_y": -0.3, "gap": 0.0,
    }  # fmt: skip
    assert deviations(found, truth) == pytest.approx(expected, abs=1e-6)


def test_random_displays_are_as_the_requirement_asks():
    cases = [random_case(seed) for seed in range(24)]
    assert cases[3] == random_case(3)
    kinds = {(one.nominal.array.grid, one.nominal.array.plano_side, one.nominal.array.rotation_deg) for one in cases}
    assert len(kinds) == 8
    turns = [one.built.array.rotation_deg - one.nominal.array.rotation_deg for one in cases]
    assert max(map(abs, turns)) <= 5.0
    assert max(turns) > 3.0
    gaps = [one.built.gap_mm / one.nominal.gap_mm - 1.0 for one in cases]
    assert max(map(abs, gaps)) <= GAP
    assert max(gaps) > 0.1 > -0.1 > min(gaps)
    stretch = [judge(one.nominal, one.built).pitch_ppm for one in cases]
    assert max(stretch) < 1.15e4
    for case in cases:
        assert len({(one.k1, one.focal_px) for one in case.cameras}) == 1
        for camera in case.cameras:
            # The whole panel is in view.
            at = camera.project(corners_mm(case.built)) / (camera.width_px, camera.height_px)
            assert at.min() > 0.0
            assert at.max() < 1.0
