"""Describes a display's optical system, and maps pixels to the array's frame (step 1 of a ray).

A pixel belongs to the lenslet through which the eye sees it. The eye is in front of the
axis point a, at the distance E from the aperture plane. The panel is at the distance D
behind the aperture plane. The line from the eye to a pixel x crosses the plane at

    q = x - (x - a) s,   s = D / (D + E),

and the pixel belongs to the lenslet whose cell contains q. A lenslet with the centre c
has its elemental image around c + (c - a) D/E; the image is the cell, scaled by 1 +
D/E. Without a viewing distance, s is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from lippmann.display.description import Display, Pair
from lippmann.optics.backend import Arr, Backend, Point
from lippmann.optics.faces import Dome, Ray
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Status


def exact_rotation(degrees: float) -> Pair:
    """Return (cos, sin) of an angle in degrees, exactly for multiples of 90."""
    quarter = round(degrees / 90.0)
    angle = math.radians(degrees - 90.0 * quarter)
    c, s = math.cos(angle), math.sin(angle)
    return ((c, s), (-s, c), (-c, -s), (s, -c))[quarter % 4]


@dataclass(frozen=True)
class PanelFrame:
    """The maps between pixel coordinates, the panel's frame and the array's frame."""

    pitch_mm: Pair
    width_px: int
    height_px: int
    offset_mm: Pair
    cos: float
    sin: float

    @classmethod
    def of(cls, display: Display) -> PanelFrame:
        """Return the maps of a display."""
        panel, array = display.panel, display.array
        turn = exact_rotation(array.rotation_deg)
        return cls(panel.pitches_mm, *panel.size_px, array.offset_mm, *turn)

    @property
    def corners(self) -> tuple[Pair, ...]:
        """The panel's corners in the array's frame, mm."""
        x, y = 0.5 * (self.width_px * self.pitch_mm[0]), 0.5 * (self.height_px * self.pitch_mm[1])
        return tuple(self.array_from_panel(*corner) for corner in ((-x, -y), (-x, y), (x, -y), (x, y)))

    def panel_from_pixel(self, u: Arr, v: Arr) -> Point:
        """Map pixel coordinates (column, row; continuous) to a point in the panel's frame, mm."""
        return (u - 0.5 * self.width_px) * self.pitch_mm[0], (0.5 * self.height_px - v) * self.pitch_mm[1]

    def pixel_from_panel(self, x: Arr, y: Arr) -> Point:
        """Map a point in the panel's frame, mm, to pixel coordinates."""
        return x / self.pitch_mm[0] + 0.5 * self.width_px, 0.5 * self.height_px - y / self.pitch_mm[1]

    def array_from_panel(self, x: Arr, y: Arr) -> Point:
        """Map a point from the panel's frame to the array's frame, mm."""
        return self.turn_back(x - self.offset_mm[0], y - self.offset_mm[1])

    def panel_from_array(self, x: Arr, y: Arr) -> Point:
        """Map a point from the array's frame to the panel's frame, mm."""
        x, y = self.turn(x, y)
        return x + self.offset_mm[0], y + self.offset_mm[1]

    def turn(self, x: Arr, y: Arr) -> Point:
        """Rotate a vector from the array's axes to the panel's axes."""
        if self.sin == 0.0 and self.cos == 1.0:
            return x, y
        return self.cos * x - self.sin * y, self.sin * x + self.cos * y

    def turn_back(self, x: Arr, y: Arr) -> Point:
        """Rotate a vector from the panel's axes to the array's axes."""
        if self.sin == 0.0 and self.cos == 1.0:
            return x, y
        return self.cos * x + self.sin * y, self.cos * y - self.sin * x


