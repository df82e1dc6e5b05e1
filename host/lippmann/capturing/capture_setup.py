"""Reads a set-up file (docs/reference/setup-file.md) of object, lens, array and camera.

All parts of a set-up are on one axis. Image distances start at the lens's image-side
principal plane, object distances at the object-side principal plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.capturing.imaging_lens import Convex, ImagingLens, LensPair, ThinLens
from lippmann.display.description import (
    MAX_SIDE_PX,
    Array,
    Display,
    DisplayFile,
    Gap,
    Glass,
    Index,
    Length,
    check_array,
    check_radius,
    display_of,
    index_of_keys,
    load_display,
)
from lippmann.errors import input_error, path_of, whole_number
from lippmann.optics.rays import Floats
from lippmann.scenes.placement import ORIGIN, Placement, Scale, Triple

#: Minimum pixels per lenslet in a camera's picture.
MIN_ELEMENTAL_PX = 2.0


@documented
@dataclass(frozen=True)
class Subject:
    """Placement of the scene. The object's frame is centred on the object: x right, y up, +z to the lens."""

    distance_mm: Annotated[Length, key("object's centre from the lens, or from the array without a lens")]
    scale: Annotated[Scale, key("factor of the size, about the object's centre")] = 1.0
    rotation_deg: Annotated[Triple, key("rotation about x, then y, then z")] = ORIGIN
    offset_mm: Annotated[Triple, key("shift of the scene; +z is towards the lens")] = ORIGIN

    @property
    def placement(self) -> Placement:
        """Transform of the scene to the object's frame."""
        return Placement(self.scale, self.rotation_deg, self.offset_mm)


@documented
@dataclass(frozen=True)
class Camera:
    """A pinhole on the axis, which sees the panel's area in the array's first principal plane."""

    distance_mm: Annotated[Length, key("pinhole from the lens, or from the array's vertices without a lens")]


@documented
@dataclass(frozen=True)
class Pickup:
    """A sensor behind the array, with the size and position of the panel."""

    gap_mm: Annotated[Gap, key("gap between the array and the sensor, as in a display file")]


@documented
@dataclass(frozen=True)
class Setup:
    """A capture through the lenslets of `array`, which may differ from the display array."""

    name: Annotated[str, key("name in reports")]
    subject: Annotated[Subject, key("placement of the scene")]
    lens: Annotated[ImagingLens | None, key("imaging lens; None if the scene is before the array")]
    display: Annotated[Display, key("display of the image; its pixels and lattice are those of the capture")]
    array: Annotated[Array, key("captured lenslets; `thickness_mm` of concave lenslets is at the middle")]
    concave: Annotated[bool, key("plano-concave lenslets, with the concave side to the lens")]
    position_mm: Annotated[float, key("array's vertices from the object's image, towards the camera; 0 without a lens")]
    pickup: Annotated[Camera | Pickup, key("pinhole camera, or sensor behind the array")]

    def image_distance(self, z_mm: npt.ArrayLike) -> Floats:
        """Return the image distances s' = f s / (s - f), mm, of points at depths z (mm, object's frame)."""
        # Without a lens an object is its own image, in front of the array.
        s = self.subject.distance_mm - np.asarray(z_mm, np.float64)
        if self.lens is None:
            return -s
        with np.errstate(divide="ignore"):
            return np.asarray(s * self.lens.focal_length_mm / (s - self.lens.focal_length_mm))

    @property
    def image_distance_mm(self) -> float:
        """Distance from the lens to the image of the object's centre, mm."""
        return float(self.image_distance(0.0))

    @property
    def magnification(self) -> float:
        """Magnification m = -s' / s of the object's centre."""
        return -self.image_distance_mm / self.subject.distance_mm

    @property
    def array_distance_mm(self) -> float:
        """Distance from the lens to the array's vertices, mm; 0 without a lens."""
        return 0.0 if self.lens is None else self.image_distance_mm + self.position_mm

    @property
    def captured(self) -> Display:
        """The display with the set-up's array. With a camera, `gap_mm` has no effect."""
        behind = self.array.focal_length_mm + self.array.sag_mm
        gap = self.pickup.gap_mm if isinstance(self.pickup, Pickup) else behind
        return replace(self.display, array=self.array, gap_mm=gap)

    @property
    def camera_distance_mm(self) -> float | None:
        """Distance from the array's first principal plane to the pinhole, mm; None for a sensor."""
        if isinstance(self.pickup, Pickup):
            return None
        # If the camera sees the flat face, the substrate shifts the image of the vertices.
        lifted = self.array.thickness_mm * (1.0 - 1.0 / self.array.index) if self.plano_to_camera else 0.0
        return self.pickup.distance_mm - self.array_distance_mm - lifted

    @property
    def plano_to_camera(self) -> bool:
        """Whether the array's flat face is towards the camera."""
        return self.array.plano_side == "panel"

    def resized(self, width_px: int) -> Setup:
        """Return the set-up with `width_px` columns; raise InputError for too few columns."""
        panel = self.display.panel
        whole_number("size", width_px, 1, MAX_SIDE_PX)
        setup = replace(self, display=replace(self.display, panel=panel.with_columns(width_px)))
        check_elemental_images(setup, f"set-up '{self.name}'", "give a larger --size")
        return setup


