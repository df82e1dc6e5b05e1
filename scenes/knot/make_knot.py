"""Make the knot scene: a torus knot through the display's plane, a mirror ball and a glass ball.

Run `python scenes/knot/make_knot.py`: meshes, textures and `knot.xml` are written beside this file.
Lengths are in mm in the display's frame (see `scenekit`).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scenekit import (
    Array,
    Mesh,
    SceneFile,
    grid_mesh,
    mix,
    noise,
    save_texture,
    smoothstep,
    texel_grid,
    unit,
)

HERE = Path(__file__).resolve().parent
SEED = 1948

STEPS, SIDES = 512, 28  # of the tube: twice their product is its number of triangles
KNOT_CENTRE = np.array([4.0, 10.0, 4.0])
KNOT_SIZE, TUBE_RADIUS = 11.2, 4.6
FLOOR, BACK, FRONT, HALF_WIDTH = -40.0, -170.0, 78.0, 320.0
STUDIO_RADIUS = 1600.0


def knot_path(turn: Array) -> Array:
    """Points of a (2, 3) torus knot, `turn` from 0 to 1, tipped to go far in front and behind."""
    a = 2.0 * np.pi * turn
    ring = 2.0 + np.cos(3.0 * a)
    points = KNOT_SIZE * np.stack([ring * np.cos(2.0 * a), ring * np.sin(2.0 * a), 1.5 * np.sin(3.0 * a)], axis=-1)
    tilt = np.radians(38.0)
    turn_y = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    return points @ turn_y.T + KNOT_CENTRE


def knot_mesh() -> Mesh:
    """Tube around the knot with exact normals, free of local twist; u goes along, v around."""
    turn = np.linspace(0.0, 1.0, STEPS + 1)
    path = knot_path(turn)
    along = unit(knot_path(turn + 1e-5) - knot_path(turn - 1e-5))
    # Carry one normal along the curve, then spread the twist left at the end over the whole length
    normal = np.empty_like(path)
    normal[0] = unit(np.cross(along[0], [0.0, 0.0, 1.0]))
    for k in range(1, STEPS + 1):
        normal[k] = unit(normal[k - 1] - (normal[k - 1] @ along[k]) * along[k])
    side = np.cross(along, normal)
    twist = np.arctan2(normal[-1] @ side[0], normal[-1] @ normal[0])
    angle = 2.0 * np.pi * np.linspace(0.0, 1.0, SIDES + 1)[None, :] - twist * turn[:, None]
    ring = np.cos(angle)[..., None] * normal[:, None, :] + np.sin(angle)[..., None] * side[:, None, :]
    u = np.broadcast_to(turn[:, None], angle.shape)
    v = np.broadcast_to(np.linspace(0.0, 1.0, SIDES + 1)[None, :], angle.shape)
    return grid_mesh(path[:, None, :] + TUBE_RADIUS * ring, np.stack([u, v], -1), normal=ring)


def knot_texture(rng: np.random.Generator) -> Array:
    """Skin whose hue goes once round along the knot, with light and dark diamonds; it tiles."""
    height, width = 128, 1024
    u, v = texel_grid(height, width)
    hue = 2.0 * np.pi * u
    base = np.stack(
        [
            0.62 + 0.32 * np.cos(hue),
            0.50 + 0.26 * np.cos(hue - 2.0),
            0.50 + 0.34 * np.cos(hue - 4.2),
        ],
        -1,
    )
    diamond = np.abs(np.mod(48.0 * u + 3.0 * v, 1.0) - 0.5) + np.abs(np.mod(48.0 * u - 3.0 * v, 1.0) - 0.5)
    base = mix(base, (0.98, 0.95, 0.86), 0.9 * smoothstep(0.34, 0.26, diamond))
    base = mix(base, base * 0.35, smoothstep(0.72, 0.82, diamond))
    return base * (1.0 + 0.04 * noise(rng, (height, width), 1.2, 6.0))[..., None]


def floor_texture(rng: np.random.Generator) -> Array:
    """Marble tiles in two colours with light joints; one picture holds 4 x 4 tiles and repeats."""
    size = 512
    u, v = texel_grid(size, size)
    vein = np.abs(noise(rng, (size, size), 1.9, 2.0))
    dark = mix((0.20, 0.30, 0.36), (0.45, 0.55, 0.58), smoothstep(0.25, 0.0, vein))
    light = mix((0.88, 0.83, 0.74), (0.66, 0.58, 0.50), smoothstep(0.25, 0.0, vein))
    odd = np.mod(np.floor(4.0 * u) + np.floor(4.0 * v), 2.0)
    tiles = mix(dark, light, odd)
    joint = np.minimum(np.abs(np.mod(4.0 * u + 0.5, 1.0) - 0.5), np.abs(np.mod(4.0 * v + 0.5, 1.0) - 0.5))
    return mix(tiles, (0.55, 0.52, 0.48), smoothstep(0.025, 0.015, joint))


def backdrop_texture(rng: np.random.Generator) -> Array:
    """Painted studio backdrop: warm below, blue-violet above, brushed; first row on top."""
    height, width = 384, 512
    _, v = texel_grid(height, width)
    brush = 0.035 * noise(rng, (height, width), 1.6, 3.0)
    picture = mix((0.36, 0.40, 0.62), (0.62, 0.58, 0.70), smoothstep(0.15, 0.62, v + brush))
    return mix(picture, (0.92, 0.76, 0.62), smoothstep(0.55, 0.95, v + brush)) * (1.0 + brush)[..., None]


def sweep_mesh(outline: Array, uv_scale: tuple[float, float]) -> Mesh:
    """Sheet as wide as the set along (y, z) points that go from far to near, or downward."""
    x = np.linspace(-HALF_WIDTH, HALF_WIDTH, 3)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=-1))])
    position = np.stack(np.broadcast_arrays(x[None, :], outline[:, :1], outline[:, 1:]), axis=-1)
    uv = np.stack(np.broadcast_arrays(x[None, :] / uv_scale[0], length[:, None] / uv_scale[1]), axis=-1)
    return grid_mesh(position, uv)


def main() -> None:
    """Write textures, meshes and the scene."""
    rng = np.random.default_rng(SEED)
    scene = SceneFile("Torus knot, mirror and glass: made by make_knot.py, millimetres in the display's frame", 8)
    for name, picture in {
        "skin": knot_texture(rng),
        "floor": floor_texture(rng),
        "backdrop": backdrop_texture(rng),
    }.items():
        save_texture(HERE / f"{name}.png", picture)
        scene.diffuse(name, f"{name}.png", two_sided=True)
    scene.mirror("mirror", (0.93, 0.92, 0.90))
    scene.glass("glass", 1.5)

    # Three lights: key, fill and one from the right
    scene.point_light((-500.0, 900.0, 700.0), (1.30, 1.24, 1.12))
    scene.point_light((300.0, 700.0, 900.0), (0.90, 0.93, 0.99))
    scene.point_light((1100.0, 350.0, 350.0), (0.65, 0.62, 0.69))

    rise = np.linspace(0.0, 1.0, 33)
    wall = np.stack([FLOOR - 12.0 + 360.0 * rise, BACK + 120.0 * rise**3], axis=-1)[::-1]
    front = np.array([[-160.0, FRONT + 0.5], [FLOOR - 14.0, FRONT]])
    floor = np.array([[FLOOR + 14.0, BACK - 4.0], [FLOOR - 14.0, FRONT]])
    meshes = {
        "knot": (knot_mesh(), "skin"),
        "floor": (
            Mesh.join([sweep_mesh(floor, (128.0, 128.0)), sweep_mesh(front[::-1], (128.0, 128.0))]),
            "floor",
        ),
        "backdrop": (sweep_mesh(wall, (2.0 * HALF_WIDTH, 400.0)), "backdrop"),
    }
    for name, (mesh, material) in meshes.items():
        mesh.save(HERE / f"{name}.ply")
        scene.ply(f"{name}.ply", material)

    def rest(x: float, z: float, radius: float) -> tuple[float, float, float]:
        """Centre of a ball that rests on the sloping floor."""
        slope = (floor[1, 0] - floor[0, 0]) / (floor[1, 1] - floor[0, 1])
        return (
            x,
            float(np.interp(z, [BACK - 4.0, FRONT], floor[:, 0])) + radius * float(np.hypot(1.0, slope)),
            z,
        )

    # A studio round everything: mirror and glass see something on the viewer's side as well
    scene.diffuse("studio", (0.30, 0.29, 0.32), two_sided=True)
    scene.sphere((0.0, 0.0, 0.0), STUDIO_RADIUS, "studio")
    scene.sphere(rest(-33.0, -34.0, 14.0), 14.0, "mirror")
    scene.sphere(rest(28.0, 26.0, 9.5), 9.5, "glass")
    scene.save(HERE / "knot.xml")
    print(f"knot.xml: 3 spheres, {sum(len(mesh.face) for mesh, _ in meshes.values())} triangles")


if __name__ == "__main__":
    main()
