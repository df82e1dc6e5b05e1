"""The truth in 50 digits, and what one rounding of each input makes of a ray.

The optics are written once over arrays of any kind (`lippmann.optics.backend`); here their numbers are mpmath's. What
golden rounds away is its distance from this. That the formulas are the right ones is not known from here: the tests
hold these 50 digits to an independent tracer that shares no formula (tests/host/truth.py).

**Condition.** A ray's unit is how far it moves, in direction or in exit point, when each of its inputs (pixel,
aperture point, the display's numbers) moves by one unit of its last place: the sum of all, and one more of the result
itself (of an exit point: of the lenslet's pitch or thickness, for it is found from there). An engine that stays within
k units has found, but for k roundings, the exact ray of inputs that are at most k roundings away. Nothing that computes
with the same words can promise more.
"""

from __future__ import annotations

import dataclasses
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

#: Relative step of the differences that give a ray's condition: far below a float64's last place, far above 50 digits'.
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
    """A display's numbers that decide where rays go, as mpf: mm and degrees."""

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
        return cls(
            array.grid,
            array.plano_side == "panel",
            panel.width_px,
            panel.height_px,
            *(
                mp.mpf(value)
                for value in (
                    panel.pixel_pitch_mm,
                    array.pitch_mm,
                    array.radius_mm,
                    array.index,
                    array.thickness_mm,
                    display.gap_mm,
                    array.rotation_deg,
                    *array.offset_mm,
                )
            ),
        )

    def system(self) -> System:
        """Return the system that the optics take, its numbers mpf (docs/reference/optics.md gives each formula)."""
        # mpf where the optics say float: they compute with whatever they are given.
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


def true_rays(numbers: Numbers, pixels: Digits, aperture: Digits | None, model: Model = "exact") -> TrueRays:
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
    origin, way = (tuple(b.real(a[:, k]) for k in range(3)) for a in (origin_mm, direction))
    hits = pixels_from_rays(b, numbers.system(), origin, way, "exact")
    return TrueHits(
        np.stack([hits.u, hits.v], axis=1), np.stack([hits.i, hits.j], axis=1), np.asarray(hits.status, np.int64)
    )


def size(vectors: Digits) -> Floats:
    """Return the length of each row of an array of mpf, (N,) float64."""
    squares = (vectors * vectors).sum(axis=1)
    return np.asarray(_root(squares), np.float64)


class Condition(NamedTuple):
    """How far rays move for one unit in the last place of every input, (N,) float64.

    turn
        Radians, roundings of a unit vector included.
    shift_mm
        Of the exit point, lens-local, mm.
    start
        Radians for one mm at the start of the ray and at its aperture point: what makes a rounding of lens-local
        coordinates count.
    """

    turn: Floats
    shift_mm: Floats
    start: Floats


def condition(display: Display, pixels: Floats, aperture: Floats | None, true: TrueRays) -> Condition:
    """Return the condition of rays of model `exact`, from differences in 50 digits.

    An input of 0 has no last place. Where a step of an input leads to another lenslet or status, its other side counts.
    """
    numbers = Numbers.of(display)
    n = len(pixels)
    ulp = float(np.spacing(1.0))
    array = display.array
    whole = float(np.spacing(max(array.pitch_mm, array.thickness_mm)))
    turn, shift, start = np.full(n, ulp), np.full(n, whole), np.zeros(n)

    def add(moved: Any, step: Digits, unit: Any, per_mm: float = 0.0) -> None:
        """Add one input's share: `moved(step)` traces with the input moved by `step`."""
        rays = moved(step)
        other = (rays.status != true.status) | (rays.lenslet != true.lenslet).any(axis=1)
        direction, local = rays.direction - true.direction, rays.local_mm - true.local_mm
        if other.any():
            back = moved(-step)
            direction[other] = (back.direction - true.direction)[other]
            local[other] = (back.local_mm - true.local_mm)[other]
            lost = (back.status != true.status) | (back.lenslet != true.lenslet).any(axis=1)
            direction[other & lost] = local[other & lost] = mp.mpf(0)
        slope, path = size(direction / step), size(local / step)
        turn[:] += slope * unit
        shift[:] += path * unit
        start[:] += slope * per_mm

    exact = exact_array(pixels)
    for k in range(2):
        column = np.eye(2)[k]
        per_mm = 1.0 / display.panel.pixel_pitch_mm
        add(
            lambda step, column=column: true_rays(numbers, exact + step * column, aperture),
            STEP,
            np.where(pixels[:, k] == 0.0, 0.0, np.spacing(np.abs(pixels[:, k]))),
            per_mm,
        )
    if aperture is not None:
        aims = exact_array(aperture)
        for k in range(2):
            column = np.eye(2)[k]
            add(
                lambda step, column=column: true_rays(numbers, exact, aims + step * column),
                STEP,
                np.where(aperture[:, k] == 0.0, 0.0, np.spacing(np.abs(aperture[:, k]))),
                1.0,
            )
    for name in MOVED:
        value = getattr(numbers, name)
        if value == 0:
            continue
        add(
            lambda step, name=name, value=value: true_rays(
                dataclasses.replace(numbers, **{name: value + step}), exact, aperture
            ),
            STEP * abs(value),
            float(np.spacing(abs(float(value)))),
        )
    return Condition(turn, shift, start)


