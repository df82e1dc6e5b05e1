"""Cut the fish and the chart into layers that a board draws by itself: folders `fish` and `chart` beside this file.

Run `make scenes`, or `python scenes/layers/make_layers.py`. The fish is a layer of its own, to swim; water, stems
and sky are cut by their depths. Both are for `vga-square`, a quarter of their scenes' size.
"""

from __future__ import annotations

from pathlib import Path

import lippmann as lp
from lippmann.api import cut_layers
from lippmann.layers.layers_and_pictures import save_layers
from lippmann.rendering.renderer import Settings
from lippmann.scenes.placement import Placement

HERE = Path(__file__).resolve().parent
SCALE = 0.25
SETTINGS = Settings(samples=32, seed=1908)
#: Scene, what moves, and the names of the layers from front to back.
SCENES = {
    "fish": ("fish-*", ("near-water", "fish", "stems", "sky")),
    "chart": (None, ("near", "front", "back", "wall")),
}


def main() -> None:
    """Cut both scenes and write their folders."""
    display = lp.load_display(HERE.parent / "displays" / "vga-square.toml")
    for name, (apart, names) in SCENES.items():
        scene, place = HERE.parent / name / f"{name}.xml", Placement(SCALE)
        ((cut, _),) = cut_layers(scene, display, (len(names),), settings=SETTINGS, apart=apart, placement=place)
        save_layers(HERE / name, cut.stack, names)
        depths = (f"{one} {layer.depth_mm:+.1f} mm" for one, layer in zip(names, cut.stack.layers, strict=True))
        print(f"{name}: {', '.join(depths)}")


if __name__ == "__main__":
    main()
