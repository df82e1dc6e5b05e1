"""Converts a Mitsuba scene to POV-Ray text (docs/reference/povray.md), mm, display's frame.

**Radiance.** At the distance d from a point light of intensity I, a diffuse surface of
reflectance a has the radiance a I cos / (pi d^2) in Mitsuba. In POV-Ray, the radiance
for a light of colour c with `fade_power 2` and `fade_distance f` is 2 a c cos / (1 + (d
/ f)^2). With c = I / (2 pi f^2), the relative difference is f^2 / d^2, or 1e-6 at 1 mm.

In Mitsuba, a smooth plastic of index eta has the diffuse reflectance a (1 - F(i)) (1 -
F(o)) / (eta^2 (1 - Fdr)): Fresnel reflectances F at the angles i (light), o (view), and
Fdr (mean inside). Exported is F(0), accurate to 2 % up to 50 degrees, then too bright.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.base.variant import dr, mi
from lippmann.capturing.povray_source import Item, Tree
from lippmann.capturing.povray_text import block, identifier, matrix, number, plain, rows, vector
from lippmann.scenes.placement import ORIGIN, Placement, Triple

REFUSED = "cannot be exported to POV-Ray"
SUBSET = "use diffuse, plastic, conductor (a mirror) or dielectric, two-sided or not"


class Side(NamedTuple):
    """A surface side's POV-Ray texture: pigments for meshes and for spheres, and a finish."""

    pigment: str
    sphere: str
    finish: str

    def texture(self, spherical: bool) -> str:
        """Return the POV-Ray texture for a sphere or for a mesh."""
        pigment = self.sphere if spherical else self.pigment
        return block("texture", pigment, block("finish", "ambient 0 " + self.finish))


@dataclass(frozen=True)
class Material:
    """A material with two sides; `index` is the refractive index (None: no Fresnel reflection)."""

    name: str
    front: Side
    back: Side
    index: float | None = None

    @property
    def clear(self) -> bool:
        """Whether the material is transparent."""
        return self.front.pigment == CLEAR

    @property
    def pictures(self) -> bool:
        """Whether the material has an image texture."""
        return any(side.pigment != side.sphere for side in (self.front, self.back))


def _plain(colour: Triple, finish: str) -> Side:
    pigment = block("pigment", f"rgb {vector(colour)}")
    return Side(pigment, pigment, finish)


WHITE = (1.0, 1.0, 1.0)
BLACK = _plain((0.0, 0.0, 0.0), "diffuse 0")
CLEAR = block("pigment", "rgbt <1, 1, 1, 1>")


