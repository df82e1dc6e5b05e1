"""The words of a scene's registers (`scene_config_t` of rtl/scene/lipp_scene_pkg.sv)."""

from __future__ import annotations

from dataclasses import dataclass

from lippmann.fixed.scene_build import MAX_LAYERS

#: Fraction bits of the registers.
TEXEL_FRACTION, DEPTH_FRACTION, COEFFICIENT_FRACTION = 16, 20, 24
#: Brightness of 1.
FULL_BRIGHTNESS = 256
_WORD = (1 << 32) - 1


@dataclass(frozen=True)
class LayerWords:
    """A layer's registers: seven signed words of 32 bits, and the fields of the eighth, `look`."""

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
        """The eighth word: visible in bit 0, infinite in bit 1, slot in bits 7 to 4, brightness in bits 16 to 8."""
        return int(self.visible) | int(self.infinite) << 1 | self.slot << 4 | self.brightness << 8

    @property
    def words(self) -> tuple[int, ...]:
        """The eight words in the order of their addresses, each 0 to 2^32 - 1."""
        moves = (self.s0, self.t0, self.depth, self.a, self.b, self.c, self.d)
        return tuple(word & _WORD for word in (*moves, self.look))


@dataclass(frozen=True)
class SceneWords:
    """A scene's registers: its layers from front to back, the lattice's words, and the background's light."""

    layers: tuple[LayerWords, ...]
    lattice_xi: int
    lattice_xj: int
    lattice_yj: int
    background: tuple[int, int, int]

    @property
    def slots(self) -> tuple[int | None, ...]:
        """The slot of each layer: of the visible ones that name a slot, the first has it; None: without one."""
        taken: set[int] = set()
        found: list[int | None] = []
        for layer in self.layers:
            found.append(layer.slot if layer.visible and layer.slot not in taken else None)
            if layer.visible:
                taken.add(layer.slot)
        return tuple(found)

    @property
    def bits(self) -> int:
        """The bits of `scene_config_t`: its first field, the layers, is the most significant."""
        word = 0
        layers = [*self.layers, *[LayerWords()] * (MAX_LAYERS - len(self.layers))]
        for layer in reversed(layers):
            for one in layer.words:
                word = word << 32 | one
        for lattice in (self.lattice_xi, self.lattice_xj, self.lattice_yj):
            word = word << 32 | lattice & _WORD
        for light in self.background:
            word = word << 16 | light
        return word
