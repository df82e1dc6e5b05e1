"""Small tools shared by the scene generators: noise, textures, meshes and Mitsuba XML.

Everything here is in the display frame of Lippmann, in millimetres: x right, y up, +z towards the
viewer, the display in the plane z = 0.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

Array = NDArray[np.float64]

VIEWER_MM = 600.0
"""Distance from the display at which the scenes' own perspective sensor stands."""
DISPLAY_MM = 101.6
"""Side of the square window that this sensor frames."""


# --- numbers --------------------------------------------------------------------------------------


def unit(v: ArrayLike) -> Array:
    """Scale vectors to length 1 along the last axis."""
    v = np.asarray(v, dtype=np.float64)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def smoothstep(low: float, high: float, x: ArrayLike) -> Array:
    """Rise from 0 at `low` to 1 at `high` with flat ends (`low` may exceed `high`)."""
    t = np.clip((np.asarray(x, dtype=np.float64) - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def mix(a: ArrayLike, b: ArrayLike, weight: ArrayLike) -> Array:
    """Blend colours: `a` where `weight` is 0, `b` where it is 1; `weight` lacks the colour axis."""
    w = np.asarray(weight, dtype=np.float64)[..., None]
    return np.asarray(a, dtype=np.float64) * (1.0 - w) + np.asarray(b, dtype=np.float64) * w


def curve(knots: list[tuple[float, float]], x: ArrayLike) -> Array:
    """Interpolate `(x, y)` knots with cubic Hermite pieces (slopes by finite differences)."""
    kx, ky = np.asarray(knots, dtype=np.float64).T
    slope = np.gradient(ky, kx)
    x = np.asarray(x, dtype=np.float64)
    i = np.clip(np.searchsorted(kx, x) - 1, 0, len(kx) - 2)
    step = kx[i + 1] - kx[i]
    t = np.clip((x - kx[i]) / step, 0.0, 1.0)
    return (
        (2 * t**3 - 3 * t**2 + 1) * ky[i]
        + (t**3 - 2 * t**2 + t) * step * slope[i]
        + (3 * t**2 - 2 * t**3) * ky[i + 1]
        + (t**3 - t**2) * step * slope[i + 1]
    )


def noise(rng: np.random.Generator, shape: tuple[int, int], exponent: float = 1.8, low_cut: float = 2.0) -> Array:
    """Tileable fractal noise, normalised to mean 0 and standard deviation 1.

    The amplitude falls as frequency to the power `-exponent`; frequencies under `low_cut` cycles
    per image are left out.
    """
    fy = np.fft.fftfreq(shape[0], 1.0 / shape[0])[:, None]
    fx = np.fft.fftfreq(shape[1], 1.0 / shape[1])[None, :]
    frequency = np.hypot(fx, fy)
    gain = np.where(frequency >= low_cut, np.maximum(frequency, 1.0) ** -exponent, 0.0)
    field = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * gain).real
    return (field - field.mean()) / field.std()


# --- files ----------------------------------------------------------------------------------------


def save_texture(path: Path, srgb: Array) -> None:
    """Write an `(h, w, 3)` sRGB image, values in [0, 1], as an 8-bit PNG."""
    Image.fromarray(np.round(np.clip(srgb, 0.0, 1.0) * 255.0).astype(np.uint8)).save(path, optimize=True)


def texel_grid(height: int, width: int) -> tuple[Array, Array]:
    """Coordinates `(u, v)` of texel centres, each `(height, width)`, v = 0 on the first row."""
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    return u, v


@dataclass
class Mesh:
    """A triangle mesh: `(n, 3)` positions in mm and unit normals, `(n, 2)` uv, `(m, 3)` faces."""

    position: Array
    normal: Array
    uv: Array
    face: NDArray[np.int32]

    @staticmethod
    def join(parts: list[Mesh]) -> Mesh:
        """Put several meshes into one."""
        start = np.cumsum([0] + [len(part.position) for part in parts[:-1]])
        return Mesh(
            np.concatenate([part.position for part in parts]),
            np.concatenate([part.normal for part in parts]),
            np.concatenate([part.uv for part in parts]),
            np.concatenate([part.face + offset for part, offset in zip(parts, start, strict=True)]),
        )

    def save(self, path: Path, *, with_uv: bool = True) -> None:
        """Write a binary PLY with smooth normals and, unless told otherwise, with uv."""
        names = ("x", "y", "z", "nx", "ny", "nz") + (("u", "v") if with_uv else ())
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(self.position)}\n"
            + "".join(f"property float {name}\n" for name in names)
            + f"element face {len(self.face)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        columns = [self.position, self.normal] + ([self.uv] if with_uv else [])
        vertex = np.concatenate(columns, axis=1).astype("<f4")
        face = np.empty(len(self.face), dtype=[("count", "u1"), ("index", "<i4", 3)])
        face["count"] = 3
        face["index"] = self.face
        path.write_bytes(header.encode("ascii") + vertex.tobytes() + face.tobytes())


