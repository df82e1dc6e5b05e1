"""Converts meshes with materials (GLB, glTF, OBJ, PLY, STL; read by trimesh) to a Mitsuba scene.

The lights `LIGHTS` are added. Materials of glTF become Mitsuba's
`principled`, other materials `diffuse`. Colours of textures and vertices are sRGB. Only
glTF's vertex colours, and colours that materials give as numbers, are linear.
"""

from __future__ import annotations

import json
import logging
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt

from lippmann.base.file_limits import read_limited
from lippmann.base.tones import decode, encode
from lippmann.base.variant import mi
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.scenes.mitsuba_xml import new_scene, plugin, unique, value, write

if TYPE_CHECKING:
    import trimesh
    from PIL.Image import Image
    from trimesh import Trimesh
    from trimesh.visual.material import Material

#: A mesh's `visual` in trimesh: colours or a texture, without a common interface.
Visual = Any
SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
#: Maximum bytes of a file, and maximum face corners in a scene.
MAX_BYTES, MAX_CORNERS = 1 << 30, 100_000_000
#: Maximum pixels of a texture, and rows of it processed at once.
MAX_PIXELS, PART_ROWS = 1 << 25, 256
PLAIN = (0.6, 0.6, 0.6)
#: glTF's default value of metallic and roughness.
DEFAULT_FACTOR = 1.0
#: glTF's code for the number type float32, and prefix of its material extensions.
FLOAT32, MATERIALS = 5126, "KHR_materials_"
LEFT_OUT = (
    "KHR_texture_transform",
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_materials_transmission",
    "KHR_materials_clearcoat",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
)
#: Pattern of options before an MTL file's texture name, such as -s 1 1 1 or -clamp on.
MTL_OPTIONS = re.compile(r"^(?:-\w+(?:\s+(?:on|off|[rgbml]|[-+.\deE]+))+\s+)+")
#: Allowed suffixes of files to which a mesh refers; no others are read.
BUFFER_SUFFIXES = (".bin", ".mtl")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".tga", ".gif", ".webp", ".dds", ".jp2", ".ppm")
#: Words in trimesh's messages about ignored textures and materials.
LOSSES = ("image", "materials from")
REMEDY = "export it again, or as .glb"
#: For each default light, its direction in the display's frame, and its fraction of the
#: light on a surface that faces the viewer. The first light comes from the viewer, so
#: that nothing visible is black; the others are a key light and a weak fill light.
LIGHTS = (((0.0, 0.0, 1.0), 0.35), ((-0.5, 0.7, 1.0), 0.5), ((0.8, -0.3, 0.5), 0.15))


def write_scene(path: Path, folder: Path, scene_from_display: Floats, notes: list[str]) -> Path:
    """Write a mesh file's scene into an empty folder; return the scene's path, or raise InputError.

    `scene_from_display` (3, 3) rotates the lights; `notes` gets lines on omitted
    features.
    """
    scene = new_scene()
    for direction, fraction in LIGHTS:
        towards = np.array(direction) / np.linalg.norm(direction)
        light = plugin(scene, "emitter", "directional")
        value(light, "vector", "direction", -scene_from_display @ towards)
        # Lambert: radiance = albedo / pi * irradiance * cosine.
        value(light, "rgb", "irradiance", [np.pi * fraction / towards[2]] * 3)
    textures = _Textures(folder, path)
    with np.errstate(all="ignore"):  # values that overflow are refused below
        instances = list(_instances(path, notes))
    names = unique(name for name, _, _ in instances)
    for number, (name, (_, mesh, matrix)) in enumerate(zip(names, instances, strict=True)):
        notes += _add_shape(scene, name, mesh, matrix, textures, folder / f"mesh-{number}.ply")
    return write(scene, folder / "scene.xml")


