"""Measures time and error of shading methods, and the possible gain by adaptive sampling (`tools.bench shading`)."""

from __future__ import annotations

import itertools
import math
import sys
import xml.etree.ElementTree as Xml
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
from lippmann.base.files import scratch_folder
from lippmann.base.images import Radiance
from lippmann.base.tones import encode, psnr_db
from lippmann.base.variant import dr, mi
from lippmann.capturing.capture import capture, placement_before
from lippmann.capturing.capture_setup import load_setup
from lippmann.conformance.engine_report import EYE_MM, VIEW_SAMPLES, middle
from lippmann.conformance.figures import Rows, groups
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import Plot, finish_picture, make_axes
from lippmann.display.description import Display, load_display
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.rendering import renderer
from lippmann.rendering.options import Settings, Shading
from lippmann.rendering.renderer import Rendered, render_integral, render_rays
from lippmann.rendering.sampling import TILE_PX, Lines, RaySource, display_source
from lippmann.rendering.shading import CachedProgram
from lippmann.rendering.surface_lattice import NONE, Place
from lippmann.scenes.placement import placement_beside
from lippmann.scenes.scene import Scene, load_scene
from scipy.ndimage import uniform_filter

from tools.bench import MeasurementRun, measurement
from tools.report_plots import contact_sheet, draw_lines, make_page

#: The measured display, numbers of lamps, and numbers of samples per pixel.
DISPLAY, LAMPS, SAMPLES = "paper-square", (1, 2, 5, 20), (1, 2, 4, 8)
#: Samples per pixel of the reference; one of every `EVERY_ROW` pixel rows is compared.
REFERENCE_SAMPLES, EVERY_ROW = 64, 16
#: The circle of lamps: radius and distance in front of the display, mm; total power of the lamps.
RADIUS_MM, HEIGHT_MM, POWER = 1000.0, 850.0, 1.2e7
#: Scenes with which the irradiance cache is tested; captured ones and their set-up; samples per pixel.
SCENES, CAPTURED, SETUP, COMPARED_SAMPLES = ("fish", "chart", "knot"), ("diffuse", "full"), "fig8a", 4
MAP_GAIN = 50.0
#: Adaptive sampling: side of the rendered middle of the display, px; samples per pixel of a pilot picture, the minimum
#: for each pixel; number of pilots for the true error; samples of a finer picture, which shows how fast the error
#: falls; samples of the reference; samples of the uniform pictures whose noise must be reached.
SIDE_PX, PILOT, PICTURES, FINE, REFERENCE, EVEN_SAMPLES = 480, 2, 16, 16, 256, (4, 8, 16)
Field = npt.NDArray[np.float64]


class Decoupled(CachedProgram):
    """A shading method that computes light once for each surface that a pixel's samples meet, at the first sample."""

    def light_of(self, place: Place, cached: Any) -> Any:
        """Return each sample's light: that of the pixel's first sample on the same side of the same shape."""
        shape = dr.gather(mi.UInt32, self.cache.lattices.shape, place.lattice, cached)
        surface = dr.select(cached, 2 * shape + dr.select(place.back, mi.UInt32(1), mi.UInt32(0)), NONE)
        dr.eval(surface)
        lane = dr.arange(mi.UInt32, dr.width(surface))
        pixel, first = lane // self.samples * self.samples, lane
        for k in reversed(range(self.samples)):
            first = dr.select(dr.gather(mi.UInt32, surface, pixel + k) == surface, pixel + k, first)
        firsts = dr.compress(cached & (first == lane))
        light = dr.zeros(mi.Color3f, dr.width(surface))
        if dr.width(firsts):
            at = (dr.gather(type(one), one, firsts) for one in (place.lattice, place.u, place.v, place.back))
            dr.scatter(light, self.cache.at(Place(*at)), firsts)
        return dr.gather(mi.Color3f, light, first, cached)


#: The shading methods, each with its setting `shading` and its class.
WAYS: dict[str, tuple[Shading, type[CachedProgram]]] = {
    "each": ("each", CachedProgram),
    "decoupled": ("shared", Decoupled),
    "shared": ("shared", CachedProgram),
}


def with_lamps(path: Path, lamps: int, scratch: Path) -> Path:
    """Write a copy of a scene, lit only by point lamps of constant total power on a circle; return its path."""
    tree = Xml.parse(path)
    root = tree.getroot()
    for lamp in root.findall("emitter"):
        root.remove(lamp)
    for name in root.iterfind(".//string[@name='filename']"):
        name.set("value", str((path.parent / name.get("value", "")).resolve()))
    for k in range(lamps):
        angle = math.tau * (k + 0.25) / lamps
        lamp = Xml.SubElement(root, "emitter", type="point")
        place = f"{RADIUS_MM * math.cos(angle):.3f} {RADIUS_MM * math.sin(angle):.3f} {HEIGHT_MM:g}"
        Xml.SubElement(lamp, "point", name="position", value=place)
        Xml.SubElement(lamp, "rgb", name="intensity", value=f"{POWER / lamps:g}")
    tree.write(scratch / f"{lamps}-lamps.xml")
    return scratch / f"{lamps}-lamps.xml"


