"""`python -m tools.bench`: its sub-commands, old command lines, kept pages; what `content` and `shading` measure."""

import json
import math
import re

import click.testing
import numpy as np
import pytest
from lippmann.conformance.figures import read_csv
from lippmann.rendering.options import Settings
from lippmann.rendering.pixel_filter import noise_fraction
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.placement import Placement, arranged
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from scene_cases import focused_display
from tools import bench, content, measured_page, motion_speed, renderer_speed, shading_speed
from tools.calibration_accuracy import accuracy_page
from tools.content import Surface, content_page, write_meshes, write_splats
from tools.hard_case_errors import hard_page
from tools.layers_likeness import layers_page
from tools.link_speed import link_page
from tools.shading_speed import shading_page
from tools.stage_errors import fixed_page

SCENES = str(repository() / "scenes")
REPORTS = repository() / "docs/generated/reports"
ROW = {"display": "vga-square", "frames": 24, "width_px": 640, "height_px": 480, "pixels_differ": 0, "ratio": 0.75}
ROW |= {"one_seconds": 20.0, "one_cpu_seconds": 30.0}
ROW |= {"workers": 2, "workers_seconds": 15.0, "workers_cpu_seconds": 31.0}


@pytest.fixture
def measured(monkeypatch):
    """`bench animate`, with a row that is made up; what it was called with."""
    calls = []

    def measure(scenes, seed):
        calls.append((str(scenes), seed))
        yield ROW

    monkeypatch.setattr(motion_speed, "measure_animate", measure)
    return calls


def test_old_command_lines_work(measured, capfd):
    """Options before the measurement, as version 0.1 allowed."""
    assert bench.main(["--scenes", SCENES, "--json", "animate", "--device", "llvm", "--seed", "5"]) == 0
    said = json.loads(capfd.readouterr().out)
    assert measured == [(SCENES, 5)]
    assert said["rows"] == [ROW]
    assert {"machine", "date", "command", "versions"} < set(said)
    assert said["command"] == f"python -m tools.bench animate --scenes {SCENES} --seed 5 --device llvm"


def test_the_origin_tells_a_command_that_runs(monkeypatch, capfd):
    """Options whose names are not those of the parameters, and a switch; nothing is calibrated."""
    for name in ("measure", "largest", "sweep", "views"):
        monkeypatch.setattr(f"tools.calibration_accuracy.{name}", lambda *args, **own: iter(()))
    words = "calibration --seed 3 --sweep 1 --width 320 --solids 2 --large --device llvm --json"
    assert bench.main([*words.split(), "--scenes", SCENES]) == 0
    first = json.loads(capfd.readouterr().out)["command"]
    assert {"--sweep 1", "--width 320", "--solids 2", "--large"} <= set(re.findall(r"--\w+(?: \d+)?", first))
    assert bench.main([*first.split()[3:], "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["command"] == first


def test_rows_as_text_and_as_page(measured, capfd, tmp_path):
    assert bench.main(["animate", "--scenes", SCENES, "--device", "llvm", "--report", str(tmp_path)]) == 0
    text = capfd.readouterr().out
    assert text.splitlines()[-1].strip("| ").split(" | ")[:4] == ["vga-square", "24", "640", "480"]
    origin, rows = read_csv(tmp_path / "measured/animate.csv")
    assert rows[0]["ratio"] == 0.75
    page = (tmp_path / "measured.md").read_text()
    assert f"Measured on {origin['machine']}, {origin['date']}." in page
    assert "| vga-square | 24 | 640 | 480 | 0 | 31 | 30 | 15 | 20 | 0.75 |" in page
    assert "Not measured yet." in page


def test_each_measurement_has_its_own_options_only(capfd):
    for words in (["trace", "--quick"], ["link", "--configuration", "widest-square"]):
        assert bench.main([*words, "--scenes", SCENES]) == 2
        assert "No such option" in capfd.readouterr().err
    # A device that is not used is still accepted.
    for name in ("fixed", "rtl", "link"):
        command = bench.command.get_command(None, name)
        assert any("--device" in option.opts and option.hidden for option in command.params)


def test_every_measurement_is_listed_and_has_an_example():
    runner = click.testing.CliRunner()
    listed = runner.invoke(bench.command, ["--help"]).output
    for name in bench.MEASUREMENTS:
        assert name in listed
        result = runner.invoke(bench.command, [name, "--help"])
        assert result.exit_code == 0
        assert f"Example: python -m tools.bench {name}" in result.output


def test_ratios_of_two_renders_are_taken_within_a_round(monkeypatch):
    times = iter([2.0, 1.0, 6.0, 2.0, 4.0, 1.0])
    monkeypatch.setattr(renderer_speed, "with_lenslets_across", lambda display, across: display)
    monkeypatch.setattr(renderer_speed, "timed", lambda *render: lambda: next(times))
    row = renderer_speed.lenslet_growth(None, None, None)
    assert (row["ratio"], row["ratio_least"], row["ratio_most"]) == (3.0, 2.0, 4.0)
    assert (row["seconds_10404_lenslets"], row["seconds_121_lenslets"]) == (4.0, 1.0)


def kept(name):
    origin, rows = read_csv(REPORTS / f"{name}.csv")
    truth = {"True": True, "False": False}
    return origin, [{key: truth.get(value, value) for key, value in row.items()} for row in rows]


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (fixed_page, ("fixed-point-error", "fixed-point-budget")),
        (link_page, ("link-efficiency", "link-frames")),
        (hard_page, ("hard-cases", "hard-cases-fixed", "hard-cases-formulas")),
        (layers_page, ("layers",)),
        (content_page, ("content",)),
    ],
)
def test_kept_pages_are_those_of_the_kept_rows(make, names):
    read = [kept(name) for name in names]
    assert len({tuple(origin.items()) for origin, _ in read}) == 1
    page = make(read[0][0], *(rows for _, rows in read))
    assert (REPORTS / f"{page.name}.md").read_text() == page.text() + "\n"