def _instances(path: Path, notes: list[str]) -> Iterator[tuple[str, Trimesh, Floats]]:
    loaded = _load(path, notes)
    nodes = [(str(node), *loaded.graph[node]) for node in loaded.graph.nodes_geometry]
    if not nodes:  # a glTF may contain no scene
        nodes = [(str(name), np.eye(4), name) for name in loaded.geometry]
    corners, area = 0, 0.0
    for node, matrix, name in nodes:
        mesh = loaded.geometry[name]
        if not hasattr(mesh, "faces") or not len(mesh.faces):
            continue
        corners += 3 * len(mesh.faces)
        if corners > MAX_CORNERS:
            raise input_error(path, f"has more than {MAX_CORNERS // 3} faces", "reduce it in a mesh editor")
        if not (np.isfinite(mesh.vertices).all() and np.isfinite(matrix).all()):
            raise input_error(path, f"mesh '{name}' has points that are not finite", REMEDY)
        area += float(mesh.area)
        yield node, mesh, matrix
    if not corners or not area > 0.0:
        raise input_error(path, "has no faces" if not corners else "has no area", "give a file with a surface")


def _load(path: Path, notes: list[str]) -> trimesh.Scene:
    import trimesh
    from trimesh.resolvers import FilePathResolver

    class Files(FilePathResolver):
        """Finds files whose names have URL escapes, backslashes or MTL options."""

        def get(self, name: str) -> bytes:
            plain = MTL_OPTIONS.sub("", name.strip())
            for file in (Path(self.parent, one) for one in (plain, unquote(plain), plain.replace("\\", "/"))):
                if file.suffix.lower() in BUFFER_SUFFIXES + IMAGE_SUFFIXES and file.is_file():
                    return read_limited(file, MAX_BYTES, "make it smaller")
            raise FileNotFoundError(name)

    kind = path.suffix.lower()
    data = read_limited(path, MAX_BYTES, "reduce it in a mesh editor")
    if not data:
        raise input_error(path, "is empty", REMEDY)
    if kind in (".glb", ".gltf"):
        _check_gltf(path, kind, data, notes)
    with _recorded_losses() as losses:
        try:
            loaded = trimesh.load_scene(path, process=False, resolver=Files(str(path)))
        except MemoryError:
            raise
        except Exception as error:  # trimesh's errors have no common base
            reason = _brief(str(error)) or type(error).__name__
            raise input_error(path, f"cannot be read as {kind[1:]} ({reason})", REMEDY) from None
    if losses:
        remedy = "add the file, or remove its name from the mesh"
        raise input_error(path, f"names a texture or material that cannot be read ({_brief(losses[0])})", remedy)
    return loaded


def _brief(text: str) -> str:
    return " ".join(re.sub(r"<(\w+\.)*(\w+) object at 0x\w+>", "its data", text).split())[:200]


@contextmanager
def _recorded_losses() -> Iterator[list[str]]:
    losses: list[str] = []

    def record_loss(record: logging.LogRecord) -> bool:
        if any(word in record.getMessage() for word in LOSSES):
            losses.append(str((record.exc_info and record.exc_info[1]) or record.getMessage()))
        return False  # hide trimesh's log from the user

    logger, handler = logging.getLogger("trimesh"), logging.Handler()
    handler.addFilter(record_loss)
    level, propagate = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    try:
        yield losses
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = propagate


def _check_gltf(path: Path, kind: str, data: bytes, notes: list[str]) -> None:
    """Refuse a glTF that is too large or requires unknown extensions; list ignored extensions in `notes`."""
    # trimesh would allocate memory for accessors without data in the file.
    try:
        head = data if kind == ".gltf" else data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
        header = json.loads(head)
        counts = [int(accessor.get("count", 0)) for accessor in header.get("accessors", [])]
        required = [str(name) for name in header.get("extensionsRequired", [])]
        used = [str(name) for name in header.get("extensionsUsed", [])]
        types = {
            header["accessors"][primitive["attributes"][name]]["componentType"]
            for mesh in header.get("meshes", [])
            for primitive in mesh["primitives"]
            for name in ("POSITION", "NORMAL", "TEXCOORD_0")
            if name in primitive["attributes"]
        }
    except (ValueError, TypeError, AttributeError, KeyError, IndexError, OverflowError, RecursionError, struct.error):
        raise input_error(path, f"is not a complete {kind[1:]} file", "export it again") from None
    if sum(counts) > MAX_CORNERS or min(counts, default=0) < 0:
        raise input_error(path, f"has over {MAX_CORNERS} accessor elements, or a negative count", "reduce or mend it")
    for name in required:
        if not name.startswith(MATERIALS):
            raise input_error(path, f"requires {name}", "export it without compression and extensions")
    if types - {FLOAT32}:
        raise input_error(path, "has integer positions or texture coordinates", "export it with 32-bit numbers")
    left_out = [name for name in used if name in LEFT_OUT]
    if left_out:
        notes.append(f"note: {path.name} is shown without its {', '.join(left_out)}")


