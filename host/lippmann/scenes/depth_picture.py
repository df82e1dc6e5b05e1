"""Converts a picture with depths (RGB-D), named in a TOML file, to a Mitsuba scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from lippmann.base import toml
from lippmann.base.file_limits import read_limited
from lippmann.base.images import read_numbers
from lippmann.base.toml import documented, key
from lippmann.errors import input_error, not_there
from lippmann.optics.rays import Floats
from lippmann.scenes.meshes import write_surface
from lippmann.scenes.mitsuba_xml import new_scene, plugin, to_world, value, write
from lippmann.scenes.quilts_and_views import Views, read_light

#: Maximum depth pixels, and maximum bytes of the TOML file.
MAX_PIXELS, MAX_BYTES = 1 << 23, 1 << 28


@documented
@dataclass(frozen=True, kw_only=True)
class DepthPicture:
    """The table `[depth_picture]`. The camera looks along -z through the picture's centre."""

    colour: Annotated[Path, key("the picture's file")]
    depth: Annotated[
        Path,
        key("the depths' file (.png, .tif, .exr): how far a pixel is, along the camera's axis; 0 where unknown"),
    ]
    unit_mm: Annotated[float, key("mm of a depth of 1: 1 for millimetres, 1000 for metres", above=0.0)]
    fov_deg: Annotated[float, key("the picture's width as the camera sees it", above=0.0, high=170.0)]


@dataclass(frozen=True)
class DepthPictureFile:
    """The file of a picture with depths; it can also have the table `[placement]`."""

    other_tables: ClassVar = True
    depth_picture: DepthPicture


def is_depth_picture(path: Path) -> bool:
    """Return whether a file describes a picture with depths."""
    return path.suffix.lower() == ".toml" and b"[depth_picture]" in read_limited(path, MAX_BYTES, "give another file")


def write_scene(path: Path, folder: Path, notes: list[str]) -> Path:
    """Write a scene of the picture into a folder; return its path. `notes` gets a line if depths are missing."""
    form = toml.read(DepthPictureFile, toml.load(path, "depth picture"), str(path)).depth_picture
    for name in ("colour", "depth"):
        file = path.parent / getattr(form, name)
        if not file.is_file():
            raise input_error(f"{path}: {name}: {getattr(form, name)}", not_there(file), "correct the name")
    colours = read_light(path.parent / form.colour)[0].astype(np.float16)
    depth = _depths(path.parent / form.depth) * form.unit_mm
    if depth.shape != colours.shape[:2]:
        sizes = [f"{shape[1]} x {shape[0]}" for shape in (depth.shape, colours.shape)]
        raise input_error(path, f"depth has {sizes[0]} pixels, colour {sizes[1]}", "give equal sizes")
    has_depth = np.isfinite(depth) & (depth > 0.0)
    if not has_depth.any():
        raise input_error(path, "no pixel has a depth above 0", "check depth and unit_mm")
    if not has_depth.all():
        holes = depth.size - int(has_depth.sum())
        notes.append(f"note: {holes} of {depth.size} pixels have no depth; each gets its nearest neighbour's depth")
        from scipy import ndimage

        nearest = ndimage.distance_transform_edt(~has_depth, return_distances=False, return_indices=True)
        depth = depth[tuple(nearest)]
    focal = 0.5 * depth.shape[1] / math.tan(math.radians(0.5 * form.fov_deg))
    _write_points(folder / "surface.ply", depth, focal)
    scene = new_scene()
    camera = plugin(scene, "sensor", "perspective")
    value(camera, "float", "fov", form.fov_deg)
    value(camera, "string", "fov_axis", "x")
    to_world(camera, "rotate", y=1, angle=180)  # Mitsuba's cameras look along z
    shape = plugin(scene, "shape", "ply", id="surface")
    value(shape, "string", "filename", "surface.ply")
    Views(colours[None, None], [0.0], [0.0], 1.0, (1.0, 1.0)).show_on(shape, folder)
    return write(scene, folder / "scene.xml")


def _depths(path: Path) -> Floats:
    if path.suffix.lower() == ".exr":
        return np.asarray(read_light(path)[0][..., 0], np.float64)
    numbers = read_numbers(path, MAX_PIXELS, "cannot be read as a picture", "give .png, .tif or .exr")
    if numbers.ndim == 3 and (numbers[..., :3] != numbers[..., :1]).any():
        raise input_error(path, "has colours, not depths", "give a picture with one channel, 16 bits or float")
    return np.asarray(numbers[..., 0] if numbers.ndim == 3 else numbers, np.float64)


def _write_points(path: Path, depth: Floats, focal_px: float) -> None:
    height, width = depth.shape
    row, column = np.mgrid[:height, :width]
    x, y = column + 0.5 - 0.5 * width, 0.5 * height - row - 0.5
    points = np.stack([x / focal_px * depth, y / focal_px * depth, -depth], axis=-1)
    uv = np.stack([(column + 0.5) / width, 1.0 - (row + 0.5) / height], axis=-1).reshape(-1, 2)
    number = (row * width + column).astype(np.uint32)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack(some, axis=-1).reshape(-1, 3) for some in ((a, b, d), (b, c, d))])
    write_surface(path, points.reshape(-1, 3), faces, uv=uv)
