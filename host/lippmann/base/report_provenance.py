"""Describes how a report was made: machine, date, command and versions."""

from __future__ import annotations

import contextlib
import datetime
import importlib.metadata
from collections.abc import Mapping

from lippmann import __version__
from lippmann.base.machine import machine_name


def provenance(command: str, packages: tuple[str, ...], programs: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return machine, date, command, and the versions of Lippmann, programs and packages."""
    versions = dict(programs or {})
    for name in packages:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # an optional package is not installed
            versions[name] = importlib.metadata.version(name)
    return {
        "machine": machine_name(),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": command,
        "versions": ", ".join([f"lippmann {__version__}", *(f"{k} {v}" for k, v in versions.items())]),
    }
