"""Meshes with materials and textures (GLB, glTF, OBJ, PLY, STL; read by trimesh) as a Mitsuba scene.

The files have no lights that trimesh reads: `mitsuba_xml.LIGHTS` are added. Materials become Mitsuba's `principled`
where they are glTF's, and `diffuse` else; colours of textures and of vertices (but glTF's) are sRGB, numbers of
materials linear.
"""

from __future__ import annotations

import json
import logging
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np

from lippmann.base.limits import read_limited
from lippmann.base.tones import decode, encode
from lippmann.base.variant import mitsuba
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.scenes.mitsuba_xml import add_lights, bitmap, new_scene, plugin, unique, value, write

#: The files' suffixes.
SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
#: Largest file, and most corners of a file's faces, vertices of each instance counted.
MOST_BYTES, MOST_CORNERS = 1 << 30, 100_000_000
#: Pixels of a texture at most; rows of it whose colours are multiplied at once.
MOST_PIXELS, PART_ROWS = 1 << 25, 256
#: Albedo of a surface of which the file tells nothing.
PLAIN = (0.6, 0.6, 0.6)
#: glTF's numbers of a material that does not tell them.
METALLIC, ROUGHNESS = 1.0, 1.0
#: glTF's number of float32; extensions of materials, which change only looks; those that are noted.
FLOAT32, MATERIALS = 5126, "KHR_materials_"
LEFT_OUT = (
    "KHR_texture_transform", "KHR_texture_basisu", "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit", "KHR_materials_transmission", "KHR_materials_clearcoat", "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
)  # fmt: skip
#: Options before the name of a texture in an MTL file, such as -s 1 1 1 or -clamp on.
MTL_OPTIONS = re.compile(r"^(?:-\w+(?:\s+(?:on|off|[rgbml]|[-+.\deE]+))+\s+)+")
#: Files that a mesh may name: no other file of this machine is read.
NAMED = (
    ".bin", ".mtl", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".tga", ".gif", ".webp", ".dds", ".jp2", ".ppm",
)  # fmt: skip
#: Words of trimesh's messages on what it leaves out.
LOSSES = ("image", "materials from")
REMEDY = "export it again, or as .glb"


def write_scene(path: Path, folder: Path, scene_from_display: Floats, notes: list[str]) -> Path:
    """Write the scene of a file, with its meshes and textures, into an empty folder; return the scene's path.

    `scene_from_display` (3, 3) turns the lights. What of the file is not shown is told in `notes`.

    Raises InputError for a file that is too large, broken, without faces, or lacks a texture, and for a glTF that
    requires what is not read.
    """
    scene = new_scene()
    add_lights(scene, scene_from_display)
    made = _Folder(folder)
    with np.errstate(all="ignore"):  # matrices of numbers that are too large are refused by their product
        found = list(_instances(path, notes))
    for (_, mesh, matrix), name in zip(found, unique(name for name, _, _ in found), strict=True):
        _add_shape(scene, name, mesh, matrix, made, path, notes)
    return write(scene, folder / "scene.xml")


# ---- reading ----


def _instances(path: Path, notes: list[str]) -> Iterator[tuple[str, Any, Floats]]:
    """Yield each mesh of a file as it stands in the scene: its name, trimesh's mesh, and a matrix (4, 4)."""
    loaded = _load(path, notes)
    nodes = [(str(node), *loaded.graph[node]) for node in loaded.graph.nodes_geometry]
    if not nodes:  # a glTF may leave out its scene
        nodes = [(str(name), np.eye(4), name) for name in loaded.geometry]
    corners, area = 0, 0.0
    for node, matrix, name in nodes:
        mesh = loaded.geometry[name]
        if not hasattr(mesh, "faces") or not len(mesh.faces):
            continue
        corners += 3 * len(mesh.faces)
        if corners > MOST_CORNERS:
            raise input_error(str(path), f"has more than {MOST_CORNERS // 3} faces", "reduce it in a mesh editor")
        if not (np.isfinite(mesh.vertices).all() and np.isfinite(matrix).all()):
            raise input_error(str(path), f"mesh '{name}' has places that are not finite", REMEDY)
        area += float(mesh.area)
        yield node, mesh, matrix
    if not corners or not area > 0.0:
        raise input_error(str(path), "has no faces" if not corners else "has no area", "give a file with a surface")


