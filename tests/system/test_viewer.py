"""The viewer page in headless Chromium, WebGL in software, against `observe` and the golden tracer."""

import base64
import dataclasses
import io
import itertools
import json
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from lippmann.base.images import write_picture
from lippmann.base.tones import decode, encode, psnr_db
from lippmann.base.variant import mitsuba, start_mitsuba
from lippmann.display.description import Array, Display, Panel, load_display
from lippmann.engines import trace
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.eye.viewer_page import Direct, page_html
from lippmann.optics.rays import Status
from lippmann.optics.trace import trace_to_panel
from PIL import Image
from tools.browser import browser_page

GRIDS, SIDES = ("square", "hex"), ("panel", "viewer")
ROOT = Path(__file__).parents[2]
SEED = 77
AS_DESIGNED = {"rotation": 0.0, "offset": [0.0, 0.0], "gap": 0.0, "pitchScale": 1.0}
LEAST_DB = 40.0
#: Differences that one pixel may have: half a step of 8 bits in each of both pictures' roundings.
STEP = 1.01 / 255


#: An array as nobody draws one, which ends on the panel.
SKEWED = {"pitch_mm": (1.0, 1.15), "shear": 0.12, "extent_mm": (10.2, 7.0)}


LENS = {"radius_mm": 1.65, "index": 1.5, "thickness_mm": 0.8, "offset_mm": (0.03, -0.07)}


def small(grid="square", side="panel", gap=3.0, rotation=0.0, skewed=False, **panel):
    """13 x 10 lenslets of f/3.3, the panel some way off focus."""
    more = SKEWED if skewed else {"pitch_mm": 1.0}
    return Display(
        f"{grid}-{side}",
        Panel(**{"width_px": 260, "height_px": 200, "pixel_pitch_mm": 0.05, **panel}),
        Array(grid=grid, plano_side=side, rotation_deg=rotation, **LENS, **more),
        gap,
    )


def painted(display, seed=SEED):
    """Panel light with edges everywhere: random values, as the page keeps them (8 bits)."""
    panel = display.panel
    rng = np.random.default_rng(seed)
    print(f"numpy.random.default_rng({seed})")
    return decode(rng.integers(0, 256, (panel.height_px, panel.width_px, 3)) / 255.0, "srgb")


@pytest.fixture(scope="module")
def mi():
    start_mitsuba("llvm")
    return mitsuba()


@pytest.fixture(scope="module")
def browser():
    with browser_page() as page:
        yield page


def open_page(browser, folder, page):
    """Open a page from its file and wait until it has started."""
    file = folder / "page.html"
    file.write_text(page, encoding="utf-8")
    browser.goto(file.as_uri())
    assert browser.evaluate("lippmann.viewer.then((viewer) => { globalThis.viewer = viewer; return true; })")


def open_still(browser, folder, page):
    """The same, but the page draws no view of its own: in software that takes longer than the pictures asked of it."""
    open_page(browser, folder, page)
    # What waits for a frame asks for none.
    browser.evaluate("(() => { cancelAnimationFrame(viewer.waiting); viewer.waiting = true; })()")


def settings(eye, pupil=0.0, focus=0.0, built=AS_DESIGNED, crosstalk=True):
    return {
        "eye": {"position": list(eye), "pupil": pupil, "focus": focus},
        "built": {**AS_DESIGNED, **built},
        "crosstalk": crosstalk,
    }


def pixels_of(url):
    """Values 0 to 1 of a PNG's data URL that has no pixel through which the page shines."""
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))).convert("RGBA"))
    assert (picture[..., 3] == 255).all()
    return picture[..., :3] / 255.0


def seen_in_page(browser, window, rays, **chosen):
    """The canvas' pixels of a view, values 0 to 1."""
    text = json.dumps(settings(**chosen))
    return pixels_of(browser.evaluate(f"viewer.picture({text}, {window.width_px}, {window.height_px}, {rays})"))


def seen_by_observe(mi, radiance, display, window, rays, eye, pupil=0.0, focus=0.0, built=None, crosstalk=True):
    built = {**AS_DESIGNED, **(built or {})}
    made = display.misaligned(built["rotation"], tuple(built["offset"]), built["gap"], built["pitchScale"])
    return observe(radiance, made, Eye(tuple(eye), pupil, focus), window, rays, crosstalk=crosstalk).radiance


