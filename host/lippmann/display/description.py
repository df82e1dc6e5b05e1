"""Describe a display: a panel behind a microlens array (docs/reference/display-file.md, optics.md)."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from lippmann.base import toml
from lippmann.base.toml import Checked, documented, key, variant
from lippmann.base.tones import MAX_PAIRS, Curve, curve_of
from lippmann.display.glass import SELLMEIER, index_of
from lippmann.display.subpixels import Subpixel, layout_of
from lippmann.errors import InputError, check_type, input_error, located, path_of

Grid = Literal["square", "hex"]
PlanoSide = Literal["panel", "viewer"]
SubpixelsName = Literal["none", "rgb", "bgr", "rgbw", "pentile"]
TransferName = Literal["srgb", "linear", "gamma2.2"]

Pair = tuple[float, float]
#: Coordinates x, y and z.
Point3 = tuple[float, float, float]
#: A pitch: one number, or the pitches in x and y.
Pitch = float | tuple[float, ...]

MM_PER_INCH = 25.4
#: Minimum viewing distance, divided by the longer of focal length and distance D.
NEAREST_EYE = 4.0
#: Maximum ratio of an array's two pitches; a higher ratio gives slits, not lenslets.
MAX_PITCH_RATIO = 4.0
#: Maximum extent of an array divided by the panel's diagonal.
MAX_EXTENT = 100.0
#: Keys of a panel that do not affect the rays.
TONES = ("bits", "transfer", "white_cd_m2", "black_cd_m2")
#: Maximum width or height of a panel, px; image files and 16-bit indices limit it.
MAX_SIDE_PX = 65535
#: Range of lengths in a file, mm, whose squares and quotients do not overflow.
MIN_LENGTH_MM, MAX_LENGTH_MM = 1e-9, 1e12
Length = Annotated[float, key("", low=MIN_LENGTH_MM, high=MAX_LENGTH_MM)]
Gap = Annotated[float, key("", low=0.0, high=MAX_LENGTH_MM)]
#: Not tuple[Length, Length], because msgspec refuses its union with a bounded number.
LengthPair = Annotated[tuple[Length, ...], key("", shape="[x, y], numbers more than 0", lengths=(2, 2))]
Shear = Annotated[float, key("shift of the rows along x, as a fraction of their height", low=-1.0, high=1.0)]
_EXTENT = "width along the rows and height across them of the area with lenslets, about `offset_mm`"
Extent = Annotated[LengthPair | None, key(_EXTENT, default="none: lenslets everywhere")]
Side = Annotated[int, key("number of pixels", low=1, high=MAX_SIDE_PX)]
_AXIS = "point of the panel that this eye is in front of, from the centre"
_CONVERGES = "distance from the array to the eye that sees each pixel through the pixel's own lenslet"
MeasuredCurve = Annotated[Curve, key("", shape="a list of [panel value, light]", lengths=(2, MAX_PAIRS))]
Subpixels = Annotated[tuple[Subpixel, ...], key("", shape="a list of [colour, x, y, width, height]", lengths=(1, 1024))]
Luminance = Annotated[float, key("", above=0.0, high=MAX_LENGTH_MM)] | None
Darkness = Annotated[float, key("", low=0.0, high=MAX_LENGTH_MM)] | None
#: Refractive index, from that of air to that of the densest optical materials.
Index = Annotated[float, key("refractive index, the same for all colours", above=1.0, high=4.0)]
Glass = Annotated[str, key(f"glass that gives the index: {', '.join(SELLMEIER)}", instead_of="index")]


@documented
@dataclass(frozen=True)
class Panel(Checked):
    """The panel that emits the light."""

    width_px: Side
    height_px: Side
    pixel_pitch_mm: Annotated[Length | LengthPair, key("pixel pitch; [x, y] where the pixels are not square")]
    subpixels: Annotated[
        SubpixelsName | Subpixels, key("where in a pixel each colour is: stripes from left to right, or a layout")
    ] = "none"
    bits: Annotated[int, key("bits of each colour, for PNG files and boards", low=1, high=16)] = 8
    transfer: Annotated[
        TransferName | MeasuredCurve, key("curve between panel value and light, for PNG files and boards")
    ] = "srgb"

    white_cd_m2: Annotated[Luminance, key("luminance of white", default="unknown")] = None
    black_cd_m2: Annotated[Darkness, key("luminance of a black pixel", default="0")] = None

    @property
    def keys(self) -> dict[str, object]:
        """The panel's keys and values in a display file, except None values."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value is not None}

    @property
    def black(self) -> float:
        """Light of a black pixel, as a fraction of a white pixel's light."""
        return (self.black_cd_m2 or 0.0) / (self.white_cd_m2 or 1.0)

    @property
    def pitches_mm(self) -> Pair:
        """Pixel pitches in x and y, mm."""
        return both_pitches(self.pixel_pitch_mm)

    @property
    def size_px(self) -> tuple[int, int]:
        """Numbers of columns and of rows."""
        return self.width_px, self.height_px

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the array of a picture: rows, columns and 3 colours."""
        return self.height_px, self.width_px, 3

    @property
    def coarsest_mm(self) -> float:
        """The larger pixel pitch, mm; it limits depth range and resolution."""
        return max(self.pitches_mm)

    @property
    def width_mm(self) -> float:
        """Width of the emitting area, mm."""
        return self.width_px * self.pitches_mm[0]

    @property
    def height_mm(self) -> float:
        """Height of the emitting area, mm."""
        return self.height_px * self.pitches_mm[1]

    def with_columns(self, width_px: int) -> Panel:
        """Return a panel of equal size in mm with `width_px` columns and a proportional number of rows."""
        height_px = max(1, round(width_px * self.height_px / self.width_px))
        x, y = (self.width_px * side / width_px for side in self.pitches_mm)
        pitch = (x, y) if isinstance(self.pixel_pitch_mm, tuple) else x
        return replace(self, width_px=width_px, height_px=height_px, pixel_pitch_mm=pitch)


@documented
@dataclass(frozen=True)
class Array(Checked):
    """The microlens array: identical plano-convex lenslets on a square or hexagonal lattice."""

    grid: Annotated[Grid, key("lattice of the lenslets; hexagonal rows run along x")]
    pitch_mm: Annotated[
        Length | LengthPair,
        key(
            "lenslet pitch, at least a pixel; hexagonal: across the flats; "
            "[x, y] where they differ, hexagonal rows are 0.866 y apart"
        ),
    ]
    radius_mm: Annotated[Length, key("radius of the dome (the curved face); at least the cell's half diagonal")]
    index: Index
    thickness_mm: Annotated[Length, key("from the dome's vertex to the flat face, at least the sag", default="the sag")]
    plano_side: Annotated[PlanoSide, key("side of the flat face")] = "panel"
    glass: Glass | None = None
    rotation_deg: Annotated[float, key("rotation of the lattice, counter-clockwise for the viewer")] = 0.0
    offset_mm: Annotated[Pair, key("position of a lenslet's centre, from the panel's centre")] = (0.0, 0.0)

    shear: Shear = 0.0
    extent_mm: Extent = None

    @property
    def keys(self) -> dict[str, object]:
        """The array's keys and values in a display file; a default `shear` or `extent_mm` is omitted."""
        defaults = {"shear": 0.0, "extent_mm": None}
        fields = dataclasses.asdict(self).items()
        return {name: value for name, value in fields if name not in defaults or value != defaults[name]}

    @property
    def pitches_mm(self) -> Pair:
        """Lenslet pitches, mm: px along a row, and py, which determines the row distance."""
        return both_pitches(self.pitch_mm)

    @property
    def finest_mm(self) -> float:
        """The smaller of the two lenslet pitches, mm."""
        return min(self.pitches_mm)

    @property
    def coarsest_mm(self) -> float:
        """The larger of the two lenslet pitches, mm."""
        return max(self.pitches_mm)

    def pitch_of(self, along_mm: float) -> Pitch:
        """Return `pitch_mm`, scaled so that the pitch along a row is `along_mm`."""
        pitch = self.pitch_mm
        return (along_mm, pitch[1] * (along_mm / pitch[0])) if isinstance(pitch, tuple) else along_mm

    @property
    def regular(self) -> bool:
        """Whether the lattice has a single pitch and no shear."""
        return self.shear == 0.0 and self.pitches_mm[0] == self.pitches_mm[1]

    @property
    def half_diagonal_mm(self) -> float:
        """Distance from the centre of a cell to its farthest corner, mm."""
        px, py = self.pitches_mm
        if self.regular:
            return px / (math.sqrt(2.0) if self.grid == "square" else math.sqrt(3.0))
        shear = abs(self.shear)
        if self.grid == "square":
            return 0.5 * math.hypot(px + shear * py, py)
        top = py / math.sqrt(3.0)
        return max(math.hypot(shear * top, top), 0.5 * math.hypot(px + shear * top, top))

    @property
    def row_pitch_mm(self) -> float:
        """Distance between neighbouring rows of lenslets, mm."""
        return self.pitches_mm[1] * (0.5 * math.sqrt(3.0) if self.grid == "hex" else 1.0)

    @property
    def half_steps(self) -> tuple[int, int] | None:
        """Maximum half steps from the array's centre to a lenslet; None if there is no extent.

        Lenslet (i, j) is 2 j half steps across the rows from the centre, and 2 i
        (hexagonal: 2 i + j) along them. Rounding excludes no lenslet at the extent's
        edge.
        """
        if self.extent_mm is None:
            return None
        width, height = self.extent_mm
        along, across = width / self.pitches_mm[0], height / self.row_pitch_mm
        return math.floor(along * (1.0 + 1e-12)), math.floor(across * (1.0 + 1e-12))

    @property
    def flat_distance_mm(self) -> float:
        """Distance d from the sphere's centre to the rim's plane, mm (paper, equations 3 and 4)."""
        # Factorize R^2 - rho^2, because the difference loses digits if R is near rho.
        rho = self.half_diagonal_mm
        return math.sqrt((self.radius_mm - rho) * (self.radius_mm + rho))

    @property
    def sag_mm(self) -> float:
        """Depth of the dome from its vertex to the cell's corners, mm."""
        # This formula for R - d avoids cancellation for a nearly flat dome.
        return self.half_diagonal_mm**2 / (self.radius_mm + self.flat_distance_mm)

    @property
    def focal_length_mm(self) -> float:
        """Focal length f = R / (n - 1), mm (paper, equation 2)."""
        return self.radius_mm / (self.index - 1.0)


