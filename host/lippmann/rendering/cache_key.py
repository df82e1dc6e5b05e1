"""The cached-frame hash: the key of all that the pixels of a picture depend on.

A kept band, a frame of a film and a worker's renderer are used again where their key is the same, and nowhere else.
"""

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

#: The libraries that a picture's pixels depend on.
PIXEL_LIBRARIES = ("mitsuba", "drjit")


def pixels_identity(
    digest: str, placement: Placement, display: Display, options: RenderOptions, **others: object
) -> str:
    """Return the hash, 16 hexadecimal digits, of all that a picture's pixels depend on.

    `digest` is the scene's (`scenes.scene.digest_of`); `others` are what else they depend on, as JSON holds it.
    """
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
    """Return the versions of the packages that a picture's pixels depend on; Lippmann's includes its code's digest."""
    others = {name: importlib.metadata.version(name) for name in PIXEL_LIBRARIES}
    return {"lippmann": __version__ + code_digest(Path(__file__).parents[1]), **others}


@functools.cache
def code_digest(folder: Path) -> str:
    """Return "+" and the hash, 8 hexadecimal digits, of a folder's Python files as they are when it is first asked for.

    Between releases a version has many codes. "" without such files, as where only their compiled forms are installed.
    """
    digest = hashlib.sha256()
    paths = [path for path in sorted(folder.rglob("*.py")) if path.is_file() and not path.name.startswith(".")]
    for path in paths:
        code = path.read_bytes()
        digest.update(f"{path.relative_to(folder)} {len(code)}\n".encode() + code)
    return f"+{digest.hexdigest()[:8]}" if paths else ""
