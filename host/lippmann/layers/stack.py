"""Describes a scene as a stack of layers (textures of palette colours) in front of a background.

The engines golden, twin and rtl draw the bytes that a board stores. Pillow chooses a
picture's initial palette. Lloyd's algorithm then moves each colour to the mean of its
texels. Colours are compared by opacity, and by opacity times light's square root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lippmann.errors import InputError, as_number, check_flags, check_type

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
#: Size of a texture: texels across and down.
Size = tuple[int, int]
Number = TypeVar("Number", bound=np.generic)

MAX_LAYERS = 8
#: Maximum side of a texture, texels.
MAX_SIDE = 1024
#: Colours in a palette.
COLOURS = 256
#: Maximum distance of a layer from the lenslet array, mm, except for skies.
MAX_DEPTH_MM = 1e6


def light_of(bytes_: npt.ArrayLike) -> Floats:
    """Return the linear light (c / 255)^2 of palette bytes c."""
    return (np.asarray(bytes_, np.float64) / 255.0) ** 2


def bytes_of(light: npt.ArrayLike) -> Bytes:
    """Return the palette bytes nearest to linear light; the inverse of `light_of`."""
    return np.asarray(np.rint(255.0 * np.sqrt(np.clip(light, 0.0, 1.0))), np.uint8)


def opacity_of(alpha: npt.ArrayLike) -> Floats:
    """Return the opacity (a + [a >= 128]) / 256 of a palette's fourth byte a, so that 255 is opaque."""
    a = np.asarray(alpha, np.float64)
    return (a + (a >= 128)) / 256.0


def alpha_of(opacity: npt.ArrayLike) -> Bytes:
    """Return the palette bytes nearest to an opacity; the inverse of `opacity_of`."""
    steps = np.rint(256.0 * np.clip(opacity, 0.0, 1.0))
    return np.asarray(steps - (steps >= 129.0), np.uint8)


@dataclass(frozen=True, eq=False)
class Layer:
    """A texture in a plane of the display's frame, or at infinity (a sky).

    Attributes
    ----------
    texels
        (height, width) uint8, indices into the palette; row 0 on top.
    palette
        (256, 4) uint8: red, green, blue (square roots of linear light) and opacity.
    depth_mm
        z of the plane, mm; a positive z is in front of the array. `math.inf` is a sky.
    matrix
        (2, 3) float64: a ray that meets the plane at (x, y), mm, sees texel (s, t) =
        matrix @ (x, y, 1). In a sky, (s, t) = matrix @ (dx/dz, dy/dz, 1). s increases
        to the right and t downwards. Texel (0, 0) covers 0 to 1 in s and t. A layer is
        transparent outside its texture.
    brightness
        Factor on the light, 0 to 1, but not on the opacity.
    visible
        Whether the layer is drawn.
    """

    texels: Bytes
    palette: Bytes
    depth_mm: float
    matrix: Floats
    brightness: float = 1.0
    visible: bool = True

    def __post_init__(self) -> None:
        texels = _array("layer: texels", self.texels, np.uint8, (None, None), "(height, width), each at least 1")
        if max(texels.shape) > MAX_SIDE:
            size = f"{texels.shape[1]} x {texels.shape[0]}"
            raise InputError(f"layer: the texture has {size} texels; give at most {MAX_SIDE} x {MAX_SIDE}")
        form = f"({COLOURS}, 4): red, green, blue, alpha"
        palette = _array("layer: palette", self.palette, np.uint8, (COLOURS, 4), form)
        matrix = _array("layer: matrix", self.matrix, np.float64, (2, 3), "(2, 3)")
        depth = _number("depth_mm", self.depth_mm)
        if not (depth == math.inf or abs(depth) <= MAX_DEPTH_MM):
            what = f"layer: depth_mm {depth:g} is out of range"
            raise InputError(f"{what}; give {-MAX_DEPTH_MM:g} to {MAX_DEPTH_MM:g}, or inf for a sky")
        brightness = _number("brightness", self.brightness)
        if not 0.0 <= brightness <= 1.0:
            raise InputError(f"layer: brightness {brightness:g} is out of range; give 0 to 1")
        check_flags(visible=self.visible)
        values = (texels, palette, depth, matrix, brightness, bool(self.visible))
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            object.__setattr__(self, name, value)

    @property
    def width(self) -> int:
        """Number of texels in a row."""
        return int(self.texels.shape[1])

    @property
    def height(self) -> int:
        """Number of rows of texels."""
        return int(self.texels.shape[0])

    @property
    def sky(self) -> bool:
        """Whether the layer is at infinity."""
        return math.isinf(self.depth_mm)

    def moved(self, scale: float, offset_mm: tuple[float, float, float]) -> Layer:
        """Return the layer scaled about the display's centre, then shifted; a sky does not change."""
        scale = _number("scale", scale)
        x, y, z = _array("layer: offset_mm", offset_mm, np.float64, (3,), "(x, y, z) in mm")
        if self.sky:
            return self
        linear, shift = self.matrix[:, :2] / scale, self.matrix[:, 2]
        matrix = np.column_stack([linear, shift - linear @ (x, y)])
        return replace(self, depth_mm=scale * self.depth_mm + z, matrix=matrix)

    def padded(self, width: int, height: int) -> Bytes:
        """Return a slot's texels (height, width): the texture at the top left, transparent elsewhere.

        Raises InputError for a texture larger than the slot, and for a smaller texture
        without a transparent colour in its palette.
        """
        size = f"layer: the texture of {self.width} x {self.height} texels"
        if self.width > width or self.height > height:
            remedy = f"cut the scene again with lippmann layers --slot {width}x{height}"
            raise InputError(f"{size} is larger than a slot of {width} x {height}; {remedy}")
        if (self.width, self.height) == (width, height):
            return self.texels
        clear = np.flatnonzero(self.palette[:, 3] == 0)
        if not len(clear):
            what = "is smaller than a slot, and its palette has no transparent colour to fill it"
            remedy = f"give {width} x {height} texels, or a transparent colour"
            raise InputError(f"{size} {what}; {remedy}")
        slot = np.full((height, width), clear[0], np.uint8)
        slot[: self.height, : self.width] = self.texels
        return slot


