"""Broken files for every reader: it reads them, or refuses them in one line, in little time and memory.

Files of the right kind are changed at random. `LIPPMANN_INPUTS` is the number of files for each reader; a failing
file is kept under build/fuzz. Those that failed once are in tests/host/fuzz, and are tried first.
"""

import importlib
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lippmann.errors import LippmannError
from lippmann.simulation.toolchain import repository

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
INPUTS = int(os.environ.get("LIPPMANN_INPUTS", "150"))
CORPUS = Path(__file__).parent / "fuzz"
#: Longest time for a file, s; most memory of a process that has read all of them, MB.
SECONDS, MOST_MB = 30, 1000.0
SCENES = repository() / "scenes"

#: What is inserted: numbers at the ends of their types, and signs that formats give a meaning.
TOKENS = [
    *(b"0", b"-1", b"1e308", b"-1e-320", b"nan", b"inf", b"9223372036854775807", b"99999999999999999999", b"1e6"),
    *(b'"', b"'''", b"[", b"]", b"[[", b"{", b"}", b"=", b".", b",", b"#", b"\\", b"\\u0000", b"\n", b"\r\n", b"\0"),
    *(b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\0", b"\x80", b"\xc3", b"<", b">", b"&", b"]]>", b"-->"),
    *(b"true", b"[[layer]]\n", b"[panel]\n", b'"../.."', b'"/dev/zero"', b"<!DOCTYPE a [", b"x" * 5000),
]


def changed(rng, seeds):
    """Return one of the files, changed at some places."""
    data = bytearray(seeds[rng.integers(len(seeds))])
    for _ in range(rng.integers(1, 6)):
        at = int(rng.integers(len(data) + 1))
        length = int(min(len(data) - at, rng.geometric(0.05)))
        match int(rng.integers(8)):
            case 0:
                data[at:at] = TOKENS[rng.integers(len(TOKENS))]
            case 1:
                data[at : at + length] = TOKENS[rng.integers(len(TOKENS))]
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length] * int(rng.integers(1, 4))
            case 4 if at < len(data):
                data[at] ^= 1 << int(rng.integers(8))
            case 5:
                data[at : at + length] = rng.bytes(length)
            case 6:
                other = seeds[rng.integers(len(seeds))]
                start = int(rng.integers(len(other) + 1))
                data[at:] = other[start:]
            case _:
                del data[at:]
    return bytes(with_right_sums(data) if rng.random() < 0.5 else data)


def with_right_sums(data):
    """Return a PNG whose chunks have the right CRC-32, so that more than its sums is read; others as they are."""
    at = 8
    while data.startswith(b"\x89PNG") and at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if at + 12 + length > len(data):
            break
        struct.pack_into(">I", data, at + 8 + length, zlib.crc32(data[at + 4 : at + 8 + length]))
        at += 12 + length
    return data


# ---- the readers, in a child: a library may crash ----


def call(name, *arguments):
    """Call a function of the package by its dotted name; its modules are loaded by the first call."""
    module, _, function = f"lippmann.{name}".rpartition(".")
    return getattr(importlib.import_module(module), function)(*arguments)


def _display():
    return call("display.description.load_display", Path("vga-square.toml"))


def reading(name):
    """Return a reader: a function of a path and nothing else."""
    return lambda path: call(name, path)


def cut_pictures(path):
    call("layers.layers_and_pictures.cut_pictures", path, _display(), (32, 32))


def layer_film(path):
    film = call("motion.layer_film.load_layer_film", path)
    call("motion.layer_film.check_keys", film, _display(), path)


def display(path):
    call("optics.display_properties.display_properties", call("display.description.load_display", path))


scene, photograph = reading("scenes.scene.load_scene"), reading("calibration.photographs.read_photograph")
picture = reading("base.images.read_picture")


def scene_with(name):
    """Return a reader of a scene that names the broken file."""
    return lambda path: scene(path.with_name(name))


def foreign_rays(path):
    call("conformance.vector_files.read_foreign", path, _display(), "exact", 16)


