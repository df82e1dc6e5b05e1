"""`lippmann live` on SDL's dummy desktop: pictures against the renderer's, motions by hand, and the board's frames."""

import json
from dataclasses import replace

import numpy as np
import pygame
import pytest
from lippmann.base.tones import encoded_values, psnr_db
from lippmann.board.board import Board
from lippmann.board.panel_frames import panel_values
from lippmann.board.streaming import Sender
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import DeviceError
from lippmann.motion.film import load_film
from lippmann.motion.film_frames import Reel, plan_film
from lippmann.motion.live_picture import Encoder, LivePicture, LiveShow, least_radiance
from lippmann.motion.live_windows import Hand, Screens, screens
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.renderer import render_integral
from lippmann.rendering.sinks import render_picture
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from model_board import ModelBoard
from scene_cases import generator
from test_film import DISPLAY

SCENE = """<scene version="3.0.0">
<shape type="sphere"><point name="center" x="1" y="0" z="2"/><float name="radius" value="2"/>
<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.5, 0.2"/></bsdf></shape>
<shape type="cube"><transform name="to_world"><scale value="1.2"/><translate x="-2" y="-1" z="-3"/></transform></shape>
<emitter type="point"><point name="position" x="20" y="30" z="60"/><rgb name="intensity" value="9000"/></emitter>
</scene>"""