def test_the_page_of_calibrations():
    """Of the kept rows, and of refusals, of which there are none among them."""
    names = {"rows": "accuracy", **{name: name for name in ("solids", "bowed", "large", "sweep", "views")}}
    tables = {name: kept(f"calibration-{file}")[1] for name, file in names.items()}
    tables["rows"].append({"display": "bad", "refused": "blurred"})
    tables["sweep"].append({"display": "one", "over": "noise", "photographs": 99, "value": 4, "refused": "too dark"})
    page = accuracy_page({}, tables, 640)
    text = page.text()
    assert {plot.name for plot in page.plots} == {"calibration-accuracy", "calibration-sweep"}
    for name, before in (("solids", "by POV-Ray the error is "), ("bowed", "wrong, the error is ")):
        worst = max(row["rms_px"] for row in tables[name])
        assert f"{before}at most {worst:.3f} px rms on {len(tables[name])} displays" in " ".join(text.split())
    for row in tables["views"]:
        words = f"of {row['before_db']:.1f} dB before calibration, {row['after_db']:.1f} dB after"
        assert words in " ".join(text.split())
    assert "displays were refused: blurred" in text
    assert "| one | noise | 4 | 99 | - | - | - | - | - | - | too dark |" in text


@pytest.mark.parametrize(
    ("name", "device", "wide", "kept"),
    [
        ("render", "llvm", False, "render"),
        ("render", "llvm", True, "render-avx512"),
        ("stages", "cuda", True, "stages-cuda"),
        ("live", "llvm", True, "live"),  # has one set of figures for all processors
    ],
)
def test_figures_of_devices_stand_beside_each_other(monkeypatch, name, device, wide, kept):
    monkeypatch.setattr(measured_page, "has_avx512", lambda: wide)
    assert measured_page.measured_name(name, device) == kept
    assert kept in measured_page.MEASURED


def test_measured_figures_are_those_of_the_kept_rows():
    docs = repository() / "docs/generated"
    assert {path.stem for path in (docs / "measured").iterdir()} <= set(measured_page.MEASURED)
    assert (docs / "measured.md").read_text() == measured_page.measured_page(docs).text() + "\n"


@pytest.mark.parametrize("name", ["report", "fixed-point-error", "depth", "hard-cases", "peers", "link", "layers"])
def test_a_report_opens_with_a_plot_and_at_most_five_lines(name):
    text = (REPORTS / f"{name}.md").read_text()
    blocks = [block for block in text.split("\n\n") if block.strip()]
    assert blocks[0].startswith("# ")
    assert blocks[1].startswith("![")
    assert blocks[3].startswith("- ")
    assert len([line for line in blocks[3].splitlines() if line.startswith("- ")]) <= 5
    tables = [block for block in blocks if "\n| --- |" in block]
    assert tables
    assert all(block.strip().startswith("| ") for block in tables), "a blank line before each table"
    picture = REPORTS / blocks[1].rpartition("](")[2].removesuffix(")")
    assert picture.is_file()
    assert len(text.split()) < (3_000 if name == "report" else 1_300)


