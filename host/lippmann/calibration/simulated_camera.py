"""Model a camera in front of a display: pose, distortion, pupil, focus, vignetting and sensor.

The normalised coordinates x, y of a direction are its slopes to the axis, right and
down. With focal length f, principal point (cx, cy), r^2 = x^2 + y^2, the pixel is

    u = cx + f x (1 + k1 r^2 + k2 r^4),   v = cy + f y (1 + k1 r^2 + k2 r^4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lippmann.base.tones import Transfer, encoded_values
from lippmann.errors import InputError
from lippmann.optics.rays import Floats

Point = tuple[float, float, float]
Light = npt.NDArray[np.float32]
#: Pixel values of a photograph, (height, width) or (height, width, 3), uint8 or uint16.
CameraValues = npt.NDArray[np.unsignedinteger]


@dataclass(frozen=True)
class Camera:
    """A camera; lengths are mm in the display's frame, and the middle of pixel (0, 0) is at (0.5, 0.5).

    `principal_px` defaults to the middle of the photograph. `pupil_mm` is the entrance
    pupil's diameter. `focus_mm` is the focus distance along the axis, by default that
    of `look_at_mm`. `blur_px` is the standard deviation of a Gaussian blur.
    `vignetting` is the fraction of light that corners lose beyond the cosine-fourth
    law.
    """

    position_mm: Point
    look_at_mm: Point = (0.0, 0.0, 0.0)
    roll_deg: float = 0.0
    width_px: int = 1280
    height_px: int = 960
    focal_px: float = 1500.0
    principal_px: tuple[float, float] | None = None
    k1: float = 0.0
    k2: float = 0.0
    pupil_mm: float = 0.0
    focus_mm: float | None = None
    blur_px: float = 0.0
    vignetting: float = 0.0

    def __post_init__(self) -> None:
        if not self.position_mm[2] > 0.0:
            raise InputError(f"camera: z {self.position_mm[2]:g} mm is not in front of the display; give z > 0")
        if not self.focal_px > 0.0:
            raise InputError(f"camera: focal length {self.focal_px:g} px is not positive; give a positive number")
        # If the distortion is not monotonic, `slopes` does not invert `pixel`.
        border = self.border()
        u, v = self.pixel(*self.slopes(*border))
        if not max(np.abs(u - border[0]).max(), np.abs(v - border[1]).max()) < 1e-6:
            raise InputError(f"camera: distortion {self.k1:g}, {self.k2:g} is not monotonic; choose k1, k2 nearer to 0")

    @property
    def centre_px(self) -> tuple[float, float]:
        """Principal point in pixels."""
        return self.principal_px or (0.5 * self.width_px, 0.5 * self.height_px)

    @property
    def axes(self) -> Floats:
        """Camera axes as rows (3, 3): the unit vectors to the right, down and forward."""
        forward = np.subtract(self.look_at_mm, self.position_mm)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 1.0, 0.0))
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        turn = math.radians(self.roll_deg)
        c, s = math.cos(turn), math.sin(turn)
        return np.stack([c * right + s * down, c * down - s * right, forward])

    @property
    def focus_distance_mm(self) -> float:
        """Focus distance along the optical axis."""
        return self.focus_mm or float(np.linalg.norm(np.subtract(self.look_at_mm, self.position_mm)))

    def pixel(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Convert normalised coordinates to pixel coordinates."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        square = x * x + y * y
        gain = self.focal_px * (1.0 + square * (self.k1 + square * self.k2))
        return self.centre_px[0] + gain * x, self.centre_px[1] + gain * y

    def slopes(self, u: npt.ArrayLike, v: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Convert pixel coordinates to normalised coordinates."""
        x = (np.asarray(u, np.float64) - self.centre_px[0]) / self.focal_px
        y = (np.asarray(v, np.float64) - self.centre_px[1]) / self.focal_px
        if self.k1 == self.k2 == 0.0:
            return x, y
        distorted = np.hypot(x, y)
        r = distorted.copy()
        for _ in range(12):  # Newton's method
            square = r * r
            slope = 1.0 + square * (3.0 * self.k1 + 5.0 * self.k2 * square)
            slope = np.where(np.abs(slope) > 1e-3, slope, 1e-3)
            step = (r * (1.0 + square * (self.k1 + self.k2 * square)) - distorted) / slope
            r -= step
            if np.abs(step).max(initial=0.0) < 1e-14:
                break
        scale = np.divide(r, distorted, out=np.ones_like(r), where=distorted > 0.0)
        return x * scale, y * scale

    def project(self, points_mm: npt.ArrayLike) -> Floats:
        """Return the pixel coordinates (N, 2) of points (N, 3) in front of the camera."""
        right, down, forward = (np.subtract(points_mm, self.position_mm) @ self.axes.T).T
        return np.stack(self.pixel(right / forward, down / forward), axis=1)

    def rays(
        self, u: npt.ArrayLike, v: npt.ArrayLike, pupil: tuple[npt.ArrayLike, npt.ArrayLike] = (0.0, 0.0)
    ) -> tuple[Floats, Floats]:
        """Return ray origins (N, 3), mm, and unit directions (N, 3), for a `pupil` point in the unit disc."""
        x, y = self.slopes(u, v)
        axes, radius, focus = self.axes, 0.5 * self.pupil_mm, self.focus_distance_mm
        px, py = (radius * np.asarray(p, np.float64) + 0.0 * x for p in pupil)
        ax, ay = focus * x - px, focus * y - py
        origin = self.position_mm + px[:, None] * axes[0] + py[:, None] * axes[1]
        towards = ax[:, None] * axes[0] + ay[:, None] * axes[1] + focus * axes[2]
        return origin, towards / np.sqrt(ax * ax + ay * ay + focus * focus)[:, None]

    def brightness(self) -> Floats:
        """Return the relative illumination (height, width), 1 on the optical axis."""
        u, v = np.meshgrid(np.arange(self.width_px) + 0.5, np.arange(self.height_px) + 0.5)
        x, y = self.slopes(u, v)
        square = x * x + y * y
        corner = max(a * a + b * b for a, b in zip(*self.slopes(*self.border()), strict=True))
        # Apply the cosine-fourth law of a simple lens.
        return np.asarray((1.0 + square) ** (-2.0) * (1.0 - self.vignetting * square / corner))

    def border(self) -> tuple[Floats, Floats]:
        """Return pixel coordinates along the photograph's edges, with the corners."""
        u, v = np.meshgrid(*(np.linspace(0.0, side, 33) for side in (self.width_px, self.height_px)))
        edge = np.pad(np.zeros((31, 31), bool), 1, constant_values=True)
        return u[edge], v[edge]


@dataclass(frozen=True)
class Sensor:
    """A camera sensor; `exposure` is the level of white relative to the full well; values above 1 clip."""

    exposure: float = 0.8
    full_well_e: float = 10000.0
    read_noise_e: float = 6.0
    bits: int = 8
    transfer: Transfer = "srgb"

    def gain(self, white: Light) -> float:
        """Return the gain (full wells per unit of light) at which `white` has the level `exposure`."""
        brightest = float(np.percentile(white, 99.5))  # ignore the brightest pixels
        return self.exposure / brightest if brightest > 0.0 else 0.0

    def values(self, light: Light, gain: float, rng: np.random.Generator) -> CameraValues:
        """Convert light to camera values, uint8 or uint16, with photon noise and read noise."""
        electrons = np.maximum(light * np.float32(gain * self.full_well_e), 0.0)
        # Above ten photons, the Poisson distribution is nearly normal.
        deviation = np.sqrt(electrons + np.float32(self.read_noise_e**2))
        electrons += deviation * rng.standard_normal(electrons.shape, np.float32)
        return encoded_values(np.clip(electrons / self.full_well_e, 0.0, 1.0), self.transfer, self.bits)
