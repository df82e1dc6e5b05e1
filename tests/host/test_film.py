"""Films: where things stand at each frame, what is rendered again, and what a video keeps."""

import itertools
import json
import re
import signal
import subprocess
import sys
import time

import imageio_ffmpeg
import numpy as np
import pytest
from lippmann.base.files import FolderLock
from lippmann.base.images import read_picture
from lippmann.base.tones import encode, psnr_db
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.motion.film import Key, MotionPath, load_film
from lippmann.motion.film_frames import plan_film
from lippmann.motion.video import write_video
from lippmann.rendering import irradiance_cache_choice
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.sinks import render_picture
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from PIL import Image
from scene_cases import small_toml
from scipy.spatial.transform import Rotation

PATIENCE_S = 120.0
DISPLAY = small_toml(46, 32)
#: Three shapes of different kinds, each 1 mm in radius or half side, and a card behind them.
SCENE = """<scene version="3.0.0">
  <emitter type="point"><point name="position" x="300" y="400" z="600" /><rgb name="intensity" value="4e5" /></emitter>
  <bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.8, 0.2, 0.1" /></bsdf>
  <shape type="sphere" id="ball-1"><point name="center" x="-1" y="0.5" z="1" /><ref id="red" /></shape>
  <shape type="sphere" id="ball-2"><ref id="red" /><transform name="to_world">
    <scale value="2" /><translate x="1" y="0" z="-2" /></transform></shape>
  <shape type="cube" id="block"><transform name="to_world"><translate x="0" y="-1" z="0" /></transform></shape>
  <shape type="rectangle" id="card"><transform name="to_world">
    <scale value="9" /><translate z="-9" /></transform></shape>
</scene>
"""
PLACEMENT = "[placement]\nscale = 0.5\nrotation_deg = [10, 0, 90]\noffset_mm = [0.25, 0, -1]\n"
FILM = 'scene = "three.xml"\nframes = 5\n'
MOVE = '[[object]]\nshapes = "{}"\nkeys = [{{ frame = 0 }}, {{ frame = 4, offset_mm = [{}, {}, {}] }}]\n'


@pytest.fixture
def place(tmp_path):
    (tmp_path / "three.xml").write_text(SCENE)
    (tmp_path / "small.toml").write_text(DISPLAY)
    (tmp_path / "film.toml").write_text(FILM + MOVE.format("ball-*", 1, 0, 2))
    return tmp_path


def film_of(place, text):
    (place / "film.toml").write_text(text)
    return load_film(place / "film.toml")


def animate(place, *words, code=0):
    """Run `lippmann animate` with one sample a pixel; its frames lie in `place/out`."""
    common = ("--display", str(place / "small.toml"), "-o", str(place / "out"), "--samples", "1")
    assert run(["animate", str(place / "film.toml"), *common, *map(str, words)]) == code


def until(done, what):
    """Wait for what a function returns to be true, and return it."""
    deadline = time.monotonic() + PATIENCE_S
    while not (found := done()):
        assert time.monotonic() < deadline, what
        time.sleep(0.02)
    return found


