"""Compute pixels from exit rays in integers, in the stages of rtl/scene/lipp_scene.sv.

Light, weights and opacities have 16 fraction bits; coordinates of texels have 8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.scene_build import MAX_LAYERS, SceneBuild
from lippmann.fixed.words import MUL_BITS, Bools, Bytes, Ints, fits, guarded, multiplier, quadratic, wrapped
from lippmann.optics.rays import Floats, gets_through

#: Fraction bits of a layer's registers `s0` and `t0`, of `depth`, and of `a` to `d`.
TEXEL_FRACTION, DEPTH_FRACTION, COEFFICIENT_FRACTION = 16, 20, 24
#: Register value for a brightness of 1.
FULL_BRIGHTNESS = 256
_WORD = (1 << 32) - 1


@dataclass(frozen=True)
class LayerWords:
    """A layer's registers: seven signed words, and the fields of the eighth word, `look`."""

    s0: int = 0
    t0: int = 0
    depth: int = 0
    a: int = 0
    b: int = 0
    c: int = 0
    d: int = 0
    visible: bool = False
    infinite: bool = False
    slot: int = 0
    brightness: int = FULL_BRIGHTNESS

    @property
    def look(self) -> int:
        """Register `look`: bits 0 visible, 1 infinite, 7 to 4 slot, 16 to 8 brightness."""
        return int(self.visible) | int(self.infinite) << 1 | self.slot << 4 | self.brightness << 8

    @property
    def words(self) -> tuple[int, ...]:
        """The layer's eight words, 0 to 2^32 - 1, in the order of their addresses."""
        moves = (self.s0, self.t0, self.depth, self.a, self.b, self.c, self.d)
        return tuple(word & _WORD for word in (*moves, self.look))


@dataclass(frozen=True)
class SceneWords:
    """A scene's registers: layers from front to back, lattice words, and the background's light."""

    layers: tuple[LayerWords, ...]
    lattice_xi: int
    lattice_xj: int
    lattice_yj: int
    background: tuple[int, int, int]

    @property
    def slots(self) -> tuple[int | None, ...]:
        """The slot that each layer reads, or None.

        If visible layers share a slot, only the first reads the slot.
        """
        visible = [layer.slot if layer.visible else None for layer in self.layers]
        return tuple(None if slot in visible[:k] else slot for k, slot in enumerate(visible))

    @property
    def bits(self) -> int:
        """The registers as bits of `scene_config_t`, whose first field, the layers, is most significant."""
        word = 0
        layers = [*self.layers, *[LayerWords()] * (MAX_LAYERS - len(self.layers))]
        words = [one for layer in reversed(layers) for one in layer.words]
        for one in (*words, self.lattice_xi, self.lattice_xj, self.lattice_yj):
            word = word << 32 | one & _WORD
        for light in self.background:
            word = word << 16 | light
        return word


#: Fraction bits of lattice words, and left shift of a lenslet index before
#: multiplication.
LATTICE_FRACTION = 30
_INDEX_SHIFT = 6


class Lines(NamedTuple):
    """Lines (N,): points at z = 0, radii (F - 3 fraction bits), slopes (F + 1), mask of visible lines."""

    x: Ints
    y: Ints
    slope_x: Ints
    slope_y: Ints
    draws: Bools


def exit_line(rays: FixedRays, xi: int, xj: int, yj: int, f: int) -> Lines:
    """Return the lines along exit rays; `xi`, `xj` and `yj` are the lattice words, 30 fraction bits.

    A ray is drawn if it leaves the array, dz >= 1/4, and x_o and y_o are in [-2048, 2048).

    q is the reciprocal root of 4 dz:

        r        = q q >> F+2                                    1 / dz, F + 4 fraction bits
        slope_x  = ((dx r >> F+1) + 4) >> 3,  slope_y likewise    F + 1 fraction bits
        x_o      = ((xi i >> 31-F) + (xj j >> 31-F) + (x >> 2) - (slope_x z >> F+3) + 2) >> 2
        y_o      = ((yj j >> 31-F) + (y >> 2) - (slope_y z >> F+3) + 2) >> 2.
    """
    length, inverse = f + 4, f + 8
    q = quadratic((rays.dz & ((1 << (f + 1)) - 1)) << 2, "reciprocal", f)
    r = wrapped(multiplier(q, q, f + 6, f + 6, f + 2), inverse)
    slopes = (guarded(multiplier(d, r, f + 2, inverse, f + 1)) for d in (rays.dx, rays.dy))
    slope_x, slope_y = (wrapped(slope, length) for slope in slopes)

    drop = LATTICE_FRACTION + _INDEX_SHIFT + 1 - f

    def centre(lattice: int, index: Ints) -> Ints:
        return multiplier(index << _INDEX_SHIFT, lattice, MUL_BITS, 32, drop)

    centres = centre(xi, rays.i) + centre(xj, rays.j), centre(yj, rays.j)
    places = [
        (c + (local >> 2) - multiplier(slope, rays.z, length, length, f + 3) + 2) >> 2
        for c, local, slope in zip(centres, (rays.x, rays.y), (slope_x, slope_y), strict=True)
    ]
    bits = f + 9
    draws = gets_through(rays.status) & (rays.dz >= 1 << (f - 1))
    draws &= fits(places[0], bits) & fits(places[1], bits)
    x, y = (wrapped(place, bits) for place in places)
    return Lines(x, y, slope_x, slope_y, draws)


