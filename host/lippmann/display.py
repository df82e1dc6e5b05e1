"""The display: a panel behind a microlens array, described once in a TOML file.

The keys are documented in docs/reference/display-file.md, the optics in docs/reference/optics.md.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import tomllib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, cast, get_args

from lippmann.errors import InputError, input_error
from lippmann.glass import DESIGN_WAVELENGTH_NM, index_of
from lippmann.toml import Table

Grid = Literal["square", "hex"]
PlanoSide = Literal["panel", "viewer"]
Subpixels = Literal["none", "rgb", "bgr"]
Transfer = Literal["srgb", "linear", "gamma2.2"]

MM_PER_INCH = 25.4
#: Largest panel side that is accepted (px): what a file format and an index of 16 bits hold.
MAX_SIDE_PX = 65535
#: Lengths that are accepted (mm): far beyond what can be built, well within what squares and quotients survive.
LENGTHS = {"at_least": 1e-9, "at_most": 1e12}
#: Indices that are accepted: above air, up to the densest optical materials.
INDEX_RANGE = (1.0, 4.0)


@dataclass(frozen=True)
class Panel:
    """The panel that emits the light.

    Attributes
    ----------
    width_px, height_px
        Number of pixels.
    pixel_pitch_mm
        Distance of neighbouring pixels' centres, the same in x and y.
    subpixels
        "none": a pixel emits all its colours everywhere; "rgb", "bgr": three vertical stripes, left to right.
    bits
        Bits for each colour.
    transfer
        Curve from panel value to light.
    """

    width_px: int
    height_px: int
    pixel_pitch_mm: float
    subpixels: Subpixels = "none"
    bits: int = 8
    transfer: Transfer = "srgb"

    @property
    def width_mm(self) -> float:
        """Width of the emitting area, mm."""
        return self.width_px * self.pixel_pitch_mm

    @property
    def height_mm(self) -> float:
        """Height of the emitting area, mm."""
        return self.height_px * self.pixel_pitch_mm


@dataclass(frozen=True)
class Array:
    """The microlens array: identical plano-convex lenslets on a square or hexagonal lattice.

    Attributes
    ----------
    pitch_mm
        Lattice pitch; hexagonal cells are this far across their flats, rows run along x.
    radius_mm
        Radius of curvature of the dome.
    index
        Refractive index at the design wavelength.
    glass
        Name of the glass, or None when only the index is known.
    thickness_mm
        Vertex to flat face.
    plano_side
        What the flat face looks at.
    rotation_deg
        Turn of the lattice, counter-clockwise as the viewer sees it.
    offset_mm
        Where the centre of one lenslet stands on the panel, from the panel's centre.
    """

    grid: Grid
    pitch_mm: float
    radius_mm: float
    index: float
    thickness_mm: float
    plano_side: PlanoSide = "panel"
    glass: str | None = None
    rotation_deg: float = 0.0
    offset_mm: tuple[float, float] = (0.0, 0.0)

    @property
    def half_diagonal_mm(self) -> float:
        """Centre of a cell to its corner, mm."""
        return self.pitch_mm / (math.sqrt(2.0) if self.grid == "square" else math.sqrt(3.0))

    @property
    def row_pitch_mm(self) -> float:
        """Distance of neighbouring rows of lenslets, mm."""
        return self.pitch_mm * (0.5 * math.sqrt(3.0) if self.grid == "hex" else 1.0)

    @property
    def flat_distance_mm(self) -> float:
        """Distance d from the sphere's centre to the rims' plane, mm (paper, equations 3 and 4)."""
        # Factored, since R^2 - rho^2 loses digits where a lenslet is nearly a hemisphere.
        rho = self.half_diagonal_mm
        return math.sqrt((self.radius_mm - rho) * (self.radius_mm + rho))

    @property
    def sag_mm(self) -> float:
        """Depth of the dome from its vertex to the cell's corners, mm."""
        # rho^2 / (R + d) equals R - d without the cancellation of a nearly flat lens.
        return self.half_diagonal_mm**2 / (self.radius_mm + self.flat_distance_mm)

    @property
    def focal_length_mm(self) -> float:
        """Focal length f = R / (n - 1), mm (paper, equation 2)."""
        return self.radius_mm / (self.index - 1.0)


