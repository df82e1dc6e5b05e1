"""Define `SceneBuild`: the parameters of the scene RTL, such as layers and texture slots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from lippmann.base.toml import check_fields, documented, key
from lippmann.errors import InputError
from lippmann.fixed.registers import SCENE_REGISTERS

#: Maximum layers and texture slots; slot 15 holds the panel's transfer curve.
MAX_LAYERS, MAX_SLOTS = 8, 15
CURVE_SLOT = 15
#: Bytes of a block, the unit in which slots are loaded.
BLOCK_BYTES = 1024
#: Bytes of a palette, the block after a slot's texels.
PALETTE_BYTES = 256 * 4
#: Maximum blocks of texels in a slot.
MAX_TEXEL_BLOCKS = 255


@documented
@dataclass(frozen=True)
class SceneBuild:
    """Parameters of the RTL module `scene`."""

    layers: Annotated[int, key("layers, 1 to 8", low=1, high=MAX_LAYERS)] = 4
    slots: Annotated[int | None, key("slots for textures, `layers` to 15; left out, one more than layers")] = None
    width: Annotated[int, key("columns of texels of a slot, a power of two from 32 to 1024")] = 256
    height: Annotated[int, key("rows of texels of a slot, 2 to 1024; even with bilinear", low=2, high=1024)] = 192
    bilinear: Annotated[bool, key("texels are interpolated; without, the nearest one is taken")] = False
    samples: Annotated[int, key("rays for each pixel: 1, 2 or 4")] = 1

    def __post_init__(self) -> None:
        check_fields(self)
        if self.slots is None:
            object.__setattr__(self, "slots", self.layers + 1)
        if not self.layers <= self.slots_built <= MAX_SLOTS:
            raise InputError(f"slots = {self.slots} cannot be built; choose {self.layers} to {MAX_SLOTS}")
        if self.width not in (32, 64, 128, 256, 512, 1024):
            raise InputError(f"width = {self.width} cannot be built; choose 32, 64, 128, 256, 512 or 1024 texels")
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
        """Number of texture slots."""
        return self.slots if self.slots is not None else self.layers + 1

    @property
    def texels(self) -> int:
        """Number of texels of a slot."""
        return self.width * self.height

    @property
    def slot_bytes(self) -> int:
        """Number of bytes of a slot, for its texels, then its palette."""
        return self.texels + PALETTE_BYTES

    @property
    def blocks(self) -> int:
        """Number of 1024-byte blocks of a slot."""
        return self.slot_bytes // BLOCK_BYTES

    @property
    def samples_bits(self) -> int:
        """Binary logarithm of the number of samples per pixel."""
        return self.samples.bit_length() - 1

    @property
    def word(self) -> int:
        """The build as a 26-bit word, as in the RTL parameter `Scene` and the scene register `build`."""
        return SCENE_REGISTERS["build"].word(
            layers=self.layers,
            slots=self.slots_built,
            width_bits=self.width.bit_length() - 1,
            height=self.height,
            bilinear=int(self.bilinear),
            samples_bits=self.samples_bits,
        )

    @classmethod
    def of_word(cls, word: int) -> SceneBuild:
        """Return the scene build that the word of the register `build` describes.

        Raises InputError for unknown bits or an impossible build.
        """
        register = SCENE_REGISTERS["build"]
        values = register.values(word)
        if unknown := word - register.word(**values):
            raise InputError(f"the scene's register build has unknown bits {unknown:#x}; update the host")
        width, samples = 1 << values["width_bits"], 1 << values["samples_bits"]
        return cls(values["layers"], values["slots"], width, values["height"], bool(values["bilinear"]), samples)