class Materials:
    """Converts each material once, and copies image textures to the export folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        #: Textures to declare in `scene.inc`, keyed by name.
        self.textures: dict[str, str] = {}
        self._known: dict[int, Material] = {}
        self._pictures: dict[tuple[Path, bool], str] = {}

    def read(self, item: Item) -> Material:
        """Convert a Mitsuba BSDF to a POV-Ray material."""
        if item.index not in self._known:
            name = identifier("material", len(self._known), item.id)
            if item.plugin == "twosided":
                (front, index), *others = [self._read_side(inner) for inner in item.children()]
                item.refuse_leftovers()
                back = others[-1][0] if others else front
            else:
                front, index = self._read_side(item)
                back = front if front.pigment == CLEAR else BLACK
            self._known[item.index] = Material(name, front, back, index)
        return self._known[item.index]

    def _read_side(self, item: Item) -> tuple[Side, float | None]:
        """Convert a BSDF to its front side and the refractive index inside."""
        index = None
        match item.plugin:
            case "diffuse":
                side = self._read_coloured_side(item, "reflectance", "diffuse 1")
            case "conductor":
                if item.value("material", "Cu") != "none" or item.values("eta", "k"):
                    remedy = 'set material to "none", remove eta and k, and set specular_reflectance'
                    raise item.refusal("has a complex index", remedy)
                tint = item.triple("specular_reflectance", WHITE)
                side = _plain((0.0, 0.0, 0.0), f"diffuse 0 reflection {{ rgb {vector(tint)} }}")
            case "dielectric":
                for name in ("specular_reflectance", "specular_transmittance"):
                    if item.triple(name, WHITE) != WHITE:
                        raise item.refusal(f"has a {name} other than 1", f"remove {name}")
                side = Side(CLEAR, CLEAR, "diffuse 0 reflection { 0, 1 fresnel on } conserve_energy")
                index = self._read_index(item)
            case "plastic":
                if item.value("nonlinear", False):
                    raise item.refusal("is nonlinear", "remove nonlinear")
                tint = item.triple("specular_reflectance", WHITE)
                index = self._read_index(item)
                normal = ((index - 1.0) / (index + 1.0)) ** 2
                inner = float(mi.fresnel_diffuse_reflectance(1.0 / index)[0])
                diffuse = (1.0 - normal) ** 2 / (index**2 * (1.0 - inner))
                finish = f"diffuse {number(diffuse)} reflection {{ rgb 0, rgb {vector(tint)} fresnel on }}"
                side = self._read_coloured_side(item, "diffuse_reflectance", finish)
            case _:
                raise item.refusal(REFUSED, SUBSET)
        item.refuse_leftovers()
        return side, index

    def _read_index(self, item: Item) -> float:
        try:
            glass = mi.load_dict({"type": item.plugin, **item.values("int_ior", "ext_ior")})
        except Exception as error:  # Mitsuba's errors have no common base
            raise item.refusal(f"has an unknown index ({' '.join(str(error).split())[:99]})", "give a number") from None
        return float(mi.traverse(glass)["eta"])

    def _read_coloured_side(self, item: Item, name: str, finish: str) -> Side:
        texture = item.child(name)
        if texture is None:
            return _plain(item.triple(name, (0.5, 0.5, 0.5)), finish)
        if texture.plugin != "bitmap":
            raise texture.refusal(REFUSED, "use a colour or a bitmap")
        if texture.value("wrap_mode", "repeat") != "repeat":
            raise texture.refusal("has a wrap_mode other than repeat", "remove wrap_mode")
        interpolate = " interpolate 2" if texture.value("filter_type", "bilinear") == "bilinear" else ""
        raw = texture.value("raw", False)
        file = self._copy_picture(texture, raw)
        texture.refuse_leftovers()
        image = f'png "{file}" gamma {"1.0" if raw else "srgb"} map_type'
        mesh, sphere = (block("image_map", f"{image} {shape}{interpolate}") for shape in (0, 1))
        # The axis of a sphere's texture is z in Mitsuba and y in POV-Ray.
        sphere = block("pigment", f"{sphere} matrix <1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0>")
        return Side(f"uv_mapping {block('pigment', mesh)}", sphere, finish)

    def _copy_picture(self, texture: Item, raw: bool) -> str:
        path = texture.path("filename")
        key = (path.resolve(), raw)
        if key not in self._pictures:
            try:
                bitmap = mi.Bitmap(str(path))
            except Exception as error:
                raise texture.refusal(f"cannot be read ({' '.join(str(error).split())[:200]})", "repair it") from None
            if bitmap.component_format() != mi.Struct.Type.UInt8:
                raise texture.refusal("has more than 8 bits per colour", "save the image as an 8-bit PNG")
            name = f"{plain(path.stem)}-{len(self._pictures)}.png"
            bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, bitmap.srgb_gamma())
            bitmap.write(str(self.folder / name))
            self._pictures[key] = name
        return self._pictures[key]


Array = npt.NDArray[Any]

#: Types of scene file objects that the export ignores.
ELSEWHERE = ("Integrator", "Sensor", "Film", "Sampler")
SHAPES = ("sphere", "rectangle", "ply", "obj")
#: Fade distance f of point lights, mm.
FADE_MM = 1e-3
#: Vertices count as one if nearer than this fraction of their mesh's size.
GRAIN = 1e-6


def write_scene(path: Path, placement: Placement, folder: Path) -> None:
    """Write `scene.inc`, meshes and textures; raise InputError for what POV-Ray cannot express."""
    materials, objects, lights = Materials(folder), list[str](), list[str]()
    for item in Item(Tree(path), 0).children():
        if item.kind == "Shape":
            objects += _shape(item, materials, placement, len(objects))
        elif item.kind == "Emitter":
            lights.append(_light(item, placement))
        elif item.kind not in (*ELSEWHERE, "BSDF", "Texture"):
            raise item.refusal(REFUSED, "remove it")
    title = f"// {plain(path.stem)} in the display's frame, mm: x right, y up, +z to the viewer; radiance is linear."
    declared = [f"#declare {name} = {text}" for name, text in materials.textures.items()]
    (folder / "scene.inc").write_text("\n".join([title, *declared, *lights, *objects]) + "\n")


def _light(item: Item, placement: Placement) -> str:
    if item.plugin != "point":
        raise item.refusal(REFUSED, "use point lights")
    *position, _ = placement.display_from_scene @ item.matrix() @ np.array([*item.triple("position", ORIGIN), 1.0])
    # I / d^2 is per square scene unit. In mm, I and d^2 are scale^2 times as large.
    intensity = placement.scale**2 * np.array(item.triple("intensity", (1.0, 1.0, 1.0)))
    item.refuse_leftovers()
    fade = f"fade_distance {number(FADE_MM)} fade_power 2"
    colour = intensity / (2.0 * math.pi * FADE_MM**2)
    return block("light_source", f"{vector(position)} rgb {vector(colour)}", fade)


def _shape(item: Item, materials: Materials, placement: Placement, place: int) -> list[str]:
    """Return a shape's POV-Ray objects, and add its textures to `materials`; `place` makes names unique."""
    if item.plugin not in SHAPES:
        raise item.refusal(REFUSED, f"use {', '.join(SHAPES)}")
    material = None
    for child in item.children():
        if child.kind != "BSDF":
            raise child.refusal(f"of a shape {REFUSED}", "use point lights and plain materials")
        material = materials.read(child)
    if material is None:
        raise item.refusal("has no material", "give the shape a bsdf")
    if material.clear and item.plugin == "rectangle":
        raise item.refusal("is not closed", "use closed shapes for dielectrics")
    spherical = item.plugin == "sphere"
    # In the geometry, `@` stands for texture and interior.
    geometry = _sphere(item, placement) if spherical else _mesh(item, material, placement, materials.folder, place)
    item.refuse_leftovers()
    front = f"{material.name}_sphere" if spherical and material.pictures else material.name
    back = front if material.back == material.front else f"{front}_back"
    materials.textures |= {front: material.front.texture(spherical), back: material.back.texture(spherical)}
    look = f"texture {{ {front} }} interior_texture {{ {back} }}"
    if material.index is not None:
        look += f" interior {{ ior {material.index:.9g} }}"
    if not material.clear:
        return [geometry.replace("@", look)]
    # In Mitsuba, glass blocks point lights; in POV-Ray, an invisible black copy of it does.
    shadow = geometry.replace("@", block("pigment", "rgb 0") + " no_image no_reflection").split("\n")[-1]
    return [geometry.replace("@", f"{look} no_shadow"), shadow]


