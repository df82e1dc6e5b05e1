"""What follows from a display file: the numbers that `lippmann inspect` prints, each with its formula."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lippmann.display import Display

#: Where eyes are taken to be, mm from the display.
VIEWING_DISTANCE_MM = 600.0
#: Beats between lenslets and pixels are seen as moire when they are longer than this many lenslets ...
MOIRE_FROM_LENSLETS = 4.0
#: ... and their contrast matters while an elemental image has fewer pixels than this.
MOIRE_BELOW_PIXELS = 60.0


@dataclass(frozen=True)
class DisplayProperties:
    """DisplayProperties numbers of a display.

    Attributes
    ----------
    radius_mm, sag_mm, flat_distance_mm, thickness_mm, focal_length_mm, f_number
        Of a lenslet (paper, equations 2 to 4); the f-number is f / pitch.
    back_focal_length_mm
        From the array's near face to the focus on the panel's side.
    lenslets
        (across, down, total): equation 5, rounded up to whole lenslets; a hexagonal array has closer rows.
    elemental_image_px
        Pixels across an elemental image: lenslet pitch over pixel pitch.
    viewing_angle_deg
        Full angle in which a lenslet shows its own elemental image: 2 atan(pitch / 2D).
    crosstalk_angle_deg
        Half of it: farther off a lenslet's axis its neighbour's elemental image is seen through it.
    viewing_zone_mm
        How far an eye at VIEWING_DISTANCE_MM may move off the axis and still see no crosstalk on the whole panel; 0
        where it cannot anywhere.
    central_depth_plane_mm
        z where the panel is imaged: 1/l = 1/f - 1/D; infinite when the panel is in focus.
    depth_range_mm
        (far, near): up to pitch D / pixel pitch from the display; there neighbouring pixels' rays are a lenslet apart.
    angular_resolution_deg
        Angle between neighbouring pixels' rays: pixel pitch / D.
    spatial_resolution_mm
        Lenslet pitch: a view has one pixel for each lenslet.
    views
        Directions across: whole pixels in an elemental image.
    warnings
        In words, with remedies.
    """

    radius_mm: float
    sag_mm: float
    flat_distance_mm: float
    thickness_mm: float
    focal_length_mm: float
    f_number: float
    index: float
    aperture_distance_mm: float
    back_focal_length_mm: float
    lenslets: tuple[int, int, int]
    elemental_image_px: float
    viewing_angle_deg: float
    crosstalk_angle_deg: float
    viewing_zone_mm: float
    central_depth_plane_mm: float
    depth_range_mm: tuple[float, float]
    angular_resolution_deg: float
    spatial_resolution_mm: float
    views: int
    warnings: tuple[str, ...]


def display_properties(display: Display) -> DisplayProperties:
    """Compute the derived numbers of a display."""
    panel, array = display.panel, display.array
    distance = display.aperture_distance_mm
    row_pitch = array.row_pitch_mm
    across = _whole_lenslets(panel.width_mm / array.pitch_mm)
    down = _whole_lenslets(panel.height_mm / row_pitch)
    half_field_deg = math.degrees(math.atan2(0.5 * array.pitch_mm, distance))
    vergence = 1.0 / array.focal_length_mm - 1.0 / distance
    # In focus to within what float arithmetic leaves: the image is at infinity.
    in_focus = abs(vergence) * distance < 1e-12
    reach = array.pitch_mm * distance / panel.pixel_pitch_mm
    return DisplayProperties(
        radius_mm=array.radius_mm,
        sag_mm=array.sag_mm,
        flat_distance_mm=array.flat_distance_mm,
        thickness_mm=array.thickness_mm,
        focal_length_mm=array.focal_length_mm,
        f_number=array.focal_length_mm / array.pitch_mm,
        index=array.index,
        aperture_distance_mm=distance,
        back_focal_length_mm=(
            array.focal_length_mm - array.thickness_mm / array.index
            if array.plano_side == "panel"
            else array.focal_length_mm
        ),
        lenslets=(across, down, across * down),
        elemental_image_px=array.pitch_mm / panel.pixel_pitch_mm,
        viewing_angle_deg=2.0 * half_field_deg,
        crosstalk_angle_deg=half_field_deg,
        viewing_zone_mm=max(0.0, 0.5 * (VIEWING_DISTANCE_MM * array.pitch_mm / distance - panel.width_mm)),
        central_depth_plane_mm=math.inf if in_focus else 1.0 / vergence,
        depth_range_mm=(-reach, reach),
        angular_resolution_deg=math.degrees(panel.pixel_pitch_mm / distance),
        spatial_resolution_mm=array.pitch_mm,
        views=math.floor(array.pitch_mm / panel.pixel_pitch_mm + 1e-9),
        warnings=tuple(_warnings(display)),
    )


def _whole_lenslets(exact: float) -> int:
    """Round a number of lenslets up; 1e-9 forgives the rounding of a panel that is a whole number wide."""
    return math.ceil(exact - 1e-9)


def _warnings(display: Display) -> list[str]:
    panel, array = display.panel, display.array
    found = []
    ratio = array.pitch_mm / panel.pixel_pitch_mm
    beat = abs(ratio - round(ratio))
    if ratio < 2.0:
        found.append(
            f"an elemental image is only {ratio:.3g} pixels across: fewer than two views; "
            "take a finer panel or a coarser array"
        )
    turned = abs(math.remainder(array.rotation_deg, 90.0)) > 0.05
    span = max(panel.width_mm, panel.height_mm) / array.pitch_mm
    if not turned and ratio < MOIRE_BELOW_PIXELS and 1.0 / span < beat < 1.0 / MOIRE_FROM_LENSLETS:
        found.append(
            f"moire: {ratio:.6g} pixels for each lenslet beat every {1.0 / beat:.3g} lenslets; "
            "choose a whole number, one near a half, or turn the array by some degrees"
        )
    if not turned and panel.subpixels != "none":
        found.append("colour moire: colour stripes run parallel to the lenslets; turn the array by some degrees")
    half_field = math.degrees(math.atan2(0.5 * array.pitch_mm, display.aperture_distance_mm))
    if half_field < 5.0:
        found.append(
            f"crosstalk: eyes more than {half_field:.3g} degrees off a lenslet's axis see its neighbour's elemental "
            "image; shorten the focal length and the gap"
        )
    defocus = abs(display.aperture_distance_mm / array.focal_length_mm - 1.0)
    if defocus > 0.5:
        found.append(
            f"the panel stands {display.aperture_distance_mm:.4g} mm from the lenslets, far from their focal length "
            f"of {array.focal_length_mm:.4g} mm: little depth is sharp; change gap_mm or thickness_mm"
        )
    if display.gap_mm == 0.0 and array.plano_side == "viewer":
        found.append("the domes touch the panel: nothing is focused; turn the plano side to the panel or give a gap")
    return found
