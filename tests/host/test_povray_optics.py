"""Camera, lenslets and imaging lens in POV-Ray: its pictures through them against ours, and what it cannot have."""

import dataclasses
import json

import numpy as np
import pytest
from lippmann.capturing.capture import capture_source
from lippmann.capturing.capture_setup import load_setup
from lippmann.capturing.povray_export import write_folder
from lippmann.capturing.povray_optics import setup_view
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_rays
from lippmann.scenes.placement import placement_beside
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from PIL import Image
from scene_cases import write_scene
from test_povray_scene import PICTURE, ball, card, diffuse, light
from tools import bench
from tools.peers import OUTLINE_PX, Pair, around, compare, near_seams
from tools.peers import page as peers_page
from tools.povray_runs import Run, render_folder
from tools.seed import findings, lenslets_in, with_window
from tools.shading_speed import every_strip

SMALL_PX = 120


@pytest.fixture(scope="module")
def spots(mi, tmp_path_factory):
    """A picture of random colours, coarse enough to be told apart through a lenslet."""
    folder = tmp_path_factory.mktemp("spots")
    rng = np.random.default_rng(5)
    mi.Bitmap(rng.integers(0, 256, (9, 9, 3)).astype(np.uint8)).write(str(folder / "spots.png"))
    return folder


def small(name, radii=None, **changes):
    """A shipped set-up with a small window, its array changed; `radii` is a thickness in radii of the dome."""
    setup = load_setup(repository() / f"scenes/setups/{name}.toml")
    if "pitch_mm" in changes:
        # Of the set-up's own pitch, with domes that span the skewed cells.
        pitch = setup.array.pitches_mm[0]
        changes |= {
            name: tuple(pitch * side for side in changes[name]) for name in ("pitch_mm", "extent_mm") if name in changes
        }
        changes["radius_mm"] = 1.2 * setup.array.radius_mm
        changes["thickness_mm"] = dataclasses.replace(setup.array, **changes).sag_mm
    if radii is not None:
        changes["thickness_mm"] = radii * setup.array.radius_mm
    setup = with_window(setup, SMALL_PX, setup.array.pitches_mm[0])
    array = dataclasses.replace(setup.array, **changes)
    display = dataclasses.replace(setup.display, array=dataclasses.replace(setup.display.array, **changes))
    return dataclasses.replace(setup, array=array, display=display)


#: Set-ups: square, hexagonal, hollow, without a lens; turned, off the axis, turned round; thick, up to four radii,
#: where the dome's sphere would end within the substrate.
CASES = [
    ("fig8a", {}),
    ("fig8d", {"rotation_deg": 7.0, "offset_mm": (0.31, -0.22)}),
    ("hex", {"rotation_deg": -20.0, "offset_mm": (0.4, 0.9)}),
    ("concave", {}),
    ("plain", {"plano_side": "viewer", "thickness_mm": 0.9}),
    ("plain", {"radii": 1.95}),
    ("plain", {"radii": 4.0}),
    ("plain", {"plano_side": "viewer", "radii": 1.95}),
    ("plain", {"plano_side": "viewer", "radii": 4.0}),
    ("hex", {"radii": 4.0}),
    # Skewed, and ending within the window.
    ("fig8d", {"rotation_deg": 7.0, "pitch_mm": (1.0, 1.1), "shear": 0.1, "extent_mm": (9.0, 8.0)}),
    ("hex", {"rotation_deg": -20.0, "pitch_mm": (1.0, 1.1), "shear": 0.1}),
]


#: Cases at every commit: of thick substrates one to the panel, and one to the viewer.
USUAL = (0, 3, 7, 10)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        pytest.param(*case, id=f"{case[0]}-{k}", marks=() if k in USUAL else pytest.mark.full)
        for k, case in enumerate(CASES)
    ],
)
def test_its_picture_through_the_optics_is_ours(mi, spots, tmp_path, name, changes):
    """Spheres before a coloured card: the colour of a pixel tells where its ray went, of 81 places and more."""
    setup = small(name, **changes)
    half = 90.0 if setup.lens is not None else 60.0
    picture = f'<bsdf type="twosided">{PICTURE.format("").replace("flag.png", str(spots / "spots.png"))}</bsdf>'
    parts = light((0.0, 300.0, 600.0), (4e5, 4e5, 4e5)), card(picture, -40.0, half), ball(-12.0, 20.0, 9.0)
    wall = card(diffuse((0.1, 0.2, 0.7)), -300.0, 3000.0)
    path = write_scene(tmp_path / "scene.xml", *parts, wall, placement="near_mm = 60\nfar_mm = -300")
    scene = load_scene(path, placement_beside(path).then(setup.subject.placement))
    theirs, _ = render_folder(write_folder(scene, setup_view(setup), tmp_path / "pov"))
    source = capture_source(setup)
    ours = render_rays(scene, source, Settings()).radiance
    assert (ours > 0.0).any(axis=-1).mean() > 0.5
    assert len(np.unique(np.round(ours, 2).reshape(-1, 3), axis=0)) > 50
    difference, _ = compare(theirs, ours, around(scene, source, OUTLINE_PX[:1]), setup)
    assert difference["median"] <= 0.5
    assert difference["differing"] < 0.05
    # What differs by more is an edge a pixel away, an outline that is passed, or at a seam.
    assert difference["unexplained"] < 0.001
    # Noise is measured in rows of the picture: with one sample those rows themselves.
    rows = render_rays(scene, every_strip(source, 8), Settings()).radiance
    np.testing.assert_allclose(rows, ours[4::8], atol=1e-4 * ours.max())