@documented
@dataclass(frozen=True)
class Display(Checked):
    """A panel, an array, and the gap between the panel's emitting plane and the array's near face (mm)."""

    name: Annotated[str, key("name of the display in pictures and reports", default="the file's name")]
    panel: Panel
    array: Array
    gap_mm: Annotated[Gap, key("from the panel's emitting plane to the array's near face; 0 in contact")]
    viewing_distance_mm: Annotated[Length | None, key(_CONVERGES, default="none: the eye is far away")] = None
    viewing_axis_mm: Annotated[Pair, key(_AXIS)] = (0.0, 0.0)

    @property
    def convergence(self) -> float:
        """Ratio of aperture distance D to viewing distance E; 0 if there is no viewing distance.

        The pitch of elemental images is 1 + D / E times the lenslet pitch.
        """
        distance = self.viewing_distance_mm
        return 0.0 if distance is None else self.aperture_distance_mm / distance

    @property
    def nearest_eye_mm(self) -> float:
        """Minimum viewing distance, mm; a nearer eye is within the lenslets' focal zone."""
        return NEAREST_EYE * max(self.array.focal_length_mm, self.aperture_distance_mm)

    @property
    def aperture_distance_mm(self) -> float:
        """Distance D from the panel to the aperture plane, mm; rays aim at points in this plane."""
        if self.array.plano_side == "panel":
            return self.gap_mm + self.array.thickness_mm / self.array.index
        return max(self.gap_mm, self.array.sag_mm)

    @cached_property
    def identity(self) -> str:
        """Hash of the keys that affect rays, 16 hexadecimal digits; images store it."""
        array = self.array.keys
        panel = {key: value for key, value in self.panel.keys.items() if key not in TONES}
        if self.array.glass is not None:
            # Omit the index: the identity does not depend on the wavelength.
            del array["index"]
        optical: dict[str, object] = {"panel": panel, "array": array, "gap_mm": self.gap_mm}
        if self.viewing_distance_mm is not None:
            optical["viewing"] = (self.viewing_distance_mm, *self.viewing_axis_mm)
        text = json.dumps(optical, sort_keys=True, default=list)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def at_wavelength(self, wavelength_nm: float) -> Display:
        """Return the display with its index at a wavelength, nm.

        Raises InputError if there is no glass or the wavelength is out of range.
        """
        if self.array.glass is None:
            what = f"display '{self.name}' has an index without dispersion"
            raise InputError(f"{what}; give array.glass in place of array.index")
        return replace(self, array=replace(self.array, index=index_of(self.array.glass, wavelength_nm)))

    def misaligned(
        self,
        rotation_deg: float = 0.0,
        offset_mm: Pair = (0.0, 0.0),
        gap_mm: float = 0.0,
        pitch_scale: float = 1.0,
    ) -> Display:
        """Return the display with its array rotated, shifted, lifted and scaled.

        Raises InputError if the misaligned display is impossible.
        """
        errors = Misalignment(rotation_deg, offset_mm, gap_mm, pitch_scale)
        array, extent, where = self.array, self.array.extent_mm, f"display '{self.name}', misaligned: "
        (x, y), (dx, dy), scale = array.offset_mm, errors.offset_mm, errors.pitch_scale
        moved = replace(
            array,
            rotation_deg=array.rotation_deg + errors.rotation_deg,
            offset_mm=(x + dx, y + dy),
            pitch_mm=array.pitch_of(array.pitches_mm[0] * scale),
            extent_mm=None if extent is None else tuple(side * scale for side in extent),
        )
        if scale > 1.0:
            # Larger lenslets have deeper domes: raise the thickness to the sag.
            check_radius(moved, f"{where}array.radius_mm")
            moved = replace(moved, thickness_mm=max(moved.thickness_mm, moved.sag_mm))
        built_gap_mm = self.gap_mm + errors.gap_mm
        if built_gap_mm < 0.0:
            remedy = f"raise the gap error by {-built_gap_mm:g} mm"
            raise input_error(f"{where}gap_mm", f"{built_gap_mm:g} mm is negative", remedy)
        display = replace(self, array=moved, gap_mm=built_gap_mm)
        _check(display, where)
        return display


