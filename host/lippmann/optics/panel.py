"""Step 1: pixel coordinates to panel millimetres, to the array's frame, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lippmann.display.description import Display
from lippmann.optics.backend import Arr


def exact_rotation(degrees: float) -> tuple[float, float]:
    """Return (cos, sin) of an angle in degrees, exact at whole quarter turns."""
    quarter = round(degrees / 90.0)
    rest = math.radians(degrees - 90.0 * quarter)
    c, s = math.cos(rest), math.sin(rest)
    return ((c, s), (-s, c), (-c, -s), (s, -c))[quarter % 4]


@dataclass(frozen=True)
class PanelFrame:
    """The maps between pixel coordinates, the panel's frame and the array's frame.

    They hold the pixel pitches in x and y, the panel's size in pixels, the array's origin in the panel's frame, and
    cosine and sine of the array's rotation.
    """

    pitch_mm: tuple[float, float]
    width_px: int
    height_px: int
    offset_mm: tuple[float, float]
    cos: float
    sin: float

    @classmethod
    def of(cls, display: Display) -> PanelFrame:
        """Return the frame of a display."""
        panel, array = display.panel, display.array
        turn = exact_rotation(array.rotation_deg)
        return cls(panel.pitches_mm, panel.width_px, panel.height_px, array.offset_mm, *turn)

    def panel_from_pixel(self, u: Arr, v: Arr) -> tuple[Arr, Arr]:
        """Map pixel coordinates (column, row; continuous) to panel millimetres."""
        return (u - 0.5 * self.width_px) * self.pitch_mm[0], (0.5 * self.height_px - v) * self.pitch_mm[1]

    def pixel_from_panel(self, x: Arr, y: Arr) -> tuple[Arr, Arr]:
        """Map panel millimetres to pixel coordinates."""
        return x / self.pitch_mm[0] + 0.5 * self.width_px, 0.5 * self.height_px - y / self.pitch_mm[1]

    def array_from_panel(self, x: Arr, y: Arr) -> tuple[Arr, Arr]:
        """Map a point from the panel's frame to the array's frame, mm."""
        return self.turn_back(x - self.offset_mm[0], y - self.offset_mm[1])

    def panel_from_array(self, x: Arr, y: Arr) -> tuple[Arr, Arr]:
        """Map a point from the array's frame to the panel's frame, mm."""
        x, y = self.turn(x, y)
        return x + self.offset_mm[0], y + self.offset_mm[1]

    def turn(self, x: Arr, y: Arr) -> tuple[Arr, Arr]:
        """Turn a vector from the array's axes to the panel's axes."""
        if self.sin == 0.0 and self.cos == 1.0:
            return x, y
        return self.cos * x - self.sin * y, self.sin * x + self.cos * y

    def turn_back(self, x: Arr, y: Arr) -> tuple[Arr, Arr]:
        """Turn a vector from the panel's axes to the array's axes."""
        if self.sin == 0.0 and self.cos == 1.0:
            return x, y
        return self.cos * x + self.sin * y, self.cos * y - self.sin * x
