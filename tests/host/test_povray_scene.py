"""Scenes as POV-Ray renders them: light computed by hand, pictures against ours, refusals. POV-Ray itself runs."""

import json
import math
import re
import shutil
import subprocess

import numpy as np
import pytest
from lippmann.base.tones import encode
from lippmann.capturing.povray_export import MAX_RAYS, export_display
from lippmann.cli import run
from lippmann.errors import InputError, MissingLibraryError
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral, render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.scene import load_scene
from scene_cases import centres, display_toml, focused_display, generator, rgb, write_scene
from tools.povray_runs import export_view, render_folder, run_povray

EYE = (0.0, 0.0, 400.0)
WINDOW = Window(80.0, 60.0, 40, 30)
LIGHT = (30.0, 50.0, 300.0)
INTENSITY = (40000.0, 50000.0, 60000.0)
NEARBY = "near_mm = 20\nfar_mm = -30"
#: OpenEXR's half floats: 11 bits.
HALF = 2.0**-11


def light(position=LIGHT, intensity=INTENSITY):
    x, y, z = position
    return (
        f'<emitter type="point"><point name="position" x="{x}" y="{y}" z="{z}"/>{rgb("intensity", intensity)}</emitter>'
    )


#: A diffuse material with a picture on it.
PICTURE = (
    '<bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="flag.png"/>{}'
    "</texture></bsdf>"
)


def diffuse(colour=(0.6, 0.4, 0.2), two_sided=False):
    inner = f'<bsdf type="diffuse">{rgb("reflectance", colour)}</bsdf>'
    return f'<bsdf type="twosided">{inner}</bsdf>' if two_sided else inner


def ball(x, z, radius):
    return (
        f'<shape type="sphere"><point name="center" x="{x}" y="0" z="{z}"/><float name="radius" value="{radius}"/>'
        f"{diffuse()}</shape>"
    )


def card(material, z=0.0, half=200.0, turn=""):
    return (
        f'<shape type="rectangle">{material}<transform name="to_world"><scale value="{half}"/>{turn}'
        f'<translate z="{z}"/></transform></shape>'
    )


def lit(points, normal, colour, intensity=INTENSITY, position=LIGHT):
    """Radiance of diffuse points: a / pi I cos / d^2."""
    way = np.array(position) - points
    distance = np.linalg.norm(way, axis=-1, keepdims=True)
    cosine = np.maximum((way / distance) @ np.array(normal), 0.0)[..., None]
    return np.array(colour) / math.pi * np.array(intensity) * cosine / distance**2


def through_window(z):
    """Where the sight lines of WINDOW's pixels from EYE cross the plane of a depth, (h, w, 3)."""
    x, y = centres(WINDOW)
    reach = (EYE[2] - z) / EYE[2]
    return np.stack([x * reach, y * reach, np.full_like(x, z)], axis=-1)


@pytest.fixture
def seen(mi, tmp_path):

    def look(*parts, placement="near_mm = 390.0\nfar_mm = -300.0", settings=None):
        scene = load_scene(write_scene(tmp_path / "scene.xml", *parts, placement=placement))
        theirs, _ = render_folder(export_view(scene, EYE, WINDOW, tmp_path / "pov"))
        ours = render_view(scene, EYE, WINDOW, settings or Settings()).radiance
        return theirs, ours

    return look


