"""Computes the display properties that `lippmann inspect` prints."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lippmann.base.toml import documented, key
from lippmann.display.description import Display, Pair, Point3
from lippmann.optics.crosstalk_and_viewing_zone import (
    Zone,
    middle_eye,
    remedy,
    sees_all,
    status_share,
    viewing_distance,
    zones,
)
from lippmann.optics.lattice import HALF_SQRT3
from lippmann.optics.system import PanelFrame, System

#: Eye distances in the table of views, as multiples of the viewing distance.
DISTANCES = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
#: Minimum period, in lenslets, of visible moire between lenslets and pixels.
MOIRE_FROM_LENSLETS = 4.0
#: Moire is visible if an elemental image has fewer pixels across than this.
MOIRE_BELOW_PIXELS = 60.0
#: Maximum rotation of an array that counts as parallel to the pixel rows, degrees.
PARALLEL_DEG = 0.05
#: A viewing distance above this limit, mm, was probably not in mm.
FAR_MM = 100_000.0

Lenslets = tuple[int, int, int]
_ZONE = "half the width of the zone without crosstalk at the viewing distance, or 0"
_MIDDLE = "with a viewing distance, for the lenslet at the viewing axis"
_DEPTHS = "(far, near): depths at pitch D / pixel pitch, where the rays of neighbouring pixels are a lenslet apart"


@documented
@dataclass(frozen=True)
class DisplayProperties:
    """The properties of a display. The founding paper's equations 2 to 4 relate the first five."""

    radius_mm: float
    sag_mm: float
    flat_distance_mm: float
    thickness_mm: float
    focal_length_mm: float
    f_number: Annotated[float, key("focal length over pitch")]
    index: float
    aperture_distance_mm: float
    back_focal_length_mm: Annotated[float, key("from the array's face on the panel's side to the focus")]
    lenslets: Annotated[Lenslets, key("(across, down, total): equation 5, rounded up; an extent limits the lenslets")]
    elemental_image_px: Annotated[float, key("pixels across an elemental image: its pitch over pixel pitch")]
    viewing_angle_deg: Annotated[float, key(f"full angle of an elemental image, {_MIDDLE}: 2 atan(pitch / 2D)")]
    crosstalk_angle_deg: Annotated[
        float, key("half of `viewing_angle_deg`; at larger angles a lenslet shows its neighbour's image")
    ]
    viewing_zone_mm: Annotated[float, key(_ZONE)]
    central_depth_plane_mm: Annotated[float, key("z of the panel's image l: 1/l = 1/f - 1/D; infinite if in focus")]
    depth_range_mm: Annotated[Pair, key(_DEPTHS)]
    angular_resolution_deg: Annotated[float, key("angle between neighbouring pixels' rays: pixel pitch / D")]
    spatial_resolution_mm: Annotated[float, key("lenslet pitch: a view has one pixel for each lenslet")]
    views: Annotated[int, key("number of directions across: whole pixels in an elemental image")]
    warnings: Annotated[tuple[str, ...], key("one sentence each, with a remedy")]


_RANGE = "depths at which the eye sees rays of neighbouring pixels at most a lenslet apart"


@documented
@dataclass(frozen=True)
class EyeView:
    """The view of a display from one eye position."""

    eye_mm: Annotated[Point3, key("position of the eye")]
    status_share: Annotated[dict[str, float], key("fraction of the eye's rays with each status, as in `observe`")]
    sees_all: Annotated[bool, key("whether the eye sees the whole panel without crosstalk")]
    zone_mm: Annotated[Zone | None, key("zone without crosstalk at this distance, or None")]
    depth_range_mm: Annotated[Pair, key(f"(far, near): {_RANGE}")]
    view_step_mm: Annotated[float, key("distance between eyes that see neighbouring pixels: pixel pitch z / D")]
    lenslet_arcmin: Annotated[float, key("angle that a lenslet, the view's pixel, subtends: pitch / z")]
    moire_lenslets: Annotated[float | None, key("period of the visible moire in lenslets, or None")]


def eye_views(display: Display, eyes_mm: Sequence[Point3]) -> list[EyeView]:
    """Return each eye's view of a display; raise InputError for an eye not in front of it."""
    pitch, distance = display.array.finest_mm, display.aperture_distance_mm
    shares = [status_share(display, eye) for eye in eyes_mm]
    reach, step = pitch * distance / display.panel.coarsest_mm, display.panel.coarsest_mm / distance
    views = []
    clear = sees_all(display, np.array(eyes_mm, float)).tolist()
    texts = zones(display, [eye[2] for eye in eyes_mm])
    for eye, share, all_right, zone in zip(eyes_mm, shares, clear, texts, strict=True):
        z = eye[2]
        depths = (z * reach / (reach - z) if z > reach else -math.inf, z * reach / (reach + z))
        arcmin, moire = 60.0 * math.degrees(display.array.coarsest_mm / z), visible_moire(display, z)
        views.append(EyeView(eye, share, all_right, zone, depths, z * step, arcmin, moire))
    return views


