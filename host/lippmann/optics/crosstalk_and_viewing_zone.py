"""Computes the crosstalk that eyes see, and the zone without crosstalk, by the model `exact`.

At the distance z, the paraxial zone is as wide as a cell's image, (1 + k) p z / D,
minus |1 - z/E| panel widths (pitch p, k = D/E, D and E as in `system`). Bisection finds
the real zone: it is narrower, because thick lenslets refract steep rays differently.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display, Point3
from lippmann.errors import InputError
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import Bools, Floats, Status
from lippmann.optics.sample_points import R2_STEPS
from lippmann.optics.system import System
from lippmann.optics.trace import trace_to_panel

#: Eye distance, mm, for a display without a viewing distance.
VIEWING_DISTANCE_MM = 600.0
#: Maximum coordinate of an eye, mm.
FARTHEST_EYE_MM = 1e9
TOO_FAR = f"eye: is farther away than {FARTHEST_EYE_MM:g} mm; give its position in mm, such as 0,0,600"
#: Rays that measure an eye's crosstalk.
SHARE_RAYS = 1 << 13
#: Lenslets tested for crosstalk, across and down the panel.
LENSLETS = (5, 3)
#: Tested points: distance from a cell's centre and height, as fractions of the rim's.
POINTS = ((0.6, 0.0), (0.95, 0.0), (0.95, 1.0), (0.99, 0.0), (0.99, 1.0))
#: Search for a zone's end: range in paraxial half widths, number of bisections.
FARTHEST, BISECTIONS = 2.0, 11
#: Search for a better display: factor on a length per step, maximum steps.
FACTOR, STEPS = 1.1, 24
#: Minimum width of a better display's zone, as a fraction of one lenslet's zone.
WORTH = 0.25


class Zone(NamedTuple):
    """Ends, mm, of the zone without crosstalk, along x and along y through the middle eye."""

    left_mm: float
    right_mm: float
    bottom_mm: float
    top_mm: float


def viewing_distance(display: Display) -> float:
    """Return the display's viewing distance, mm, or `VIEWING_DISTANCE_MM`."""
    return VIEWING_DISTANCE_MM if display.viewing_distance_mm is None else display.viewing_distance_mm


def middle_eye(display: Display, distance_mm: float) -> Point3:
    """Return the position, mm, from which an eye at a distance sees opposite panel sides equally."""
    share = 0.0 if display.viewing_distance_mm is None else distance_mm / display.viewing_distance_mm
    return share * display.viewing_axis_mm[0], share * display.viewing_axis_mm[1], distance_mm


def status_share(display: Display, eye_mm: Point3) -> dict[str, float]:
    """Return the fraction of an eye's rays that have each status.

    Raises InputError if the eye is behind the display or too far away.
    """
    (shares,) = status_shares(display, np.array([eye_mm]), SHARE_RAYS)
    return {one.name.lower(): float(shares[one]) for one in Status}


def status_shares(display: Display, eyes_mm: Floats, rays: int) -> Floats:
    """Return `status_share` of eyes (N, 3), with `rays` rays each, as (N, statuses) float64."""
    front, nearest = System.of(display).last_face_mm, eyes_mm[:, 2].min()
    if not nearest > front:
        what = f"z {nearest:g} mm is not in front of the display, whose front is at z = {front:.4g} mm"
        raise InputError(f"eye: {what}; move the eye towards +z")
    if not np.abs(eyes_mm).max() <= FARTHEST_EYE_MM:
        raise InputError(TOO_FAR)
    steps = np.arange(1, rays + 1)[:, None] * R2_STEPS % 1.0
    points = np.pad((steps - 0.5) * (display.panel.width_mm, display.panel.height_mm), ((0, 0), (0, 1)))
    status = _statuses(display, eyes_mm, points, inside=False)
    return np.stack([(status == one).mean(axis=1) for one in Status], axis=1)


def sees_all(display: Display, eyes_mm: Floats) -> Bools:
    """Return which eyes, (N, 3) float64 mm, see the whole panel without crosstalk."""
    system, panel = System.of(display), display.panel
    across, down = (np.linspace(-0.5, 0.5, count) for count in LENSLETS)
    grid = np.stack(np.meshgrid(across * panel.width_mm, down * panel.height_mm), axis=-1).reshape(-1, 2)
    # Find the lenslets through which each eye sees the grid's points. The panel's edges
    # are ignored: crosstalk beyond an edge also appears in the last lenslet inside.
    lift = display.aperture_distance_mm / eyes_mm[:, None, 2:]
    x, y = np.moveaxis((grid + lift * eyes_mm[:, None, :2]) / (1.0 + lift), -1, 0)
    place = system.lattice.nearest_within(*system.frame.array_from_panel(x, y))
    i, j, *_ = system.lattice.locate(NumpyBackend(), *place)
    centres = np.stack(system.centre(i, j), axis=-1)
    corners = np.array(system.lattice.corners)
    around = np.concatenate([corners, 0.5 * (corners + np.roll(corners, 1, axis=0))])
    around = np.stack(system.frame.turn(*around.T), axis=-1)
    rims = -system.dome.sag_mm if system.plano_to_panel else system.dome.sag_mm
    rings = (np.pad(share * around, ((0, 0), (0, 1)), constant_values=h * rims) for share, h in POINTS)
    cell = np.concatenate(list(rings))
    points = (np.pad(centres, ((0, 0), (0, 0), (0, 1)))[:, :, None] + cell).reshape(len(eyes_mm), -1, 3)
    x, y = panel.pitches_mm
    # Enlarge the panel with larger pixels, not with more: their number is limited.
    wide = replace(panel, pixel_pitch_mm=(4.0 * x, 4.0 * y))
    status = _statuses(replace(display, panel=wide), eyes_mm, points)
    mostly = (status == Status.OK).mean(axis=1) >= 0.5
    return np.asarray(mostly & ~(status == Status.CROSSTALK).any(axis=1))