def test_a_mirror_does_not_show_the_stops(mi, tmp_path):
    """A mirror ball before the lens reflects walls beside and behind the camera, which the stops' discs would hide."""
    setup = small("fig8a")
    mirror = '<bsdf type="conductor"><string name="material" value="none"/></bsdf>'
    parts = [
        light((0.0, 0.0, 0.0), (4e5, 4e5, 4e5)),
        f'<shape type="sphere"><float name="radius" value="60"/><transform name="to_world"><translate z="-80"/>'
        f"</transform>{mirror}</shape>",
        card(diffuse(two_sided=True), 2500.0, 9000.0),
    ]
    path = write_scene(tmp_path / "scene.xml", *parts, placement="near_mm = 10\nfar_mm = -150")
    scene = load_scene(path, placement_beside(path).then(setup.subject.placement))
    theirs, _ = render_folder(write_folder(scene, setup_view(setup), tmp_path / "pov"))
    ours = render_rays(scene, capture_source(setup), Settings()).radiance
    assert (ours > 0.0).mean() > 0.05
    assert theirs.sum() == pytest.approx(ours.sum(), rel=0.02)


def test_an_ideal_lens_and_a_sensor_are_refused():
    with pytest.raises(InputError, match="ideal thin lens"):
        setup_view(load_setup(repository() / "scenes/setups/thin.toml"))
    with pytest.raises(InputError, match="cannot render a sensor"):
        setup_view(load_setup(repository() / "scenes/setups/pickup.toml"))
    setup = load_setup(repository() / "scenes/setups/fig8a.toml")
    with pytest.raises(InputError, match=r"viewing_distance_mm.*give a display without this key"):
        setup_view(dataclasses.replace(setup, display=dataclasses.replace(setup.display, viewing_distance_mm=600.0)))


