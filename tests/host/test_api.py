"""The public Python interface: the ten lines of the docs in a script and in a notebook, and Mitsuba's variants."""

import base64
import html
import inspect
import io
import json
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import click
import drjit
import lippmann as lp
import mitsuba
import numpy as np
import pytest
from jupyter_client.manager import start_new_kernel
from lippmann.base.images import read_picture
from lippmann.base.tones import encoded_values
from lippmann.base.variant import current_device, start_mitsuba
from lippmann.base.variant import mitsuba as ours
from lippmann.cli import run
from lippmann.display.glass import index_of
from lippmann.errors import DeviceError, InputError
from model_board import ModelBoard
from PIL import Image
from scene_cases import display_toml, focused_display, glowing_sphere, write_scene

TOP = Path(__file__).parents[2]
FISH, SETUP = TOP / "scenes/layers/fish", TOP / "scenes/setups/fig8a.toml"
TEN_LINES = """\
import lippmann as lp
display = lp.load_display("vga-square.toml")
image = lp.render("fish.xml", display, samples=4)      # an IntegralImage: radiance, display, metadata
image.save("fish.exr")
lp.observe(image, eye=(20, 0, 600)).show()
with lp.Board.open("socket://127.0.0.1:4000") as board:
    board.show(image)                                  # identity, curve and bits checked
"""


