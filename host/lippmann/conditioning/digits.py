"""Rays in 50 digits, and the effect of one rounding of each input on a ray.

The optics are written once over arrays of any kind (`lippmann.optics.backend`); here their numbers are mpmath's. The
distance between golden and these rays is golden's rounding error. This module cannot show that the formulas are right:
the tests compare the 50 digits with an independent tracer that shares no formula (tests/host/truth.py).

**Condition.** A ray's unit is the distance that it moves, in direction or in exit point, when each of its inputs
(pixel, aperture point, the display's numbers) moves by one unit of its last place: the sum over the inputs, plus one
unit of the result itself (for an exit point: of the lenslet's pitch or thickness, which it is computed from). An engine
that stays within k units has computed, up to k roundings, the exact ray of inputs that are at most k roundings away.
No engine with the same number format can promise more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt

from lippmann.display import Display, Grid
from lippmann.optics.backend import Arr, NumpyBackend
from lippmann.optics.dome import Dome
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.optics.pixel_rays import pixels_from_rays, rays_from_pixels
from lippmann.optics.rays import Model
from lippmann.optics.system import System

#: A private context: nobody can lower the precision by touching mpmath.mp.
mp = mpmath.mp.clone()
mp.dps = 50

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
#: Arrays of mpf, or one mpf; mpmath ships no types.
Digits = Any

#: Relative step of the differences for a ray's condition: far below a float64's last place, far above 50 digits'.
STEP = mp.mpf(10) ** -24

_number = np.frompyfunc(mp.mpf, 1, 1)
_floor = np.frompyfunc(mp.floor, 1, 1)
_root = np.frompyfunc(mp.sqrt, 1, 1)


def exact_array(values: npt.ArrayLike) -> Digits:
    """Return an array of mpf of the exact values of numbers of any kind."""
    return np.asarray(_number(values), object)


class FiftyDigits(NumpyBackend):
    """Arrays of mpf, 50 digits throughout."""

    def __init__(self) -> None:
        super().__init__()
        self.floor, self.sqrt = _floor, _root

    def real(self, x: Arr) -> Arr:
        """Take a number of any kind at its exact value."""
        return exact_array(x)

    double = real


@dataclass(frozen=True)
class Numbers:
    """The numbers of a display that the rays depend on, as mpf: mm and degrees."""

    grid: Grid
    plano_to_panel: bool
    width_px: int
    height_px: int
    pixel_pitch_mm: Digits
    pitch_mm: Digits
    radius_mm: Digits
    index: Digits
    thickness_mm: Digits
    gap_mm: Digits
    rotation_deg: Digits
    offset_x_mm: Digits
    offset_y_mm: Digits

    @classmethod
    def of(cls, display: Display) -> Numbers:
        """Take a display's numbers at their exact values."""
        panel, array = display.panel, display.array
        exact = map(
            mp.mpf,
            (panel.pixel_pitch_mm, array.pitch_mm, array.radius_mm, array.index, array.thickness_mm, display.gap_mm,
             array.rotation_deg, *array.offset_mm),
        )  # fmt: skip
        return cls(array.grid, array.plano_side == "panel", panel.width_px, panel.height_px, *exact)

    def system(self) -> System:
        """Return the system for the optics, with mpf for its numbers (docs/reference/optics.md gives each formula)."""
        # The optics declare float, and compute with any type of number.
        lattice = Lattice(self.grid, self.pitch_mm, mp.sqrt(3) / 2)
        rho = self.pitch_mm / mp.sqrt(2 if self.grid == "square" else 3)
        sag = self.radius_mm - mp.sqrt(self.radius_mm**2 - rho**2)
        distance = self.gap_mm + self.thickness_mm / self.index if self.plano_to_panel else max(self.gap_mm, sag)
        turn = self.rotation_deg / 180
        frame = PanelFrame(
            self.pixel_pitch_mm,
            mp.mpf(self.width_px) / 2,
            mp.mpf(self.height_px) / 2,
            (self.offset_x_mm, self.offset_y_mm),
            mp.cospi(turn),
            mp.sinpi(turn),
        )
        return System(
            frame=frame,
            lattice=lattice,
            dome=Dome(lattice, self.radius_mm, sag),
            index=self.index,
            thickness_mm=self.thickness_mm,
            gap_mm=self.gap_mm,
            aperture_distance_mm=distance,
            focal_length_mm=self.radius_mm / (self.index - 1),
            plano_to_panel=self.plano_to_panel,
            width_px=self.width_px,
            height_px=self.height_px,
        )