def _load(path: Path, notes: list[str]) -> Any:
    """Return trimesh's scene of a file."""
    import trimesh
    from trimesh.resolvers import FilePathResolver

    class Files(FilePathResolver):
        """Finds the files that a file names, also as web addresses, with backslashes, and behind MTL's options."""

        def get(self, name: str) -> Any:
            plain = MTL_OPTIONS.sub("", name.strip())
            for one in dict.fromkeys((plain, unquote(plain), plain.replace("\\", "/"))):
                if Path(one).suffix.lower() in NAMED and Path(self.parent, one).is_file():
                    return read_limited(Path(self.parent, one), MOST_BYTES, "make it smaller")
            raise FileNotFoundError(name)

    kind = path.suffix.lower()
    data = read_limited(path, MOST_BYTES, "reduce it in a mesh editor")
    if not data:
        raise input_error(str(path), "is empty", REMEDY)
    if kind in (".glb", ".gltf"):
        _check_gltf(path, kind, data, notes)
    with _told_of_losses() as lost:
        try:
            loaded = trimesh.load_scene(path, process=False, resolver=Files(str(path)))
        except MemoryError:
            raise
        except Exception as error:  # trimesh's readers raise what they stumble over
            reason = _brief(str(error)) or type(error).__name__
            raise input_error(str(path), f"cannot be read as {kind[1:]} ({reason})", REMEDY) from None
    if lost:
        remedy = "put it there, or take its name out of the file"
        raise input_error(str(path), f"lacks a texture or material that can be read ({_brief(lost[0])})", remedy)
    return loaded


def _brief(text: str) -> str:
    """Return a library's words in one line, cut, without the addresses of Python's objects."""
    return " ".join(re.sub(r"<(\w+\.)*(\w+) object at 0x\w+>", "its data", text).split())[:200]


@contextmanager
def _told_of_losses() -> Iterator[list[str]]:
    """Give a list of what trimesh says of textures and materials that it leaves out without an error."""
    told: list[str] = []

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if any(word in record.getMessage() for word in LOSSES):
                error = record.exc_info[1] if record.exc_info else None
                told.append(" ".join(str(error or record.getMessage()).split())[:200])

    logger, handler = logging.getLogger("trimesh"), Handler()
    before = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    try:
        yield told
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before[0])
        logger.propagate = before[1]


def _check_gltf(path: Path, kind: str, data: bytes, notes: list[str]) -> None:
    """Refuse a glTF that requires what is not read, or whose accessors have more elements than any file needs.

    Some accessors have no bytes in the file, and are counted before they are expanded. What is left out is noted.
    """
    try:
        head = data if kind == ".gltf" else data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
        told = json.loads(head)
        counts = [int(accessor.get("count", 0)) for accessor in told.get("accessors", [])]
        required = [str(name) for name in told.get("extensionsRequired", [])]
        used = [str(name) for name in told.get("extensionsUsed", [])]
        places = {
            told["accessors"][primitive["attributes"][name]]["componentType"]
            for mesh in told.get("meshes", [])
            for primitive in mesh["primitives"]
            for name in ("POSITION", "NORMAL", "TEXCOORD_0")
            if name in primitive["attributes"]
        }
    except (ValueError, TypeError, AttributeError, KeyError, IndexError, OverflowError, RecursionError, struct.error):
        raise input_error(str(path), f"is no {kind[1:]}, or cut off", "export it again") from None
    if sum(counts) > MOST_CORNERS or min(counts, default=0) < 0:
        raise input_error(str(path), f"has more than {MOST_CORNERS} numbered vertices", "reduce it in a mesh editor")
    for name in required:
        if not name.startswith(MATERIALS):
            raise input_error(str(path), f"requires {name}", "export it without compression and extensions")
    if places - {FLOAT32}:
        raise input_error(str(path), "has places or texture coordinates in integers", "export it with 32-bit numbers")
    left_out = [name for name in used if name in LEFT_OUT]
    if left_out:
        notes.append(f"note: {path.name} is shown without its {', '.join(left_out)}")


