"""Small scenes and displays for the tests of renderer and observer."""

import dataclasses
import math
import re

import numpy as np
from lippmann.display.description import display_text
from optics_cases import display_of


def generator(seed, *key):
    """A generator of its own for each case; pytest shows the line when the case fails."""
    seeds = [seed, *(sum(map(ord, k)) if isinstance(k, str) else k for k in key)]
    print(f"numpy.random.default_rng({seeds})")
    return np.random.default_rng(seeds)


def focused_display(grid, side="panel", *, focal=2.0, pitch=1.0, index=1.5, subpixels="none", **others):
    """A display whose panel stands in the lenslets' focal plane: D = f, by the definition of D in optics.md."""
    made = display_of(
        grid, side, pitch=pitch, radius=focal * (index - 1.0), index=index, thickness=None, gap=focal, **others
    )
    gap = focal - made.array.thickness_mm / index if side == "panel" else focal
    return dataclasses.replace(made, gap_mm=gap, panel=dataclasses.replace(made.panel, subpixels=subpixels))


def display_toml(display):
    return re.sub(r'^(bits = 8|transfer = "srgb")\n', "", display_text(display), flags=re.MULTILINE)


def small_toml(width_px, height_px, pixels="pixel_pitch_mm = 0.1", gap_mm=3.3):
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


def rgb(name, values):
    return f'<rgb name="{name}" value="{" ".join(repr(float(v)) for v in values)}"/>'


def glowing_sphere(centre, radius, radiance=(1.0, 1.0, 1.0)):
    """A sphere that shines alike in all directions."""
    x, y, z = centre
    return (
        f'<shape type="sphere"><point name="center" x="{x!r}" y="{y!r}" z="{z!r}"/>'
        f'<float name="radius" value="{radius!r}"/><emitter type="area">{rgb("radiance", radiance)}</emitter></shape>'
    )


def glowing_card(name, z, radiance, half=1000.0, x=0.0, turn=""):
    return (
        f'<shape type="rectangle" id="{name}"><transform name="to_world"><scale value="{half}"/>{turn}'
        f'<translate x="{x}" z="{z}"/></transform><emitter type="area">{rgb("radiance", radiance)}</emitter></shape>'
    )


def write_scene(path, *parts, placement=""):
    """Write a scene file, and its placement beside it."""
    path.write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>')
    if placement:
        path.with_suffix(".toml").write_text(f"[placement]\n{placement}\n")
    return path


def centres(window):
    """x and y of the pixels' centres of a view on the plane z = 0, mm."""
    x = ((np.arange(window.width_px) + 0.5) / window.width_px - 0.5) * window.width_mm
    y = (0.5 - (np.arange(window.height_px) + 0.5) / window.height_px) * window.height_mm
    gx, gy = np.meshgrid(x, y)
    return gx, gy


def on_screen(point, eye):
    """Where the line from an eye to a point crosses z = 0: E + (P - E) ez / (ez - z)."""
    reach = eye[2] / (eye[2] - point[2])
    return eye[0] + (point[0] - eye[0]) * reach, eye[1] + (point[1] - eye[1]) * reach


def first_sphere(origin, direction, centre, radius):
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


def programs_of(work):
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        work()
        return {kernel["hash"] for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT}
