"""Scenes in other tools' files, made by their own libraries or byte by byte here: in the right place and colour."""

import json
import struct

import numpy as np
import plyfile
import pytest
import trimesh
from lippmann import api
from lippmann.base.images import read_picture, write_picture
from lippmann.base.tones import decode, psnr_db
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.rendering.options import Settings
from lippmann.rendering.picture_hash import digest_of
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes import meshes
from lippmann.scenes.meshes import check_faces
from lippmann.scenes.placement import Placement, arranged
from lippmann.scenes.scene import load_scene
from PIL import Image
from plyfile import PlyData, PlyElement
from scene_cases import glowing_card, glowing_sphere, write_scene
from test_export_views import told
from test_film import DISPLAY
from test_raw_images import chunk, png

#: A picture of four fields in sRGB: top left, top right, bottom left, bottom right.
FIELDS = np.array([[[200, 40, 40], [40, 200, 40]], [[40, 40, 200], [200, 200, 40]]], np.uint8)
CORNERS = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], np.float32)
FACES = [[0, 1, 2], [0, 2, 3]]
#: The corners' places in the picture, from its bottom left.
UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
LIGHT = decode(FIELDS / 255.0, "srgb")


def picture():
    return Image.fromarray(FIELDS.repeat(32, axis=0).repeat(32, axis=1))


def png_of(image, path):
    image.save(path)
    return path.read_bytes()


def glb(path, material, images=(), extra=(), change=lambda told: None):
    """Write the square as GLB, byte by byte, by glTF's specification; v of its texture coordinates goes down."""
    binary = CORNERS.tobytes() + (UV * [1, -1] + [0, 1]).astype("<f4").tobytes() + np.array(FACES, "<u2").tobytes()
    views = [(0, 48), (48, 32), (80, 12)]
    for data in images:
        views.append((len(binary), len(data)))
        binary += data + b"\0" * (-len(data) % 4)
    told = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "square"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [material],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
            *extra,
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in views],
        "buffers": [{"byteLength": len(binary)}],
        "textures": [{"source": k} for k in range(len(images))],
        "images": [{"bufferView": 3 + k, "mimeType": "image/png"} for k in range(len(images))],
    }
    change(told)
    text = json.dumps(told).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def obj(folder, material, colour=""):
    """Write the square as a.obj: the lines of its material, and the colour that follows each vertex."""
    (folder / "a.mtl").write_text(f"newmtl paint\n{material}\n")
    corners = "".join(f"v {x} {y} {z}{colour}\nvt {u} {v}\n" for (x, y, z), (u, v) in zip(CORNERS, UV, strict=True))
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl paint\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    return folder / "a.obj"


def dielectric(**more):
    return {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0, **more}}


def seen(path, side=2.0, width=64, eye=(0.0, 0.0, 600.0), placement=None, samples=1):
    """What a far eye sees of a scene in a square window around the origin."""
    scene = load_scene(path, Placement() if placement is None else placement)
    return render_view(scene, eye, Window(side, side, width, width), Settings(samples=samples)).radiance


def fields(radiance):
    side = len(radiance) // 4
    return radiance[side :: 2 * side, side :: 2 * side][:2, :2]


def test_a_glb_has_its_texture_the_right_way_up(tmp_path, mi):
    """Rough glass-like paint: its albedo, and of the lights in front less than glTF's 4 % of a mirror more."""
    path = glb(tmp_path / "a.glb", dielectric(baseColorTexture={"index": 0}), [png_of(picture(), tmp_path / "a.png")])
    found = fields(seen(path)) - LIGHT
    assert found.min() > -0.02, found
    assert found.max() < 0.04, found


def test_factors_of_a_glb_multiply_linear_light(tmp_path, mi):
    image = [png_of(picture(), tmp_path / "a.png")]
    pale = fields(seen(glb(tmp_path / "a.glb", dielectric(baseColorTexture={"index": 0}), image)))
    factor = dielectric(baseColorTexture={"index": 0}, baseColorFactor=[0.5, 0.25, 1.0, 1.0])
    found = fields(seen(glb(tmp_path / "b.glb", factor, image)))
    assert found[0, 0] - pale[0, 0] == pytest.approx(LIGHT[0, 0] * [-0.5, -0.75, 0.0], abs=0.02)


def test_a_glb_that_glows_needs_no_light(tmp_path, mi):
    """Black paint, whose gloss alone is added."""
    black = dielectric(baseColorFactor=[0.0, 0.0, 0.0, 1.0])
    dark = fields(seen(glb(tmp_path / "a.glb", black)))
    glow = black | {"emissiveFactor": [0.2, 0.4, 0.8]}
    added = fields(seen(glb(tmp_path / "b.glb", glow))) - dark
    assert added == pytest.approx(np.full((2, 2, 3), [0.2, 0.4, 0.8]), abs=1e-3)


