"""Photographs by POV-Ray of glass solids: its rays against our tracer's, its pictures against its numbers."""

import dataclasses

import numpy as np
import pytest
from lippmann.calibration.simulated_camera import Camera
from lippmann.calibration.simulated_photographs import trace_projection
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.optics.rays import gets_through
from lippmann.optics.trace import trace_to_panel
from tools.simulated_bench import framed
from tools.simulated_povray import SolidsBench, numbered, numbers, render, write_model, write_picture

#: A panel so fine that its pixels' edges do not count, columns.
FINE_PX = 2560


def built(request, grid, side, gap_mm=0.2):
    display = load_display(request.config.rootpath / f"scenes/displays/vga-{grid}.toml")
    display = dataclasses.replace(
        display, array=dataclasses.replace(display.array, plano_side=side, thickness_mm=0.9, offset_mm=(0.13, -0.21))
    )
    return display.misaligned(rotation_deg=2.0, pitch_scale=1.003, gap_mm=gap_mm)


def camera_before(display):
    """A camera that sees a part of the panel and its edge."""
    aside = Camera((20.0, -10.0, 150.0), (12.0, 6.0, 0.0), roll_deg=3.0, width_px=240, height_px=200, k1=-0.1)
    return framed(aside, display, fill=2.0)


@pytest.mark.parametrize(("grid", "side"), [("square", "panel"), ("hex", "viewer"), ("square", "viewer")])
def test_its_rays_meet_the_panel_where_ours_do(request, tmp_path, grid, side):
    display = built(request, grid, side)
    camera = camera_before(display)
    fine = dataclasses.replace(display, panel=display.panel.with_columns(FINE_PX))
    write_model(fine, tmp_path)
    write_picture(tmp_path / "panel.png", numbered(fine.panel))
    values, u, v = render(tmp_path, camera)
    place, lit = numbers(values, fine.panel)
    hits = trace_to_panel(display, *camera.rays(u, v))
    ours = gets_through(hits.status)
    assert 0.3 < ours.mean() < 0.95
    # Total internal reflection, which ends our rays, may lead POV-Ray's on to the panel.
    assert (lit & ~ours).mean() < (0.03 if grid == "hex" else 0.005)
    assert (ours & ~lit).mean() < 0.001
    both = lit & ours
    difference = place[both] * (display.panel.width_px / FINE_PX) - hits.pixel[both]
    same = np.abs(difference).max(axis=1) < 0.3
    print(f"{grid} {side}: {1 - same.mean():.2e} elsewhere, mean {difference[same].mean(axis=0)} px")
    assert same.mean() > 0.999
    assert np.abs(difference[same].mean(axis=0)).max() < 0.002
    _, lenslet, count = np.unique(hits.lenslet[both][same], axis=0, return_inverse=True, return_counts=True)
    assert (count > 50).sum() > 40
    for axis in (0, 1):
        means = np.bincount(lenslet.ravel(), difference[same][:, axis]) / count
        assert np.sqrt((means[count > 50] ** 2).mean()) < 0.01


def test_its_photographs_are_ours(request):
    """The whole camera, with distortion and a pupil out of focus: smooth pictures, the same but for the samples."""
    display = built(request, "square", "panel")
    camera = dataclasses.replace(camera_before(display), pupil_mm=3.0, focus_mm=140.0, vignetting=0.3)
    row, column = np.mgrid[0:480, 0:640].astype(np.float32)
    light = 0.5 + 0.25 * np.sin(column / 40.0) + 0.25 * np.sin(row / 31.0)
    theirs, ours = (
        projection.photograph(light)
        for projection in (SolidsBench(2).project(display, camera), trace_projection(display, camera))
    )
    assert theirs.shape == ours.shape == (200, 240)
    assert ours.mean() > 0.15
    assert np.median(np.abs(theirs - ours)) < 0.01
    assert theirs.mean() == pytest.approx(ours.mean(), rel=2e-3)


def test_a_panel_in_contact_and_one_with_sub_pixels(request, tmp_path):
    display = built(request, "square", "panel")
    touching = dataclasses.replace(display, gap_mm=0.0)
    write_model(touching, tmp_path)
    write_picture(tmp_path / "panel.png", numbered(touching.panel))
    camera = camera_before(touching)
    values, u, v = render(tmp_path, camera)
    place, lit = numbers(values, touching.panel)
    hits = trace_to_panel(touching, *camera.rays(u, v))
    both = lit & gets_through(hits.status)
    assert both.mean() > 0.3
    assert (np.abs(place - hits.pixel)[both].max(axis=1) < 0.6).mean() > 0.98
    striped = dataclasses.replace(display, panel=dataclasses.replace(display.panel, subpixels="rgb"))
    with pytest.raises(InputError, match="has colour sub-pixels"):
        SolidsBench().project(striped, camera)