def check_elemental_images(setup: Setup, where: str, remedy: str) -> None:
    """Raise InputError if a lenslet has fewer than `MIN_ELEMENTAL_PX` pixels."""
    pixels = setup.array.finest_mm / setup.display.panel.coarsest_mm
    if pixels < MIN_ELEMENTAL_PX:
        what = f"the picture has {pixels:.2f} pixels per lenslet; at least {MIN_ELEMENTAL_PX:g} are needed"
        raise input_error(where, what, remedy)


@dataclass(frozen=True, kw_only=True)
class LensKeys:
    """The keys of `[lens]` in a set-up file."""

    kind: Annotated[Literal["pair", "thin"], key("two equal thick plano-convex lenses, or one ideal thin lens")]
    image_distance_mm: Annotated[Length | None, key("distance s' of the image of the object: 1/f = 1/s + 1/s'")] = None
    focal_length_mm: Annotated[Length | None, key("of the whole lens", instead_of="image_distance_mm")] = None
    radius_mm: Annotated[Length | None, key("`pair`: radius of the domes", instead_of="image_distance_mm")] = None
    index: Annotated[Index | None, key("`pair`: refractive index", default="required for `pair`")] = None
    glass: Glass | None = None
    thickness_mm: Annotated[Length | None, key("`pair`: centre thickness", default="required for `pair`")] = None
    separation_mm: Annotated[Gap | None, key("`pair`: air between the inner vertices", default="0")] = None
    aperture_mm: Annotated[Length, key("diameter; rays outside it are lost (vignetting)")]
    convex: Annotated[Convex | None, key("`pair`: side of the domes; in: facing each other", default='`"in"`')] = None


PAIR_ONLY = ("radius_mm", "index", "glass", "thickness_mm", "separation_mm", "convex")
Position = Annotated[float | None, key("", default="required with a lens")]
Focal = Annotated[float | None, key("", default="the display's")]
Thickness = Annotated[float, key("", above=0.0, default="the display's, or the sag")] | None


@dataclass(frozen=True, kw_only=True)
class ArrayKeys:
    """The keys of `[array]` in a set-up file."""

    position_mm: Annotated[Position, key("vertices, from the object's image; positive towards the camera")] = None
    focal_length_mm: Annotated[Focal, key("of the captured lenslets, if different; negative: plano-concave")] = None
    thickness_mm: Annotated[Thickness, key("from vertex to flat face; concave: in the middle")] = None


@dataclass(frozen=True, kw_only=True)
class SetupFile:
    """The keys of a set-up file."""

    name: Annotated[str | None, key("name of the set-up in reports", default="the file's name")] = None
    display: Annotated[str | DisplayFile, key("display file, its path relative to the set-up file; or its tables")]
    object: Subject
    lens: LensKeys | None = None
    array: ArrayKeys = ArrayKeys()
    camera: Camera | None = None
    pickup: Annotated[Pickup | None, key("", instead_of="camera")] = None


def load_setup(path: str | Path) -> Setup:
    """Read a set-up file; raise InputError with file, key and remedy."""
    path = path_of(path, "a set-up file")
    keys = toml.read(SetupFile, toml.load(path, "set-up"), str(path))
    where, subject = f"{path}: ", keys.object
    lens = None if keys.lens is None else _make_lens(keys.lens, subject.distance_mm, f"{where}lens.")
    if isinstance(keys.display, str):
        display = load_display(path.parent / keys.display)
    else:
        display = display_of(keys.display, path.stem, f"{where}display.")
    position_mm = keys.array.position_mm
    if (position_mm is None) != (lens is None):
        fault = ("needs a lens", "remove the key, or add [lens]") if lens is None else ("the key is missing", "add it")
        raise input_error(f"{where}array.position_mm", *fault)
    array, concave = _captured_array(keys.array, display.array, f"{where}array.")
    pickup = keys.camera or keys.pickup
    assert pickup is not None
    name = path.stem if keys.name is None else keys.name
    setup = Setup(name, subject, lens, display, array, concave, position_mm or 0.0, pickup)
    _check_setup(setup, str(path))
    return setup


