"""Converts 3D Gaussian splats (a trainer's .ply) to a Mitsuba scene with the shape `ellipsoids`.

A splat has a centre, the logarithms of three scales, a quaternion, the logit of its
opacity, and spherical harmonics of its sRGB colour: f_dc_0..2, then f_rest_* for red,
for green and for blue.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.errors import input_error
from lippmann.scenes.mitsuba_xml import new_scene, plugin, value, write

#: Permitted degrees of spherical harmonics; 3 (degree + 1)^2 coefficients each.
DEGREES = (0, 1, 2, 3)
PLACE = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
COLOUR = ("f_dc_0", "f_dc_1", "f_dc_2")
SHAPE = ("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")
#: Logit of the minimum opacity; below 1 %, Mitsuba cannot compute a splat's extent.
MIN_LOGIT = float(np.log(0.0101 / (1.0 - 0.0101)))
MAX_LOG = 30.0
MAX_BYTES = 2 << 30
REMEDY = "export it again from the trainer or a splat editor"


def write_scene(path: Path, folder: Path) -> Path:
    """Write a scene of a file's splats into an empty folder; return its path, or raise InputError."""
    table = _read(path)
    file = folder / "splats.ply"
    write_table(file, table)
    scene = new_scene()
    value(plugin(scene, "shape", "ellipsoids", id="splats"), "string", "filename", file.name)
    return write(scene, folder / "scene.xml")


def write_table(path: Path, table: npt.NDArray[np.void]) -> None:
    """Write a PLY file of splats; a column of the table is a property."""
    import plyfile

    plyfile.PlyData([plyfile.PlyElement.describe(table, "vertex")], byte_order="<").write(str(path))


def _read(path: Path) -> npt.NDArray[np.void]:
    import plyfile

    if path.stat().st_size > MAX_BYTES:
        raise input_error(path, f"is larger than {MAX_BYTES >> 30} GiB", "reduce it in a splat editor")
    try:
        vertex = plyfile.PlyData.read(str(path), mmap=False)["vertex"]
    except (plyfile.PlyParseError, KeyError, ValueError, UnicodeDecodeError, OverflowError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200]
        raise input_error(path, f"cannot be read as ply ({reason})", REMEDY) from None
    there = [one.name for one in vertex.properties]
    missing = [name for name in (*PLACE, *COLOUR, *SHAPE) if name not in there]
    if missing:
        what = "has splats without colours" if set(missing) & set(COLOUR) else "has points that are not splats"
        raise input_error(path, f"{what}: no property {', '.join(missing)}", REMEDY)
    harmonics = [name for k in range(3 * (DEGREES[-1] + 1) ** 2 - 3) if (name := f"f_rest_{k}") in there]
    if len(harmonics) not in (counts := [3 * degree * (degree + 2) for degree in DEGREES]):
        raise input_error(path, f"has {len(harmonics)} properties f_rest_*, not one of {counts}", REMEDY)
    names = (*PLACE, *COLOUR, *harmonics, *SHAPE)
    # Mitsuba requires normals, and ignores them.
    table = np.zeros(vertex.count, [(name, "<f4") for name in (*PLACE, *NORMAL, *names[len(PLACE) :])])
    for name in names:
        try:
            table[name] = vertex[name]
        except (ValueError, TypeError):
            raise input_error(path, f"property {name} is not a number", REMEDY) from None
    if not vertex.count:
        raise input_error(path, "has no splats", "give a file with splats")
    wrong = ~np.all([np.isfinite(table[name]) for name in names], axis=0)
    if wrong.any():
        what = f"{wrong.sum()} splats have numbers that are not finite"
        raise input_error(path, what, "remove them in a splat editor")
    sizes = np.array([table[name] for name in SHAPE if name.startswith("scale")])
    if np.abs(sizes).max() > MAX_LOG:
        what = f"has splats whose size is e to the {max(sizes.flat, key=abs):.3g}"
        raise input_error(path, what, "remove them in a splat editor")
    table["opacity"] = np.maximum(table["opacity"], MIN_LOGIT)
    return table
