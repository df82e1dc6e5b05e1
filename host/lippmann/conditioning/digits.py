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

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt

from lippmann.conditioning.search import Bools, Floats
from lippmann.display import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.dome import Dome
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.optics.pixel_rays import pixels_from_rays, rays_from_pixels
from lippmann.optics.rays import Model
from lippmann.optics.system import System

#: A private context: nobody can lower the precision by touching mpmath.mp.
mp = mpmath.mp.clone()
mp.dps = 50

Ints = npt.NDArray[np.int64]
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
        self.real = self.double = exact_array  # a number of any kind, at its exact value


def exact_numbers(display: Display) -> dict[str, Digits]:
    """Return the exact values of the display's numbers that a rounding can move, mm and degrees."""
    panel, array = display.panel, display.array
    names = ("pitch_mm", "radius_mm", "index", "thickness_mm")
    return {
        "pixel_pitch_mm": mp.mpf(panel.pixel_pitch_mm),
        **{name: mp.mpf(getattr(array, name)) for name in names},
        "gap_mm": mp.mpf(display.gap_mm),
        "rotation_deg": mp.mpf(array.rotation_deg),
        "offset_x_mm": mp.mpf(array.offset_mm[0]),
        "offset_y_mm": mp.mpf(array.offset_mm[1]),
    }


def exact_system(display: Display, **moved: Digits) -> System:
    """Return the system for the optics in mpf, with other values of some of its `exact_numbers`.

    docs/reference/optics.md gives each formula.
    """
    # The optics declare float, and compute with any type of number.
    n = SimpleNamespace(**exact_numbers(display) | moved)
    panel, grid, to_panel = display.panel, display.array.grid, display.array.plano_side == "panel"
    lattice = Lattice(grid, n.pitch_mm, mp.sqrt(3) / 2)
    rho = n.pitch_mm / mp.sqrt(2 if grid == "square" else 3)
    sag = n.radius_mm - mp.sqrt(n.radius_mm**2 - rho**2)
    offset, turn = (n.offset_x_mm, n.offset_y_mm), n.rotation_deg / 180
    return System(
        frame=PanelFrame(n.pixel_pitch_mm, panel.width_px, panel.height_px, offset, mp.cospi(turn), mp.sinpi(turn)),
        lattice=lattice,
        dome=Dome(lattice, n.radius_mm, sag),
        index=n.index,
        thickness_mm=n.thickness_mm,
        gap_mm=n.gap_mm,
        aperture_distance_mm=n.gap_mm + n.thickness_mm / n.index if to_panel else max(n.gap_mm, sag),
        focal_length_mm=n.radius_mm / (n.index - 1),
        plano_to_panel=to_panel,
    )


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


def true_rays(
    display: Display,
    pixels: Digits,
    aperture: Digits | None = None,
    model: Model = "exact",
    **moved: Digits,
) -> TrueRays:
    """Trace rays as `lippmann.optics.pixel_rays.trace` does, in 50 digits.

    Parameters
    ----------
    display
        The display.
    pixels
        (N, 2) pixel coordinates, floats or mpf.
    aperture
        (N, 2) aperture points, mm, likewise; None for chief rays.
    model
        Lens model.
    moved
        Other values of some of the display's `exact_numbers`.
    """
    u, v = exact_array(pixels).T
    points = None if aperture is None else tuple(exact_array(aperture).T)
    out = rays_from_pixels(FiftyDigits(), exact_system(display, **moved), u, v, points, model)
    ray = out.ray
    return TrueRays(
        np.stack([ray.dx, ray.dy, ray.dz], axis=1),
        np.stack(np.broadcast_arrays(ray.x, ray.y, ray.z), axis=1),
        np.stack([out.centre_x, out.centre_y], axis=1),
        np.stack([out.i, out.j], axis=1),
        np.broadcast_to(out.status, len(pixels)).astype(np.int64),
    )