def test_a_report_goes_into_a_folder_that_exists(tmp_path, capfd):
    """As every other output; known before minutes of measuring."""
    missing = tmp_path / "kept/here"
    assert bench.main(["fixed", "--scenes", SCENES, "--report", str(missing)]) == 2
    assert f"the folder {missing} does not exist; make the folder first" in capfd.readouterr().err


SCENE_FOLDER = repository() / "scenes"


def test_every_mesh_and_the_splats_show_the_same_knot(tmp_path, mi):
    """Its texture's bright and dark dots, and without them the same outline as the STL."""
    knot, window = (
        Surface.read(SCENE_FOLDER / "knot/knot.ply", SCENE_FOLDER / "knot/skin.png"),
        Window(90.0, 90.0, 90, 90),
    )

    def seen(path, samples, placement=None):
        return render_view(load_scene(path, placement), (0.0, 0.0, 600.0), window, Settings(samples)).radiance

    meshes = {
        path.suffix: seen(path, 4, Placement(rotation_deg=(-90.0 * (path.suffix == ".stl"), 0.0, 0.0)))
        for path in write_meshes(knot, tmp_path)
    }
    outline = meshes[".stl"].max(axis=2) > 0.02
    for suffix in (".glb", ".obj", ".ply"):
        assert (outline ^ (meshes[suffix].max(axis=2) > 0.02)).mean() < 0.03
        assert np.std(meshes[suffix][outline], axis=0).min() > 0.1
    assert np.median(np.abs(meshes[".obj"] - meshes[".ply"])[outline]) < 0.05

    splats, wanted = seen(write_splats(knot, tmp_path / "s.ply", 1), 1), meshes[".glb"]
    there = wanted.max(axis=2) > 0.02
    assert (splats.max(axis=2)[there] > 0.05).mean() > 0.97
    assert (splats.max(axis=2)[~there] > 0.05).mean() < 0.1
    hue = [view[there] / np.maximum(view[there].sum(axis=1, keepdims=True), 1e-6) for view in (splats, wanted)]
    assert np.median(np.abs(hue[0] - hue[1])) < 0.05


@pytest.mark.full
def test_more_views_are_nearer_to_the_scene(tmp_path, monkeypatch, mi):
    monkeypatch.setattr(content, "VIEWS", ((3, 1), (16, 1)))
    monkeypatch.setattr(content, "SAMPLES", 2)
    rows = list(content.measure(SCENE_FOLDER, tmp_path, 1))
    few, many, depths, itself = (row["middle_db"] for row in rows)
    assert few < many < itself
    assert depths > few - 3.0
    assert "| views | 16 | 1 |" in content_page({}, rows).text()


@pytest.mark.full
def test_the_gallery_has_a_picture_of_each_kind(tmp_path, monkeypatch, mi):
    monkeypatch.setattr(content, "GALLERY", "vga-square")
    pictures, captions = content.gallery(SCENE_FOLDER, tmp_path, 1)
    assert len(pictures) == len(captions) == 8
    assert captions[-3:] == ["views/", "quilt_qs8x2a1.33333.png", "picture.toml"]
    assert all(picture.max() > 0.2 for picture in pictures)


def test_a_depth_picture_is_placed_by_its_camera(tmp_path, mi):
    display = content.load_display(SCENE_FOLDER / "displays/vga-square.toml")
    scene = load_scene(SCENE_FOLDER / "fish/fish.xml", Placement(0.25))
    path = content.write_depth_picture(scene, display, tmp_path, 160)
    placed = arranged(load_scene(path), display, "camera")
    # The camera was the display's eye: the scale brings the surface on the axis to the panel.
    near = placed.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(0.0), mi.Vector3f(0.0, 0.0, -1.0))).t
    assert placed.placement.scale == pytest.approx(600.0 / float(np.array(near).ravel()[0]), rel=1e-6)


@pytest.fixture(scope="module")
def display():
    return focused_display("square", width_px=144, height_px=96, pixel_pitch=1.0 / 12.0)


@pytest.fixture
def fish(mi, tmp_path):
    return load_scene(shading_speed.with_lamps(SCENE_FOLDER / "fish/fish.xml", 2, tmp_path))


