"""What a result depends on: the hash of the code and the versions in cached frames; the provenance of a report."""

from __future__ import annotations

import contextlib
import datetime
import functools
import hashlib
import importlib.metadata
from collections.abc import Mapping
from pathlib import Path

from lippmann import __version__
from lippmann.base.machine import machine_name


def pixel_versions() -> dict[str, str]:
    """Return the versions of the packages that a picture's pixels depend on; Lippmann's tells its code's digest."""
    others = {name: importlib.metadata.version(name) for name in ("mitsuba", "drjit")}
    return {"lippmann": __version__ + code_digest(Path(__file__).parents[1]), **others}


@functools.cache
def code_digest(folder: Path) -> str:
    """Return "+" and the hash, 8 hexadecimal digits, of a folder's Python files as they are when it is first asked for.

    Between releases a version has many codes. "" without such files, as where only their compiled forms are installed.
    """
    found = hashlib.sha256()
    paths = [path for path in sorted(folder.rglob("*.py")) if path.is_file() and not path.name.startswith(".")]
    for path in paths:
        code = path.read_bytes()
        found.update(f"{path.relative_to(folder)} {len(code)}\n".encode() + code)
    return f"+{found.hexdigest()[:8]}" if paths else ""


def provenance(
    command: str, packages: tuple[str, ...] = ("mitsuba", "drjit", "numpy"), programs: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return the provenance of a report: machine, date, command, versions of Lippmann, of programs, some packages."""
    versions = dict(programs or {})
    for name in packages:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # an extra that is not installed
            versions[name] = importlib.metadata.version(name)
    return {
        "machine": machine_name(),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": command,
        "versions": ", ".join([f"lippmann {__version__}", *(f"{k} {v}" for k, v in versions.items())]),
    }
