"""Ways to light samples, time against error (`tools.bench shading`).

Light is found by each sample's own rays, once for each surface of a pixel, or shared between lenslets. A further table
tells what samples could save that go where the noise is.
"""

from __future__ import annotations

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
from lippmann.base.variant import drjit, mitsuba
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

from tools.bench import MeasurementRun, measurement
from tools.report_plots import contact_sheet, draw_lines, make_page

#: Display, numbers of lamps, and samples a pixel.
DISPLAY, LAMPS, SAMPLES = "paper-square", (1, 2, 5, 20), (1, 2, 4, 8)
#: Samples of the reference, of which every sixteenth row is compared, and its seed's distance.
REFERENCE_SAMPLES, EVERY_ROW, OTHER_SEED = 64, 16, 1
#: The lamps' circle, mm: radius and height before the display; and the power of all together.
RADIUS_MM, HEIGHT_MM, POWER = 1000.0, 850.0, 1.2e7
#: Scenes whose pictures by shared light are compared with the others', the set-up of the paper's, and their samples.
SCENES, CAPTURED, SETUP, COMPARED_SAMPLES = ("fish", "chart", "knot"), ("diffuse", "full"), "fig8a", 4
SHADINGS: tuple[Shading, ...] = ("each", "shared", "auto")
#: Factor on the differences of the map.
MAP_GAIN = 50.0
#: Side of the middle of the display that is rendered for the pilots, px.
SIDE_PX = 480
#: Samples of a pilot picture, the fewest that are spread; pilots from which the true error is known.
PILOT, PICTURES = 2, 16
#: Samples of a finer picture, which shows how fast the error falls, and of the reference.
FINE, REFERENCE = 16, 256
#: Samples a pixel of the even picture whose noise is to be met, by samples that go where the noise is.
EVEN_SAMPLES = (4, 8, 16)
Field = npt.NDArray[np.float64]


class Decoupled(CachedProgram):
    """Light found once for each surface that a pixel's samples meet, where the first of them meets it."""

    def light_of(self, place: Place, cached: Any) -> Any:
        """Return the light of samples: that of the first one of the same pixel on the same side of the same shape."""
        dr, mi = drjit(), mitsuba()

        shape = dr.gather(mi.UInt32, self.cache.lattices.shape, place.lattice, cached)
        surface = dr.select(cached, 2 * shape + dr.select(place.back, mi.UInt32(1), mi.UInt32(0)), NONE)
        dr.eval(surface)
        lane = dr.arange(mi.UInt32, dr.width(surface))
        pixel, first = lane // self.samples * self.samples, lane
        for k in reversed(range(self.samples)):
            first = dr.select(dr.gather(mi.UInt32, surface, pixel + k) == surface, pixel + k, first)
        asked = dr.compress(cached & (first == lane))
        light = dr.zeros(mi.Color3f, dr.width(surface))
        if dr.width(asked):
            at = (dr.gather(type(one), one, asked) for one in (place.lattice, place.u, place.v, place.back))
            dr.scatter(light, self.cache.at(Place(*at)), asked)
        return dr.gather(mi.Color3f, light, first, cached)


#: The ways: how light is shared, and by which program.
WAYS: dict[str, tuple[Shading, type[CachedProgram]]] = {
    "each": ("each", CachedProgram),
    "decoupled": ("shared", Decoupled),
    "shared": ("shared", CachedProgram),
}


def with_lamps(path: Path, lamps: int, scratch: Path) -> Path:
    """Write a scene file whose lamps are so many points on a circle, of the same power together; return its path."""
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
    made = scratch / f"{lamps}-lamps.xml"
    tree.write(made)
    return made