#: The numbers of a display that a rounding can move.
MOVED = tuple(field.name for field in dataclasses.fields(Numbers))[4:]


class TrueRays(NamedTuple):
    """Rays in 50 digits: `direction` (N, 3), `local_mm` (N, 3), `centre_mm` (N, 2) arrays of mpf, panel's axes."""

    direction: Digits
    local_mm: Digits
    centre_mm: Digits
    lenslet: Ints
    status: Ints


class TrueHits(NamedTuple):
    """Rays from the world on the panel in 50 digits: `pixel` (N, 2) array of mpf."""

    pixel: Digits
    lenslet: Ints
    status: Ints


#: Rays in 50 digits, either way.
Truth = TrueRays | TrueHits


def true_rays(numbers: Numbers, pixels: Digits, aperture: Digits | None = None, model: Model = "exact") -> TrueRays:
    """Trace rays as `lippmann.optics.pixel_rays.trace` does, in 50 digits.

    Parameters
    ----------
    numbers
        The display.
    pixels
        (N, 2) pixel coordinates, floats or mpf.
    aperture
        (N, 2) aperture points, mm, likewise; None for chief rays.
    model
        Lens model.
    """
    b = FiftyDigits()
    points = None if aperture is None else (b.real(aperture[:, 0]), b.real(aperture[:, 1]))
    out = rays_from_pixels(b, numbers.system(), b.real(pixels[:, 0]), b.real(pixels[:, 1]), points, model)
    ray = out.ray
    return TrueRays(
        np.stack([ray.dx, ray.dy, ray.dz], axis=1),
        np.stack(np.broadcast_arrays(ray.x, ray.y, ray.z), axis=1),
        np.stack([out.centre_x, out.centre_y], axis=1),
        np.stack([out.i, out.j], axis=1),
        np.broadcast_to(out.status, len(pixels)).astype(np.int64),
    )


def true_hits(numbers: Numbers, origin_mm: Digits, direction: Digits) -> TrueHits:
    """Trace rays from the world as `lippmann.optics.pixel_rays.trace_to_panel` does, exact model, in 50 digits.

    Directions are scaled to length 1, which a float64 triple cannot have exactly.
    """
    b = FiftyDigits()
    direction = exact_array(direction)
    direction = direction / _root((direction * direction).sum(axis=1))[:, None]
    origin, unit = (tuple(b.real(a[:, k]) for k in range(3)) for a in (origin_mm, direction))
    hits = pixels_from_rays(b, numbers.system(), origin, unit, "exact")
    return TrueHits(
        np.stack([hits.u, hits.v], axis=1), np.stack([hits.i, hits.j], axis=1), np.asarray(hits.status, np.int64)
    )


def size(vectors: Digits) -> Floats:
    """Return the length of each row of an array of mpf, (N,) float64."""
    squares = (vectors * vectors).sum(axis=1)
    return np.asarray(_root(squares), np.float64)


class _Input(NamedTuple):
    """One number that rays depend on, a column of an array or a number of the display.

    `values` are (N,) or one number; `array` is the index of its array, None for the display; `traced` traces the rays
    with the input moved by a step, mpf or (N,).
    """

    values: Any
    array: int | None
    traced: Callable[[Any], Any]


def _inputs(display: Display, trace: Callable[..., Any], arrays: Sequence[Floats]) -> Iterator[_Input]:
    """Yield the inputs of `trace(numbers, *arrays)`, without the display's numbers that are 0."""
    numbers, exact = Numbers.of(display), [exact_array(values) for values in arrays]
    for which, values in enumerate(arrays):
        for k, unit in enumerate(np.eye(values.shape[1])):

            def moved_column(step: Any, which: int = which, unit: Floats = unit) -> Any:
                moved = list(exact)
                moved[which] = moved[which] + np.reshape(step, (-1, 1)) * unit
                return trace(numbers, *moved)

            yield _Input(values[:, k], which, moved_column)
    for name in MOVED:
        value = getattr(numbers, name)
        if value:

            def moved_number(step: Any, name: str = name, value: Any = value) -> Any:
                return trace(dataclasses.replace(numbers, **{name: value + step}), *exact)

            yield _Input(float(value), None, moved_number)