# --- against observe ------------------------------------------------------------------------------

EYES = (
    {"eye": (5.0, -8.0, 300.0)},
    {"eye": (-90.0, 40.0, 250.0), "built": {"rotation": 3.0, "offset": [0.2, 0.1], "gap": -0.4, "pitchScale": 1.03}},
    {"eye": (4.0, 10.0, 200.0), "pupil": 6.0, "focus": 25.0, "crosstalk": False},
)


@pytest.mark.parametrize(
    "shape",
    [
        {"grid": "square"},
        {"grid": "hex", "subpixels": "rgb"},
        {"grid": "square", "side": "viewer", "subpixels": "bgr", "rotation": 20.0},
        {"grid": "hex", "side": "viewer", "gap": 1.5},
        {"grid": "hex", "gap": 0.0, "rotation": -7.0},
        {"grid": "square", "subpixels": "rgbw", "white_cd_m2": 100.0, "black_cd_m2": 2.0},
        {"grid": "hex", "subpixels": "pentile", "pixel_pitch_mm": (0.05, 0.065)},
        *({"grid": grid, "side": side, "rotation": 7.0, "skewed": True} for grid in GRIDS for side in SIDES),
    ],
    ids=lambda shape: "-".join(map(str, shape.values())),
)
def test_the_page_shows_what_observe_shows(browser, mi, tmp_path, shape):
    """Both follow the same rays: a pixel that differs has one that rounding brought across an edge."""
    display = small(**shape)
    radiance = painted(display)
    open_still(browser, tmp_path, page_html(display, radiance, "x"))
    window = whole_window(display, 130)
    for chosen in EYES:
        built = chosen.get("built", AS_DESIGNED)
        one = {**chosen, "built": {**built, "gap": max(built["gap"], -display.gap_mm)}}
        page = seen_in_page(browser, window, 4, **one)
        view = seen_by_observe(mi, radiance, display, window, 4, **one)
        assert view.std() > 0.02
        assert psnr_db(decode(page, "srgb"), view) >= LEAST_DB, one
        assert (np.abs(page - encode(view, "srgb")) > STEP).mean() < 0.01, one


@pytest.mark.parametrize("subpixels", ["none", "rgb"])
def test_tiles_change_no_pixel(browser, tmp_path, monkeypatch, subpixels):
    """The same view and the same drawing of the panel from one picture as from 6 x 5, the last ones smaller."""
    display = small(subpixels=subpixels, rotation=3.0)
    radiance = painted(display)
    window = whole_window(display, 130)
    found = []
    for limit in (2048, 47):
        monkeypatch.setattr("lippmann.eye.viewer_page.TILE_PX", limit)
        open_page(browser, tmp_path, page_html(display, radiance, "x"))
        assert browser.evaluate("viewer.panel.bitmaps.length") == (1 if limit == 2048 else 30)
        views = [seen_in_page(browser, window, rays, **one) for one in EYES for rays in (0, 4)]
        # Four screen pixels to a panel pixel, the edges of both together; and any zoom: no gap between tiles.
        browser.evaluate(
            "(() => { const view = viewer.panelView; view.zoom = 4;"
            "view.centre = [view.canvas.width, view.canvas.height].map((side) => 99 + (side % 2) / 8); })()"
        )
        for zoom in (4, 3.7, 1.3):
            browser.evaluate(f"viewer.panelView.zoom = {zoom}; viewer.panelView.panBy(0, 0)")
            frame(browser)
            drawn = pixels_of(browser.evaluate("viewer.panelView.canvas.toDataURL()"))
            views += [drawn] if zoom == 4 else []
        found.append(views)
    for one, other in zip(*found, strict=True):
        assert one.std() > 0.02
        np.testing.assert_array_equal(one, other)


