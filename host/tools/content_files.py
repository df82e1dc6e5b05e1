"""Scenes in other tools' files, made from those that ship: one of each kind, for the gallery and its measurements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.images import write_picture
from lippmann.base.variant import mitsuba
from lippmann.display.description import Display
from lippmann.eye.many_views import eyes_of, of_scene
from lippmann.eye.observer import Eye, whole_window
from lippmann.optics.zones import viewing_distance
from lippmann.rendering.renderer import Settings, first_depths, render_view
from lippmann.rendering.sources import Window
from lippmann.scenes.scene import Scene
from lippmann.scenes.splats import write_table
from lippmann.scenes.window_views import EYES, eyes_note, eyes_text, quilt_path, tiled

#: Zeroth spherical harmonic.
Y00 = 0.5 / np.sqrt(np.pi)
#: Splats of the knot; their radius and thickness, mm, and the logit of their opacity.
SPLATS, SPLAT_MM, LOGIT = 12_000, (0.7, 0.7, 0.15), 4.0


@dataclass(frozen=True)
class Surface:
    """A mesh of the project's: points, normals and places in its texture (N, 3), (N, 3), (N, 2), and faces."""

    points: Any
    normals: Any
    uv: Any
    faces: Any
    texture: Path

    @classmethod
    def read(cls, mesh: Path, texture: Path) -> Surface:
        """Read a PLY that Mitsuba reads; v of its texture goes down."""
        parameters = mitsuba().traverse(mitsuba().load_dict({"type": "ply", "filename": str(mesh)}))
        points, normals, uv = (
            np.array(parameters[f"vertex_{name}"], np.float64).reshape(-1, size)
            for name, size in (("positions", 3), ("normals", 3), ("texcoords", 2))
        )
        return cls(points, normals, uv, np.array(parameters["faces"]).reshape(-1, 3), texture)

    def colours(self) -> Any:
        """Return the texture's colours at the points (N, 3), sRGB, 0 to 255."""
        from PIL import Image

        with Image.open(self.texture) as image:
            pixels = np.asarray(image.convert("RGB"))
        height, width, _ = pixels.shape
        column, row = (np.floor(np.mod(self.uv, 1.0) * (width, height)).astype(int)).T
        return pixels[row, column]


def write_meshes(surface: Surface, folder: Path) -> list[Path]:
    """Write a surface as GLB, glTF, OBJ, PLY with coloured vertices, and STL, by trimesh; return the paths."""
    import trimesh
    from PIL import Image
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial, SimpleMaterial

    def with_material(material: Any) -> Any:
        visual = TextureVisuals(uv=surface.uv * (1.0, -1.0) + (0.0, 1.0), material=material)
        return trimesh.Scene(
            trimesh.Trimesh(surface.points, surface.faces, vertex_normals=surface.normals, visual=visual, process=False)
        )

    with Image.open(surface.texture) as opened:
        image = opened.convert("RGB")
    with_material(PBRMaterial(baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.4)).export(
        folder / "knot.glb"
    )
    with_material(SimpleMaterial(image=image)).export(folder / "knot.obj")
    painted = trimesh.Trimesh(
        surface.points, surface.faces, vertex_normals=surface.normals, vertex_colors=surface.colours(), process=False
    )
    painted.export(folder / "knot.ply", vertex_normal=True)
    painted.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))  # z up, as in workshops
    painted.export(folder / "knot.stl")
    return [folder / f"knot.{suffix}" for suffix in ("glb", "obj", "ply", "stl")]


def write_splats(surface: Surface, path: Path, seed: int) -> Path:
    """Write splats on a surface, flat along it, as their trainers write them: y down."""
    random = np.random.default_rng(seed)
    chosen = random.choice(len(surface.points), min(SPLATS, len(surface.points)), replace=False)
    # The shortest turn from z to the normal, as a quaternion.
    x, y, z = surface.normals[chosen].T
    turn = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    turn[z < -1.0 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    down = np.array([1.0, -1.0, -1.0])  # turned about x
    turn = np.stack([-turn[:, 1], turn[:, 0], -turn[:, 3], turn[:, 2]], axis=1)
    columns = {
        **dict(zip("xyz", (surface.points[chosen] * down).T, strict=True)),
        **dict.fromkeys(("nx", "ny", "nz"), np.zeros(len(chosen))),
        **{f"f_dc_{k}": (surface.colours()[chosen, k] / 255.0 - 0.5) / Y00 for k in range(3)},
        "opacity": np.full(len(chosen), LOGIT),
        **{f"scale_{k}": np.full(len(chosen), np.log(size)) for k, size in enumerate(SPLAT_MM)},
        **{f"rot_{k}": turn[:, k] for k in range(4)},
    }
    table = np.array(list(zip(*columns.values(), strict=True)), [(name, "<f4") for name in columns])
    write_table(path, table)
    return path


def write_views(
    scene: Scene, display: Display, folder: Path, across: int, down: int = 1, width: int = 480, seed: int = 0
) -> Path:
    """Write the views of a scene from the display's viewing zone, and views.json; return the folder."""
    window = whole_window(display, width)
    sight = of_scene(scene, window, Settings(samples=16, seed=seed))
    folder.mkdir()
    eyes = eyes_of(display, across, down)
    for number, eye in enumerate(eyes):
        write_picture(folder / f"{number}.exr", sight(Eye(eye)), {})
    names = [f"{number}.exr" for number in range(len(eyes))]
    (folder / EYES).write_text(eyes_text((window.width_mm, window.height_mm), names, eyes))
    return folder


def write_quilt(views: Iterable[Any], sizes: Sequence[float], eyes: Sequence[Any], path: Path, columns: int) -> Path:
    """Write the quilt of views of a window of some size (mm), from eyes from left to right; return its path."""
    pictures = list(views)
    height, width = pictures[0].shape[:2]
    rows = len(pictures) // columns
    path = quilt_path(path, columns, rows, width / height)
    write_picture(path, tiled(pictures, columns, rows), eyes_note(sizes, eyes))
    return path


def write_depth_picture(scene: Scene, display: Display, folder: Path, width: int = 960, seed: int = 0) -> Path:
    """Write what an eye before the display's middle sees of a scene, and its depths; return the file of both."""
    from PIL import Image

    eye = (0.0, 0.0, viewing_distance(display))
    panel = display.panel
    window = Window(panel.width_mm, panel.height_mm, width, round(width * panel.height_mm / panel.width_mm))
    seen = render_view(scene, eye, window, Settings(samples=16, seed=seed)).radiance
    write_picture(folder / "colour.png", seen, {})
    steps = np.round(10.0 * (eye[2] - first_depths(scene, eye, window)))
    there = np.isfinite(steps) & (steps > 0.0) & (steps < 65536.0)
    Image.fromarray(np.where(there, steps, 0.0).astype(np.uint16)).save(folder / "depth.png")
    fov = 2.0 * np.degrees(np.arctan(0.5 * panel.width_mm / eye[2]))
    path = folder / "picture.toml"
    path.write_text(
        f'[depth_picture]\ncolour = "colour.png"\ndepth = "depth.png"\nunit_mm = 0.1\nfov_deg = {float(fov)!r}\n'
    )
    return path
