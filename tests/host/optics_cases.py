"""Random displays for the tests of the optics, and their numbers as truth.py wants them."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import truth
from lippmann.display.description import Array, Display, Panel
from lippmann.engines import trace, trace_fixed
from lippmann.fixed.conversion import aims_of_words, words_of_aims

GRIDS = ("square", "hex")
SIDES = ("panel", "viewer")
#: Regular arrays, such that converge on an eye, and such of two pitches and a shear, which may end and converge.
KINDS = ("far", "near", "skewed")
kinds = pytest.mark.parametrize("kind", KINDS)


def cases(several, most):
    """Each kind of display with each of several; at every commit all with kind "far", the other kinds with `most`."""
    return [
        pytest.param(kind, *one, marks=() if kind == "far" or one == most else pytest.mark.full)
        for kind in KINDS
        for one in several
    ]


somewhere = pytest.mark.parametrize(("kind", "grid", "side"), cases(itertools.product(GRIDS, SIDES), ("hex", "viewer")))


#: Of their seeds.
KEYS = {"far": [], "near": ["eye"], "skewed": ["skewed"]}
LONG_PI = np.longdouble("3.14159265358979323846264338327950288")


def display_of(
    grid, side, *, pitch=1.0, radius=1.5, index=1.5, thickness=2.0, gap=0.5, rotation=0.0, offset=(0.0, 0.0),
    width_px=200, height_px=160, pixel_pitch=0.0625, eye=None, axis=(0.0, 0.0), shear=0.0, row_pitch=None, extent=None,
):  # fmt: skip
    """A display of plain numbers, mm and degrees; thickness None is the thinnest lenslet."""
    pitches = pitch if row_pitch is None else (pitch, row_pitch)
    array = Array(grid, pitches, radius, index, thickness or radius, side, None, rotation, offset, shear, extent)
    made = replace(array, thickness_mm=array.sag_mm if thickness is None else thickness)
    return Display("case", Panel(width_px, height_px, pixel_pitch), made, gap, eye, axis)


def random_display(
    rng, grid, side, *, steepest=1.02, shallowest=30.0, index=(1.3, 2.4), widest_mm=700.0, kind="far", ends=True
):
    """A display that could be built, drawn wide: pitch 0.1 to 5 mm, panels to 700 mm, any turn.

    R goes from `steepest` half diagonals (nearly hemispheres) logarithmically to `shallowest`; a
    third of the lenslets are as thin as can be, a third of the panels in contact. `kind` "near": on an
    eye from half a diagonal of the panel to ten times as far, which is off the panel's centre; "skewed": rows 0.6 to
    1.6 pitches apart and sheared by up to 0.4, half of the arrays ending on the panel (if `ends`), half converged.
    """
    pitch = float(np.exp(rng.uniform(np.log(0.1), np.log(5.0))))
    rho = pitch / math.sqrt({"square": 2, "hex": 3}[grid])
    lattice = {}
    if kind == "skewed":
        shear = float(rng.choice((rng.uniform(-0.4, 0.4), rng.normal() * 0.002)))
        rows = pitch * float(rng.choice((rng.uniform(0.6, 1.6), 1.0 + rng.normal() * 0.002)))
        lattice = {"shear": shear, "row_pitch": rows}
        rho = farthest_corner(grid, pitch, rows, shear)
    radius = rho * float(np.exp(rng.uniform(np.log(steepest), np.log(shallowest))))
    sag = rho**2 / (radius + math.sqrt(radius**2 - rho**2))
    n = float(rng.uniform(*index))
    focal = radius / (n - 1)
    thickness = None if rng.random() < 1 / 3 else sag + float(rng.uniform(0, 1.5 * radius))
    gap = 0.0 if rng.random() < 1 / 3 else float(rng.uniform(0, 1.5 * focal))
    pixel_pitch = pitch / float(rng.uniform(2, 40))
    sides = [int(min(rng.uniform(10, widest_mm) / pixel_pitch + 4, 65535)) for _ in range(2)]
    lens = {"pitch": pitch, "radius": radius, "index": n, "thickness": thickness, "gap": gap}
    lens["rotation"] = float(rng.choice((0.0, 90.0, rng.uniform(-200, 200))))
    lens["offset"] = (float(rng.uniform(-pitch, pitch)), float(rng.uniform(-pitch, pitch)))
    panel = {"width_px": sides[0], "height_px": sides[1], "pixel_pitch": pixel_pitch}
    made = display_of(grid, side, **lens, **panel, **lattice)
    if kind == "skewed" and rng.random() < 0.5 and ends:
        # Lenslets that need not be many, and borders that run between lenslets and through them.
        sides = made.panel.width_mm, made.panel.height_mm
        extent = tuple(float(max(side * rng.uniform(0.3, 1.2), 2.1 * pitch)) for side in sides)
        made = replace(made, array=replace(made.array, extent_mm=extent))
    return with_random_eye(rng, made) if kind == "near" or (kind == "skewed" and rng.random() < 0.5) else made


def lattice(rng, kind, pitch):
    """Two pitches and a shear for `display_of`, if `kind` is "skewed": cells that a dome of a pitch's radius spans."""
    if kind != "skewed":
        return {}
    return {"shear": float(rng.uniform(-0.2, 0.2)), "row_pitch": pitch * float(rng.uniform(0.8, 1.2))}


