"""Random displays for the tests of the optics, and their numbers as truth.py wants them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import truth
from lippmann.display import Array, Display, Grid, Panel, PlanoSide

GRIDS: tuple[Grid, ...] = ("square", "hex")
SIDES: tuple[PlanoSide, ...] = ("panel", "viewer")
#: Elemental images right behind their lenslets, and such that converge on an eye.
eyes = pytest.mark.parametrize("converged", [False, True], ids=["far", "near"])
LONG_PI = np.longdouble("3.14159265358979323846264338327950288")

Floats = npt.NDArray[np.float64]


def display_of(
    grid: Grid,
    side: PlanoSide,
    *,
    pitch: float = 1.0,
    radius: float = 1.5,
    index: float = 1.5,
    thickness: float | None = 2.0,
    gap: float = 0.5,
    rotation: float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
    width_px: int = 200,
    height_px: int = 160,
    pixel_pitch: float = 0.0625,
    eye: float | None = None,
    axis: tuple[float, float] = (0.0, 0.0),
) -> Display:
    """A display of plain numbers, mm and degrees; thickness None is the thinnest lenslet."""
    array = Array(grid, pitch, radius, index, math.nan, side, None, rotation, offset)
    made = Array(
        grid,
        pitch,
        radius,
        index,
        array.sag_mm if thickness is None else thickness,
        side,
        None,
        rotation,
        offset,
    )
    return Display("case", Panel(width_px, height_px, pixel_pitch), made, gap, eye, axis)


def random_display(
    rng: np.random.Generator,
    grid: Grid,
    side: PlanoSide,
    *,
    steepest: float = 1.02,
    shallowest: float = 30.0,
    index: tuple[float, float] = (1.3, 2.4),
    widest_mm: float = 700.0,
    converged: bool = False,
) -> Display:
    """A display that could be built, drawn wide: pitch 0.1 to 5 mm, panels to 700 mm, any turn.

    R goes from `steepest` half diagonals (nearly hemispheres) logarithmically to `shallowest`; a
    third of the lenslets are as thin as can be, a third of the panels in contact. `converged`: on an
    eye from half a diagonal of the panel to ten times as far, which is off the panel's centre.
    """
    pitch = float(np.exp(rng.uniform(np.log(0.1), np.log(5.0))))
    rho = pitch / math.sqrt({"square": 2, "hex": 3}[grid])
    radius = rho * float(np.exp(rng.uniform(np.log(steepest), np.log(shallowest))))
    sag = rho**2 / (radius + math.sqrt(radius**2 - rho**2))
    n = float(rng.uniform(*index))
    focal = radius / (n - 1)
    thickness = None if rng.random() < 1 / 3 else sag + float(rng.uniform(0, 1.5 * radius))
    gap = 0.0 if rng.random() < 1 / 3 else float(rng.uniform(0, 1.5 * focal))
    pixel_pitch = pitch / float(rng.uniform(2, 40))
    sides = [int(min(rng.uniform(10, widest_mm) / pixel_pitch + 4, 65535)) for _ in range(2)]
    made = display_of(
        grid,
        side,
        pitch=pitch,
        radius=radius,
        index=n,
        thickness=thickness,
        gap=gap,
        rotation=float(rng.choice((0.0, 90.0, rng.uniform(-200, 200)))),
        offset=(float(rng.uniform(-pitch, pitch)), float(rng.uniform(-pitch, pitch))),
        width_px=sides[0],
        height_px=sides[1],
        pixel_pitch=pixel_pitch,
    )
    return with_random_eye(rng, made) if converged else made


def with_random_eye(rng: np.random.Generator, display: Display) -> Display:
    """The display, converged on an eye as `random_display` draws it."""
    panel = display.panel
    nearest = 4.0 * max(display.array.focal_length_mm, display.aperture_distance_mm)
    nearest = max(nearest, 0.5 * math.hypot(panel.width_mm, panel.height_mm))
    eye = 1.001 * nearest * float(np.exp(rng.uniform(0.0, math.log(20.0))))
    x, y = (float(side * rng.uniform(-0.6, 0.6)) for side in (panel.width_mm, panel.height_mm))
    return replace(display, viewing_distance_mm=eye, viewing_axis_mm=(x, y))


def random_pixels(rng: np.random.Generator, display: Display, n: int) -> Floats:
    """Points of the panel, (n, 2), half of them pixel centres."""
    size = (display.panel.width_px, display.panel.height_px)
    points = rng.uniform(0, size, (n, 2))
    points[: n // 2] = np.floor(points[: n // 2]) + 0.5
    return points


def random_in_cell(rng: np.random.Generator, display: Display, n: int) -> Floats:
    """Points spread evenly over a cell, (n, 2), mm, array's axes, from the lenslet's centre."""
    pitch = display.array.pitch_mm
    if display.array.grid == "square":
        return rng.uniform(-pitch / 2, pitch / 2, (n, 2))
    points = rng.uniform(-1, 1, (8 * n, 2)) * pitch * (0.5, 1 / math.sqrt(3))
    # Projections on 60 and 120 degrees; the one on 0 holds already.
    slanted = points @ np.array([[0.5, -0.5], [math.sqrt(0.75), math.sqrt(0.75)]])
    return points[np.abs(slanted).max(axis=1) < pitch / 2][:n]


def optics_of(display: Display) -> truth.Optics:
    """The display's numbers for truth.py; the rotation in radians with 50 digits."""
    array = display.array
    return truth.Optics(
        width_px=display.panel.width_px,
        height_px=display.panel.height_px,
        pixel_pitch_mm=display.panel.pixel_pitch_mm,
        grid=array.grid,
        pitch_mm=array.pitch_mm,
        radius_mm=array.radius_mm,
        index=array.index,
        thickness_mm=array.thickness_mm,
        gap_mm=display.gap_mm,
        plano_side=array.plano_side,
        rotation_rad=truth.mp.mpf(array.rotation_deg) * truth.mp.pi / 180,
        offset_mm=array.offset_mm,
        eye_mm=display.viewing_distance_mm,
        axis_mm=display.viewing_axis_mm,
    )


def long_optics_of(display: Display) -> dict[str, Any]:
    """The display's numbers as keywords of `truth.back_to_panel_many`."""
    array = display.array
    return {
        "hexagonal": array.grid == "hex",
        "plano_viewer": array.plano_side == "viewer",
        "pitch_mm": array.pitch_mm,
        "radius_mm": array.radius_mm,
        "index": array.index,
        "thickness_mm": array.thickness_mm,
        "gap_mm": display.gap_mm,
        "rotation_rad": np.longdouble(array.rotation_deg) * LONG_PI / 180,
        "offset_mm": array.offset_mm,
    }


def exit_cosine(display: Display, local_mm: Floats, direction: Floats) -> Floats:
    """Cosine between exit rays and the last face's normal, the dome's or the flat face's.

    local_mm as `Rays` has them: from the lenslet's centre, the dome's vertex at z = 0.
    """
    if display.array.plano_side == "viewer":
        return np.abs(direction[:, 2])
    normal = local_mm / display.array.radius_mm + (0, 0, 1)
    return np.abs((normal * direction).sum(axis=1))