def curves(scenes: Path, scratch: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield rows of time and error: `way` is the method, `seconds` exclude compilation, `panel_db` is the PSNR."""
    display, fish = load_display(scenes / f"displays/{DISPLAY}.toml"), scenes / "fish/fish.xml"
    for lamps in LAMPS:
        scene = load_scene(with_lamps(fish, lamps, scratch), placement_beside(fish))
        # The reference has the rows of `every_strip`, with light computed per ray.
        settings = Settings(REFERENCE_SAMPLES, seed=seed + 1, shading="each")
        source = every_strip(display_source(display, "exact", REFERENCE_SAMPLES, "chief", "fast", None), EVERY_ROW)
        reference = render_rays(scene, source, settings).radiance
        for name, samples in itertools.product(WAYS, SAMPLES):
            seconds, picture = _drawn(scene, display, Settings(samples, seed=seed), name)
            decibels = psnr_db(picture[rows_of_strips(len(picture), EVERY_ROW)], reference)
            yield {"lamps": lamps, "way": name, "samples": samples, "seconds": seconds, "panel_db": decibels}


def _drawn(scene: Scene, display: Display, settings: Settings, name: str) -> tuple[float, Radiance]:
    shading, program = WAYS[name]
    source = display_source(display, "exact", settings.samples, "chief", "fast", None)
    with patch.object(renderer, "CachedProgram", program):
        rendered = render_rays(scene, source, replace(settings, shading=shading))
    return rendered.seconds, rendered.radiance


def likeness(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the PSNR of pictures and views with the irradiance cache; `auto` is `--shading auto`'s choice."""
    for name in (*SCENES, *CAPTURED):
        (each, shared, auto), display = _drawn_scene(scenes, name, seed, ("each", "shared", "auto"))
        panel_db = psnr_db(shared.radiance, each.radiance)
        view_db = psnr_db(_view(shared.radiance, display), _view(each.radiance, display))
        yield {"scene": name, "panel_db": panel_db, "view_db": view_db, "auto": auto.shading}


def error_map(scenes: Path, seed: int) -> tuple[list[Radiance], list[str]]:
    """Return two views of the fish (light per ray, and from the irradiance cache), their difference, and captions."""
    drawn, display = _drawn_scene(scenes, SCENES[0], seed, ("each", "shared"))
    views = [_view(one.radiance, display) for one in drawn]
    difference = np.abs(views[1] - views[0]) * np.float32(MAP_GAIN)
    return [*views, difference], ["each ray's own light", "irradiance cache", f"difference, {MAP_GAIN:g} times"]


def _drawn_scene(scenes: Path, name: str, seed: int, shadings: Sequence[Shading]) -> tuple[list[Rendered], Display]:
    """Return a scene's pictures with each shading, and the display that shows them."""
    ways = [Settings(COMPARED_SAMPLES, seed=seed, shading=shading) for shading in shadings]
    if name in CAPTURED:
        setup = load_setup(scenes / f"setups/{SETUP}.toml")
        path = scenes / f"seed/{name}.xml"
        scene = load_scene(path, placement_before(setup, path))
        return [capture(scene, setup, one, rotate=True) for one in ways], setup.display
    display = load_display(scenes / f"displays/{DISPLAY}.toml")
    scene = load_scene(scenes / f"{name}/{name}.xml")
    return [render_integral(scene, display, "exact", one) for one in ways], display


def _view(picture: Radiance, display: Display) -> Radiance:
    return observe(picture, display, Eye(EYE_MM), whole_window(display), VIEW_SAMPLES).radiance


def samples_saved(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the factors by which samples could be reduced at equal noise, if they were distributed by the noise.

    A pixel of n samples has the mean squared error v / n^p, with one p (`power`) for the picture: 1 for random samples,
    more for evenly spread samples. For a given mean error, n proportional to v^(1 / (1 + p)) needs the fewest samples
    (Lagrange), but each pixel needs a few samples before v is known. v is known for each `pixel` or `tile`, or is
    `found` from two pilot pictures (their samples count), averaged over neighbours.
    """
    display = middle(load_display(scenes / f"displays/{DISPLAY}.toml"), SIDE_PX)
    for name in SCENES:
        scene = load_scene(scenes / f"{name}/{name}.xml")
        exact = _encoded(scene, display, seed + PICTURES, REFERENCE)
        pictures = [_encoded(scene, display, seed + k, PILOT) for k in range(PICTURES)]
        of_pilots = np.mean([_apart(picture, exact) for picture in pictures], axis=0)
        of_fine = _apart(_encoded(scene, display, seed, FINE), exact)
        power = math.log(of_pilots.mean() / of_fine.mean()) / math.log(FINE / PILOT)
        true = of_pilots * PILOT**power
        rows, columns = (length // TILE_PX for length in true.shape)
        means = true.reshape(rows, TILE_PX, columns, TILE_PX).mean(axis=(1, 3))
        tiles = np.kron(means, np.ones((TILE_PX, TILE_PX)))
        # Rounding can make the filter's running sums slightly negative.
        pilots = np.maximum(uniform_filter(_apart(pictures[0], pictures[1]), 3, mode="nearest"), 0.0)
        guesses = {"pixel": (true, PILOT), "tile": (tiles, PILOT), "found": (pilots, 2 * PILOT)}
        for samples in EVEN_SAMPLES:
            needed = {key: samples_needed(true, guess, samples, n, power) for key, (guess, n) in guesses.items()}
            factors = {key: samples / number for key, number in needed.items()}
            yield {"scene": name, "samples": samples, "power": power, **factors}


def samples_needed(true: Field, guess: Field, samples: float, least: float, power: float) -> float:
    """Return the mean samples per pixel at which a distribution by `guess` has the error of uniform `samples`."""
    target, share = true.mean() / samples**power, guess ** (1.0 / (1.0 + power))

    def numbers(factor: float) -> Field:
        return np.maximum(least, factor * share)

    def error(factor: float) -> float:
        return float((true / numbers(factor) ** power).mean())

    if error(0.0) <= target:
        return least
    low, high = 0.0, 1.0
    while error(high) > target:
        high *= 2.0
        # A noisy pixel with a guess of 0 gets only `least` samples: use uniform samples.
        if high > 1e12:
            return samples
    for _ in range(60):
        factor = 0.5 * (low + high)
        low, high = (factor, high) if error(factor) > target else (low, factor)
    return float(min(numbers(high).mean(), samples))


def _encoded(scene: Scene, display: Display, seed: int, samples: int) -> Field:
    # Set no `owner`, so that pilots and pictures of many samples follow the same noise law.
    source = replace(display_source(display, "exact", samples), owner=None)
    rendered = render_rays(scene, source, Settings(samples, seed=seed, shading="each"))
    return encode(rendered.radiance, "srgb").astype(np.float64)


def _apart(one: Field, other: Field) -> Field:
    return np.asarray(((one - other) ** 2).sum(axis=-1))


def every_strip(source: RaySource, every: int, rows: int = 1) -> RaySource:
    """Return the part of a picture that has one strip of `rows` rows from each group of `every` strips."""

    def moved(b: Any, v: Any) -> tuple[Any, Any]:
        strip = b.floor(v * (1.0 / rows))
        return strip, v + (strip * (every - 1.0) + every // 2) * rows

    def lines(b: Any, u: Any, v: Any, square: Any) -> Lines:
        return source.lines(b, u, moved(b, v)[1], square)

    height = source.height_px // (every * rows) * rows
    owner_of = source.owner
    if owner_of is None:
        return replace(source, height_px=height, lines=lines)

    def owner(b: Any, u: Any, v: Any) -> Any:
        strip, v = moved(b, v)
        # The strip's number prevents pixels of different strips from sharing samples.
        return owner_of(b, u, v) + mi.UInt32(mi.Int32(strip)) * 0x9E3779B1

    return replace(source, height_px=height, lines=lines, owner=owner)


def rows_of_strips(height_px: int, every: int, rows: int = 1) -> npt.NDArray[np.int64]:
    """Return the indices of the rows that `every_strip` takes from a picture of `height_px` rows."""
    strips = np.arange(height_px // (every * rows)) * every + every // 2
    return np.asarray((strips[:, None] * rows + np.arange(rows)).ravel())


@measurement(page="shading")
def shading(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Measure time and error of light computed per ray, per surface in a pixel, or once for all lenslets.

    The program also measures how many samples adaptive sampling could save.

    Example: python -m tools.bench shading
    """
    with scratch_folder() as folder:
        rows = bench.collect(curves(bench.scenes, folder, bench.seed))
    pairs = bench.collect(likeness(bench.scenes, bench.seed))
    saved = bench.collect(samples_saved(bench.scenes, bench.seed))
    views = None if bench.report is None else error_map(bench.scenes, bench.seed)
    tables = {"shading": rows, "shading-likeness": pairs, "shading-adaptive": saved}
    return tables, shading_page(bench.origin, tables, views)


def shading_page(
    origin: Mapping[str, str], tables: Mapping[str, Rows], views: tuple[list[Radiance], list[str]] | None = None
) -> Page:
    """Return the page of `tools.bench shading`; `views` has the pictures and captions of the contact sheet."""
    drawn = [draw_shading(tables["shading"]), *contact_sheet("shading-map", views, 3)]
    context = {"rows": tables["shading"], "pairs": tables["shading-likeness"], "saved": tables["shading-adaptive"]}
    return make_page("shading", origin, drawn, tables, {**context, "constants": sys.modules[__name__]})


def draw_shading(rows: Rows) -> Plot:
    """Draw the PSNR of the shading methods against their time, for each number of lamps."""
    kinds = groups(rows, "lamps")
    picture, axes = make_axes(1, len(kinds), (3.4, 3.2))
    for axis, kind in zip(axes[0], kinds, strict=True):
        draw_lines(axis, kind, "way", "seconds", "panel_db")
        title = f"{kind[0]['lamps']} lamp{'s' if kind[0]['lamps'] > 1 else ''}"
        axis.set(xlim=(0.0, None), xlabel="seconds", ylabel="panel, dB", title=title)
    return Plot("shading", finish_picture(picture))