def test_a_film_is_seen_frame_by_frame_and_plays(browser, mi, tmp_path):
    """Each frame as `observe` sees it, also in tiles; the button plays them at their rate, over and over."""
    display = small(rotation=3.0)
    frames = [painted(display, SEED + k) for k in range(3)]
    window = whole_window(display, 130)
    open_page(browser, tmp_path, page_html(display, frames[0], "x", later=frames[1:], frames_per_second=20.0))
    for number in (0, 2, 1):
        browser.evaluate(f"viewer.setFrame({number})")
        page = seen_in_page(browser, window, 4, **EYES[0])
        assert (
            psnr_db(decode(page, "srgb"), seen_by_observe(mi, frames[number], display, window, 4, **EYES[0]))
            >= LEAST_DB
        )
        assert browser.evaluate("document.getElementById('frame-words').value") == f"Frame {number + 1} of 3"
    browser.evaluate("document.getElementById('play').click()")
    seen = browser.evaluate(
        "new Promise((done) => { const seen = new Set(); const look = () => {"
        "seen.add(document.getElementById('frame-words').value);"
        "seen.size < 3 ? setTimeout(look, 5) : done(seen.size); }; look(); })"
    )
    assert seen == 3
    browser.evaluate("document.getElementById('play').click()")
    assert browser.evaluate("document.getElementById('play').getAttribute('aria-pressed')") == "false"
    # A page of one image has no film.
    open_page(browser, tmp_path, page_html(display, frames[0], "x"))
    assert browser.evaluate("document.getElementById('play')") is None


def test_a_panel_wider_than_textures_is_shown(browser, tmp_path):
    """Chromium's WebGL in software takes textures of 8192 pixels: the page shows 9000 columns nevertheless."""
    display = Display("wide", Panel(9000, 20, 0.05), Array("square", 1.0, 1.65, 1.5, 0.8, "panel"), 3.0)
    radiance = np.zeros((20, 9000, 3), np.float32)
    radiance[:, 8500:] = 1.0
    open_still(browser, tmp_path, page_html(display, radiance, "x"))
    assert browser.evaluate("viewer.renderer.gl.getParameter(viewer.renderer.gl.MAX_TEXTURE_SIZE)") < 9000
    seen = seen_in_page(browser, whole_window(display, 450), 4, eye=(0.0, 0.0, 40000.0))
    # From far away each lenslet shows the pixel behind it: 8500 of 9000 columns are black.
    assert seen[:, :420].max() < 0.02
    assert seen[:, 430:445].min() > 0.98


@pytest.mark.parametrize(("side", "index"), [("panel", 1.1), ("viewer", 1.5)])
def test_steep_domes_block_and_grow_with_the_pitch(browser, mi, tmp_path, side, index):
    """Nearly hemispheres, as thin as can be, seen from far aside: rays that neighbours' domes block.

    Downward that takes a low index, which bends rays so little that they come out again through a seam's valley.
    """
    flat = small("square", side, gap=0.4)
    steep = dataclasses.replace(flat.array, radius_mm=0.73, index=index)
    display = dataclasses.replace(flat, array=dataclasses.replace(steep, thickness_mm=steep.sag_mm))
    radiance = painted(display)
    open_still(browser, tmp_path, page_html(display, radiance, "x"))
    window = whole_window(display, 130)
    for eye in ((60.0, 100.0, 40.0), (-130.0, 20.0, 40.0)):
        chosen = {"eye": eye, "built": {"pitchScale": 1.02}}
        page = seen_in_page(browser, window, 4, **chosen)
        view = seen_by_observe(mi, radiance, display, window, 4, **chosen)
        assert view.std() > 0.02
        assert psnr_db(decode(page, "srgb"), view) >= LEAST_DB, eye


