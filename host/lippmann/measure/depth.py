"""`lippmann bench depth`: where the founding paper's set-ups show fish and stems, by the parallax of a moving eye.

At the depth of each object of the fish scene stands, alone and on the axis, a soft bright mark. It is captured and
shown, an eye moves along x, and the centre of what it sees is followed across the plane of the display. A point at
depth z moves by -z / (E - z) for each mm of an eye at distance E: the slope of the fitted line gives the depth.

Three eyes look. One sees each lenslet through its centre alone and stays near the axis, as the lens equations do.
Another sees through whole, exact lenslets: behind a gap that is not their focal length they spread its view over a wide
part of the imaging lens, whose spherical aberration then counts. The third looks through the centres and moves far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.capturing.capture import capture
from lippmann.capturing.depths import appearance, image_distance
from lippmann.capturing.setup import Setup, load_setup
from lippmann.observer import Eye, observe, whole_window
from lippmann.optics.rays import Model
from lippmann.rendering.placement import Placement
from lippmann.rendering.renderer import Settings
from lippmann.rendering.scene import Scene, load_scene, placement_beside
from lippmann.report.tables import table
from lippmann.variant import mitsuba

#: Depths of the fish scene's objects in its own frame, mm: the middle of the fish, and the stems.
OBJECTS = {"fish": 6.0, "stem 1": -20.0, "stem 2": -45.0, "stem 3": -70.0, "stem 4": -100.0, "stem 5": -115.0}
SETUPS = ("fig8a", "fig8b", "fig8c", "fig8d")
EYE_DISTANCE_MM = 600.0
#: The eye's places along x, mm: so near the axis that rays stay in the middle of the imaging lens.
EYES_MM = np.linspace(-5.0, 5.0, 9)
#: The places of one that moves as far as viewers do: its rays reach the lens's outer parts.
WIDE_EYES_MM = np.linspace(-30.0, 30.0, 9)
#: Part of the display that a mark is shown on, lenslets, and the pixels of each: finer than the print's, where such a
#: small move of an eye shifts what it sees by a pixel or two, and whole, so that rotation is exact.
STRIP, PIXELS = (25, 1), 240
#: Where rays to marks start, mm before the object's centre; one plane for all, so that one program renders them all.
NEAR_MM = 100.0
#: Standard deviation of a mark's image, mm: small, yet too smooth for lenslets of 1 mm to alias it; and where it ends.
MARK_MM = 0.8
MARK_SIGMAS = 3.5
MARK_TEXELS = 256
#: What the depths are held to: a share of their magnitude.
SHARE = 0.05
#: The eye's places for the views of the fish, mm.
VIEW_EYES_MM = (-10.0, 10.0)

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]


class Look(NamedTuple):
    """An eye that moves: through the lenslets' centres ("pinhole") or through all of them, and its places along x."""

    model: Model
    eyes_mm: Floats


CENTRES, LENSLETS, WIDE = Look("pinhole", EYES_MM), Look("exact", EYES_MM), Look("pinhole", WIDE_EYES_MM)


@dataclass(frozen=True)
class Depth:
    """Where an object appears, mm before the display: by the lens equations, and as eyes see it."""

    setup: str
    array_position_mm: float
    gap_mm: float
    rotated: bool
    thing: str
    object_mm: float
    image_mm: float
    theory_mm: float
    centres_mm: float
    lenslets_mm: float
    wide_mm: float

    @property
    def error_percent(self) -> float:
        """Of the depth's magnitude, seen through the lenslets' centres."""
        return 100.0 * (self.centres_mm / self.theory_mm - 1.0)

    @property
    def wide_error_percent(self) -> float:
        """The same of an eye that moves far."""
        return 100.0 * (self.wide_mm / self.theory_mm - 1.0)

    @property
    def kept(self) -> bool:
        """Whether the sign is right and the magnitude, seen through the centres, within its bound."""
        return abs(self.error_percent) <= 100.0 * SHARE


def mark_scene(setup: Setup, z_mm: float) -> Scene:
    """Return a scene of one soft mark on the axis at a depth (below NEAR_MM) of the object's frame, facing the lens."""
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
    setup: Setup,
    z_mm: float,
    rotated: bool,
    looks: tuple[Look, ...] = (CENTRES,),
    seed: int = 0,
) -> list[float]:
    """Return the depths (mm, positive in front of the display) at which moving eyes see a captured point.

    Parameters
    ----------
    setup
        The set-up, with the display that shows its picture.
    z_mm
        The point's depth in the object's frame, on the axis.
    rotated
        Whether elemental images are turned.
    looks
        How eyes look, one depth each.
    seed
        Of the capture.
    """
    settings = Settings(integrator="direct", seed=seed)
    picture = capture(mark_scene(setup, z_mm), setup, settings, rotated).rendered.radiance
    display = setup.display
    window = whole_window(display, 5 * round(display.panel.width_mm / display.array.pitch_mm))
    x = ((np.arange(window.width_px) + 0.5) / window.width_px - 0.5) * window.width_mm
    depths = []
    for look in looks:
        centres = []
        for eye in look.eyes_mm:
            view = observe(picture, display, Eye((float(eye), 0.0, EYE_DISTANCE_MM)), window, model=look.model)
            light = view.radiance.sum(axis=(0, 2), dtype=np.float64)
            centres.append(float((light * x).sum() / light.sum()))
        slope = float(np.polyfit(look.eyes_mm, centres, 1)[0])
        depths.append(EYE_DISTANCE_MM * slope / (slope - 1.0))
    return depths


