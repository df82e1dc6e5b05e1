"""Convert pixels and aperture points to fixed-point words and back, and words to rays."""

from __future__ import annotations

import numpy as np

from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import PIXEL_BITS, PIXEL_FRACTION, Ints, fits
from lippmann.optics.rays import Floats, Rays
from lippmann.optics.system import System


def words_of_pixels(display: Display, pixels: Floats) -> tuple[Ints, Ints]:
    """Convert pixel coordinates (N, 2) to words from the panel's centre, in 1/16 pixel.

    Raises InputError for pixels that do not fit the words and, if elemental images
    converge, for pixels outside the panel, whose rays may be too steep.
    """
    scale, half = 1 << PIXEL_FRACTION, 0.5 * np.array(display.panel.size_px)
    words = np.floor((pixels - half) * (scale, -scale) + 0.5)
    if not fits(words, PIXEL_BITS).all():
        reach = 1 << (PIXEL_BITS - 1 - PIXEL_FRACTION)
        raise InputError(
            f"pixels lie outside [-{reach}, {reach}) from the panel's centre, the range of the fixed-point "
            "engines; give pixels nearer to it"
        )
    if display.viewing_distance_mm is not None and (np.abs(words) > half * scale).any():
        raise InputError(
            "pixels lie outside the panel; with viewing_distance_mm, give fixed-point engines only pixels of the panel"
        )
    return words[:, 0].astype(np.int64), words[:, 1].astype(np.int64)


def pixels_of_words(display: Display, u: Ints, v: Ints) -> Floats:
    """Convert the words (u, v) to pixel coordinates (N, 2)."""
    panel, scale = display.panel, 1.0 / (1 << PIXEL_FRACTION)
    return np.stack([u * scale + 0.5 * panel.width_px, 0.5 * panel.height_px - v * scale], axis=1)


def words_of_aims(display: Display, aperture_mm: Floats, fraction_bits: int) -> tuple[Ints, Ints]:
    """Convert aperture points (N, 2), mm from the lenslet's centre, to wide words in pitches and rows.

    Raises InputError for points more than 1.5 pitches from their lenslet's centre.
    """
    array = display.array
    x, y = aperture_mm.T
    scaled = np.stack([(x - array.shear * y) / array.pitches_mm[0], y / array.row_pitch_mm], axis=1)
    if (np.abs(scaled) > 1.5).any():
        raise InputError("aperture points lie over 1.5 pitches from their lenslet's centre; give points nearer to it")
    words = np.floor(np.ldexp(scaled, fraction_bits) + 0.5).astype(np.int64)
    return words[:, 0], words[:, 1]


def aims_of_words(display: Display, a: Ints, b: Ints, fraction_bits: int) -> Floats:
    """Convert the words (a, b) to aperture points (N, 2), mm."""
    array = display.array
    x = np.ldexp(a * array.pitches_mm[0], -fraction_bits)
    y = np.ldexp(b * array.row_pitch_mm, -fraction_bits)
    return np.stack([x + array.shear * y, y], axis=1)


def word_unit(fraction_bits: int) -> float:
    """Return the value of the last bit of a direction word, and of a point word in radii."""
    return 2.0 ** -(fraction_bits + 1)


def rays_of_words(display: Display, pixel: Floats, rays: FixedRays, fraction_bits: int) -> Rays:
    """Convert words to rays in mm, in the panel's axes; `pixel` (N, 2) are pixel coordinates."""
    system = System.of(display)
    frame = system.frame
    unit = word_unit(fraction_bits)
    length = unit * display.array.radius_mm
    x, y = frame.turn(rays.x * length, rays.y * length)
    dx, dy = frame.turn(rays.dx * unit, rays.dy * unit)
    centre = system.centre(rays.i.astype(np.float64), rays.j.astype(np.float64))
    return Rays(
        pixel=pixel,
        lenslet=np.stack([rays.i, rays.j], axis=1),
        centre_mm=np.stack(centre, axis=1),
        local_mm=np.stack([x, y, rays.z * length], axis=1),
        direction=np.stack([dx, dy, rays.dz * unit], axis=1),
        status=rays.status.astype(np.uint8),
    )
