"""A build of the RTL's drawing: the parameters that decide what hardware is made (`scene_build_t`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from lippmann.base.toml import documented, key
from lippmann.errors import InputError

#: Most layers and slots; slot 15 is the panel's curve.
MAX_LAYERS, MAX_SLOTS = 8, 15
CURVE_SLOT = 15
#: Bytes of a block, the unit in which slots are loaded.
BLOCK_BYTES = 1024
#: Bytes of a palette, the block after the texels.
PALETTE_BYTES = 256 * 4
#: Most blocks of texels of a slot.
MAX_TEXEL_BLOCKS = 255
#: Bits and first bit of each field of the build's word, the lowest first.
_FIELDS = (("layers", 4), ("slots", 4), ("width_bits", 4), ("height", 11), ("bilinear", 1), ("samples_bits", 2))


@documented
@dataclass(frozen=True)
class SceneBuild:
    """Parameters of the RTL module `scene`."""

    layers: Annotated[int, key("layers, 1 to 8")] = 4
    slots: Annotated[int | None, key("slots for textures, `layers` to 15; left out, one more than layers")] = None
    width: Annotated[int, key("columns of texels of a slot, a power of two from 32 to 1024")] = 256
    height: Annotated[int, key("rows of texels of a slot, 2 to 1024; even with bilinear")] = 192
    bilinear: Annotated[bool, key("texels are interpolated; without, the nearest one is taken")] = False
    samples: Annotated[int, key("rays for each pixel: 1, 2 or 4")] = 1

    def __post_init__(self) -> None:
        """Refuse what the RTL's elaboration refuses."""
        _check("layers", self.layers, range(1, MAX_LAYERS + 1))
        if self.slots is None:
            object.__setattr__(self, "slots", self.layers + 1)
        _check("slots", self.slots_built, range(self.layers, MAX_SLOTS + 1))
        if self.width not in (32, 64, 128, 256, 512, 1024):
            raise InputError(f"width = {self.width} cannot be built; choose 32, 64, 128, 256, 512 or 1024 texels")
        _check("height", self.height, range(2, 1025))
        size = f"{self.width} x {self.height} texels"
        if self.texels % BLOCK_BYTES or self.texels > MAX_TEXEL_BLOCKS * BLOCK_BYTES:
            raise InputError(
                f"slots of {size} cannot be built; choose a multiple of {BLOCK_BYTES} texels, at most "
                f"{MAX_TEXEL_BLOCKS * BLOCK_BYTES}"
            )
        if self.bilinear and self.height % 2:
            raise InputError(f"height = {self.height} cannot be built with bilinear; choose an even number of rows")
        if self.samples not in (1, 2, 4):
            raise InputError(f"samples = {self.samples} cannot be built; choose 1, 2 or 4 rays for each pixel")

    @property
    def slots_built(self) -> int:
        """Number of slots."""
        return self.slots if self.slots is not None else self.layers + 1

    @property
    def texels(self) -> int:
        """Texels of a slot."""
        return self.width * self.height

    @property
    def slot_bytes(self) -> int:
        """Bytes of a slot: its texels, then its palette."""
        return self.texels + PALETTE_BYTES

    @property
    def blocks(self) -> int:
        """Blocks of a slot."""
        return self.slot_bytes // BLOCK_BYTES

    @property
    def width_bits(self) -> int:
        """Binary logarithm of the width."""
        return self.width.bit_length() - 1

    @property
    def samples_bits(self) -> int:
        """Binary logarithm of the samples."""
        return self.samples.bit_length() - 1

    @property
    def word(self) -> int:
        """The word of `scene_build_t`, 26 bits: the RTL's parameter, and what its register `build` holds."""
        values = {
            "layers": self.layers, "slots": self.slots_built, "width_bits": self.width_bits, "height": self.height,
            "bilinear": int(self.bilinear), "samples_bits": self.samples_bits,
        }  # fmt: skip
        word = at = 0
        for name, bits in _FIELDS:
            word, at = word | values[name] << at, at + bits
        return word

    @classmethod
    def of_word(cls, word: int) -> SceneBuild:
        """Return the build whose word a register holds; raises InputError for one that cannot be built."""
        values = {}
        for name, bits in _FIELDS:
            values[name], word = word & ((1 << bits) - 1), word >> bits
        if word:
            raise InputError(f"the register of the scene's build has unknown bits {word:#x}")
        return cls(
            values["layers"], values["slots"], 1 << values["width_bits"], values["height"], bool(values["bilinear"]),
            1 << values["samples_bits"],
        )  # fmt: skip


def _check(name: str, value: int, values: range) -> None:
    if value not in values:
        raise InputError(f"{name} = {value} cannot be built; choose {values[0]} to {values[-1]}")