def _make_lens(keys: LensKeys, object_mm: float, where: str) -> ImagingLens:
    image_mm, focal = keys.image_distance_mm, keys.focal_length_mm
    if image_mm is not None:
        focal = object_mm * image_mm / (object_mm + image_mm)
    if keys.kind == "thin":
        for name in PAIR_ONLY:
            if getattr(keys, name) is not None:
                raise input_error(f"{where}{name}", "a thin lens has no such key", 'remove it, or set kind = "pair"')
        assert focal is not None
        return ThinLens(focal, keys.aperture_mm)
    if keys.index is None and keys.glass is None:
        raise input_error(f"{where}index or glass", "both keys are missing", "give exactly one of them")
    if keys.thickness_mm is None:
        raise input_error(f"{where}thickness_mm", "the key is missing", "add it")
    sizes = (keys.thickness_mm, keys.separation_mm or 0.0, keys.aperture_mm, keys.convex or "in")
    pair = LensPair(keys.radius_mm or math.inf, index_of_keys(keys, where), *sizes)
    if focal is not None:
        try:
            pair = pair.with_focal_length(focal)
        except ValueError:
            name = "focal_length_mm" if image_mm is None else "image_distance_mm"
            what = f"a focal length of {focal:g} mm is too short for this thickness and separation"
            raise input_error(f"{where}{name}", what, "give a smaller thickness_mm or separation_mm") from None
    if not 0.5 * pair.aperture_mm < pair.radius_mm:
        what = f"{pair.aperture_mm:g} mm is wider than a lens with radius of curvature {pair.radius_mm:.5g} mm"
        remedy = f"give a smaller aperture, or a {'larger radius' if focal is None else 'higher index'}"
        raise input_error(f"{where}aperture_mm", what, remedy)
    if pair.thickness_mm < pair.sag_mm:
        what = f"{pair.thickness_mm:g} mm is less than the sag over the aperture, {pair.sag_mm:.5g} mm"
        raise input_error(f"{where}thickness_mm", what, "give a larger thickness, or a smaller aperture")
    return pair


def _captured_array(keys: ArrayKeys, display_array: Array, where: str) -> tuple[Array, bool]:
    array, focal, concave = display_array, keys.focal_length_mm, False
    if focal is not None:
        if focal == 0.0:
            raise input_error(f"{where}focal_length_mm", "the focal length is 0", "give it in mm, negative if concave")
        concave = focal < 0.0
        array = replace(display_array, radius_mm=abs(focal) * (display_array.index - 1.0))
        check_radius(array, f"{where}focal_length_mm")
        array = replace(array, thickness_mm=array.sag_mm)
    if keys.thickness_mm is not None:
        array = replace(array, thickness_mm=keys.thickness_mm)
    if not concave:
        check_array(array, where)
    elif array.plano_side != "panel":
        what = "concave lenslets must have their plano side towards the camera"
        raise input_error(f"{where}focal_length_mm", what, 'give a display whose plano_side is "panel"')
    return array, concave


def _check_setup(setup: Setup, source: str) -> None:
    check_elemental_images(setup, source, "give a display with smaller pixels or larger lenslets")
    if setup.display.panel.subpixels != "none":
        what = f"display '{setup.display.name}' has colour sub-pixels, but a camera's picture has none"
        raise input_error(source, what, "give a display without sub-pixels")
    lens, stand = setup.lens, f"{setup.array_distance_mm:.4g} mm behind the lens"
    if lens is not None:
        distance = setup.subject.distance_mm
        if not distance > lens.focal_length_mm:
            what = f"{distance:g} mm is within the focal length {lens.focal_length_mm:g} mm: there is no real image"
            raise input_error(f"{source}: object.distance_mm", what, "move the object away")
        # The array with its substrate must be behind the lens's last face.
        behind_mm = setup.array_distance_mm + lens.extent_mm[0]
        if not behind_mm > (0.0 if setup.plano_to_camera else setup.array.thickness_mm):
            what = f"{setup.position_mm:g} mm puts the array {stand}'s principal plane, but before the lens's last face"
            raise input_error(
                f"{source}: array.position_mm", f"{what}: outside the image space", "give a larger position_mm"
            )
    to_camera = setup.camera_distance_mm
    depth = setup.array.thickness_mm if setup.plano_to_camera else setup.array.sag_mm
    if to_camera is not None and not to_camera > depth:
        key, what = "camera.distance_mm", "the camera is inside the array"
        if lens is not None:
            key = "array.position_mm"
            what = f"the array is {stand}, which is not before the camera: outside the image space"
        raise input_error(f"{source}: {key}", what, "move the camera or the array")