def test_lights_add_up_and_shadows_fall(seen):
    second, glow = (-60.0, 20.0, 200.0), (20000.0, 5000.0, 9000.0)
    theirs, ours = seen(light(), light(second, glow), card(diffuse(two_sided=True)), ball(-20, 100, 8))
    points = through_window(0.0)
    expected = np.zeros_like(points)
    clear = np.ones(points.shape[:2], bool)
    for position, intensity in ((LIGHT, INTENSITY), (second, glow)):
        way = np.array(position) - points
        length = np.linalg.norm(way, axis=-1)
        to_ball = np.array((-20.0, 0.0, 100.0)) - points
        along = (to_ball * way).sum(axis=-1) / length
        off = np.sqrt((to_ball**2).sum(axis=-1) - along**2)
        clear &= np.abs(off - 8.0) > 0.05
        expected += np.where((off < 8.0)[..., None], 0.0, lit(points, (0, 0, 1), (0.6, 0.4, 0.2), intensity, position))
    eye = np.array(EYE)
    sight = (points - eye) / np.linalg.norm(points - eye, axis=-1, keepdims=True)
    to_ball = np.array((-20.0, 0.0, 100.0)) - eye
    off = np.sqrt((to_ball**2).sum() - (sight @ to_ball) ** 2)
    plane = clear & (off > 8.05)
    assert 0.9 < plane.mean() < 1.0
    np.testing.assert_allclose(theirs[plane], expected[plane], rtol=2 * HALF, atol=1e-6)
    np.testing.assert_allclose(theirs, ours, rtol=2e-3, atol=np.abs(ours).max() * (0.0 if plane.all() else 0.02))


@pytest.mark.parametrize("two_sided", [True, False])
def test_the_back_of_a_surface(seen, two_sided):
    """A card that looks away from the eye, lit from the eye's side: black unless two-sided, as in Mitsuba."""
    theirs, ours = seen(light(), card(diffuse(two_sided=two_sided), turn='<rotate y="1" angle="180"/>'))
    expected = lit(through_window(0.0), (0, 0, 1), (0.6, 0.4, 0.2)) * two_sided
    np.testing.assert_allclose(theirs, expected, rtol=2 * HALF, atol=1e-9)
    np.testing.assert_allclose(ours, expected, rtol=1e-4, atol=1e-9)


def test_a_mirror_shows_what_stands_before_it(seen):
    """The eye sees in a mirror at z = 0 a wall behind itself, at z = 500: a light between them lights it."""
    tint = (0.9, 0.7, 0.5)
    mirror = f'<bsdf type="conductor"><string name="material" value="none"/>{rgb("specular_reflectance", tint)}</bsdf>'
    wall = card(diffuse(), 500.0, 900.0, '<rotate y="1" angle="180"/>')
    theirs, ours = seen(light(), card(mirror), wall)
    # The mirror image of the wall stands at z = -500.
    points = through_window(-500.0) * [1.0, 1.0, -1.0]
    expected = lit(points, (0, 0, -1), (0.6, 0.4, 0.2)) * tint
    np.testing.assert_allclose(theirs, expected, rtol=2 * HALF)
    np.testing.assert_allclose(ours, expected, rtol=1e-4)


def test_as_many_surfaces_are_met_as_ours_meets(seen):
    """Two mirrors face each other: both stop at the fourth surface."""
    mirror = '<bsdf type="twosided"><bsdf type="conductor"><string name="material" value="none"/></bsdf></bsdf>'
    turn = '<rotate y="1" angle="30"/>'
    theirs, ours = seen(
        light(), card(mirror, -50.0, 60.0, turn), card(mirror, 60.0, 40.0, turn), card(diffuse(), 500.0, 2000.0),
        card(diffuse((0.2, 0.9, 0.3), two_sided=True), -200.0, 900.0),
    )  # fmt: skip
    assert (np.abs(theirs - ours).max(axis=-1) < 1e-3).mean() > 0.98