class _Textures:
    def __init__(self, folder: Path, source: Path) -> None:
        self._folder, self.source = folder, source
        #: File names, keyed by picture id and use; a picture is stored to keep its id unique.
        self._written: dict[tuple[int, str, tuple[float, ...]], tuple[str, Image]] = {}

    def write(self, picture: Image, part: str, factor: Floats) -> str:
        """Write a picture's colour, alpha or one channel, times a factor; return the file's name."""
        import PIL.Image

        key = id(picture), part, tuple(factor.tolist())
        if key in self._written:
            return self._written[key][0]
        if picture.width * picture.height > MAX_PIXELS:
            what = f"has a texture of {picture.width} x {picture.height} pixels; {MAX_PIXELS // 1_000_000} million"
            raise input_error(self.source, f"{what} are allowed", "make it smaller")
        try:
            pixels = np.array(picture.convert("RGBA"))
        except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError) as error:
            raise input_error(self.source, f"has a texture that cannot be read ({error})", REMEDY) from None
        values = pixels[..., :3] if part == "colour" else pixels[..., "RGBA".index(part[0].upper())]
        if (factor != 1.0).any() and part == "colour":
            for first in range(0, len(values), PART_ROWS):
                rows = values[first : first + PART_ROWS]
                rows[:] = np.round(255.0 * encode(decode(rows / 255.0, "srgb") * factor, "srgb"))
        elif (factor != 1.0).any():
            values = np.round(255.0 * np.clip(values / 255.0 * factor, 0.0, 1.0)).astype(np.uint8)
        name = f"texture-{len(self._written)}.png"
        PIL.Image.fromarray(values).save(self._folder / name)
        self._written[key] = name, picture
        return name


def _add_shape(scene: Element, name: str, mesh: Trimesh, matrix: Floats, textures: _Textures, file: Path) -> list[str]:
    visual: Visual = mesh.visual
    source = textures.source
    if visual.kind == "face":
        mesh = _with_faces_apart(mesh, visual.face_colors, source)
        visual = mesh.visual
    notes: list[str] = []
    uv, material = getattr(visual, "uv", None), getattr(visual, "material", None)
    colours = _vertex_colours(mesh, source.suffix.lower() in (".glb", ".gltf"))
    images = [getattr(material, name, None) for name in ("image", "baseColorTexture")]
    if colours is not None and uv is not None and images != [None, None]:
        if (colours < 0.999).any():
            notes = [f"note: {source.name} has a texture, so the colours of its vertices are not shown"]
        colours = None

    _write_mesh(file, mesh, matrix, uv, colours)
    shape = plugin(scene, "shape", "ply", id=name)
    value(shape, "string", "filename", file.name)
    if not _has_normals(mesh):
        value(shape, "boolean", "face_normals", True)
    if colours is not None:
        diffuse = plugin(plugin(shape, "bsdf", "twosided"), "bsdf", "diffuse")
        texture = plugin(diffuse, "texture", "mesh_attribute", name="reflectance")
        value(texture, "string", "name", "vertex_color")
    else:
        _add_material(shape, material, textures, uv is not None)
    return notes