@pytest.fixture
def place(tmp_path, monkeypatch, no_desktop):
    """A folder with the files that the ten lines name, and no desktop."""
    for source in (TOP / "scenes/fish").iterdir():
        (tmp_path / source.name).symlink_to(source)
    shutil.copy(TOP / "scenes/displays/vga-square.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check(place, model):
    """What the ten lines leave: a file for the display, and its frame on the board's panel."""
    display = lp.load_display("vga-square.toml")
    image = lp.IntegralImage.load("fish.exr", display)
    assert (image.metadata["samples"], image.metadata["scene"]) == ("4", "fish.xml")
    assert image.radiance.max() > 0.2
    frame = encoded_values(image.radiance, display.panel.transfer, display.panel.bits)
    # Half floats move a value by one step at most.
    assert np.abs(model.buffers[model.front].astype(int) - frame).max() <= 1
    assert model.buffers[model.front].any()


def board():
    display = lp.load_display("vga-square.toml")
    return ModelBoard(display.panel.width_px, display.panel.height_px, identity=int(display.identity, 16))


def lines_for(model):
    return TEN_LINES.replace("socket://127.0.0.1:4000", model.url)


def test_the_ten_lines_in_a_script(place):
    with board() as model:
        (place / "ten.py").write_text(lines_for(model))
        done = subprocess.run([sys.executable, "ten.py"], check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout == ""
        assert [line.split(":")[:2] for line in done.stderr.splitlines()] == [["lippmann", " not shown"]]
        check(place, model)


@pytest.fixture
def notebook(place, monkeypatch):
    """Run a program in a notebook's kernel, which prints nothing; return what it displays."""
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    manager, client = start_new_kernel(kernel_name="python3", cwd=str(place))

    def execute(program):
        outputs = []
        reply = client.execute_interactive(program, timeout=300, output_hook=outputs.append)
        assert reply["content"]["status"] == "ok", reply["content"]
        assert "stream" not in {one["msg_type"] for one in outputs}
        kinds = "display_data", "execute_result"
        return [one["content"]["data"] for one in outputs if one["msg_type"] in kinds]

    yield execute
    client.stop_channels()
    manager.shutdown_kernel(now=True)
    manager.cleanup_resources()


def test_a_notebook_shows_views_sweeps_and_pages(place, notebook):
    """The ten lines; `show` displays an animation; the page's frame holds the page that `view` writes."""
    with board() as model:
        (view,) = notebook(lines_for(model))
        check(place, model)
    assert "image/png" in view
    sweep, page = (
        output["text/html"]
        for output in notebook("""
lp.sweep(image, (-20, 0, 600), (20, 0, 600), 4, width_px=48, samples=2).show()
lp.view(image, "page.html")
lp.widget(image, height_px=300)
""")
    )
    data = base64.b64decode(re.fullmatch(r'<img src="data:image/png;base64,(.*)">', sweep)[1])
    with Image.open(io.BytesIO(data)) as animation:
        assert (animation.n_frames, animation.size[0]) == (6, 48)
    assert "height: 300px" in page
    assert html.unescape(re.search('srcdoc="(.*)"></iframe>', page, re.DOTALL)[1]) == (place / "page.html").read_text()


def test_a_sweep_is_what_the_eyes_see(small, mi, monkeypatch):
    image = lp.render("ball.xml", small, samples=1, device="llvm")
    sweep = lp.sweep(image, (-30, 0, 600), (30, 0, 600), 3, width_px=40)
    for view, x in zip(sweep.views, (-30, 0, 30), strict=True):
        assert (view.radiance == lp.observe(image, (x, 0, 600), width_px=40).radiance).all()
    sweep.save("a.gif")
    with Image.open("a.gif") as animation:
        assert animation.n_frames == 4
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    began = time.monotonic()
    sweep.show(0.3)
    assert time.monotonic() - began >= 0.3
    for said, end, count in (("count", (1, 0, 600), 1), ("end", (1, 0), 21)):
        with pytest.raises(InputError, match=said):
            lp.sweep(image, (0, 0, 600), end, count)


@pytest.fixture
def small(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    display = focused_display("square", width_px=60, height_px=40, pixel_pitch=0.2)
    (tmp_path / "d.toml").write_text(display_toml(display))
    write_scene(tmp_path / "ball.xml", glowing_sphere((0.5, 0.3, 0.0), 2.0, (0.2, 0.5, 0.9)))
    return lp.load_display("d.toml")


def test_the_command_renders_what_the_function_returns(small, capfd, mi, caplog):
    caplog.set_level("INFO", "lippmann")
    image = lp.render("ball.xml", "d.toml", samples=3, seed=5, aperture="full", device="llvm")
    assert image.display == small
    assert image.measured["seconds"] > 0.0
    assert caplog.messages[0].startswith(f"model {image.metadata['model']}: the cheapest")
    words = "render ball.xml --display d.toml -o c.tif --samples 3 --seed 5 --aperture full --device llvm --json"
    assert run(words.split()) == 0
    saved = lp.IntegralImage.load("c.tif", small)
    np.testing.assert_array_equal(saved.radiance, image.radiance)
    assert saved.metadata == image.metadata
    # A scene that was loaded once, placed elsewhere.
    scene = lp.load_scene("ball.xml", device="llvm")
    again = lp.render(scene, small, samples=3, seed=5, aperture="full")
    np.testing.assert_array_equal(again.radiance, image.radiance)
    moved = lp.render(scene, small, samples=3, seed=5, placement=lp.Placement(offset_mm=(0.0, 0.0, 9.0)))
    there = lp.render("ball.xml", small, samples=3, seed=5, placement=lp.Placement(offset_mm=(0.0, 0.0, 9.0)))
    np.testing.assert_array_equal(moved.radiance, there.radiance)
    assert not np.array_equal(moved.radiance, image.radiance)


def test_the_command_observes_what_the_function_returns(small, capfd, mi):
    image = lp.render("ball.xml", small, device="llvm")
    image.save("a.tif")
    built = small.misaligned(rotation_deg=0.3)
    view = lp.observe(image, (5.0, 1.0, 300.0), 4.0, 2.0, 50, 4, display=built, seed=2, device="llvm")
    words = "observe a.tif --display d.toml --eye 5,1,300 --pupil 4 --focus 2 --width 50 --samples 4 --seed 2"
    assert run([*words.split(), "--rotation-error", "0.3", "-o", "v.tif", "--device", "llvm"]) == 0
    saved = read_picture("v.tif")
    np.testing.assert_array_equal(saved.radiance, view.radiance)
    assert saved.metadata == {**view.metadata, "view_of": "a.tif"}
    assert view.radiance.max() > 0.1


@pytest.fixture
def few_samples(monkeypatch):
    monkeypatch.setattr("lippmann.eye.many_views.SAMPLES", 1)


def test_the_command_writes_the_page_of_the_function(small, capfd, mi, few_samples):
    image = lp.render("ball.xml", small, device="llvm")
    image.save("a.tif")
    assert lp.view(image, "one.html", "ball.xml", title="a", device="llvm") == Path("one.html")
    words = "view a.tif --display d.toml -o two.html --scene ball.xml --device llvm"
    assert run(words.split()) == 0
    assert Path("one.html").read_bytes() == Path("two.html").read_bytes()


def test_without_a_path_a_browser_opens_the_page(small, monkeypatch, mi):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    image = lp.IntegralImage(np.zeros((40, 60, 3), np.float32), small)
    path = lp.view(image)
    assert opened == [path.as_uri()]
    shutil.rmtree(path.parent)


def test_the_command_captures_what_the_function_returns(tmp_path, capfd, monkeypatch, mi):
    setup = TOP / "scenes/setups/fig8a.toml"
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path / "ball.xml", glowing_sphere((5.0, 5.0, -5.0), 4.0))
    words = "capture ball.xml -o c.tif --samples 1 --size 600 --device llvm --json --setup"
    assert run([*words.split(), str(setup)]) == 0
    told = json.loads(capfd.readouterr().out)
    image = lp.capture("ball.xml", lp.load_setup(setup).resized(600), samples=1, device="llvm")
    saved = lp.IntegralImage.load("c.tif", image.display)
    np.testing.assert_array_equal(saved.radiance, image.radiance)
    assert saved.metadata == image.metadata
    for key in ("vignetting_percent", "array_loss_percent"):
        assert told[key] == image.measured[key]


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral"])
def test_a_users_variant_neither_matters_nor_changes(small, mi, few_samples, variant):
    expected = lp.render("ball.xml", small, device="llvm")
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Warn)
    try:
        image = lp.render("ball.xml", small, device="llvm")
        np.testing.assert_array_equal(image.radiance, expected.radiance)
        lp.observe(image, samples=1, width_px=20, device="llvm")
        lp.view(image, "page.html", lp.load_scene("ball.xml", device="llvm"))
        for scene, integrator in (("none.xml", "lights"), ("ball.xml", "none")):
            with pytest.raises(InputError):
                lp.render(scene, small, integrator=integrator, device="llvm")
        assert mitsuba.variant() == variant
        assert mitsuba.log_level() == mitsuba.LogLevel.Warn
    finally:
        mitsuba.set_variant("llvm_ad_rgb")
        mitsuba.set_log_level(mitsuba.LogLevel.Error)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"model": "thick"}, "unknown model 'thick'; choose from auto, pinhole"),
        ({"engine": "slow"}, "unknown engine 'slow'; choose from golden"),
        ({"fraction_bits": 20}, r"fraction_bits belongs to the engines twin and rtl"),
        ({"samples": 0}, "samples 0 is out of range"),
        ({"samples": 65537}, "samples 65537 is out of range"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**32}, "seed"),
        ({"max_depth": 0}, "max depth 0"),
        ({"aperture": "half"}, "aperture"),
        ({"shading": "none"}, "unknown shading 'none'; choose from auto, each, shared"),
        *(({"tolerance": tolerance}, "tolerance") for tolerance in (-1.0, float("inf"), "x")),
        ({"integrator": ""}, "integrator.*choose lights"),
        ({"device": "tpu"}, "unknown device 'tpu'"),
        ({"placement": "x.toml"}, "placement must be a lippmann.Placement or None, not 'x.toml'"),
        ({"memory_mb": float("nan")}, "memory_mb nan is not a limit"),
        ({"engine": "twin", "fraction_bits": 14.0}, r"fraction_bits: 14\.0 is not valid; give a whole number from 14"),
        ({"kept": ""}, "'' is not a path; give the path of a folder for kept bands"),
        ({"scheduler": ""}, "scheduler '' is not an address; give tcp://"),
        ({"model": "pinhole", "tolerance": "x"}, "tolerance 'x' is not positive and finite"),
        ({"kept": 5}, "'5' is not a folder for kept bands; give its path"),
        ({"progress": 5}, "progress 5 is not a function; give one that takes"),
        ({"memory_mb": 1.0}, "display 'case': panel.width_px, panel.height_px: an image of 60 x 40 pixels: needs"),
    ],
)
def test_bad_values(small, mi, values, said):
    with pytest.raises(InputError, match=said):
        lp.render("ball.xml", small, **{"device": "llvm", **values})


