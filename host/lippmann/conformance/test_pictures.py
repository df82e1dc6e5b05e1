"""Pictures that compare engines, models and word lengths: a scene's integral image, and an eye's view of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.base.images import Radiance
from lippmann.base.tones import encode
from lippmann.base.variant import mitsuba
from lippmann.conformance.report_plan import Plan
from lippmann.display.description import Display
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.renderer import Settings, render_integral, render_view
from lippmann.rendering.sources import Aperture, Lines, RaySource
from lippmann.scenes.scene import Scene, load_scene

#: Position of the eye: off the axis, within the viewing angle of the displays that ship.
EYE_MM = (20.0, -20.0, 600.0)
#: Samples a pixel of a view.
VIEW_SAMPLES = 64


def middle(display: Display, most_px: int) -> Display:
    """Return the display with its panel cropped to the middle, at most `most_px` pixels wide and high."""
    panel = display.panel
    width, height = min(panel.width_px, most_px), min(panel.height_px, most_px)
    return replace(display, panel=replace(panel, width_px=width, height_px=height))


def noise_levels(one: Radiance, other: Radiance) -> float:
    """Return the standard deviation of a pixel value, in 8-bit sRGB levels, from two renders with different seeds.

    The difference of two independent values with the same noise has twice the variance of one value.
    """
    apart = 255.0 * (encode(one, "srgb").astype(np.float64) - encode(other, "srgb"))
    return float(np.sqrt((apart**2).mean() / 2.0))


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


@dataclass(frozen=True)
class Pictures:
    """Pictures of a scene for the middle of a display.

    Each has one sample per pixel, at the pixel's centre, so two pictures differ only by the rays of their engines.
    """

    scene: Scene
    display: Display
    seed: int

    @classmethod
    def of(cls, scenes: Path, display: Display, plan: Plan, seed: int) -> Pictures:
        """Load the plan's scene, and take the middle of a display."""
        scene = load_scene(scenes / f"{plan.scene}/{plan.scene}.xml")
        return cls(scene, middle(display, plan.panel_px), seed)

    def integral(
        self, model: Model, engine: Engine, fraction_bits: int | None = None, aperture: Aperture = "chief"
    ) -> Radiance:
        """Return the integral image, rendered with the rays of a model and an engine."""
        settings = Settings(aperture=aperture, seed=self.seed)
        return render_integral(self.scene, self.display, model, settings, None, engine, fraction_bits).radiance

    def seen(self, integral: Radiance) -> Radiance:
        """Return the eye's view of an integral image, through exact lenslets."""
        window = whole_window(self.display)
        return observe(integral, self.display, Eye(EYE_MM), window, VIEW_SAMPLES).radiance

    def direct(self) -> Radiance:
        """Return the eye's view of the scene itself."""
        settings = Settings(samples=VIEW_SAMPLES, seed=self.seed)
        return render_view(self.scene, EYE_MM, whole_window(self.display), settings).radiance