@dataclass(frozen=True)
class Misalignment(Checked):
    """Parameters of `Display.misaligned`; types and ranges are checked."""

    rotation_deg: float
    offset_mm: Pair
    gap_mm: float
    pitch_scale: Annotated[float, key("", above=0.0)]


def load_display(path: str | Path) -> Display:
    """Read a display file. Raises InputError for a wrong key or value."""
    return _read(toml.load(path_of(path, "a display file"), "display"), str(path))


def display_at(display: str | Path | Display) -> Display:
    """Return the display, read from its file if `display` is a path."""
    return display if isinstance(display, Display) else load_display(display)


def parse_display(text: str, source: str = "display") -> Display:
    """Read a display from TOML text; `source` names the text in messages. See `load_display`."""
    for name, value in (("text", text), ("source", source)):
        check_type(name, value, str, "text")
    return _read(toml.parse(text, source), source)


def _read(raw: Mapping[str, object], source: str) -> Display:
    return display_of(toml.read(DisplayFile, raw, source), Path(source).stem, f"{source}: ")


_Dpi = Annotated[Length, key("pixels per inch, 25.4 / `pixel_pitch_mm`", instead_of="pixel_pitch_mm")]
_Focal = Annotated[Length, key("focal length in air at 587.56 nm", instead_of="radius_mm")]
_PanelFile = variant(Panel, ("pixel_pitch_mm", "dpi"), dpi=_Dpi)
_ArrayFile = variant(Array, ("radius_mm", "index", "thickness_mm", "focal_length_mm"), focal_length_mm=_Focal)
#: A display file: the keys of `Display`, and alternative keys such as `dpi`.
DisplayFile = variant(Display, ("name",), panel=_PanelFile, array=_ArrayFile)