def test_a_glb_may_have_holes(tmp_path, mi):
    """Alpha 0 in the top left field: nothing is seen there."""
    alpha = np.dstack([FIELDS, np.array([[0, 255], [255, 255]], np.uint8)])
    image = Image.fromarray(alpha.repeat(32, axis=0).repeat(32, axis=1))
    paint = dielectric(baseColorTexture={"index": 0}) | {"alphaMode": "MASK"}
    found = fields(seen(glb(tmp_path / "a.glb", paint, [png_of(image, tmp_path / "a.png")])))
    assert found[0, 0].max() == 0.0
    assert found[0, 1] == pytest.approx(LIGHT[0, 1], abs=0.04)


def test_a_normal_map_turns_surfaces_towards_the_key_light(tmp_path, mi):
    """glTF's green is up: towards the key light, which is above; the same map upside down is darker."""
    base = png_of(Image.new("RGB", (8, 8), (128, 128, 128)), tmp_path / "a.png")
    found = {}
    for name, green in (("up", 190), ("flat", 128), ("down", 66)):
        bumps = png_of(Image.new("RGB", (8, 8), (128, green, 238)), tmp_path / f"{name}.png")
        material = dielectric(baseColorTexture={"index": 0}) | {"normalTexture": {"index": 1}}
        found[name] = float(seen(glb(tmp_path / f"{name}.glb", material, [base, bumps])).mean())
    assert found["up"] > 1.2 * found["down"], found
    assert found["flat"] > 1.2 * found["down"], found


def test_an_obj_without_a_texture_has_its_kd(tmp_path, mi):
    assert fields(seen(obj(tmp_path, "Kd 0.3 0.6 0.1"))) == pytest.approx(np.full((2, 2, 3), [0.3, 0.6, 0.1]), abs=1e-3)


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize(("kind", "times"), [("u1", 1), ("u2", 257), ("u2", 1), ("i4", 1), (None, 0)])
def test_colours_of_any_whole_numbers(tmp_path, mi, text, kind, times):
    """Of 16 bits, 257 times a byte is that byte's colour; so is a byte in a wider type. Text and binary files."""
    kinds = [*((name, "f4") for name in "xyz"), *((name, kind) for name in ("red", "green", "blue") if kind)]
    colours = [times * int(byte) for byte in FIELDS[0, 0]] if kind else []
    points = np.array([(*at, *colours) for at in CORNERS], kinds)
    faces = np.array([(list(corners),) for corners in FACES], [("vertex_indices", "i4", (3,))])
    elements = [plyfile.PlyElement.describe(points, "vertex"), plyfile.PlyElement.describe(faces, "face")]
    plyfile.PlyData(elements, text=text).write(str(tmp_path / "a.ply"))
    found = fields(seen(tmp_path / "a.ply"))
    if kind is None:
        assert found.min() > 0.1
    else:
        assert found == pytest.approx(np.full((2, 2, 3), LIGHT[0, 0]), abs=1e-3)


def test_a_scene_of_hardly_any_size_is_not_fitted(tmp_path, mi):
    (tmp_path / "d.toml").write_text(DISPLAY)
    for size, part in ((1e-10, "1e-10 x 1e-10"), (1e12, r"outside 1e-09 to 1e\+09; resize its file")):
        trimesh.creation.box((size, size, size)).export(tmp_path / "a.stl")
        scene = load_scene(tmp_path / "a.stl")
        with pytest.raises(InputError, match=part):
            arranged(scene, load_display(tmp_path / "d.toml"), "fit")


def test_an_stl_stands_upright(tmp_path, mi):
    """Its z is up: a tower along z is high in the picture."""
    trimesh.creation.box((1.0, 1.0, 4.0)).export(tmp_path / "tower.stl")
    scene = api.load_scene(tmp_path / "tower.stl")
    assert scene.usual == "fit"
    assert scene.width_mm == pytest.approx(4.0)
    assert scene.depth_range_mm == pytest.approx([-0.5, 0.5], abs=0.01)


@pytest.mark.parametrize("turn", [(0.0, 180.0, 0.0), (-90.0, 0.0, 30.0)])
def test_lights_stay_before_a_turned_mesh(tmp_path, mi, turn):
    """A cube shows another face, lit as the first was."""
    trimesh.creation.box((2.0, 2.0, 2.0)).export(tmp_path / "cube.glb")
    found = seen(tmp_path / "cube.glb", 0.5, placement=Placement(rotation_deg=turn))
    assert found == pytest.approx(seen(tmp_path / "cube.glb", 0.5), abs=1e-3)
    assert found.min() > 0.05


def test_nodes_move_meshes_and_mirrored_ones_are_not_inside_out(tmp_path, mi):
    scene = trimesh.Scene()
    square = trimesh.Trimesh(0.4 * CORNERS, FACES, vertex_colors=[[255, 255, 255, 255]] * 4, process=False)
    scene.add_geometry(square, transform=np.diag([-1.0, 1.0, 1.0, 1.0]) + np.array([[0, 0, 0, 0.5], *[[0] * 4] * 3]))
    scene.export(tmp_path / "a.glb")
    found = seen(tmp_path / "a.glb", width=40)[20, :, 0]
    assert (found[23:37] > 0.5).all()
    assert not found[:20].any()