@pytest.fixture
def place(tmp_path, monkeypatch, mi):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    (tmp_path / "s.xml").write_text(SCENE)
    (tmp_path / "d.toml").write_text(DISPLAY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def made(place):
    display, scene = load_display("d.toml"), load_scene("s.xml")
    picture = LivePicture(scene, display, "pinhole", Settings(seed=3, shading="each"))
    panel = display.panel
    return display, scene, picture, Hand(scene.placement, picture.middle_mm, panel.width_mm / panel.width_px)


def refined(picture):
    assert picture.finer(lambda: False)
    return picture.radiance


@pytest.mark.parametrize("moves", [0, 2])
def test_pictures_are_the_renderers(made, moves):
    """A quick one is a render of one sample, the first finer one of four, bit for bit, wherever the scene stands."""
    display, scene, picture, hand = made
    assert picture.block == 1
    for _ in range(moves):
        hand.turn(25.0, -10.0)
        hand.zoom(1.0)
        hand.shift(3.0, -2.0, 1.0)
    picture.quick(hand.placement())
    quick = picture.radiance
    assert picture.samples == 0
    finer = refined(picture)
    assert picture.samples == 4
    placed = scene if not moves else scene.placed(hand.placement())
    # The same front, so that rays start at the same points; boxes differ in their last place.
    near = picture._placement
    placed = placed.placed(near)
    for found, samples in ((quick, 1), (finer, 4)):
        settings = Settings(samples=samples, seed=3, shading="each")
        wanted = render_integral(placed, display, "pinhole", settings).radiance
        assert (found == wanted).all()


def test_a_resting_picture_becomes_finer(made):
    """Against 400 samples: each step of passes is nearer."""
    display, scene, picture, _ = made
    picture.quick(scene.placement)
    exact = render_integral(scene, display, "pinhole", Settings(samples=400, seed=77, shading="each")).radiance
    found = [psnr_db(refined(picture), exact) for _ in range(16)]
    assert picture.samples == 64
    assert found[15] > found[0] + 6.0, found


def test_an_interrupted_pass_is_done_again(made):
    _, scene, picture, _ = made
    picture.quick(scene.placement)
    first = refined(picture)
    assert not picture.finer(lambda: True)
    assert picture.samples == 4
    assert (picture.radiance == first).all()
    picture.quick(scene.placement)
    assert (refined(picture) == first).all()


def test_large_panels_get_a_ray_for_a_block_of_pixels(place, monkeypatch):
    monkeypatch.setattr("lippmann.motion.live_picture.QUICK_S", 1e-9)
    display, scene = load_display("d.toml"), load_scene("s.xml")
    picture = LivePicture(scene, display, "pinhole", Settings())
    assert picture.block == 8
    picture.quick(scene.placement)
    found = picture.radiance
    height, width = display.panel.height_px, display.panel.width_px
    assert found.shape == (height, width, 3)
    whole = height - height % 8, width - width % 8
    blocks = found[: whole[0], : whole[1]].reshape(whole[0] // 8, 8, whole[1] // 8, 8, 3)
    assert (blocks == blocks[:, :1, :, :1]).all()
    assert found.max() > 0.05
    assert picture.finer(lambda: False)
    assert picture.samples == 4


MEASURED = ((0.0, 0.0), (0.2, 0.01), (0.5, 0.0100001), (0.7, 0.6), (1.0, 1.0))  # steep, with levels of hardly a float


@pytest.mark.parametrize("transfer", ["srgb", "gamma2.2", "linear", MEASURED])
@pytest.mark.parametrize("bits", [1, 8, 10])
def test_values_are_those_of_the_file(mi, transfer, bits):
    """Of random light, dark and too bright light, and the least light of each level and the float before it."""
    panel = load_display(repository() / "scenes/displays/vga-square.toml").panel
    panel = replace(panel, width_px=256, height_px=9, transfer=transfer, bits=bits)
    least = least_radiance(panel, min(bits, 8))
    rng = generator(11, bits, str(transfer))
    light = np.concatenate([
        [-1.0, 0.0, 1e-30, 1.0, 7.0, np.inf], least, np.nextafter(least, np.float32(0.0)),
        rng.random(3000), 10.0 ** rng.uniform(-6, 1, 3000),
    ])  # fmt: skip
    planes = np.resize(light.astype(np.float32), (3, 256 * 9))
    found = Encoder(panel)([mi.Float(plane) for plane in planes])
    wanted = encoded_values(planes.T.reshape(9, 256, 3), panel.transfer, min(bits, 8))
    # NumPy's powers of neighbouring floats need not rise: where they do not, a float is one level off.
    differ = found.astype(int) - wanted
    assert np.count_nonzero(differ) <= 2
    assert np.abs(differ).max() <= 255 // (2 ** min(bits, 8) - 1) + 1


def moved(hand, point):
    return hand.placement().display_from_scene[:3] @ [*point, 1.0]


@pytest.mark.parametrize("base", [Placement(), Placement(scale=2.0, rotation_deg=(0, 0, 90), offset_mm=(5, 0, 0))])
def test_motions_are_about_the_middle(base):
    """A point before, to the right of, and above the middle, 1 mm away, by hand."""
    pivot = np.array([3.0, -2.0, 1.0])
    inverse = base.scene_from_display[:3]
    at = [inverse @ [*(pivot + step), 1.0] for step in np.eye(3)]
    middle = inverse @ [*pivot, 1.0]
    hand = Hand(base, pivot, 0.1)
    hand.turn(90.0)  # what was in front goes right, what was right goes behind
    for point, wanted in zip(at, ([0, 0, -1], [0, 1, 0], [1, 0, 0]), strict=True):
        assert moved(hand, point) - pivot == pytest.approx(wanted, abs=1e-9)
    hand.reset()
    hand.turn(0.0, 45.0)  # what was in front goes down
    assert moved(hand, at[2]) - pivot == pytest.approx([0, -np.sqrt(0.5), np.sqrt(0.5)], abs=1e-9)
    hand.reset()
    hand.zoom(2.0)
    assert moved(hand, at[0]) - pivot == pytest.approx([1.05**2, 0, 0])
    hand.shift(10.0, 20.0, 30.0)
    assert moved(hand, middle) - pivot == pytest.approx([1.0, 2.0, 3.0])
    hand.reset()
    assert hand.placement() is base


def test_turns_stop_at_the_poles_and_scales_at_their_limits():
    hand = Hand(Placement(), np.zeros(3), 0.1)
    hand.turn(0.0, 500.0)
    assert hand.pitch_deg == 89.0
    for _ in range(100):
        hand.zoom(20.0)
    assert hand.scale <= 1e9
    hand.placement()


def post(kind, **values):
    pygame.event.post(pygame.event.Event(kind, **values))


def press(*names):
    """Press keys, those in capitals with shift."""
    for name in names:
        mod = pygame.KMOD_LSHIFT if name.isupper() else 0
        post(pygame.KEYDOWN, key=pygame.key.key_code(name.lower()), mod=mod)


def test_mouse_and_keys(place):
    hand = Hand(Placement(), np.zeros(3), 0.1)
    with screens() as shown:
        shown.open("panel", (64, 48))
        assert shown.obey(hand)
        for rel, buttons in (((10, 5), (1, 0, 0)), ((90, 5), (0, 0, 0)), ((10, 20), (0, 0, 1))):
            post(pygame.MOUSEMOTION, rel=rel, buttons=buttons, pos=(0, 0))
        post(pygame.MOUSEWHEEL, x=0, y=2)
        assert shown.waiting()
        assert shown.obey(hand)
        assert not shown.waiting()
        assert (hand.yaw_deg, hand.pitch_deg) == pytest.approx((4.0, 2.0))
        assert hand.shift_mm == pytest.approx([1.0, -2.0, 0.0])
        assert hand.scale == pytest.approx(1.05**2)
        press("left", "UP", "page up", "-")
        assert shown.obey(hand)
        assert hand.yaw_deg == pytest.approx(-1.0)
        assert hand.shift_mm == pytest.approx([1.0, -1.0, 1.0])
        assert hand.scale == pytest.approx(1.05)
        press("r")
        assert shown.obey(hand)
        assert hand.placement() is hand.base
        for key in ("q", "escape"):
            press(key)
            assert not shown.obey(hand)
        post(pygame.QUIT)
        assert not shown.obey(hand)


def test_the_window_shows_the_panels_pixels(made):
    display, scene, picture, hand = made
    panel = display.panel
    with screens() as shown:
        shown.open("panel", (panel.width_px, panel.height_px))
        played = LiveShow(picture, hand, shown).run(seconds=0.0, samples=8)
        found = pygame.surfarray.array3d(shown._windows["panel"].get_surface()).swapaxes(0, 1)
    assert played.samples == 8
    picture.quick(scene.placement)
    assert picture.finer(lambda: False)
    wanted = encoded_values(refined(picture), panel.transfer, 8)
    assert (found == wanted).all()


def test_the_command_turns_a_scene_by_itself(place, capfd):
    assert run([
        "live", "s.xml", "--display", "d.toml", "--turn", "60", "--turn-seconds", "1", "--seconds", "1",
        "--samples", "8", "--eye", "0,0,600", "--device", "llvm", "--json",
    ]) == 0  # fmt: skip
    out, error = capfd.readouterr()
    told = json.loads(out)
    assert told["frames"] > 3
    assert told["samples"] == 8
    assert told["first_s"] < 5.0
    assert told["block"] == 1
    assert "rotate" in told["placement"]
    assert "Traceback" not in error


def test_a_key_ends_the_command(place, capfd, monkeypatch):
    calls, obey = iter(range(9)), Screens.obey

    def press_at_last(self, *moved):
        if next(calls) == 3:
            press("q")
        return obey(self, *moved)

    monkeypatch.setattr(Screens, "obey", press_at_last)
    assert run(["live", "s.xml", "--display", "d.toml", "--device", "llvm"]) == 0
    assert "samples at the end" in capfd.readouterr().out


FILM = """scene = "s.xml"
frames = 4
frames_per_second = 50
[[object]]
shapes = "ball"
keys = [{ frame = 0 }, { frame = 3, offset_mm = [-6.0, 2.0, 1.0] }]
"""


@pytest.fixture
def reel(place):
    (place / "s.xml").write_text(SCENE.replace('type="sphere"', 'type="sphere" id="ball"'))
    (place / "f.toml").write_text(FILM)
    display = load_display("d.toml")
    options = RenderOptions(model="pinhole", settings=Settings(4, seed=3, shading="each"))
    return display, Reel(plan_film(load_film("f.toml"), display, options), 50.0)


def test_a_films_frames_are_those_of_animate(reel):
    """All of them, the first time round and from memory; then one at rest, as fine as animate's, and moved by hand."""
    display, reel = reel
    picture = LivePicture(reel.plans[0].load(), display, "pinhole", Settings(seed=3, shading="each"))
    hand = Hand(reel.plans[0].placement, picture.middle_mm, 0.1)
    wanted = []
    for shot in reel.plans:
        one = replace(shot, options=replace(shot.options, settings=Settings(samples=1, seed=3, shading="each")))
        wanted.append(panel_values(render_picture(one).radiance, display.panel.transfer, 8).astype(np.uint8))
    assert len({frame.tobytes() for frame in wanted}) == 4
    given = []
    with screens() as shown:
        shown.open("panel", (display.panel.width_px, display.panel.height_px))
        show = shown.show
        shown.show = lambda name, pixels, title: (given.append(np.array(pixels)), show(name, pixels, title))
        played = LiveShow(picture, hand, shown, reel=reel).run(moving_s=1.5, seconds=1.5, samples=4)
    *frames, last = given
    assert len(frames) >= 9
    for number, frame in enumerate(frames):
        assert np.count_nonzero(frame != wanted[number % 4]) <= 6, number  # rays start at a front of another box
    assert played.samples == 4
    assert not reel.playing
    fine = panel_values(render_picture(reel.plans[reel.frame]).radiance, display.panel.transfer, 8)
    assert np.count_nonzero(last != fine) <= 6


def test_space_stops_a_film_and_full_stops_step_it(reel):
    _, reel = reel
    hand = Hand(Placement(), np.zeros(3), 0.1)
    with screens() as shown:
        shown.open("panel", (64, 48))
        reel.advance(0.021)
        assert reel.frame == 1
        reel.advance(100.0)  # no frame is left out
        assert reel.frame == 2
        press("space")
        assert shown.obey(hand, reel)
        reel.advance(1.0)
        assert (reel.playing, reel.frame) == (False, 2)
        for key, frame in ((".", 3), (".", 0), (",", 3)):
            press(key)
            assert shown.obey(hand, reel)
            assert (reel.playing, reel.frame) == (False, frame)
        press("space")
        assert shown.obey(hand, reel)
        reel.advance(0.02)
        assert reel.frame == 0


def test_the_command_plays_a_film(reel, capfd, refusal_of):
    common = ["live", "f.toml", "--display", "d.toml", "--device", "llvm"]
    assert run([*common, "--seconds", "4", "--samples", "4", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["frames"] > 3
    assert told["samples"] == 4
    assert "--offset cannot place a film" in refusal_of(*common, "--offset", "1,2,3")
    assert "leave one" in refusal_of(*common, "--fit", "--scale", "2")


def test_a_board_without_a_desktop(made, no_desktop, capfd):
    panel = made[0].panel
    with ModelBoard(panel.width_px, panel.height_px) as model:
        words = ["--no-window", "--port", model.url, "--force", "--turn", "60", "--seconds", "1", "--samples", "4"]
        assert run(["live", "s.xml", "--display", "d.toml", "--device", "llvm", *words, "--json"]) == 0
        told = json.loads(capfd.readouterr().out)
    assert told["board"]["frames"] >= 2
    assert told["samples"] == 4
    assert len(model.shown) >= 2


def test_a_board_that_fails_ends_the_picture(made):
    display, *_ = made
    panel = display.panel
    pixels = np.zeros((panel.height_px, panel.width_px, 3), np.uint8)
    with ModelBoard(panel.width_px, panel.height_px) as model:
        board = Board.open(model.url, 12_000_000, 0.3)
    with board:
        sender = Sender(board)
        sender.send(pixels)
        with pytest.raises(DeviceError):
            sender.finish()


def test_mistakes(place, capfd):
    for words, code, part in (
        ("--monitor 7", 2, "monitor 7 does not exist"),
        ("--monitor 0", 2, "monitor 0 has 1024 x 768 pixels, but the image has 46 x 32"),
        ("--monitor 0 --port socket://127.0.0.1:1", 2, "leave one out"),
        ("--monitor 0 --window", 2, "leave one out"),
        ("--no-window", 2, "give --port"),
        ("--no-window --port socket://127.0.0.1:1 --eye 0,0,600", 2, "leave out --eye"),
        ("--port socket://127.0.0.1:1", 1, "127.0.0.1:1"),
    ):
        assert run(["live", "s.xml", "--display", "d.toml", "--device", "llvm", *words.split()]) == code
        error = capfd.readouterr().err
        assert part in error.splitlines()[-1], error


def test_without_a_desktop(place, no_desktop, capfd):
    assert run(["live", "s.xml", "--display", "d.toml", "--device", "llvm"]) == 1
    assert "no desktop" in capfd.readouterr().err


@pytest.mark.full
def test_memory_is_flat_over_a_thousand_frames(made):
    display, _, picture, hand = made
    panel = display.panel

    def resident_mb():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096 / 1e6

    with screens() as shown:
        shown.open("panel", (panel.width_px, panel.height_px))
        sizes = []
        for _ in range(12):
            for _ in range(100):
                hand.turn(1.0)
                picture.quick(hand.placement())
                shown.show("panel", picture.values, "turning")
            sizes.append(resident_mb())
    assert sizes[-1] - sizes[1] < 0.02 * sizes[1], sizes