#: Each reader with its name, and the good files that are changed for it.
READERS = [
    ("display_file", display, "d.toml"),
    ("placement_file", reading("scenes.placement.load_placement"), "p.toml"),
    ("film_file", reading("motion.film.load_film"), "f.toml"),
    ("layer_film_file", layer_film, "l.toml"),
    ("setup_file", reading("capturing.capture_setup.load_setup"), "s.toml"),
    ("layers_file", reading("load_layers"), "layers/layers.toml"),
    ("layer_picture", lambda path: call("load_layers", path.parent), "layers/fish.png"),
    ("pictures_file", cut_pictures, "pictures/pictures.toml"),
    ("placed_picture", lambda path: cut_pictures(path.parent), "pictures/one.png"),
    ("image_file", picture, "i.png", "i.exr", "i.tif"),
    ("foreign_rays", foreign_rays, "rays.npz", "rays.csv", "rays.mem"),
    ("bitstream_file", reading("board.bitstreams.read_bitfile"), "b.bit"),
    ("photograph", photograph, "p.png", "p.jpg", "p.tif", "p.bmp"),
    ("patterns_file", lambda path: call("calibration.coded_patterns.read_patterns", path, _display()), "patterns.toml"),
    ("calibration_file", lambda path: call("calibration.result.load_calibration", path.with_suffix(".toml")), "c.npz"),
    ("scene_file", scene, "scene.xml", "m.glb", "m.gltf", "m.obj", "m.ply", "m.stl", "pair.toml"),
    ("scene_file", scene, "q_qs2x2a1.png", "q_qs2x2a1.webp", "q_qs2x2a1.jpg"),
    ("splats_file", scene, "splats.ply"),
    ("views_folder", lambda path: scene(path.parent), "views/views.json"),
    ("depth_picture", scene_with("pair.toml"), "depth.png"),
    ("scene_mesh", scene_with("mesh.xml"), "mesh.ply"),
    ("scene_material", scene_with("painted.obj"), "painted.mtl"),
    ("scene_texture", scene_with("painted.obj"), "paint.png"),
    ("scene_buffer", scene_with("m.gltf"), "gltf_buffer_0.bin"),
]
CASES = {f"{name}, {Path(file).suffix[1:]}": (reader, file) for name, reader, *files in READERS for file in files}


def make_seeds(place):
    """Make a folder with a good file for every reader, by the commands that make them."""
    import cv2
    import lippmann as lp
    from lippmann.board.bitstreams import comment, sealed
    from lippmann.calibration.coded_patterns import PatternSet
    from lippmann.calibration.result import Calibration, FoundCamera, Parameter
    from lippmann.cli import run
    from PIL import Image

    rng = np.random.default_rng(1)
    os.chdir(place)
    shutil.copy(SCENES / "displays/vga-square.toml", "vga-square.toml")
    shutil.copy(SCENES / "displays/measured-hex.toml", "d.toml")
    shutil.copy(SCENES / "chart/chart.xml", "chart.xml")
    Path("p.toml").write_text(
        "[placement]\nscale = 2.0\nrotation_deg = [0, 30, 0]\noffset_mm = [1, 2, 3]\nnear_mm = 70\n"
    )
    Path("f.toml").write_text((SCENES / "films/swim.toml").read_text().replace("../fish/fish.xml", "chart.xml"))
    setup = (SCENES / "setups/pickup.toml").read_text()
    Path("s.toml").write_text(setup.replace("../displays/paper-square-real.toml", "vga-square.toml"))
    shutil.copytree(SCENES / "layers/fish", "layers")
    film = (SCENES / "films/swim-layers.toml").read_text()
    Path("l.toml").write_text(film.replace("../layers/fish", "layers"))
    Path("pictures").mkdir()
    Image.fromarray(rng.integers(0, 256, (12, 16, 4), np.uint8), "RGBA").save("pictures/one.png")
    Path("pictures/pictures.toml").write_text('[[picture]]\nfile = "one.png"\ndepth_mm = 5.0\nwidth_mm = 10.0\n')
    vga = lp.load_display("vga-square.toml")
    small = replace(vga, panel=replace(vga.panel, width_px=24, height_px=16))
    light = rng.random((16, 24, 3)).astype(np.float32) ** 8
    for suffix in ("png", "exr", "tif"):
        lp.IntegralImage(light, small, {}, {}).save(f"i.{suffix}")
    things = '<shape type="sphere" id="a"><bsdf type="diffuse"/></shape><emitter type="constant"/>'
    Path("scene.xml").write_text(f'<scene version="3.0.0">{things}</scene>')
    make_scene_files(rng)
    common = ["--display", "vga-square.toml", "--seed", "1"]
    assert run(["trace", *common, "--pixels", "20", "-o", "rays.npz"]) == 0
    assert run(["vectors", *common, "--case", "cell-edges", "--fraction-bits", "16", "-o", "words"]) == 0
    for found, name in (("words.csv", "rays.csv"), ("expected.mem", "rays.mem"), ("inputs.mem", "inputs.mem")):
        shutil.copy(next(Path("words").rglob(found)), name)
    text = b"\xff\x00" + comment("ulx3s", "vga", "0" * 16, "0" * 16, 1).encode() + b"\x00\xff\xff\xff\xbd\xb3"
    identity = b"\xe2\x00\x00\x00" + struct.pack(">I", 0x41113043)
    Path("b.bit").write_bytes(sealed(text + b"\xff" * 4 + identity + bytes(64) + b"\x5e\x00\x00\x00"))
    for name in ("p.png", "p.jpg", "p.tif", "p.bmp"):
        cv2.imwrite(name, rng.integers(0, 256, (20, 30, 3), np.uint8))
    Path("patterns.toml").write_text(PatternSet.of(vga).text(vga))
    shutil.copy("d.toml", "c.toml")
    camera = FoundCamera(
        name="a", place_mm=(0, 0, 600), uncertainty_mm=(1, 1, 1), lenslets=2, agree=1.0, modulation=0.5
    )
    parameter = Parameter("gap", 3.0, 0.1, "mm", 3.1, True)
    found = Calibration((parameter,), (), (camera,), {}, 0.1, 0.1, 0.0, lp.load_display("c.toml"), vga, np.ones((2, 8)))
    found.save(Path("c.toml"))


