"""The viewer page as a text: nothing from outside, a label for each control, the panel's own pixels, bad input."""

import base64
import dataclasses
import io
import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from html_page import HtmlPage
from lippmann.base.images import write_picture
from lippmann.base.tones import decode
from lippmann.cli import run
from lippmann.display.description import Panel, load_display
from lippmann.errors import InputError
from lippmann.eye import viewer_page
from lippmann.eye.many_views import grid_of_eyes
from lippmann.eye.viewer_page import SCRIPTS, SHADERS, Direct, eye_reach_mm, focus_reach_mm, page_html, sliders
from lippmann.optics.display_properties import display_properties
from optics_cases import GRIDS, SIDES, random_display
from PIL import Image
from scene_cases import display_toml, focused_display, generator, glowing_sphere, write_scene
from test_cli import lippmann

SEED = 1702
VIEW = Path(viewer_page.__file__).parent / "page_files"
SHIPPED = sorted((Path(__file__).parents[2] / "scenes/displays").glob("*.toml"))
WIDTH, HEIGHT = 64, 48


def small(grid="square", **others):
    return focused_display(grid, width_px=WIDTH, height_px=HEIGHT, pixel_pitch=0.1, **others)


def values(*key):
    return generator(SEED, *key).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def light(panel_values):
    return decode(panel_values / 255.0, "srgb")


@pytest.fixture(scope="module")
def page():
    direct = Direct((10.0, -5.0, 600.0), light(values("direct")))
    return page_html(small(), light(values("panel")), 'A <fish> & "co" </script>', [direct])


def picture_of(text):
    png = base64.b64decode(text.removeprefix("data:image/png;base64,"))
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def panel_of(page, across=1):
    """The panel's pictures, in rows of `across`."""
    texts = re.findall(r'<script type="text/plain" class="panel-tile" data-frame="0">([^<]*)</script>', page)
    tiles = [picture_of(text) for text in texts]
    return [tiles[k : k + across] for k in range(0, len(tiles), across)]


def test_the_panel_travels_value_by_value(page):
    """8-bit panel values come through light and back without a change."""
    reader = HtmlPage(page)
    np.testing.assert_array_equal(panel_of(page)[0][0], values("panel"))
    (direct,) = json.loads(reader.texts["directs"])
    assert direct["eye_mm"] == [10.0, -5.0, 600.0]
    np.testing.assert_array_equal(picture_of(direct["png"]), values("direct"))


@pytest.mark.parametrize(("limit", "across", "width", "height"), [(20, 4, 16, 16), (30, 3, 22, 24), (63, 2, 32, 48)])
def test_a_large_panel_travels_in_tiles(monkeypatch, limit, across, width, height):
    """Tiles of one size, at most the limit; those at the right and at the bottom may be smaller."""
    monkeypatch.setattr("lippmann.eye.viewer_page.TILE_PX", limit)
    rows = panel_of(page_html(small(), light(values("panel")), "x"), across)
    assert rows[0][0].shape == (height, width, 3)
    np.testing.assert_array_equal(np.vstack([np.hstack(row) for row in rows]), values("panel"))


def test_a_panel_that_no_browser_holds_is_refused():
    display = dataclasses.replace(small(), panel=Panel(32768, 18432, 0.05))
    nothing = np.broadcast_to(np.float32(0.0), (18432, 32768, 3))
    with pytest.raises(InputError, match=r"32768 x 18432 pixels are more than browsers can show.*; show a smaller"):
        page_html(display, nothing, "x")


def test_nothing_comes_from_outside(page):
    """No address of any kind; and the page's own policy would forbid what a change brings in."""
    shell = re.sub(r"data:image/png;base64,[\w+/=]+", "", page)
    assert not re.findall(
        r"https?:|//[\w-]+\.\w|@import|url\(|importScripts|\bimport\b", re.sub(r"^\s*//.*", "", shell, flags=re.M)
    )
    reader = HtmlPage(page)
    for attributes in (attributes for _, attributes in reader.elements):
        assert not {"src", "href", "srcset", "data", "action", "poster"} & set(attributes)
    (policy,) = [a["content"] for a in reader.named("meta") if a.get("http-equiv") == "Content-Security-Policy"]
    assert policy.startswith("default-src 'none';")
    assert set(re.findall(r"[\w-]+:", policy)) == {"data:", "blob:"}


