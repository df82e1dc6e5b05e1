"""The set-up file: where object, imaging lens, microlens array and camera stand, in TOML.

The keys are documented in docs/reference/setup-file.md. All stand on one axis. Image distances are counted from the
lens's image-side principal plane, object distances from its object-side one: for an ideal lens, from its centre.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast, get_args

from lippmann.capturing.imaging_lens import Convex, ImagingLens, LensPair, ThinLens
from lippmann.display import INDEX_RANGE, LENGTHS, MAX_SIDE_PX, Array, Display, load_display, read_display
from lippmann.errors import InputError, input_error
from lippmann.glass import DESIGN_WAVELENGTH_NM, index_of
from lippmann.rendering.placement import SCALE_RANGE, Placement
from lippmann.toml import Table

#: Pixels that a camera must see of a lenslet.
MIN_ELEMENTAL_PX = 2.0


@dataclass(frozen=True)
class Subject:
    """Where the scene stands.

    Attributes
    ----------
    distance_mm
        From the lens, or from the array where there is no lens, to the object's centre: the origin of the object's
        frame, x right, y up, +z towards the lens.
    placement
        From the scene as it stands before a display (its own placement file) to the object's frame.
    """

    distance_mm: float
    placement: Placement


@dataclass(frozen=True)
class Camera:
    """A pinhole on the axis that sees the array's first principal plane, its picture being the display's panel there.

    `distance_mm` is counted from the lens, or from the array's vertices where there is no lens.
    """

    distance_mm: float


@dataclass(frozen=True)
class Pickup:
    """A sensor behind the array, the display's panel in place and size; `gap_mm` is the gap of a display file."""

    gap_mm: float


@dataclass(frozen=True)
class Setup:
    """A capture.

    Attributes
    ----------
    name
        What reports call it.
    subject
        The scene's stand.
    lens
        The imaging lens; None for an array that looks at the scene itself.
    display
        What shows the picture: its panel gives the picture's pixels, its lattice is the captured array's.
    array
        The lenslets that are captured through; the display's own unless the file says otherwise.
    concave
        Whether those lenslets are plano-concave: their sphere's centre on the lens's side. `array.thickness_mm` is then
        that of their middle.
    position_mm
        The array's vertices from the image of the object's centre, positive towards the camera; 0 without a lens.
    pickup
        What takes the picture: a pinhole camera, or a sensor behind the array.
    """

    name: str
    subject: Subject
    lens: ImagingLens | None
    display: Display
    array: Array
    concave: bool
    position_mm: float
    pickup: Camera | Pickup

    @property
    def image_distance_mm(self) -> float:
        """From the lens to the image of the object's centre: s' = f s / (s - f), mm; -s without a lens.

        Without a lens the object is its own image, before the array where the image of a lens lies behind it.
        """
        s = self.subject.distance_mm
        return -s if self.lens is None else s * self.lens.focal_length_mm / (s - self.lens.focal_length_mm)

    @property
    def magnification(self) -> float:
        """Of the object's centre: m = -s' / s."""
        return -self.image_distance_mm / self.subject.distance_mm

    @property
    def array_distance_mm(self) -> float:
        """From the lens to the array's vertices, mm; 0 without a lens."""
        return 0.0 if self.lens is None else self.image_distance_mm + self.position_mm

    @property
    def captured(self) -> Display:
        """Panel and array as they stand while the picture is taken.

        A camera's panel stands anywhere behind the domes: its rays are known by the points that they aim at.
        """
        behind = self.array.focal_length_mm + self.array.sag_mm
        gap = self.pickup.gap_mm if isinstance(self.pickup, Pickup) else behind
        return replace(self.display, array=self.array, gap_mm=gap)

    @property
    def camera_distance_mm(self) -> float | None:
        """From the array's first principal plane to the camera's pinhole, mm; None for a pickup."""
        if isinstance(self.pickup, Pickup):
            return None
        # The vertices' plane, seen through the substrate where the flat face looks at the camera.
        lifted = self.array.thickness_mm * (1.0 - 1.0 / self.array.index) if self.plano_to_camera else 0.0
        return self.pickup.distance_mm - self.array_distance_mm - lifted

    @property
    def plano_to_camera(self) -> bool:
        """Whether the flat face looks at the camera."""
        return self.array.plano_side == "panel"

    def resized(self, width_px: int) -> Setup:
        """Return the set-up whose picture has another number of pixels across the same window.

        Raises
        ------
        InputError
            When that leaves the camera too few pixels for each lenslet.
        """
        panel = self.display.panel
        if not 1 <= width_px <= MAX_SIDE_PX:
            raise InputError(f"size {width_px} is out of range; give 1 to {MAX_SIDE_PX} pixels")
        height_px = max(1, round(width_px * panel.height_px / panel.width_px))
        pitch = panel.width_mm / width_px
        panel = replace(panel, width_px=width_px, height_px=height_px, pixel_pitch_mm=pitch)
        setup = replace(self, display=replace(self.display, panel=panel))
        check_elemental_images(setup, f"set-up '{self.name}'", "give a larger --size")
        return setup