def _last_place(values: Any) -> Any:
    return np.spacing(np.abs(values))


def _other_fate(rays: Truth, true: Truth) -> Bools:
    """Tell which rays have another status or lenslet."""
    return np.asarray((rays.status != true.status) | (rays.lenslet != true.lenslet).any(axis=1))


def _slopes(given: _Input, true: Truth, names: tuple[str, ...]) -> list[Floats]:
    """Return how far some arrays of the rays move, each row's length (N,), for a unit of an input.

    Where a step leads to another lenslet or status, the step to the other side counts; where both do, the slope is 0.
    """
    step = STEP if given.array is not None else STEP * abs(mp.mpf(given.values))
    rays = given.traced(step)
    other = _other_fate(rays, true)
    apart = [getattr(rays, name) - getattr(true, name) for name in names]
    if other.any():
        back = given.traced(-step)
        lost = other & _other_fate(back, true)
        for name, moved in zip(names, apart, strict=True):
            moved[other] = (getattr(back, name) - getattr(true, name))[other]
            moved[lost] = mp.mpf(0)
    return [size(moved / step) for moved in apart]


class Condition(NamedTuple):
    """How far rays move for one unit in the last place of every input, (N,) float64.

    turn
        Radians, the rounding of a unit vector included. For rays from the world: the shift over the array's pitch.
    shift_mm
        Of the exit point, lens-local, mm. For rays from the world: of the point on the panel.
    start
        Radians for one mm at the start of the ray and at its aperture point: the effect of a rounding of lens-local
        coordinates. For rays from the world: 0.
    """

    turn: Floats
    shift_mm: Floats
    start: Floats


def condition(display: Display, true: TrueRays, pixels: Floats, aperture: Floats | None = None) -> Condition:
    """Return the condition of rays of model `exact`, from differences in 50 digits. An input of 0 has no last place."""
    array, n = display.array, len(pixels)
    turn = np.full(n, float(np.spacing(1.0)))
    shift = np.full(n, float(np.spacing(max(array.pitch_mm, array.thickness_mm))))
    start = np.zeros(n)
    arrays = [pixels] if aperture is None else [pixels, aperture]
    for given in _inputs(display, true_rays, arrays):
        unit = np.where(given.values == 0.0, 0.0, _last_place(given.values))
        slope, path = _slopes(given, true, ("direction", "local_mm"))
        turn += slope * unit
        shift += path * unit
        if given.array is not None:
            start += slope * (1.0 / display.panel.pixel_pitch_mm, 1.0)[given.array]
    return Condition(turn, shift, start)


def hit_condition(display: Display, true: TrueHits, origin_mm: Floats, direction: Floats) -> Condition:
    """Return the condition of rays from the world."""
    pitch = display.panel.pixel_pitch_mm
    shift: Floats = pitch * np.spacing(np.asarray(np.abs(true.pixel), np.float64)).sum(axis=1)
    for given in _inputs(display, true_hits, (origin_mm, direction)):
        unit = np.where(given.values == 0.0, 0.0, _last_place(given.values))
        (slope,) = _slopes(given, true, ("pixel",))
        shift += slope * pitch * unit
    return Condition(shift / display.array.pitch_mm, shift, np.zeros_like(shift))


def on_edge(display: Display, true: Truth, arrays: Sequence[Floats], ulps: int) -> Bools:
    """Tell which rays get another fate (status or lenslet) when one input moves by `ulps` units of its last place.

    Parameters
    ----------
    display, true
        The display, and the rays in 50 digits.
    arrays
        What they were traced from: pixels, and aperture points if any; for rays from the world, origins and directions.
    ulps
        Units of the last place of a float64.
    """
    edge = np.zeros(len(true.status), bool)
    for given in _inputs(display, true_rays if isinstance(true, TrueRays) else true_hits, arrays):
        step = exact_array(_last_place(given.values)) * ulps
        for moved in (step, -step):
            edge |= _other_fate(given.traced(moved), true)
    return edge
