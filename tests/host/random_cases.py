"""Random displays that fit the registers, and random and adversarial rays for them, all from one seed.

The RTL is compared with its twin on them (tests/rtl, `make mutation`).
"""

from dataclasses import replace

import numpy as np
from lippmann.display.description import NEAREST_EYE, Array, Display, Panel
from lippmann.errors import InputError, LippmannError
from lippmann.fixed.configuration import configuration

#: The largest coordinates of random aims, in pitches and rows.
AIMS = 0.75


def reach_mm(array):
    """Return the largest distance of random aims from their lenslet's centre, in [-AIMS, AIMS]^2."""
    row = array.row_pitch_mm
    return 1.01 * AIMS * float(np.hypot(array.pitches_mm[0] + abs(array.shear) * row, row))


def random_lattice(random, pitch, shear):
    """Return the keys of a random lattice: one pitch, two close ones, or any two; with `shear` a shear up to 1."""
    ratio = np.exp(random.choice([0.0, 0.0, 0.001, 1.0]) * random.uniform(-np.log(4.0), np.log(4.0)))
    lattice = {"pitch_mm": (pitch, float(pitch * ratio)) if ratio != 1.0 else pitch}
    if shear:
        lattice["shear"] = float(random.choice([0.0, 0.001, 0.3, 1.0, 1.0]) * random.uniform(-1.0, 1.0))
    return lattice


def random_display(random, grid, viewer, converge=False, shear=False):
    """Return optics near the limits of the registers: strong and weak domes, thick and thin, rotated and shifted.

    Half of the lattices have two pitches, and with `shear` most have one; a third of the arrays end on the panel. With
    `converge` most have an eye nearby, in front of any point of the panel.
    """
    pitch = float(np.exp(random.uniform(np.log(0.3), np.log(3.0))))
    array = Array(
        grid=grid,
        **random_lattice(random, pitch, shear),
        radius_mm=1.0,
        index=float(random.uniform(1.17, 2.19)),
        thickness_mm=1.0,
        plano_side="viewer" if viewer else "panel",
        rotation_deg=float(random.choice([0.0, 30.0, 90.0, random.uniform(0.0, 360.0)])),
        offset_mm=(float(random.uniform(-pitch, pitch)), float(random.uniform(-pitch, pitch))),
    )
    steepest, shallowest = array.half_diagonal_mm * 1.02, array.half_diagonal_mm * 20.0
    array = replace(array, radius_mm=float(np.exp(random.uniform(np.log(steepest), np.log(shallowest)))))
    thicker = float(random.choice([0.0, 1.0]) * random.uniform(0.0, 3.5) * array.radius_mm)
    size = int(random.integers(100, 8000))
    panel = Panel(size, size, array.finest_mm / float(random.uniform(4.5, 60.0)))
    if random.random() < 1.0 / 3.0:
        across, up = random.uniform(0.0, 1.2, 2) * panel.width_mm
        extent = float(max(across, array.pitches_mm[0])), float(max(up, array.row_pitch_mm))
        array = replace(array, extent_mm=extent)
    array = replace(array, thickness_mm=array.sag_mm + thicker)
    display = Display("random", panel, array, float(random.choice([0.0, random.uniform(0.3, 4.0) * pitch])))
    if not converge or random.random() < 0.1:
        return display
    nearest = max(NEAREST_EYE * array.focal_length_mm, 7.0 * display.aperture_distance_mm)
    eye = max(1.001 * nearest, panel.width_mm * float(np.exp(random.uniform(np.log(0.4), np.log(8.0)))))
    axis = random.choice([0.0, 1.0]) * random.uniform(-0.5, 0.5, 2) * panel.width_mm
    return replace(display, viewing_distance_mm=eye, viewing_axis_mm=(float(axis[0]), float(axis[1])))


def configured_display(random, build, model):
    """Return a random display that fits the registers, and its registers."""
    for _ in range(1000):
        display = random_display(random, build.grid, build.viewer, build.converge, build.shear)
        try:
            return display, configuration(display, build, model, reach_mm(display.array))
        except InputError:
            continue
    raise LippmannError("no random display fits the registers")


def random_rays(random, display, build, count):
    """Return pixel and aim words (count,): the whole panel, aims over a cell and a half, a third on edges and axes."""
    half = 8 * np.array([display.panel.width_px, display.panel.height_px])
    u, v = (random.integers(-half[k], half[k] + 1, count) for k in range(2))
    one = 1 << build.fraction_bits
    aims = random.integers(-int(AIMS * one), int(AIMS * one) + 1, (2, count))
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
