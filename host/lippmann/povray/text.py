"""Numbers, vectors and blocks as POV-Ray's scene language writes them.

POV-Ray's frame is left-handed by custom only: points and matrices are written as they are, and the camera names its
own right, so that pictures come out unmirrored.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

#: Characters of a name that are kept: file systems end at 255 bytes.
MAX_NAME = 100


def number(value: float) -> str:
    """Return a number with all that float32 holds, and a little more."""
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
    """Return a transform from a (4, 4) matrix for columns of points; POV-Ray multiplies rows: written transposed."""
    return "matrix " + vector(np.asarray(values)[:3, :4].T.ravel())


def rows(values: npt.NDArray[Any]) -> str:
    """Return the rows of an (N, k) array as vectors, after their number, as meshes want them."""
    whole = np.issubdtype(values.dtype, np.integer)
    form = "%d" if whole else "%.9g"
    line = "<" + ",".join([form] * values.shape[1]) + ">"
    return f"{len(values)},\n" + ",\n".join([line] * len(values)) % tuple(values.ravel().tolist())


def plain(name: str) -> str:
    """Return a name with nothing but ASCII letters, digits and _: for files, and as a part of identifiers."""
    return re.sub(r"\W", "_", name[:MAX_NAME], flags=re.ASCII)


def identifier(kind: str, number: int, name: str) -> str:
    """Return a name that POV-Ray takes and none of its keywords; kind and number make it the only one."""
    return f"L_{kind}{number}_{plain(name)}"
