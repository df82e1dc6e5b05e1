"""Measures the depths at which an eye sees objects in the founding paper's set-ups (`tools.bench depth`).

For each object of the fish scene, a soft bright mark on the axis at the object's depth is captured and displayed. An
eye at the distance E moves along x. If the mark has the depth z, its centre in the eye's view moves by -z / (E - z) per
mm of this motion, so the slope of a fitted line gives the depth.

The first eye sees through the lenslets' centres and stays near the axis, as the lens equations assume. The second eye
sees through complete lenslets, with exact rays. If the gap is not the focal length, the second eye's rays fill much of
the imaging lens, whose spherical aberration adds an error. The third eye sees as the first, but moves farther.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.images import Radiance
from lippmann.base.variant import mitsuba
from lippmann.capturing.capture import capture, shown_depth
from lippmann.capturing.capture_setup import Setup, load_setup
from lippmann.conformance.figures import Rows, groups, values, where
from lippmann.conformance.pages import Page
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.optics.rays import Floats, Model
from lippmann.rendering.options import Settings
from lippmann.scenes.placement import Placement, placement_beside
from lippmann.scenes.scene import Scene, load_scene

from tools.bench import MeasurementRun, measurement
from tools.report_plots import contact_sheet, make_page

#: Depths, in the scene's frame, mm, of the fish scene's objects: the middle of the fish, and the stems.
OBJECTS = {"fish": 6.0, "stem 1": -20.0, "stem 2": -45.0, "stem 3": -70.0, "stem 4": -100.0, "stem 5": -115.0}
SETUPS = ("fig8a", "fig8b", "fig8c", "fig8d")
EYE_DISTANCE_MM = 600.0
#: x of the eyes, mm: near the axis, so that rays pass the middle of the imaging lens; then as far as viewers move.
EYES_MM, WIDE_EYES_MM = np.linspace(-5.0, 5.0, 9), np.linspace(-30.0, 30.0, 9)
#: Size of the displayed strip, lenslets; pixels across a lenslet: an integer, so that elemental images rotate
#: exactly, and larger than the paper's, with which a small move of the eye would shift the view by a pixel or two.
STRIP, PIXELS = (25, 1), 240
#: Depth, mm, of the plane where rays to all marks start; with one plane, one compiled program renders all marks.
NEAR_MM = 100.0
#: A mark: standard deviation of its image, mm (1 mm lenslets do not alias it), half width in deviations, texels across.
MARK_MM, MARK_SIGMAS, MARK_TEXELS = 0.8, 3.5, 256
#: Maximum error of a measured depth, as a fraction of the theoretical depth.
SHARE = 0.05
#: x, mm, of the eyes whose views of the fish the page shows.
VIEW_EYES_MM = (-10.0, 10.0)

#: A moving eye: the lens model of its view, and its positions along x, mm.
Look = tuple[Model, Floats]
CENTRES: Look = ("pinhole", EYES_MM)
LENSLETS: Look = ("exact", EYES_MM)
WIDE: Look = ("pinhole", WIDE_EYES_MM)


def judged(row: dict[str, Any]) -> dict[str, Any]:
    """Add columns: errors, per cent, of the first and third eye; `kept` (the first eye's error is within `SHARE`)."""
    error, wide = (100.0 * (row[key] / row["theory_mm"] - 1.0) for key in ("centres_mm", "wide_mm"))
    return {**row, "error_percent": error, "wide_error_percent": wide, "kept": abs(error) <= 100.0 * SHARE}


def mark_scene(setup: Setup, z_mm: float) -> Scene:
    """Return a scene of a soft mark that faces the lens on the axis, at z = `z_mm` < NEAR_MM in the object's frame."""
    mi = mitsuba()
    x = (np.arange(MARK_TEXELS) + 0.5) * (2.0 / MARK_TEXELS) - 1.0
    profile = np.exp(-0.5 * (MARK_SIGMAS * x) ** 2).astype(np.float32)
    brightness = np.repeat(np.outer(profile, profile)[:, :, None], 3, axis=2)
    half_mm = MARK_SIGMAS * MARK_MM / abs(setup.magnification)
    mark = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0.0, 0.0, z_mm]).scale(half_mm),
        "emitter": {"type": "area", "radiance": {"type": "bitmap", "bitmap": mi.Bitmap(brightness), "raw": True}},
    }
    scene = mi.load_dict({"type": "scene", "mark": mark})
    return Scene(Path("mark"), scene, Placement(near_mm=NEAR_MM, far_mm=z_mm))


def measure_depths(
    setup: Setup, z_mm: float, rotated: bool, looks: tuple[Look, ...] = (CENTRES,), seed: int = 0
) -> list[float]:
    """Return the depth, mm in front of the display, at which each eye sees a mark captured at `z_mm` on the axis."""
    settings = Settings(integrator="direct", seed=seed)
    picture = capture(mark_scene(setup, z_mm), setup, settings, rotated).radiance
    display = setup.display
    window = whole_window(display, 5 * round(display.panel.width_mm / display.array.pitches_mm[0]))
    x = ((np.arange(window.width_px) + 0.5) / window.width_px - 0.5) * window.width_mm
    depths = []
    for model, eyes_mm in looks:
        centres = []
        for eye in eyes_mm:
            view = observe(picture, display, Eye((float(eye), 0.0, EYE_DISTANCE_MM)), window, model=model)
            light = view.radiance.sum(axis=(0, 2), dtype=np.float64)
            centres.append(float((light * x).sum() / light.sum()))
        slope = float(np.polyfit(eyes_mm, centres, 1)[0])
        depths.append(EYE_DISTANCE_MM * slope / (slope - 1.0))
    return depths


