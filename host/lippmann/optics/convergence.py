"""Step 3 on a display for a near eye: elemental images that converge on it.

A pixel belongs to the lenslet through which an eye sees it. The eye is in front of the axis point a, at the distance E
from the aperture plane. This plane is at the distance D from the panel. The line from the eye to the pixel's point x
crosses it at

    q = x - (x - a) s,   s = D / (D + E),

and the lenslet whose cell contains q owns the pixel. So the elemental image of the lenslet with centre c is its cell,
enlarged by 1 + D/E around the point c + (c - a) D/E. Without a viewing distance s is 0, and q is x itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from lippmann.optics.backend import Arr


@dataclass(frozen=True)
class Convergence:
    """The share s = D / (D + E), and the axis point a in the array's frame, mm."""

    share: float = 0.0
    axis_x: float = 0.0
    axis_y: float = 0.0

    def towards_eye(self, x: Arr, y: Arr) -> tuple[Arr, Arr]:
        """Return where the line from a point of the panel to the eye crosses the aperture plane, array frame, mm."""
        if self.share == 0.0:
            return x, y
        return x - (x - self.axis_x) * self.share, y - (y - self.axis_y) * self.share

    def within_cell(self, x: Arr, y: Arr, cx: Arr, cy: Arr) -> tuple[Arr, Arr]:
        """Return the same as `towards_eye`; point and result are measured from the lenslet's centre (cx, cy)."""
        if self.share == 0.0:
            return x, y
        rest = 1.0 - self.share
        return x * rest - (cx - self.axis_x) * self.share, y * rest - (cy - self.axis_y) * self.share

    def on_panel(self, x: Arr, y: Arr, cx: Arr, cy: Arr) -> tuple[Arr, Arr]:
        """Return the point of the panel that the eye sees through a point of the cell of the lenslet at (cx, cy).

        Both points are measured from the lenslet's centre. This is the inverse of `within_cell`.
        """
        if self.share == 0.0:
            return x, y
        rest = 1.0 - self.share
        return (x + (cx - self.axis_x) * self.share) / rest, (y + (cy - self.axis_y) * self.share) / rest
