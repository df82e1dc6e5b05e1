"""Defines the configurations of the RTL that have names in the project's reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from lippmann.display.description import Display, Grid, load_display
from lippmann.fixed.build import Build
from lippmann.fixed.words import COMPACT, WIDEST

#: Names of shipped displays (scenes/displays), keyed by grid.
DISPLAYS: dict[Grid, tuple[str, ...]] = {"square": ("paper-square", "uhd-8k"), "hex": ("paper-hex", "uhd-4k")}

#: Viewing distance, mm, of displays that are adapted for builds with `converge`.
EYE_MM = 600.0


@dataclass(frozen=True)
class Named:
    """A named build, and bounds of its errors: direction error times min(1, 2 cos theta_t), and exit point's error."""

    name: str
    build: Build
    promise_urad: float | None = None
    promise_nm: float | None = None

    def displays(self, scenes: Path) -> list[Display]:
        """Return the shipped displays of the build's grid, adapted so that the build can trace them."""
        displays = [load_display(scenes / "displays" / f"{name}.toml") for name in DISPLAYS[self.build.grid]]
        if self.build.converge:
            displays = [replace(one, name=f"{one.name}, near eye", viewing_distance_mm=EYE_MM) for one in displays]
        if self.build.shear:
            displays = [skewed(display) for display in displays]
        return [turned_over(display) for display in displays] if self.build.viewer else displays


def turned_over(display: Display) -> Display:
    """Return the display with the array's plano side to the viewer, and a gap of at least a focal length."""
    array = replace(display.array, plano_side="viewer")
    gap = max(display.gap_mm, array.focal_length_mm)
    return replace(display, name=f"{display.name}, turned over", array=array, gap_mm=gap)


def skewed(display: Display) -> Display:
    """Return the display with rows 3 % closer, lenslets 2 % farther apart along the rows, and a shear of 5 %."""
    array = display.array
    px, py = array.pitches_mm
    moved = replace(array, pitch_mm=(1.02 * px, 0.97 * py), shear=0.05)
    moved = replace(moved, thickness_mm=max(array.thickness_mm, moved.sag_mm))
    return replace(display, name=f"{display.name}, skewed", array=moved)


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
#: The named configurations, keyed by name.
CONFIGURATIONS = {one.name: one for one in _NAMED}