def test_a_factor_multiplies_the_texture_of_metal_and_roughness(tmp_path, mi):
    """Of a picture that says metal, a factor of 0 makes paint: white, as if its file said so."""
    images = [png_of(Image.new("RGB", (8, 8), (255, 128, 255)), tmp_path / "a.png")]
    metal = {"metallicRoughnessTexture": {"index": 0}, "metallicFactor": 0.0}
    found = seen(glb(tmp_path / "a.glb", {"pbrMetallicRoughness": metal}, images)).mean()
    assert found > 0.9
    assert found == pytest.approx(seen(glb(tmp_path / "b.glb", dielectric(roughnessFactor=0.5))).mean(), 0.1)


def test_a_glb_without_a_scene_shows_its_meshes(tmp_path, mi):
    def change(told):
        del told["scene"], told["scenes"], told["nodes"]

    assert seen(glb(tmp_path / "a.glb", dielectric(), change=change)).min() > 0.9


def test_what_of_a_gltf_is_left_out_is_told(tmp_path, mi):
    def with_extension(key, name):
        return glb(tmp_path / "a.glb", dielectric(), change=lambda told: told.update({key: [name]}))

    assert "KHR_texture_transform" in load_scene(with_extension("extensionsUsed", "KHR_texture_transform")).notes[0]
    for name in ("KHR_draco_mesh_compression", "KHR_mesh_quantization", "EXT_meshopt_compression"):
        refused(with_extension("extensionsRequired", name), name)

    def integers(told):
        told["accessors"][1]["componentType"] = 5123

    refused(glb(tmp_path / "c.glb", dielectric(), change=integers), "integer positions")


def test_textures_are_found_by_any_spelling(tmp_path, mi):
    """MTL's options and backslashes, and a glTF's web addresses."""
    picture().save(tmp_path / "tex ä.png")
    for name in ("tex ä.png", ".\\tex ä.png", "-s 1 1 1 tex ä.png", "-clamp on -o 0 0 0 ./tex ä.png"):
        assert fields(seen(obj(tmp_path, f"map_Kd {name}"))) == pytest.approx(LIGHT, abs=1e-3), name
    image = {"uri": "tex%20%C3%A4.png"}
    told = dielectric(baseColorTexture={"index": 0})
    path = glb(tmp_path / "a.glb", told, change=lambda made: made.update(images=[image], textures=[{"source": 0}]))
    assert fields(seen(path)) == pytest.approx(LIGHT, abs=0.04)


def test_a_texture_hides_the_colours_of_vertices(tmp_path, mi):
    """Photogrammetry writes both; white ones are no loss, others are told."""
    picture().save(tmp_path / "t.png")
    for colour, notes in ((" 1 1 1", 0), (" 0.5 0.5 0.5", 1)):
        path = obj(tmp_path, "map_Kd t.png", colour)
        assert fields(seen(path)) == pytest.approx(LIGHT, abs=1e-3)
        assert len(load_scene(path).notes) == notes


def test_colours_of_faces_do_not_run(tmp_path, mi):
    mesh = trimesh.Trimesh(CORNERS, FACES, process=False)
    mesh.visual.face_colors = [[*FIELDS[0, 0], 255], [*FIELDS[0, 1], 255]]
    mesh.export(tmp_path / "a.ply")
    found = seen(tmp_path / "a.ply", width=40)
    assert found[30, 35] == pytest.approx(LIGHT[0, 0], abs=1e-3)  # below the diagonal
    assert found[10, 5] == pytest.approx(LIGHT[0, 1], abs=1e-3)


def test_a_depth_pictures_file_places_no_mesh(tmp_path, mi):
    """room.glb beside room.toml, which is a picture's."""
    (tmp_path / "room.toml").write_text(
        '[depth_picture]\ncolour = "a.png"\ndepth = "b.png"\nunit_mm = 1\nfov_deg = 60\n'
    )
    glb(tmp_path / "room.glb", dielectric())
    assert load_scene(tmp_path / "room.glb").usual == "fit"
    (tmp_path / "room.toml").write_text("[placement]\nscale = 3.0\n")
    scene = load_scene(tmp_path / "room.glb")
    assert (scene.usual, scene.placement.scale) == (None, 3.0)


HARMONICS = 45


def splats(path, centres, rgb, scale=0.1, opacity=6.0, rest=None):
    """A file as the splats' trainers write it; rgb in sRGB."""
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{k}" for k in range(HARMONICS)] + ["opacity", "scale_0", "scale_1", "scale_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3"]
    table = np.zeros((len(centres), len(names)), "<f4")
    table[:, :3] = centres
    table[:, 6:9] = (np.array(rgb) - 0.5) / 0.28209479177387814
    if rest is not None:
        table[:, 9 : 9 + HARMONICS] = rest
    table[:, names.index("opacity")] = opacity
    table[:, -7:-4] = np.log(scale)
    table[:, -4] = 1.0
    head = "".join(f"property float {name}\n" for name in names)
    told = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{head}end_header\n"
    path.write_bytes(told.encode() + table.tobytes())
    return path