@pytest.mark.parametrize(("grid", "side"), list(itertools.product(("square", "hex"), ("panel", "viewer"))))
def test_a_glance_is_the_golden_ray_of_each_pixel(browser, tmp_path, grid, side):
    """While the eye moves: one ray from the eye through the middle of each of the view's pixels."""
    display = small(grid, side)
    panel = display.panel
    radiance = painted(display)
    open_still(browser, tmp_path, page_html(display, radiance, "x"))
    window = whole_window(display, 120)
    eye = np.array([20.0, -30.0, 300.0])
    glance = seen_in_page(browser, window, 0, eye=eye.tolist(), pupil=5.0, focus=30.0)
    column, row = np.meshgrid(np.arange(window.width_px) + 0.5, np.arange(window.height_px) + 0.5)
    x = (column / window.width_px - 0.5) * panel.width_mm
    y = (0.5 - row / window.height_px) * panel.height_mm
    way = np.stack([x, y, 0.0 * x], axis=2).reshape(-1, 3) - eye
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    hits = trace_to_panel(display, np.broadcast_to(eye, way.shape), way)
    seen = (hits.status == Status.OK) | (hits.status == Status.CROSSTALK)
    pixel = np.where(seen[:, None], np.floor(hits.pixel), 0.0).astype(int)
    expected = np.where(seen[:, None], np.rint(encode(radiance, "srgb") * 255)[pixel[:, 1], pixel[:, 0]], 0.0)
    different = (np.rint(glance * 255).reshape(-1, 3) != expected).any(axis=1)
    # A glance lets rays keep to the dome that they come to first: beyond its seam within the sag times the slope, here
    # at most 0.16 mm times 0.15, they see through the wrong one.
    print(f"{different.mean():.4f} differ")
    assert different.mean() < 0.16 * 0.15 * 2


#: Elemental images up to a pitch beside their lenslets.
CONVERGED = {
    "square-panel": {"viewing_distance_mm": 200.0, "viewing_axis_mm": (-20.0, 12.0)},
    "hex-viewer": {"viewing_distance_mm": 120.0, "viewing_axis_mm": (30.0, 0.0)},
    "hex-panel": {"viewing_distance_mm": 150.0, "viewing_axis_mm": (10.0, -8.0)},
}


def converged(name):
    """60 x 45 lenslets for a near eye that is off the middle, turned and moved; "hex-panel" is skewed, and ends."""
    grid, side = name.split("-")
    display = small(grid, side, rotation=11.0, skewed=name == "hex-panel")
    if name == "hex-panel":
        display = dataclasses.replace(display, array=dataclasses.replace(display.array, extent_mm=(50.0, 38.0)))
    return dataclasses.replace(display, panel=Panel(1200, 900, 0.05), **CONVERGED[name])


@pytest.mark.parametrize(
    "name", ["hex-panel", *(pytest.param(name, marks=pytest.mark.full) for name in ("square-panel", "hex-viewer"))]
)
def test_twenty_eyes_on_converged_displays(browser, mi, tmp_path, name):
    """With crosstalk and without, which only the pixels' owners tell apart."""
    display = converged(name)
    radiance = painted(display)
    open_still(browser, tmp_path, page_html(display, radiance, "x"))
    window = whole_window(display, 240)
    rng = np.random.default_rng(SEED)
    print(f"numpy.random.default_rng({SEED})")
    worst, told_apart = np.inf, 0
    for k in range(20):
        eye = (*rng.uniform(-60.0, 60.0, 2).tolist(), float(rng.uniform(100.0, 900.0)))
        pupil = float(rng.uniform(0.0, 12.0)) if k % 2 else 0.0
        chosen = {"eye": eye, "pupil": pupil, "focus": float(rng.uniform(-60.0, 60.0)), "crosstalk": k % 4 < 2}
        if k >= 16:
            chosen["built"] = {"rotation": 0.2, "offset": [0.1, -0.2], "gap": 0.2, "pitchScale": 1.01}
        page = seen_in_page(browser, window, 4, **chosen)
        view = seen_by_observe(mi, radiance, display, window, 4, **chosen)
        worst = min(worst, psnr_db(decode(page, "srgb"), view))
        if not chosen["crosstalk"]:
            straight = dataclasses.replace(display, viewing_distance_mm=None, viewing_axis_mm=(0.0, 0.0))
            other = seen_by_observe(mi, radiance, straight, window, 4, **chosen)
            told_apart += psnr_db(other, view) < 20.0
    print(f"worst of 20 eyes on {name}: {worst:.1f} dB")
    assert worst >= 50.0
    assert told_apart >= 8