# ---- shapes ----


class _Folder:
    """Where a scene's files are written; each picture once."""

    def __init__(self, folder: Path) -> None:
        self.path = folder
        self._pictures: dict[tuple[int, str, Any], str] = {}
        self._kept: list[Any] = []

    def picture(self, picture: Any, part: str, source: Path, factor: Floats | None = None) -> str:
        """Write a part of a picture of Pillow's as a PNG; return its name.

        `part` is "colour", "alpha" or a channel's letter. Colours are multiplied by a linear factor (3,), a channel's
        numbers by a factor (1,).
        """
        from PIL import Image

        scaled = None if factor is None or (factor == 1.0).all() else tuple(factor.tolist())
        key = id(picture), part, scaled
        if key not in self._pictures:
            if picture.width * picture.height > MOST_PIXELS:
                what = f"has a texture of {picture.width} x {picture.height} pixels; {MOST_PIXELS // 1_000_000} million"
                raise input_error(str(source), f"{what} are allowed", "make it smaller")
            try:
                pixels = np.array(picture.convert("RGBA"))
            except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
                raise input_error(str(source), f"has a texture that cannot be read ({error})", REMEDY) from None
            if scaled is not None and part == "colour":
                for first in range(0, len(pixels), PART_ROWS):
                    rows = pixels[first : first + PART_ROWS, :, :3]
                    rows[:] = _as_bytes(encode(decode(rows / 255.0, "srgb") * np.array(scaled), "srgb"))
            chosen = pixels[..., :3] if part == "colour" else pixels[..., "RGBA".index(part[0].upper())]
            if scaled is not None and part != "colour":
                chosen = _as_bytes(np.clip(chosen / 255.0 * scaled[0], 0.0, 1.0))
            name = f"texture-{len(self._pictures)}.png"
            Image.fromarray(chosen).save(self.path / name)
            self._pictures[key] = name
            self._kept.append(picture)  # so that no other picture gets its id
        return self._pictures[key]


def _as_bytes(unit: Any) -> Any:
    return np.round(255.0 * np.asarray(unit)).astype(np.uint8)


def _add_shape(
    scene: Element, name: str, mesh: Any, matrix: Floats, made: _Folder, source: Path, notes: list[str]
) -> None:
    if mesh.visual.kind == "face":
        mesh = _with_faces_apart(mesh, source)
    uv, material = getattr(mesh.visual, "uv", None), getattr(mesh.visual, "material", None)
    colours = _vertex_colours(mesh, source.suffix.lower() in (".glb", ".gltf"))
    if colours is not None and uv is not None and _has_texture(material):
        if (colours < 0.999).any():
            notes.append(f"note: {source.name} is shown without the colours of its vertices, for it has a texture")
        colours = None
    file = f"mesh-{len(list(made.path.glob('mesh-*.ply')))}.ply"
    _write_mesh(made.path / file, mesh, matrix, uv, colours)
    shape = plugin(scene, "shape", "ply", id=name)
    value(shape, "string", "filename", file)
    if not _has_normals(mesh):
        value(shape, "boolean", "face_normals", True)
    _add_material(shape, material, made, source, uv is not None, colours is not None)


def _has_texture(material: Any) -> bool:
    return any(getattr(material, name, None) is not None for name in ("image", "baseColorTexture"))


def _with_faces_apart(mesh: Any, source: Path) -> Any:
    """Return a mesh whose faces share no vertices, each of which has its face's colour."""
    import trimesh

    colours = mesh.visual.face_colors
    if len(colours) != len(mesh.faces):
        what = f"has {len(colours)} colours of faces, and {len(mesh.faces)} triangles"
        raise input_error(str(source), what, "split its faces into triangles in a mesh editor")
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)].reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(corners, faces, vertex_colors=np.repeat(colours, 3, axis=0), process=False)


def _has_normals(mesh: Any) -> bool:
    """Tell whether the file has normals; asked for them else, trimesh would make some up."""
    return "vertex_normals" in mesh._cache