def zones(display: Display, distances_mm: Sequence[float]) -> list[Zone | None]:
    """Return the zone at each distance, or None where the middle eye sees crosstalk."""
    middle = np.array([middle_eye(display, z) for z in distances_mm])
    clear = sees_all(display, middle)
    away = np.array([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)])
    reach = np.zeros((len(middle), len(away), 1))
    step = FARTHEST * half_width(display) * middle[:, None, 2:]
    for _ in range(BISECTIONS if clear.any() else 0):
        step = 0.5 * step
        eyes = (middle[:, None] + (reach + step) * away)[clear].reshape(-1, 3)
        reach[clear] += np.where(sees_all(display, eyes).reshape(-1, len(away), 1), step[clear], 0.0)
    ends = middle[:, None] + reach * away
    places = np.stack([ends[:, 0, 0], ends[:, 1, 0], ends[:, 2, 1], ends[:, 3, 1]], axis=1).tolist()
    return [Zone(*place) if is_clear else None for place, is_clear in zip(places, clear, strict=True)]


def half_width(display: Display) -> float:
    """Return half the paraxial width of one lenslet's zone, divided by the distance z."""
    return 0.5 * (1.0 + display.convergence) * display.array.coarsest_mm / display.aperture_distance_mm


def remedy(display: Display) -> str:
    """Return advice: the first tried change that gives a zone without crosstalk."""
    old = _Change(
        display.gap_mm, display.viewing_distance_mm, display.array.focal_length_mm, display.array.pitches_mm[0]
    )
    for new in _changes(display, old):
        pitch_mm = display.array.pitch_of(new.pitch_mm)
        radius_mm = new.focal_length_mm * (display.array.index - 1.0)
        array = replace(display.array, pitch_mm=pitch_mm, radius_mm=radius_mm)
        if array.radius_mm < array.half_diagonal_mm:
            continue
        array = replace(array, thickness_mm=max(array.thickness_mm, array.sag_mm))
        changed = replace(display, array=array, gap_mm=new.gap_mm, viewing_distance_mm=new.viewing_distance_mm)
        if new.viewing_distance_mm is not None and new.viewing_distance_mm < changed.nearest_eye_mm:
            continue
        x, y, z = middle_eye(changed, viewing_distance(changed))
        aside = WORTH * z * half_width(changed)
        if sees_all(changed, np.array([(x - aside, y, z), (x, y, z), (x + aside, y, z)])).all():
            pairs = zip(_Change._fields, new, old, strict=True)
            changes = ", ".join(f"{key} = {value:.4g}" for key, value, was in pairs if value not in (was, None))
            return f"give {changes}" + ("" if z == viewing_distance(display) else " and look from there")
    return "take lenslets of another pitch and focal length, or a smaller panel"


class _Change(NamedTuple):
    gap_mm: float
    viewing_distance_mm: float | None
    focal_length_mm: float
    pitch_mm: float


def _changes(display: Display, old: _Change) -> Iterator[_Change]:
    usual = viewing_distance(display)
    array = display.array
    in_glass = array.thickness_mm / array.index if array.plano_side == "panel" else 0.0

    def focused(change: _Change) -> _Change:
        return change._replace(gap_mm=_rounded(max(0.0, change.focal_length_mm - in_glass), 4))

    yield focused(old)
    for eye in (*(_rounded(usual * FACTOR**k, 2) for k in range(STEPS)), VIEWING_DISTANCE_MM):
        farther = old._replace(viewing_distance_mm=eye)
        yield from (farther, focused(farther))
    old = old._replace(viewing_distance_mm=usual)
    for k in range(STEPS):
        yield focused(old._replace(focal_length_mm=_rounded(old.focal_length_mm * FACTOR**k, 2)))
        yield focused(old._replace(pitch_mm=_rounded(old.pitch_mm * FACTOR**k, 2)))


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def _statuses(display: Display, eyes_mm: Floats, points_mm: Floats, inside: bool = True) -> npt.NDArray[np.uint8]:
    """Return the statuses (N, M) of rays from eyes (N, 3) to points (N, M, 3) or (M, 3), mm.

    If `inside`, the points are in glass behind a flat front face, which refracts rays.
    """
    place, z = eyes_mm[:, None, :2], eyes_mm[:, None, 2:]
    slope = (points_mm[..., :2] - place) / (z - points_mm[..., 2:])
    front = System.of(display).last_face_mm
    if inside and front > 0.0:
        square = (slope * slope).sum(axis=-1, keepdims=True)
        in_glass = slope / np.sqrt(display.array.index**2 * (1.0 + square) - square)
        slope = (points_mm[..., :2] - (front - points_mm[..., 2:]) * in_glass - place) / (z - front)
    ray = np.concatenate([slope, np.full((*slope.shape[:-1], 1), -1.0)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    origin = np.broadcast_to(eyes_mm[:, None], ray.shape).reshape(-1, 3)
    return trace_to_panel(display, origin, ray.reshape(-1, 3)).status.reshape(ray.shape[:-1])