def test_a_plate_of_glass(mi, seen, tmp_path):
    """n = 1.5 at nearly normal incidence: each face passes 1 - 0.04; and glass throws a shadow in both."""
    glass = '<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>'
    mi.load_dict({"type": "cube"}).write_ply(str(tmp_path / "cube.ply"))
    plate = (
        f'<shape type="ply">{glass}<string name="filename" value="cube.ply"/>'
        '<boolean name="face_normals" value="true"/>'
        '<transform name="to_world"><scale value="5"/><translate z="200"/></transform></shape>'
    )
    position = (20.0, 10.0, 390.0)
    theirs, ours = seen(light(position), card(diffuse()), plate, settings=Settings(samples=4096))
    lit_plane = lit(through_window(0.0), (0, 0, 1), (0.6, 0.4, 0.2), position=position)
    middle = (15, 20)
    # Straight through, and once to and fro inside; the fourth surface is the last: (1 - F)^2 of the plane's light.
    assert theirs[middle] == pytest.approx(lit_plane[middle] * 0.96**2, rel=2e-3)
    assert ours[middle] == pytest.approx(lit_plane[middle] * 0.96**2, rel=0.02)
    # Through the plate's shadow too, the pictures agree (ours draws the Fresnel reflection at random).
    dark, dark_ours = (theirs < 1e-3).all(axis=-1), (ours < 1e-3).all(axis=-1)
    assert dark.sum() > 50
    # Where light comes round through the block's sides, by more surfaces, they differ.
    assert (dark != dark_ours).mean() < 0.02


def test_plastic(seen):
    """Diffuse light that comes and goes nearly along the normal: a (1 - F)^2 / (n^2 (1 - Fdr))."""
    n, a = 1.49, (0.6, 0.4, 0.2)
    plastic = (
        f'<bsdf type="plastic"><float name="int_ior" value="{n}"/><float name="ext_ior" value="1"/>'
        f"{rgb('diffuse_reflectance', a)}</bsdf>"
    )
    theirs, ours = seen(light(), card(plastic))
    # Fdr inside by quadrature, 2 times the integral of F(mu) mu; Mitsuba's polynomial is good to 1e-3.
    mu = (np.arange(200000) + 0.5) / 200000
    square = 1.0 - n**2 * (1.0 - mu**2)
    c = np.sqrt(np.maximum(square, 0.0))
    s, p = (n * mu - c) / (n * mu + c), (mu - n * c) / (mu + n * c)
    inner = (2.0 * np.where(square > 0.0, 0.5 * (s**2 + p**2), 1.0) * mu).mean()
    normal = ((n - 1.0) / (n + 1.0)) ** 2
    factor = (1.0 - normal) ** 2 / (n**2 * (1.0 - inner))
    np.testing.assert_allclose(theirs, lit(through_window(0.0), (0, 0, 1), a) * factor, rtol=3e-3)
    np.testing.assert_allclose(theirs, ours, rtol=3e-3)


@pytest.fixture
def flag(mi, tmp_path):
    """A picture of six colours, wider than high, and a material that carries it."""
    values = np.array([[(250, 20, 20), (20, 250, 20), (20, 20, 250)], [(200, 200, 20), (20, 200, 200), (90, 90, 90)]])
    picture = np.kron(values, np.ones((8, 8, 1))).astype(np.uint8)
    mi.Bitmap(picture).write(str(tmp_path / "flag.png"))

    return lambda extra="": f'<bsdf type="twosided">{PICTURE.format(extra)}</bsdf>'


@pytest.mark.parametrize(
    "extra", ["", '<string name="filter_type" value="nearest"/>', '<boolean name="raw" value="true"/>']
)
def test_a_picture_on_a_card(seen, flag, extra):
    """Mitsuba puts the first row at v = 0, a rectangle's lower edge."""
    theirs, ours = seen(light(), card(flag(extra), half=30.0))
    share = theirs / lit(through_window(0.0), (0, 0, 1), (1.0, 1.0, 1.0))
    value = np.array([250, 20, 20]) / 255.0  # lower left
    assert share[20, 10] == pytest.approx(value if "raw" in extra else ((value + 0.055) / 1.055) ** 2.4, abs=2e-3)
    difference = np.abs(theirs - ours).max(axis=-1) / ours.max()
    assert np.median(difference) < 1e-3
    assert (difference > 0.01).mean() < (0.05 if "nearest" in extra else 0.005)