def true_hits(display: Display, origin_mm: Digits, direction: Digits, **moved: Digits) -> TrueHits:
    """Trace rays from the world as `lippmann.optics.pixel_rays.trace_to_panel` does, exact model, in 50 digits.

    Directions are scaled to length 1, which a float64 triple cannot have exactly. `moved` as for `true_rays`.
    """
    direction = exact_array(direction)
    unit = direction / _root((direction * direction).sum(axis=1))[:, None]
    origin = tuple(exact_array(origin_mm).T)
    hits = pixels_from_rays(FiftyDigits(), exact_system(display, **moved), origin, tuple(unit.T), "exact")
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


def _inputs(display: Display, true: Truth, arrays: Sequence[Floats]) -> Iterator[_Input]:
    """Yield the inputs of the rays, without the display's numbers that are 0."""
    trace: Callable[..., Truth] = true_rays if isinstance(true, TrueRays) else true_hits

    def moved_column(which: int, k: int, step: Any) -> Truth:
        exact = [exact_array(values) for values in arrays]
        exact[which][:, k] += step
        return trace(display, *exact)

    for which, values in enumerate(arrays):
        for k, column in enumerate(values.T):
            yield _Input(column, which, partial(moved_column, which, k))
    for name, value in exact_numbers(display).items():
        if value:

            def moved_number(step: Any, name: str = name, value: Any = value) -> Truth:
                return trace(display, *arrays, **{name: value + step})

            yield _Input(float(value), None, moved_number)


def _other_fate(rays: Truth, true: Truth) -> Bools:
    """Tell which rays have another status or lenslet."""
    return np.asarray((rays.status != true.status) | (rays.lenslet != true.lenslet).any(axis=1))


def _slopes(given: _Input, true: Truth) -> list[Floats]:
    """Return how far the arrays of mpf of the rays move, each row's length (N,), for a unit of an input.

    Where a step leads to another lenslet or status, the step to the other side counts; where both do, the slope is 0.
    """
    step = STEP if given.array is not None else STEP * abs(mp.mpf(given.values))
    rays, names = given.traced(step), ("direction", "local_mm") if isinstance(true, TrueRays) else ("pixel",)
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


def condition(display: Display, true: Truth, arrays: Sequence[Floats]) -> Condition:
    """Return the condition of rays of model `exact`, from differences in 50 digits. An input of 0 has no last place.

    `arrays` are what the rays were traced from: pixels, and aperture points if any; for rays from the world, origins
    and directions.
    """
    array, pixel_mm = display.array, display.panel.pixel_pitch_mm
    turn = np.full(len(true.status), float(np.spacing(1.0)))
    shift = np.full(len(turn), float(np.spacing(max(array.pitch_mm, array.thickness_mm))))
    start = np.zeros(len(turn))
    if isinstance(true, TrueHits):
        shift = pixel_mm * np.spacing(np.asarray(np.abs(true.pixel), np.float64)).sum(axis=1)
    for given in _inputs(display, true, arrays):
        unit = np.where(given.values == 0.0, 0.0, np.spacing(np.abs(given.values)))
        slopes = _slopes(given, true)
        if isinstance(true, TrueHits):
            shift += slopes[0] * pixel_mm * unit
            continue
        turn += slopes[0] * unit
        shift += slopes[1] * unit
        if given.array is not None:
            start += slopes[0] * (1.0 / pixel_mm, 1.0)[given.array]
    return Condition(shift / array.pitch_mm if isinstance(true, TrueHits) else turn, shift, start)


def on_edge(display: Display, true: Truth, arrays: Sequence[Floats], ulps: int) -> Bools:
    """Tell which rays get another fate (status or lenslet) when one input moves by `ulps` units of its last place.

    `arrays` as for `condition`; the last place is a float64's.
    """
    edge = np.zeros(len(true.status), bool)
    for given in _inputs(display, true, arrays):
        step = exact_array(np.spacing(np.abs(given.values))) * ulps
        for moved in (step, -step):
            edge |= _other_fate(given.traced(moved), true)
    return edge
