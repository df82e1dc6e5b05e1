"""A Mitsuba scene as POV-Ray's: spheres, meshes and rectangles, their materials, point lights.

Everything comes out in the display's frame, in mm: the placement is worked into points and matrices.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.povray.materials import Material, Materials, point_light
from lippmann.povray.source import Item, Tree
from lippmann.povray.text import block, identifier, matrix, rows
from lippmann.render.placement import Placement

Array = npt.NDArray[Any]

#: Objects of a scene file that say how Mitsuba renders, not what there is.
ELSEWHERE = ("Integrator", "Sensor", "Film", "Sampler")
SHAPES = ("sphere", "rectangle", "ply", "obj")


def write_scene(mi: Any, path: Path, placement: Placement, folder: Path) -> None:
    """Write `scene.inc`, a file for each mesh, and the pictures.

    Parameters
    ----------
    mi
        Mitsuba, started.
    path
        The scene file.
    placement
        From scene units to mm.
    folder
        Where to; exists.

    Raises
    ------
    InputError
        Naming the first thing in the scene that POV-Ray cannot express as Mitsuba renders it.
    """
    materials = Materials(mi, folder)
    textures: dict[str, str] = {}
    objects: list[str] = []
    lights: list[str] = []
    for item in Tree(mi, path).scene.children():
        if item.kind == "Shape":
            objects += _shape(mi, item, materials, textures, placement, folder, len(objects))
        elif item.kind == "Emitter":
            lights.append(_light(item, placement))
        elif item.kind not in (*ELSEWHERE, "BSDF", "Texture"):
            raise item.refusal("has no counterpart in POV-Ray", "leave it out")
    title = f"// {path.name} in the display's frame, mm: x right, y up, +z to the viewer; radiance is linear."
    declared = [f"#declare {name} = {text}" for name, text in textures.items()]
    (folder / "scene.inc").write_text("\n".join([title, *declared, *lights, *objects]) + "\n")


def _light(item: Item, placement: Placement) -> str:
    if item.plugin != "point":
        raise item.refusal("has no counterpart in POV-Ray", "use point lights")
    place = placement.display_from_scene @ item.matrix() @ np.array([*item.triple("position", (0.0, 0.0, 0.0)), 1.0])
    # In scene units a surface at distance d gets I / d^2; in mm both squares grow by the scale's.
    area = placement.scale**2
    red, green, blue = item.triple("intensity", (1.0, 1.0, 1.0))
    item.refuse_leftovers()
    return point_light((place[0], place[1], place[2]), (area * red, area * green, area * blue))


def _shape(
    mi: Any,
    item: Item,
    materials: Materials,
    textures: dict[str, str],
    placement: Placement,
    folder: Path,
    number: int,
) -> list[str]:
    if item.plugin not in SHAPES:
        raise item.refusal("has no counterpart in POV-Ray", f"use {', '.join(SHAPES)}")
    material = None
    for child in item.children():
        if child.kind != "BSDF":
            raise child.refusal("on a shape has no counterpart in POV-Ray", "use point lights and plain materials")
        material = materials.read(child)
    if material is None:
        raise item.refusal("has no material", "give it one")
    if material.clear and item.plugin == "rectangle":
        raise item.refusal("encloses no glass", "use closed shapes for dielectrics")
    if item.plugin == "sphere":
        geometry = _sphere(item, placement)
    else:
        geometry = _mesh(mi, item, material, placement, folder, number)
    item.refuse_leftovers()
    return _object(geometry, material, textures, spherical=item.plugin == "sphere")


def _sphere(item: Item, placement: Placement) -> str:
    """Return a sphere: the unit sphere and what brings it to its place, along which its picture is turned too."""
    to_world = item.matrix()
    to_world[:3, 3] += to_world[:3, :3] @ np.array(item.triple("center", (0.0, 0.0, 0.0)))
    to_world[:3, :3] *= item.number("radius", 1.0)
    size = np.linalg.svd(to_world[:3, :3], compute_uv=False)
    if size[0] - size[2] > 1e-3 * size[0]:
        raise item.refusal("is no sphere where it stands", "scale it alike in all directions")
    if item.flag("flip_normals", False):
        raise item.refusal("has flipped normals", "leave flip_normals out")
    return f"sphere {{ 0, 1 @ {matrix(placement.display_from_scene @ to_world)} }}"


def _mesh(mi: Any, item: Item, material: Material, placement: Placement, folder: Path, number: int) -> str:
    """Write a mesh's file and return how it is included."""
    mesh, stem = _load(mi, item)
    points = _column(mesh.vertex_positions_buffer(), 3) @ placement.display_from_scene[:3, :3].T
    points += placement.display_from_scene[:3, 3]
    parts = ["vertex_vectors", rows(points)]
    if mesh.has_vertex_normals():
        normals = _column(mesh.vertex_normals_buffer(), 3) @ placement.display_from_scene[:3, :3].T
        parts += ["normal_vectors", rows(normals / placement.scale)]
    if mesh.has_vertex_texcoords():
        # The first row of a picture is v = 0 in Mitsuba and v = 1 in POV-Ray.
        parts += ["uv_vectors", rows(_column(mesh.vertex_texcoords_buffer(), 2) * [1.0, -1.0] + [0.0, 1.0])]
    elif material.pictures:
        raise item.refusal("has a picture on it but no uv", "give the mesh uv, or the material a colour")
    # A face's outside is where its corners go clockwise, in POV-Ray's left-handed frame.
    parts += ["face_indices", rows(np.array(mesh.faces_buffer()).reshape(-1, 3)[:, ::-1].astype(np.int64))]
    name = f"{stem}-{number}.inc"
    body = "\n".join(_braced(parts))
    (folder / name).write_text(f"#declare {identifier(stem)}_{number} = mesh2 {{\n{body}\n}}\n")
    return f'#include "{name}"\nobject {{ {identifier(stem)}_{number} @ }}'