def display_of(keys: Any, name: str, where: str) -> Display:
    """Return the display for a file's keys; `name` is the default name.

    Messages begin with `where`.
    """
    panel, array = toml.values(keys.panel), toml.values(keys.array)
    dpi, focal_mm = panel.pop("dpi"), array.pop("focal_length_mm")
    if dpi is not None:
        panel["pixel_pitch_mm"] = MM_PER_INCH / dpi
    panel["pixel_pitch_mm"] = plain_pitch(panel["pixel_pitch_mm"])
    for part, check in (("transfer", curve_of), ("subpixels", layout_of)):
        with located(f"{where}panel.{part}"):
            check(panel[part])
    white, black = panel["white_cd_m2"], panel["black_cd_m2"]
    if black and not black < (white or 0.0):
        what = "needs white_cd_m2" if white is None else f"{black:g} is not below white_cd_m2, {white:g}"
        mend = "give both, in cd/m2, from the data sheet" + ("; are they exchanged?" if white is not None else "")
        raise input_error(f"{where}panel.black_cd_m2", what, mend)
    array["pitch_mm"] = plain_pitch(array["pitch_mm"])
    array["index"] = index_of_keys(keys.array, f"{where}array.")
    if focal_mm is not None:
        array["radius_mm"] = focal_mm * (array["index"] - 1.0)
    thinnest = array["thickness_mm"] is None
    lenslets = Array(**array | ({"thickness_mm": array["radius_mm"]} if thinnest else {}))
    if lenslets.coarsest_mm > MAX_PITCH_RATIO * lenslets.finest_mm:
        x, y = lenslets.pitches_mm
        what = f"[{x:g}, {y:g}] is not a lattice of lenslets: one pitch is over {MAX_PITCH_RATIO:g} times the other"
        mend = "give [px, py]: lenslets px mm apart along a row, rows py mm apart, hexagonal 0.866 py"
        raise input_error(f"{where}array.pitch_mm", what, mend)
    if thinnest:
        check_radius(lenslets, f"{where}array.radius_mm")
        lenslets = replace(lenslets, thickness_mm=max(lenslets.sag_mm, MIN_LENGTH_MM))
    title = keys.name if keys.name is not None else name
    if len(title.splitlines()) > 1 or title != title.strip("\r\n"):
        raise input_error(f"{where}name", "has a line break", "write the name on one line")
    display = Display(title, Panel(**panel), lenslets, keys.gap_mm, keys.viewing_distance_mm, keys.viewing_axis_mm)
    _check(display, where)
    return display