@pytest.fixture
def tent(mi, tmp_path):
    """Four faces round a tip that looks to +z, with vertex normals and uv or without."""
    for normals in (False, True):
        mesh = mi.Mesh("tent", 5, 4, has_vertex_normals=normals, has_vertex_texcoords=normals)
        p = mi.traverse(mesh)
        corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 0.4)], float)
        p["vertex_positions"] = corners.ravel()
        p["faces"] = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]).ravel()
        if normals:
            p["vertex_texcoords"] = ((corners[:, :2] + 1.0) * (1.0, 0.5)).ravel()
            leaning = corners * (0.5, 0.5, 0) + (0, 0, 1)
            p["vertex_normals"] = (leaning / np.linalg.norm(leaning, axis=1, keepdims=True)).ravel()
        p.update()
        mesh.write_ply(str(tmp_path / f"tent-{normals}.ply"))


@pytest.mark.usefixtures("tent")
def test_a_picture_round_a_sphere_and_meshes(seen, flag):
    """A sphere turned all ways, a mesh with smooth normals and uv, and one that a placement scales and turns."""
    parts = [
        '<shape type="sphere"><point name="center" x="-1" y="0.4" z="0"/><float name="radius" value="0.8"/>'
        '<transform name="to_world"><rotate x="0.6" y="0" z="-0.8" angle="70"/></transform>' + flag() + "</shape>",
        '<shape type="ply"><string name="filename" value="tent-True.ply"/><transform name="to_world">'
        '<translate x="1" y="0.2" z="-0.5"/></transform>' + flag() + "</shape>",
        '<shape type="ply"><string name="filename" value="tent-True.ply"/><boolean name="face_normals"'
        ' value="true"/><transform name="to_world"><translate y="-1.4" z="0.2"/></transform>' + flag() + "</shape>",
    ]
    placement = (
        "scale = 12.0\nrotation_deg = [10.0, 20.0, -30.0]\noffset_mm = [3.0, 4.0, 20.0]\nnear_mm = 200\nfar_mm = -99"
    )
    theirs, ours = seen(light((1.0, 2.0, 9.0), (50.0, 60.0, 40.0)), *parts, placement=placement)
    assert (ours > 0.01).any(axis=-1).mean() > 0.2
    difference = np.abs(encode(theirs, "srgb") - encode(ours, "srgb")).max(axis=-1) * 255.0
    assert np.median(difference) < 0.2
    assert (difference > 2.0).mean() < 0.03


@pytest.mark.parametrize(
    ("shape", "flip", "mirror"),
    [
        ("rectangle", False, '<scale z="-1"/>'),
        ("rectangle", True, ""),
        ("smooth", False, ""),
        ("smooth", True, '<scale x="-1"/>'),
        ("faces", False, '<scale x="-1"/>'),
        ("faces", True, '<scale z="-1"/>'),
        # Inside out twice, by the transform or a negative radius: outwards again, its picture mirrored.
        ("sphere", True, '<scale x="-1"/>'),
        ("sphere", True, ""),
    ],
)
@pytest.mark.usefixtures("flag", "tent")
def test_which_side_of_a_surface_is_its_front(seen, shape, flip, mirror):
    """One-sided surfaces, lit from the eye's side: bright or black as Mitsuba's own normals say."""
    kind = "ply" if shape in ("smooth", "faces") else shape
    file = f'<string name="filename" value="tent-{shape == "smooth"}.ply"/>' if kind == "ply" else ""
    file += '<float name="radius" value="-1"/>' if (shape, mirror) == ("sphere", "") else ""
    theirs, ours = seen(
        light(),
        card(diffuse((0.1, 0.2, 0.9)), -60.0),
        f'<shape type="{kind}">{file}{PICTURE.format("") if kind == "sphere" else diffuse()}'
        f'<boolean name="flip_normals" value="{str(flip).lower()}"/>'
        f'<transform name="to_world">{mirror}<scale value="20"/><translate z="30"/></transform></shape>',
    )
    assert ((ours == 0.0).all(axis=-1).mean() > 0.1) or (ours[..., 0] > ours[..., 2]).mean() > 0.1
    difference = np.abs(theirs - ours).max(axis=-1) / ours.max()
    assert np.median(difference) < 2e-3
    assert (difference > 0.02).mean() < 0.02


