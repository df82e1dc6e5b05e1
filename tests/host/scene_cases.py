"""Small scenes and displays for the tests of renderer and observer."""

import dataclasses
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.display.description import Display, Grid, PlanoSide
from lippmann.eye.observer import Window
from optics_cases import display_of

Floats = npt.NDArray[np.float64]


def generator(seed: int, *key: int | str) -> np.random.Generator:
    """A generator of its own for each case; pytest shows the line when the case fails."""
    seeds = [seed, *(sum(map(ord, k)) if isinstance(k, str) else k for k in key)]
    print(f"numpy.random.default_rng({seeds})")
    return np.random.default_rng(seeds)


def focused_display(
    grid: Grid,
    side: PlanoSide = "panel",
    *,
    focal: float = 2.0,
    pitch: float = 1.0,
    index: float = 1.5,
    subpixels: str = "none",
    **others: Any,
) -> Display:
    """A display whose panel stands in the lenslets' focal plane: D = f, by the definition of D in optics.md."""
    made = display_of(
        grid, side, pitch=pitch, radius=focal * (index - 1.0), index=index, thickness=None, gap=focal, **others
    )
    gap = focal - made.array.thickness_mm / index if side == "panel" else focal
    return dataclasses.replace(made, gap_mm=gap, panel=dataclasses.replace(made.panel, subpixels=subpixels))


def display_toml(display: Display) -> str:
    """The display as a file."""
    panel, array = display.panel, display.array
    eye_mm, axis_mm = display.viewing_distance_mm, list(display.viewing_axis_mm)
    eye = "" if eye_mm is None else f"viewing_distance_mm = {eye_mm!r}\nviewing_axis_mm = {axis_mm!r}"
    return f"""
name = "{display.name}"
gap_mm = {display.gap_mm!r}
{eye}
[panel]
width_px = {panel.width_px}
height_px = {panel.height_px}
pixel_pitch_mm = {panel.pixel_pitch_mm!r}
subpixels = "{panel.subpixels}"
[array]
grid = "{array.grid}"
pitch_mm = {json.dumps(array.pitch_mm)}
shear = {array.shear!r}
{"" if array.extent_mm is None else f"extent_mm = {json.dumps(array.extent_mm)}"}
radius_mm = {array.radius_mm!r}
index = {array.index!r}
thickness_mm = {array.thickness_mm!r}
plano_side = "{array.plano_side}"
rotation_deg = {array.rotation_deg!r}
offset_mm = {list(array.offset_mm)!r}
"""


def small_toml(width_px: int, height_px: int, pixels: str = "pixel_pitch_mm = 0.1", gap_mm: float = 3.3) -> str:
    """A display file of square lenslets of 1 mm and f/3.3; `pixels` gives their pitch, and what else the panel has."""
    return f"""gap_mm = {gap_mm}
[panel]
width_px = {width_px}
height_px = {height_px}
{pixels}
[array]
grid = "square"
pitch_mm = 1.0
focal_length_mm = 3.3
index = 1.5
"""


def rgb(name: str, values: Iterable[float]) -> str:
    """A colour in Mitsuba's XML."""
    return f'<rgb name="{name}" value="{" ".join(repr(float(v)) for v in values)}"/>'


def glowing_sphere(centre: Iterable[float], radius: float, radiance: Iterable[float] = (1.0, 1.0, 1.0)) -> str:
    """A sphere that shines alike in all directions."""
    x, y, z = centre
    return (
        f'<shape type="sphere"><point name="center" x="{x!r}" y="{y!r}" z="{z!r}"/>'
        f'<float name="radius" value="{radius!r}"/><emitter type="area">{rgb("radiance", radiance)}</emitter></shape>'
    )


def glowing_card(
    name: str, z: float, radiance: Iterable[float], half: float = 1000.0, x: float = 0.0, turn: str = ""
) -> str:
    """A square that shines, at a depth."""
    return (
        f'<shape type="rectangle" id="{name}"><transform name="to_world"><scale value="{half}"/>{turn}'
        f'<translate x="{x}" z="{z}"/></transform><emitter type="area">{rgb("radiance", radiance)}</emitter></shape>'
    )


def write_scene(path: Path, *parts: str, placement: str = "") -> Path:
    """Write a scene file, and its placement beside it."""
    path.write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>')
    if placement:
        path.with_suffix(".toml").write_text(f"[placement]\n{placement}\n")
    return path


def centres(window: Window) -> tuple[Floats, Floats]:
    """x and y of the pixels' centres of a view on the plane z = 0, mm."""
    x = ((np.arange(window.width_px) + 0.5) / window.width_px - 0.5) * window.width_mm
    y = (0.5 - (np.arange(window.height_px) + 0.5) / window.height_px) * window.height_mm
    gx, gy = np.meshgrid(x, y)
    return gx, gy


def on_screen(point: tuple[float, float, float], eye: tuple[float, float, float]) -> tuple[float, float]:
    """Where the line from an eye to a point crosses z = 0: E + (P - E) ez / (ez - z)."""
    reach = eye[2] / (eye[2] - point[2])
    return eye[0] + (point[0] - eye[0]) * reach, eye[1] + (point[1] - eye[1]) * reach


def first_sphere(
    origin: Floats, direction: Floats, centre: Floats, radius: Floats
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Tell which sphere a viewer meets first who looks back along rays (N, 3) that leave a display; -1 for none.

    Also tell which rays are clear of every outline by 1e-3 mm, so that float32 cannot change the answer.
    """
    found = np.full(len(origin), -1)
    nearest = np.full(len(origin), -math.inf)
    clear = np.ones(len(origin), bool)
    for k, (c, r) in enumerate(zip(centre, radius, strict=True)):
        from_centre = origin - c
        along = -(from_centre * direction).sum(axis=1)
        miss = np.linalg.norm(from_centre + along[:, None] * direction, axis=1)
        clear &= np.abs(miss - r) > 1e-3
        # The viewer looks against the ray: what lies farthest along it hides the rest.
        far = along + np.sqrt(np.maximum(r * r - miss * miss, 0.0))
        nearer = (miss < r) & (far > nearest)
        found[nearer], nearest[nearer] = k, far[nearer]
    return found, clear
