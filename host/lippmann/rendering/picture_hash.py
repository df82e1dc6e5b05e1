"""Computes a picture's hash, by which bands, frames and workers' renderers are reused."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import itertools
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from lippmann import __version__
from lippmann.base.variant import mi
from lippmann.display.description import Display
from lippmann.rendering.options import RenderOptions
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import check_scene_file, file_of, parsed

PIXEL_LIBRARIES = ("mitsuba", "drjit")


def pixels_identity(
    digest: str, placement: Placement, display: Display, options: RenderOptions, **others: object
) -> str:
    """Return a hash (16 hexadecimal digits) of a picture's inputs; `digest` is from `digest_of`."""
    arguments = asdict(options)
    del arguments["settings"]["memory_mb"]
    parts = {
        "scene": digest,
        "placement": asdict(placement),
        "display": display.identity,
        "options": arguments,
        "versions": list(pixel_versions().values()),
        **others,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def pixel_versions() -> dict[str, str]:
    """Return the versions of packages that affect pixels; Lippmann's includes `code_digest`."""
    others = {name: importlib.metadata.version(name) for name in PIXEL_LIBRARIES}
    return {"lippmann": __version__ + code_digest(Path(__file__).parents[1]), **others}


def digest_of(path: str | Path) -> str:
    """Return a hash (64 hexadecimal digits) of all files of a scene.

    Raises errors of `load_scene`.
    """
    # Hash the converted scene, included files, spectra and files named in properties.
    path = check_scene_file(path)
    digest = hashlib.sha256()
    with parsed(path) as (config, state):
        mi.parser.transform_resolve(config, state)
        files = [Path(str(file)) for file in state.files]
        for name, value in itertools.chain.from_iterable(node.props.items() for node in state.nodes):
            if isinstance(value, str) and (name == "filename" or file_of(value).is_file()):
                files.append(file_of(value))
            elif hasattr(value, "wavelengths"):
                digest.update(np.array([value.wavelengths, value.values]).tobytes())
        for file in dict.fromkeys(files):
            with file.open("rb") as stream:
                digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()


@functools.cache
def code_digest(folder: Path) -> str:
    """Return "+" and a hash (8 hexadecimal digits) of a folder's Python files; "" if it has none."""
    # Between releases, the code changes, but not the version number.
    digest = hashlib.sha256()
    paths = [path for path in sorted(folder.rglob("*.py")) if path.is_file() and not path.name.startswith(".")]
    for path in paths:
        code = path.read_bytes()
        digest.update(f"{path.relative_to(folder)} {len(code)}\n".encode() + code)
    return f"+{digest.hexdigest()[:8]}" if paths else ""