#: Bits of a texture coordinate.
COORDINATE_BITS = 20
#: Offset of bilinear coordinates, 16 fraction bits: half a unit of s_o minus half a texel.
_BILINEAR = (1 << 7) - (1 << 15)


def coefficient_bits(f: int) -> int:
    """Return A, the number of a coefficient's 24 fraction bits that a build reads."""
    return min(f + 4, 24)


def layer_coordinate(lines: Lines, layer: LayerWords, bilinear: bool, f: int) -> tuple[Ints, Ints, Bools]:
    """Return the texture coordinates s, t at which lines meet a layer, and a mask of overflows.

        X'  = (2 (infinite ? 0 : x) + 1 + (depth slope_x >> F)) >> 1       F - 3 fraction bits
        Y'  = (2 (infinite ? 0 : y) + 1 + (depth slope_y >> F)) >> 1
        s_o = (s0 + h + (a X' >> A+F-19) + (b Y' >> A+F-19)) >> 8           8 fraction bits
        t_o = (t0 + h + (c X' >> A+F-19) + (d Y' >> A+F-19)) >> 8.

    `depth` has F - 3 fraction bits, a to d have A; h is 2^7 - 2^15 if bilinear, else 0.
    """
    bits, fraction = f + 9, coefficient_bits(f)
    plane, beyond = [], np.zeros(lines.x.shape, np.bool_)
    for place, slope in ((lines.x, lines.slope_x), (lines.y, lines.slope_y)):
        start = np.zeros_like(place) if layer.infinite else place
        met = (2 * start + 1 + multiplier(slope, layer.depth >> (23 - f), f + 4, bits, f)) >> 1
        beyond = beyond | ~fits(met, bits)
        plane.append(wrapped(met, bits))

    coordinates = []
    for zero, *factors in ((layer.s0, layer.a, layer.b), (layer.t0, layer.c, layer.d)):
        total = np.full_like(lines.x, zero + (_BILINEAR if bilinear else 0))
        for factor, at in zip(factors, plane, strict=True):
            total += multiplier(at, factor >> (24 - fraction), bits, fraction + 8, fraction + f - 19)
        total >>= 8
        beyond = beyond | ~fits(total, COORDINATE_BITS)
        coordinates.append(wrapped(total, COORDINATE_BITS))
    return coordinates[0], coordinates[1], beyond


#: Integer for a weight, an opacity or a transmittance of 1.
WHOLE = 1 << 16


def texel_fetch(s: Ints, t: Ints, hidden: Bools, slot: Bytes | None, build: SceneBuild) -> tuple[Ints, Ints]:
    """Return the colours (N, taps, 4) of the texels at coordinates (N,), and their weights (N, taps).

    `slot` is the content of the layer's slot (`slot_bytes`), or None. Bilinear builds
    read four texels, each into tap 2 * (row & 1) + (column & 1). With f = s & 255 and g
    = t & 255, the weights are (256 - f) (256 - g), f (256 - g), (256 - f) g and f g.
    Hidden rays, and texels outside the texture, have weight 0 and colour 0.
    """
    i, j = s >> 8, t >> 8
    if not build.bilinear:
        columns, rows, weights = i[:, None], j[:, None], np.full((len(s), 1), WHOLE)
    else:
        f, g = s & 255, t & 255
        columns, rows, weights = (np.empty((len(s), 4), np.int64) for _ in range(3))
        every = np.arange(len(s))
        for right, down in np.ndindex(2, 2):
            tap = 2 * ((j + down) & 1) + ((i + right) & 1)
            columns[every, tap], rows[every, tap] = i + right, j + down
            weights[every, tap] = (f if right else 256 - f) * (g if down else 256 - g)
    there = (columns >= 0) & (columns < build.width) & (rows >= 0) & (rows < build.height) & ~hidden[:, None]
    if slot is None:
        there = np.zeros_like(there)
        slot = np.zeros(build.slot_bytes, np.uint8)
    index = slot[np.where(there, rows * build.width + columns, 0)]
    palette = slot[build.texels :].reshape(256, 4)
    colours = np.where(there[..., None], palette[index], 0).astype(np.int64)
    return colours, np.where(there, weights, 0)