@pytest.mark.parametrize("rate", [float("nan"), float("inf"), 0.0, -12.0, "12"])
def test_a_page_of_no_frame_rate_is_refused(plain, rate):
    with pytest.raises(InputError, match=r"frames_per_second .* is out of range; give a finite number, 0\.1 or more"):
        lp.view(plain, "page.html", frames_per_second=rate)
    assert not Path("page.html").exists()


def test_who_refuses_the_first_progress_lets_go_of_the_bands(small, mi, tmp_path):
    """The caller holds the exception, as a notebook does."""

    def refuse(done, total):
        raise RuntimeError(f"{done} of {total}")

    with pytest.raises(RuntimeError, match="0 of 40") as caught:
        lp.render("ball.xml", small, device="llvm", kept=tmp_path / "new" / "kept", progress=refuse)
    image = lp.render("ball.xml", small, device="llvm", kept=tmp_path / "new" / "kept")
    assert image.radiance.shape == (40, 60, 3)
    assert caught.value is not None


@pytest.fixture
def plain(small):
    return lp.IntegralImage(np.full((40, 60, 3), 0.5, np.float32), small)


@pytest.mark.parametrize("value", [2.5, "4", True, np.float64(3.0)])
def test_counts_are_whole_numbers(small, plain, mi, value):
    calls = {lp.render: ("ball.xml", small), lp.observe: (plain,)}
    names = {lp.render: ("samples", "seed", "max_depth"), lp.observe: ("samples", "seed", "width_px")}
    for function, arguments in calls.items():
        for name in names[function]:
            said = rf"^{name.replace('_', '[ _]')} {re.escape(repr(value))} is not a whole number"
            with pytest.raises(InputError, match=said):
                function(*arguments, device="llvm", **{name: value})


