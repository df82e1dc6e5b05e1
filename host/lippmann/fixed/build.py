"""A build of the RTL: the parameters that decide what hardware is made; and the builds that have a name."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Annotated, Literal, get_args

from lippmann.base.toml import documented, key
from lippmann.display.description import Display, Grid, load_display
from lippmann.errors import InputError
from lippmann.fixed.words import COMPACT, FRACTIONS, WIDEST, extra_bits
from lippmann.optics.rays import Model
from lippmann.optics.system import System

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
    converge: Annotated[bool, key("elemental images may converge on a near eye")] = False
    shear: Annotated[bool, key("the lattice may be sheared")] = False

    def __post_init__(self) -> None:
        """Refuse what the RTL's elaboration refuses."""
        for name, kind in (("grid", Grid), ("model", HardwareModel)):
            value = getattr(self, name)
            if value not in get_args(kind):
                raise InputError(f"{name} '{value}' cannot be built; choose from {', '.join(get_args(kind))}")
        for name, values in (("fraction_bits", FRACTIONS), ("max_cell_steps", range(MOST_CELL_STEPS + 1))):
            value = getattr(self, name)
            if not isinstance(value, Integral) or isinstance(value, bool):
                raise InputError(f"{name} {value!r} is not a whole number; give {values[0]} to {values[-1]}")
            if value not in values:
                raise InputError(f"{name} = {value} cannot be built; choose {values[0]} to {values[-1]}")
        if self.max_cell_steps and (self.model != "exact" or not (self.aims or self.viewer or self.converge)):
            raise InputError("max_cell_steps must be 0 in a build whose rays cannot leave their cell")
        if self.viewer and self.model != "exact":
            raise InputError(
                f"viewer belongs to exact builds; leave it out of a {self.model} build, whose registers hold the side"
            )
        if self.aims and self.model == "pinhole":
            raise InputError("a pinhole build has no aperture points; leave aims out, or choose another model")

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
        """Return the build that traces a display with a model.

        `max_cell_steps` left out: 2 where rays can leave their cell, else 0. `converge` and `shear` left out: as the
        display needs.
        """
        viewer = display.array.plano_side == "viewer"
        hardware: HardwareModel = "paraxial" if model == "thin" else model
        exact = model == "exact"
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
        """Bits of a near or wide word, W."""
        return self.fraction_bits + 2

    @property
    def extra(self) -> int:
        """Bits of slopes and directions in the air beyond a word's, `extra_bits`."""
        return extra_bits(self.fraction_bits) if self.model == "exact" and not self.viewer else 0

    @property
    def local(self) -> int:
        """Bits of a pixel's point measured from its lenslet's centre."""
        return self.fraction_bits + (4 if self.converge or self.shear else 2)

    @property
    def aim(self) -> int:
        """Bits of an aperture point measured from its lenslet's centre."""
        return self.fraction_bits + (4 if self.shear else 2)

    @property
    def slope_aims(self) -> bool:
        """Whether the slope takes a factor for the aperture point."""
        return self.aims and (self.converge or self.model == "paraxial")

    def as_dict(self) -> dict[str, int | str]:
        """Return the parameters for a JSON file; `walk`, the old name of `max_cell_steps`, stays for one version."""
        return {**dataclasses.asdict(self), "walk": self.max_cell_steps}


