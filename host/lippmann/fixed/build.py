"""A build of the RTL: the parameters that decide what hardware there is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from lippmann.display import Display, Grid
from lippmann.errors import InputError
from lippmann.fixed.words import FRACTIONS
from lippmann.optics.rays import Model

#: What the RTL distinguishes; `thin` is the paraxial hardware with other coefficients.
HardwareModel = Literal["pinhole", "paraxial", "exact"]

#: Most further domes that a build may try.
MAX_WALK = 4


@dataclass(frozen=True)
class Build:
    """Parameters of `ray_pipeline`.

    Attributes
    ----------
    fraction_bits
        F, 14 to 23.
    grid
        Lattice.
    model
        Hardware model.
    viewer
        Plano side to the viewer.
    aims
        Rays aim at aperture points; without, chief rays only.
    walk
        Further domes tried when a ray meets a dome outside its cell.
    cross_cells
        Cross terms of products in multiplier cells instead of logic; the same words come out.
    """

    fraction_bits: int
    grid: Grid
    model: HardwareModel = "exact"
    viewer: bool = False
    aims: bool = False
    walk: int = 0
    cross_cells: bool = False

    def __post_init__(self) -> None:
        """Refuse what the RTL's elaboration refuses."""
        for name, kind in (("grid", Grid), ("model", HardwareModel)):
            if getattr(self, name) not in get_args(kind):
                raise InputError(
                    f"{name} '{getattr(self, name)}' cannot be built; choose from {', '.join(get_args(kind))}"
                )
        if self.fraction_bits not in FRACTIONS:
            raise InputError(
                f"F = {self.fraction_bits} fraction bits cannot be built; choose {FRACTIONS[0]} to {FRACTIONS[-1]}"
            )
        if not 0 <= self.walk <= MAX_WALK:
            raise InputError(f"walk = {self.walk} cannot be built; choose 0 to {MAX_WALK}")
        if self.walk and (self.model != "exact" or not (self.aims or self.viewer)):
            raise InputError("walk = 0 is the only choice where rays cannot leave their cell")
        if self.viewer and self.model != "exact":
            raise InputError(
                f"viewer is for exact builds; leave it out of a {self.model} one, whose registers know the side"
            )
        if self.aims and self.model == "pinhole":
            raise InputError("a pinhole build knows no aperture points; leave aims out, or choose another model")

    @classmethod
    def of(cls, display: Display, model: Model, fraction_bits: int, aims: bool, walk: int | None = None) -> Build:
        """Return the build that traces a display with a model; `walk` as needed when left out."""
        viewer = display.array.plano_side == "viewer"
        hardware: HardwareModel = "paraxial" if model == "thin" else model
        exact = model == "exact"
        aims = aims and model != "pinhole"
        if walk is None:
            walk = 2 if exact and (viewer or aims) else 0
        return cls(fraction_bits, display.array.grid, hardware, viewer and exact, aims, walk)

    @property
    def near(self) -> int:
        """Bits of a near or wide word, W."""
        return self.fraction_bits + 2