def grid_mesh(position: Array, uv: Array, normal: Array | None = None, *, around: bool = False) -> Mesh:
    """Mesh an `(n, m, 3)` grid of points.

    Without `normal`, normals come from central differences: (second axis) x (first axis). With
    `around` the second axis closes on itself, its last column repeating the first. The winding
    agrees with (second axis) x (first axis).
    """
    n, m = position.shape[:2]
    if normal is None:
        if around:
            wrapped = np.concatenate([position[:, -2:-1], position, position[:, 1:2]], axis=1)
            across = np.gradient(wrapped, axis=1)[:, 1:-1]
        else:
            across = np.gradient(position, axis=1)
        normal = np.cross(across, np.gradient(position, axis=0))
        size = np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = np.where(size > 1e-12, normal / np.maximum(size, 1e-12), [0.0, 0.0, 1.0])
    index = np.arange(n * m).reshape(n, m)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    face = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])
    return Mesh(position.reshape(-1, 3), normal.reshape(-1, 3), uv.reshape(-1, 2), face.astype(np.int32))


# --- Mitsuba XML ----------------------------------------------------------------------------------


def numbers(values: ArrayLike, digits: int = 6) -> str:
    """Format numbers for an XML attribute: up to `digits` after the point, no negative zero."""
    rounded = np.round(np.asarray(values, dtype=np.float64), digits).ravel()
    return " ".join(f"{value + 0.0:.{digits + 4}g}" for value in rounded)


