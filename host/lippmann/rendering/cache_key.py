"""Computes a picture's hash. Bands, frames and workers' renderers of an equal hash are reused."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
from dataclasses import asdict
from pathlib import Path

from lippmann import __version__
from lippmann.display.description import Display
from lippmann.rendering.options import RenderOptions
from lippmann.scenes.placement import Placement

PIXEL_LIBRARIES = ("mitsuba", "drjit")


def pixels_identity(
    digest: str, placement: Placement, display: Display, options: RenderOptions, **others: object
) -> str:
    """Return a hash of the arguments, 16 hexadecimal digits; `digest` is the scene's digest."""
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
    """Return the versions of the packages that determine pixels, Lippmann's with `code_digest`."""
    others = {name: importlib.metadata.version(name) for name in PIXEL_LIBRARIES}
    return {"lippmann": __version__ + code_digest(Path(__file__).parents[1]), **others}


@functools.cache
def code_digest(folder: Path) -> str:
    """Return "+" and 8 hexadecimal digits for a folder's Python files; "" if the folder has none."""
    # Code changes between releases without a new version. Sources may be missing.
    digest = hashlib.sha256()
    paths = [path for path in sorted(folder.rglob("*.py")) if path.is_file() and not path.name.startswith(".")]
    for path in paths:
        code = path.read_bytes()
        digest.update(f"{path.relative_to(folder)} {len(code)}\n".encode() + code)
    return f"+{digest.hexdigest()[:8]}" if paths else ""