def test_splats_are_where_and_as_mitsubas_camera_sees_them(tmp_path, mi):
    """The file given to Mitsuba as it is, its own camera and integrator."""
    random = np.random.default_rng(3)
    rest = random.normal(0.0, 0.1, (40, HARMONICS))
    path = splats(tmp_path / "a.ply", random.normal(0, 0.5, (40, 3)), random.random((40, 3)), rest=rest)
    camera = {
        "type": "perspective", "near_clip": 0.01, "fov": float(np.degrees(2 * np.arctan(0.25))),
        "to_world": mi.ScalarTransform4d().look_at([0, 0, 8], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}},
    }  # fmt: skip
    theirs = mi.load_dict({
        "type": "scene", "integrator": {"type": "volprim_rf_basic", "max_depth": 256}, "camera": camera,
        "splats": {"type": "ellipsoids", "filename": str(path), "to_world": mi.ScalarTransform4d()},
    })  # fmt: skip
    wanted = np.array(mi.render(theirs, spp=64))[..., :3]
    found = seen(path, 4.0, eye=(0.0, 0.0, 8.0), placement=Placement(near_mm=6.0, far_mm=-6.0), samples=64)
    assert psnr_db(found, wanted) > 40.0


def test_splats_have_no_light_of_ours_and_y_down(tmp_path, mi):
    path = splats(tmp_path / "a.ply", [[0.0, 1.0, 0.0]], [[0.5, 0.7, 0.9]], scale=0.3, opacity=12.0)
    scene = api.load_scene(path)
    low, high = scene.mitsuba.bbox().min.y, scene.mitsuba.bbox().max.y
    assert 0.0 < low < 1.0 < high
    assert scene.placement.rotation_deg == (180.0, 0.0, 0.0)
    found = render_view(scene, (0.0, 0.0, 600.0), Window(4.1, 4.1, 41, 41), Settings()).radiance
    assert found[30, 20] == pytest.approx(decode(np.array([0.5, 0.7, 0.9]), "srgb"), rel=0.02)
    assert not found[:15].any()


def test_stray_splats_do_not_shrink_the_scene(tmp_path, mi):
    random = np.random.default_rng(4)
    for strays in (0, 1, 16):
        centres = random.normal(0.0, 0.3, (400, 3))
        centres[:strays] = random.uniform(-500.0, 500.0, (strays, 3))
        scene = api.load_scene(splats(tmp_path / "a.ply", centres, [[1.0, 1.0, 1.0]] * 400))
        assert 1.5 < scene.width_mm < 3.5, strays


