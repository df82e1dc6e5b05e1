"""Numbers, vectors and blocks as POV-Ray's scene language writes them.

POV-Ray's frame is left-handed only by convention: points and matrices are written unchanged, and the camera defines its
own right, so that images are not mirrored.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

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
    whole = np.issubdtype(values.dtype, np.integer)
    form = "%d" if whole else "%.9g"
    line = "<" + ",".join([form] * values.shape[1]) + ">"
    return f"{len(values)},\n" + ",\n".join([line] * len(values)) % tuple(values.ravel().tolist())


def plain(name: str) -> str:
    """Return a name of ASCII letters, digits and _ only, for files and parts of identifiers."""
    return re.sub(r"\W", "_", name[:MAX_NAME], flags=re.ASCII)


def identifier(kind: str, number: int, name: str) -> str:
    """Return a valid identifier that is not a keyword; kind and number make it unique."""
    return f"L_{kind}{number}_{plain(name)}"