def test_a_title_stays_text(page):
    assert "<title>A &lt;fish&gt; &amp; &quot;co&quot; &lt;/script&gt;</title>" in page
    named = dataclasses.replace(small(), name="</script><b>")
    assert "</script><b>" not in page_html(named, light(values("panel")), "x")


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        ({"grid": "square"}, {"PLANO_TO_PANEL": "1"}),
        ({"grid": "hex", "side": "viewer"}, {"HEX": "1"}),
        ({"grid": "hex", "subpixels": "bgr"}, {"HEX": "1", "PLANO_TO_PANEL": "1", "EMITS": "1", "SUBPIXELS": "3"}),
    ],
)
def test_shaders_are_made_for_the_display(others, expected):
    page = page_html(small(**others), light(values("panel")), "x")
    shaders = json.loads(HtmlPage(page).texts["shaders"])
    assert set(shaders) == set(SHADERS)
    for source in shaders.values():
        assert source.startswith("#version 300 es\n")
        lines = itertools.takewhile(lambda line: line.startswith("#define "), source.splitlines()[1:])
        defined = dict(line.removeprefix("#define ").split(" ", 1) for line in lines)
        assert expected.items() <= defined.items()
        assert "subpixels" in others or defined.keys() - {"GLANCE"} == expected.keys()
        assert "#include" not in source


def test_every_file_is_used():
    """Each shader file is reached from one that is compiled, each script is in the page."""
    reached, todo = set(), list(SHADERS)
    while todo:
        name = todo.pop()
        reached.add(name)
        todo += viewer_page.INCLUDE.findall((VIEW / "shaders" / name).read_text())
    assert reached == {file.name for file in (VIEW / "shaders").iterdir()}
    assert sorted(SCRIPTS) == sorted(file.stem for file in (VIEW / "scripts").iterdir())


def test_templates_refuse_wrong_values():
    assert viewer_page.fill_template(
        "slider.html", **dict.fromkeys(("id", "label", "unit", "low", "high", "step", "value"), "@@id@@")
    )
    with pytest.raises(ValueError, match="placeholders"):
        viewer_page.fill_template("slider.html", id="x")


@pytest.fixture(scope="module")
def displays():
    """Displays, random and shipped, each with its properties and its groups of sliders."""
    rng = generator(SEED, "displays")
    drawn = [random_display(rng, grid, side) for grid in GRIDS for side in SIDES for _ in range(25)]
    found = [(display, display_properties(display)) for display in (*drawn, *map(load_display, SHIPPED))]
    return [(display, derived, sliders(display)) for display, derived in found]


def test_sliders_start_on_one_of_their_steps(displays):
    """A browser moves a value that lies between two steps, counted from the low end."""
    for _, _, groups in displays:
        for slider in (one for group in groups.values() for one in group):
            assert slider.low <= slider.value <= slider.high, slider
            steps = (slider.value - slider.low) / slider.step
            assert abs(steps - round(steps)) < 1e-6, slider
            assert '"-0"' not in slider.html()


def test_sliders_stay_within_what_can_be_built(displays):
    for display, _, groups in displays:
        built = {slider.id: slider for slider in groups["The array as built"]}
        for end in ("low", "high"):
            at = {key: getattr(slider, end) for key, slider in built.items()}
            display.misaligned(at["rotation"], (at["offset-x"], at["offset-y"]), at["gap"], at["pitch-scale"])


def test_the_eye_goes_beyond_the_viewing_zone_and_the_focus_not_to_the_eye(displays):
    for display, derived, groups in displays:
        # |C - ex| D / 600 > p / 2 at the panel's far edge, C = -w / 2, too: all lenslets show neighbours' images.
        least = 0.5 * display.panel.width_mm + 600.0 * math.tan(math.radians(derived.crosstalk_angle_deg))
        assert eye_reach_mm(display) >= least * (1.0 - 1e-12)
        nearest = next(s.low for s in groups["Eye"] if s.id == "eye-z")
        assert 0.0 < focus_reach_mm(display) < nearest


def test_direct_eyes_stand_in_the_viewing_zone():
    for path in SHIPPED:
        display = load_display(path)
        eyes = np.array(grid_of_eyes(display))
        assert eyes.shape == (21, 3)
        assert np.abs(eyes - (0.0, 0.0, 600.0)).max(axis=1).min() < 1e-9
        assert np.abs(eyes[:, 0]).max() == pytest.approx(max(display_properties(display).viewing_zone_mm, 30.0))


@pytest.mark.parametrize("shape", [(WIDTH, HEIGHT, 3), (HEIGHT, WIDTH, 4), (HEIGHT, WIDTH + 1, 3)])
def test_a_picture_of_another_size_is_refused(shape):
    with pytest.raises(InputError, match=rf"{shape[1]} x {shape[0]}.*{WIDTH} x {HEIGHT}"):
        page_html(small(), np.zeros(shape, np.float32), "x")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a display, its image, a direct render, and what is wrong with others."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(display_toml(small()))
    (tmp_path / "other.toml").write_text(display_toml(small(focal=3.0)))
    identity = {"identity": load_display("small.toml").identity}
    write_picture("a.png", light(values("panel")), identity)
    write_picture("direct.png", light(values("direct")), {})
    write_picture("wide.png", np.zeros((20, 40, 3), np.float32), {})
    write_scene(tmp_path / "ball.xml", glowing_sphere((0.0, 0.0, -5.0), 2.0))
    (tmp_path / "text.png").write_text("no picture")
    return tmp_path