@dataclass(frozen=True, eq=False)
class LayerStack:
    """Layers from front to back, and the background behind them.

    Attributes
    ----------
    layers
        1 to 8 layers; the first layer is in front of all others, whatever the depths.
    background
        (3,) float64, linear red, green and blue, 0 to 1.
    """

    layers: tuple[Layer, ...]
    background: Floats = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        check_type("layers", self.layers, (list, tuple), "a list of lippmann.Layer")
        layers = tuple(self.layers)
        for k, layer in enumerate(layers):
            if not isinstance(layer, Layer):
                raise InputError(f"layers: layer {k} is a {type(layer).__name__}; give a Layer")
        if not 1 <= len(layers) <= MAX_LAYERS:
            raise InputError(f"layers: the stack has {len(layers)} layers; give 1 to {MAX_LAYERS}")
        background = _array("layers: background", self.background, np.float64, (3,), "(3,)")
        if (background < 0.0).any() or (background > 1.0).any():
            raise InputError(f"layers: background {background.tolist()} is out of range; give linear light, 0 to 1")
        object.__setattr__(self, "layers", layers)
        object.__setattr__(self, "background", background)

    def moved(self, scale: float = 1.0, offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> LayerStack:
        """Return the stack scaled about the display's centre, then shifted by `offset_mm`."""
        if not 0.0 < as_number(scale) < math.inf:
            raise InputError(f"layers: scale {scale} is out of range; give more than 0")
        return replace(self, layers=tuple(layer.moved(scale, offset_mm) for layer in self.layers))


def _array(
    name: str, values: npt.ArrayLike, kind: type[Number], shape: tuple[int | None, ...], form: str
) -> npt.NDArray[Number]:
    """Check type and shape (None: any length above 0) of values; return a read-only copy."""
    try:
        # Conversion to bytes would lose fractions or high bits.
        array = np.asarray(values, None if kind is np.uint8 else kind)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} has an entry that is not a number; give {form}") from None
    if array.dtype != kind:
        raise InputError(f"{name} has type {array.dtype}; give uint8")
    sides = zip(shape, array.shape, strict=False)
    if array.ndim != len(shape) or not array.size or any(side not in (None, count) for side, count in sides):
        raise InputError(f"{name} has shape {array.shape}; give {form}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} contains a value that is not finite; give finite numbers")
    copy = array.copy()
    copy.setflags(write=False)
    return copy


