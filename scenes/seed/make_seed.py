"""Make the founding paper's scenes: the fish above reflecting water, before stems, under point lights.

Run `python scenes/seed/make_seed.py`. Fish, water, sky and textures are those of `scenes/fish`, which must be there;
stems and `*.xml` are written beside this file. All of it lies within what POV-Ray can be given.

| scene | lights | stems | water | for |
|---|---|---|---|---|
| `base` | 2 | 2 | mirror | the time that others are counted in |
| `full` | 5 | 4 | mirror | integral images |
| `diffuse` | 5 | 4 | diffuse | comparing pictures |
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "fish"))

import make_fish as fish
from scenekit import Mesh, SceneFile

HERE = Path(__file__).resolve().parent
FISH = "../fish"

#: Position (mm) and irradiance at the origin of each light; the base scene has the first two, brighter.
LIGHTS = (
    ((-450.0, 1200.0, 950.0), (1.18, 1.14, 1.06)),
    ((1350.0, -75.0, 420.0), (0.61, 0.66, 0.75)),
    ((500.0, 1150.0, 800.0), (0.96, 0.96, 0.95)),
    ((0.0, 1150.0, 850.0), (0.96, 0.96, 0.97)),
    ((-1350.0, -75.0, 420.0), (0.78, 0.74, 0.67)),
)
#: x, z, height of the top, lean, bend (mm), kind of stem and of leaf; nearest first.
STEMS = (
    (39.0, -20.0, 41.0, -2.0, 1.0, "reed", "green leaf"),
    (17.0, -70.0, 48.0, 6.0, -2.0, "teal", "teal leaf"),
    (-38.0, -45.0, 36.0, -3.0, 1.6, "red", "red leaf"),
    (-13.0, -100.0, 52.0, -5.0, 2.2, "olive", "olive leaf"),
)
SCENES = {"base": (2, 2, "mirror"), "full": (5, 4, "mirror"), "diffuse": (5, 4, "diffuse")}


def stems_mesh(count: int) -> Mesh:
    """Return the first stems, with their leaves."""
    parts: list[Mesh] = []
    for x, z, top, lean, bend, stem, leaf in STEMS[:count]:
        path = fish.stem_path(x, z, top, lean, bend)
        parts.append(fish.tube(path, np.linspace(1.4, 0.8, len(path)), stem))
        fish.add_leaves(parts, path, np.random.default_rng(fish.SEED + round(-z)), 7, 20.0, leaf)
    return Mesh.join(parts)


def write_scene(name: str, lights: int, stems: int, water: str) -> None:
    """Write one scene."""
    scene = SceneFile(f"The founding paper's fish, {lights} lights, {stems} stems: made by make_seed.py, mm")
    for texture in ("skin", "eye", "fins", "plants", "sky", *(f"scale_{colour}" for colour in fish.PALETTE)):
        two_sided = texture in ("fins", "plants", "sky", "skin")
        scene.diffuse(texture, f"{FISH}/{texture}.png", two_sided=two_sided)
    scene.diffuse("deep", (0.05, 0.16, 0.22), two_sided=True)
    if water == "mirror":
        scene.mirror("water", (0.60, 0.76, 0.84))
    else:
        scene.diffuse("water", (0.16, 0.36, 0.42))
    for position, irradiance in LIGHTS[:lights]:
        scene.point_light(position, np.array(irradiance) * (len(LIGHTS) / lights) ** 0.5)
    for mesh, material in (("body", "skin"), ("fins", "fins"), ("water", "water"), ("skirt", "deep"), ("sky", "sky")):
        scene.ply(f"{FISH}/{mesh}.ply", material, name=f"fish-{mesh}" if mesh in fish.FISH_MESHES else None)
    scene.ply(f"stems-{stems}.ply", "plants")
    count = fish.add_scales(scene, np.random.default_rng(fish.SEED)) + fish.add_eyes(scene)
    scene.save(HERE / f"{name}.xml")
    shutil.copyfile(HERE.parent / "fish/fish.toml", HERE / f"{name}.toml")
    print(f"{name}.xml: {lights} lights, {stems} stems, {count} spheres")


def main() -> None:
    """Write stems and scenes."""
    for count in sorted({stems for _, stems, _ in SCENES.values()}):
        stems_mesh(count).save(HERE / f"stems-{count}.ply")
    for name, (lights, stems, water) in SCENES.items():
        write_scene(name, lights, stems, water)


if __name__ == "__main__":
    main()