def test_the_command_writes_the_page(place, capfd):
    words = ("view", "a.png", "--display", "small.toml", "--direct", "10,0,600", "direct.png", "--title", "T", "--json")
    code, out, _ = lippmann(capfd, *words)
    assert code == 0
    told = json.loads(out)
    page = (place / "a.html").read_bytes()
    assert told["output"] == "a.html"
    assert told["bytes"] == len(page)
    assert told["direct_views"] == 1
    assert told["identity"] == load_display("small.toml").identity
    assert b"<title>T</title>" in page
    assert sorted(p.name for p in place.glob(".*")) == []


def test_a_scene_is_rendered_from_the_grid_of_eyes(place, capfd, mi, monkeypatch):
    monkeypatch.setattr("lippmann.eye.many_views.SAMPLES", 1)
    words = ("view", "a.png", "--display", "small.toml", "--scene", "ball.xml", "--device", "llvm", "-o", "p.html")
    code, out, err = lippmann(capfd, *words, "--json")
    assert code == 0, err
    assert json.loads(out)["direct_views"] == 21
    directs = json.loads(HtmlPage((place / "p.html").read_text()).texts["directs"])
    assert [tuple(d["eye_mm"]) for d in directs] == grid_of_eyes(load_display("small.toml"))
    middle = picture_of(directs[10]["png"])
    assert middle.shape == (300, 400, 3)
    # The sphere before the axis, white in the middle and nothing round it.
    assert (middle[150, 200].tolist(), middle[5, 5].tolist()) == ([255] * 3, [0] * 3)
    # Stood elsewhere, as `render` was told to: aside of the panel's window, 6.4 mm wide. Its middle eye tells.
    for module in ("lippmann.eye.many_views", "lippmann.cli.view"):
        monkeypatch.setattr(f"{module}.grid_of_eyes", lambda display: grid_of_eyes(display)[10:11])
    code, _, err = lippmann(capfd, *words, "--offset", "-100,0,0")
    assert code == 0, err
    (moved,) = (direct["png"] for direct in json.loads(HtmlPage((place / "p.html").read_text()).texts["directs"]))
    assert picture_of(moved)[150, 200].tolist() == [0] * 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("none.png",), "no such image"),
        (("text.png",), "not an image"),
        (("wide.png",), "40 x 20"),
        (("direct.png",), "names no display"),
        (("a.png", "--display", "other.toml"), "--force"),
        (("a.png", "-o", "a.png"), "unknown extension"),
        (("a.png", "-o", "none/a.html"), "does not exist"),
        (("a.png", "--serve", "-o", "a.html"), "-o"),
        (("a.png", "--tcp-port", "8000"), "--serve"),
        (("a.png", "--direct", "0,0,600", "wide.png"), "wide.png.*40 x 20"),
        (("a.png", "--direct", "0,0,-600", "direct.png"), "not in front of the display"),
        (("a.png", "--direct", "0,0", "direct.png"), "X,Y,Z"),
        (("a.png", "--direct", "0,0,600", "none.png"), "none.png"),
        (("a.png", "--scene", "none.xml"), "none.xml"),
        (("a.png", "--depth", "3"), "--depth belongs to --scene"),
    ],
)
def test_bad_input_is_one_line(place, refusal_of, words, message):
    display = () if "--display" in words else ("--display", "small.toml")
    assert re.search(message, refusal_of("view", *words, *display))
    assert not list(place.glob("*.html"))


def test_a_folder_of_frames_is_a_film(tmp_path, capsys):
    """Each frame's own pixels, in the order of their names, and the rate; a folder without frames is refused."""
    (tmp_path / "d.toml").write_text(display_toml(small()))
    folder = tmp_path / "frames"
    folder.mkdir()
    common = ["--display", str(tmp_path / "d.toml"), "-o", str(tmp_path / "p.html")]
    assert run(["view", str(folder), *common]) == 2
    assert "without frames" in capsys.readouterr().err
    identity = load_display(tmp_path / "d.toml").identity
    for number in (1, 0, 2):
        write_picture(folder / f"frame_{number:04d}.exr", light(values("frame", number)), {"identity": identity})
    assert run(["view", str(folder), *common, "--frames-per-second", "24"]) == 0
    page = (tmp_path / "p.html").read_text()
    assert 'data-rate="24"' in page
    for number in range(3):
        (text,) = re.findall(rf'class="panel-tile" data-frame="{number}">([^<]*)</script>', page)
        assert np.abs(picture_of(text).astype(int) - values("frame", number)).max() <= 1