def shift_mm(display: Display) -> float:
    """Return how far from its lenslet's cell a pixel may lie where elemental images converge on an eye."""
    system, panel = System.of(display), display.panel
    corners = [(x * panel.width_mm, y * panel.height_mm) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    axis = system.convergence
    points = [system.frame.array_from_panel(*corner) for corner in corners]
    return axis.share * max(math.hypot(x - axis.axis_x, y - axis.axis_y) for x, y in points)


def _chief_rays_stray(display: Display) -> bool:
    """Tell whether a chief ray may leave its lenslet's cell before the dome, where elemental images converge on an eye.

    Snell's law bends a steep ray less than the thin lens of the definition does, the more the steeper it is. With the
    plano side to the viewer the ray meets the dome near its vertex.
    """
    array, shift = display.array, shift_mm(display)
    if not shift or array.plano_side == "viewer":
        return False
    lattice = System.of(display).lattice
    nearest_side = lattice.half_mm / max(math.hypot(*axis) for axis in lattice.axes)
    slope = (shift + array.half_diagonal_mm) / display.aperture_distance_mm
    sine = slope / math.hypot(1.0, slope) / array.index
    # At the rims' plane; nearer to the viewer the ray is nearer to the axis.
    depth = array.thickness_mm - array.sag_mm
    return slope * array.thickness_mm / array.index - depth * sine / math.sqrt(1.0 - sine**2) >= nearest_side


#: Shipped displays (scenes/displays) of each grid.
DISPLAYS: dict[Grid, tuple[str, ...]] = {"square": ("paper-square", "uhd-8k"), "hex": ("paper-hex", "uhd-4k")}

#: Viewing distance of the displays of a build with `converge`.
EYE_MM = 600.0


@dataclass(frozen=True)
class Named:
    """A build with a name.

    `promise_urad` and `promise_nm` bound its error against golden, in direction (times min(1, 2 cos theta_t)) and in
    exit point; None makes no promise.
    """

    name: str
    build: Build
    promise_urad: float | None = None
    promise_nm: float | None = None

    def displays(self, scenes: Path) -> list[Display]:
        """Return the shipped displays that it can trace, turned over if its plano side faces the viewer.

        A build with `converge` gets an eye in front of them, one with `shear` a lattice with two pitches and a shear.
        `scenes` is the project's folder of scenes.
        """
        shipped = [load_display(scenes / "displays" / f"{name}.toml") for name in DISPLAYS[self.build.grid]]
        if self.build.converge:
            shipped = [near_eye(display) for display in shipped]
        if self.build.shear:
            shipped = [skewed(display) for display in shipped]
        return [turned_over(display) for display in shipped] if self.build.viewer else shipped


def turned_over(display: Display) -> Display:
    """Return the display with its array's plano side to the viewer, at least a focal length from the panel."""
    array = dataclasses.replace(display.array, plano_side="viewer")
    gap = max(display.gap_mm, array.focal_length_mm)
    return dataclasses.replace(display, name=f"{display.name}, turned over", array=array, gap_mm=gap)


def near_eye(display: Display) -> Display:
    """Return the display for an eye at `EYE_MM`."""
    return dataclasses.replace(display, name=f"{display.name}, near eye", viewing_distance_mm=EYE_MM)


def skewed(display: Display) -> Display:
    """Return the display with rows 3 % nearer to each other, lenslets 2 % farther along them, and a shear of 5 %."""
    array = display.array
    px, py = array.pitches_mm
    moved = dataclasses.replace(array, pitch_mm=(1.02 * px, 0.97 * py), shear=0.05)
    moved = dataclasses.replace(moved, thickness_mm=max(array.thickness_mm, moved.sag_mm))
    return dataclasses.replace(display, name=f"{display.name}, skewed", array=moved)


_NAMED = (
    *(Named(f"widest-{g}", Build(WIDEST, g), 1.0, 2.0) for g in DISPLAYS),
    *(Named(f"widest-aims-{g}", Build(WIDEST, g, aims=True, max_cell_steps=1), 1.0, 2.0) for g in DISPLAYS),
    *(Named(f"compact-{g}", Build(COMPACT, g), 60.0) for g in DISPLAYS),
    Named("converged-hex", Build(WIDEST, "hex", converge=True), 1.0, 2.0),
    Named("affine-hex", Build(WIDEST, "hex", shear=True), 1.0, 2.0),
    Named("viewer-square", Build(WIDEST, "square", viewer=True, max_cell_steps=2), 1.0, 2.0),
    Named("paraxial-square", Build(WIDEST, "square", "paraxial")),
    Named("pinhole-square", Build(WIDEST, "square", "pinhole")),
    *(Named(f"square-{f}", Build(f, "square")) for f in (18, 20, 21, 22)),
    Named("pinhole-compact", Build(COMPACT, "square", "pinhole")),
)
#: The named configurations, by name.
CONFIGURATIONS = {one.name: one for one in _NAMED}


def select_builds(names: tuple[str, ...]) -> list[Named]:
    """Return configurations by name, all when no name is given; raise InputError for an unknown name."""
    for name in names:
        if name not in CONFIGURATIONS:
            raise InputError(f"unknown configuration '{name}'; choose from {', '.join(CONFIGURATIONS)}")
    return [CONFIGURATIONS[name] for name in names or CONFIGURATIONS]
