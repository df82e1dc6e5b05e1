"""Loads a scene with some of its shapes moved; the file does not change."""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from lippmann.errors import input_error
from lippmann.variant import mitsuba

if TYPE_CHECKING:
    from collections.abc import Iterator

Matrix = npt.NDArray[np.float64]
#: Ids that an error message lists.
LISTED_IDS = 8


@dataclass(frozen=True)
class Move:
    """A similarity (4, 4), in the scene's frame, of all shapes whose id matches a pattern (`*`, `?`)."""

    shapes: str
    matrix: Matrix


def load_moved(path: Path, moves: Sequence[Move]) -> Any:
    """Load a scene file with its shapes moved, in the order of the moves.

    Raises
    ------
    InputError
        When no shape matches a pattern.
    RuntimeError
        From Mitsuba, for a broken scene.
    """
    mi = mitsuba()
    configuration = mi.parser.ParserConfig(mi.variant())
    state = mi.parser.parse_file(configuration, str(path))
    shapes = [node.props for node in state.nodes if node.type == mi.ObjectType.Shape]
    for move in moves:
        chosen = [props for props in shapes if fnmatch.fnmatchcase(props.id(), move.shapes)]
        if not chosen:
            raise input_error(str(path), f"no shape's id matches '{move.shapes}'", _ids_there(shapes))
        motion = mi.ScalarTransform4d(move.matrix)
        for props in chosen:
            props["to_world"] = motion @ props["to_world"] if "to_world" in props else motion
    with _beside(path):
        mi.parser.transform_all(configuration, state)
        return mi.parser.instantiate(configuration, state)


def scene_digest(path: Path) -> str:
    """Return a hash, 64 hexadecimal digits, of a scene file, its includes, and the meshes and textures that it names.

    Raises
    ------
    RuntimeError
        From Mitsuba, for a broken scene.
    OSError
        When a file cannot be read.
    """
    mi = mitsuba()
    configuration = mi.parser.ParserConfig(mi.variant())
    state = mi.parser.parse_file(configuration, str(path))
    mi.parser.transform_resolve(configuration, state)
    named = [Path(str(file)) for file in state.files]
    with _beside(path):
        for node in state.nodes:
            if "filename" in node.props:
                named.append(Path(str(mi.file_resolver().resolve(mi.filesystem.path(node.props["filename"])))))
    digest = hashlib.sha256()
    for file in dict.fromkeys(named):
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _ids_there(shapes: Sequence[Any]) -> str:
    ids = [props.id() for props in shapes if props.id()]
    if not ids:
        return 'give the shapes ids in the file: <shape type="ply" id="...">'
    more = f" and {len(ids) - LISTED_IDS} more" if len(ids) > LISTED_IDS else ""
    return f"there are {', '.join(ids[:LISTED_IDS])}{more}"


@contextmanager
def _beside(path: Path) -> Iterator[None]:
    """Let Mitsuba find files beside the scene file, as its own loader does."""
    mi = mitsuba()
    before = mi.file_resolver()
    resolver = mi.FileResolver(before)
    resolver.prepend(mi.filesystem.path(str(path.parent)))
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)
