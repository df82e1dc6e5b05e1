"""A triangle mesh as a file that Mitsuba reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lippmann.base.variant import mitsuba


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
