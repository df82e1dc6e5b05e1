"""Makes the golden pictures again: python tests/host/make_golden.py

To be run only when a change of the picture is wanted; look at them before they are committed.
"""

from unittest import mock

from golden_pictures import BEFORE, SCENES, STANDS, SUBPIXELS, path_of, placement_of, render_golden
from lippmann.base.variant import start_mitsuba
from lippmann.optics.sample_points import points_in_square
from lippmann.rendering import sampling
from lippmann.scenes.scene import load_scene
from PIL import Image


def old_places(pixel, sample, _, seed, number):
    return points_in_square(pixel, sample, seed, 0)


def save_picture(picture, path):
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(picture).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    start_mitsuba("llvm")
    for name in STANDS:
        scene = load_scene(SCENES / name / f"{name}.xml", placement_of(name))
        for grid in SUBPIXELS:
            save_picture(render_golden(scene, grid), path_of(name, grid))
            with mock.patch.object(sampling, "points_in_pixel", old_places):
                save_picture(render_golden(scene, grid), BEFORE / f"{name}-{grid}.png")
