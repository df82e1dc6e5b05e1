"""Accuracy of the engines' formulas against a textbook's, both compared with 50 digits, in float64 and float32."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.conditioning.digits import FiftyDigits, exact_array, mp
from lippmann.optics.aim import Ray
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.dome import Dome, meet
from lippmann.optics.flat import refract_flat
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import exact_rotation

Values = npt.NDArray[Any]

#: Rays of each comparison.
RAYS = 400
FORMATS: tuple[Any, ...] = (np.float64, np.float32)


@dataclass(frozen=True)
class Gain:
    """A formula and the naive one: the largest error of each in `unit`, and the ratio (None: no error of ours)."""

    formula: str
    where: str
    number_format: str
    unit: str
    naive: float
    chosen: float
    gain: float | None


def _gain(formula: str, where: str, kind: Any, unit: str, naive: float, chosen: float) -> Gain:
    return Gain(formula, where, kind.__name__, unit, naive, chosen, naive / chosen if chosen else None)


def _error(got: Values, wanted: Values, scale: float) -> float:
    return float(np.abs(exact_array(np.asarray(got, np.float64)) - wanted).max()) * scale


def measure(seed: int) -> list[Gain]:
    """Compare all formulas."""
    random = np.random.default_rng(seed)
    return [*_dome(random), *_sag(), *_flat(random), *_panel(random), *_quarter_turns(random)]


def _dome(random: np.random.Generator) -> list[Gain]:
    """Where a ray in the glass, 2 mm below, meets a dome: foot of the perpendicular, or the sphere's quadratic."""
    gains = []
    for radius in (1.5, 1e3, 1e6):
        for kind in FORMATS:
            x, y, sx, sy = (column.astype(kind) for column in random.uniform(-0.2, 0.2, (4, RAYS)))
            scale = 1 / np.sqrt(1 + sx * sx + sy * sy)
            ray = Ray(x, y, np.full_like(x, -2.0), sx * scale, sy * scale, scale)

            def chosen(b: Any, ray: Ray, R: Any) -> Values:
                lattice = Lattice("square", 4.0)
                return np.asarray(meet(b, Dome(lattice, R, 0.1), ray, upward=True).ray.z)

            # Sphere |p - C| = R around C = (0, 0, -R): t^2 + 2 b t + c = 0.
            oz = ray.z + kind(radius)
            b = ray.x * ray.dx + ray.y * ray.dy + oz * ray.dz
            c = ray.x * ray.x + ray.y * ray.y + oz * oz - kind(radius) * kind(radius)
            z = ray.z + (-b + np.sqrt(np.maximum(b * b - c, 0))) * ray.dz
            true = chosen(FiftyDigits(), Ray(*(exact_array(v.astype(np.float64)) for v in ray)), mp.mpf(radius))
            where = f"R = {radius:g} mm"
            got = chosen(NumpyBackend(), ray, radius)
            gains.append(_gain("perpendicular foot", where, kind, "nm", _error(z, true, 1e6), _error(got, true, 1e6)))
    return gains


def _sag() -> list[Gain]:
    """Depth of a dome: rho^2 / (R + d), or R - d."""
    gains = []
    for radius in (1.5, 1e3, 1e6):
        for kind in FORMATS:
            R: Any = kind(radius)
            rho: Any = kind(0.5**0.5)
            d = np.sqrt((R - rho) * (R + rho))
            true = mp.mpf(float(R)) - mp.sqrt(mp.mpf(float(R)) ** 2 - mp.mpf(float(rho)) ** 2)
            naive, chosen = (float(abs(mp.mpf(float(s)) - true) / true) for s in (R - d, rho * rho / (R + d)))
            gains.append(_gain("sag as rho^2 / (R + d)", f"R = {radius:g} mm", kind, "relative", naive, chosen))
    return gains


def _flat(random: np.random.Generator) -> list[Gain]:
    """Squared cosine behind a flat face near the onset of total reflection: (1 - k)(1 + k), or 1 - k^2."""
    gains = []
    for kind in FORMATS:
        k = (1.0 - 10.0 ** random.uniform(-15.0 if kind is np.float64 else -7.0, -1.0, RAYS)).astype(kind)
        zero = np.zeros_like(k)
        ray = Ray(zero, zero, zero, k, zero, zero + kind(0.5))
        _, square = refract_flat(NumpyBackend(), ray, 1.0)
        exact_k = exact_array(k.astype(np.float64))
        true = 1 - exact_k * exact_k
        naive, chosen = (
            float(np.abs((exact_array(np.asarray(s, np.float64)) - true) / true).max()) for s in (1 - k * k, square)
        )
        where = "within 10^-15 of the onset" if kind is np.float64 else "within 10^-7 of the onset"
        gains.append(_gain("(1 - k)(1 + k)", where, kind, "relative", naive, chosen))
    return gains


def _panel(random: np.random.Generator) -> list[Gain]:
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

    return [_gain("float64 until lens-local", "700 mm panel", np.float32, "nm", worst(naive), worst(chosen))]


def _quarter_turns(random: np.random.Generator) -> list[Gain]:
    """Points on the edges of an array turned by 90 degrees that change owners: exact turns, or cos and sin of pi/2."""
    x, y = random.integers(-400, 401, (2, RAYS)) / 2.0

    def strays(cos: float, sin: float) -> float:
        turned = cos * x + sin * y
        return float((np.floor(turned + 0.5) != np.floor(y + 0.5)).sum())

    naive = strays(float(np.cos(np.pi / 2)), float(np.sin(np.pi / 2)))
    chosen = strays(*exact_rotation(90.0))
    return [_gain("exact quarter turns", "edges, 90 degrees", np.float64, f"rays of {RAYS}", naive, chosen)]