def farthest_corner(grid, pitch, rows, shear):
    """Half the longest diagonal of a cell: of the regular cell's corners, brought to the lattice."""
    turns = np.radians({"square": [45, 135], "hex": [30, 90, 150]}[grid])
    x, y = np.stack([np.cos(turns), np.sin(turns)]) / math.sqrt({"square": 2, "hex": 3}[grid])
    return float(np.hypot(pitch * x + shear * rows * y, rows * y).max())


def with_random_eye(rng, display):
    """The display, converged on an eye as `random_display` draws it."""
    panel = display.panel
    nearest = 4.0 * max(display.array.focal_length_mm, display.aperture_distance_mm)
    nearest = max(nearest, 0.5 * math.hypot(panel.width_mm, panel.height_mm))
    eye = 1.001 * nearest * float(np.exp(rng.uniform(0.0, math.log(20.0))))
    x, y = (float(side * rng.uniform(-0.6, 0.6)) for side in (panel.width_mm, panel.height_mm))
    return replace(display, viewing_distance_mm=eye, viewing_axis_mm=(x, y))


def random_pixels(rng, display, n):
    """Points of the panel, (n, 2), half of them pixel centres."""
    size = (display.panel.width_px, display.panel.height_px)
    points = rng.uniform(0, size, (n, 2))
    points[: n // 2] = np.floor(points[: n // 2]) + 0.5
    return points


def random_in_cell(rng, display, n):
    """Points spread evenly over a cell, (n, 2), mm, array's axes, from the lenslet's centre."""
    pitch, rows = display.array.pitches_mm
    if display.array.grid == "square":
        points = rng.uniform(-pitch / 2, pitch / 2, (n, 2))
    else:
        points = rng.uniform(-1, 1, (8 * n, 2)) * pitch * (0.5, 1 / math.sqrt(3))
        # Projections on 60 and 120 degrees; the one on 0 holds already.
        slanted = points @ np.array([[0.5, -0.5], [math.sqrt(0.75), math.sqrt(0.75)]])
        points = points[np.abs(slanted).max(axis=1) < pitch / 2][:n]
    if display.array.regular:
        return points
    return points @ np.array([[1, 0], [display.array.shear * rows / pitch, rows / pitch]])


def _lens_numbers(display):
    """What both forms of truth.py call alike."""
    array = display.array
    numbers = {name: getattr(array, name) for name in ("shear", "radius_mm", "index", "thickness_mm", "offset_mm")}
    return numbers | {"pitch_mm": array.pitches_mm[0], "row_pitch_mm": array.pitches_mm[1], "gap_mm": display.gap_mm}


def optics_of(display):
    """The display's numbers for truth.py; the rotation in radians with 50 digits."""
    array, panel = display.array, display.panel
    return truth.Optics(
        **{name: getattr(panel, name) for name in ("width_px", "height_px", "pixel_pitch_mm")},
        **{name: getattr(array, name) for name in ("grid", "extent_mm", "plano_side")},
        **_lens_numbers(display),
        rotation_rad=truth.mp.mpf(array.rotation_deg) * truth.mp.pi / 180,
        eye_mm=display.viewing_distance_mm,
        axis_mm=display.viewing_axis_mm,
    )


def long_optics_of(display):
    """The display's numbers as keywords of `truth.back_to_panel_many`."""
    array = display.array
    return {
        "hexagonal": array.grid == "hex",
        "plano_viewer": array.plano_side == "viewer",
        "rotation_rad": np.longdouble(array.rotation_deg) * LONG_PI / 180,
        **_lens_numbers(display),
    }


def exit_cosine(display, local_mm, direction):
    """Cosine between exit rays and the last face's normal, the dome's or the flat face's.

    local_mm as `Rays` has them: from the lenslet's centre, the dome's vertex at z = 0.
    """
    if display.array.plano_side == "viewer":
        return np.abs(direction[:, 2])
    normal = local_mm / display.array.radius_mm + (0, 0, 1)
    return np.abs((normal * direction).sum(axis=1))


def trace_both(rng, display, count, aims, model="exact"):
    """The same random rays by the twin and by golden; their pixels and aims are words of the twin."""
    pixels, points = random_pixels(rng, display, count), None
    if aims:
        points = aims_of_words(display, *words_of_aims(display, random_in_cell(rng, display, count), 23), 23)
        pixels = pixels[: len(points)]
    twin = trace_fixed(display, pixels, points, model)
    return twin, trace(display, twin.pixel, points, model)


def twin_errors(display, twin, golden):
    """The angles between rays, over what is promised, max(1, 0.5 / cos) microradian; the exit points' errors, nm."""
    turn = np.linalg.norm(twin.direction - golden.direction, axis=1) * 1e6
    promised = np.maximum(1.0, 0.5 / exit_cosine(display, golden.local_mm, golden.direction))
    return turn / promised, np.linalg.norm(twin.local_mm - golden.local_mm, axis=1) * 1e6
