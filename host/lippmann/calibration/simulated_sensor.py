"""A camera's sensor: from the light of a picture to the numbers of a photograph's file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.base.tones import Transfer, encoded_values
from lippmann.calibration.simulated_projection import Light

#: The brightest pixels of a white panel that the exposure does not count, percent.
BRIGHTEST = 0.5


@dataclass(frozen=True)
class Sensor:
    """A sensor. The defaults are those of a small camera: a pixel of 10000 electrons, and 8 bits in sRGB.

    `exposure` is where a white panel comes, as a share of the full well: above 1 it is clipped.
    """

    exposure: float = 0.8
    full_well_e: float = 10000.0
    read_noise_e: float = 6.0
    bits: int = 8
    transfer: Transfer = "srgb"

    def gain(self, white: Light) -> float:
        """Return the share of the full well for light 1, from the picture of a white panel."""
        brightest = float(np.percentile(white, 100.0 - BRIGHTEST))
        return self.exposure / brightest if brightest > 0.0 else 0.0

    def values(self, light: Light, gain: float, rng: np.random.Generator) -> npt.NDArray[np.unsignedinteger[Any]]:
        """Return a photograph's values, uint8 or uint16, with the noise of photons and of reading."""
        electrons = np.maximum(light * np.float32(gain * self.full_well_e), 0.0)
        # From some ten photons on, their number is normal.
        deviation = np.sqrt(electrons + np.float32(self.read_noise_e**2))
        electrons += deviation * rng.standard_normal(electrons.shape, np.float32)
        return encoded_values(np.clip(electrons / self.full_well_e, 0.0, 1.0), self.transfer, self.bits)