@pytest.mark.parametrize("name", CONVERGED)
def test_the_panel_view_knows_whose_a_pixel_is(browser, tmp_path, name):
    """Each pixel that the page is asked for has golden's lenslet, and seams stand where owners change."""
    display = converged(name)
    open_still(browser, tmp_path, page_html(display, painted(display), "x"))
    rng = np.random.default_rng(SEED)
    pixels = rng.integers(0, (1200, 900), (300, 2))
    system = "systemOf(viewer.display, {rotation: 0, offset: [0, 0], gap: 0, pitchScale: 1})"
    asked = f"{pixels.tolist()}.map((p) => owner(s, arrayFromPanel(s, panelFromPixel(s, [p[0] + 0.5, p[1] + 0.5]))))"
    told = browser.evaluate(f"(() => {{ const s = {system}; return {asked}; }})()")
    rays = trace(display, pixels + 0.5, None, "pinhole")
    np.testing.assert_array_equal(told, rays.lenslet)
    # A little inside the corners that are drawn, all points are that lenslet's.
    corner = (
        "cellCorners(s).map(([x, y]) => pixelFromPanel(s, panelFromArray(s, behind(s, "
        "[0.999 * x + centreOf(s, i, j)[0], 0.999 * y + centreOf(s, i, j)[1]]))))"
    )
    lenslets = np.unique(rays.lenslet, axis=0).tolist()
    drawn = browser.evaluate(f"(() => {{ const s = {system}; return {lenslets}.map(([i, j]) => {corner}); }})()")
    for lenslet, corners in zip(lenslets, drawn, strict=True):
        owners = trace(display, corners, None, "pinhole").lenslet
        np.testing.assert_array_equal(owners, np.broadcast_to(lenslet, owners.shape))


# --- the page as a person uses it -----------------------------------------------------------------


@pytest.fixture
def page(browser, tmp_path):
    """The browser with the page of a small display open."""
    display = small()
    directs = [Direct((x, 0.0, 600.0), painted(display, k)) for k, x in enumerate((-40.0, 0.0, 40.0))]
    open_page(browser, tmp_path, page_html(display, painted(display), "A page", directs))
    return browser


def value(page, name):
    return page.evaluate(f"document.getElementById('{name}').valueAsNumber")


def frame(page):
    """Wait until what changed has been taken up and drawn."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")


def centre(page, name):
    page.evaluate(f"document.getElementById('{name}').scrollIntoView({{block: 'center'}})")
    box = page.evaluate(f"document.getElementById('{name}').getBoundingClientRect().toJSON()")
    return box["x"], box["y"], box["width"], box["height"]


@pytest.fixture
def devtools(page):
    """Sends commands of Chromium's DevTools to the page."""
    session = page.context.new_cdp_session(page)
    yield session.send
    session.detach()


def test_it_asks_for_nothing_and_complains_of_nothing(page):
    asked, told = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: told.append(message.text))
    page.on("pageerror", lambda error: told.append(str(error)))
    page.reload()
    frame(page)
    assert asked
    assert {url.partition(":")[0] for url in asked} <= {"file", "data", "blob"}
    assert told == []
    assert page.evaluate("document.getElementById('trouble').hidden")


