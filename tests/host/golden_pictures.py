"""The golden pictures: small integral images of the shipped scenes. Rendered here, stored under golden/.

A middle part of each scene, 96 x 96 pixels of 0.25 mm behind lenslets of 2 mm: few pixels, all of the optics.
"""

from pathlib import Path

from lippmann.base.tones import encoded_values
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.placement import Placement
from scene_cases import focused_display

SCENES = Path(__file__).parents[2] / "scenes"
GOLDEN = Path(__file__).parent / "golden"
#: The same by the places that version 0.1 gave samples.
BEFORE = Path(__file__).parent / "golden_before"
#: Scene, and where its origin comes to stand (mm): what is of interest comes to the middle.
STANDS = {"fish": (0.0, 0.0, 0.0), "chart": (2.0, 18.0, 0.0), "knot": (0.0, 0.0, 0.0)}
SUBPIXELS = {"square": "none", "hex": "rgb"}
SETTINGS = Settings(samples=16, seed=2005, shading="each")


def display_for(grid):
    """96 x 96 pixels; the hexagonal one with colour stripes and turned by 11 degrees."""
    return focused_display(
        grid,
        pitch=2.0,
        focal=5.0,
        width_px=96,
        height_px=96,
        pixel_pitch=0.25,
        subpixels=SUBPIXELS[grid],
        rotation=0.0 if grid == "square" else 11.0,
    )


def placement_of(scene):
    return Placement(offset_mm=STANDS[scene], near_mm=90.0, far_mm=-180.0)


def path_of(scene, grid):
    return GOLDEN / f"{scene}-{grid}.png"


def render_golden(scene, grid):
    return encoded_values(render_integral(scene, display_for(grid), "exact", SETTINGS).radiance, "srgb", 8)
