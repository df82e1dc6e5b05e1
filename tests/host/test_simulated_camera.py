"""Computed photographs: the camera's geometry, its noise, the disturbances; and POV-Ray's of glass solids."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from lippmann.base.tones import decode
from lippmann.calibration.simulated_camera import Camera, Sensor
from lippmann.calibration.simulated_photographs import photograph_folder, trace_projection
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.optics.rays import gets_through
from lippmann.optics.trace import trace_to_panel
from PIL import Image
from scipy.ndimage import gaussian_filter
from tools.simulated_bench import Disturbances, disturbed, framed
from tools.simulated_povray import SolidsBench, numbered, numbers, render, write_model, write_picture

#: A camera aside, rolled, with distortion: 60 x 48 pixels keep a trace short.
CAMERA = Camera((20.0, -10.0, 150.0), roll_deg=3.0, width_px=60, height_px=48, k1=-0.1, k2=0.02, pupil_mm=2.0)


@pytest.fixture(scope="module")
def built(request):
    shipped = load_display(request.config.rootpath / "scenes/displays/vga-square.toml")
    return shipped.misaligned(rotation_deg=2.0, pitch_scale=1.003, gap_mm=0.2)


@pytest.fixture
def patterns(tmp_path, built):
    folder = tmp_path / "patterns"
    folder.mkdir()
    height, width = built.panel.height_px, built.panel.width_px
    ramp = np.broadcast_to(np.arange(width) * 255 // (width - 1), (height, width)).astype(np.uint8)
    for number, values in enumerate((np.full_like(ramp, 255), np.zeros_like(ramp), ramp)):
        Image.fromarray(values).save(folder / f"{number:02}-pattern.png")
    return folder


def picture(path):
    return np.asarray(Image.open(path)).astype(float)


def test_the_camera_shows_points_where_its_rays_come_from(built):
    camera = framed(dataclasses.replace(CAMERA, width_px=1000, height_px=800, principal_px=(530.0, 377.0)), built)
    u, v = np.random.default_rng(1).random((2, 500)) * [[1000.0], [800.0]]
    origin, direction = camera.rays(u, v)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-12)
    points = origin - (origin[:, 2:] / direction[:, 2:]) * direction
    np.testing.assert_allclose(camera.project(points), np.stack([u, v], axis=1), atol=1e-7)
    # Rays from the pupil's rim meet those from its middle in the plane in focus: the one looked at, upright here.
    upright = dataclasses.replace(camera, position_mm=(0.0, 0.0, 150.0))
    (o, d), (p, e) = upright.rays(u, v), upright.rays(u, v, (np.cos(u), np.sin(u)))
    np.testing.assert_allclose(np.linalg.norm(p - o, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(p - (p / e)[:, 2:] * e, o - (o / d)[:, 2:] * d, atol=1e-9)


def test_distortion_and_directions_by_hand():
    camera = Camera((0.0, 0.0, 100.0), width_px=200, height_px=100, focal_px=500.0, k1=-0.2, k2=0.1)
    # To the right by 10 mm and up by 5 mm: x = 0.1, y = -0.05, r^2 = 0.0125.
    gain = 500.0 * (1.0 - 0.2 * 0.0125 + 0.1 * 0.0125**2)
    np.testing.assert_allclose(camera.project([(10.0, 5.0, 0.0)]), [(100.0 + 0.1 * gain, 50.0 - 0.05 * gain)])
    # Rolled clockwise by 90 degrees, the camera shows the world turned counter-clockwise: right becomes up.
    turned = Camera((0.0, 0.0, 100.0), roll_deg=90.0, width_px=200, height_px=100, focal_px=500.0)
    np.testing.assert_allclose(turned.project([(10.0, 0.0, 0.0)]), [(100.0, 0.0)], atol=1e-9)


def test_a_camera_that_cannot_be(built):
    with pytest.raises(InputError, match="not in front of the display"):
        Camera((0.0, 0.0, -1.0))
    with pytest.raises(InputError, match="is not monotonic"):
        Camera((0.0, 0.0, 100.0), focal_px=600.0, k1=-0.6)


def test_it_sees_what_the_golden_tracer_says(built):
    """The mean panel column and row that each camera pixel sees, against rays of the golden engine."""
    camera = framed(dataclasses.replace(CAMERA, pupil_mm=0.0, look_at_mm=(9.0, 6.0, 0.0)), built, fill=3.0)
    projection = trace_projection(built, camera, samples=6)
    height, width = built.panel.height_px, built.panel.width_px
    row, column = np.indices((height, width), dtype=np.float32)
    seen = projection.photograph(np.ones((height, width), np.float32)) / camera.brightness()
    means = [projection.photograph(one + np.float32(0.5)) / camera.brightness() for one in (column, row)]
    u, v = np.meshgrid(np.arange(60 * 12), np.arange(48 * 12))
    hits = trace_to_panel(built, *camera.rays((u.ravel() + 0.5) / 12.0, (v.ravel() + 0.5) / 12.0))
    reach = gets_through(hits.status)
    share, *blocks = (
        values.reshape(48, 12, 60, 12).swapaxes(1, 2).reshape(48, 60, -1)
        for values in (reach, *(hits.pixel * reach[:, None]).T)
    )
    # Camera pixels that see through one lenslet: the others weigh two by random samples.
    single = (share.mean(axis=2) == 1.0) & (np.maximum(*(np.ptp(block, axis=2) for block in blocks)) < 3.0)
    assert 0.3 < single.mean() < 0.8
    assert (share.mean(axis=2) == 0.0).mean() > 0.05
    np.testing.assert_allclose(seen[share.mean(axis=2) == 0.0], 0.0)
    np.testing.assert_allclose(seen[single], 1.0, atol=1e-5)
    for mean, block in zip(means, blocks, strict=True):
        difference = (mean - block.mean(axis=2))[single]
        # The panel's pixels are whole ones: 0.29 where all samples come to the same, less where they spread.
        assert difference.std() < 0.15
        assert abs(difference.mean()) < 0.015


def test_a_lens_blurs_an_edge_as_its_deviation_says(built):
    """The outline of a white panel, against the sharp picture with a Gaussian blur."""
    camera = framed(dataclasses.replace(CAMERA, pupil_mm=0.0, roll_deg=0.0, k1=0.0, k2=0.0), built, fill=0.5)
    white = np.ones((480, 640), np.float32)
    sharp, soft = (
        trace_projection(built, dataclasses.replace(camera, blur_px=blur), samples=8).photograph(white)
        for blur in (0.0, 1.5)
    )
    assert np.abs(soft - sharp).max() > 0.2
    # 64 rays of a pixel at an edge scatter by a sixteenth.
    off = [float((soft - gaussian_filter(sharp, one))[6:-6, 6:-6].std()) for one in (1.0, 1.5, 2.2)]
    assert off[1] < 0.03
    assert off[1] < 0.8 * min(off[0], off[2])


def test_simulated_camera_carry_the_light_with_the_sensors_noise(built, patterns, tmp_path):
    camera = framed(dataclasses.replace(CAMERA, vignetting=0.3, pupil_mm=0.5), built, fill=1.5)
    sensor = Sensor(exposure=0.5, full_well_e=4000.0, read_noise_e=10.0, bits=16, transfer="linear")
    white, black, ramp = photograph_folder(built, camera, patterns, tmp_path / "photos", sensor=sensor)
    assert [path.name for path in (white, black, ramp)] == [path.name for path in sorted(patterns.iterdir())]
    light = picture(white) / 65535.0
    middle, corner = light[20:28, 26:34], light[:6, :6]
    assert middle.mean() == pytest.approx(0.5, abs=0.01)
    assert corner.mean() / middle.mean() == pytest.approx(1.0 - 0.3 * (27**2 + 21**2) / (30**2 + 24**2), abs=0.01)
    # Shot noise of 2000 electrons, and read noise: sqrt(2000 + 100) / 4000; in the dark half of it is clipped.
    assert middle.std() == pytest.approx(0.01146, rel=0.25)
    assert (picture(black) / 65535.0).max() < 0.02
    # The ramp is the panel's light, by the panel's curve, seen through the lenslets.
    expected = trace_projection(built, camera).photograph(
        decode(np.arange(640)[None] * np.ones((480, 1)) // 639, "linear")
    )
    assert expected.shape == (48, 60)
    shares = (picture(ramp) / picture(white))[4:-4, 4:-4]
    u = np.meshgrid(np.arange(4, 56) + 0.5, np.arange(4, 44) + 0.5)
    column = trace_to_panel(built, *camera.rays(u[0].ravel(), u[1].ravel())).pixel[:, 0].reshape(40, 52)
    difference = shares - decode(np.floor(np.clip(column, 0, 639) / 639 * 255) / 255, "srgb")
    assert np.median(np.abs(difference)) < 0.03


def test_seeds_repeat_a_photograph(built, patterns, tmp_path):
    camera = framed(CAMERA, built)
    one, same, other = (
        picture(photograph_folder(built, camera, patterns, tmp_path / str(k), seed=seed, samples=2)[2])
        for k, seed in enumerate((1, 1, 2))
    )
    assert (one == same).all()
    assert (one != other).mean() > 0.3


def test_a_bowed_array_is_the_one_that_stands_higher_there(built):
    """At the panel's corner a bow of 30 um is a gap of 30 um more, under an array that stands 30 um nearer."""
    reach = np.hypot(0.5 * built.panel.width_mm, 0.5 * built.panel.height_mm)
    origin = np.array([[20.0, -10.0, 150.0]])
    corner = np.array([reach * np.cos(0.6), reach * np.sin(0.6), 0.0])
    direction = (corner - origin) / np.linalg.norm(corner - origin)
    bowed = disturbed(built, Disturbances(bow_mm=0.03), engine="golden")(origin, direction)
    lifted = dataclasses.replace(built, gap_mm=built.gap_mm + 0.03)
    expected = trace_to_panel(lifted, origin - [[0.0, 0.0, 0.03]], direction)
    np.testing.assert_allclose(bowed.pixel, expected.pixel, atol=1e-6)
    # In the middle it is the plain one, and the corner is seen elsewhere than without a bow.
    middle = -origin / np.linalg.norm(origin)
    plain = partial(trace_to_panel, built, engine="golden")
    straight = disturbed(built, Disturbances(bow_mm=0.03), engine="golden")(origin, middle)
    np.testing.assert_allclose(straight.pixel, plain(origin, middle).pixel, atol=1e-9)
    assert np.abs(bowed.pixel - plain(origin, direction).pixel).max() > 0.05


