"""Numbers, vectors, blocks and cameras as POV-Ray's scene language writes them.

POV-Ray's frame is left-handed only by convention: points and matrices are written unchanged, and the camera defines its
own right, so that images are not mirrored.

The cameras' rays go through the pixels' centres, as Lippmann's do with one sample.
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

#: Longest part of a name that is kept, characters: file systems allow 255 bytes.
MAX_NAME = 100


def number(value: float) -> str:
    """Return a number with more digits than float32 has."""
    return f"{float(value) + 0.0:.10g}"


def vector(values: Iterable[Any]) -> str:
    """Return a vector, <x, y, z>."""
    return f"<{', '.join(number(value) for value in values)}>"


def block(name: str, *parts: str) -> str:
    """Return `name { parts }`, a line each, indented."""
    body = "\n".join(part for part in parts if part)
    if "\n" not in body and len(body) < 90:
        return f"{name} {{ {body} }}"
    return f"{name} {{\n{textwrap.indent(body, '  ')}\n}}"


def matrix(values: npt.NDArray[Any]) -> str:
    """Return a transform from a (4, 4) matrix for column vectors, transposed for POV-Ray's row vectors."""
    return "matrix " + vector(np.asarray(values)[:3, :4].T.ravel())


def rows(values: npt.NDArray[Any]) -> str:
    """Return the number of rows of an (N, k) array, then the rows as vectors, as meshes need them."""
    is_integer = np.issubdtype(values.dtype, np.integer)
    form = "%d" if is_integer else "%.9g"
    line = "<" + ",".join([form] * values.shape[1]) + ">"
    return f"{len(values)},\n" + ",\n".join([line] * len(values)) % tuple(values.ravel().tolist())


def plain(name: str) -> str:
    """Return a name of ASCII letters, digits and _ only, for files and parts of identifiers."""
    return re.sub(r"\W", "_", name[:MAX_NAME], flags=re.ASCII)


def identifier(kind: str, number: int, name: str) -> str:
    """Return a valid identifier that is not a keyword; kind and number make it unique."""
    return f"L_{kind}{number}_{plain(name)}"


#: Size of the triangles that define rays, mm: POV-Ray stores their corners in float32, which 100 mm from the origin
#: rotates the normal of a triangle of 10 mm by a microradian.
FACE_MM = 10.0
#: POV-Ray 3.7 renders each row of such a camera one row too low, and the first row twice.
SPARE_ROWS = 1


def pinhole(position_mm: Triple, to_window: Triple, width_mm: float, height_mm: float) -> str:
    """Return a pinhole camera that looks through an upright window; `to_window` leads to the window's centre, mm."""
    return block(
        "camera",
        f"perspective location {vector(position_mm)}",
        f"right {vector((width_mm, 0, 0))} up {vector((0, height_mm, 0))} direction {vector(to_window)}",
    )


def write_rays(path: Path, origin_mm: Floats, direction: Floats) -> None:
    """Write a camera with one ray for each pixel: the ray of pixel k starts at the centre of face k, along its normal.

    The origins and the unit directions are (N, 3), row by row from the image's top left.
    """
    # Two unit vectors perpendicular to each ray; the first from the axis that is most perpendicular to it.
    helper = np.eye(3)[np.abs(direction).argmin(axis=1)]
    across = np.cross(direction, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(direction, across)
    # An equilateral triangle about the origin.
    corners = [
        origin_mm + FACE_MM * (np.cos(turn) * across + np.sin(turn) * other)
        for turn in 2.0 * np.pi / 3.0 * np.arange(3)
    ]
    points = np.stack(corners, axis=1).reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)[:, ::-1]
    mesh = f"#declare L_rays = mesh2 {{\nvertex_vectors {{ {rows(points)} }}\nface_indices {{ {rows(faces)} }}\n}}"
    path.write_text(f"{mesh}\ncamera {{ mesh_camera {{ 1 0 mesh {{ L_rays }} }} }}\n")
