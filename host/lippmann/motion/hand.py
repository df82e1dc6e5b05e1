"""What mouse, wheel and keys do to a scene: turn, shift, scale, all about its middle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lippmann.scenes.placement import SCALE_RANGE, Matrix, Placement

#: Degrees of a turn for each pixel of a drag, and for each press of an arrow key.
DRAG_DEG, KEY_DEG = 0.4, 5.0
#: Factor of a step of the wheel, and of the keys + and -.
ZOOM = 1.05
#: Steepest view from above or below, degrees.
STEEP_DEG = 89.0


@dataclass
class Hand:
    """The motion of a scene whose middle is `pivot_mm`, in the display's frame; `base` is its place before."""

    base: Placement
    pivot_mm: Matrix
    #: mm that a drag of a pixel shifts the scene, and a press of a key.
    drag_mm: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    scale: float = 1.0
    shift_mm: Matrix = field(default_factory=lambda: np.zeros(3))

    def turn(self, yaw_deg: float, pitch_deg: float = 0.0) -> None:
        """Turn the scene to the right, and upwards."""
        self.yaw_deg = math.remainder(self.yaw_deg + yaw_deg, 360.0)
        self.pitch_deg = min(max(self.pitch_deg + pitch_deg, -STEEP_DEG), STEEP_DEG)

    def shift(self, right: float, up: float, nearer: float = 0.0) -> None:
        """Shift the scene by some pixels of a drag."""
        self.shift_mm = self.shift_mm + self.drag_mm * np.array([right, up, nearer])

    def zoom(self, steps: float) -> None:
        """Scale the scene by steps of the wheel."""
        wanted = self.scale * ZOOM**steps
        if SCALE_RANGE[0] <= wanted * self.base.scale <= SCALE_RANGE[1]:
            self.scale = wanted

    def reset(self) -> None:
        """Put the scene back."""
        self.yaw_deg = self.pitch_deg = 0.0
        self.scale, self.shift_mm = 1.0, np.zeros(3)

    @property
    def motion(self) -> tuple[float, ...]:
        """All that the hand has done; equal motions put a scene to the same place."""
        return (self.yaw_deg, self.pitch_deg, self.scale, *self.shift_mm.tolist())

    def placement(self) -> Placement:
        """Return where the scene stands, without depths once it has moved."""
        if (self.yaw_deg, self.pitch_deg, self.scale) == (0.0, 0.0, 1.0) and not self.shift_mm.any():
            return self.base
        yaw, pitch = math.radians(self.yaw_deg), math.radians(self.pitch_deg)
        about_y = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
        about_x = np.array([[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]])
        moved = np.eye(4)
        moved[:3, :3] = self.scale * about_x @ about_y
        moved[:3, 3] = self.pivot_mm + self.shift_mm - moved[:3, :3] @ self.pivot_mm
        return Placement.of(moved @ self.base.display_from_scene, self.scale * self.base.scale)
