"""Planted mistakes in display files and commands: each is one line that names the likeliest remedy, exit code 2."""

import re

import numpy as np
import pytest
from lippmann.base.images import write_picture
from model_board import ModelBoard
from scene_cases import display_toml, focused_display, generator, glowing_sphere, write_scene

SEED = 1411
DISPLAY = focused_display("square", width_px=64, height_px=48, pixel_pitch=0.1)
TINY = display_toml(DISPLAY)
#: Where a mistake puts a key of its own.
TOP, PANEL, ARRAY = r"^(?=name)", r"^(?=subpixels)", r"^(?=index)"


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(TINY)
    write_scene(tmp_path / "ball.xml", glowing_sphere((0.0, 0.0, -5.0), 2.0))
    light = generator(SEED).random((48, 64, 3))
    write_picture("image.exr", light, {"identity": DISPLAY.identity})
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "latin.toml").write_bytes(b"name = '\xe9'")
    np.save("objects.npy", np.array([{}], object), allow_pickle=True)
    write_picture("other.exr", light, {"identity": "79ee8471d40b2533", "display": "paper-square"})
    return tmp_path


#: What is found in the file, what the mistake puts in its place, the place that is named, and the remedy. The tests of
#: the reader, test_display, have more.
FILES = [
    ("pixel_pitch_mm = 0.1", "pixel_pitch = 0.1", "panel.pixel_pitch", "did you mean pixel_pitch_mm?"),
    (TOP, "viewing_distance = 600\n", "viewing_distance", "did you mean viewing_distance_mm?"),
    (ARRAY, "viewing_distance_mm = 600\n", "array.viewing_distance_mm", "at the top of the file"),
    (PANEL, "gamma = 2.2\n", "panel.gamma", "did you mean transfer?"),
    (ARRAY, "shear_deg = 0.5\n", "array.shear_deg", "did you mean shear (shift of the rows along x, as a fraction"),
    (ARRAY, "skew = 0.5\n", "array.skew", "did you mean shear?"),
    (ARRAY, "angle_deg = 0.5\n", "array.angle_deg", "did you mean rotation_deg?"),
    (TOP, "layout = 'hex'\n", "layout", "did you mean array.grid?"),
    (ARRAY, "index = 1.6\n", "index is given a second time in line", "remove one of the lines"),
    ("pixel_pitch_mm = 0.1", "pixel_pitch_mm = 100", "panel.pixel_pitch_mm", "give 0.1, if 100 micrometres are meant"),
    (PANEL, "transfer = 2.2\n", "panel.transfer", 'did you mean "gamma2.2"?'),
    (PANEL, "transfer = [[1, 1], [0.5, 0.2], [0, 0]]\n", "panel.transfer", "reverse the list"),
    (PANEL, "white_cd_m2 = 0.2\nblack_cd_m2 = 300\n", "panel.black_cd_m2", "are they exchanged?"),
    (ARRAY, "rotation_rad = 0.5\n", "array.rotation_rad", "did you mean rotation_deg (rotation of the lattice"),
    ("index = .*", "glass = 'BK7'", "array.glass", "did you mean N-BK7? (or give index)"),
    ("width_px = .*", f"width_px = 0x{'f' * 5000}", "panel.width_px", "give a whole number"),
    ("gap_mm = .*", "gap_mm = 2,5", "not TOML", "write numbers with a point, text in quotes"),
    ('grid = "square"', "grid = square", "not TOML", "write numbers with a point, text in quotes"),
    (TOP, "viewing_distance_mm = 2\n", "viewing_distance_mm", "give 2000, if 2 m are meant, or a viewing_distance_mm"),
    (TOP, "viewing_distance_mm = 0.1\n", "viewing_distance_mm", "give 100, if 0.1 m are meant, or a"),
    (TOP, "viewing_distance_mm = 0.09\n", "viewing_distance_mm", "give a viewing_distance_mm such as "),
]


@pytest.mark.parametrize(("found", "mistake", "named", "remedy"), FILES, ids=[f"{m[2]} {m[1][:20]!r}" for m in FILES])
def test_mistakes_in_a_display_file(place, refusal_of, found, mistake, named, remedy):
    text, count = re.subn(found, mistake, TINY, count=1, flags=re.MULTILINE)
    assert count == 1
    (place / "wrong.toml").write_text(text)
    line = refusal_of("inspect", "wrong.toml")
    where, _, rest = line.removeprefix("lippmann: wrong.toml: ").partition("; ")
    assert line.startswith("lippmann: wrong.toml: ")
    assert re.match(rf"{re.escape(named)}[: ]", where), line
    assert remedy in rest, line


