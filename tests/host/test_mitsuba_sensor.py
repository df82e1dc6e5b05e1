"""The sensor plugin `integral`: the picture of `lippmann render`, from plain Mitsuba XML."""

import os
import subprocess
import sys

import lippmann
import numpy as np
import pytest
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from optics_cases import GRIDS
from scene_cases import display_toml, focused_display, generator, glowing_sphere, rgb, write_scene

SEED = 6120
NEAR = 25.0
POSE = '<transform name="to_world">{}</transform>'
SCENE = (
    '<emitter type="point"><point name="position" x="30" y="40" z="300"/>'
    '<rgb name="intensity" value="9e4 1e5 8e4"/></emitter>',
    '<shape type="sphere"><point name="center" x="1" y="0" z="9"/>'
    f'<bsdf type="diffuse">{rgb("reflectance", (0.7, 0.5, 0.3))}</bsdf></shape>',
    '<shape type="rectangle"><transform name="to_world"><scale value="60"/><translate z="-30"/></transform>'
    '<bsdf type="diffuse"/></shape>',
    glowing_sphere((-2.0, 1.0, -12.0), 2.0, (0.9, 0.2, 0.4)),
)


@pytest.fixture
def sensor_of(mi, tmp_path):
    import lippmann.capturing.mitsuba_sensor

    lippmann.capturing.mitsuba_sensor.register()

    def made(display, extra="", samples=1):
        (tmp_path / "display.toml").write_text(display_toml(display))
        width, height = display.panel.width_px, display.panel.height_px
        sensor = (
            '<sensor type="integral"><string name="display" value="display.toml"/>'
            f'<float name="near_mm" value="{NEAR}"/>{extra}'
            f'<sampler type="independent"><integer name="sample_count" value="{samples}"/></sampler>'
            f'<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>'
            '<rfilter type="box"/></film></sensor><integrator type="direct"/>'
        )
        path = write_scene(tmp_path / "scene.xml", sensor, *SCENE)
        return load_scene(path, Placement(near_mm=NEAR, far_mm=-40.0))

    return made


def rays_at(mi, sensor, u, v, display, aperture=(0.5, 0.5)):
    panel = display.panel
    place = mi.Point2f(mi.Float(u / panel.width_px), mi.Float(v / panel.height_px))
    return sensor.sample_ray(0.0, 0.5, place, mi.Point2f(*aperture), True)


@pytest.mark.parametrize(
    "eye",
    [{}, {"eye": 9.0, "axis": (1.5, -1.0)}, {"row_pitch": 1.1, "shear": 0.1, "extent": (3.0, 2.0)}],
    ids=["far", "near", "skewed"],
)
@pytest.mark.parametrize("model", ["pinhole", "exact"])
@pytest.mark.parametrize("grid", GRIDS)
def test_its_rays_are_golden_s_seen_from_the_viewer(mi, sensor_of, grid, model, eye):
    display = focused_display(grid, width_px=40, height_px=30, pixel_pitch=0.1, rotation=3.0, offset=(0.2, 0.1), **eye)
    sensor = sensor_of(display, f'<string name="model" value="{model}"/>').mitsuba.sensors()[0]
    rng = generator(SEED, grid, model)
    points = rng.uniform((0, 0), (40, 30), (2000, 2))
    ray, weight = rays_at(mi, sensor, points[:, 0], points[:, 1], display)
    golden = lippmann.trace(display, points, None, model)
    t = (NEAR - golden.origin_mm[:, 2]) / golden.direction[:, 2]
    start = golden.origin_mm + t[:, None] * golden.direction
    alive = np.isin(golden.status, (lippmann.Status.OK, lippmann.Status.CROSSTALK))
    np.testing.assert_array_equal(np.array(weight)[0] == 1.0, alive)
    # A film position in float32 is good to 40 * 2^-24 pixels, 0.24 micrometres of panel: 0.12 microradian and more.
    np.testing.assert_allclose(np.array(ray.d).T[alive], -golden.direction[alive], atol=3e-6)
    np.testing.assert_allclose(np.array(ray.o).T[alive], start[alive], atol=1e-4)


