"""Ways to light samples, time against error: each by its own rays, one for each surface of a pixel, and shared."""

from __future__ import annotations

import math
import xml.etree.ElementTree as Xml
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.images import Radiance
from lippmann.base.tones import psnr_db
from lippmann.base.variant import drjit, mitsuba
from lippmann.capturing.capture import capture, placement_before
from lippmann.capturing.capture_setup import load_setup
from lippmann.conformance.engine_speeds import EYE_MM, VIEW_SAMPLES
from lippmann.display.description import Display, load_display
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.rendering.renderer import Rendered, Settings, Shading, render_integral, render_rays
from lippmann.rendering.shading import SharedProgram
from lippmann.rendering.sources import display_source
from lippmann.rendering.surface_lattice import NONE, Place
from lippmann.scenes.placement import placement_beside
from lippmann.scenes.scene import Scene, load_scene

from tools.picture_strips import every_strip, rows_of_strips

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


class Decoupled(SharedProgram):
    """Light found once for each surface that a pixel's samples meet, where the first of them meets it."""

    def light_of(self, place: Place, shared: Any) -> Any:
        """Return the light of samples: that of the first one of the same pixel on the same side of the same shape."""
        dr, mi = drjit(), mitsuba()

        shape = dr.gather(mi.UInt32, self.light.lattices.shape, place.lattice, shared)
        surface = dr.select(shared, 2 * shape + dr.select(place.back, mi.UInt32(1), mi.UInt32(0)), NONE)
        dr.eval(surface)
        lane = dr.arange(mi.UInt32, dr.width(surface))
        pixel, first = lane // self.samples * self.samples, lane
        for k in reversed(range(self.samples)):
            first = dr.select(dr.gather(mi.UInt32, surface, pixel + k) == surface, pixel + k, first)
        asked = dr.compress(shared & (first == lane))
        light = dr.zeros(mi.Color3f, dr.width(surface))
        if dr.width(asked):
            at = (dr.gather(type(one), one, asked) for one in (place.lattice, place.u, place.v, place.back))
            dr.scatter(light, self.light.at(Place(*at)), asked)
        return dr.gather(mi.Color3f, light, first, shared)


#: The ways: how light is shared, and by which program.
WAYS: dict[str, tuple[Shading, type[SharedProgram]]] = {
    "each": ("each", SharedProgram),
    "decoupled": ("shared", Decoupled),
    "shared": ("shared", SharedProgram),
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
    rendered = render_rays(scene, source, replace(settings, shading=shading), program=program)
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
    # One pixel for each lenslet, magnified.
    return [np.kron(one, np.ones((3, 3, 1), np.float32)) for one in (*seen, difference)], [
        "each ray's own light",
        "shared light",
        f"difference, {MAP_GAIN:g} times",
    ]


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