def _with_faces_apart(mesh: Trimesh, colours: npt.NDArray[np.uint8], source: Path) -> Trimesh:
    import trimesh

    if len(colours) != len(mesh.faces):
        what = f"has {len(colours)} face colours, and {len(mesh.faces)} triangles"
        raise input_error(source, what, "triangulate it in a mesh editor")
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)].reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(corners, faces, vertex_colors=np.repeat(colours, 3, axis=0), process=False)


def _has_normals(mesh: Trimesh) -> bool:
    return "vertex_normals" in mesh._cache


def _vertex_colours(mesh: Trimesh, linear: bool) -> Floats | None:
    visual: Visual = mesh.visual
    colours = _wide_colours(mesh)
    if colours is None and visual.kind == "vertex":
        colours = visual.vertex_colors
    elif colours is None and "color" in mesh.vertex_attributes:
        colours = np.asarray(mesh.vertex_attributes["color"])
    if colours is None or len(colours) != len(mesh.vertices):
        return None
    plain = np.asarray(colours)[:, :3]
    unit = plain / np.iinfo(plain.dtype).max if plain.dtype.kind in "iu" else plain.astype(np.float64)
    return unit if linear else np.asarray(decode(unit, "srgb"), np.float64)


def _wide_colours(mesh: Trimesh) -> npt.NDArray[np.number] | None:
    """Return a PLY's colours (N, 3) of more than 8 bits, which trimesh would truncate, or None."""
    raw = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
    try:
        columns = [np.asarray(raw[name]).ravel() for name in ("red", "green", "blue")]
    except (KeyError, ValueError, IndexError, TypeError):  # the PLY has no plain colours
        return None
    # Colours of a wider type count as 8 bits if all are below 256.
    wide = np.stack(columns, axis=1)
    if wide.dtype.kind not in "iu" or wide.dtype.itemsize == 1 or wide.min(initial=0) < 0:
        return None
    return wide.astype(np.uint8) if wide.max(initial=0) <= 255 else wide


