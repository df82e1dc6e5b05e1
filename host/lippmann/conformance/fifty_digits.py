"""Trace rays with 50 digits, and compute their sensitivity to rounding of inputs.

The golden engine uses the same formulas, so its distance from 50-digit rays is its
rounding error. The independent tracer tests/host/truth.py verifies the formulas.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt

from lippmann.conformance.ray_sets import Bools, PanelRays, WorldRays
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.faces import Dome
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Floats, Hits, Rays
from lippmann.optics.system import Convergence, PanelFrame, System
from lippmann.optics.trace import hits_of, pixels_from_rays, rays_from_pixels, rays_of

#: A private mpmath context, whose precision mpmath.mp does not change.
mp = mpmath.mp.clone()
mp.dps = 50

#: An mpf number or an array of them; mpmath has no type hints.
Digits = Any

#: Relative step of finite differences, between float64 and 50-digit resolution.
STEP = mp.mpf(10) ** -24

_convert_number = mp.npconvert


def _convert(value: Any) -> Digits:
    # mpf * array calls this for each product; mpmath's own error would contain the array as text.
    if isinstance(value, np.ndarray) and value.ndim:
        raise TypeError("an array is not a number")
    return _convert_number(value)


mp.npconvert = _convert
_number = np.frompyfunc(mp.convert, 1, 1)
_root = np.frompyfunc(mp.sqrt, 1, 1)


def exact_array(values: npt.ArrayLike) -> Digits:
    """Convert numbers to an array of mpf without rounding."""
    return np.asarray(_number(values), object)


class FiftyDigits(NumpyBackend):
    """Backend that computes with arrays of 50-digit mpf numbers."""

    def __init__(self) -> None:
        super().__init__()
        self.floor, self.sqrt = np.frompyfunc(mp.floor, 1, 1), _root
        self.real = self.double = exact_array


def exact_inputs(rays: PanelRays | WorldRays) -> dict[str, Digits]:
    """Return the exact inputs of a trace: ray arrays (N,), and display parameters in mm and degrees.

    Rays from the panel have the arrays `u`, `v` and, with aperture points, `a`, `b`.
    Rays from the world have the arrays `x`, `y`, `z`, `dx`, `dy`, `dz`.
    """
    display = rays.display
    panel, array = display.panel, display.array
    if isinstance(rays, PanelRays):
        names: tuple[str, ...] = ("u", "v", "a", "b")
        columns = exact_array(rays.pixels if rays.aperture is None else np.hstack([rays.pixels, rays.aperture])).T
    else:
        names = ("x", "y", "z", "dx", "dy", "dz")
        columns = exact_array(np.hstack([rays.origin_mm, rays.direction])).T
    numbers = {
        **_lengths("pixel", panel.pixel_pitch_mm),
        **_lengths("pitch", array.pitch_mm),
        **{name: getattr(array, name) for name in ("radius_mm", "index", "thickness_mm", "shear")},
        "gap_mm": display.gap_mm,
        "rotation_deg": array.rotation_deg,
        **_lengths("offset", array.offset_mm),
    }
    if display.viewing_distance_mm is not None:
        numbers |= {"eye_mm": display.viewing_distance_mm, **_lengths("axis", display.viewing_axis_mm)}
    return dict(zip(names, columns, strict=False)) | {name: mp.mpf(value) for name, value in numbers.items()}


def _lengths(name: str, value: float | tuple[float, ...]) -> dict[str, float]:
    if isinstance(value, tuple):
        return {f"{name}_x_mm": value[0], f"{name}_y_mm": value[1]}
    return {f"{name}_mm": value}


def _system(rays: PanelRays | WorldRays, n: SimpleNamespace) -> System:
    display, panel, array = rays.display, rays.display.panel, rays.display.array
    to_panel = array.plano_side == "panel"
    # The optics functions are annotated with float, but also accept mpf.
    pitches, pixels = (
        tuple(getattr(n, f"{name}_{axis}", None) or getattr(n, f"{name}_mm") for axis in ("x_mm", "y_mm"))
        for name in ("pitch", "pixel")
    )
    lattice = Lattice(array.grid, pitches, mp.sqrt(3) / 2, n.shear, array.half_steps)
    (px, py), shear = pitches, abs(n.shear)
    # Corners of the cell: the upper right corner, and the top corner of a hexagon.
    corners = [(px + shear * py) / 2, py / 2], [0, 0]
    if array.grid == "hex":
        corners = [px / 2 + shear * py / mp.sqrt(12), py / mp.sqrt(12)], [shear * py / mp.sqrt(3), py / mp.sqrt(3)]
    rho = max(mp.hypot(*corner) for corner in corners)
    sag = n.radius_mm - mp.sqrt(n.radius_mm**2 - rho**2)
    offset, turn = (n.offset_x_mm, n.offset_y_mm), n.rotation_deg / 180
    frame = PanelFrame(pixels, *panel.size_px, offset, mp.cospi(turn), mp.sinpi(turn))
    distance = n.gap_mm + n.thickness_mm / n.index if to_panel else max(n.gap_mm, sag)
    convergence = Convergence()
    if display.viewing_distance_mm is not None:
        axis = frame.array_from_panel(n.axis_x_mm, n.axis_y_mm)
        convergence = Convergence(distance / (distance + n.eye_mm), *axis)
    return System(
        frame=frame,
        lattice=lattice,
        dome=Dome(lattice, n.radius_mm, sag),
        index=n.index,
        thickness_mm=n.thickness_mm,
        gap_mm=n.gap_mm,
        aperture_distance_mm=distance,
        focal_length_mm=n.radius_mm / (n.index - 1),
        plano_to_panel=to_panel,
        convergence=convergence,
    )


def true_rays(rays: PanelRays, **moved: Digits) -> Rays:
    """Trace rays from the panel with 50 digits; `moved` replaces some `exact_inputs`."""
    n = SimpleNamespace(**exact_inputs(rays) | moved)
    points = None if rays.aperture is None else (n.a, n.b)
    out = rays_from_pixels(FiftyDigits(), _system(rays, n), n.u, n.v, points, rays.model)
    return rays_of(rays.pixels, out, object)


def true_hits(rays: WorldRays, **moved: Digits) -> Hits:
    """Normalise and trace rays from the world with 50 digits; `moved` replaces some `exact_inputs`."""
    n = SimpleNamespace(**exact_inputs(rays) | moved)
    length = _root(n.dx * n.dx + n.dy * n.dy + n.dz * n.dz)
    unit = n.dx / length, n.dy / length, n.dz / length
    hits = pixels_from_rays(FiftyDigits(), _system(rays, n), (n.x, n.y, n.z), unit, "exact")
    return hits_of(len(rays.origin_mm), hits, object)


def truth(rays: PanelRays | WorldRays, **moved: Digits) -> Rays | Hits:
    """Trace rays from the panel or from the world with 50 digits."""
    return true_rays(rays, **moved) if isinstance(rays, PanelRays) else true_hits(rays, **moved)


def _length(vectors: Digits) -> Digits:
    return (_root if vectors.dtype == object else np.sqrt)((vectors * vectors).sum(axis=1))


def size(vectors: Digits) -> Floats:
    """Return the lengths (N,), as float64, of vectors of mpf or float64."""
    return np.asarray(_length(vectors), np.float64)


def apart(rays: Rays | Hits, true: Rays | Hits) -> tuple[Digits, Digits]:
    """Return errors (N,) of direction, radians, and of point, mm; for `Hits`, both are the distance in pixels."""
    if isinstance(rays, Hits):
        pixels = _length(rays.pixel - true.pixel)
        return pixels, pixels
    assert isinstance(true, Rays)
    return _length(rays.direction - true.direction), _length(rays.local_mm - true.local_mm)


def has_other_fate(rays: Rays | Hits, true: Rays | Hits) -> Bools:
    """Return a mask (N,) of rays whose status or lenslet differs from the true ray's."""
    return np.asarray((rays.status != true.status) | (rays.lenslet != true.lenslet).any(axis=1))


