"""Simulates a bench to test calibrations: disturbances outside the model, and cameras that see a complete panel."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from lippmann.calibration.simulated_camera import Camera, CameraValues, Light, Point, Sensor
from lippmann.calibration.simulated_photographs import Bench, Projection, Tracer, trace_projection
from lippmann.display.description import Display
from lippmann.optics.rays import Engine, Floats, Hits, Indices, Status
from lippmann.optics.system import System
from lippmann.optics.trace import trace_to_panel
from scipy import ndimage

#: Period, lenslets, across and down, of the pattern of hidden lenslets.
DUST_PERIOD = 1024
#: Number of patches in a reflection; radius of a patch and of the bright spot as fractions of the photograph's width.
PATCHES, PATCH, SPOT = 6, 0.2, 0.02
#: Fraction of the photograph's width or height that the panel fills after `framed`.
FILL = 0.9


@dataclass(frozen=True)
class Disturbances(Bench):
    """Disturbances of a display on a bench, and of its photographs. By default there are no disturbances.

    `bow_mm` is the bowed array's extra distance from the panel at the corners; it grows with the square of the distance
    from the middle. `dead_pixels`, `hidden_lenslets` (dust) and `outliers` (camera pixels with arbitrary values) are
    fractions. `reflection` and `bright_spot` are the light of a lamp's diffuse reflection and mirror image, as
    fractions of white. `blur_px` is the standard deviation of a Gaussian blur. `moved_mm` moves the camera before the
    second half of the photographs. `seed` chooses dead pixels and hidden lenslets, the same for all camera positions.
    """

    bow_mm: float = 0.0
    dead_pixels: float = 0.0
    hidden_lenslets: float = 0.0
    reflection: float = 0.0
    bright_spot: float = 0.0
    outliers: float = 0.0
    blur_px: float = 0.0
    moved_mm: Point = (0.0, 0.0, 0.0)
    seed: int = 0

    def project(self, display: Display, camera: Camera, samples: int, seed: int) -> Projection:
        """Return the camera's projection of the display with a bowed array and hidden lenslets."""
        return trace_projection(display, camera, samples, seed, disturbed(display, self))

    def move(self, camera: Camera) -> Camera:
        """Return the camera for the second half of the photographs."""
        x, y, z = np.add(camera.position_mm, self.moved_mm).tolist()
        aim = np.add(camera.look_at_mm, self.moved_mm).tolist()
        return replace(camera, position_mm=(x, y, z), look_at_mm=(aim[0], aim[1], aim[2]))

    def photograph(
        self, projection: Projection, light: Light, sensor: Sensor, gain: float, seed: int, rng: np.random.Generator
    ) -> CameraValues:
        """Return a photograph's values, with dead pixels, reflections, a blur and outliers."""
        dead = np.random.default_rng((self.seed, 0xDEAD)).random(light.shape[:2]) < self.dead_pixels
        picture = projection.photograph(np.where(dead if light.ndim == 2 else dead[..., None], np.float32(0.0), light))
        added = reflected(picture.shape[:2], self.reflection, self.bright_spot, seed)
        added *= sensor.exposure / max(gain, 1e-30)
        picture = picture + (added if picture.ndim == 2 else added[..., None])
        if self.blur_px > 0.0:
            picture = ndimage.gaussian_filter(picture, (self.blur_px, self.blur_px, 0.0)[: picture.ndim])
        values = sensor.values(picture, gain, rng)
        if self.outliers == 0.0:
            return values
        # All photographs have outliers at the same camera pixels.
        outliers = np.random.default_rng((seed, 0x0DD)).random(values.shape[:2]) < self.outliers
        noise = rng.integers(0, np.iinfo(values.dtype).max, values.shape, values.dtype, endpoint=True)
        return np.where(outliers if values.ndim == 2 else outliers[..., None], noise, values)


def disturbed(display: Display, disturbances: Disturbances, engine: Engine = "fast") -> Tracer:
    """Return a tracer of rays through the bowed array with hidden lenslets."""
    deeper = display.misaligned(gap_mm=1.0)
    front = System.of(display).last_face_mm

    def trace(origin: Floats, direction: Floats) -> Hits:
        if disturbances.bow_mm != 0.0:
            # Raising a lenslet is equivalent to lowering the ray's start and the panel by the same distance.
            t = (front - origin[:, 2]) / direction[:, 2]
            height = bow_height(display, disturbances.bow_mm, origin[:, :2] + t[:, None] * direction[:, :2])
            origin = origin - np.stack([0.0 * height, 0.0 * height, height], axis=1)
            hits = trace_to_panel(display, origin, direction, engine=engine)
            farther = trace_to_panel(deeper, origin, direction, engine=engine)
            hits = replace(hits, pixel=hits.pixel + height[:, None] * (farther.pixel - hits.pixel))
        else:
            hits = trace_to_panel(display, origin, direction, engine=engine)
        if disturbances.hidden_lenslets > 0.0:
            lost = hidden(hits.lenslet, disturbances.hidden_lenslets, disturbances.seed)
            hits = replace(hits, status=np.where(lost, np.uint8(Status.BLOCKED), hits.status))
        return hits

    return trace


def bow_height(display: Display, bow_mm: float, place_mm: Floats) -> Floats:
    """Return a bowed array's additional height, mm, at points (N, 2), mm from the panel's centre."""
    reach = math.hypot(0.5 * display.panel.width_mm, 0.5 * display.panel.height_mm)
    return np.asarray(bow_mm * (place_mm**2).sum(axis=1) / reach**2)


def hidden(lenslet: Indices, share: float, seed: int) -> npt.NDArray[np.bool_]:
    """Return which lenslets (N, 2) are hidden; the choice depends only on the seed."""
    i, j = lenslet.T % DUST_PERIOD
    dust = np.random.default_rng((seed, 0xD057)).random((DUST_PERIOD, DUST_PERIOD)) < share
    return np.asarray(dust[i, j])


def reflected(shape: tuple[int, int], reflection: float, bright_spot: float, seed: int) -> Light:
    """Return the light, (height, width), that a lamp adds to each photograph: smooth patches and a bright spot."""
    rng = np.random.default_rng((seed, 0x1A3B))
    height, width = shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    added = np.zeros(shape, np.float32)

    def patch(radius: float) -> Light:
        x, y = rng.random() * width, rng.random() * height
        return np.asarray(np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / (radius * width) ** 2), np.float32)

    for _ in range(PATCHES):
        added += patch(PATCH) * np.float32(rng.random())
    added *= np.float32(reflection / max(float(added.max()), 1e-30))
    return added + np.float32(bright_spot) * patch(SPOT)


def corners_mm(display: Display) -> Floats:
    """Return the corners, (4, 3), of the panel's outline in the plane z = 0."""
    x, y = 0.5 * display.panel.width_mm, 0.5 * display.panel.height_mm
    return np.array([(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)])


def framed(camera: Camera, display: Display, fill: float = FILL) -> Camera:
    """Return the camera with the focal length at which the panel fills the fraction `fill` of the photograph."""
    ideal = replace(camera, focal_px=1.0, principal_px=(0.0, 0.0), k1=0.0, k2=0.0)
    reach = np.abs(ideal.project(corners_mm(display))).max(axis=0)
    half = np.array([0.5 * camera.width_px, 0.5 * camera.height_px])
    return replace(camera, focal_px=fill * float(min(half / reach)))