def _number(name: str, value: object) -> float:
    number = as_number(value)
    if math.isnan(number):
        raise InputError(f"layer: {name} {value!r} is not a number; give a number")
    return number


#: Steps of Lloyd's algorithm. Each of the last steps lowers the error by under 1 %.
STEPS = 12


def rgba_of(light: Floats, opacity: Floats) -> Bytes:
    """Return the palette bytes (height, width, 4) of a picture's linear light and opacity."""
    return np.concatenate([bytes_of(light), alpha_of(opacity)[..., None]], axis=-1)


def quantise(rgba: Bytes) -> tuple[Bytes, Bytes, float]:
    """Quantise a picture (height, width, 4) of palette bytes to 256 colours.

    Returns texels, palette, and the PSNR in dB. Colour 0 is transparent, and pads
    pictures to their slots. A picture with at most 255 visible colours keeps them all.
    Opaque texels stay opaque.
    """
    height, width = rgba.shape[:2]
    flat = np.where(rgba[..., 3:] > 0, rgba, 0).reshape(-1, 4)
    every, index, counts = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
    visible = every[:, 3] > 0
    colours = every[visible] if visible.sum() < COLOURS else _palette(every[visible], counts[visible])
    palette = np.zeros((COLOURS, 4), np.uint8)
    palette[1 : 1 + len(colours)] = colours
    place = np.zeros(len(every), np.int64)
    if len(colours):
        place[visible] = 1 + nearest(every[visible], colours)
    error = float(((_perceived(every) - _perceived(palette[place]))[:, :3] ** 2).mean(axis=1) @ counts) / counts.sum()
    texels = place[index.ravel()].reshape(height, width).astype(np.uint8)
    return texels, palette, math.inf if error == 0.0 else float(-10.0 * np.log10(error))


def _perceived(rgba: Bytes) -> Floats:
    """Map colours (N, 4) to points whose distances measure visible errors."""
    share = rgba / 255.0
    return np.concatenate([share[:, :3] * share[:, 3:], share[:, 3:]], axis=1)


def nearest(rgba: Bytes, palette: Bytes) -> np.ndarray:
    """Return the index of each colour's nearest palette colour: an opaque one if the colour is opaque."""
    from scipy.spatial import KDTree  # scipy loads slowly

    place = KDTree(_perceived(palette)).query(_perceived(rgba))[1]
    opaque, solid = rgba[:, 3] == 255, np.flatnonzero(palette[:, 3] == 255)
    if len(solid) and opaque.any():
        place[opaque] = solid[KDTree(_perceived(palette[solid])).query(_perceived(rgba[opaque]))[1]]
    return np.asarray(place, np.int64)


def _palette(colours: Bytes, counts: np.ndarray) -> Bytes:
    """Return 255 colours for visible colours (N, 4); `counts` (N,) texels have each colour."""
    from PIL import Image

    # Pillow's octree supports opacity. The image `start` has each colour once.
    start = Image.fromarray(colours[None], "RGBA").quantize(COLOURS - 1, Image.Quantize.FASTOCTREE)
    palette: Bytes = np.array(start.getpalette("RGBA"), np.uint8).reshape(-1, 4)[np.unique(np.asarray(start))]
    points, opaque = _perceived(colours), colours[:, 3] == 255
    for _ in range(STEPS):
        place = nearest(colours, palette)
        weight = np.bincount(place, counts, len(palette))
        # Colours with large errors replace palette colours without texels.
        error = ((points - _perceived(palette)[place]) ** 2).sum(axis=1) * counts
        worst = np.argsort(-error)[: COLOURS - 1 - np.count_nonzero(weight)]
        sums = np.stack([np.bincount(place, counts * points[:, k], len(palette)) for k in range(4)], axis=1)
        solid, used = np.bincount(place, opaque, len(palette)) > 0, weight > 0
        palette = np.concatenate([_colours_at(sums[used] / weight[used, None], solid[used]), colours[worst]])
    return palette


def _colours_at(points: Floats, solid: np.ndarray) -> Bytes:
    opacity = np.where(solid, 1.0, points[:, 3:].ravel())
    colour = points[:, :3] / np.maximum(points[:, 3:], 1e-9)
    rgba = np.concatenate([colour, opacity[:, None]], axis=1)
    return np.asarray(np.maximum(np.rint(255.0 * np.clip(rgba, 0.0, 1.0)), [0, 0, 0, 1]), np.uint8)
