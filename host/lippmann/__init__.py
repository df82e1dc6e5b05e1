"""Lippmann: integral photography on a panel behind a microlens array."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lippmann.display import Display, load_display, parse_display
    from lippmann.optics.status import Status
    from lippmann.optics.trace import Hits, Rays, trace, trace_to_panel

__version__ = "0.1.0"

__all__ = [
    "Display",
    "Hits",
    "Rays",
    "Status",
    "load_display",
    "parse_display",
    "trace",
    "trace_to_panel",
]

_HOMES = {
    "lippmann.display": ("Display", "load_display", "parse_display"),
    "lippmann.optics.status": ("Status",),
    "lippmann.optics.trace": ("Hits", "Rays", "trace", "trace_to_panel"),
}


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, so that the command line starts at once."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module 'lippmann' has no attribute '{name}'")