@pytest.mark.parametrize("subpixels", ["none", "rgb", "bgr"])
def test_mitsuba_s_own_render_converges_to_ours(mi, sensor_of, subpixels):
    display = focused_display("hex", width_px=24, height_px=18, pixel_pitch=0.1, subpixels=subpixels)
    scene = sensor_of(display, samples=1024)
    theirs = np.array(mi.render(scene.mitsuba, seed=SEED))
    ours = render_integral(scene, display, "exact", Settings(samples=256, integrator="direct")).radiance
    assert theirs.shape == ours.shape
    # A stripe shows in a third of the samples, three times as bright: sqrt(2) its mean for a noise of 1 in 1024.
    noise = 3.0 * ours.max() / 32.0
    assert np.abs(theirs - ours).max() < 4.0 * noise
    np.testing.assert_allclose(theirs.mean(axis=(0, 1)), ours.mean(axis=(0, 1)), rtol=0.02)
    if subpixels != "none":
        assert np.abs(theirs - ours[:, :, ::-1]).max() > 0.1


def test_a_whole_lenslet_and_where_the_display_stands(mi, sensor_of):
    """Aperture points move the rays' origins by as much as they move; to_world is the display's pose."""
    display = focused_display("square", width_px=24, height_px=18, pixel_pitch=0.1)
    extra = (
        '<string name="model" value="thin"/><string name="aperture" value="full"/><transform name="to_world">'
        '<scale value="0.5"/><rotate y="1" angle="90"/><translate x="7"/></transform>'
    )
    sensor = sensor_of(display, extra).mitsuba.sensors()[0]
    assert sensor.needs_aperture_sample()
    ray, _ = rays_at(mi, sensor, np.array([12.0]), np.array([9.0]), display, (0.75, 0.5))
    # Pixel (12, 9) is the panel's centre, in the focal plane of a lenslet there: its rays leave along the axis, +z,
    # which the pose turns to +x; the aperture point is at x = 0.25, which it turns to -z and halves.
    np.testing.assert_allclose(np.array(ray.d).ravel(), [-1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(np.array(ray.o).ravel(), [7.0 + 0.5 * NEAR, 0.0, -0.125], atol=1e-5)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ('<string name="model" value="cheap"/>', "unknown model 'cheap'"),
        ('<string name="aperture" value="half"/>', "unknown aperture 'half'"),
        ('<float name="gap" value="3"/>', "gap"),
        ('<float name="near_mm" value="nan"/>', "near_mm is nan"),
        (POSE.format('<scale x="2" y="1" z="1"/>'), "differs between directions"),
        (POSE.format('<scale value="0"/>'), "the scale of to_world is 0"),
        (POSE.format('<matrix value="1 0.1 0 0  0 1 0 0  0 0 1 0  0 0 0 1"/>'), "differs between directions"),
        (POSE.format('<matrix value="nan 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"/>'), "to_world contains NaN or infinity"),
        (POSE.format('<matrix value="1 0 0 inf  0 1 0 0  0 0 1 0  0 0 0 1"/>'), "to_world contains NaN or infinity"),
        (POSE.format('<scale x="-1"/>'), "to_world mirrors"),
    ],
)
def test_bad_parameters_raise(mi, sensor_of, extra, message):
    path = sensor_of(focused_display("square")).path
    text = path.read_text()
    if "near_mm" in extra:
        text = text.replace(f'<float name="near_mm" value="{NEAR}"/>', "")
    path.write_text(text.replace("<sampler", f"{extra}<sampler", 1))
    with pytest.raises(Exception, match=message):
        mi.load_file(str(path))


def test_a_display_is_needed(mi, tmp_path):
    with pytest.raises(Exception, match="display is missing"):
        mi.load_dict({"type": "integral"})
    with pytest.raises(Exception, match="no such file"):
        mi.load_dict({"type": "integral", "display": str(tmp_path / "none.toml")})


PLAIN = """
import sys
import mitsuba as mi
for variant in (None, "llvm_ad_spectral", "llvm_ad_rgb"):
    if variant:
        mi.set_variant(variant)
    try:
        import lippmann.capturing.mitsuba_sensor
    except Exception as error:
        print(error)
print(mi.render(mi.load_file(sys.argv[1]), spp=2).shape)
"""


def test_plain_mitsuba_uses_it(mi, sensor_of, tmp_path):
    sensor_of(focused_display("square", width_px=8, height_px=6, pixel_pitch=0.1))
    command = [sys.executable, "-c", PLAIN, tmp_path / "scene.xml"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ)
    *refused, shape = done.stdout.splitlines()
    assert len(refused) == 2
    assert all("call mitsuba.set_variant" in line for line in refused)
    assert shape == "(6, 8, 3)"