@pytest.fixture
def place(tmp_path, monkeypatch, mi):
    write_scene(
        tmp_path / "balls.xml",
        glowing_sphere((-2.0, 1.0, 8.0), 1.5, (1.0, 0.2, 0.1)),
        glowing_sphere((2.0, 1.0, 0.0), 1.5, (0.1, 1.0, 0.2)),
        glowing_sphere((0.0, -1.5, -10.0), 1.5, (0.2, 0.1, 1.0)),
        glowing_card("wall", -14.0, (0.3, 0.25, 0.2), 40.0),
    )
    (tmp_path / "d.toml").write_text(DISPLAY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


SHORT = ("--display", "d.toml", "--device", "llvm", "--json")


@pytest.mark.parametrize("rows", [1, 3])
def test_a_view_that_coincides_with_an_eye_is_that_view(place, capfd, rows):
    """The scene's views; their folder as a scene; its views from the same eyes."""
    form = ("--across", 4, "--down", rows, "--width", 96, "--linear", *SHORT)
    told(capfd, "export", "views", "balls.xml", "-o", "a", *form)
    views = told(capfd, "export", "views", "a", "-o", "b", *form, "--samples", 1)["views"]
    for view in views:
        a, b = (read_picture(place / folder / view["file"]).radiance for folder in "ab")
        assert psnr_db(a, b) >= 50.0, view


def test_between_two_eyes_both_views_are_mixed(place, capfd):
    """A far wall, alone, would be the same; each ball is seen twice, half as bright before the wall."""
    told(capfd, "export", "views", "balls.xml", "-o", "a", "--across", 2, "--width", 96, "--linear", *SHORT)
    both = [read_picture(place / f"a/view_000{k}.exr").radiance for k in range(2)]
    told(capfd, "export", "views", "a", "-o", "b", "--across", 3, "--width", 96, "--samples", 1, "--linear", *SHORT)
    middle = read_picture(place / "b/view_0001.exr").radiance
    assert psnr_db(middle, 0.5 * (both[0] + both[1])) >= 50.0
    assert psnr_db(both[0], both[1]) < 30.0


def test_a_quilt_is_shown_by_its_name_alone(place, capfd):
    """The quilt of the scene, and the scene, as an eye aside sees them on the display: alike; in another order not."""
    tiling = ("--width", 150, "--columns", 6, "--rows", 8)
    quilt = told(capfd, "export", "quilt", "balls.xml", "-o", "q.png", *tiling, *SHORT)["output"]
    whole = read_picture(quilt)
    height, width, _ = whole.radiance.shape
    tiles = whole.radiance.reshape(8, height // 8, 6, width // 6, 3)
    turned = "turned" + quilt[1:]
    write_picture(turned, tiles[::-1, :, ::-1].reshape(height, width, 3), whole.metadata)
    eyes = {}
    for name, source in (("scene", "balls.xml"), ("quilt", quilt), ("turned", turned)):
        told(capfd, "render", source, "-o", f"{name}.exr", *SHORT)
        told(capfd, "observe", f"{name}.exr", "--eye", "15,0,600", "-o", f"{name}-eye.exr", "--width", 150, *SHORT)
        eyes[name] = read_picture(f"{name}-eye.exr").radiance
    alike, other = (psnr_db(eyes["scene"], eyes[name]) for name in ("quilt", "turned"))
    assert alike > 24.0, alike
    assert other < alike - 2.0, (alike, other)


def test_a_quilt_of_another_tool_has_a_cone_of_forty_degrees(tmp_path, mi):
    """Looking Glass' cameras; tiles that each have one colour are seen from their part of it."""
    tiles = np.zeros((2, 10, 3, 10, 3), np.uint8)
    for number in range(6):
        tiles[1 - number // 3, :, number % 3] = 40 * number + 20
    Image.fromarray(tiles.reshape(20, 30, 3)).save(tmp_path / "a_qs3x2a1.png")
    for number, angle in enumerate(np.linspace(-20.0, 20.0, 6)):
        across = np.tan(np.radians(20.0)) * (2.0 * number / 5 - 1.0)
        assert abs(np.degrees(np.arctan(across)) - angle) < 2.0
        found = seen(tmp_path / "a_qs3x2a1.png", 0.5, 65, (600.0 * across, 0.0, 600.0))[32, 32]
        assert found == pytest.approx(decode(np.full(3, (40 * number + 20) / 255.0), "srgb"), rel=1e-2)


def depth_pair(place, mi, hole=False):
    """A picture and depths of the balls by Mitsuba's own camera; depths in tenths of a millimetre, 16 bits."""
    scene = mi.load_file(str(place / "balls.xml"))
    camera = {
        "type": "perspective", "fov": 12.0,
        "to_world": mi.ScalarTransform4d().look_at([0, 0, 60], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 160, "height": 120, "rfilter": {"type": "box"}},
    }  # fmt: skip
    picture = np.array(
        mi.render(scene, sensor=mi.load_dict(camera), integrator=mi.load_dict({"type": "direct"}), spp=16)
    )
    Image.fromarray(np.uint8(255 * np.clip(np.array(mi.Bitmap(picture).convert(
        mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True)) / 255.0, 0, 1))).save(place / "colour.png")  # fmt: skip
    y, x = np.mgrid[:120, :160] + 0.5
    focal = 80.0 / np.tan(np.radians(6.0))
    across = np.stack([(x - 80) / focal, (60 - y) / focal, -np.ones_like(x)]).reshape(3, -1)
    far = np.linalg.norm(across, axis=0)
    ray = mi.Ray3f(mi.Point3f(0, 0, 60), mi.Vector3f(*(across / far).astype(np.float32)))
    depth = (np.array(scene.ray_intersect(ray).t) / far).reshape(120, 160)
    steps = np.round(10 * depth).astype(np.uint16)
    if hole:
        steps[30:33, 40:50] = 0
    Image.fromarray(steps).save(place / "depth.png")
    (place / "pair.toml").write_text(
        '[depth_picture]\ncolour = "colour.png"\ndepth = "depth.png"\nunit_mm = 0.1\nfov_deg = 12\n'
    )
    return depth


def test_a_picture_with_depths_is_the_scene_for_its_camera(place, mi):
    """From the camera's place the picture; the surface at each pixel as far as the scene's."""
    depth_pair(place, mi)
    scene = load_scene(place / "pair.toml")
    assert scene.usual == "camera"
    assert not scene.notes
    side = 2 * 60.0 * np.tan(np.radians(6.0))
    placed, window = scene.placed(Placement(offset_mm=(0.0, 0.0, 60.0))), Window(side, 0.75 * side, 160, 120)
    found = render_view(placed, (0.0, 0.0, 60.0), window, Settings()).radiance
    wanted = read_picture(place / "colour.png").radiance
    assert psnr_db(found[1:-1, 1:-1], wanted[1:-1, 1:-1]) > 35.0


def test_a_picture_with_depths_beside_the_scene(place, mi, capfd):
    """Eyes aside see what the scene shows them, but where the camera saw nothing."""
    depth_pair(place, mi)
    eye, window = (2.0, 1.0, 60.0), Window(8.0, 6.0, 160, 120)
    surface = load_scene(place / "pair.toml", Placement(offset_mm=(0.0, 0.0, 60.0)))
    views = [
        render_view(scene, eye, window, Settings(samples=4)).radiance
        for scene in (surface, load_scene(place / "balls.xml", Placement()))
    ]
    assert psnr_db(*views) > 25.0
    told(capfd, "render", "pair.toml", "-o", "pair.png", *SHORT)


def test_holes_of_depths_are_counted_and_filled(place, mi, capfd):
    depth_pair(place, mi, hole=True)
    assert run(["render", "pair.toml", "-o", "pair.exr", "--display", "d.toml", "--device", "llvm"]) == 0
    assert "30 of 19200 pixels have no depth" in capfd.readouterr().err
    scene = load_scene(place / "pair.toml", Placement(offset_mm=(0.0, 0.0, 60.0)))
    found = render_view(scene, (0.0, 0.0, 60.0), Window(12.0, 9.0, 160, 120), Settings()).radiance
    assert found[10:-10, 10:-10].max(axis=2).min() > 0.05


def test_every_kind_renders_without_an_option(place, mi, capfd):
    depth_pair(place, mi)
    ball = trimesh.creation.icosphere(2)
    for kind in ("glb", "obj", "ply", "stl"):
        ball.export(place / f"ball.{kind}")
    (place / "gltf").mkdir()
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(ball)).items():
        (place / "gltf" / name).write_bytes(data)
    splats(place / "s.ply", [[0, 0, 0]], [[1, 1, 1]])
    told(capfd, "export", "views", "balls.xml", "-o", "v", "--across", 3, "--width", 64, *SHORT)
    quilt = told(capfd, "export", "quilt", "balls.xml", "-o", "q.png", "--width", 64, *SHORT)["output"]
    for name in ("ball.glb", "gltf/model.gltf", "ball.obj", "ball.ply", "ball.stl", "s.ply", "v", quilt, "pair.toml"):
        told(capfd, "render", name, "-o", "out.exr", "--samples", 1, *SHORT)
        light = read_picture(place / "out.exr").radiance
        assert light.max() > 0.2, name
        assert light.mean() > 0.002, name


def test_a_dictionary_and_a_mitsuba_scene_are_scenes(place, mi):
    given = {"type": "scene", "ball": {"type": "sphere", "e": {"type": "area", "radiance": 0.5}}}
    images = [api.render(scene, "d.toml", samples=1, model="pinhole") for scene in (given, mi.load_dict(given))]
    assert images[0].radiance.max() == pytest.approx(0.5)
    assert (images[0].radiance == images[1].radiance).all()
    with pytest.raises(InputError, match="dictionary"):
        api.render({"type": "scene", "ball": {"type": "spere"}}, "d.toml")
    with pytest.raises(InputError, match="int is not a scene"):
        api.render(5, "d.toml")


def test_a_window_fills_the_panel(place, mi):
    quilt = np.zeros((40, 120, 3), np.uint8) + 200
    Image.fromarray(quilt).save("w_qs2x1a1.5.png")
    built = load_display("d.toml")
    scene = arranged(load_scene("w_qs2x1a1.5.png"), built, "fill")
    panel = built.panel
    assert scene.width_mm == pytest.approx(min(panel.width_mm, 1.5 * panel.height_mm))
    assert scene.placement.near_mm > 0.0 > scene.placement.far_mm


def refused(path, words):
    with pytest.raises(InputError) as caught:
        load_scene(path)
    for word in words if isinstance(words, tuple) else (words,):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("form", ["ascii", "little", "big"])
@pytest.mark.parametrize("sides", [3, 4])
def test_a_face_names_vertices_that_are_there(tmp_path, mi, form, sides):
    """Mitsuba reads the numbers of a PLY as they are, and crashed."""
    (tmp_path / "a.xml").write_text(
        '<scene version="3.0.0"><shape type="ply"><string name="filename" value="a.ply"/></shape></scene>'
    )
    places = np.array([(*corner,) for corner in CORNERS], [(axis, "f4") for axis in "xyz"])
    for last, right in ((3, True), (4, False), (-1, False), (99_999_999, False)):
        face = np.zeros(1, [("vertex_indices", "i4", (sides,))])
        face["vertex_indices"][0] = [*range(sides - 1), last]
        data = [PlyElement.describe(places, "vertex"), PlyElement.describe(face, "face")]
        order = {"little": "<", "big": ">"}.get(form, "=")
        PlyData(data, text=form == "ascii", byte_order=order).write(str(tmp_path / "a.ply"))
        if right:
            check_faces(tmp_path / "a.ply")
        else:
            what = f"a face uses vertex {last}, but the file has 4 (from 0); export it again"
            refused(tmp_path / "a.xml", ("a.ply", what))
    head = (tmp_path / "a.ply").read_bytes().partition(b"element face")[0]
    (tmp_path / "a.ply").write_bytes(head + b"element face -1\nend_header\n" + bytes(100))
    refused(tmp_path / "a.xml", ("a.ply", "negative count"))
    (tmp_path / "a.ply").write_bytes(head)
    refused(tmp_path / "a.xml", ("a.ply", "no header"))


def test_a_mesh_names_pictures_materials_and_buffers_only(tmp_path, mi):
    """Not any file of this machine."""
    secret = tmp_path / "secret.txt"
    secret.write_bytes(bytes(4096))

    def change(told):
        told["buffers"] = [{"uri": str(secret), "byteLength": 4096}]

    refused(glb(tmp_path / "a.glb", dielectric(), change=change), "secret.txt")


def test_broken_meshes_are_refused_in_a_line(tmp_path, mi):
    good = glb(tmp_path / "a.glb", dielectric()).read_bytes()
    for cut in (0, 3, 12, 30, 200, len(good) - 40):
        (tmp_path / "b.glb").write_bytes(good[:cut])
        refused(tmp_path / "b.glb", "b.glb")
    for name, data, word in (
        ("b.stl", b"\0" * 80 + struct.pack("<I", 1 << 30) + b"\0" * 50, "b.stl"),
        ("b.obj", b"f 1 2 3\nv 0 0\n", "b.obj"),
        ("c.obj", b"v 0 0 0\nv 1 0 0\n", "c.obj"),
        ("d.obj", b"v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "finite"),
        ("e.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no area"),
        ("f.glb", b"", "empty"),
    ):
        (tmp_path / name).write_bytes(data)
        refused(tmp_path / name, word)


def test_accessors_without_data_are_not_expanded(tmp_path, mi):
    huge = {"componentType": 5126, "count": 2_000_000_000, "type": "VEC4"}
    refused(glb(tmp_path / "a.glb", dielectric(), extra=[huge]), "has over 100000000 accessor elements")
    refused(glb(tmp_path / "b.glb", dielectric(), extra=[huge | {"count": -5}]), "b.glb")


def test_missing_and_broken_textures_are_named(tmp_path, mi):
    path = obj(tmp_path, "map_Kd bark.png")
    refused(path, ("bark.png", "texture"))
    (tmp_path / "c.obj").write_text(path.read_text().replace("a.mtl", "none.mtl"))
    refused(tmp_path / "c.obj", ("none.mtl", "material"))
    (tmp_path / "bark.png").write_bytes(b"no picture")
    refused(path, "texture")
    refused(glb(tmp_path / "b.glb", dielectric(baseColorTexture={"index": 0}), [b"no picture"]), "texture")
    whole = png_of(picture(), tmp_path / "whole.png")
    refused(glb(tmp_path / "c.glb", dielectric(baseColorTexture={"index": 0}), [whole[:-60]]), "texture")
    large = png_of(Image.new("1", (8192, 4097)), tmp_path / "large.png")
    told = "a texture of 8192 x 4097 pixels; 33 million are allowed"
    refused(glb(tmp_path / "d.glb", dielectric(baseColorTexture={"index": 0}), [large]), told)


def test_a_factor_multiplies_every_row_of_a_texture(tmp_path, mi):
    """Of one that is taken in several parts: half of a linear 1 is 0.5, 188 in sRGB."""
    textures = meshes._Textures(tmp_path, tmp_path)
    name = textures.write(Image.new("RGB", (2, 600), (255, 255, 0)), "colour", np.array([0.5, 1.0, 0.5]))
    written = np.asarray(Image.open(tmp_path / name))
    assert written.shape == (600, 2, 3)
    assert (written == [188, 255, 0]).all()


def test_points_without_faces_or_colours_are_told(tmp_path, mi):
    trimesh.PointCloud(CORNERS).export(tmp_path / "points.ply")
    refused(tmp_path / "points.ply", "faces")
    data = splats(tmp_path / "s.ply", [[0, 0, 0]], [[1, 1, 1]]).read_bytes()
    (tmp_path / "s.ply").write_bytes(data.replace(b"f_dc_1", b"g_dc_1"))
    refused(tmp_path / "s.ply", ("without colours", "f_dc_1"))
    (tmp_path / "s.ply").write_bytes(data[:-3])
    refused(tmp_path / "s.ply", "s.ply")
    splats(tmp_path / "s.ply", [[0, np.nan, 0]], [[1, 1, 1]])
    refused(tmp_path / "s.ply", "finite")


def test_bad_views_are_told(place, capfd, mi):
    told(capfd, "export", "views", "balls.xml", "-o", "v", "--across", 3, "--width", 64, "--samples", 1, *SHORT)
    eyes = json.loads((place / "v/views.json").read_text())

    for number, values, words in (
        (0, {"eye_mm": [0, 0]}, "three numbers"),
        (1, {"eye_mm": [-60, 20, 600]}, "grid"),
        (1, {"eye_mm": eyes["views"][0]["eye_mm"]}, "has 3 eyes on 2 columns"),
        (1, {"eye_mm": [0, 0, -600]}, "distances"),
        (1, {"file": "other.png"}, "other.png"),
        (None, {"window_mm": [-24, 10]}, "window_mm"),
    ):
        changed = json.loads(json.dumps(eyes))
        (changed if number is None else changed["views"][number]).update(values)
        (place / "v/views.json").write_text(json.dumps(changed))
        refused(place / "v", words)
    (place / "v/views.json").write_text(json.dumps({key: eyes[key] for key in eyes if key != "window_mm"}))
    refused(place / "v", "window_mm")
    (place / "v/views.json").write_text(json.dumps(eyes))
    Image.new("RGB", (32, 48)).save(place / "v/view_0002.png")
    refused(place / "v", ("view_0002.png", "32 x 48"))
    (place / "v/views.json").unlink()
    refused(place / "v", ("is a folder", "views.json"))


def test_bad_quilts_are_told(tmp_path, mi):
    # Headers that claim a size, without pixels: who reads these first says that the picture is broken.
    for name, side in (("large_qs8x6a1.png", 30000), ("0.png", 8000)):
        (tmp_path / name).write_bytes(png(side, side, chunk(b"IDAT", bytes(1 << 22)), chunk(b"IEND")))
    views = [{"file": "0.png", "eye_mm": [x, 0, 600]} for x in range(4)]
    (tmp_path / "views.json").write_text(json.dumps({"window_mm": [8, 8], "views": views}))
    refused(tmp_path / "large_qs8x6a1.png", "900 million pixels")
    refused(tmp_path, "the views have 256 million pixels; 200 are allowed")
    Image.new("RGB", (4, 4)).save(tmp_path / "a_qs8x6a1.png")
    refused(tmp_path / "a_qs8x6a1.png", "tiling")
    Image.new("RGB", (4, 4)).save(tmp_path / "plain.png")
    refused(tmp_path / "plain.png", ("is not a scene", "quilt"))


def test_bad_depths_are_told(place, mi):
    depth_pair(place, mi)
    coloured = np.random.default_rng(1).integers(0, 255, (120, 160, 3), np.uint8)
    for image, words in (
        (Image.new("I;16", (10, 10)), ("10 x 10", "160 x 120")),
        (Image.new("I;16", (160, 120)), "no pixel has a depth"),
        (Image.fromarray(coloured), "has colours"),
    ):
        image.save(place / "depth.png")
        refused(place / "pair.toml", words)
    (place / "depth.png").write_bytes(b"no picture")
    refused(place / "pair.toml", "cannot be read")
    (place / "depth.png").unlink()
    refused(place / "pair.toml", "depth: depth.png: no such file; correct the name")


def test_eyes_may_stand_in_uneven_steps(place, capfd, mi):
    told(capfd, "export", "views", "balls.xml", "-o", "v", "--across", 4, "--width", 64, "--samples", 1, *SHORT)
    listed = json.loads((place / "v/views.json").read_text())
    for view, x in zip(listed["views"], (-60, -50, 0, 60), strict=True):
        view["eye_mm"] = [x, 0, 600]
    (place / "v/views.json").write_text(json.dumps(listed))
    assert "4 x 1 views" in str(load_scene(place / "v").mitsuba.emitters()[0])


def test_commands_that_place_nothing_say_so(place, capfd, mi):
    """Films and captures take a mesh's units as mm; POV-Ray's export takes Mitsuba's scenes only."""
    trimesh.creation.icosphere(2).export(place / "ball.glb")
    (place / "film.toml").write_text('scene = "ball.glb"\nframes = 1\n')
    assert run(["animate", "film.toml", "--display", "d.toml", "-o", "f", "--samples", "1", "--device", "llvm"]) == 0
    assert "ball.glb has no placement" in capfd.readouterr().err
    assert run(["export", "povray", "ball.glb", "--display", "d.toml", "-o", "p", "--device", "llvm"]) == 2
    assert "not a Mitsuba scene" in capfd.readouterr().err


#: Parts of a scene that name a file each.
FILES_OF_SCENES = {
    "reflectance.spd": '<bsdf type="diffuse" id="b"><spectrum name="reflectance" filename="{}"/></bsdf>',
    "index.spd": '<shape type="sphere"><bsdf type="conductor"><spectrum name="eta" filename="{}"/></bsdf></shape>',
    "lamp.spd": '<emitter type="point"><spectrum name="intensity" filename="{}"/></emitter>',
    "skin.png": '<texture type="bitmap" id="t"><string name="filename" value="{}"/></texture>',
    "sky.exr": '<emitter type="envmap"><string name="filename" value="{}"/></emitter>',
    "smoke.vol": '<volume type="gridvolume" id="v"><string name="filename" value="{}"/></volume>',
    "cloth.bsdf": '<bsdf type="measured" id="b"><string name="filename" value="{}"/></bsdf>',
    "cup.obj": '<shape type="obj"><string name="filename" value="{}"/></shape>',
    "room.xml": '<include filename="{}"/>',
    "screen.toml": '<sensor type="integral"><string name="display" value="{}"/></sensor>',
}


@pytest.mark.parametrize("name", FILES_OF_SCENES)
def test_each_file_that_a_scene_is_loaded_from_counts_in_its_hash(mi, tmp_path, name):
    scene, file = tmp_path / "s.xml", tmp_path / name
    scene.write_text(f'<scene version="3.0.0">{FILES_OF_SCENES[name].format(name)}</scene>')
    written = {
        ".spd": "400 0.{0}\n700 0.5\n", ".xml": '<scene version="3.0.0"><shape type="sphere" id="s{0}"/></scene>',
    }.get(file.suffix, "content {0}")  # fmt: skip
    file.write_text(written.format(1))
    before = digest_of(scene)
    assert digest_of(scene) == before
    file.write_text(written.format(2))
    assert digest_of(scene) != before


@pytest.mark.parametrize("name", ["a.mtl", "skin.png"])
def test_the_files_of_a_mesh_count_in_its_hash(mi, tmp_path, name):
    picture().save(tmp_path / "skin.png")
    path = obj(tmp_path, "Kd 1 1 1\nmap_Kd skin.png")
    before = digest_of(path)
    if name == "a.mtl":
        obj(tmp_path, "Kd 1 0 0")
    else:
        picture().rotate(90).save(tmp_path / "skin.png")
    assert digest_of(path) != before
