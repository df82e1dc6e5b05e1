"""Lippmann: integral photography on a panel behind a microlens array."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lippmann.board.board import Board
    from lippmann.display import Display, load_display, parse_display
    from lippmann.engines import trace, trace_to_panel
    from lippmann.optics.rays import Hits, Rays, Status

__version__ = "0.1.0"

__all__ = [
    "Board",
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
    "lippmann.board.board": ("Board",),
    "lippmann.display": ("Display", "load_display", "parse_display"),
    "lippmann.engines": ("trace", "trace_to_panel"),
    "lippmann.optics.rays": ("Hits", "Rays", "Status"),
}


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, so that the command line starts at once."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module 'lippmann' has no attribute '{name}'")
