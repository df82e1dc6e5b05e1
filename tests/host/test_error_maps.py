"""Errors of foreign rays: counted in maps and histograms by hand-made rays, and shown on a page."""

import csv
import json

import numpy as np
import pytest
from lippmann.cli import run
from lippmann.conformance.comparison import Bounds
from lippmann.conformance.judge import judge
from lippmann.conformance.ray_sets import ForeignRays, PanelRays, foreign_from_words
from lippmann.conformance.regress_page import ErrorMaps, edges
from lippmann.fixed.ray_pipeline import FixedRays
from optics_cases import display_of
from scene_cases import display_toml

DISPLAY = display_of("square", "panel", radius=2.0, thickness=None, width_px=96, height_px=48, pixel_pitch=0.1)


def test_maps_and_bins_by_hand():
    """48 cells a side: pixel (10.5, 20.5) of 96 x 48 is cell (5, 20); aperture (0.3, -0.3) of 1.2 pitches (36, 12)."""
    pixels = np.array([[10.5, 20.5], [10.9, 20.1], [95.9, 47.9], [1.0, 1.0], [2.0, 2.0]])
    aims = np.array([[0.3, -0.3], [0.3, -0.3], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    far = np.array([3e-6, 2e-6, 0.0, 1.0, np.inf])
    judged = np.array([True, True, True, False, True])
    maps = ErrorMaps()
    for part in (slice(0, 2), slice(2, 5)):
        given = PanelRays("hand", DISPLAY, pixels[part], aims[part])
        maps.count(given, {"direction": far[part]}, {"direction": np.full(5, 1e-6)[part]}, judged[part])
    found = maps["direction"]
    assert (found.unit, found.rays) == ("microradian", 3)
    assert (found.worst, found.worst_units) == (pytest.approx(3.0), pytest.approx(3.0))
    for counted, cells in (
        (found.panel, {(20, 5): pytest.approx(3.0), (47, 47): 0.0}),
        (found.lenslet, {(12, 36): pytest.approx(3.0), (24, 24): 0.0}),
    ):
        assert {tuple(map(int, cell)): counted[tuple(cell)] for cell in np.argwhere(counted >= 0.0)} == cells
    # 2 and 3 lie between 10^0.25 = 1.78 and 10^0.5 = 3.16.
    place = int(np.argmin(np.abs(edges() - 10**0.25))) + 1
    assert {int(k): int(found.counts[k]) for k in np.flatnonzero(found.counts)} == {0: 1, place: 2}


def test_tiny_and_huge_errors_are_counted_at_the_ends():
    given = PanelRays("hand", DISPLAY, np.full((2, 2), 3.0), None)
    maps = ErrorMaps()
    maps.count(given, {"origin_mm": np.array([1e-30, 1e30])}, {"origin_mm": np.ones(2)}, np.ones(2, bool))
    assert maps["origin_mm"].unit == "nm"
    assert np.flatnonzero(maps["origin_mm"].counts).tolist() == [1, len(edges())]


def chief(count, seed):
    pixels = np.random.default_rng(seed).uniform((0, 0), (96, 48), (count, 2))
    return PanelRays("foreign", DISPLAY, pixels, None)


def test_a_planted_error_of_numbers_is_at_its_pixel():
    """A direction within 60 degrees of the axis: a float32 of its largest component has steps of 2^-24."""
    given = chief(200, 3)
    direction = given.trace().direction.copy()
    ray = int(np.argmax(np.abs(direction[:, 2]) > 0.75))
    direction[ray, 0] += 1e-5
    maps, foreign = ErrorMaps(), ForeignRays(given, {"direction": direction})
    maps.add(foreign, Bounds())
    assert judge(foreign, two_faults=False).wrong == 1
    found = maps["direction"]
    column, row = (np.floor(given.pixels[ray] / (2.0, 1.0))).astype(int)
    assert found.panel[row, column] == found.panel.max() == pytest.approx(10.0, rel=1e-9)
    assert found.worst_units == pytest.approx(1e-5 / 2.0**-24, rel=1e-9)
    assert found.counts[0] == 199


def test_a_word_that_is_one_off_is_one_unit_off():
    bits = 16
    words = {name: np.zeros(50, np.int64) for name in (*"uvab", *FixedRays._fields)}
    words |= {"u": np.arange(50) << 18, "v": np.full(50, 24 << 18)}
    twin = foreign_from_words(words, DISPLAY, "exact", bits).words[0].trace()
    columns = {**words, **{name: getattr(twin, name).copy() for name in FixedRays._fields}}
    columns["dx"][7] += 1
    columns["y"][9] -= 2
    maps, foreign = ErrorMaps(), foreign_from_words(columns, DISPLAY, "exact", bits)
    maps.add(foreign, Bounds())
    assert judge(foreign).wrong == 2
    assert maps["direction"].worst_units == pytest.approx(1.0)
    assert maps["direction"].worst == pytest.approx(1e6 * 2.0**-17)
    assert maps["local_mm"].worst_units == pytest.approx(2.0)
    assert maps["local_mm"].worst == pytest.approx(1e6 * 2.0 * 2.0 * 2.0**-17)
    assert [int(found.counts[0]) for found in maps.values()] == [49, 49]


@pytest.mark.parametrize("added", [0.0, 1e-4])
def test_the_page_tells_the_verdict(added, tmp_path, capsys):
    given = chief(300, 5)
    rays = given.trace()
    direction = rays.direction + np.array([added, 0.0, 0.0])
    (tmp_path / "d.toml").write_text(display_toml(DISPLAY))
    np.savez(tmp_path / "mine.npz", pixel=given.pixels, direction=direction, origin_mm=rays.origin_mm)
    words = ["regress", "--display", tmp_path / "d.toml", "--rays", tmp_path / "mine.npz", "--json"]
    code = run([*map(str, words), "--report", str(tmp_path / "page")])
    assert code == (4 if added else 0)
    page = (tmp_path / "page/errors.md").read_text()
    assert "# Errors of 300 rays" in page
    if added:
        assert "**1 of 1 sets wrong.** The first: mine, 300 of 300 rays, step exit; a constant added" in page
        assert "| exit | direction | 300 | 100 | microradian |" in page
    else:
        assert "**Right**, in 1 set." in page
    assert "| dome | origin_mm | 300 | 0 | nm | 0 |" in page
    with (tmp_path / "page/errors-sets.csv").open() as file:
        (row,) = csv.DictReader(line for line in file if line[0] != "#")
    assert (row["set"], row["rays"], row["wrong"]) == ("mine", "300", "300" if added else "0")
    assert json.loads(capsys.readouterr().out)["right"] is (added == 0.0)
    assert (tmp_path / "page/errors.html").read_text().count("<img") == 2