def test_a_scene_has_as_many_lamps_as_asked_and_their_power(fish, mi):
    lamps = [mi.traverse(lamp) for lamp in fish.mitsuba.emitters()]
    assert len(lamps) == 2
    power = [np.array(lamp["intensity.value"]).ravel() for lamp in lamps]
    np.testing.assert_allclose(np.sum(power, axis=0), shading_speed.POWER, rtol=1e-5)
    np.testing.assert_allclose(np.array(lamps[0]["position"]).ravel()[2], shading_speed.HEIGHT_MM)


def test_the_page_shows_every_way(tmp_path, monkeypatch, display, mi):
    monkeypatch.setattr(shading_speed, "load_display", lambda path: display)
    for name, value in (("LAMPS", (1, 2)), ("SAMPLES", (1, 2)), ("SCENES", ("fish",)), ("CAPTURED", ())):
        monkeypatch.setattr(shading_speed, name, value)
    rows = list(shading_speed.curves(SCENE_FOLDER, tmp_path, 1))
    assert [(row["lamps"], row["way"], row["samples"]) for row in rows[:7]] == [
        *((1, way, samples) for way in shading_speed.WAYS for samples in (1, 2)), (2, "each", 1)
    ]  # fmt: skip
    # Twice the samples, half the noise's power: 3 dB, beside what pixels gain that share samples.
    gain = rows[1]["panel_db"] - rows[0]["panel_db"] + 20.0 * math.log10(noise_fraction(2, 1))
    assert 1.0 < gain < 5.0
    (pair,) = shading_speed.likeness(SCENE_FOLDER, 1)
    assert (pair["scene"], pair["auto"]) == ("fish", "each")  # the picture is small
    assert min(pair["panel_db"], pair["view_db"]) > 40.0
    saved = [{"scene": "fish", "samples": 4, "power": 1.5, "pixel": 2.0, "tile": 1.2, "found": 1.1}]
    tables = {"shading": rows, "shading-likeness": [pair], "shading-adaptive": saved}
    page = shading_page({"machine": "one"}, tables, shading_speed.error_map(SCENE_FOLDER, 1))
    assert {path.name for path in page.write(tmp_path / "page")} == {
        *(f"{name}.csv" for name in tables), "shading.md", "shading.png", "shading-map.png",
    }  # fmt: skip


def test_samples_go_where_the_noise_is():
    """Half of the pixels with 9 times the error of the others, by hand; nothing is saved where all are alike."""
    true = np.array([1.0, 9.0])
    # n = c and 3 c: noise (1 / c + 3 / c) / 2 = 5 / 8, so c = 3.2, and 6.4 samples instead of 8.
    assert shading_speed.samples_needed(true, true, 8.0, 1.0, 1.0) == pytest.approx(6.4)
    assert shading_speed.samples_needed(true, np.array([2.0, 18.0]), 8.0, 1.0, 1.0) == pytest.approx(6.4)
    # Errors 1 / n^3 and 16 / n^3, n = c and 2 c: 3 / 2 c^3 = 17 / 2 x 8^3.
    even = shading_speed.samples_needed(np.array([1.0, 16.0]), np.array([1.0, 16.0]), 8.0, 1.0, 3.0)
    assert even == pytest.approx(1.5 * (3.0 * 512.0 / 17.0) ** (1.0 / 3.0))
    # At least 5 each: the other one needs 9 / n = 10 / 8 - 1 / 5.
    assert shading_speed.samples_needed(true, true, 8.0, 5.0, 1.0) == pytest.approx(0.5 * (5.0 + 9.0 / 1.05))
    assert shading_speed.samples_needed(np.ones(3), np.ones(3), 8.0, 1.0, 1.0) == pytest.approx(8.0)
    assert shading_speed.samples_needed(true, np.array([1.0, 0.0]), 8.0, 1.0, 1.0) == 8.0


@pytest.mark.full
def test_what_is_known_saves_more_than_what_is_found(mi, monkeypatch):
    monkeypatch.setattr(shading_speed, "SCENES", ("fish",))
    monkeypatch.setattr(shading_speed, "SIDE_PX", 160)
    for row in shading_speed.samples_saved(SCENE_FOLDER, 1):
        assert row["pixel"] >= row["tile"] >= 1.0
        assert row["pixel"] >= row["found"] >= 1.0
