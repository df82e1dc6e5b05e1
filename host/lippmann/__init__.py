"""Lippmann: integral photography on a panel behind a microlens array."""

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