class SceneFile:
    """A Mitsuba 3 scene description in the making."""

    def __init__(self, title: str, max_depth: int = 4) -> None:
        """Start a scene with the path integrator and a sensor that frames the display."""
        self.root = ET.Element("scene", version="3.0.0")
        self.root.append(ET.Comment(f" {title} "))
        for name, value in (("spp", "64"), ("resolution", "512")):
            ET.SubElement(self.root, "default", name=name, value=value)
        integrator = ET.SubElement(self.root, "integrator", type="path")
        ET.SubElement(integrator, "integer", name="max_depth", value=str(max_depth))
        sensor = ET.SubElement(self.root, "sensor", type="perspective")
        fov = np.degrees(2.0 * np.arctan(DISPLAY_MM / 2.0 / VIEWER_MM))
        ET.SubElement(sensor, "float", name="fov", value=numbers(fov))
        ET.SubElement(sensor, "float", name="near_clip", value="10")
        ET.SubElement(sensor, "float", name="far_clip", value="5000")
        pose = ET.SubElement(sensor, "transform", name="to_world")
        ET.SubElement(pose, "lookat", origin=f"0, 0, {VIEWER_MM:g}", target="0, 0, 0", up="0, 1, 0")
        sampler = ET.SubElement(sensor, "sampler", type="independent")
        ET.SubElement(sampler, "integer", name="sample_count", value="$spp")
        film = ET.SubElement(sensor, "film", type="hdrfilm")
        for name in ("width", "height"):
            ET.SubElement(film, "integer", name=name, value="$resolution")
        ET.SubElement(film, "rfilter", type="gaussian")

    def _bsdf(self, kind: str, name: str, two_sided: bool) -> ET.Element:
        """Add a BSDF, within `twosided` if asked; return the element that takes its parameters."""
        if not two_sided:
            return ET.SubElement(self.root, "bsdf", type=kind, id=name)
        outer = ET.SubElement(self.root, "bsdf", type="twosided", id=name)
        return ET.SubElement(outer, "bsdf", type=kind)

    def diffuse(self, name: str, albedo: str | ArrayLike, *, two_sided: bool = False, nearest: bool = False) -> None:
        """Add a diffuse material; `albedo` names an sRGB picture, or is a linear RGB triple."""
        bsdf = self._bsdf("diffuse", name, two_sided)
        if isinstance(albedo, str):
            texture = ET.SubElement(bsdf, "texture", type="bitmap", name="reflectance")
            ET.SubElement(texture, "string", name="filename", value=albedo)
            if nearest:
                ET.SubElement(texture, "string", name="filter_type", value="nearest")
        else:
            ET.SubElement(bsdf, "rgb", name="reflectance", value=numbers(albedo))

    def mirror(self, name: str, tint: ArrayLike, *, two_sided: bool = False) -> None:
        """Add a perfect mirror that multiplies what it reflects by a linear RGB `tint`."""
        bsdf = self._bsdf("conductor", name, two_sided)
        ET.SubElement(bsdf, "string", name="material", value="none")
        ET.SubElement(bsdf, "rgb", name="specular_reflectance", value=numbers(tint))

    def glass(self, name: str, index: float) -> None:
        """Add clear glass of the given refractive index, in air."""
        bsdf = self._bsdf("dielectric", name, False)
        ET.SubElement(bsdf, "float", name="int_ior", value=numbers(index))
        ET.SubElement(bsdf, "float", name="ext_ior", value="1")

    def point_light(self, position: ArrayLike, irradiance: ArrayLike) -> None:
        """Add a point light; it gives a surface at the origin that faces it this `irradiance`."""
        position = np.asarray(position, dtype=np.float64)
        light = ET.SubElement(self.root, "emitter", type="point")
        ET.SubElement(light, "point", name="position", value=numbers(position))
        intensity = np.asarray(irradiance, dtype=np.float64) * (position @ position)
        ET.SubElement(light, "rgb", name="intensity", value=numbers(np.broadcast_to(intensity, 3)))

    def _shape(self, kind: str, bsdf: str, name: str | None = None) -> ET.Element:
        shape = ET.SubElement(self.root, "shape", {"type": kind} | ({} if name is None else {"id": name}))
        ET.SubElement(shape, "ref", id=bsdf)
        return shape

    def ply(self, filename: str, bsdf: str, name: str | None = None) -> None:
        """Add a mesh file; `name` is the id that films move it by."""
        ET.SubElement(self._shape("ply", bsdf, name), "string", name="filename", value=filename)

    def sphere(
        self, centre: ArrayLike, radius: float, bsdf: str, axes: ArrayLike | None = None, name: str | None = None
    ) -> None:
        """Add a sphere; the rows of `axes` are its own directions x (u = 0), y and z (v = 0)."""
        shape = self._shape("sphere", bsdf, name)
        if axes is None:
            ET.SubElement(shape, "point", name="center", value=numbers(centre))
            ET.SubElement(shape, "float", name="radius", value=numbers(radius))
            return
        matrix = np.eye(4)
        matrix[:3, :3] = np.asarray(axes, dtype=np.float64).T * radius
        matrix[:3, 3] = centre
        pose = ET.SubElement(shape, "transform", name="to_world")
        ET.SubElement(pose, "matrix", value=numbers(matrix, 8))

    def rectangle(
        self,
        centre: ArrayLike,
        size: tuple[float, float],
        bsdf: str,
        rotate: tuple[str, float] | None = None,
    ) -> None:
        """Add a card of `size` (width, height), facing the viewer unless turned (axis, degrees)."""
        pose = ET.SubElement(self._shape("rectangle", bsdf), "transform", name="to_world")
        ET.SubElement(pose, "scale", value=numbers([size[0] / 2.0, size[1] / 2.0, 1.0]))
        if rotate is not None and rotate[1]:
            ET.SubElement(pose, "rotate", {rotate[0]: "1", "angle": numbers(rotate[1])})
        ET.SubElement(pose, "translate", value=numbers(centre))

    def save(self, path: Path) -> None:
        """Write the file."""
        ET.indent(self.root, "  ")
        path.write_text(ET.tostring(self.root, encoding="unicode") + "\n", encoding="utf-8")