@dataclass(frozen=True)
class Display:
    """A panel, an array, and the gap between the panel's emitting plane and the array's near face (mm)."""

    name: str
    panel: Panel
    array: Array
    gap_mm: float

    @property
    def aperture_distance_mm(self) -> float:
        """Distance D from the panel to the aperture plane that rays aim at, mm."""
        if self.array.plano_side == "panel":
            return self.gap_mm + self.array.thickness_mm / self.array.index
        return max(self.gap_mm, self.array.sag_mm)

    @cached_property
    def identity(self) -> str:
        """Hash of the optical part, 16 hexadecimal digits; images carry it to name the display that they fit."""
        array = dataclasses.asdict(self.array)
        panel = {key: value for key, value in dataclasses.asdict(self.panel).items() if key not in ("bits", "transfer")}
        if self.array.glass is not None:
            # It follows from the glass: at another wavelength this is the same display.
            del array["index"]
        optical = {"panel": panel, "array": array, "gap_mm": self.gap_mm}
        text = json.dumps(optical, sort_keys=True, default=list)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def at_wavelength(self, wavelength_nm: float) -> Display:
        """Return this display with the index that its glass has at a wavelength (nm).

        Raises
        ------
        InputError
            When the array has a plain index and no glass, or for a wavelength out of range.
        """
        if self.array.glass is None:
            raise InputError(
                f"display '{self.name}' has a plain index, which knows no dispersion; name array.glass instead"
            )
        return replace(self, array=replace(self.array, index=index_of(self.array.glass, wavelength_nm)))

    def misaligned(
        self,
        rotation_deg: float = 0.0,
        offset_mm: tuple[float, float] = (0.0, 0.0),
        gap_mm: float = 0.0,
        pitch_scale: float = 1.0,
    ) -> Display:
        """Return the display as built: the array turned, moved, lifted and stretched by the given errors.

        Raises
        ------
        InputError
            When nothing that can be built is left, such as a negative gap.
        """
        array = self.array
        moved = replace(
            array,
            rotation_deg=array.rotation_deg + rotation_deg,
            offset_mm=(array.offset_mm[0] + offset_mm[0], array.offset_mm[1] + offset_mm[1]),
            pitch_mm=array.pitch_mm * pitch_scale,
        )
        if pitch_scale > 1.0:
            # A thinnest lenslet that is stretched is still one: its substrate spans the deeper rims.
            _check_radius(moved, f"display '{self.name}', misaligned: array.radius_mm")
            moved = replace(moved, thickness_mm=max(moved.thickness_mm, moved.sag_mm))
        display = replace(self, array=moved, gap_mm=self.gap_mm + gap_mm)
        _check(display, f"display '{self.name}', misaligned: ")
        return display


