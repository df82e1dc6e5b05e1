"""A picture with opacity becomes texels and a palette of 256 colours, with the least mean square error.

Pillow chooses the first palette; Lloyd's steps then move each colour to the mean of its texels. Distances are those of
what is seen: of the square roots of light times the opacity, and of the opacity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lippmann.layers.stack import COLOURS, Bytes, Floats, alpha_of, bytes_of

#: Lloyd's steps; each makes the error smaller, the last ones by less than 1 %.
STEPS = 12


@dataclass(frozen=True)
class Picture:
    """Linear light (height, width, 3) float64, not multiplied by the opacity (height, width) float64; both 0 to 1."""

    light: Floats
    opacity: Floats

    @property
    def rgba(self) -> Bytes:
        """(height, width, 4) uint8, as a palette's colours; where nothing is opaque, 0."""
        alpha = alpha_of(self.opacity)
        colours = np.where(alpha[..., None] > 0, bytes_of(self.light), 0)
        return np.concatenate([colours, alpha[..., None]], axis=-1).astype(np.uint8)


class Quantised(NamedTuple):
    """Texels and palette of a picture, and the error that they add, dB: its peak signal over the noise."""

    texels: Bytes
    palette: Bytes
    error_db: float


def quantise(rgba: Bytes) -> Quantised:
    """Quantise a picture (height, width, 4), bytes as in a palette, to 256 colours.

    Colour 0 is transparent, so that a smaller texture can fill a slot. A picture of at most 255 other colours keeps
    them all. Opaque texels stay opaque.
    """
    height, width = rgba.shape[:2]
    flat = np.where(rgba[..., 3:] > 0, rgba, 0).reshape(-1, 4).astype(np.uint8)
    found, index, counts = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
    kept = found[found[:, 3] > 0]
    if len(kept) < COLOURS:
        colours = kept
    else:
        used = found[:, 3] > 0
        colours = _palette(kept, counts[used])
    palette = np.zeros((COLOURS, 4), np.uint8)
    palette[1 : 1 + len(colours)] = colours
    place = np.zeros(len(found), np.int64)
    if len(colours):
        place[found[:, 3] > 0] = 1 + nearest(kept, colours)
    error = float(((_seen(found) - _seen(palette[place]))[:, :3] ** 2).mean(axis=1) @ counts) / counts.sum()
    texels = place[index.ravel()].reshape(height, width).astype(np.uint8)
    return Quantised(texels, palette, float("inf") if error == 0.0 else float(-10.0 * np.log10(error)))


def _seen(rgba: Bytes) -> Floats:
    """Return colours (N, 4) as points whose distances are the errors that an eye sees: premultiplied, and opacity."""
    share = rgba / 255.0
    return np.concatenate([share[:, :3] * share[:, 3:], share[:, 3:]], axis=1)


def nearest(rgba: Bytes, palette: Bytes) -> np.ndarray:
    """Return the palette's colour nearest to each colour; opaque ones take opaque ones only."""
    from scipy.spatial import KDTree  # at its first use: it takes as long to load as all of render

    place = KDTree(_seen(palette)).query(_seen(rgba))[1]
    opaque, solid = rgba[:, 3] == 255, np.flatnonzero(palette[:, 3] == 255)
    if len(solid) and opaque.any():
        place[opaque] = solid[KDTree(_seen(palette[solid])).query(_seen(rgba[opaque]))[1]]
    return np.asarray(place, np.int64)


def _palette(colours: Bytes, counts: np.ndarray) -> Bytes:
    """Return 255 colours for many (N, 4), none transparent; `counts` tells how many texels have each."""
    from PIL import Image

    # The first palette: Pillow's octree knows opacity. A row of one picture, each colour once.
    start = Image.fromarray(colours[None], "RGBA").quantize(COLOURS - 1, Image.Quantize.FASTOCTREE)
    palette = np.array(start.getpalette("RGBA"), np.uint8).reshape(-1, 4)
    palette = palette[np.unique(np.asarray(start))]
    points, opaque = _seen(colours), colours[:, 3] == 255
    for _ in range(STEPS):
        place = nearest(colours, palette)
        weight = np.bincount(place, counts, len(palette))
        # Colours without texels move to those that are worst.
        error = ((points - _seen(palette)[place]) ** 2).sum(axis=1) * counts
        worst = np.argsort(-error)[: COLOURS - 1 - int((weight > 0).sum())]
        sums = np.stack([np.bincount(place, counts * points[:, k], len(palette)) for k in range(4)], axis=1)
        solid = np.bincount(place, opaque, len(palette)) > 0
        palette = np.concatenate(
            [_bytes(sums[weight > 0] / weight[weight > 0, None], solid[weight > 0]), colours[worst]]
        )
    return palette


def _bytes(points: Floats, solid: np.ndarray) -> Bytes:
    """Return points of `_seen` as colours; `solid` ones become opaque."""
    opacity = np.where(solid, 1.0, points[:, 3:].ravel())
    colour = points[:, :3] / np.maximum(points[:, 3:], 1e-9)
    rgba = np.concatenate([colour, opacity[:, None]], axis=1)
    return np.asarray(np.maximum(np.rint(255.0 * np.clip(rgba, 0.0, 1.0)), [0, 0, 0, 1]), np.uint8)
