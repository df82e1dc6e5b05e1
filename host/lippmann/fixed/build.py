"""Define `Build`: the parameters of the optics RTL, such as lens model and fraction bits."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Literal

from lippmann.base.toml import check_fields, documented, key
from lippmann.display.description import Display, Grid
from lippmann.errors import InputError
from lippmann.fixed.words import FRACTIONS, extra_bits
from lippmann.optics.rays import Model
from lippmann.optics.system import System

#: Lens models of the RTL. A `paraxial` build also traces the model `thin`.
HardwareModel = Literal["pinhole", "paraxial", "exact"]


@documented
@dataclass(frozen=True)
class Build:
    """Parameters of the RTL module `ray_pipeline`."""

    fraction_bits: Annotated[int, key("F, 14 to 23", low=FRACTIONS[0], high=FRACTIONS[-1])]
    grid: Annotated[Grid, key("lattice")]
    model: Annotated[HardwareModel, key("lens model")] = "exact"
    viewer: Annotated[bool, key("the plano side faces the viewer")] = False
    aims: Annotated[bool, key("rays aim at aperture points; without, all rays are chief rays")] = False
    #: The RTL calls this parameter `walk`.
    max_cell_steps: Annotated[
        int, key("cells that a ray may step to when it meets a dome outside its cell", low=0, high=4)
    ] = 0
    cross_cells: Annotated[bool, key("cross terms of products in multiplier cells, not logic; same results")] = False
    converge: Annotated[bool, key("elemental images may converge on a near eye")] = False
    shear: Annotated[bool, key("the lattice may be sheared")] = False

    def __post_init__(self) -> None:
        check_fields(self)
        if self.max_cell_steps and (self.model != "exact" or not (self.aims or self.viewer or self.converge)):
            raise InputError("max_cell_steps must be 0 in a build whose rays cannot leave their cell")
        if self.viewer and self.model != "exact":
            raise InputError(
                f"viewer needs model exact; leave viewer out of {self.model} builds, whose registers set the plano side"
            )
        if self.aims and self.model == "pinhole":
            raise InputError(
                "aims needs aperture points, which a pinhole build lacks; leave aims out, or choose another model"
            )

    @classmethod
    def of(
        cls,
        display: Display,
        model: Model,
        fraction_bits: int,
        aims: bool,
        max_cell_steps: int | None = None,
        converge: bool | None = None,
        shear: bool | None = None,
    ) -> Build:
        """Return the RTL build that traces a display with a lens model.

        By default, `max_cell_steps` is 2 if rays can leave their cell, else 0;
        `converge` and `shear` are True if the display needs them.
        """
        viewer, exact = display.array.plano_side == "viewer", model == "exact"
        hardware: HardwareModel = "paraxial" if model == "thin" else model
        aims = aims and model != "pinhole"
        if max_cell_steps is None:
            max_cell_steps = 2 if exact and (viewer or aims or _chief_rays_stray(display)) else 0
        if converge is None:
            converge = display.viewing_distance_mm is not None
        if shear is None:
            shear = display.array.shear != 0.0
        sides = viewer and exact, aims, max_cell_steps
        return cls(fraction_bits, display.array.grid, hardware, *sides, converge=converge, shear=shear)

    @property
    def near(self) -> int:
        """Number of bits W of a near word or a wide word."""
        return self.fraction_bits + 2

    @property
    def extra(self) -> int:
        """Number of extra bits E of slopes and of directions in air."""
        return extra_bits(self.fraction_bits) if self.model == "exact" and not self.viewer else 0

    @property
    def local(self) -> int:
        """Number of bits of a pixel's point relative to its lenslet's centre."""
        return self.fraction_bits + (4 if self.converge or self.shear else 2)

    @property
    def aim(self) -> int:
        """Number of bits of an aperture point relative to its lenslet's centre."""
        return self.fraction_bits + (4 if self.shear else 2)

    @property
    def slope_aims(self) -> bool:
        """Whether a ray's slope has a coefficient for the aperture point."""
        return self.aims and (self.converge or self.model == "paraxial")

    def as_dict(self) -> dict[str, int | str]:
        """Return the parameters for JSON; `walk` repeats `max_cell_steps` under its old name."""
        return {**dataclasses.asdict(self), "walk": self.max_cell_steps}


def shift_mm(display: Display) -> float:
    """Return the maximum shift, mm, of a pixel out of its cell if elemental images converge."""
    system = System.of(display)
    axis = system.convergence
    return axis.share * max(math.hypot(x - axis.axis_x, y - axis.axis_y) for x, y in system.frame.corners)


def _chief_rays_stray(display: Display) -> bool:
    """Return whether a chief ray towards the eye may leave its lenslet's cell before the dome.

    If the plano side faces the viewer, a chief ray meets the dome near its vertex.
    """
    array, shift = display.array, shift_mm(display)
    if not shift or array.plano_side == "viewer":
        return False
    lattice = System.of(display).lattice
    nearest_side = lattice.half_mm / max(math.hypot(*axis) for axis in lattice.axes)
    slope = (shift + array.half_diagonal_mm) / display.aperture_distance_mm
    sine = slope / math.hypot(1.0, slope) / array.index
    # A ray is farthest from the axis in the plane of the dome's rim.
    depth = array.thickness_mm - array.sag_mm
    return slope * array.thickness_mm / array.index - depth * sine / math.sqrt(1.0 - sine**2) >= nearest_side