def load_display(path: str | Path) -> Display:
    """Read a display file.

    Raises
    ------
    InputError
        Naming file, key and remedy, for whatever is missing, unknown, or cannot be built.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise input_error(str(path), "no such file", "give the path of a display file (.toml)") from None
    except (OSError, UnicodeDecodeError) as error:
        raise input_error(str(path), f"cannot be read ({error})", "give a display file (.toml)") from None
    return parse_display(text, str(path))


def parse_display(text: str, source: str = "display") -> Display:
    """Read a display from TOML text; `source` names it in errors (see `load_display`)."""
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # broken, overlong numbers, endless nests
        raise input_error(source, f"not TOML ({error})", "mend the syntax there") from None
    return read_display(Table(raw, source, ""), Path(source).stem)


def read_display(top: Table, name: str) -> Display:
    """Read a display from its TOML table; `name` is its name when the table gives none (see `load_display`)."""
    panel = _read_panel(top.table("panel"))
    array = _read_array(top.table("array"))
    display = Display(
        name=top.text("name", name),
        panel=panel,
        array=array,
        gap_mm=top.number("gap_mm", at_least=0.0, at_most=LENGTHS["at_most"]),
    )
    top.refuse_leftovers()
    _check(display, top.where(""))
    return display


def display_text(display: Display) -> str:
    """Return a display as the text of a display file, from which `parse_display` reads the same one."""
    panel, array = display.panel, display.array
    tables = {"": {"name": display.name, "gap_mm": display.gap_mm}}
    tables["panel"] = dataclasses.asdict(panel)
    tables["array"] = dataclasses.asdict(array)
    del tables["array"]["glass" if array.glass is None else "index"]
    # Numbers, text and lists are written alike in JSON and TOML.
    return "\n".join(
        (f"[{name}]\n" if name else "") + "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())
        for name, table in tables.items()
    )


def _read_panel(table: Table) -> Panel:
    pitch = table.one_of("pixel_pitch_mm", "dpi")
    panel = Panel(
        width_px=table.integer("width_px", 1, MAX_SIDE_PX),
        height_px=table.integer("height_px", 1, MAX_SIDE_PX),
        pixel_pitch_mm=(
            table.number(pitch, above=0.0, **LENGTHS)
            if pitch == "pixel_pitch_mm"
            else MM_PER_INCH / table.number(pitch, above=0.0, **LENGTHS)
        ),
        subpixels=cast(Subpixels, table.choice("subpixels", get_args(Subpixels), "none")),
        bits=table.integer("bits", 1, 16, default=8),
        transfer=cast(Transfer, table.choice("transfer", get_args(Transfer), "srgb")),
    )
    table.refuse_leftovers()
    return panel


def _read_array(table: Table) -> Array:
    grid = cast(Grid, table.choice("grid", get_args(Grid)))
    pitch_mm = table.number("pitch_mm", above=0.0, **LENGTHS)
    glass: str | None = None
    if table.one_of("index", "glass") == "glass":
        glass = table.text("glass")
        try:
            index = index_of(glass, DESIGN_WAVELENGTH_NM)
        except InputError as error:
            raise InputError(f"{table.where('glass')}: {error}") from None
    else:
        index = table.number("index", above=INDEX_RANGE[0], at_most=INDEX_RANGE[1])
    if table.one_of("focal_length_mm", "radius_mm") == "radius_mm":
        radius_mm = table.number("radius_mm", above=0.0, **LENGTHS)
    else:
        radius_mm = table.number("focal_length_mm", above=0.0, **LENGTHS) * (index - 1.0)
    array = Array(
        grid=grid,
        pitch_mm=pitch_mm,
        radius_mm=radius_mm,
        index=index,
        thickness_mm=math.nan,
        plano_side=cast(PlanoSide, table.choice("plano_side", get_args(PlanoSide), "panel")),
        glass=glass,
        rotation_deg=table.number("rotation_deg", default=0.0),
        offset_mm=table.pair("offset_mm", (0.0, 0.0)),
    )
    _check_radius(array, table.where("radius_mm"))
    thickness_mm = table.number("thickness_mm", default=array.sag_mm, above=0.0, **LENGTHS)
    table.refuse_leftovers()
    return replace(array, thickness_mm=thickness_mm)


def _check_radius(array: Array, where: str) -> None:
    if not array.radius_mm >= array.half_diagonal_mm:
        raise input_error(
            where,
            f"radius {array.radius_mm:g} mm is too small to span its cell "
            f"(half diagonal {array.half_diagonal_mm:g} mm)",
            "give a larger radius_mm or focal_length_mm, or a smaller pitch_mm",
        )


def _check(display: Display, where: str) -> None:
    """Refuse what cannot be built; single keys were checked when they were read. `where` goes before a key's name."""
    array = display.array
    _check_radius(array, f"{where}array.radius_mm")
    # A thickness typed as the sag with 15 digits may round to a hair less.
    if array.thickness_mm < array.sag_mm * (1.0 - 1e-12):
        raise input_error(
            f"{where}array.thickness_mm",
            f"{array.thickness_mm:g} mm is below the sag of the dome, {array.sag_mm:.6g} mm",
            "make it at least the sag, or leave it out for the thinnest lenslet",
        )
    if not display.gap_mm >= 0.0:
        raise input_error(f"{where}gap_mm", f"{display.gap_mm:g} mm is negative", "make it 0 or more")
    if array.pitch_mm < display.panel.pixel_pitch_mm:
        raise input_error(
            f"{where}array.pitch_mm",
            f"{array.pitch_mm:g} mm is finer than the panel's pixels ({display.panel.pixel_pitch_mm:.6g} mm)",
            "give lenslets of at least a pixel",
        )