def check_elemental_images(setup: Setup, where: str, remedy: str) -> None:
    """Refuse a picture that has too few pixels for each lenslet.

    Raises
    ------
    InputError
        Naming how many there are.
    """
    pixels = setup.array.pitch_mm / setup.display.panel.pixel_pitch_mm
    if pixels < MIN_ELEMENTAL_PX:
        raise input_error(
            where, f"the camera sees {pixels:.2f} pixels of a lenslet, fewer than {MIN_ELEMENTAL_PX:g}", remedy
        )


def load_setup(path: str | Path) -> Setup:
    """Read a set-up file.

    Raises
    ------
    InputError
        Naming file, key and remedy, for whatever is missing, unknown, or cannot be built.
    """
    path = Path(path)
    try:
        raw = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except FileNotFoundError:
        raise input_error(str(path), "no such file", "give the path of a set-up file (.toml)") from None
    except (OSError, ValueError, RecursionError) as error:  # unreadable, no text, broken TOML, endless nests
        raise input_error(str(path), f"cannot be read ({error})", "give a set-up file (.toml)") from None
    top = Table(raw, str(path), "")
    name = top.text("name", path.stem)
    subject = _read_subject(top.table("object"))
    lens_table = top.optional_table("lens")
    lens = None if lens_table is None else _read_lens(lens_table, subject.distance_mm)
    display = _read_display(top, raw.get("display"), path)
    array_table = top.optional_table("array") if lens is None else top.table("array")
    array, concave, position_mm = _read_array(array_table, display.array, lens is not None)
    pickup = _read_pickup(top)
    top.refuse_leftovers()
    setup = Setup(name, subject, lens, display, array, concave, position_mm, pickup)
    _check(setup, str(path))
    return setup


def _read_subject(table: Table) -> Subject:
    distance_mm = table.number("distance_mm", above=0.0, **LENGTHS)
    placement = Placement(
        scale=table.number("scale", default=1.0, at_least=SCALE_RANGE[0], at_most=SCALE_RANGE[1]),
        rotation_deg=table.triple("rotation_deg", (0.0, 0.0, 0.0)),
        offset_mm=table.triple("offset_mm", (0.0, 0.0, 0.0)),
    )
    table.refuse_leftovers()
    return Subject(distance_mm, placement)


def _read_lens(table: Table, object_mm: float) -> ImagingLens:
    """Read `[lens]`; `image_distance_mm` asks for the lens that images the object's centre there."""
    kind = table.choice("kind", ("pair", "thin"))
    keys = ("focal_length_mm", "image_distance_mm", *(("radius_mm",) if kind == "pair" else ()))
    given = table.one_of(*keys)
    size = table.number(given, above=0.0, **LENGTHS)
    focal = object_mm * size / (object_mm + size) if given == "image_distance_mm" else size
    aperture_mm = table.number("aperture_mm", above=0.0, **LENGTHS)
    lens: ImagingLens
    if kind == "thin":
        lens = ThinLens(focal, aperture_mm)
    else:
        if table.one_of("index", "glass") == "glass":
            glass = table.text("glass")
            try:
                index = index_of(glass, DESIGN_WAVELENGTH_NM)
            except InputError as error:
                raise InputError(f"{table.where('glass')}: {error}") from None
        else:
            index = table.number("index", above=INDEX_RANGE[0], at_most=INDEX_RANGE[1])
        thickness_mm = table.number("thickness_mm", above=0.0, **LENGTHS)
        separation_mm = table.number("separation_mm", default=0.0, at_least=0.0, at_most=LENGTHS["at_most"])
        convex = cast(Convex, table.choice("convex", get_args(Convex), "in"))
        if given == "radius_mm":
            pair = LensPair(size, index, thickness_mm, separation_mm, aperture_mm, convex)
        else:
            try:
                pair = LensPair.of_focal_length(focal, index, thickness_mm, separation_mm, aperture_mm, convex)
            except ValueError:
                raise input_error(
                    table.where(given),
                    f"no pair of such thick lenses, so far apart, has a focal length of {focal:g} mm",
                    "give a smaller thickness_mm or separation_mm",
                ) from None
        _check_pair(pair, table)
        lens = pair
    table.refuse_leftovers()
    return lens