def make_scene_files(rng):
    """Make a good file of each kind of other tools' scenes."""
    import trimesh
    from PIL import Image
    from test_scene_files import splats
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    ball = trimesh.creation.icosphere(1)
    image = Image.fromarray(rng.integers(0, 256, (8, 8, 3), np.uint8))
    visual = TextureVisuals(uv=rng.random((len(ball.vertices), 2)), material=PBRMaterial(baseColorTexture=image))
    painted = trimesh.Trimesh(ball.vertices, ball.faces, visual=visual, process=False)
    trimesh.Scene(painted).export("m.glb")
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(painted)).items():
        Path("m.gltf" if name == "model.gltf" else name).write_bytes(data)
    for suffix in ("obj", "ply", "stl"):
        ball.export(f"m.{suffix}")
    ball.export("mesh.ply")
    Path("mesh.xml").write_text(
        '<scene version="3.0.0"><shape type="ply"><string name="filename" value="mesh.ply"/></shape></scene>'
    )
    splats(Path("splats.ply"), rng.random((9, 3)), rng.random((9, 3)))
    for suffix in ("png", "webp", "jpg"):
        Image.fromarray(rng.integers(0, 256, (20, 20, 3), np.uint8)).save(f"q_qs2x2a1.{suffix}")
    image.save("paint.png")
    Path("painted.mtl").write_text("newmtl a\nKd 0.8 0.5 0.2\nmap_Kd paint.png\n")
    Path("painted.obj").write_text(
        "mtllib painted.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    )
    Path("views").mkdir()
    eyes = [[x, y, 600] for y in (-5, 5) for x in (-5, 5)]
    for number in range(4):
        Image.fromarray(rng.integers(0, 256, (6, 8, 3), np.uint8)).save(f"views/{number}.png")
    listed = [{"file": f"{number}.png", "eye_mm": eye} for number, eye in enumerate(eyes)]
    Path("views/views.json").write_text(json.dumps({"window_mm": [8, 6], "views": listed}))
    Image.fromarray(rng.integers(0, 256, (9, 12, 3), np.uint8)).save("colour.png")
    Image.fromarray(rng.integers(900, 1100, (9, 12), np.uint16)).save("depth.png")
    Path("pair.toml").write_text(
        '[depth_picture]\ncolour = "colour.png"\ndepth = "depth.png"\nunit_mm = 1.0\nfov_deg = 40\n'
    )


def child(name, place, kept, seed, inputs):
    """Give a reader broken files; ends with a traceback at the first fault, with the peak memory in MB without one."""
    os.chdir(place)
    for case in sorted(CASES):
        if case.startswith(f"{name}, "):
            read_broken(case, kept, seed, inputs)
    # Not ru_maxrss: it begins with the size of the process that started this one.
    (most,) = (line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    print(int(most) / 1024)


def read_broken(case, kept, seed, inputs):
    """Read the known files, then changed ones; that of a fault stays in `kept`."""
    reader, name = CASES[case]
    path, rng = Path(name), np.random.default_rng([seed, zlib.crc32(case.encode())])
    seeds = [path.read_bytes()]
    reader(path.resolve())  # the good file is read, and libraries are loaded
    failing = Path(kept, case.replace(", ", "."))
    known = sorted((CORPUS / case.replace(", ", ".")).glob("*"))
    for number in range(len(known) + inputs):
        data = known[number].read_bytes() if number < len(known) else changed(rng, seeds)
        path.write_bytes(data)
        failing.write_bytes(data)  # it is there when the process is no more
        signal.alarm(SECONDS)
        try:
            reader(path.resolve())
        except LippmannError as error:
            if "\n" in str(error):
                raise AssertionError("more than one line") from error
        finally:
            signal.alarm(0)
    failing.unlink()
    path.write_bytes(seeds[0])


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    place = tmp_path_factory.mktemp("fuzz")
    before = Path.cwd()
    try:
        make_seeds(place)
    finally:
        os.chdir(before)
    return place


@pytest.mark.parametrize("name", sorted({name for name, *_ in READERS}))
def test_broken_files_are_refused_in_one_line(seeds, tmp_path, name):
    print(f"seed {SEED}")
    kept = repository() / "build" / "fuzz"
    kept.mkdir(parents=True, exist_ok=True)
    place = tmp_path / "place"
    shutil.copytree(seeds, place)
    program = [sys.executable, __file__, name, str(place), str(kept), str(SEED), str(INPUTS)]
    began = time.monotonic()
    done = subprocess.run(program, capture_output=True, text=True, errors="replace", check=False)
    print(f"{INPUTS} files of each kind, {time.monotonic() - began:.1f} s")
    assert done.returncode == 0, f"{kept}: {done.stdout[-500:]}{done.stderr[-3000:]}"
    assert float(done.stdout.split()[-1]) < MOST_MB


if __name__ == "__main__":
    child(sys.argv[1], *sys.argv[2:4], *map(int, sys.argv[4:6]))
