"""A build of the RTL: the parameters that decide what hardware is made."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from lippmann.display import Display, Grid
from lippmann.errors import InputError
from lippmann.fixed.words import FRACTIONS
from lippmann.optics.rays import Model
from lippmann.toml import documented, key

#: Lens models of the RTL; `thin` runs on the paraxial hardware with other coefficients.
HardwareModel = Literal["pinhole", "paraxial", "exact"]

#: Largest `max_cell_steps` of a build.
MOST_CELL_STEPS = 4


@documented
@dataclass(frozen=True)
class Build:
    """Parameters of the RTL module `ray_pipeline`."""

    fraction_bits: Annotated[int, key("F, 14 to 23")]
    grid: Annotated[Grid, key("lattice")]
    model: Annotated[HardwareModel, key("lens model")] = "exact"
    viewer: Annotated[bool, key("the plano side faces the viewer")] = False
    aims: Annotated[bool, key("rays aim at aperture points; without, all rays are chief rays")] = False
    #: The RTL's parameter `Walk`.
    max_cell_steps: Annotated[int, key("cells that a ray may step to when it meets a dome outside its cell")] = 0
    cross_cells: Annotated[bool, key("cross terms of products in multiplier cells, not logic; same results")] = False

    def __post_init__(self) -> None:
        """Refuse what the RTL's elaboration refuses."""
        for name, kind in (("grid", Grid), ("model", HardwareModel)):
            value = getattr(self, name)
            if value not in get_args(kind):
                raise InputError(f"{name} '{value}' cannot be built; choose from {', '.join(get_args(kind))}")
        for name, values in (("fraction_bits", FRACTIONS), ("max_cell_steps", range(MOST_CELL_STEPS + 1))):
            value = getattr(self, name)
            if value not in values:
                raise InputError(f"{name} = {value} cannot be built; choose {values[0]} to {values[-1]}")
        if self.max_cell_steps and (self.model != "exact" or not (self.aims or self.viewer)):
            raise InputError("max_cell_steps must be 0 in a build whose rays cannot leave their cell")
        if self.viewer and self.model != "exact":
            raise InputError(
                f"viewer belongs to exact builds; leave it out of a {self.model} build, whose registers hold the side"
            )
        if self.aims and self.model == "pinhole":
            raise InputError("a pinhole build has no aperture points; leave aims out, or choose another model")

    @classmethod
    def of(
        cls, display: Display, model: Model, fraction_bits: int, aims: bool, max_cell_steps: int | None = None
    ) -> Build:
        """Return the build that traces a display with a model.

        `max_cell_steps` left out: 2 where rays can leave their cell, else 0.
        """
        viewer = display.array.plano_side == "viewer"
        hardware: HardwareModel = "paraxial" if model == "thin" else model
        exact = model == "exact"
        aims = aims and model != "pinhole"
        if max_cell_steps is None:
            max_cell_steps = 2 if exact and (viewer or aims) else 0
        return cls(fraction_bits, display.array.grid, hardware, viewer and exact, aims, max_cell_steps)

    @property
    def near(self) -> int:
        """Bits of a near or wide word, W."""
        return self.fraction_bits + 2

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters for a JSON file; `walk`, the old name of `max_cell_steps`, stays for one version."""
        return {**dataclasses.asdict(self), "walk": self.max_cell_steps}
