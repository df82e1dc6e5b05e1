"""Defines the results of a trace, and the names of models and engines."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal, get_args

import numpy as np
import numpy.typing as npt

from lippmann.base.toml import documented, key
from lippmann.errors import InputError
from lippmann.optics.backend import Arr

Model = Literal["pinhole", "thin", "paraxial", "exact"]
Engine = Literal["golden", "fast", "twin", "rtl"]
#: The models, cheapest first.
MODELS: tuple[Model, ...] = get_args(Model)
ENGINES: tuple[Engine, ...] = get_args(Engine)

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


class Status(IntEnum):
    """Status of a ray, the same in all engines."""

    OK = 0
    MISSED = 1
    INTERNAL_REFLECTION = 2
    BLOCKED = 3
    CROSSTALK = 4


def check_fraction_bits(fraction_bits: int | None, engine: str) -> None:
    """Refuse `fraction_bits` for the engines golden and fast."""
    if fraction_bits is not None and engine in ("golden", "fast"):
        raise InputError(f"fraction_bits belongs to the engines twin and rtl; leave it out with {engine}")


def gets_through(status: Arr) -> Arr:
    """Return which rays pass the array; `status` is an array of any backend."""
    # Dr.Jit compares arrays with integers, but not with an IntEnum.
    return (status == int(Status.OK)) | (status == int(Status.CROSSTALK))


@documented
@dataclass(frozen=True)
class Rays:
    """N rays that leave a display, as arrays."""

    pixel: Annotated[Floats, key("(N, 2) float64, pixel coordinates (column, row; continuous) of the starts")]
    lenslet: Annotated[Indices, key("(N, 2) int64, (i, j) of the lenslets through which the rays leave")]
    centre_mm: Annotated[Floats, key("(N, 2) float64, centres of these lenslets, panel frame")]
    local_mm: Annotated[Floats, key("(N, 3) float64, origins from these centres, panel's axes; z = 0 at the vertices")]
    direction: Annotated[Floats, key("(N, 3) float64, unit vectors")]
    status: Annotated[npt.NDArray[np.uint8], key("(N,) uint8, see `Status`")]

    @property
    def origin_mm(self) -> Floats:
        """The rays' origins in the panel frame, (N, 3) float64."""
        origin = self.local_mm.copy()
        origin[:, :2] += self.centre_mm
        return origin


@dataclass(frozen=True)
class Hits:
    """Hits of N rays on the panel: pixels (N, 2), passed lenslets (N, 2), statuses (N,)."""

    pixel: Floats
    lenslet: Indices
    status: npt.NDArray[np.uint8]
