"""Random displays that fit the registers, and random and adversarial rays for them, all from one seed.

The RTL is compared with its twin on them (tests/rtl, `make mutation`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from lippmann.display import NEAREST_EYE, Array, Display, Grid, Panel
from lippmann.errors import InputError, LippmannError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.words import Ints
from lippmann.optics.rays import Model

#: The largest distance of random aims from their lenslet's centre, in pitches: the corner of [-3/4, 3/4]^2.
REACH = 1.07


def random_display(random: np.random.Generator, grid: Grid, viewer: bool, converge: bool = False) -> Display:
    """Return optics near the limits of the registers: strong and weak domes, thick and thin, rotated and shifted.

    With `converge` most have an eye nearby, in front of any point of the panel.
    """
    pitch = float(np.exp(random.uniform(np.log(0.3), np.log(3.0))))
    rho = pitch / (np.sqrt(2.0) if grid == "square" else np.sqrt(3.0))
    radius = rho * float(np.exp(random.uniform(np.log(1.02), np.log(20.0))))
    sag = rho**2 / (radius + np.sqrt(radius**2 - rho**2))
    array = Array(
        grid=grid,
        pitch_mm=pitch,
        radius_mm=radius,
        index=float(random.uniform(1.17, 2.19)),
        thickness_mm=float(sag + random.choice([0.0, 1.0]) * random.uniform(0.0, 3.5) * radius),
        plano_side="viewer" if viewer else "panel",
        rotation_deg=float(random.choice([0.0, 30.0, 90.0, random.uniform(0.0, 360.0)])),
        offset_mm=(float(random.uniform(-pitch, pitch)), float(random.uniform(-pitch, pitch))),
    )
    size = int(random.integers(100, 8000))
    panel = Panel(size, size, pitch / float(random.uniform(4.5, 60.0)))
    display = Display("random", panel, array, float(random.choice([0.0, random.uniform(0.3, 4.0) * pitch])))
    if not converge or random.random() < 0.1:
        return display
    nearest = max(NEAREST_EYE * array.focal_length_mm, 7.0 * display.aperture_distance_mm)
    eye = max(1.001 * nearest, panel.width_mm * float(np.exp(random.uniform(np.log(0.4), np.log(8.0)))))
    axis = random.choice([0.0, 1.0]) * random.uniform(-0.5, 0.5, 2) * panel.width_mm
    return replace(display, viewing_distance_mm=eye, viewing_axis_mm=(float(axis[0]), float(axis[1])))


def configured_display(random: np.random.Generator, build: Build, model: Model) -> tuple[Display, Configuration]:
    """Return a random display that fits the registers, and its registers."""
    for _ in range(1000):
        display = random_display(random, build.grid, build.viewer, build.converge)
        try:
            return display, configuration(display, build, model, REACH * display.array.pitch_mm)
        except InputError:
            continue
    raise LippmannError("no random display fits the registers")


def random_rays(
    random: np.random.Generator, display: Display, build: Build, count: int
) -> tuple[Ints, Ints, Ints, Ints]:
    """Return pixel and aim words (count,): the whole panel, aims over a cell and a half, a third on edges and axes."""
    half = 8 * np.array([display.panel.width_px, display.panel.height_px])
    u, v = (random.integers(-half[k], half[k] + 1, count) for k in range(2))
    one = 1 << build.fraction_bits
    aims = random.integers(-int(0.75 * one), int(0.75 * one) + 1, (2, count))
    # Aims within a unit of the last place of cell edges, corners, hexagon vertices and the axis.
    places = np.array([-one // 2, one // 2, 0, one // 3, -one // 3, 2 * one // 3, -2 * one // 3, one // 4, -one // 4])
    for words in aims:
        hard = random.random(count) < 1.0 / 3.0
        words[:] = np.where(hard, random.choice(places, count) + random.integers(-1, 2, count), words)
    # The panel's centre and corners.
    corner = random.random(count) < 0.01
    u = np.where(corner, random.choice([-half[0], 0, half[0]], count), u)
    v = np.where(corner, random.choice([-half[1], 0, half[1]], count), v)
    a, b = aims if build.aims else np.zeros_like(aims)
    return u, v, a, b