def test_materials_keep_apart_whatever_their_names(seen, mi, tmp_path):
    """Names that POV-Ray's letters cannot tell apart, and names like those that the export makes itself."""
    names = ["a-b", "a_b", "Mat.001", "Mat-001", "ä", "ö", "material_1", "", "w", "w_back", "w_sphere", "card", "0_w"]
    mi.load_dict({"type": "rectangle"}).write_ply(str(tmp_path / "card.ply"))
    rng = generator(30)
    colours = rng.uniform(0.1, 0.9, (len(names), 3))
    parts = []
    for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
        given = f' id="{name}"' if name else ""
        inner = f'<bsdf type="diffuse">{rgb("reflectance", colour)}</bsdf>'
        one_sided = f'<bsdf type="diffuse"{given}>{rgb("reflectance", colour)}</bsdf>'
        material = one_sided if k % 2 else f'<bsdf type="twosided"{given}>{inner}</bsdf>'
        parts.append(
            f'<shape type="ply"><string name="filename" value="card.ply"/>{material}<transform name="to_world">'
            f'<scale value="2.8"/><translate x="{6 * (k - 6)}"/></transform></shape>'
        )
    theirs, ours = seen(light(), *parts)
    points = through_window(0.0)
    place = np.rint(points[..., 0] / 6.0).astype(int)
    on = (np.abs(points[..., 0] - 6.0 * place) < 2.7) & (np.abs(points[..., 1]) < 2.7) & (np.abs(place) <= 6)
    expected = lit(points, (0, 0, 1), (1.0, 1.0, 1.0))[on] * colours[place[on] + 6]
    assert set(place[on]) == set(range(-6, 7))
    np.testing.assert_allclose(theirs[on], expected, rtol=3 * HALF)
    np.testing.assert_allclose(ours[on], expected, rtol=1e-4)


@pytest.mark.parametrize("grey", ['<float name="{}" value="0.5"/>', '<spectrum name="{}" value="0.5"/>'])
def test_a_grey_may_be_a_number_or_a_uniform_spectrum(mi, tmp_path, grey):
    texts = []
    for colour in (grey.format("reflectance"), rgb("reflectance", (0.5, 0.5, 0.5))):
        material = f'<bsdf type="diffuse">{colour}</bsdf>'
        path = write_scene(tmp_path / "s.xml", light(), card(material), placement=NEARBY)
        exported = export_view(load_scene(path), EYE, WINDOW, tmp_path / "pov")
        texts.append((exported.ini.parent / "scene.inc").read_text())
    assert texts[0] == texts[1]
    assert "rgb <0.5, 0.5, 0.5>" in texts[0]


def test_names_that_a_file_may_have(mi, tmp_path, capfd):
    """A scene, a mesh and a picture with spaces, quotes and letters of other tongues; the folder too."""
    folder = tmp_path / "a scène's"
    folder.mkdir()
    rng = generator(31)
    stems = ['pic "1"', "pic '1'", "Bild ü"]
    for stem in stems:
        mi.Bitmap(rng.integers(0, 256, (4, 4, 3)).astype(np.uint8)).write(str(folder / f"{stem}.png"))
    mi.load_dict({"type": "rectangle"}).write_ply(str(folder / "Körper 1.ply"))
    shapes = [
        '<shape type="ply"><string name="filename" value="Körper 1.ply"/><bsdf type="diffuse">'
        '<texture type="bitmap" name="reflectance"><string name="filename" value="'
        + stem.replace('"', "&quot;")
        + f'"/></texture></bsdf><transform name="to_world"><translate x="{2 * k}"/></transform></shape>'
        for k, stem in enumerate(f"{stem}.png" for stem in stems)
    ]
    scene = write_scene(folder / "my scène.xml", light(), *shapes, placement=NEARBY)
    display = tmp_path / "d.toml"
    display.write_text(display_toml(focused_display("square", width_px=16, height_px=12, pixel_pitch=0.1)))
    out = folder / "p o'v"
    assert run(["export", "povray", str(scene), "--display", str(display), "-o", str(out)]) == 0
    line = re.search("render: (.+)", capfd.readouterr().out)[1]
    subprocess.run(["sh", "-c", line], check=True, capture_output=True)
    assert list(out.glob("*.exr"))