def test_numpys_integers_are_whole_numbers(plain, mi):
    views = [
        lp.observe(plain, samples=kind(4), seed=kind(3), width_px=kind(20), device="llvm").radiance
        for kind in (int, np.int64, np.uint8)
    ]
    np.testing.assert_array_equal(views[1:], views[:1] * 2)


@pytest.mark.parametrize(
    ("eye", "others", "said"),
    [
        ((20, 600), {}, r"eye: \(20, 600\) is not a position; give \(x, y, z\) in mm"),
        ((0, 20, 600, 1), {}, "is not a position"),
        ((0, 0, 0), {}, "eye: z 0 mm is not in front of the display"),
        (600, {}, "eye: 600 is not a position"),
        ("0,0,600", {}, "eye: 0,0,600 is not a position"),
        ((0, (20, 1), 600), {}, "is not finite; give numbers in mm"),
        ((0, "20", 600), {}, "is not finite; give numbers in mm"),
        ((0, np.nan, 600), {}, "is not finite; give numbers in mm"),
        ((0, 0, 600), {"pupil_mm": "4"}, "is not finite; give numbers in mm"),
        ((0, 0, 600), {"focus_z_mm": None}, "is not finite; give numbers in mm"),
        ((0, 0, 600), {"window": 5}, r"window must be a rendering\.sampling\.Window or None, not '5'"),
    ],
)
def test_an_eye_is_a_position(plain, mi, eye, others, said):
    with pytest.raises(InputError, match=said):
        lp.observe(plain, eye, device="llvm", **others)


WORDS = "fraction_bits .*belongs to the engines twin and rtl; leave it .*"
NO_IMAGE = r"'a\.exr' is not an IntegralImage; load a file with lippmann\.IntegralImage\.load\(path, display\)"


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: lp.load_display(None), "'None' is not a display file; give its path"),
        (lambda: lp.load_scene(None), "'None' is not a scene; give its path"),
        (lambda: lp.load_setup(None), "'None' is not a set-up file; give its path"),
        (lambda: lp.load_layers(None), "'None' is not a folder of layers; give its path"),
        (lambda: lp.trace("d.toml", [[5, 5]], engine="golden", fraction_bits=0), rf"{WORDS}golden"),
        (lambda: lp.trace("d.toml", [[5, 5]], engine="fast", fraction_bits=18), rf"{WORDS}fast"),
        (lambda: lp.trace("d.toml", "a"), r"pixels is not an array of numbers; give shape \(N, 2\)"),
        (lambda: lp.observe("a.exr", device="llvm"), NO_IMAGE),
        (lambda: lp.view("a.exr", "a.html", device="llvm"), NO_IMAGE),
    ],
)
def test_arguments_that_are_refused(small, mi, call, said):
    with pytest.raises(InputError, match=said):
        call()