def test_mouse_finger_and_keys_move_the_eye(page, devtools):
    x, y, width, height = centre(page, "view-canvas")
    reach = page.evaluate("Number(document.getElementById('eye-x').max)")
    page.mouse.move(x + 0.75 * width, y + 0.25 * height)
    frame(page)
    # A pixel of the canvas is what the mouse may round.
    assert value(page, "eye-x") == pytest.approx(0.5 * reach, abs=3.0 * reach / width)
    assert value(page, "eye-y") == pytest.approx(0.5 * reach, abs=3.0 * reach / height)
    point = {"x": x + 0.25 * width, "y": y + 0.5 * height}
    devtools("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    devtools("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert value(page, "eye-x") == pytest.approx(-0.5 * reach, abs=3.0 * reach / width)
    page.evaluate("document.getElementById('view-canvas').focus()")
    page.keyboard.press("Home")
    assert [value(page, f"eye-{k}") for k in "xyz"] == [0.0, 0.0, 600.0]
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("PageUp")
    assert value(page, "eye-x") < 0.0 < value(page, "eye-y")
    assert value(page, "eye-z") > 600.0


def test_the_view_follows_the_eye(page):
    page.evaluate("document.getElementById('crosstalk').scrollIntoView()")
    shot = "(viewer.frame(performance.now()), viewer.canvas.toDataURL())"
    first = page.evaluate(shot)
    page.evaluate("setSlider('eye-x', 30); viewer.changed()")
    second = page.evaluate(shot)
    assert first != second
    words = page.evaluate(
        "new Promise((done) => setTimeout(() => done(document.getElementById('view-words').textContent), 900))"
    )
    assert words == "Eye 30 mm right, 600 mm away. A pinhole pupil: all depths are sharp. Open the pupil to focus."
    page.evaluate("setSlider('pupil', 4); setSlider('focus', -20); viewer.changed()")
    frame(page)
    assert "20 mm behind the display, where images are virtual" in page.evaluate(
        "document.getElementById('depth-words').value"
    )
    page.evaluate("setSlider('focus', 12); viewer.changed()")
    frame(page)
    assert "12 mm in front of the display, where images are real" in page.evaluate(
        "document.getElementById('depth-words').value"
    )


def test_the_nearest_direct_render_stands_beside(page):
    for x, expected in ((-39.0, -40.0), (3.0, 0.0), (35.0, 40.0)):
        page.evaluate(f"setSlider('eye-x', {x}); viewer.changed()")
        frame(page)
        assert page.evaluate("viewer.direct.shown.eye_mm[0]") == expected
    page.evaluate("document.getElementById('direct-go').click()")
    frame(page)
    assert value(page, "eye-x") == 40.0
    assert page.evaluate("document.getElementById('direct-words').value").endswith("The same eye.")
    shown = pixels_of(page.evaluate("document.getElementById('direct-image').src"))
    np.testing.assert_allclose(shown, encode(painted(small(), 2), "srgb"), atol=STEP / 2)


def test_the_panel_zooms_to_its_pixels(page):
    """At the most zoom the canvas' middle is one panel pixel, in its own colour; borders are drawn in between."""
    x, y, width, height = centre(page, "panel-canvas")
    page.evaluate("for (const id of ['seams', 'marks']) document.getElementById(id).click()")
    page.mouse.move(x + width / 2, y + height / 2)
    for _ in range(20):
        page.mouse.wheel(0, -300)
    frame(page)
    found = page.evaluate(
        "(() => { const view = viewer.panelView, canvas = view.canvas;"
        "const pixel = view.pixelAt([canvas.width / 2, canvas.height / 2]).map(Math.floor);"
        "const at = [canvas.width / 2, canvas.height / 2].map(Math.floor);"
        "return [view.scale, ...pixel, ...view.context.getImageData(...at, 1, 1).data]; })()"
    )
    scale, column, row, *colour = found
    assert scale == 64
    expected = np.rint(encode(painted(small()), "srgb")[int(row), int(column)] * 255)
    np.testing.assert_array_equal(colour[:3], expected)
    plain = page.evaluate("viewer.panelView.canvas.toDataURL()")
    page.evaluate("document.getElementById('zoom-lenslets').click(); document.getElementById('seams').click()")
    frame(page)
    assert page.evaluate("viewer.panelView.canvas.toDataURL()") != plain
    page.evaluate("document.getElementById('panel-canvas').focus()")
    page.keyboard.press("0")
    frame(page)
    assert page.evaluate("viewer.panelView.scale") == pytest.approx(page.evaluate("viewer.panelView.fit"))


def test_a_fine_pattern_shows_its_mean_from_far_away(browser, tmp_path):
    """Columns by turns black and white, several to a screen pixel: grey, and no stripes."""
    display = dataclasses.replace(small(), panel=Panel(2400, 1600, 0.05))
    columns = np.zeros((1600, 2400, 3), np.float32)
    columns[:, ::2] = 1.0
    open_page(browser, tmp_path, page_html(display, columns, "x"))
    frame(browser)
    assert browser.evaluate("viewer.panelView.scale") < 0.4
    shown = browser.evaluate(
        "(() => { const { context, canvas } = viewer.panelView;"
        "return [...context.getImageData(20, 20, canvas.width - 40, canvas.height - 40).data]; })()"
    )
    values = np.reshape(shown, (-1, 4))[:, 0]
    assert values.mean() == pytest.approx(127.5, abs=8.0)
    assert values.std() < 16.0


def test_reset_brings_all_controls_back(page):
    read = "JSON.stringify(readControls())"
    first = page.evaluate(read)
    page.evaluate("for (const id of ['eye-x', 'gap', 'pupil']) setSlider(id, 1); element('crosstalk').click()")
    assert page.evaluate(read) != first
    page.evaluate("element('reset').click()")
    assert page.evaluate(read) == first


def test_everything_focusable_has_a_name(devtools):
    nodes = devtools("Accessibility.getFullAXTree")["nodes"]
    focusable = [
        n for n in nodes if any(p["name"] == "focusable" and p["value"]["value"] for p in n.get("properties", []))
    ]
    roles = {n["role"]["value"] for n in focusable}
    assert {"slider", "button", "checkbox", "combobox", "application"} <= roles
    nameless = [n for n in focusable if not n.get("name", {}).get("value") and n["role"]["value"] != "RootWebArea"]
    assert nameless == []


def test_light_and_dark(page):
    ground = "getComputedStyle(document.body).backgroundColor"
    colours = {}
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        colours[scheme] = page.evaluate(ground)
    assert colours["light"] != colours["dark"]
    # The page's own choice goes before the system's.
    page.evaluate("document.getElementById('theme').value = 'light'")
    page.evaluate("document.getElementById('theme').dispatchEvent(new Event('change'))")
    assert page.evaluate(ground) == colours["light"]
    page.emulate_media(color_scheme="null")


def test_the_view_fills_the_window_until_escape(page):
    page.evaluate("document.getElementById('fill').click()")
    frame(page)
    assert page.evaluate("[viewer.canvas.clientWidth, viewer.canvas.clientHeight]") == [800, 600]
    page.keyboard.press("Escape")
    frame(page)
    assert page.evaluate("viewer.canvas.clientWidth") < 800


def test_without_webgl_it_says_so(browser, tmp_path):
    display = small()
    with browser.context.browser.new_page() as other:
        other.add_init_script(
            "const old = HTMLCanvasElement.prototype.getContext;"
            "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
            "return kind === 'webgl2' ? null : old.call(this, kind, ...more); };"
        )
        open_page(other, tmp_path, page_html(display, painted(display), "x"))
        assert "no WebGL 2" in other.evaluate("document.getElementById('trouble').textContent")
        # The panel is there all the same.
        frame(other)
        middle = other.evaluate("[...viewer.panelView.context.getImageData(50, 50, 1, 1).data]")
        assert max(middle[:3]) > 0


# --- the server -----------------------------------------------------------------------------------


def test_the_page_is_served_on_loopback_until_interrupted(tmp_path):
    display = load_display(ROOT / "scenes/displays/vga-square.toml")
    panel = display.panel
    write_picture(tmp_path / "a.png", np.full((panel.height_px, panel.width_px, 3), 0.5, np.float32), {})
    display = str(ROOT / "scenes/displays/vga-square.toml")
    command = [sys.executable, "-m", "lippmann", "view", "a.png", "--display", display, "--force", "--serve", "--json"]
    pipe = subprocess.PIPE
    server = subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True)
    try:
        told = json.loads(server.stdout.readline())
        assert told["url"].startswith("http://127.0.0.1:")
        with urllib.request.urlopen(told["url"]) as answer:
            page = answer.read()
        assert len(page) == told["bytes"]
        assert b"view-canvas" in page
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(told["url"] + "etc/passwd")
        port = told["url"].split(":")[2].split("/")[0]
        second = subprocess.run(
            [*command, "--tcp-port", port],
            cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip
        assert second.returncode == 2
        assert "cannot listen on port" in second.stderr
        server.send_signal(signal.SIGINT)
        out, err = server.communicate(timeout=30)
    finally:
        server.kill()
        server.wait()
    assert server.returncode == 0, err
    assert out == ""
