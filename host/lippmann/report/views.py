"""What an eye sees of a display: how engines, models and word lengths are judged by their picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.display import Display
from lippmann.observer import Eye, observe, whole_window
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.renderer import Settings, render_integral, render_view
from lippmann.rendering.scene import Scene, load_scene
from lippmann.rendering.sources import Aperture

#: Off the axis, and within the viewing angle of the displays that ship.
EYE_MM = (20.0, -20.0, 600.0)
VIEW_SAMPLES = 64

Image = npt.NDArray[np.float32]


def middle(display: Display, most_px: int) -> Display:
    """Return the display with the middle of its panel alone, at most so many pixels wide and high."""
    panel = display.panel
    width, height = min(panel.width_px, most_px), min(panel.height_px, most_px)
    return replace(display, panel=replace(panel, width_px=width, height_px=height))


@dataclass(frozen=True)
class Stage:
    """The scene before the middle of a display, and the eye that looks.

    One sample a pixel, through its centre: pictures differ by their rays and by nothing else.
    """

    scene: Scene
    display: Display
    seed: int

    @classmethod
    def of(cls, scenes: Path, display: Display, most_px: int, seed: int) -> Stage:
        """Stand the fish before the middle of a display."""
        return cls(load_scene(scenes / "fish/fish.xml"), middle(display, most_px), seed)

    def integral(
        self, model: Model, engine: Engine, fraction_bits: int | None = None, aperture: Aperture = "chief"
    ) -> Image:
        """Return the integral image by the rays of a model and an engine."""
        settings = Settings(aperture=aperture, seed=self.seed)
        return render_integral(self.scene, self.display, model, settings, None, engine, fraction_bits).radiance

    def seen(self, integral: Image) -> Image:
        """Return what the eye sees of an integral image, through exact lenslets."""
        window = whole_window(self.display)
        return observe(integral, self.display, Eye(EYE_MM), window, VIEW_SAMPLES).radiance

    def direct(self) -> Image:
        """Return what the eye sees of the scene itself."""
        settings = Settings(samples=VIEW_SAMPLES, seed=self.seed)
        return render_view(self.scene, EYE_MM, whole_window(self.display), settings).radiance