def _sphere(item: Item, placement: Placement) -> str:
    to_world = item.matrix()
    to_world[:3, 3] += to_world[:3, :3] @ np.array(item.triple("center", ORIGIN))
    to_world[:3, :3] *= item.value("radius", 1.0)
    size = np.linalg.svd(to_world[:3, :3], compute_uv=False)
    if size[0] - size[2] > 1e-3 * size[0]:
        raise item.refusal("is not a sphere after its transform", "scale the sphere equally in all directions")
    # Mitsuba inverts normals for flip_normals, a negative radius and mirroring.
    if (np.linalg.det(to_world[:3, :3]) < 0.0) != item.value("flip_normals", False):
        raise item.refusal("has normals that point inwards", "flip the normals")
    return f"sphere {{ 0, 1 @ {matrix(placement.display_from_scene @ to_world)} }}"


def _mesh(item: Item, material: Material, placement: Placement, folder: Path, place: int) -> str:
    mesh, stem = _load_mesh(item)
    points = _column(mesh.vertex_positions_buffer(), 3)
    faces = np.array(mesh.faces_buffer()).reshape(-1, 3).astype(np.int64)
    # For POV-Ray, a face's vertices must be clockwise, seen from outside.
    faces = np.where(_outside(mesh, points, faces)[:, None], faces[:, ::-1], faces)
    if material.clear:
        _check_closed(item, points, faces)
    points = points @ placement.display_from_scene[:3, :3].T
    points += placement.display_from_scene[:3, 3]
    parts = {"vertex_vectors": points}
    if mesh.has_vertex_normals():
        normals = _column(mesh.vertex_normals_buffer(), 3) @ placement.display_from_scene[:3, :3].T
        # In Mitsuba, flip_normals does not change the file's normals.
        facing = -1.0 if item.value("flip_normals", False) else 1.0
        parts["normal_vectors"] = facing * normals / placement.scale
    if mesh.has_vertex_texcoords():
        # The first row of a texture is v = 0 in Mitsuba and v = 1 in POV-Ray.
        parts["uv_vectors"] = _column(mesh.vertex_texcoords_buffer(), 2) * [1.0, -1.0] + [0.0, 1.0]
    elif material.pictures:
        raise item.refusal("has an image texture but no uv", "add uv to the mesh, or use a material with a colour")
    parts["face_indices"] = faces
    name = f"{stem}-{place}.inc"
    body = "\n".join(f"{keyword} {{ {rows(values)} }}" for keyword, values in parts.items())
    declared = identifier("mesh", place, stem)
    (folder / name).write_text(f"#declare {declared} = mesh2 {{\n{body}\n}}\n")
    return f'#include "{name}"\nobject {{ {declared} @ }}'