def axis_text(display: Display) -> str:
    """Describe the axis from which viewing and crosstalk angles are measured."""
    if display.viewing_distance_mm is None:
        return "a lenslet's axis"
    x, y = display.viewing_axis_mm
    return f"the axis of the lenslet at ({x:g}, {y:g}) mm"


def percent(share: float, sampled: bool = False) -> str:
    """Return a fraction as per cent; small positive values, and 0 if `sampled`, become "< 0.1 %"."""
    return "< 0.1 %" if (sampled or share > 0.0) and share < 5e-4 else f"{100.0 * share:.1f} %"


def table_of_views(display: Display) -> list[EyeView]:
    """Return the middle eye's view at each of `DISTANCES`."""
    usual = viewing_distance(display)
    return eye_views(display, [middle_eye(display, factor * usual) for factor in DISTANCES])


def display_properties(display: Display) -> DisplayProperties:
    """Compute the properties of a display."""
    panel, array = display.panel, display.array
    pitch, distance = array.finest_mm, display.aperture_distance_mm
    image = pitch * (1.0 + display.convergence)
    half_field_deg = math.degrees(math.atan2(0.5 * image, distance))
    (zone,) = zones(display, [viewing_distance(display)])
    vergence = 1.0 / array.focal_length_mm - 1.0 / distance
    # If the panel is in focus, within rounding error, its image is at infinity.
    in_focus = abs(vergence) * distance < 1e-12
    in_glass = array.thickness_mm / array.index if array.plano_side == "panel" else 0.0
    return DisplayProperties(
        radius_mm=array.radius_mm,
        sag_mm=array.sag_mm,
        flat_distance_mm=array.flat_distance_mm,
        thickness_mm=array.thickness_mm,
        index=array.index,
        focal_length_mm=array.focal_length_mm,
        f_number=array.focal_length_mm / pitch,
        aperture_distance_mm=distance,
        back_focal_length_mm=array.focal_length_mm - in_glass,
        lenslets=_lenslets(display),
        elemental_image_px=image / panel.coarsest_mm,
        viewing_angle_deg=2.0 * half_field_deg,
        crosstalk_angle_deg=half_field_deg,
        viewing_zone_mm=0.0 if zone is None else 0.5 * (zone.right_mm - zone.left_mm),
        central_depth_plane_mm=math.inf if in_focus else 1.0 / vergence,
        depth_range_mm=depth_reach_mm(display),
        angular_resolution_deg=math.degrees(panel.coarsest_mm / distance),
        spatial_resolution_mm=array.coarsest_mm,
        views=math.floor(image / panel.coarsest_mm + 1e-9),
        warnings=tuple(_warnings(display, half_field_deg, zone)),
    )


def depth_reach_mm(display: Display) -> Pair:
    """Return the farthest and the nearest depth, mm, at which a pixel's beam is at most a lenslet wide."""
    reach = display.array.finest_mm * display.aperture_distance_mm / display.panel.coarsest_mm
    return -reach, reach


