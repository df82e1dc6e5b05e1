"""Accuracy of the engines' formulas against a textbook's, both compared with 50 digits, in float64 and float32."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.conformance.fifty_digits import FiftyDigits, exact_array, mp
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.faces import Dome, Ray, meet, refract_flat
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel_frame import exact_rotation

Values = npt.NDArray[Any]

#: Rays of each comparison.
RAYS = 400
#: Radii of the domes, mm.
RADII = (1.5, 1e3, 1e6)
FORMATS: tuple[Any, ...] = (np.float64, np.float32)


Row = dict[str, Any]


def _gain(formula: str, where: str, number_format: str, unit: str, naive: float, chosen: float) -> Row:
    """Return a row: the largest error of a formula and of the naive one in `unit`, and their ratio."""
    row = {"formula": formula, "where": where, "number_format": number_format, "unit": unit}
    return row | {"naive": naive, "chosen": chosen, "gain": naive / chosen if chosen else None}


def _error(got: Any, true: Any, relative: bool = False) -> float:
    """Return the largest error of numbers or arrays against mpf."""
    error = exact_array(np.asarray(got, np.float64)) - true
    return float(np.max(np.abs(error / true if relative else error)))


def measure(seed: int) -> list[Row]:
    """Compare all formulas."""
    random = np.random.default_rng(seed)
    return [*_dome(random), *_sag(), *_flat(random), _panel(random), _quarter_turns(random)]


def _dome(random: np.random.Generator) -> Iterator[Row]:
    """Where a ray in the glass, 2 mm below, meets a dome: foot of the perpendicular, or the sphere's quadratic."""

    def height(b: Any, ray: Ray, R: Any) -> Values:
        return np.asarray(meet(b, Dome(Lattice("square", 4.0), R, 0.1), ray, upward=True).ray.z)

    for radius, kind in product(RADII, FORMATS):
        x, y, sx, sy = (column.astype(kind) for column in random.uniform(-0.2, 0.2, (4, RAYS)))
        scale = 1 / np.sqrt(1 + sx * sx + sy * sy)
        ray = Ray(x, y, np.full_like(x, -2.0), sx * scale, sy * scale, scale)
        # Sphere |p - C| = R around C = (0, 0, -R): t^2 + 2 b t + c = 0.
        oz = ray.z + kind(radius)
        b = ray.x * ray.dx + ray.y * ray.dy + oz * ray.dz
        c = ray.x * ray.x + ray.y * ray.y + oz * oz - kind(radius) * kind(radius)
        naive = ray.z + (-b + np.sqrt(np.maximum(b * b - c, 0))) * ray.dz
        true = height(FiftyDigits(), Ray(*(exact_array(v.astype(np.float64)) for v in ray)), mp.mpf(radius))
        errors = (_error(z, true) * 1e6 for z in (naive, height(NumpyBackend(), ray, radius)))
        yield _gain("perpendicular foot", f"R = {radius:g} mm", kind.__name__, "nm", *errors)


def _sag() -> Iterator[Row]:
    """Depth of a dome: rho^2 / (R + d), or R - d."""
    for radius, kind in product(RADII, FORMATS):
        R, rho = kind(radius), kind(0.5**0.5)
        d = np.sqrt((R - rho) * (R + rho))
        true = mp.mpf(float(R)) - mp.sqrt(mp.mpf(float(R)) ** 2 - mp.mpf(float(rho)) ** 2)
        errors = (_error(sag, true, relative=True) for sag in (R - d, rho * rho / (R + d)))
        yield _gain("sag as rho^2 / (R + d)", f"R = {radius:g} mm", kind.__name__, "relative", *errors)


def _flat(random: np.random.Generator) -> Iterator[Row]:
    """Squared cosine behind a flat face near the onset of total reflection: (1 - k)(1 + k), or 1 - k^2."""
    for kind, nearest in zip(FORMATS, (-15, -7), strict=True):
        k = (1.0 - 10.0 ** random.uniform(nearest, -1.0, RAYS)).astype(kind)
        zero = np.zeros_like(k)
        _, square = refract_flat(NumpyBackend(), Ray(zero, zero, zero, k, zero, zero + kind(0.5)), 1.0)
        exact_k = exact_array(k.astype(np.float64))
        errors = (_error(got, 1 - exact_k * exact_k, relative=True) for got in (1 - k * k, square))
        yield _gain("(1 - k)(1 + k)", f"within 10^{nearest} of the onset", kind.__name__, "relative", *errors)


def _panel(random: np.random.Generator) -> Row:
    """Where in its lenslet a pixel of a 700 mm panel is: in float64 until the centre is taken off, or in float32."""
    pitch, pixel = 0.5, 0.1
    u = random.integers(0, 7000, RAYS) + 0.5

    def local(u: Values, pixel: Any, pitch: Any, floor: Callable[[Any], Any]) -> Values:
        x = (u - 3500.0) * pixel
        return np.asarray(x - floor(x / pitch + 0.5) * pitch)

    true = local(exact_array(u), mp.mpf(pixel), mp.mpf(pitch), np.frompyfunc(mp.floor, 1, 1))
    # A tie may go either way in float32: the same point, measured from the next centre.
    naive = local(u.astype(np.float32), np.float32(pixel), np.float32(pitch), np.floor)
    chosen = local(u, pixel, pitch, np.floor).astype(np.float32)

    def worst(got: Values) -> float:
        apart = np.abs(np.asarray(exact_array(np.asarray(got, np.float64)) - true, np.float64))
        return float(np.minimum(apart, np.abs(apart - pitch)).max()) * 1e6

    return _gain("float64 until lens-local", "700 mm panel", "float32", "nm", worst(naive), worst(chosen))


def _quarter_turns(random: np.random.Generator) -> Row:
    """Points on the edges of an array turned by 90 degrees that change owners: exact turns, or cos and sin of pi/2."""
    x, y = random.integers(-400, 401, (2, RAYS)) / 2.0

    def strays(cos: float, sin: float) -> float:
        turned = cos * x + sin * y
        return float((np.floor(turned + 0.5) != np.floor(y + 0.5)).sum())

    naive = strays(float(np.cos(np.pi / 2)), float(np.sin(np.pi / 2)))
    chosen = strays(*exact_rotation(90.0))
    return _gain("exact quarter turns", "edges, 90 degrees", "float64", f"rays of {RAYS}", naive, chosen)