def times(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.exr")}


def test_keys_are_met_and_held():
    keys = (Key(2, (1.0, 2.0, 3.0), (10.0, 20.0, 30.0), 2.0), Key(5, (4.0, 2.0, 0.0), (0.0, 0.0, 0.0), 0.5))
    for motion in ("linear", "smooth"):
        path = MotionPath(keys, motion=motion)
        for frame, key in ((0, keys[0]), (2, keys[0]), (5, keys[1]), (9, keys[1])):
            assert path.at(frame) == Placement(key.scale, key.rotation_deg, key.offset_mm)


def test_between_keys_linear_is_even_and_smooth_stays_between():
    rng = np.random.default_rng(2005)
    values = rng.uniform(-9.0, 9.0, 6).round(3)
    keys = tuple(Key(4 * k, (float(v), 0.0, 0.0)) for k, v in enumerate(values))
    linear, smooth = MotionPath(keys, motion="linear"), MotionPath(keys)
    straight = 0
    for k in range(5):
        low, high = sorted(values[k : k + 2])
        for part in (1, 2, 3):
            even = values[k] + (values[k + 1] - values[k]) * part / 4
            assert linear.at(4 * k + part).offset_mm[0] == pytest.approx(even, abs=1e-12)
            x = smooth.at(4 * k + part).offset_mm[0]
            assert low <= x <= high
            straight += abs(x - even) < 1e-9
    assert straight < 5, "smooth runs like linear"


def test_a_smooth_path_has_the_slopes_of_fritsch_and_butland():
    """By hand: slopes 2 and 4 with equal steps meet with their harmonic mean 8/3; half way up a cubic of Hermite."""
    path = MotionPath((Key(0), Key(2, (4.0, 0.0, 0.0)), Key(4, (12.0, 0.0, 0.0))))
    end = (3.0 * 4.0 - 2.0) / 2.0  # three points' formula at the last key
    middle = 0.5 * (4.0 + 12.0) + 2.0 * (8.0 / 3.0 - end) / 8.0
    assert path.at(3).offset_mm[0] == pytest.approx(middle, abs=1e-12)


@pytest.mark.parametrize(("shape", "centre"), [("ball-1", (-1, 0.5, 1)), ("ball-2", (1, 0, -2)), ("block", (0, -1, 0))])
def test_shapes_move_in_the_displays_frame(place, mi, shape, centre):
    """However the scene stands, and however the file says where a shape is."""
    (place / "three.toml").write_text(PLACEMENT)
    rest = Placement(0.5, (10.0, 0.0, 90.0), (0.25, 0.0, -1.0))
    keys = "keys = [{ frame = 0, offset_mm = [3, -1, 2], rotation_deg = [0, 30, -20], scale = 1.5 }]"
    film = film_of(place, FILM + f'[[object]]\nshapes = "{shape}"\npivot_mm = [1, 2, 3]\n{keys}\n')
    scene = load_scene(film.scene, rest, film.moves(0, rest))
    found = next(s for s in scene.mitsuba.shapes() if s.id() == shape).bbox().center()
    found = rest.display_from_scene @ [*np.array(found).ravel(), 1.0]
    pivot, turn = np.array([1.0, 2.0, 3.0]), Rotation.from_euler("xyz", (0, 30, -20), degrees=True)
    stood = (0.5 * Rotation.from_euler("xyz", (10, 0, 90), degrees=True).apply(centre)) + [0.25, 0.0, -1.0]
    wanted = 1.5 * turn.apply(stood - pivot) + pivot + [3.0, -1.0, 2.0]
    np.testing.assert_allclose(found[:3], wanted, atol=1e-5)


def test_later_objects_move_what_earlier_ones_moved(place, mi):
    turn = '[[object]]\nshapes = "ball-1"\nkeys = [{ frame = 0, rotation_deg = [0, 0, 90] }]\n'
    shift = '[[object]]\nshapes = "b*"\nkeys = [{ frame = 0, offset_mm = [10, 0, 0] }]\n'
    for text, wanted in ((turn + shift, (9.5, -1.0, 1.0)), (shift + turn, (-0.5, 9.0, 1.0))):
        film = film_of(place, FILM + text)
        scene = load_scene(film.scene, Placement(), film.moves(3, Placement()))
        ball = next(s for s in scene.mitsuba.shapes() if s.id() == "ball-1")
        np.testing.assert_allclose(np.array(ball.bbox().center()).ravel(), wanted, atol=1e-5)


def test_a_moved_shape_is_the_shape_there(place, mi):
    """The film's last frame against the scene with the block written there."""
    film = film_of(place, FILM + MOVE.format("block", 1, 0, 2))
    display, options = load_display(place / "small.toml"), RenderOptions("exact", settings=Settings(samples=1))
    moved = render_picture(plan_film(film, display, options)[4]).radiance
    moved_by_hand = SCENE.replace('<translate x="0" y="-1" z="0" />', '<translate x="1" y="-1" z="2" />')
    (place / "three.xml").write_text(moved_by_hand)
    there = render_picture(plan_film(film_of(place, FILM), display, options)[0]).radiance
    still = render_picture(plan_film(film_of(place, FILM), display, options)[4]).radiance
    assert psnr_db(moved, there) > 60.0
    np.testing.assert_array_equal(there, still)


def test_the_world_moves_as_render_places_it(place):
    keys = "keys = [{ frame = 0, offset_mm = [1, 0, 5], rotation_deg = [0, 25, 0], scale = 1.25 }]"
    (place / "film.toml").write_text(FILM + f"[world]\n{keys}\n")
    animate(place, "--model", "exact")
    words = ["render", str(place / "three.xml"), "--display", str(place / "small.toml"), "-o", str(place / "one.exr")]
    stand = ["--offset", "1,0,5", "--rotate", "0,25,0", "--scale", "1.25"]
    assert run([*words, "--samples", "1", "--model", "exact", *stand]) == 0
    frame, one = (read_picture(place / name) for name in ("out/frame_0003.exr", "one.exr"))
    assert psnr_db(frame.radiance, one.radiance) > 60.0
    assert frame.metadata["frame"] == "3"
    assert frame.metadata["film"] == "film"
    assert one.metadata.items() <= frame.metadata.items()


def test_scale_shrinks_the_whole_film(place, mi):
    """A quarter of everything: depths, paths and all."""
    film = film_of(place, FILM + MOVE.format("ball-*", 0, 0, 40))
    shots = [plan_film(film, load_display(place / "small.toml"), RenderOptions(), s)[4] for s in (1.0, 0.25)]
    boxes = [np.array(load_scene(film.scene, shot.placement, shot.moves).box(shot.placement))[:, 2] for shot in shots]
    np.testing.assert_allclose(0.25 * np.array(boxes[0]), boxes[1], rtol=1e-6)
    assert boxes[0][1] == pytest.approx(42.0, abs=1e-4)  # ball-1's front


def test_depths_reach_as_far_as_shapes_move(place, mi):
    """A block flies in front of the placement's near plane and is seen; a film's own near plane cuts it off."""
    (place / "three.toml").write_text("[placement]\nnear_mm = 4.0\nfar_mm = -9.0\n")
    flight = '[[object]]\nshapes = "block"\nkeys = [{ frame = 0, offset_mm = [0, 1, 20], scale = 6.0 }]\n'

    def picture(near):
        film = film_of(place, near + FILM + flight)
        return render_picture(plan_film(film, load_display(place / "small.toml"), RenderOptions("exact"))[0]).radiance

    seen, from_40, cut = (picture(near) for near in ("", "near_mm = 40.0\n", "near_mm = 4.0\n"))
    assert psnr_db(seen, from_40) > 50.0
    assert psnr_db(seen, cut) < 40.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frames = 3\n", "scene"),
        ('scene = "three.xml"\nframes = 0\n', "frames"),
        (FILM + "frames_per_second = 0\n", "frames_per_second"),
        (FILM + "frames_per_second = 0.09\n", "0.09 is not valid; give a finite number, from 0.1 to 1000"),
        (FILM + "frames_per_second = 1001\n", "frames_per_second"),
        (FILM + 'motion = "jumpy"\n', "motion"),
        (FILM + "speed = 3\n", "speed"),
        (FILM + "near_mm = 1\nfar_mm = 2\n", "in front of"),
        (FILM + "[world]\nkeys = []\n", "world.keys: is empty; give at least 1: write each of them as [[world.keys]]"),
        (FILM + "[world]\n", "world.keys: the key is missing; add it"),
        (FILM + "[world]\nkeys = [{ frame = 5 }]\n", "[0].frame: 5 is beyond the film's last frame; give at most 4"),
        (FILM + "[world]\nkeys = [{ frame = 3 }, { frame = 3 }]\n", "does not come after 3; sort the keys, at most"),
        (FILM + "[world]\nkeys = [{ frame = 0, scale = 0 }]\n", "world.keys[0].scale"),
        (FILM + "[world]\nkeys = [{ frame = 0, offset = [0] }]\n", "[0].offset: unknown key; did you mean offset_mm?"),
        (FILM + "[[object]]\nkeys = [{ frame = 0 }]\n", "object[0].shapes"),
        (FILM + '[object]\nshapes = "a"\n', 'object: {"shapes": "a"} is not valid; write each of them as [[object]]'),
        ("scene = ", "not TOML"),
    ],
)
def test_bad_films_are_refused_in_one_line(place, text, said):
    with pytest.raises(InputError) as caught:
        film_of(place, text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "refused"), [("v.gif", True), ("v.png", True), ("v.mp4", False)])