def hit_condition(display: Display, origin_mm: Floats, direction: Floats, true: TrueHits) -> Floats:
    """Return how far rays from the world move on the panel, mm, for one unit in the last place of every input: (N,)."""
    numbers = Numbers.of(display)
    pitch = display.panel.pixel_pitch_mm
    total: Floats = pitch * np.spacing(np.asarray(np.abs(true.pixel), np.float64)).sum(axis=1)

    def add(moved: Any, step: Digits, unit: Any) -> None:
        hits = moved(step)
        other = (hits.status != true.status) | (hits.lenslet != true.lenslet).any(axis=1)
        apart = hits.pixel - true.pixel
        if other.any():
            back = moved(-step)
            apart[other] = (back.pixel - true.pixel)[other]
            lost = (back.status != true.status) | (back.lenslet != true.lenslet).any(axis=1)
            apart[other & lost] = mp.mpf(0)
        total[:] += size(apart / step) * pitch * unit

    inputs = (origin_mm, direction)
    for which, k in ((which, k) for which in range(2) for k in range(3)):
        column = np.eye(3)[k]

        def moved(step: Digits, which: int = which, column: Any = column) -> TrueHits:
            rays = [exact_array(values) for values in inputs]
            rays[which] = rays[which] + step * column
            return true_hits(numbers, rays[0], rays[1])

        values = inputs[which][:, k]
        add(moved, STEP, np.where(values == 0.0, 0.0, np.spacing(np.abs(values))))
    for name in MOVED:
        value = getattr(numbers, name)
        if value != 0:
            add(
                lambda step, name=name, value=value: true_hits(
                    dataclasses.replace(numbers, **{name: value + step}), origin_mm, direction
                ),
                STEP * abs(value),
                float(np.spacing(abs(float(value)))),
            )
    return total


def on_edge(display: Display, pixels: Floats, aperture: Floats | None, true: TrueRays, ulps: int) -> Bools:
    """Tell which rays get another fate (status or lenslet) when one input moves by `ulps` units of its last place."""
    numbers = Numbers.of(display)
    edge = np.zeros(len(pixels), bool)

    def tried(rays: TrueRays) -> None:
        edge[:] |= (rays.status != true.status) | (rays.lenslet != true.lenslet).any(axis=1)

    for sign in (-ulps, ulps):
        for k in range(2):
            column = np.eye(2)[k]
            tried(true_rays(numbers, pixels + sign * np.spacing(np.abs(pixels)) * column, aperture))
            if aperture is not None:
                tried(true_rays(numbers, pixels, aperture + sign * np.spacing(np.abs(aperture)) * column))
        for name in MOVED:
            value = float(getattr(numbers, name))
            if value:
                step = mp.mpf(sign) * float(np.spacing(abs(value)))
                tried(true_rays(dataclasses.replace(numbers, **{name: value + step}), pixels, aperture))
    return edge


def hit_on_edge(display: Display, origin_mm: Floats, direction: Floats, true: TrueHits, ulps: int) -> Bools:
    """As `on_edge`, of rays from the world."""
    numbers = Numbers.of(display)
    edge = np.zeros(len(origin_mm), bool)

    def tried(hits: TrueHits) -> None:
        edge[:] |= (hits.status != true.status) | (hits.lenslet != true.lenslet).any(axis=1)

    for sign in (-ulps, ulps):
        for k in range(3):
            column = np.eye(3)[k]
            tried(true_hits(numbers, origin_mm + sign * np.spacing(np.abs(origin_mm)) * column, direction))
            tried(true_hits(numbers, origin_mm, direction + sign * np.spacing(np.abs(direction)) * column))
        for name in MOVED:
            value = float(getattr(numbers, name))
            if value:
                step = mp.mpf(sign) * float(np.spacing(abs(value)))
                tried(true_hits(dataclasses.replace(numbers, **{name: value + step}), origin_mm, direction))
    return edge