@dataclass(frozen=True)
class Convergence:
    """Convergence on the eye: the fraction s = D / (D + E), and the axis point a in the array's frame, mm."""

    share: float = 0.0
    axis_x: float = 0.0
    axis_y: float = 0.0

    def towards_eye(self, x: Arr, y: Arr) -> Point:
        """Return the point, mm, where the line from a panel point to the eye crosses the aperture plane."""
        if self.share == 0.0:
            return x, y
        return x - (x - self.axis_x) * self.share, y - (y - self.axis_y) * self.share

    def within_cell(self, x: Arr, y: Arr, cx: Arr, cy: Arr) -> Point:
        """Return the point of `towards_eye`; it and (x, y) are measured from the lenslet's centre (cx, cy)."""
        if self.share == 0.0:
            return x, y
        shrink = 1.0 - self.share
        return x * shrink - (cx - self.axis_x) * self.share, y * shrink - (cy - self.axis_y) * self.share

    def on_panel(self, x: Arr, y: Arr, cx: Arr, cy: Arr) -> Point:
        """Return the panel point that the eye sees at a point of the cell (the inverse of `within_cell`)."""
        if self.share == 0.0:
            return x, y
        shrink = 1.0 - self.share
        return (x + (cx - self.axis_x) * self.share) / shrink, (y + (cy - self.axis_y) * self.share) / shrink


@dataclass(frozen=True)
class System:
    """The optical system of a display.

    `concave` means a capture's plano-concave lenslets, flat towards the panel and
    `thickness_mm` thick at the vertex. Only the model `exact` traces rays through
    concave lenslets, and only from the panel.
    """

    frame: PanelFrame
    lattice: Lattice
    dome: Dome
    index: float
    thickness_mm: float
    gap_mm: float
    aperture_distance_mm: float
    focal_length_mm: float
    plano_to_panel: bool
    convergence: Convergence
    concave: bool = False

    @classmethod
    def of(cls, display: Display) -> System:
        """Return the system of a display."""
        array = display.array
        lattice, frame = Lattice.of(array), PanelFrame.of(display)
        share = display.convergence / (1.0 + display.convergence)
        return cls(
            frame=frame,
            lattice=lattice,
            dome=Dome(lattice, array.radius_mm, array.sag_mm),
            index=array.index,
            thickness_mm=array.thickness_mm,
            gap_mm=display.gap_mm,
            aperture_distance_mm=display.aperture_distance_mm,
            focal_length_mm=array.focal_length_mm,
            plano_to_panel=array.plano_side == "panel",
            convergence=Convergence(share, *frame.array_from_panel(*display.viewing_axis_mm)),
        )

    @property
    def last_face_mm(self) -> float:
        """The z of the array's plane nearest to the viewer: dome vertices or flat face."""
        return 0.0 if self.plano_to_panel else self.thickness_mm

    def locate(self, b: Backend, u: Arr, v: Arr) -> tuple[Arr, Arr, Arr, Arr]:
        """Return pixels' lenslets (i, j), and positions from the lenslets' centres along the array's axes, mm."""
        x, y = self.frame.array_from_panel(*self.frame.panel_from_pixel(u, v))
        i, j, qx, qy = self.lattice.locate(b, *self.convergence.towards_eye(x, y))
        if self.convergence.share == 0.0:
            return i, j, qx, qy
        cx, cy = self.lattice.centre(i, j)
        return i, j, x - cx, y - cy  # from q, the rounding error would be 1 / (1 - s) times as large

    def through_mount(self, b: Backend, status: Arr, passed: Point, own: Point | None = None) -> Arr:
        """Return `status`, or BLOCKED if lenslet `own` is absent, or if `passed` is and the ray is not MISSED."""
        if self.lattice.half_steps is None:
            return status
        there = self.lattice.present(b, *passed) | (status == int(Status.MISSED))
        if own is not None:
            there = there & self.lattice.present(b, *own)
        return b.where(there, status, int(Status.BLOCKED))

    def centre(self, i: Arr, j: Arr) -> Point:
        """Return the centre of lenslet (i, j), panel frame, mm."""
        return self.frame.panel_from_array(*self.lattice.centre(i, j))


class Exit(NamedTuple):
    """A ray that left the array, local to the lenslet (di, dj) steps from the pixel's lenslet, in the array's axes.

    `grazing` is the minimum squared cosine, in air, to a face's normal. Rounding
    rotates the ray by about epsilon / sqrt(`grazing`).
    """

    ray: Ray
    di: Arr
    dj: Arr
    status: Arr
    grazing: Arr


class Landing(NamedTuple):
    """The point where a ray meets the panel plane, local to the passed lenslet, in the array's axes, mm.

    `status` ignores whether the point belongs to the passed lenslet (crosstalk).
    """

    x: Arr
    y: Arr
    di: Arr
    dj: Arr
    status: Arr