def test_a_view_that_memory_cannot_hold_is_refused(place, capsys, name, refused):
    """Before a frame is rendered: an animation keeps all of its frames in memory, a video one."""
    words = ["--view", place / name, "--eye", "0,0,200", "--width", "300", "--memory-mb", "502", "--model", "exact"]
    animate(place, *words, code=2 if refused else 0)
    err = capsys.readouterr().err
    if refused:
        assert re.search(rf"{re.escape(name)}: \d+ frames of 300 x \d+ pixels in memory: needs \d+ MB", err)
        assert "the limit is 502 MB; give a smaller --width, or an .mp4 file" in err
    assert any((place / "out").glob("frame_*")) != refused
    assert (place / name).exists() != refused


def test_what_cannot_be_rendered_is_refused(place, capsys):
    def refused(said, *words):
        animate(place, *words, code=2)
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1

    (place / "film.toml").write_text(FILM + MOVE.format("fisch-*", 0, 0, 0))
    refused("no shape's id matches 'fisch-*'; there are ball-1, ball-2, block, card")
    (place / "film.toml").write_text(FILM.replace("three", "four"))
    refused("four.xml: no such scene")
    (place / "film.toml").write_text(FILM)
    refused("--view needs --eye, and --width needs both; give", "--view", place / "view.mp4")
    refused(".mkv", "--video", place / "panel.mp4")
    refused("--view needs --eye, and --width needs both; give", "--width", "50")
    (place / "film.toml").write_text(FILM + "frames_per_second = 51\n")
    refused("at most 50 frames a second", "--view", place / "view.gif", "--eye", "0,0,200")
    assert not (place / "out").exists() or not list((place / "out").iterdir()), "refused before any work"
    (place / "film.toml").write_text(FILM)
    (place / "out").mkdir(exist_ok=True)
    (place / "out/frame_0005.exr").write_text("of a longer film")
    refused("frame_0005.exr: is beyond the film's 5 frames")
    (place / "out/frame_0005.exr").unlink()
    lock = FolderLock(place / "out", "")
    refused("out: is in use by another command; wait until that command has ended, or choose another folder with -o")
    lock.close()
    (place / "three.xml").write_text(SCENE.replace('type="cube"', 'type="obj"'))
    refused("three.xml")