#: Calls with an argument of a wrong type, and what the error says.
WRONG = [
    (lambda _: lp.load_scene(""), "'' is not a path; give the path of a scene"),
    (lambda _: lp.load_display(""), "'' is not a path; give the path of a display file"),
    (lambda p: lp.observe(p, crosstalk="x"), "crosstalk must be True or False, not 'x'"),
    (lambda p: lp.IntegralImage.load("a.exr", p.display, force="no"), "force must be True or False, not 'no'"),
    (lambda p: lp.IntegralImage.load("a.exr", p.display, stored=1), "stored must be True or False, not '1'"),
    (lambda _: lp.load_scene("ball.xml", 3), r"placement must be a lippmann\.Placement or None, not '3'"),
    (lambda _: lp.load_scene("ball.xml", device="llvm").placed(3), r"placement must be a lippmann\.Placement, not '3'"),
    (lambda _: lp.parse_display(3), "text must be text, not '3'"),
    (lambda p: replace(p, metadata=3), "metadata must be a dictionary, not '3'"),
    (lambda p: replace(p, measured=[]), "measured must be a dictionary"),
    (lambda p: lp.IntegralImage([[1, 2], [3]], p.display), "radiance is not an array; give"),
    (lambda p: replace(p.display, panel=3), "Display: panel must be lippmann's Panel, not '3'"),
    (lambda p: p.show("x"), "seconds x is not a duration"),
    (lambda p: lp.view(p, "p.html", later=3), r"later must be a list of lippmann\.IntegralImage, not '3'"),
    (lambda p: lp.view(p, "p.html", title=3), "title must be text, not '3'"),
    (lambda p: lp.view(p, "p.html", seed="x"), "seed 'x' is not a whole number"),
    (lambda p: lp.view(p, "p.html", arrange="fit"), "placement and arrange need a scene; give scene too"),
    (lambda p: lp.sweep(p, [[1, 2], [3]], (0, 0, 600)), "start .* is not a position"),
    (lambda p: lp.observe(p, pupil_mm=10**400), "is not finite; give numbers in mm"),
    (lambda p: lp.trace(p.display, 10**400), "pixels is not an array of numbers"),
    (lambda p: lp.trace(p.display, [[1, 1]], device="cuda"), "device cuda belongs to the engine fast; leave it out"),
    (lambda p: lp.trace(p.display, [[1, 1]], engine="twin", device=3), "unknown device '3'"),
    (lambda p: p.display.at_wavelength("x"), "without dispersion"),
    (lambda p: p.display.misaligned(pitch_scale=0), "pitch_scale: 0 is not valid; give a finite number, more than 0"),
    (lambda _: index_of("N-BK7", "x"), "wavelength x nm is out of range; give"),
    (lambda _: lp.LayerStack(3), r"layers must be a list of lippmann\.Layer, not '3'"),
    (lambda _: lp.load_layers(FISH).moved(scale="x"), "scale x is out of range"),
    (lambda _: lp.load_layers(FISH).moved(offset_mm=(1,)), r"offset_mm has shape \(1,\); give \(x, y, z\) in mm"),
    (lambda _: lp.load_layers(FISH).moved(2.0, "x"), "offset_mm has an entry that is not a number; give"),
    (lambda _: lp.load_setup(SETUP).resized("x"), "size 'x' is not a whole number"),
    (lambda _: lp.capture("ball.xml", SETUP, rotate="x"), "rotate must be True or False, not 'x'"),
    (lambda _: lp.Board.open("loop://", baud="x"), "the baud rate x is not positive"),
]


@pytest.mark.parametrize(("call", "said"), WRONG, ids=[said for _, said in WRONG])
def test_arguments_of_a_wrong_type(plain, mi, call, said):
    plain.save("a.exr")
    with pytest.raises(InputError, match=said):
        call(plain)


def test_a_board_refuses_arguments_of_a_wrong_type(plain):
    model = ModelBoard(60, 40, identity=int(plain.display.identity, 16))
    with model, lp.Board.open(model.url) as link:
        for call, said in (
            (lambda: link.show(plain, progress=3), "progress 3 is not a function"),
            (lambda: link.show(plain, force="no"), "force must be True or False, not 'no'"),
            (lambda: link.show_render(3), "plan must be a plan of a render"),
            (lambda: link.write_optics(3), r"display must be a lippmann\.Display, not '3'"),
        ):
            with pytest.raises(InputError, match=said):
                call()