def test_the_command_with_a_set_up(mi, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(repository())
    scene = write_scene(tmp_path / "s.xml", light(), card(diffuse()), placement="near_mm = 20\nfar_mm = -30")
    common = ["export", "povray", str(scene), "-o", str(tmp_path / "pov"), "--json"]
    assert run([*common, "--setup", "scenes/setups/fig8a.toml"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert "optics.inc" in result["files"]
    assert (result["width_px"], result["spare_rows"]) == (2400, 0)
    assert run(common) == 2
    assert "either --display or --setup" in capfd.readouterr().err
    assert run([*common, "--setup", "scenes/setups/fig8a.toml", "--display", "scenes/displays/paper-square.toml"]) == 2
    assert run([*common, "--setup", "scenes/setups/fig8a.toml", "--model", "thin"]) == 2
    assert "--model is for --display" in json.loads(capfd.readouterr().out.splitlines()[-1])["error"]
    # A scene that reaches into the lens is refused, as by capture.
    write_scene(scene, light(), card(diffuse(), 999.0))
    scene.with_suffix(".toml").unlink()
    common[4] = str(tmp_path / "no")
    assert run([*common[:-1], "--setup", "scenes/setups/fig8a.toml"]) == 2
    assert "the scene extends 1787 mm in front of" in capfd.readouterr().err
    assert not (tmp_path / "no").exists()


def test_lenslets_in_the_window():
    """The paper's own number (equation 5): 102^2 = 10404; and a window of 720 px at 9 mm: 30.48 / 9 = 3.4, 4^2."""
    display = load_display(repository() / "scenes/displays/paper-square.toml")
    assert lenslets_in(display) == 10404
    setup = with_window(load_setup(repository() / "scenes/setups/fig8a.toml"), 720, 9.0)
    assert lenslets_in(setup.display) == 16
    # Lenslets of one shape: f-number and thickness scale along.
    assert setup.array.focal_length_mm / setup.array.pitch_mm == pytest.approx(3.3)
    assert setup.array.thickness_mm == pytest.approx(setup.array.sag_mm)


def test_what_the_sweep_says():
    names = ("tracer", "grid", "window_px", "pitch_mm", "antialias", "cpu_seconds")
    rows = [
        ("lippmann", "none", 720, None, True, 1.0),
        ("lippmann", "square", 720, 1.0, False, 2.2),
        ("lippmann", "square", 720, 9.0, False, 2.0),
        ("lippmann", "hex", 720, 1.0, False, 2.42),
        ("lippmann", "square", 720, 1.0, True, 4.4),
        ("POV-Ray", "square", 720, 1.0, False, 30.0),
        ("POV-Ray", "square", 720, 9.0, False, 10.0),
    ]
    found = findings([dict(zip(names, row, strict=True)) for row in rows])
    assert found["growth"] == {720: pytest.approx(1.1)}
    assert found["povray_growth"] == {720: pytest.approx(3.0)}
    assert found["hex_share"] == pytest.approx(0.1)
    assert found["plain_share"] == pytest.approx(-0.5)
    assert found["povray_hex_share"] is None


def test_differences_are_told_apart():
    """An edge shifted by one pixel is displaced; one by two is not; a seam is where a lenslet ends."""
    setup = small("fig8a")
    panel = setup.display.panel
    step = np.zeros((panel.height_px, panel.width_px, 3), np.float32)
    step[:, 61:] = 1.0
    shifted = np.roll(step, 1, axis=1)
    shifted[:, 0] = 0.0
    seams = near_seams(setup)
    pitch = setup.array.pitch_mm / panel.pixel_pitch_mm
    # A band of two pixels for each lenslet and axis.
    assert seams.mean() == pytest.approx(1.0 - (1.0 - 2.0 / pitch) ** 2, abs=0.03)
    one, where = compare(shifted, step, step[None, None], setup)
    assert one["differing"] == pytest.approx(1.0 / panel.width_px)
    assert where[:, 61].min() == pytest.approx(255.0)
    assert (one["displaced"], one["unexplained"]) == (1.0, 0.0)
    two, _ = compare(np.roll(shifted, 1, axis=1), step, step[None, None], setup)
    assert two["displaced"] < 1.0
    others = two["unexplained"] + two["seams"] * two["differing"]
    assert others == pytest.approx((1.0 - two["displaced"]) * two["differing"], abs=0.02)


def test_the_page_beside_povray(tmp_path):
    ours = np.full((8, 12, 3), 0.25, np.float32)
    names = "grid pixels median mean largest differing displaced outlines near_outlines seams unexplained"
    figures = 96, 0.1, 0.2, 40.0, 0.02, 0.5, 0.75, 0.8, 0.1, 0.001
    rows = [dict(zip(names.split(), (grid, *figures), strict=True)) for grid in ("square", "hex")]
    pairs = [Pair(row, ours, ours, np.full((8, 12), 16.0, np.float32)) for row in rows]
    run = dataclasses.asdict(Run("povray full.ini +A0.3", 100.0, 90.0))
    times = {"povray": run, "seconds": 3.0, "cpu_seconds": 5.0, "samples": 7, "povray_noise": 5.0, "noise": 4.5,
             "whole": {"POV-Ray": 90.0, "each": 9.0, "auto": 6.0}, "ratio": 18.0}  # fmt: skip
    files = {path.name for path in peers_page({"machine": "one"}, pairs, times).write(tmp_path)}
    assert files == {"peers.md", "peers.csv", "peers-square.png", "peers-hex.png"}
    text = (tmp_path / "peers.md").read_text()
    assert f"POV-Ray takes **{90.0 / 5.0:.0f} times** Lippmann's CPU seconds" in text
    words = "POV-Ray takes **10 times** as long as `capture` with every ray shaded, and **15 times** as long"
    assert words in " ".join(text.split())
    assert "| hex | 96 | 0.1 | 0.2 | 40 | 0.02 | 0.5 | 0.75 | 0.8 | 0.1 | 0.001 |" in text
    with Image.open(tmp_path / "peers-hex.png") as picture:
        pixels = np.asarray(picture)
    assert pixels.shape == (8, 3 * 8 + 2 * 6, 3)
    assert (pixels[:, -8:] == 128).all(), "half of what is shown white"
    assert (pixels[:, 8:14] == 255).all()


def test_bench_seed_quick(mi, capfd, monkeypatch, tmp_path):
    monkeypatch.chdir(repository())
    monkeypatch.setattr("tools.seed.ROUNDS", 1)
    assert bench.main(["seed", "--quick", "--report", str(tmp_path), "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    scenes = ("none", True), ("square", False), ("square", True)
    wanted = {(tracer, *scene) for tracer in ("lippmann", "POV-Ray") for scene in scenes}
    assert {(row["tracer"], row["grid"], row["antialias"]) for row in result["rows"]} == wanted
    assert all(row["cpu_seconds"] > 0.0 for row in result["rows"])
    base = {row["tracer"]: row["cpu_seconds"] for row in result["rows"] if row["grid"] == "none"}
    for row in result["rows"]:
        assert row["relative"] == pytest.approx(row["cpu_seconds"] / base[row["tracer"]])
    assert set(result["findings"]["growth"]) == {"48"}
    assert {path.name for path in tmp_path.iterdir()} == {"seed.md", "seed.csv", "seed.png"}
    page = (tmp_path / "seed.md").read_text()
    assert "![t_R" in page
    assert "too small for a measurement" in page
    # A scene without lenslets has no pitch: an empty field.
    assert "nan" not in (tmp_path / "seed.csv").read_text().lower()
    assert "\nlippmann,none,96,,0,True," in (tmp_path / "seed.csv").read_text()
    assert {row["pitch_mm"] for row in result["rows"] if row["grid"] == "none"} == {None}