def _check_pair(pair: LensPair, table: Table) -> None:
    if not 0.5 * pair.aperture_mm < pair.radius_mm:
        raise input_error(
            table.where("aperture_mm"),
            f"{pair.aperture_mm:g} mm is wider than domes of radius {pair.radius_mm:.5g} mm are",
            "give a smaller aperture, or a higher index",
        )
    if pair.thickness_mm < pair.sag_mm:
        raise input_error(
            table.where("thickness_mm"),
            f"{pair.thickness_mm:g} mm is below the sag of the domes over the aperture, {pair.sag_mm:.5g} mm",
            "make it at least the sag, or the aperture smaller",
        )


def _read_display(top: Table, value: Any, path: Path) -> Display:
    """Read `display`: a display file's path, from the set-up file, or the table itself."""
    if isinstance(value, dict):
        return read_display(top.table("display"), path.stem)
    return load_display(path.parent / top.text("display"))


def _read_array(table: Table | None, shown: Array, with_lens: bool) -> tuple[Array, bool, float]:
    """Read `[array]` over the display's array; returns it, whether it is concave, and its position."""
    if table is None:
        return shown, False, 0.0
    position_mm = table.number("position_mm") if with_lens else 0.0
    focal = table.optional_number("focal_length_mm")
    thickness = table.optional_number("thickness_mm", above=0.0)
    array, concave = shown, False
    if focal is not None:
        if focal == 0.0:
            raise input_error(table.where("focal_length_mm"), "0 is no focal length", "give mm, negative for concave")
        concave = focal < 0.0
        array = replace(shown, radius_mm=abs(focal) * (shown.index - 1.0))
        if array.radius_mm < array.half_diagonal_mm:
            raise input_error(
                table.where("focal_length_mm"),
                f"a radius of {array.radius_mm:g} mm is too small to span a cell of half diagonal "
                f"{array.half_diagonal_mm:g} mm",
                "give a longer focal length",
            )
        array = replace(array, thickness_mm=array.sag_mm)
    if thickness is not None:
        array = replace(array, thickness_mm=thickness)
    if not concave and array.thickness_mm < array.sag_mm * (1.0 - 1e-12):
        raise input_error(
            table.where("thickness_mm"),
            f"{array.thickness_mm:g} mm is below the sag of the dome, {array.sag_mm:.6g} mm",
            "make it at least the sag",
        )
    if concave and array.plano_side != "panel":
        raise input_error(
            table.where("focal_length_mm"),
            "concave lenslets are traced with their plano side to the camera only",
            'give a display whose plano_side is "panel"',
        )
    table.refuse_leftovers()
    return array, concave, position_mm


def _read_pickup(top: Table) -> Camera | Pickup:
    kind = top.one_of("camera", "pickup")
    table = top.table(kind)
    taken: Camera | Pickup
    if kind == "camera":
        taken = Camera(table.number("distance_mm", above=0.0, **LENGTHS))
    else:
        taken = Pickup(table.number("gap_mm", at_least=0.0, at_most=LENGTHS["at_most"]))
    table.refuse_leftovers()
    return taken


def _check(setup: Setup, source: str) -> None:
    """Refuse what stands in the wrong order on the axis; single tables were checked when they were read."""
    check_elemental_images(setup, source, "give a display of finer pixels or larger lenslets")
    if setup.display.panel.subpixels != "none":
        raise input_error(
            source, f"display '{setup.display.name}' has colour stripes, a camera none", "give one without"
        )
    if setup.lens is not None:
        if not setup.subject.distance_mm > setup.lens.focal_length_mm:
            raise input_error(
                f"{source}: object.distance_mm",
                f"{setup.subject.distance_mm:g} mm is within the focal length {setup.lens.focal_length_mm:g} mm: "
                "no real image",
                "move the object away",
            )
        # The array, its substrate too, must stand behind the lens's last face, towards the camera.
        behind_mm = setup.array_distance_mm + setup.lens.extent_mm[0]
        if not behind_mm > (0.0 if setup.plano_to_camera else setup.array.thickness_mm):
            raise input_error(
                f"{source}: array.position_mm",
                f"{setup.position_mm:g} mm puts the array {setup.array_distance_mm:.4g} mm behind the lens's principal "
                "plane, not behind its last face: outside the image space",
                "give a larger position_mm",
            )
    to_camera = setup.camera_distance_mm
    depth = setup.array.thickness_mm if setup.plano_to_camera else setup.array.sag_mm
    if to_camera is not None and not to_camera > depth:
        raise input_error(
            f"{source}: array.position_mm" if setup.lens is not None else f"{source}: camera.distance_mm",
            f"the array stands {setup.array_distance_mm:.4g} mm behind the lens, not before the camera: outside the "
            "image space"
            if setup.lens is not None
            else "the camera stands within the array",
            "move one of them",
        )