def _lenslets(display: Display) -> Lenslets:
    panel, array = display.panel, display.array
    # 1e-9 absorbs rounding error if the panel is an integer number of lenslets wide.
    across = math.ceil(panel.width_mm / array.pitches_mm[0] - 1e-9)
    down = math.ceil(panel.height_mm / array.row_pitch_mm - 1e-9)
    if array.half_steps is None:
        return across, down, across * down
    along, rows = array.half_steps
    down = min(down, 2 * (rows // 2) + 1)
    # The middle row has a central lenslet; in a hexagonal array, the next rows do not.
    own, other = (min(across, count) for count in (2 * (along // 2) + 1, 2 * ((along + 1) // 2)))
    others = (down + 1) // 4 * 2 if array.grid == "hex" else 0
    return max(own, other) if others else own, down, own * (down - others) + other * others


def beats_in_lenslets(display: Display, distance_mm: float = math.inf) -> Pair:
    """Return the moire periods of pixel columns and of pixel rows behind the lenslets, in pitches.

    An eye at a distance z looks through neighbouring lenslets at points 1 + D/z pitches
    apart. Pixel columns of pitch p have the frequency k = (1/p, 0); their phase
    advances by k . a cycles along a lattice vector a. The eye sees the longest wave
    whose frequency f satisfies f . a = k . a modulo 1 for both lattice vectors. The
    length of f is k's distance from the reciprocal lattice; the period is its inverse.
    """
    lattice, frame = System.of(display).lattice, PanelFrame.of(display)
    pitch_mm = lattice.pitches_mm[0]
    # Lattice vectors in lenslet pitches, and the area of their parallelogram.
    step, row = (tuple(c / pitch_mm for c in lattice.centre(*lenslet)) for lenslet in ((1, 0), (0, 1)))
    area = step[0] * row[1]

    def period(axis: int, pixel_mm: float) -> float:
        ratio = pitch_mm * (1.0 + display.aperture_distance_mm / distance_mm) / pixel_mm
        phases = [math.remainder(ratio * frame.turn(*vector)[axis], 1.0) for vector in (step, row)]
        lengths = []
        for i, j in itertools.product(range(-2, 3), repeat=2):
            first, second = phases[0] + i, phases[1] + j
            lengths.append(math.hypot(first * row[1], second * step[0] - first * row[0]))
        frequency = min(lengths) / area
        return 1.0 / frequency if frequency else math.inf

    return period(0, display.panel.pitches_mm[0]), period(1, display.panel.pitches_mm[1])


def visible_moire(display: Display, distance_mm: float) -> float | None:
    """Return the longest moire period, in lenslets, or None if no moire is visible."""
    panel, pitch = display.panel, display.array.pitches_mm[0]
    widest = max(panel.width_mm, panel.height_mm) / pitch
    beats = [beat for beat in beats_in_lenslets(display, distance_mm) if MOIRE_FROM_LENSLETS < beat < widest]
    pixels = display.array.finest_mm / panel.coarsest_mm
    return max(beats) if beats and pixels < MOIRE_BELOW_PIXELS else None


def _warnings(display: Display, half_field_deg: float, zone: Zone | None) -> list[str]:
    panel, array = display.panel, display.array
    texts = []
    ratio = array.finest_mm / panel.coarsest_mm
    if ratio < 2.0:
        texts.append(
            f"an elemental image is only {ratio:.3g} pixels across: fewer than two views; "
            "take a finer panel or a coarser array"
        )
    px, py = array.pitches_mm
    if array.grid == "hex" and abs(py / px / HALF_SQRT3 - 1.0) < 0.01:
        texts.append(
            f"rows are {array.row_pitch_mm:.4g} mm apart, because py of a hexagonal pitch_mm is not their distance; "
            f"if they are {py:g} mm apart give pitch_mm = [{px:g}, {py / HALF_SQRT3:.6g}]"
        )
    distance = viewing_distance(display)
    moire = visible_moire(display, distance)
    if moire is not None:
        texts.append(
            f"moire: to an eye at {distance:g} mm, pixels and lenslets beat every {moire * px:.3g} mm; change the "
            "pitch of either, or the angle of the array by some degrees"
        )
    # Stripes align with a square lattice every 90 degrees, and with a hexagonal one every 30.
    symmetry_deg = 30.0 if array.grid == "hex" else 90.0
    if panel.subpixels != "none" and abs(math.remainder(array.rotation_deg, symmetry_deg)) <= PARALLEL_DEG:
        kind = "stripes" if panel.subpixels in ("rgb", "bgr") else "sub-pixels"
        texts.append(f"colour moire: colour {kind} run parallel to the lenslets; turn the array by some degrees")
    if half_field_deg < 5.0:
        texts.append(
            f"crosstalk: eyes more than {half_field_deg:.3g} degrees off {axis_text(display)} see its neighbour's "
            "elemental image; shorten the focal length and the gap"
        )
    texts += _eye_warnings(display, zone)
    defocus = abs(display.aperture_distance_mm / array.focal_length_mm - 1.0)
    if defocus > 0.5:
        texts.append(
            f"the panel is {display.aperture_distance_mm:.4g} mm from the lenslets, far from their focal length "
            f"of {array.focal_length_mm:.4g} mm: little depth is sharp; change gap_mm or thickness_mm"
        )
    if display.gap_mm == 0.0 and array.plano_side == "viewer":
        texts.append("the domes touch the panel: nothing is focused; turn the plano side to the panel or give a gap")
    return texts


def _eye_warnings(display: Display, zone: Zone | None) -> list[str]:
    panel, distance, texts = display.panel, viewing_distance(display), []
    x, y = display.viewing_axis_mm
    if abs(x) > 0.5 * panel.width_mm or abs(y) > 0.5 * panel.height_mm:
        texts.append(
            f"viewing_axis_mm, {x:g}, {y:g}, is beside the panel of {panel.width_mm:.4g} x {panel.height_mm:.4g} mm; "
            "give the point of the panel that the eye is in front of"
        )
    elif zone is None:
        share = status_share(display, middle_eye(display, distance))["crosstalk"]
        texts.append(
            f"no eye at {distance:g} mm sees the whole panel: {percent(share, sampled=True)} of the view from the "
            f"middle is crosstalk; {remedy(display)}"
        )
    if (display.viewing_distance_mm or 0.0) > FAR_MM:
        texts.append(
            f"an eye {display.viewing_distance_mm:g} mm away is {distance / 1000.0:g} m away; give millimetres, or "
            "leave viewing_distance_mm out for elemental images right behind their lenslets"
        )
    return texts