def _vertex_colours(mesh: Any, linear: bool) -> Floats | None:
    """Return the vertices' linear colours (N, 3); None without."""
    visual = mesh.visual
    wide = _wide_colours(mesh)
    if wide is not None:
        given = wide
    elif visual.kind == "vertex":
        given = visual.vertex_colors
    else:
        given = mesh.vertex_attributes.get("color")
        if given is None or len(given) != len(mesh.vertices):
            return None
    plain = np.asarray(given)[:, :3]
    unit = plain / np.iinfo(plain.dtype).max if plain.dtype.kind in "iu" else plain.astype(np.float64)
    return unit if linear else np.asarray(decode(unit, "srgb"), np.float64)


def _wide_colours(mesh: Any) -> Any:
    """Return the colours of more than 8 bits of a PLY file (N, 3), of which trimesh would keep 8; None without.

    Numbers of 16 or 32 bits that are all below 256 are bytes in a wide type.
    """
    raw = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
    try:
        columns = [np.asarray(raw[name]).ravel() for name in ("red", "green", "blue")]
    except (KeyError, ValueError, IndexError, TypeError):  # no data, none of these, or a list of rows
        return None
    wide = np.stack(columns, axis=1)
    if wide.dtype.kind not in "iu" or wide.dtype.itemsize == 1 or wide.min(initial=0) < 0:
        return None
    return wide.astype(np.uint8) if wide.max(initial=0) <= 255 else wide


