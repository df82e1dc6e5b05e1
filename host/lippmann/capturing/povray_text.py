"""Writes numbers, vectors, blocks and cameras in POV-Ray's scene language.

A camera's `right` vector decides whether POV-Ray's axes are left-handed. The exported
cameras are right-handed, so points stay unchanged and images are not mirrored.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.optics.rays import Floats
from lippmann.scenes.placement import Triple

#: Maximum characters of a name in a file name (file systems allow 255 bytes).
MAX_NAME = 100
#: Size of the triangles whose normals are rays, mm. At 100 mm from the origin, float32
#: rounding of the corners rotates the normal of a 10 mm triangle by 1e-6 rad.
FACE_MM = 10.0
#: Extra rows of a mesh camera's image: POV-Ray 3.7 renders the first row twice.
SPARE_ROWS = 1


def number(value: float) -> str:
    """Return a number as text with ten digits, more than float32 has."""
    return f"{float(value) + 0.0:.10g}"


def vector(values: Iterable[Any]) -> str:
    """Return a vector as POV-Ray text, <x, y, z>."""
    return f"<{', '.join(number(value) for value in values)}>"


def block(name: str, *parts: str) -> str:
    """Return the text `name { parts }`; long blocks have a line for each part."""
    body = "\n".join(parts)
    if "\n" not in body and len(body) < 90:
        return f"{name} {{ {body} }}"
    return f"{name} {{\n{textwrap.indent(body, '  ')}\n}}"


def matrix(values: npt.NDArray[Any]) -> str:
    """Convert a (4, 4) matrix for column vectors to POV-Ray's transform for row vectors."""
    return "matrix " + vector(values[:3, :4].T.ravel())


def rows(values: npt.NDArray[Any]) -> str:
    """Return an (N, k) array as POV-Ray text: N, then each row as a vector."""
    form = "%d" if np.issubdtype(values.dtype, np.integer) else "%.9g"
    line = "<" + ",".join([form] * values.shape[1]) + ">"
    return f"{len(values)},\n" + ",\n".join([line] * len(values)) % tuple(values.ravel().tolist())


def plain(name: str) -> str:
    """Replace all characters except ASCII letters and digits by _."""
    return re.sub(r"\W", "_", name[:MAX_NAME], flags=re.ASCII)


def identifier(kind: str, number: int, name: str) -> str:
    """Return a POV-Ray identifier that `kind` and `number` make unique."""
    return f"L_{kind}{number}_{plain(name)}"


def pinhole(position_mm: Triple, to_window: Triple, width_mm: float, height_mm: float) -> str:
    """Return a pinhole camera for an upright window; `to_window` points to the window's centre, mm."""
    return block(
        "camera",
        f"perspective location {vector(position_mm)}",
        f"right {vector((width_mm, 0, 0))} up {vector((0, height_mm, 0))} direction {vector(to_window)}",
    )


def write_rays(path: Path, origin_mm: Floats, direction: Floats) -> None:
    """Write a camera of rays with origins and unit directions (N, 3), in image order."""
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(direction, across)
    turns = 2.0 * np.pi / 3.0 * np.arange(3)
    corners = [origin_mm + FACE_MM * (np.cos(turn) * across + np.sin(turn) * other) for turn in turns]
    points = np.stack(corners, axis=1).reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)[:, ::-1]
    mesh = f"#declare L_rays = mesh2 {{\nvertex_vectors {{ {rows(points)} }}\nface_indices {{ {rows(faces)} }}\n}}"
    path.write_text(f"{mesh}\ncamera {{ mesh_camera {{ 1 0 mesh {{ L_rays }} }} }}\n")