def test_only_what_is_missing_or_changed_is_rendered(place, capsys):
    def rendered(*words):
        before = times(place / "out")
        animate(place, *words)
        after = times(place / "out")
        assert f"{sum(after[k] != before.get(k) for k in after)} rendered" in capsys.readouterr().out
        return {int(name[6:10]) for name in after if after[name] != before.get(name)}

    assert rendered() == {0, 1, 2, 3, 4}
    first = read_picture(place / "out/frame_0001.exr").radiance
    assert rendered() == set()
    (place / "out/frame_0001.exr").unlink()
    whole = (place / "out/frame_0003.exr").read_bytes()
    (place / "out/frame_0003.exr").write_bytes(whole[: len(whole) // 2])
    assert rendered() == {1, 3}
    np.testing.assert_array_equal(read_picture(place / "out/frame_0001.exr").radiance, first)
    # Another end: what stands where it stood is kept.
    (place / "film.toml").write_text(FILM + MOVE.format("ball-*", 1, 0, 3))
    assert rendered() == {1, 2, 3, 4}
    assert rendered("--seed", "1") == {0, 1, 2, 3, 4}
    (place / "three.xml").write_text(SCENE.replace("0.8, 0.2", "0.7, 0.2"))
    assert rendered("--seed", "1") == {0, 1, 2, 3, 4}


@pytest.mark.parametrize(("likeness", "shading"), [([60.0, 50.0], "shared"), ([60.0, 40.0], "each")])
def test_a_film_has_one_way_to_shade(place, mi, monkeypatch, capfd, likeness, shading):
    """Its key frames, 0 and 4, are tried; all frames do what all key frames allow."""
    for name, value in (("RAYS_A_POINT", 0.01), ("MIN_LAMPS", 1), ("MIN_RAYS", 1)):
        monkeypatch.setattr(irradiance_cache_choice, name, value)
    trials = iter(likeness)
    monkeypatch.setattr(irradiance_cache_choice.CacheTrial, "psnr", lambda *arguments: next(trials))
    animate(place, "--model", "exact", "--device", "llvm")
    frames = [read_picture(place / f"out/frame_{k:04d}.exr") for k in range(5)]
    assert {frame.metadata["shading"] for frame in frames} == {shading}
    err = capfd.readouterr().err
    tried = "irradiance cache, compared with each ray's own light in 100 % of the picture"
    assert err.count(f"frame 4: {tried}: PSNR {likeness[1]} dB; ") == 1
    assert err.count(f"so it is {'not ' * (shading == 'each')}used") == 1
    assert not list(trials)


def test_a_changed_picture_or_mesh_is_noticed(place, mi):
    Image.new("RGB", (2, 2), (200, 0, 0)).save(place / "skin.png")
    picture = '<texture type="bitmap" name="reflectance"><string name="filename" value="skin.png" /></texture>'
    (place / "three.xml").write_text(SCENE.replace('<rgb name="reflectance" value="0.8, 0.2, 0.1" />', picture))
    film, display = load_film(place / "film.toml"), load_display(place / "small.toml")
    before = [shot.identity for shot in plan_film(film, display, RenderOptions())]
    assert before == [shot.identity for shot in plan_film(film, display, RenderOptions())]
    assert len(set(before)) == 5
    Image.new("RGB", (2, 2), (0, 200, 0)).save(place / "skin.png")
    assert not set(before) & {shot.identity for shot in plan_film(film, display, RenderOptions())}
    (place / "skin.png").unlink()
    with pytest.raises(InputError, match=r"skin\.png"):
        plan_film(film, display, RenderOptions())


def test_an_interrupted_film_goes_on(place, mi):
    frames = 40  # a second of work and more
    (place / "film.toml").write_text(FILM.replace("5", str(frames)) + MOVE.format("ball-*", 1, 0, 2))
    words = ["animate", "film.toml", "--display", "small.toml", "--samples", "16", "-o", "out"]
    command = [sys.executable, "-m", "lippmann", *words]
    process = subprocess.Popen(command, cwd=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    until(lambda: list((place / "out").glob("frame_*.exr")), "no frames")
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=120)
    assert process.returncode == 130, error
    there = times(place / "out")
    assert 1 <= len(there) < frames
    assert {path.name for path in (place / "out").iterdir()} == set(there), "something half-written is left"
    done = subprocess.run([*command, "--json"], cwd=place, check=True, capture_output=True)
    told = json.loads(done.stdout)
    assert (told["kept"], told["rendered"]) == (len(there), frames - len(there))
    assert there.items() <= times(place / "out").items()
    display, options = load_display(place / "small.toml"), RenderOptions(settings=Settings(samples=16))
    shots = plan_film(load_film(place / "film.toml"), display, options)
    for k in (0, len(there) - 1, len(there), frames - 1):
        radiance = render_picture(shots[k]).radiance
        frame = read_picture(place / f"out/frame_{k:04d}.exr").radiance
        np.testing.assert_array_equal(frame, radiance.astype(np.float16).astype(np.float32))


def frames_in(path, width, height):
    """Return (frames a second, frames) of a video, by the program itself."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, check=True, capture_output=True)
    speed = re.search(r" ([\d.]+) fps", done.stderr.decode())
    assert f" {width}x{height}" in done.stderr.decode()
    return float(speed[1]), np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3)


def test_the_panels_video_is_lossless(place):
    (place / "film.toml").write_text("frames_per_second = 7.5\n" + FILM + MOVE.format("ball-*", 1, 0, 2))
    animate(place, "--video", place / "panel.mkv")
    speed, frames = frames_in(place / "panel.mkv", 46, 32)
    assert (speed, len(frames)) == (7.5, 5)
    for k, frame in enumerate(frames):
        radiance = read_picture(place / f"out/frame_{k:04d}.exr").radiance
        np.testing.assert_array_equal(frame, np.rint(encode(radiance, "srgb") * 255))


def test_views_are_what_the_eye_sees(place):
    for name in ("view.mp4", "view.gif"):
        animate(place, "--view", place / name, "--eye", "1,0,200", "--width", "31")
    speed, frames = frames_in(place / "view.mp4", 32, 22)  # both sides even
    assert (speed, len(frames)) == (12.0, 5)
    common = ["--display", str(place / "small.toml"), "--eye", "1,0,200", "--width", "32", "-o", str(place / "one.png")]
    for k in (0, 4):
        assert run(["observe", str(place / f"out/frame_{k:04d}.exr"), *common]) == 0
        one = np.asarray(Image.open(place / "one.png").convert("RGB"), np.float64)
        error = frames[k].astype(np.float64) - one
        assert abs(error.mean()) < 4.0, "colours shifted"
        assert 10.0 * np.log10(255.0**2 / (error**2).mean()) > 25.0
    with Image.open(place / "view.gif") as film:
        assert film.n_frames == 5
        assert film.info["duration"] == 80  # GIF counts hundredths of a second


def test_a_video_that_cannot_be_written_is_told(tmp_path):
    frames = [np.zeros((15, 15, 3), np.uint8)] * 3
    with pytest.raises(InputError, match="does not exist"):
        write_video(tmp_path / "none/bad.mkv", frames, 15, 15, 10.0)
    with pytest.raises(InputError, match="ffmpeg stopped"):
        write_video(tmp_path / "odd.mp4", frames, 15, 15, 10.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "speed"),
    [("view.gif", 50.0), *itertools.product(("view.png", "view.mp4", "panel.mkv"), (0.1, 1000.0)), ("view.gif", 0.1)],
)
def test_every_speed_can_be_written(place, name, speed):
    """The slowest and the fastest; each frame stands as long as is said."""
    (place / "film.toml").write_text(f"frames_per_second = {speed}\n" + FILM + MOVE.format("ball-*", 1, 0, 2))
    view = ("--view", place / name, "--eye", "1,0,200", "--width", "60")
    animate(place, *(("--video", place / name) if name == "panel.mkv" else view))
    if name.endswith((".mkv", ".mp4")):
        _, seconds = imageio_ffmpeg.count_frames_and_secs(str(place / name))
        assert seconds == pytest.approx(5 / speed, abs=0.01)  # ffmpeg tells hundredths
        return
    with Image.open(place / name) as film:
        times = [(film.seek(k), film.info["duration"])[1] for k in range(film.n_frames)]
    assert times == [1000.0 / speed] * 5