RENDER = "render ball.xml --display tiny.toml --device llvm -o a.exr"
OBSERVE = "observe image.exr --display tiny.toml --device llvm --eye 0,0,600 -o v.png"
#: The words of the command, what is named, and the remedy.
COMMANDS = [
    ("Inspect tiny.toml", "Inspect", "Did you mean 'inspect'"),
    ("xyzzy", "No such command 'xyzzy'", "(see --help)"),
    ("board strat", "strat", "Did you mean 'start'"),
    *((f"bench {word}", "lippmann bench: removed; to measure Lippmann itself, run", "python -m tools.bench")
      for word in ("rendr", "trace")),
    ("export pov", "pov", "Did you mean 'povray'"),
    (RENDER.replace("--display", "--dispaly"), "--dispaly", "Did you mean '--display'?"),
    (f"{RENDER} --sample 2", "--sample", "--samples"),
    (f"{OBSERVE} --pupil-mm 3", "--pupil-mm", "Did you mean '--pupil'"),
    (f"{RENDER} --model exat", "--model", "'exact'"),
    (f"{RENDER} --engine gpu", "--engine", "'fast'"),
    ("inspect --display tiny.toml", "--display", "lippmann inspect [OPTIONS] DISPLAY.toml"),
    ("inspect tiny.toml --eye 1e300,0,600", "eye: is farther away", "such as 0,0,600"),
    (OBSERVE.replace("image.exr", "."), ".: is a folder", "give an image"),
    (OBSERVE.replace("image.exr", "/dev/zero"), "/dev/zero: is not a plain file", "give an image"),
    ("trace --display tiny.toml --pixels /dev/zero -o r.npz", "/dev/zero: is not a plain file", "give a number of"),
    ("trace --display tiny.toml --pixels . -o r.npz", ".: is a folder", "give a number of rays"),
    ("regress --display tiny.toml --rays none.csv", "none.csv: no such file", "give a .npz, .csv or .mem"),
    ("regress --display tiny.toml --rays /dev/zero", "/dev/zero: is not a plain file", "give a .npz, .csv or .mem"),
    (f"{OBSERVE} --frames 5", "--frames", "give --sweep X0,X1"),
    ("pattern white-for-eye --display tiny.toml -o w.png", "white-for-eye", "--eye X,Y,Z"),
    ("pattern ramp --display tiny.toml -o w.png --eye 0,0,600", "--eye", "leave it out"),
    ("inspect --schema displays", "--schema", "'display'"),
    ("inspect tny.toml", "tny.toml: no such file", "did you mean tiny.toml?"),
    ("inspect tiny", "tiny: no such file", "did you mean tiny.toml?"),
    (RENDER.replace("ball", "bal"), "bal.xml: no such scene", "did you mean ball.xml?"),
    (OBSERVE.replace("image.exr", "image.png"), "image.png: no such image", "did you mean image.exr?"),
    (OBSERVE.replace("image.exr", "other.exr"), "other.exr: was made for display 'paper-square'", "--force"),
    ("inspect ball.xml", "ball.xml", "give a display file (.toml)"),
    (RENDER.replace(" -o a.exr", ""), "'-o'", "--help"),
    (OBSERVE.replace("0,0,600", "0,600"), "--eye", "give 3 finite numbers separated by commas"),
    (OBSERVE.replace("0,0,600", "1e300,0,600"), "eye: is farther away than 1e+09 mm", "such as 0,0,600"),
    (OBSERVE.replace("0,0,600", "0,0,-600"), "eye: z -600 mm is not in front of the display", "give z > 0"),
    (f"{OBSERVE} --sweep -30", "--sweep", "give 2 finite numbers separated by commas"),
    (f"{OBSERVE.replace('.png', '.mp4')}", "v.mp4", "give --sweep X0,X1 too, or choose from .exr"),
    (f"{OBSERVE} --sweep 5,x", "'5,x' is not X0,X1", "give 2 finite numbers"),
    ("pattern lens-centers --display tiny.toml -o w.png", "lens-centers", "did you mean lens-centres?"),
    (f"{RENDER} --samples 0", "samples 0", "give 1 to"),
    ("stream image.exr --port localhost:4000", "localhost:4000", "did you mean socket://localhost:4000?"),
    *((f"stream image.exr --port socket://127.0.0.1:1 --resume {time}", "--resume", "")
      for time in ("nan", "inf", "-1", "soon")),
    ("stream imag.exr --port /dev/no-such-port", "imag.exr: no such image", "did you mean image.exr?"),
    ("animate tiny.toml --display tiny.toml -o a.gif", "tiny.toml: gap_mm", "this is a display file, give a film file"),
    ("inspect latin.toml", "latin.toml: cannot be read (it is not text in UTF-8)", "give a display file (.toml)"),
    ("trace --display tiny.toml --pixels objects.npy -o r.npz", "objects.npy: cannot be read (it contains no array of",
     "give columns u, v"),
    (f"{RENDER} --memory-mb nan", "'--memory-mb': 'nan' is not finite", "give a finite number"),
    (f"{RENDER} --memory-mb much", "'--memory-mb'", "'much' is not a valid float"),
    (f"board check --display tiny.toml --region 0,0,{'9' * 400},1", "'--region'", "give 4 whole numbers"),
    ("board read dispaly", "dispaly: no such register", "did you mean display?"),
    ("board read optics.contrl", "optics.contrl: no such register", "did you mean optics.control?"),
    # Values of render's options.
    (f"{RENDER} --samples nan", "samples", ""),
    (f"{RENDER} --tolerance nan", "tolerance", "not finite; give"),
    (f"{RENDER} --tolerance 0", "tolerance 0.0", "give"),
    (f"{RENDER} --max-depth 0", "max depth 0", "give"),
    (f"{RENDER} --memory-mb 10", "tiny.toml: panel.width_px", "raise --memory-mb or use"),
    (f"{RENDER} --scale nan", "not finite", "give"),
    (f"{RENDER} --scale -1", "scale: -1 is not valid", "give"),
    (f"{RENDER} --rotate 1,2", "--rotate", "X,Y,Z"),
    (f"{RENDER} --offset 1,2,nan", "--offset", "finite"),
    (f"{RENDER} --depth inf", "not finite", "give"),
    (f"{RENDER} --near -5 --far 5", "near_mm -5 is not in front of far_mm 5", "raise near_mm"),
    (f"{RENDER} --integrator wizard", "integrator 'wizard'", "choose lights"),
    (f"{RENDER} --integrator ptracer", "integrator 'ptracer'", "choose lights"),
    (f"{RENDER} --seed -1", "--seed", ""),
    (f"{RENDER} --bogus", "--bogus", ""),
    (RENDER.replace("a.exr", "no/a.exr"), "no/a.exr: the folder no does not exist", "make the folder first"),
    (RENDER.replace("a.exr", "folder.exr"), "folder.exr: is a folder", "give"),
    (RENDER.replace("a.exr", "a.jpg"), "unknown extension '.jpg'", "choose from .exr"),
    # Values of observe's options.
    (OBSERVE.replace("0,0,600", "0,0,nan"), "--eye", "finite"),
    *((f"{OBSERVE} --{name} nan", f"--{name}", "finite")
      for name in ("pupil", "rotation-error", "gap-error", "pitch-scale")),
    (f"{OBSERVE} --focus inf", "--focus", "finite"),
    (f"{OBSERVE} --offset-error 1,inf", "--offset-error", "finite"),
    (f"{OBSERVE} --pupil -1", "pupil -1 mm is negative", ""),
    (f"{OBSERVE} --gap-error -100", "gap_mm", "negative; raise the gap error by"),
    (f"{OBSERVE} --pitch-scale 0", "pitch_scale", ""),
    (f"{OBSERVE} --sheet s.png", "--sheet", "--sweep"),
    (f"{OBSERVE} --width 0", "--width", ""),
    (f"{OBSERVE} --samples 0", "--samples", ""),
    (f"{OBSERVE} --frames 1", "--frames", ""),
    (f"{OBSERVE} --sweep -3,3 --frames 1000 --width 16384 -o v.gif", "1000 views", "--width"),
    (OBSERVE.replace("--eye 0,0,600 ", ""), "--eye", ""),
]  # fmt: skip


@pytest.mark.parametrize(("words", "named", "remedy"), COMMANDS, ids=[words for words, _, _ in COMMANDS])
def test_mistakes_in_a_command(place, refusal_of, words, named, remedy):
    before = sorted(place.iterdir())
    line = refusal_of(*words.split())
    assert named in line
    assert remedy in line[line.index(named) + len(named) :], line
    assert sorted(place.iterdir()) == before


def test_a_mistyped_field_of_a_board(place, refusal_of):
    with ModelBoard() as model:
        line = refusal_of("board", "write", "display", "patern=2", "--port", model.url)
        assert not model.writes
    assert "patern=2: display has no field patern; did you mean pattern?" in line