def _write_mesh(path: Path, mesh: Any, matrix: Floats, uv: Any, colours: Floats | None) -> None:
    """Write a mesh, placed by a matrix."""
    points = np.array(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
    normals, faces = None, np.array(mesh.faces)
    if _has_normals(mesh):
        turned = np.array(mesh.vertex_normals) @ np.linalg.pinv(matrix[:3, :3])
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        normals = turned / np.where(length > 0.0, length, 1.0)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    if uv is not None:  # the first row of trimesh's pictures is at v = 1
        uv = np.array(uv) * (1.0, -1.0) + (0.0, 1.0)
    write_surface(path, points, faces, normals, uv, colours)


# ---- materials ----


def _add_material(shape: Element, material: Any, made: _Folder, source: Path, uv: bool, coloured: bool) -> None:
    """Add trimesh's material to a shape: a BSDF, and light that it emits."""
    if coloured:
        outer = plugin(shape, "bsdf", "twosided")
        diffuse = plugin(outer, "bsdf", "diffuse")
        texture = plugin(diffuse, "texture", "mesh_attribute", name="reflectance")
        value(texture, "string", "name", "vertex_color")
    elif type(material).__name__ == "PBRMaterial":
        _add_pbr(shape, material, made, source, uv)
    else:
        outer = plugin(shape, "bsdf", "twosided")
        _add_simple(outer, material, made, source, uv)


def _add_simple(outer: Element, material: Any, made: _Folder, source: Path, uv: bool) -> None:
    diffuse = plugin(outer, "bsdf", "diffuse")
    image, own = getattr(material, "image", None), getattr(material, "kwargs", {}).get("kd")
    if image is not None and uv:
        bitmap(diffuse, "reflectance", made.picture(image, "colour", source))
    else:
        value(diffuse, "rgb", "reflectance", PLAIN if own is None else np.clip(np.ravel(own)[:3], 0.0, 1.0))


def _add_pbr(shape: Element, material: Any, made: _Folder, source: Path, uv: bool) -> None:
    def picture(name: str) -> Any:
        return getattr(material, name, None) if uv else None

    base = material.baseColorFactor
    factor = np.ones(4) if base is None else np.ravel(base) / (255.0 if np.asarray(base).dtype.kind in "iu" else 1.0)
    factor = np.concatenate([factor, np.ones(4)])[:4]
    parent = shape
    if material.alphaMode in ("BLEND", "MASK") and (picture("baseColorTexture") is not None or factor[3] < 1.0):
        parent = plugin(parent, "bsdf", "mask")
        if picture("baseColorTexture") is not None:
            bitmap(parent, "opacity", made.picture(material.baseColorTexture, "alpha", source), raw=True)
        else:
            value(parent, "float", "opacity", float(factor[3]))
    parent = plugin(parent, "bsdf", "twosided")
    if picture("normalTexture") is not None:
        parent = plugin(parent, "bsdf", "normalmap")
        bitmap(parent, "normalmap", made.picture(material.normalTexture, "colour", source), raw=True)
    principled = plugin(parent, "bsdf", "principled")
    if picture("baseColorTexture") is not None:
        bitmap(principled, "base_color", made.picture(material.baseColorTexture, "colour", source, factor[:3]))
    else:
        value(principled, "rgb", "base_color", factor[:3])
    both = picture("metallicRoughnessTexture")
    for name, letter, given, usual in (
        ("metallic", "B", material.metallicFactor, METALLIC),
        ("roughness", "G", material.roughnessFactor, ROUGHNESS),
    ):
        if both is not None:
            share = np.array([1.0 if given is None else float(given)])
            bitmap(principled, name, made.picture(both, letter, source, share), raw=True)
        else:
            value(principled, "float", name, float(usual if given is None else given))
    glow = np.zeros(3) if material.emissiveFactor is None else np.ravel(material.emissiveFactor)[:3]
    if glow.any():
        emitter = plugin(shape, "emitter", "area")
        if picture("emissiveTexture") is not None:
            bitmap(emitter, "radiance", made.picture(material.emissiveTexture, "colour", source, glow))
        else:
            value(emitter, "rgb", "radiance", glow)


def write_surface(
    path: Path, points: Any, faces: Any, normals: Any = None, uv: Any = None, colours: Any = None
) -> None:
    """Write points (N, 3), faces (M, 3), and per point normals (N, 3), texture coordinates (N, 2), and colours (N, 3).

    The first row of a texture is at v = 0 in Mitsuba; colours are linear, its attribute `vertex_color`.
    """
    mi = mitsuba()

    def flat(values: Any) -> Any:
        return mi.Float(np.array(values, np.float32).ravel())

    built = mi.Mesh(
        "mesh", len(points), len(faces), has_vertex_normals=normals is not None, has_vertex_texcoords=uv is not None
    )
    parameters = mi.traverse(built)
    parameters["vertex_positions"] = flat(points)
    parameters["faces"] = mi.UInt32(np.array(faces, np.uint32).ravel())
    if normals is not None:
        parameters["vertex_normals"] = flat(normals)
    if uv is not None:
        parameters["vertex_texcoords"] = flat(uv)
    parameters.update()
    if colours is not None:
        built.add_attribute("vertex_color", 3, flat(colours))
    built.write_ply(str(path))


#: Names of the list of a face's vertices.
LISTS = ("vertex_indices", "vertex_index")
#: Longest header.
MOST_HEADER_BYTES = 1 << 20


def check_faces(path: Path) -> None:
    """Raise InputError for a mesh with a face that names a vertex which is not there, and for no PLY file."""
    import plyfile

    try:
        with path.open("rb") as stream:
            head, ended, _ = stream.read(MOST_HEADER_BYTES).partition(b"end_header")
        if not ended:
            raise ValueError("it has no header")
        if re.search(rb"\belement\s+\S+\s+-", head):  # without properties, numpy divides by 0 and ends the process
            raise ValueError("an element has a negative count")
        try:
            data = plyfile.PlyData.read(str(path), known_list_len={"face": dict.fromkeys(LISTS, 3)})
        except plyfile.PlyParseError:  # not of triangles alone: its lists are read one by one
            data = plyfile.PlyData.read(str(path), mmap=False)
        vertices = data["vertex"].count if "vertex" in data else 0
        faces = [data["face"][name] for name in LISTS if "face" in data and name in data["face"]]
        worst = next((number for numbers in faces if (number := _worst(numbers, vertices)) is not None), None)
    except (plyfile.PlyParseError, KeyError, ValueError, OverflowError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise input_error(str(path), f"cannot be read as ply ({reason})", "export it again") from None
    if worst is not None:
        raise input_error(str(path), f"a face names vertex {worst} of {vertices}", "export it again")


def _worst(lists: Any, vertices: int) -> int | None:
    """Return a number that is no vertex's; None when all are."""
    numbers = np.asarray(lists)
    if numbers.dtype == object and len(numbers):
        numbers = np.concatenate(numbers)
    for number in (int(numbers.min()), int(numbers.max())) if numbers.size else ():
        if not 0 <= number < vertices:
            return number
    return None