def test_a_display_may_be_given_as_its_path(plain, small, mi):
    pixels = [[30.5, 20.25], [3.0, 39.5]]
    rays, wanted = lp.trace("d.toml", pixels), lp.trace(small, pixels)
    np.testing.assert_array_equal(rays.direction, wanted.direction)
    hits = lp.trace_to_panel(Path("d.toml"), rays.origin_mm, -rays.direction)
    np.testing.assert_array_equal(hits.pixel, lp.trace_to_panel(small, rays.origin_mm, -rays.direction).pixel)
    plain.save("a.tif")
    assert lp.IntegralImage.load("a.tif", "d.toml").display == small
    views = [lp.observe(plain, width_px=9, display=one, device="llvm").radiance for one in ("d.toml", small)]
    np.testing.assert_array_equal(*views)
    for display, said in (("e.toml", r"e\.toml: no such file"), (7, "'7' is not a display file; give its path")):
        with pytest.raises(InputError, match=said):
            lp.trace(display, pixels)


def test_a_board_that_was_closed(small):
    with ModelBoard(60, 40, identity=int(small.identity, 16)) as model:
        with lp.Board.open(model.url) as link, pytest.raises(InputError, match=NO_IMAGE):
            link.show("a.exr")
        with pytest.raises(DeviceError, match=rf"{model.url}: the line to the board is closed; open the board again"):
            link.show(lp.IntegralImage(np.zeros((40, 60, 3), np.float32), small))


#: Options of the command line and parameters of the functions that the page lists as differing.
RENAMED = re.compile(r"^\| (`--[^|]+) \| `([^|]+)` \|$", re.M)
#: Options that say where a command reads or writes, which a function has as a return value or an argument; --filter is
#: an argument of `lp.draw`. Functions return pictures in memory, which are not shared among processes.
FILES = {
    "render": {"display", "o", "json", "filter", "workers", "scheduler"},
    "capture": {"setup", "o", "json", "size", "display_out"},
    "observe": {"display", "o", "json", "sweep", "frames", "sheet", "force"},
    "view": {"display", "o", "json", "direct", "scene", "serve", "tcp_port", "force"},
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_the_page_names_the_options_that_differ(name):
    """An option has the name of a parameter, or stands in the page's table with a parameter that exists."""
    page = (TOP / "docs/reference/python.md").read_text()
    renamed = {}
    for options, parameter in RENAMED.findall(page):
        for option in re.findall(r"--[a-z-]+", options):
            renamed[option] = re.match(r"\w+", parameter)[0]
    assert renamed
    taken = inspect.signature(getattr(lp, name)).parameters
    for option in import_module(f"lippmann.cli.{name}").command.params:
        if isinstance(option, click.Argument):
            continue
        flag = option.opts[0]
        word = flag.strip("-").replace("-", "_")
        if word not in FILES[name]:
            assert word in taken or renamed.get(flag) in taken, flag


def test_a_scene_belongs_to_its_device(small, mi):
    scene = lp.load_scene("ball.xml", device="llvm")
    with pytest.raises(InputError, match="loaded for device 'llvm', not 'cuda'; give 'llvm', or load it again"):
        lp.render(scene, small, device="cuda")


def test_names_are_public():
    assert {"load_display", "render", "capture", "observe", "view", "trace", "Board", "IntegralImage"} <= set(dir(lp))
    assert all(getattr(lp, name) is not None for name in lp.__all__)


def test_importing_loads_nothing_large():
    """Nor scipy for a render, which took as long to load as everything else of its command."""
    code = """
import sys, lippmann
assert not {"numpy", "mitsuba", "PIL", "click"} & sys.modules.keys()
import lippmann.cli.render
assert "scipy" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.fixture
def kept():
    """Set this worker's variant again at the end."""
    before = mitsuba.variant()
    yield
    mitsuba.set_variant(before or "llvm_ad_rgb")


def test_each_start_sets_the_variant_again(mi, kept):
    """Starting was remembered by device, so that a variant set in between stayed."""
    assert start_mitsuba("llvm") == "llvm"
    mitsuba.set_variant("scalar_rgb")
    assert start_mitsuba("llvm") == "llvm"
    assert mitsuba.variant() == "llvm_ad_rgb"
    assert current_device() == "llvm"


def test_another_variant_is_named(mi, kept):
    mitsuba.set_variant("scalar_rgb")
    with pytest.raises(InputError, match="variant is scalar_rgb"):
        ours()


def test_dr_jit_is_as_it_comes_while_the_variant_is_set(mi, kept, monkeypatch):
    syntax, set_variant, seen = drjit.syntax, mitsuba.set_variant, []
    monkeypatch.setattr(mitsuba, "set_variant", lambda name: seen.append(drjit.syntax) or set_variant(name))
    start_mitsuba("llvm")
    assert seen == [syntax]