def texel_blend(colours: Ints, weights: Ints) -> tuple[Ints, Ints]:
    """Return premultiplied light (N, 3) and opacity (N,) of weighted texels (N, taps, 4).

    Texel n has the bytes r, g, b, a, the opacity A = a + [a >= 128] and the weight w_n:

        share_n = (w_n A + 2^7) >> 8        16 fraction bits
        light_o = (sum over n of (share_n r^2 >> 8) + 2^7) >> 8,  g and b likewise
        opacity_o = sum over n of share_n
    """
    alpha = colours[..., 3]
    shares = (weights * (alpha + (alpha >> 7)) + 128) >> 8
    parts = (shares[..., None] * colours[..., :3] ** 2) >> 8
    return (parts.sum(axis=1) + 128) >> 8, shares.sum(axis=1)


def composite(
    light: Sequence[Ints], opacity: Sequence[Ints], draws: Bools, brightness: Sequence[int], background: Ints
) -> Ints:
    """Composite layers and background (3,) to light (N, 3); 0 for rays that are not drawn.

    The layers, front to back, have premultiplied light P (N, 3), opacity A (N,) and
    brightness B, at most 256. Light C_0 is 0, and transmittance T_0 is 65536:

        G_k     = (T_k B_k + 2^7) >> 8
        C_(k+1) = C_k + ((P_k G_k + 2^15) >> 16)        for each of red, green and blue
        T_(k+1) = T_k - ((T_k A_k + 2^15) >> 16)
        light_o = min(C_n + ((background T_n + 2^15) >> 16), 65535), or 0 where draws_i is low.
    """
    half, mask = 1 << 15, (1 << 17) - 1  # the sum of light has 17 bits
    total = np.zeros((len(draws), 3), np.int64)
    passing = np.full(len(draws), WHOLE)
    for one, covered, bright in zip(light, opacity, brightness, strict=True):
        gain = (passing * min(bright, 256) + 128) >> 8
        total = (total + ((one * gain[:, None] + half) >> 16)) & mask
        passing = passing - ((passing * covered + half) >> 16)
    total = (total + ((passing[:, None] * background + half) >> 16)) & mask
    return np.where(draws[:, None], np.minimum(total, 65535), 0)


def sample_mean(light: Ints, samples_bits: int) -> Ints:
    """Return the rounded mean (N, 3) of the light of each pixel's 2^`samples_bits` samples.

    One sample is its own mean; otherwise

        light_o = (sum of light_i + 2^(SamplesBits-1)) >> SamplesBits   for red, green and blue.
    """
    count = 1 << samples_bits
    total: Ints = light.reshape(-1, count, 3).sum(axis=1)
    return (total + (count >> 1)) >> samples_bits


#: Curve-table entries, and light value from which an entry covers 16 values.
ENTRIES = 1 << 13
COARSE_FROM = 1 << 12
#: Light value of white.
WHITE = 255 * 255


def curve_table(light: Ints, table: Bytes) -> Bytes:
    """Convert light to bytes with the table of the panel's transfer curve.

    L is the light:

        rgb_o = table[L < 4096 ? L : 4096 + (L >> 4)]        for each of red, green and blue.
    """
    return table[np.where(light < COARSE_FROM, light, COARSE_FROM + (light >> 4))]


def entry_light() -> Floats:
    """Return the light (8192,) at the middle of each curve-table entry; white is 1."""
    entry = np.arange(ENTRIES)
    return np.where(entry < COARSE_FROM, entry, 16 * (entry - COARSE_FROM) + 7.5) / WHITE


def scene(
    rays: FixedRays, words: SceneWords, slots: Mapping[int, Bytes], table: Bytes, build: SceneBuild, f: int
) -> Bytes:
    """Compute pixels (N, 3) from the exit rays of an optics build with F = `f` fraction bits.

    The `build.samples` rays of a pixel are adjacent. `slots` maps slot numbers to
    contents (`slot_bytes`); other slots contain zeros. `table` is the panel's transfer
    curve, 8192 bytes. Layers beyond `build.layers` are ignored.
    """
    return curve_table(sample_mean(scene_light(rays, words, slots, build, f), build.samples_bits), table)


def scene_light(rays: FixedRays, words: SceneWords, slots: Mapping[int, Bytes], build: SceneBuild, f: int) -> Ints:
    """Return the light (N, 3) of exit rays before averaging; parameters are those of `scene`."""
    lines = exit_line(rays, words.lattice_xi, words.lattice_xj, words.lattice_yj, f)
    empty = np.zeros(build.slot_bytes, np.uint8)
    light, opacity = [], []
    layers = words.layers[: build.layers]
    for layer, slot in zip(layers, words.slots, strict=False):
        s, t, beyond = layer_coordinate(lines, layer, build.bilinear, f)
        content = None if slot is None or slot >= build.slots_built else slots.get(slot, empty)
        one_light, one_opacity = texel_blend(*texel_fetch(s, t, beyond, content, build))
        light.append(one_light)
        opacity.append(one_opacity)
    brightness = [layer.brightness for layer in layers]
    return composite(light, opacity, lines.draws, brightness, np.array(words.background, np.int64))