def curves(scenes: Path, scratch: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield `lamps`, `way`, `samples`, `seconds` without compilation, and `panel_db` against the reference."""
    display, fish = load_display(scenes / f"displays/{DISPLAY}.toml"), scenes / "fish/fish.xml"
    for lamps in LAMPS:
        scene = load_scene(with_lamps(fish, lamps, scratch), placement_beside(fish))
        wanted = _reference(scene, display, seed)
        for way, samples in ((way, samples) for way in WAYS for samples in SAMPLES):
            seconds, found = _drawn(scene, display, Settings(samples, seed=seed), way)
            decibels = psnr_db(found[rows_of_strips(len(found), EVERY_ROW)], wanted)
            yield {"lamps": lamps, "way": way, "samples": samples, "seconds": seconds, "panel_db": decibels}


def _reference(scene: Scene, display: Display, seed: int) -> Radiance:
    """Return rows of the picture by each ray's own light, of many samples."""
    settings = Settings(REFERENCE_SAMPLES, seed=seed + OTHER_SEED, shading="each")
    source = display_source(display, "exact", REFERENCE_SAMPLES, "chief", "fast", None)
    return render_rays(scene, every_strip(source, EVERY_ROW), settings).radiance


def _drawn(scene: Scene, display: Display, settings: Settings, way: str) -> tuple[float, Radiance]:
    """Return the seconds of a picture in one of the ways, and the picture."""
    shading, program = WAYS[way]
    source = display_source(display, "exact", settings.samples, "chief", "fast", None)
    with patch.object(renderer, "CachedProgram", program):
        rendered = render_rays(scene, source, replace(settings, shading=shading))
    return rendered.seconds, rendered.radiance


def likeness(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield `scene`, and `panel_db` and `view_db` of its pictures by shared light and by each ray's own.

    `auto` is the way that `--shading auto` takes.
    """
    for name in (*SCENES, *CAPTURED):
        (each, shared, auto), display = _drawn_scene(scenes, name, seed, SHADINGS)
        found = {"panel_db": psnr_db(shared.radiance, each.radiance)}
        found["view_db"] = psnr_db(_seen(shared.radiance, display), _seen(each.radiance, display))
        yield {"scene": name, **found, "auto": auto.shading}


def error_map(scenes: Path, seed: int) -> tuple[list[Radiance], list[str]]:
    """Return the eye's view of the fish by each ray's own light, by shared light, and their difference; captions."""
    drawn, display = _drawn_scene(scenes, SCENES[0], seed, ("each", "shared"))
    seen = [_seen(one.radiance, display) for one in drawn]
    difference = np.abs(seen[1] - seen[0]) * np.float32(MAP_GAIN)
    return [*seen, difference], ["each ray's own light", "shared light", f"difference, {MAP_GAIN:g} times"]


def _drawn_scene(scenes: Path, name: str, seed: int, shadings: Sequence[Shading]) -> tuple[list[Rendered], Display]:
    """Return a scene's pictures by some ways to shade, and the display that shows them."""
    ways = [Settings(COMPARED_SAMPLES, seed=seed, shading=shading) for shading in shadings]
    if name in CAPTURED:
        setup = load_setup(scenes / f"setups/{SETUP}.toml")
        path = scenes / f"seed/{name}.xml"
        scene = load_scene(path, placement_before(setup, path))
        return [capture(scene, setup, one, rotate=True) for one in ways], setup.display
    display = load_display(scenes / f"displays/{DISPLAY}.toml")
    scene = load_scene(scenes / f"{name}/{name}.xml")
    return [render_integral(scene, display, "exact", one) for one in ways], display


def _seen(picture: Radiance, display: Display) -> Radiance:
    return observe(picture, display, Eye(EYE_MM), whole_window(display), VIEW_SAMPLES).radiance


def samples_saved(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Measure what samples could save that go where the noise is: by each pixel's, or tile's, known or estimated noise.

    A pixel of n samples has the mean squared error v / n^p, with p of the whole picture: 1 for samples at random, more
    for even ones. The fewest samples for a mean error are those with n in proportion to v^(1 / (1 + p)) (Lagrange), but
    each pixel needs a few before its noise is known.

    Yields `scene`, `samples`, and by how much fewer samples, on average, meet the same noise: factors.

    `pixel`: each pixel's error is known; `tile`: each tile's is; `found`: each pixel's is estimated from two pilots,
    averaged over its neighbours, with all pilots counted. `power` is p.
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
        known = {"pixel": true, "tile": _of_tiles(true)}
        pilots = _smoothed(_apart(pictures[0], pictures[1]))
        for samples in EVEN_SAMPLES:
            factors = {
                way: samples / samples_needed(true, guess, samples, PILOT, power) for way, guess in known.items()
            }
            factors["found"] = samples / samples_needed(true, pilots, samples, 2 * PILOT, power)
            yield {"scene": name, "samples": samples, "power": power, **factors}


def samples_needed(true: Field, guess: Field, samples: float, least: float, power: float) -> float:
    """Return the mean number of samples that meets the mean error, true / n^power, of `samples` everywhere.

    They are shared out by a guess of the error, and each pixel has `least` at least.
    """
    wanted, share = true.mean() / samples**power, guess ** (1.0 / (1.0 + power))

    def numbers(factor: float) -> Field:
        return np.maximum(least, factor * share)

    def error(factor: float) -> float:
        return float((true / numbers(factor) ** power).mean())

    if error(0.0) <= wanted:
        return least
    low, high = 0.0, 1.0
    while error(high) > wanted:
        high *= 2.0
        if high > 1e12:  # some noise that the guess denies: nothing but more samples for all helps
            return samples
    for _ in range(60):
        factor = 0.5 * (low + high)
        low, high = (factor, high) if error(factor) > wanted else (low, factor)
    return float(min(numbers(high).mean(), samples))


def _encoded(scene: Scene, display: Display, seed: int, samples: int) -> Field:
    # Plain means, so that one law of noise holds for pilots and for pictures of many samples.
    source = replace(display_source(display, "exact", samples), owner=None)
    rendered = render_rays(scene, source, Settings(samples, seed=seed, shading="each"))
    return encode(rendered.radiance, "srgb").astype(np.float64)


def _apart(one: Field, other: Field) -> Field:
    """Return the squared difference of each pixel, of all colours together."""
    return np.asarray(((one - other) ** 2).sum(axis=-1))


def _of_tiles(values: Field) -> Field:
    """Return each pixel's mean over its tile."""
    rows, columns = (length // TILE_PX for length in values.shape)
    tiles = values.reshape(rows, TILE_PX, columns, TILE_PX).mean(axis=(1, 3))
    return np.kron(tiles, np.ones((TILE_PX, TILE_PX)))


def _smoothed(values: Field) -> Field:
    """Return each pixel's mean over itself and its eight neighbours."""
    from scipy.ndimage import uniform_filter

    # Its running sums round to less than 0.
    return np.asarray(np.maximum(uniform_filter(values, 3, mode="nearest"), 0.0))


def every_strip(source: RaySource, every: int, rows: int = 1) -> RaySource:
    """Return a part of a picture: every so many strips of so many rows (`rows_of_strips`)."""
    mi = mitsuba()

    def moved(b: Any, v: Any) -> tuple[Any, Any]:
        strip = b.floor(v * (1.0 / rows))
        return strip, v + (strip * (every - 1.0) + every // 2) * rows

    def lines(b: Any, u: Any, v: Any, square: Any) -> Lines:
        return source.lines(b, u, moved(b, v)[1], square)

    height = source.height_px // (every * rows) * rows
    taken = replace(source, height_px=height, lines=lines, owner=None)
    owner_of = source.owner
    if owner_of is None:
        return taken

    def owner(b: Any, u: Any, v: Any) -> Any:
        strip, v = moved(b, v)
        # The strip's number is added, so that pixels of two strips never share.
        return owner_of(b, u, v) + mi.UInt32(mi.Int32(strip)) * 0x9E3779B1

    return replace(taken, owner=owner)


def rows_of_strips(height_px: int, every: int, rows: int = 1) -> npt.NDArray[np.int64]:
    """Return the picture's rows that `every_strip` takes, from the middle of the first group of strips on."""
    strips = np.arange(height_px // (every * rows)) * every + every // 2
    taken: npt.NDArray[np.int64] = (strips[:, None] * rows + np.arange(rows)).ravel()
    return taken


@measurement(page="shading")
def shading(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Measure time against error of light that each ray finds, that a pixel's surfaces share, and that lenslets share.

    And what samples could save that go where the noise is.

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
    """Return the page of `tools.bench shading`; `views` are the pictures of its sheet, and captions."""
    drawn = [draw_shading(tables["shading"]), *contact_sheet("shading-map", views, 3)]
    context = {
        "rows": tables["shading"], "pairs": tables["shading-likeness"], "saved": tables["shading-adaptive"],
        "constants": sys.modules[__name__],
    }  # fmt: skip
    return make_page("shading", origin, drawn, tables, context)


def draw_shading(rows: Rows) -> Plot:
    """Draw the error of ways to shade over their time, a picture for each number of lamps."""
    kinds = groups(rows, "lamps")
    picture, axes = make_axes(1, len(kinds), (3.4, 3.2))
    for axis, kind in zip(axes[0], kinds, strict=True):
        draw_lines(axis, kind, "way", "seconds", "panel_db")
        lamps = kind[0]["lamps"]
        axis.set(
            xlim=(0.0, None), xlabel="seconds", ylabel="panel, dB", title=f"{lamps} lamp{'s' if lamps > 1 else ''}"
        )
    return Plot("shading", finish_picture(picture))