def _braced(parts: list[str]) -> list[str]:
    return [f"{keyword} {{ {values} }}" for keyword, values in zip(parts[::2], parts[1::2], strict=True)]


def _load(mi: Any, item: Item) -> tuple[Any, str]:
    """Return Mitsuba's mesh, in scene units, and a name for it."""
    given: dict[str, Any] = {"type": item.plugin, "to_world": mi.ScalarTransform4f(item.matrix())}
    stem = item.plugin
    if item.plugin != "rectangle":
        path = item.path("filename")
        given["filename"] = str(path)
        stem = re.sub(r"[^\w-]", "_", path.stem, flags=re.ASCII)
        for name in ("face_normals", "flip_tex_coords"):
            if item.has(name):
                given[name] = item.flag(name, False)
    if item.flag("flip_normals", False):
        given["flip_normals"] = True
    try:
        shape = mi.load_dict(given)
    except Exception as error:  # Mitsuba raises RuntimeError and friends without a common base
        raise item.refusal(f"cannot be read ({' '.join(str(error).split())[:200]})", "mend it") from None
    return shape, stem


def _column(buffer: Any, width: int) -> Array:
    return np.array(buffer, np.float64).reshape(-1, width)


def _object(geometry: str, material: Material, textures: dict[str, str], spherical: bool) -> list[str]:
    """Return the objects of a shape; @ in `geometry` stands for texture and interior."""
    declared = material.declarations(spherical)
    textures.update(declared)
    front, back = next(iter(declared)), list(declared)[-1]
    look = f"texture {{ {front} }} interior_texture {{ {back} }}"
    if material.index is not None:
        look += " interior { ior " + f"{material.index:.9g}" + " }"
    if not material.clear:
        return [geometry.replace("@", look)]
    # Glass stops the light of Mitsuba's point lights, and lets POV-Ray's pass: its shadow is an object of its own.
    shadow = geometry.replace("@", block("pigment", "rgb 0") + " no_image no_reflection").split("\n")[-1]
    return [geometry.replace("@", f"{look} no_shadow"), shadow]
