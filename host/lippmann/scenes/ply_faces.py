"""A check of a mesh (.ply) before Mitsuba reads it, which takes the vertices' numbers of its faces as they are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.errors import input_error

REMEDY = "export it again"
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
        raise input_error(str(path), f"cannot be read as ply ({reason})", REMEDY) from None
    if worst is not None:
        raise input_error(str(path), f"a face names vertex {worst} of {vertices}", REMEDY)


def _worst(lists: Any, vertices: int) -> int | None:
    """Return a number that is no vertex's; None when all are."""
    numbers = np.asarray(lists)
    if numbers.dtype == object and len(numbers):
        numbers = np.concatenate(numbers)
    for number in (int(numbers.min()), int(numbers.max())) if numbers.size else ():
        if not 0 <= number < vertices:
            return number
    return None