def strip_of(setup: Setup) -> Setup:
    """Return the set-up with only a strip of its display, with finer pixels."""
    width_px, height_px = (count * PIXELS for count in STRIP)
    pitch_mm = setup.display.array.pitches_mm[0] / PIXELS
    panel = replace(setup.display.panel, width_px=width_px, height_px=height_px, pixel_pitch_mm=pitch_mm)
    return replace(setup, display=replace(setup.display, panel=panel))


def measure(folder: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the depths of every object in every set-up, with elemental images rotated and as captured."""
    for name in SETUPS:
        setup = strip_of(load_setup(folder / f"setups/{name}.toml"))
        placement = setup.subject.placement
        for rotated, (thing, z) in itertools.product((True, False), OBJECTS.items()):
            z_mm = placement.scale * z + placement.offset_mm[2]
            centres_mm, lenslets_mm, wide_mm = measure_depths(setup, z_mm, rotated, (CENTRES, LENSLETS, WIDE), seed)
            row = {"setup": name, "array_position_mm": setup.position_mm, "gap_mm": setup.display.gap_mm}
            row |= {"rotated": rotated, "thing": thing, "object_mm": setup.subject.distance_mm - z_mm}
            row |= {"image_mm": float(setup.image_distance(z_mm))}
            row |= {"theory_mm": float(shown_depth(setup, z_mm, rotated))}
            yield judged({**row, "centres_mm": centres_mm, "lenslets_mm": lenslets_mm, "wide_mm": wide_mm})


def fish_views(folder: Path, seed: int) -> tuple[list[Radiance], list[str]]:
    """Return two eyes' views of the fish in every set-up (in the first one also without rotation), and captions."""
    path = folder / "fish/fish.xml"
    views, captions = [], []
    for name, rotated in (*((name, True) for name in SETUPS), ("fig8a", False)):
        setup = load_setup(folder / f"setups/{name}.toml")
        scene = load_scene(path, placement_beside(path).then(setup.subject.placement))
        picture = capture(scene, setup, Settings(samples=2, seed=seed), rotated).radiance
        # The window has one pixel per lenslet.
        window = whole_window(setup.display)
        for x in VIEW_EYES_MM:
            views.append(observe(picture, setup.display, Eye((x, 0.0, EYE_DISTANCE_MM)), window, 64).radiance)
            suffix = "" if rotated else ", not rotated"
            captions.append(f"{name}: array {setup.position_mm:+.0f} mm, eye {x:+.0f} mm{suffix}")
    return views, captions


@measurement(page="depth")
def depth(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Compare the depths that an eye sees in the founding paper's set-ups with the lens equations.

    Example: python -m tools.bench depth
    """
    rows = bench.collect(measure(bench.scenes, bench.seed))
    views = None if bench.report is None else fish_views(bench.scenes, bench.seed)
    return {"rows": rows}, depth_page(bench.origin, rows, views)


def depth_page(origin: Mapping[str, str], rows: Rows, views: tuple[list[Radiance], list[str]] | None = None) -> Page:
    """Return the page of `tools.bench depth`; `views` has the pictures and captions of the contact sheet."""
    sheet = contact_sheet("depth", views, 2)
    moved = [{**row, "shift": row["wide_mm"] - row["theory_mm"]} for row in rows]
    setups = []
    for group in groups(moved, "setup", "rotated"):
        nearer, shifts = np.diff(values(group, "centres_mm")) < 0.0, values(group, "shift")
        setup = {**group[0], "images": "rotated" if group[0]["rotated"] else "as captured"}
        setup["relief"] = "orthoscopic" if nearer.all() else "neither" if nearer.any() else "pseudoscopic"
        setup["range"] = f"{group[0]['theory_mm']:+.1f} to {group[-1]['theory_mm']:+.1f}"
        setup["error"] = max(abs(row["error_percent"]) for row in group)
        setup["lenslets"] = max(abs(row["lenslets_mm"] - row["theory_mm"]) for row in group)
        setups.append({**setup, "shift": f"{min(shifts):+.1f} to {max(shifts):+.1f}"})
    near, far = (f"{eyes[0]:+.0f} to {eyes[-1]:+.0f}" for eyes in (EYES_MM, WIDE_EYES_MM))
    rotated = where(moved, rotated=True)
    signs = sum(row["lenslets_mm"] * row["theory_mm"] > 0 for row in rotated)
    context = {"rows": rotated, "signs": signs, "setups": setups, "near": near, "far": far}
    context["constants"] = sys.modules[__name__]
    return make_page("depth", origin, sheet, {"depth": rows}, context)
