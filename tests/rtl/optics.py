"""Displays and rays for the tests of the whole way of a ray."""

from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.display.description import Array, Display, Panel
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.ray_start import lenslet_hex, lenslet_square, pixel_to_lattice
from lippmann.fixed.words import PIXEL_BITS
from random_cases import random_lattice
from words import Ints, around, mixed, signed

PIXELS = signed(PIXEL_BITS)
#: Of an array of which the lattice alone counts.
KEYS = {"radius_mm": 1.0, "index": 1.5, "thickness_mm": 1.0}


def display(build: Build, **numbers: Any) -> Display:
    """A display for a build, mm: pitch, radius (None: 1.2 half diagonals), index, thickness (None: thinnest), gap,
    rotation, offset, shear, extent, eye, axis.
    """
    n = {"pitch": 1.0, "radius": 1.2, "index": 1.5, "thickness": None, "gap": 0.4, "rotation": 0.0, "offset": (0, 0)}
    n |= {"shear": 0.0, "extent": None, **numbers}
    side = "viewer" if build.viewer else "panel"

    def array(thickness: float) -> Array:
        given = (n["pitch"], n["radius"], n["index"], thickness, side, None, n["rotation"], n["offset"])
        return Array(build.grid, *given, shear=n["shear"], extent_mm=n["extent"])

    if n["radius"] is None:
        n["radius"] = 1.0
        n["radius"] = 1.2 * array(1.0).half_diagonal_mm
    thickness = array(1.0).sag_mm if n["thickness"] is None else n["thickness"]
    panel = Panel(400, 300, array(1.0).finest_mm / n.get("across", 9.3))
    return Display("case", panel, array(thickness), n["gap"], n.get("eye"), n.get("axis", (0.0, 0.0)))


def random_configuration(rng: np.random.Generator, build: Build) -> Configuration:
    """The registers of a random display that the formats hold; steep lenslets more often than flat ones."""
    for _ in range(1000):
        steep = rng.choice([0.62, 0.75, 1.2, 3.0])
        lattice = random_lattice(rng, 1.0, build.shear)
        long = max(1.0, Array(build.grid, **KEYS, **lattice).half_diagonal_mm / 0.62)
        numbers = {
            "pitch": lattice["pitch_mm"],
            "shear": lattice.get("shear", 0.0),
            "extent": tuple(rng.uniform(1.0, 60.0, 2)) if rng.random() < 0.3 else None,
            "radius": steep * (1 + 0.1 * rng.random()) * long,
            "index": rng.uniform(1.2, 2.1),
            "gap": rng.choice([0.0, 0.1, 0.6, 2.0]) * rng.random() if not build.viewer else rng.uniform(0.2, 2.0),
            "thickness": rng.choice([None, 0.8, 2.0]),
            "rotation": rng.choice([0.0, 0.0, rng.uniform(-30, 30)]),
            "offset": tuple(rng.uniform(-0.5, 0.5, 2)),
            "across": rng.choice([8, 20, 9.3]),
        }
        if build.converge:
            # Half of the panel's diagonal is 10 to 33 mm.
            numbers["eye"] = rng.uniform(1.0, 2.0) * rng.choice([12.0, 25.0, 100.0]) if rng.random() < 0.8 else None
            numbers["axis"] = tuple(rng.choice([0.0, 1.0]) * rng.uniform(-20.0, 20.0, 2))
        try:
            return configuration(display(build, **numbers), build, build.model)
        except (InputError, ValueError):
            continue
    raise AssertionError(f"no display for {build}")


def ray_words(
    rng: np.random.Generator, count: int, build: Build, config: Configuration
) -> tuple[Ints, Ints, Ints, Ints]:
    """Pixels all over the words' range, near the axis, at its ends; aims all over the own cell and beyond."""
    f = build.fraction_bits
    panel = (-(1 << 12), 1 << 12)
    u, v = mixed(rng, count, PIXELS, PIXELS)
    near = rng.random(len(u)) < 0.8
    u, v = (np.where(near, rng.integers(*panel, len(u)), w) for w in (u, v))
    reach = 3 << (f - 1)
    a, b = rng.integers(-(1 << (f - 1)), 1 << (f - 1), (2, len(u)))
    far = rng.random(len(u)) < 0.3
    a, b = (np.where(far, rng.integers(-reach, reach, len(u)), w) for w in (a, b))
    edge = around(np.arange(-3, 4) << (f - 1), 1, -reach, reach)
    on = rng.random(len(u)) < 0.2
    a, b = np.where(on, rng.choice(edge, len(u)), a), np.where(on, rng.choice(edge, len(u)), b)
    kept = within(u, v, a, b, build, config)
    assert kept.sum() > len(u) // 10
    return u[kept], v[kept], a[kept], b[kept]


def within(u: Ints, v: Ints, a: Ints, b: Ints, build: Build, config: Configuration) -> npt.NDArray[np.bool_]:
    """Which rays the host lets pass: less steep than 60 degrees, and met less than 4 radii from the axis."""
    f = build.fraction_bits
    locate = lenslet_hex if build.grid == "hex" else lenslet_square
    lattice = [
        pixel_to_lattice(u, v, *(getattr(config, f"{axis}_{name}") for name in ("from_u", "from_v", "offset")), f)[0]
        for axis in "xy"
    ]
    own_i, own_j, *own, _ = locate(*lattice, f)
    aimed = (a, b) if build.aims else (np.zeros_like(a), np.zeros_like(b))
    step_i, step_j, *local, _ = locate(*aimed, f)
    shift = (step_i + (step_j / 2 if build.grid == "hex" else 0), step_j)
    unit = float(1 << f)
    slope, point, inside = [], [], np.ones(len(u), bool)
    lens_i, lens_j = own_i + step_i, own_j + step_j
    centre = (lens_i + (lens_j / 2 if build.grid == "hex" else 0), lens_j)
    share = config.converge_share / (unit * (1 << 11))
    starts, ends = [], []
    for axis, pixel, moved, aim, c in zip("xy", own, shift, local, centre, strict=True):
        x = pixel / unit - moved
        if build.converge:
            x = x + share * c + getattr(config, f"converge_{axis}") / (4 * unit)
            inside &= np.abs(x) < 7.99
        starts.append(x)
        ends.append(aim / unit)
    if build.shear:
        for place in (starts, ends):
            place[0] = place[0] + config.shear_x / unit * place[1]
            inside &= np.abs(place[0]) < 7.99
    for axis, x, to in zip("xy", starts, ends, strict=True):
        k, m, p, q = (getattr(config, f"{name}_{axis}") / unit for name in ("slope", "slope_aim", "point", "point_aim"))
        slope.append(k * (to - x) if build.model == "exact" and not build.converge else k * x + m * to)
        point.append(p * x + q * to)
    return inside & (np.hypot(*slope) < 1.732) & (np.hypot(*point) < 3.99)