def movable_inputs(rays: PanelRays | WorldRays) -> list[tuple[str, Digits, Floats]]:
    """Return name, exact value and float64 value of each input, except display parameters that are 0."""
    inputs = exact_inputs(rays).items()
    return [(name, x, np.asarray(x, np.float64)) for name, x in inputs if isinstance(x, np.ndarray) or x]


def _slopes(rays: PanelRays | WorldRays, true: Rays | Hits, name: str, value: Digits) -> list[Floats]:
    # If a step changes lenslet or status, use the opposite step; if both steps do, use 0.
    step = STEP if isinstance(value, np.ndarray) else STEP * abs(value)
    ahead = truth(rays, **{name: value + step})
    other, slopes = has_other_fate(ahead, true), apart(ahead, true)
    if other.any():
        back = truth(rays, **{name: value - step})
        lost = other & has_other_fate(back, true)
        behind = apart(back, true)
        slopes = tuple(np.where(lost, mp.mpf(0), np.where(other, b, a)) for a, b in zip(slopes, behind, strict=True))
    return [np.asarray(slope / step, np.float64) for slope in slopes]


class Condition(NamedTuple):
    """Sum (N,) of a ray's changes when each input, and the result, changes by one ulp."""

    #: Change of the ray's direction, radians; for rays from the world, `shift_mm` / pitch.
    turn: Floats
    #: Shift of the exit point (its ulp is that of pitch or thickness); for rays from the
    #: world, shift of the point on the panel.
    shift_mm: Floats
    #: Change of direction, radians, per mm of shift of the start point and the aperture
    #: point; 0 for rays from the world.
    start: Floats


def condition(rays: PanelRays | WorldRays, true: Rays | Hits) -> Condition:
    """Return the rounding sensitivity of rays of model `exact`. Inputs of 0 stay 0."""
    array, pixel_mm = rays.display.array, rays.display.panel.coarsest_mm
    turn = np.full(len(true.status), float(np.spacing(1.0)))
    shift = np.full(len(turn), float(np.spacing(max(array.coarsest_mm, array.thickness_mm))))
    start, unit_mm = np.zeros(len(turn)), 1.0
    if isinstance(true, Hits):
        shift = pixel_mm * np.spacing(np.asarray(np.abs(true.pixel), np.float64)).sum(axis=1)
        unit_mm = pixel_mm
    for name, value, rounded in movable_inputs(rays):
        unit = np.where(rounded == 0.0, 0.0, np.spacing(np.abs(rounded)))
        turned, shifted = _slopes(rays, true, name, value)
        turn += turned * unit
        shift += shifted * unit_mm * unit
        start += turned * {"u": 1.0 / pixel_mm, "v": 1.0 / pixel_mm, "a": 1.0, "b": 1.0}.get(name, 0.0)
    return Condition(shift / array.finest_mm if isinstance(true, Hits) else turn, shift, start)