def both_pitches(pitch_mm: Pitch) -> Pair:
    """Return the pitches in x and y for the value of a pitch key."""
    return (pitch_mm[0], pitch_mm[1]) if isinstance(pitch_mm, tuple) else (pitch_mm, pitch_mm)


def plain_pitch(pitch_mm: Pitch) -> Pitch:
    """Replace two equal pitches by one number, so that both forms have the same identity."""
    return pitch_mm[0] if isinstance(pitch_mm, tuple) and len(set(pitch_mm)) == 1 else pitch_mm


def index_of_keys(keys: Any, where: str) -> float:
    """Return `keys.index`, or the index of `keys.glass` at the design wavelength."""
    if keys.glass is None:
        return float(keys.index)
    with located(f"{where}glass"):
        return index_of(keys.glass)


def display_text(display: Display) -> str:
    """Return a display as file text: the inverse of `parse_display`."""
    top: dict[str, object] = {"name": display.name, "gap_mm": display.gap_mm}
    if display.viewing_distance_mm is not None:
        top |= {"viewing_distance_mm": display.viewing_distance_mm, "viewing_axis_mm": display.viewing_axis_mm}
    array = display.array.keys
    del array["glass" if display.array.glass is None else "index"]
    return toml.toml_text({**top, "panel": display.panel.keys, "array": array})


def check_radius(array: Array, where: str) -> None:
    """Refuse a dome that does not cover its cell; `where` is the key in the message."""
    rho = array.half_diagonal_mm
    if not array.radius_mm >= rho:
        what = f"radius {array.radius_mm:g} mm is too small to span its cell, whose half diagonal is {rho:g} mm"
        raise input_error(where, what, "give a larger radius_mm or focal_length_mm, or a smaller pitch_mm")