def strip_of(setup: Setup) -> Setup:
    """Return the set-up with a strip in the middle of its display alone, in finer pixels."""
    panel = replace(
        setup.display.panel,
        width_px=STRIP[0] * PIXELS,
        height_px=STRIP[1] * PIXELS,
        pixel_pitch_mm=setup.display.array.pitch_mm / PIXELS,
    )
    return replace(setup, display=replace(setup.display, panel=panel))


def bench_depth(folder: Path, seed: int, done: Callable[[Depth], None]) -> list[Depth]:
    """Measure every object in every set-up, elemental images rotated and as captured."""
    rows = []
    for name in SETUPS:
        setup = strip_of(load_setup(folder / f"setups/{name}.toml"))
        stand = setup.subject.placement
        for rotated in (True, False):
            for thing, z in OBJECTS.items():
                z_mm = stand.scale * z + stand.offset_mm[2]
                centres, lenslets, wide = measure_depths(setup, z_mm, rotated, (CENTRES, LENSLETS, WIDE), seed)
                row = Depth(
                    name,
                    setup.position_mm,
                    setup.display.gap_mm,
                    rotated,
                    thing,
                    setup.subject.distance_mm - z_mm,
                    float(image_distance(setup, z_mm)),
                    float(appearance(setup, z_mm, rotated).depth_mm),
                    centres,
                    lenslets,
                    wide,
                )
                rows.append(row)
                done(row)
    return rows


def fish_views(folder: Path, seed: int) -> tuple[list[Image], list[str]]:
    """Return what two eyes see of the fish in every set-up, and once as captured; and captions."""
    path = folder / "fish/fish.xml"
    views, captions = [], []
    for name, rotated in (*((name, True) for name in SETUPS), ("fig8a", False)):
        setup = load_setup(folder / f"setups/{name}.toml")
        scene = load_scene(path, placement_beside(path).then(setup.subject.placement))
        picture = capture(scene, setup, Settings(samples=2, seed=seed), rotated).rendered.radiance
        # One pixel for each lenslet, magnified.
        window = whole_window(setup.display)
        for x in VIEW_EYES_MM:
            seen = observe(picture, setup.display, Eye((x, 0.0, EYE_DISTANCE_MM)), window, 64).radiance
            views.append(np.kron(seen, np.ones((3, 3, 1), np.float32)))
            how = "" if rotated else ", not rotated"
            captions.append(f"{name}: array {setup.position_mm:+.0f} mm, eye {x:+.0f} mm{how}")
    return views, captions


def report_text(rows: list[Depth]) -> str:
    """Return the report's page."""
    rotated = [row for row in rows if row.rotated]
    near, far = (f"{eyes[0]:+.0f} to {eyes[-1]:+.0f}" for eyes in (EYES_MM, WIDE_EYES_MM))
    text = (
        "# Depths in the founding paper's set-ups\n\n"
        "A soft mark on the axis at the depth of each object of the fish scene, captured with the set-ups of figure 8 "
        "(imaging lens of two thick plano-convex lenses, really traced; exact lenslets; camera at 145 cm) and shown by "
        "the decoding display. Depths (mm, positive in front of the display) are those of an eye at 600 mm that moves "
        f"{near} mm: `theory` by the lens equations, `centres` seen through the lenslets' centres, `lenslets` through "
        "whole exact lenslets. `error` is that of `centres`. `wide` is seen through the centres by an eye that moves "
        f"{far} mm, and has its error beside it. The marks are shown by the middle {STRIP[0]} lenslets of the display "
        f"with {PIXELS} pixels each, where the print has 23.6: such a small move of an eye shifts what it sees by one "
        "or two of the print's pixels. The views of the fish below are of the print as it is.\n\n"
        f"{sum(row.kept for row in rotated)} of {len(rotated)} objects have the right sign and are within "
        f"{100 * SHARE:.0f} % of the lens equations for an eye near the axis ({near} mm); through whole lenslets "
        f"{sum(row.lenslets_mm * row.theory_mm > 0 for row in rotated)} have the right sign. An eye that moves "
        f"{far} mm sees them through the outer parts of imaging lens and lenslets, with their aberrations, "
        f"shifted by {_wide(rotated)}: a few per cent of a large depth, much of a small one.\n\n"
        "![What two eyes see of the fish](depth.png)\n"
    )
    for name in SETUPS:
        for turned in (True, False):
            part = [row for row in rows if row.setup == name and row.rotated == turned]
            near_first = np.diff([row.centres_mm for row in part]) < 0.0
            relief = "orthoscopic" if near_first.all() else "pseudoscopic" if not near_first.any() else "neither"
            text += (
                f"\n## {name}, array {part[0].array_position_mm:+.0f} mm, gap {part[0].gap_mm:g} mm, "
                f"{'rotated' if turned else 'as captured'}: {relief}\n\n"
            )
            text += table(
                {
                    "object": [row.thing for row in part],
                    "distance": [f"{row.object_mm:.1f}" for row in part],
                    "image at": [f"{row.image_mm:.1f}" for row in part],
                    "theory": [f"{row.theory_mm:+.2f}" for row in part],
                    "centres": [f"{row.centres_mm:+.2f}" for row in part],
                    "error": [f"{row.error_percent:+.1f} %" for row in part],
                    "lenslets": [f"{row.lenslets_mm:+.2f}" for row in part],
                    "wide": [f"{row.wide_mm:+.2f}" for row in part],
                    "wide error": [f"{row.wide_error_percent:+.1f} %" for row in part],
                }
            )
    return text


def _wide(rows: list[Depth]) -> str:
    """Return the range of shifts that an eye that moves far sees, set-up by set-up."""
    ranges = []
    for name in SETUPS:
        shifts = [row.wide_mm - row.theory_mm for row in rows if row.setup == name]
        ranges.append(f"{min(shifts):+.1f} to {max(shifts):+.1f} mm ({name})")
    return ", ".join(ranges)