def test_files_that_are_there_already(mi, tmp_path, capfd):
    """What stands in the folder is not counted as ours; a folder in a file's place stops all."""
    scene = write_scene(tmp_path / "s.xml", light(), card(diffuse()), placement=NEARBY)
    display = tmp_path / "d.toml"
    display.write_text(display_toml(focused_display("hex", width_px=16, height_px=12, pixel_pitch=0.1)))
    folder = tmp_path / "new" / "pov"
    (folder / "scene.inc").mkdir(parents=True)
    (folder / "notes.txt").write_text("mine")
    command = ["export", "povray", str(scene), "--display", str(display), "--json", "-o"]
    assert run([*command, str(folder)]) == 2
    assert "scene.inc: is a folder" in json.loads(capfd.readouterr().out)["error"]
    assert sorted(file.name for file in folder.iterdir()) == ["notes.txt", "scene.inc"]
    shutil.rmtree(folder.parent)
    assert run([*command, str(folder)]) == 0
    (folder / "notes.txt").write_text("mine")
    assert run([*command, str(folder)]) == 0
    result = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert result["ini"] == str(folder / "s.ini")
    assert sorted([*result["files"], "notes.txt"]) == sorted(file.name for file in folder.iterdir())
    done = run_povray(folder / "s.ini")
    assert (done.command, done.seconds > 0.0, (folder / "s.exr").is_file()) == ("povray s.ini", True, True)
    # Places where the system makes no folder, even for who may do everything.
    for place in ("/proc/lippmann-export", str(scene)):
        assert run([*command, place]) == 2
        assert re.search(rf"{place}: cannot be made \(.+\); choose another folder", capfd.readouterr().err)


def test_glass_that_is_not_closed_is_refused(mi, tmp_path):
    """A cube, its corners split by normals and uv, is closed; without one face, or inside out, it is refused."""
    glass = '<bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf>'
    whole = mi.load_dict({"type": "cube"})
    whole.write_ply(str(tmp_path / "whole.ply"))
    p = mi.traverse(whole)
    faces = np.array(p["faces"]).reshape(-1, 3)[1:]
    holed = mi.Mesh("holed", whole.vertex_count(), len(faces))
    q = mi.traverse(holed)
    q["vertex_positions"], q["faces"] = p["vertex_positions"], faces.ravel()
    q.update()
    holed.write_ply(str(tmp_path / "holed.ply"))

    def export(file, extra=""):
        shape = f'<shape type="ply"><string name="filename" value="{file}.ply"/>{extra}{glass}</shape>'
        path = write_scene(tmp_path / "s.xml", light(), shape, placement=NEARBY)
        export_view(load_scene(path), EYE, WINDOW, tmp_path / "pov")

    export("whole")
    export("whole", '<transform name="to_world"><rotate x="1" y="2" angle="33"/><scale value="7"/></transform>')
    with pytest.raises(InputError, match="is not closed"):
        export("holed")
    with pytest.raises(InputError, match="point inwards"):
        export("whole", '<boolean name="flip_normals" value="true"/>')


