"""Makes the golden pictures again: python tests/host/make_golden.py

To be run only when a change of the picture is wanted; look at them before they are committed.
"""

from golden_pictures import GOLDEN, SCENES, STANDS, SUBPIXELS, path_of, placement_of, render_golden
from lippmann.base.variant import start_mitsuba
from lippmann.scenes.scene import load_scene
from PIL import Image


def main() -> None:
    start_mitsuba("llvm")
    GOLDEN.mkdir(exist_ok=True)
    for name in STANDS:
        scene = load_scene(SCENES / name / f"{name}.xml", placement_of(name))
        for grid in SUBPIXELS:
            path = path_of(name, grid)
            Image.fromarray(render_golden(scene, grid)).save(path, optimize=True)
            print(f"{path.name}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