def _write_mesh(path: Path, mesh: Trimesh, matrix: Floats, uv: Floats | None, colours: Floats | None) -> None:
    points = np.array(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
    normals, faces = None, np.array(mesh.faces)
    if _has_normals(mesh):
        normals = np.array(mesh.vertex_normals) @ np.linalg.pinv(matrix[:3, :3])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(length > 0.0, length, 1.0)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    if uv is not None:  # the first row of trimesh's pictures is at v = 1
        uv = np.array(uv) * (1.0, -1.0) + (0.0, 1.0)
    write_surface(path, points, faces, normals, uv, colours)


def _add_material(shape: Element, material: Material | None, textures: _Textures, has_uv: bool) -> None:
    from trimesh.visual.material import PBRMaterial

    def add(
        parent: Element, parameter: str, texture: str, part: str, factor: Floats | Sequence[float], raw: bool = False
    ) -> None:
        """Add a parameter: a texture times a factor, or a number; `raw` values are not colours."""
        image = getattr(material, texture, None) if has_uv else None
        if image is not None:
            bitmap = plugin(parent, "texture", "bitmap", name=parameter)
            value(bitmap, "string", "filename", textures.write(image, part, np.asarray(factor)))
            value(bitmap, "boolean", "raw", raw)
        else:
            value(parent, "rgb" if len(factor) == 3 else "float", parameter, factor)

    if not isinstance(material, PBRMaterial):
        diffuse = plugin(plugin(shape, "bsdf", "twosided"), "bsdf", "diffuse")
        own = getattr(material, "kwargs", {}).get("kd")
        plain = PLAIN if own is None else np.clip(np.ravel(own)[:3], 0.0, 1.0)
        is_textured = has_uv and getattr(material, "image", None) is not None
        add(diffuse, "reflectance", "image", "colour", np.ones(3) if is_textured else plain)
        return
    base, is_textured = material.baseColorFactor, has_uv and material.baseColorTexture is not None
    factor = np.ones(4) if base is None else np.ravel(base) / (255.0 if np.asarray(base).dtype.kind in "iu" else 1.0)
    factor = np.concatenate([factor, np.ones(4)])[:4]
    parent = shape
    if material.alphaMode in ("BLEND", "MASK") and (is_textured or factor[3] < 1.0):
        parent = plugin(parent, "bsdf", "mask")
        add(parent, "opacity", "baseColorTexture", "alpha", np.ones(1) if is_textured else factor[3:], raw=True)
    parent = plugin(parent, "bsdf", "twosided")
    if has_uv and material.normalTexture is not None:
        parent = plugin(parent, "bsdf", "normalmap")
        add(parent, "normalmap", "normalTexture", "colour", np.ones(3), raw=True)
    principled = plugin(parent, "bsdf", "principled")
    add(principled, "base_color", "baseColorTexture", "colour", factor[:3])
    for name, channel in (("metallic", "B"), ("roughness", "G")):
        number = getattr(material, f"{name}Factor")
        weight = [DEFAULT_FACTOR if number is None else float(number)]
        add(principled, name, "metallicRoughnessTexture", channel, weight, raw=True)
    glow = np.ravel(0.0 if material.emissiveFactor is None else material.emissiveFactor)[:3]
    if glow.any():
        add(plugin(shape, "emitter", "area"), "radiance", "emissiveTexture", "colour", glow)


def write_surface(
    path: Path,
    points: Floats,
    faces: npt.NDArray[np.integer],
    normals: Floats | None = None,
    uv: Floats | None = None,
    colours: Floats | None = None,
) -> None:
    """Write a PLY of points (N, 3), faces (M, 3), and the points' normals (N, 3), uv (N, 2) and colours (N, 3)."""
    # In `uv`, v = 0 is a texture's first row; `colours` are linear, and written as Mitsuba's `vertex_color`.
    mesh = mi.Mesh(
        "mesh", len(points), len(faces), has_vertex_normals=normals is not None, has_vertex_texcoords=uv is not None
    )
    params = mi.traverse(mesh)
    params["faces"] = mi.UInt32(np.array(faces, np.uint32).ravel())
    for name, values in (("positions", points), ("normals", normals), ("texcoords", uv)):
        if values is not None:
            params[f"vertex_{name}"] = mi.Float(np.array(values, np.float32).ravel())
    params.update()

    if colours is not None:
        mesh.add_attribute("vertex_color", 3, mi.Float(np.array(colours, np.float32).ravel()))
    mesh.write_ply(str(path))


#: Names that PLY files give to a face's list of vertices.
LISTS = ("vertex_indices", "vertex_index")
MAX_HEADER_BYTES = 1 << 20


def check_faces(path: Path) -> None:
    """Raise InputError if a file is not PLY, or if a face uses a missing vertex."""
    import plyfile

    try:
        with path.open("rb") as stream:
            head, end, _ = stream.read(MAX_HEADER_BYTES).partition(b"end_header")
        if not end:
            raise ValueError("it has no header")
        if re.search(rb"\belement\s+\S+\s+-", head):  # numpy would divide by 0 and crash
            raise ValueError("an element has a negative count")
        try:
            data = plyfile.PlyData.read(str(path), known_list_len={"face": dict.fromkeys(LISTS, 3)})
        except plyfile.PlyParseError:  # not triangles: read each list
            data = plyfile.PlyData.read(str(path), mmap=False)
        vertices = data["vertex"].count if "vertex" in data else 0
        faces = [data["face"][name] for name in LISTS if "face" in data and name in data["face"]]
        lists = [np.concatenate(one) if one.dtype == object and len(one) else one for one in map(np.asarray, faces)]
        numbers = [int(extreme) for one in lists if one.size for extreme in (one.min(), one.max())]
        worst = next((number for number in numbers if not 0 <= number < vertices), None)
    except (plyfile.PlyParseError, KeyError, ValueError, OverflowError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise input_error(path, f"cannot be read as ply ({reason})", "export it again") from None
    if worst is not None:
        raise input_error(path, f"a face uses vertex {worst}, but the file has {vertices} (from 0)", "export it again")