def _check(display: Display, where: str) -> None:
    array, pixel_mm = display.array, display.panel.coarsest_mm
    check_array(array, f"{where}array.")
    if array.finest_mm < 0.1 * pixel_mm and 0.001 * pixel_mm <= array.finest_mm:
        what = f"{pixel_mm:g} mm is coarser than a lenslet ({array.finest_mm:g} mm)"
        mend = f"give {0.001 * pixel_mm:g}, if {pixel_mm:g} micrometres are meant"
        raise input_error(f"{where}panel.pixel_pitch_mm", what, mend)
    if array.finest_mm < pixel_mm:
        what = f"{array.finest_mm:g} mm is finer than the panel's pixels ({pixel_mm:.6g} mm)"
        raise input_error(f"{where}array.pitch_mm", what, "give a pitch_mm of at least one pixel pitch")
    if array.extent_mm is not None:
        _check_extent(display, f"{where}array.extent_mm")
    if display.viewing_distance_mm is None:
        if display.viewing_axis_mm != (0.0, 0.0):
            what = "has no effect without viewing_distance_mm"
            raise input_error(f"{where}viewing_axis_mm", what, "add viewing_distance_mm, or remove viewing_axis_mm")
        return
    nearest = display.nearest_eye_mm
    if not display.viewing_distance_mm >= nearest:
        eye, gap = display.viewing_distance_mm, display.gap_mm
        inside = f"within the lenslets' focal zone, which ends at {nearest:.4g} mm"
        farther = f"a viewing_distance_mm such as {float(f'{1.01 * nearest:.3g}'):g}"
        in_focus = array.focal_length_mm - (display.aperture_distance_mm - gap)
        # Report the gap that focuses the panel, if the eye is then far enough.
        if 0.0 <= in_focus < gap and eye >= NEAREST_EYE * array.focal_length_mm:
            what = f"{gap:g} mm puts the eye at {eye:g} mm {inside}"
            raise input_error(f"{where}gap_mm", what, f"give a gap_mm of {in_focus:.4g} (in focus), or {farther}")
        if 0.1 <= eye <= 10.0 and 1000.0 * eye >= nearest:  # probably metres
            farther = f"{1000.0 * eye:g}, if {eye:g} m are meant, or {farther}"
        raise input_error(f"{where}viewing_distance_mm", f"{eye:g} mm is {inside}", f"give {farther}")


def _check_extent(display: Display, where: str) -> None:
    array, panel = display.array, display.panel
    width, height = array.extent_mm or (0.0, 0.0)
    size, column_mm, row_mm = f"{width:g} x {height:g} mm", array.pitches_mm[0], array.row_pitch_mm
    if width < column_mm or height < row_mm:
        what = f"{size} contains no lenslet of {column_mm:.4g} x {row_mm:.4g} mm"
        raise input_error(where, what, "give width and height of the area with lenslets, mm, or omit the key")
    if max(width, height) > MAX_EXTENT * math.hypot(panel.width_mm, panel.height_mm):
        what = f"{size} is over {MAX_EXTENT:g} times the panel, {panel.width_mm:.4g} x {panel.height_mm:.4g} mm"
        raise input_error(where, what, "give extent_mm in mm, or omit the key for lenslets everywhere")
    # Two parallelograms are disjoint if the normal of one of their sides separates them.
    turn = math.radians(array.rotation_deg)
    c, s = math.cos(turn), math.sin(turn)
    rows = (c, s)
    columns = (c * array.shear - s, s * array.shear + c)
    reach = array.half_diagonal_mm
    for ax, ay in ((1.0, 0.0), (0.0, 1.0), (-rows[1], rows[0]), (-columns[1], columns[0])):
        to_edge = 0.5 * (abs(ax) * panel.width_mm + abs(ay) * panel.height_mm)
        along, across = ax * rows[0] + ay * rows[1], ax * columns[0] + ay * columns[1]
        half = 0.5 * (abs(along) * width + abs(across) * height)
        if abs(ax * array.offset_mm[0] + ay * array.offset_mm[1]) > to_edge + half + reach * math.hypot(ax, ay):
            what = f"{size} at offset_mm {list(array.offset_mm)} leaves no lenslet in front of the panel"
            raise input_error(where, what, "bring array.offset_mm nearer to 0, or raise extent_mm")


def check_array(array: Array, where: str) -> None:
    """Refuse lenslets that cannot be built; `where` precedes the key in the message."""
    check_radius(array, f"{where}radius_mm")
    # The factor accepts a thickness equal to the sag rounded to 15 digits.
    if array.thickness_mm < array.sag_mm * (1.0 - 1e-12):
        what = f"{array.thickness_mm:g} mm is below the sag of the dome, {array.sag_mm:.6g} mm"
        remedy = "make it at least the sag, or leave it out for the thinnest lenslet"
        raise input_error(f"{where}thickness_mm", what, remedy)