def _outside(mesh: Any, points: Array, faces: Array) -> npt.NDArray[np.bool_]:
    """Return a mask of the faces whose vertices are counter-clockwise, seen from the front."""
    # Mitsuba's normal points to the front; it depends on winding, vertex normals,
    # flip_normals and mirroring.
    centre = dr.zeros(mi.PreliminaryIntersection3f, len(faces))
    centre.t = 1.0
    centre.prim_index = dr.arange(mi.UInt32, len(faces))
    centre.prim_uv = mi.Point2f(1.0 / 3.0)
    centre.shape = mi.ShapePtr(mesh)
    interaction = mesh.compute_surface_interaction(dr.zeros(mi.Ray3f, len(faces)), centre, mi.RayFlags.All)
    normal = np.array(interaction.sh_frame.n, np.float64).T
    return np.asarray((_area(points, faces) * normal).sum(axis=1) >= 0.0)


def _area(points: Array, faces: Array) -> Array:
    """Return face normals from the order of vertices; their length is twice the area."""
    first, second, third = (points[faces[:, k]] for k in range(3))
    return np.cross(second - first, third - first)


def _check_closed(item: Item, points: Array, faces: Array) -> None:
    # Merge vertices at one point, because normals and uv may split a corner.
    grain = GRAIN * np.ptp(points, axis=0).max()
    _, corner = np.unique(np.round(points / grain), axis=0, return_inverse=True)
    edges = np.sort(corner.reshape(-1)[faces[:, [[0, 1], [1, 2], [2, 0]]]].reshape(-1, 2), axis=1)
    _, faces_there = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0, return_counts=True)
    if (faces_there % 2).any():
        raise item.refusal("is not closed", "use closed shapes for dielectrics")
    # The sum is six times the signed volume, positive if the fronts face inwards.
    if ((points[faces[:, 0]] - points[0]) * _area(points, faces)).sum() > 0.0:
        raise item.refusal("has normals that point inwards", "flip the normals; glass is behind a surface")


def _load_mesh(item: Item) -> tuple[Any, str]:
    properties = {"type": item.plugin, "to_world": mi.ScalarTransform4f(item.matrix()), **item.values("flip_normals")}
    stem = item.plugin
    if item.plugin != "rectangle":
        path = item.path("filename")
        properties |= {"filename": str(path), **item.values("face_normals", "flip_tex_coords")}
        stem = plain(path.stem)
    try:
        return mi.load_dict(properties), stem
    except Exception as error:  # Mitsuba's errors have no common base
        raise item.refusal(f"cannot be read ({' '.join(str(error).split())[:200]})", "repair the file") from None


def _column(buffer: Any, width: int) -> Array:
    return np.array(buffer, np.float64).reshape(-1, width)