def test_disturbances_disturb_as_much_as_they_are_given(built, patterns, tmp_path):
    camera = framed(dataclasses.replace(CAMERA, pupil_mm=0.0, width_px=200, height_px=160), built, fill=1.2)
    sensor = Sensor(exposure=0.5, transfer="linear")

    def shots(**given):
        folder = tmp_path / "_".join(given or ["none"])
        paths = photograph_folder(
            built, camera, patterns, folder, sensor=sensor, bench=Disturbances(**given), samples=2
        )
        return [picture(path) for path in paths]

    white, black, ramp = shots()
    lost = shots(hidden_lenslets=0.1)[0]
    assert (lost < 0.3 * white)[white > 100].mean() == pytest.approx(0.1, abs=0.04)
    assert shots(dead_pixels=0.2)[0].mean() / white.mean() == pytest.approx(0.8, abs=0.03)
    assert shots(reflection=0.2)[1].max() == pytest.approx(0.2 * white.max(), rel=0.15)
    spot = shots(bright_spot=3.0)
    assert spot[1].max() == 255
    assert (spot[1] == 255).mean() < 0.05
    strange = shots(outliers=0.1)
    assert (np.abs(strange[0] - white) > 25).mean() == pytest.approx(0.1 * 0.85, abs=0.03)
    # The spot of 4 px (2 % of 200) becomes one of hypot(4, 3), which is less bright.
    soft = shots(bright_spot=1.0, blur_px=3.0)[1].max() / shots(bright_spot=1.0)[1].max()
    assert soft == pytest.approx(4.0**2 / (4.0**2 + 3.0**2), abs=0.08)
    moved = shots(moved_mm=(3.0, 0.0, 0.0))
    assert np.abs(moved[0] - white).mean() < 0.1 * np.abs(moved[2] - ramp).mean() + 5.0
    assert np.abs(moved[2] - ramp).mean() > 10.0
    assert black.mean() < 1.0


def test_patterns_of_another_panel_are_named(built, patterns, tmp_path):
    Image.new("L", (320, 240)).save(patterns / "01-pattern.png")
    with pytest.raises(InputError, match=r"01-pattern\.png: is 320 x 240 pixels, but the panel is 640 x 480"):
        photograph_folder(built, framed(CAMERA, built), patterns, tmp_path / "photos", samples=1)
    with pytest.raises(InputError, match="contains no PNG files"):
        photograph_folder(built, framed(CAMERA, built), tmp_path, tmp_path / "photos")


#: A panel so fine that its pixels' edges do not count, columns.
FINE_PX = 2560


def solids_display(request, grid, side, gap_mm=0.2):
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
    display = solids_display(request, grid, side)
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


def test_a_panel_in_contact_and_one_with_sub_pixels(request, tmp_path):
    display = solids_display(request, "square", "panel")
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
