"""`tools.bench shading`: its ways to light samples, its scenes and its page, on a small display."""

import math

import numpy as np
import pytest
from lippmann.rendering.pixel_filter import noise_fraction
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from scene_cases import focused_display
from tools import shading_speed
from tools.shading_speed import shading_page

SCENES = repository() / "scenes"


@pytest.fixture(scope="module")
def display():
    return focused_display("square", width_px=144, height_px=96, pixel_pitch=1.0 / 12.0)


@pytest.fixture
def fish(mi, tmp_path):
    return load_scene(shading_speed.with_lamps(SCENES / "fish/fish.xml", 2, tmp_path))


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
    rows = list(shading_speed.curves(SCENES, tmp_path, 1))
    assert [(row["lamps"], row["way"], row["samples"]) for row in rows[:7]] == [
        *((1, way, samples) for way in shading_speed.WAYS for samples in (1, 2)), (2, "each", 1)
    ]  # fmt: skip
    # Twice the samples, half the noise's power: 3 dB, beside what pixels gain that share samples.
    gain = rows[1]["panel_db"] - rows[0]["panel_db"] + 20.0 * math.log10(noise_fraction(2, 1))
    assert 1.0 < gain < 5.0
    (pair,) = shading_speed.likeness(SCENES, 1)
    assert (pair["scene"], pair["auto"]) == ("fish", "each")  # the picture is small
    assert min(pair["panel_db"], pair["view_db"]) > 40.0
    saved = [{"scene": "fish", "samples": 4, "power": 1.5, "pixel": 2.0, "tile": 1.2, "found": 1.1}]
    tables = {"shading": rows, "shading-likeness": [pair], "shading-adaptive": saved}
    page = shading_page({"machine": "one"}, tables, shading_speed.error_map(SCENES, 1))
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
    for row in shading_speed.samples_saved(SCENES, 1):
        assert row["pixel"] >= row["tile"] >= 1.0
        assert row["pixel"] >= row["found"] >= 1.0