@pytest.mark.parametrize(("grid", "eye"), [("square", {}), ("hex", {"eye": 60.0, "axis": (4.0, 1.0)})])
def test_a_display_s_lines_of_sight(mi, tmp_path, flag, grid, eye):
    """Real and virtual objects, one ray a pixel: the picture that `lippmann render` makes."""
    display = focused_display(grid, width_px=64, height_px=48, pixel_pitch=0.1, rotation=7.0, **eye)
    parts = light(), card(flag(), -30.0, 20.0), ball(-1, 12, 1.2)
    scene = load_scene(write_scene(tmp_path / "s.xml", *parts, placement=NEARBY))
    theirs, _ = render_folder(export_display(scene, display, "exact", tmp_path / "pov"))
    ours = render_integral(scene, display, "exact", Settings()).radiance
    assert theirs.shape == ours.shape
    difference = np.abs(encode(theirs, "srgb") - encode(ours, "srgb")).max(axis=-1) * 255.0
    assert np.median(difference) < 0.1
    assert (difference > 2.0).mean() < 0.01
    assert len(np.unique(np.round(ours, 2).reshape(-1, 3), axis=0)) > 6
    large = focused_display(grid, width_px=2048, height_px=1024, pixel_pitch=0.1)
    for wrong, says in ((large, str(MAX_RAYS)), (focused_display(grid, subpixels="rgb"), "colour sub-pixels")):
        with pytest.raises(InputError, match=says):
            export_display(scene, wrong, "exact", tmp_path / "no")


#: What is refused of a sphere, or of the scene.
REFUSED = {
    "emitter 'constant'": '<emitter type="constant"/>',
    "emitter 'area'": diffuse() + '<emitter type="area"/>',
    "shape 'cylinder'": f'<shape type="cylinder">{diffuse()}</shape>',
    "bsdf 'roughplastic' (gloss)": '<bsdf type="roughplastic" id="gloss"/>',
    "bsdf 'conductor' has a complex index": '<bsdf type="conductor"/>',
    "bsdf 'plastic' is nonlinear": '<bsdf type="plastic"><boolean name="nonlinear" value="true"/></bsdf>',
    "texture 'checkerboard'": '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>',
    "wrap_mode": PICTURE.format('<string name="wrap_mode" value="clamp"/>'),
    "to_uv": PICTURE.format('<transform name="to_uv"><scale value="2"/></transform>'),
    "specular_transmittance": '<bsdf type="dielectric"><rgb name="specular_transmittance" value="1 0.5 1"/></bsdf>',
    "is not closed": card('<bsdf type="dielectric"/>'),
    "shape 'sphere' has no material": "",
    "is not a sphere": diffuse() + '<transform name="to_world"><scale x="2"/></transform>',
    "normals that point inwards": diffuse() + '<boolean name="flip_normals" value="true"/>',
    "point inwards": diffuse() + '<transform name="to_world"><scale x="-1"/></transform>',
    "inwards": diffuse() + '<float name="radius" value="-1"/>',
    "has a intensity that": '<emitter type="point"><spectrum name="intensity" value="400:1, 700:2"/></emitter>',
}


@pytest.mark.parametrize("named", REFUSED)
@pytest.mark.usefixtures("flag")
def test_what_povray_cannot_express_is_refused_by_name(mi, tmp_path, named):
    part = REFUSED[named]
    if not part.startswith(("<shape", "<emitter")):
        part = f'<shape type="sphere">{part}</shape>'
    scene = load_scene(write_scene(tmp_path / "s.xml", card(diffuse()), part, placement=NEARBY))
    with pytest.raises(InputError) as caught:
        export_view(scene, EYE, WINDOW, tmp_path / "pov")
    message = str(caught.value)
    assert re.search(rf"s\.xml \(line 1.*{re.escape(named)}.*; ", message)
    assert not (tmp_path / "pov").exists()


def test_without_povray_it_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingLibraryError, match="apt-get install -y povray") as caught:
        run_povray(tmp_path / "s.ini")
    assert caught.value.exit_code == 3


def test_files_that_povray_refuses(tmp_path):
    (tmp_path / "s.ini").write_text("Input_File_Name=s.pov\nDisplay=off\n")
    (tmp_path / "s.pov").write_text("#version 3.7;\nsphere { 0, one }\n")
    with pytest.raises(InputError, match="line 2: Parse Error"):
        run_povray(tmp_path / "s.ini")
