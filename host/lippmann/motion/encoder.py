"""A panel's values of radiance, found where the radiance is: on the processor's threads or on the GPU (Dr.Jit)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.base.fullscreen import Pixels
from lippmann.base.tones import encoded_values
from lippmann.base.variant import mitsuba
from lippmann.display.description import Panel

#: float32 of 0 and of 1, as whole numbers; those between are in the order of their values.
ZERO, ONE = 0, 0x3F800000


def least_radiance(panel: Panel, bits: int) -> npt.NDArray[np.float32]:
    """Return the least radiance of each of a panel's levels above the darkest (2^bits - 1,), by bisection.

    For any transfer curve that does not fall: `encoded_values` itself is asked.
    """
    wanted = values_of(bits)[1:]
    low, high = np.full(len(wanted), ZERO), np.full(len(wanted), ONE)
    while (high - low > 1).any():
        middle = (low + high) // 2
        reached = encoded_values(middle.astype(np.int32).view(np.float32), panel.transfer, bits) >= wanted
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return high.astype(np.int32).view(np.float32)


def values_of(bits: int) -> npt.NDArray[np.uint8]:
    """Return the 8-bit values of all levels of a panel of up to 8 bits (levels,)."""
    return encoded_values(np.linspace(0.0, 1.0, 1 << bits), "linear", bits).astype(np.uint8)


class Encoder:
    """Makes 8-bit values of planes of radiance, those of `encoded_values`."""

    def __init__(self, panel: Panel) -> None:
        """Take the panel's transfer curve, and its bits up to 8."""
        import drjit as dr

        mi = mitsuba()
        bits = min(panel.bits, 8)
        self._byte = getattr(dr, mi.variant().split("_")[0]).ad.UInt8
        self._shape = (panel.height_px, panel.width_px, 3)
        self._least, self._values = mi.Float(least_radiance(panel, bits)), self._byte(values_of(bits))
        dr.make_opaque(self._least, self._values)

    def __call__(self, planes: list[Any]) -> Pixels:
        """Return the values (height, width, 3) of red, green and blue planes, each of all pixels row by row.

        They may be Dr.Jit's memory, as in `radiance_of`.
        """
        mi = mitsuba()
        import drjit

        dr: Any = drjit  # its search has no types
        place = 3 * dr.arange(mi.UInt32, dr.width(planes[0]))
        found = dr.empty(self._byte, 3 * dr.width(place))
        for k, plane in enumerate(planes):
            level = dr.binary_search(
                0, dr.width(self._least), lambda i, plane=plane: dr.gather(mi.Float, self._least, i) <= plane
            )
            dr.scatter(found, dr.gather(self._byte, self._values, level), place + k)
        return np.asarray(found).reshape(self._shape)
