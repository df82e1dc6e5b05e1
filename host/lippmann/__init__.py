"""Lippmann: integral photography on a panel behind a microlens array."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lippmann.errors import MissingLibraryError, missing_library

if TYPE_CHECKING:
    from lippmann.api import capture, draw, load_layers, load_scene, observe, render, sweep, view, widget
    from lippmann.board.board import Board
    from lippmann.capturing.capture_setup import load_setup
    from lippmann.display.description import Display, load_display, parse_display
    from lippmann.engines import trace
    from lippmann.layers.stack import Layer, LayerStack
    from lippmann.optics.rays import Hits, Rays, Status
    from lippmann.optics.trace import trace_to_panel
    from lippmann.rendering.integral_image import IntegralImage
    from lippmann.scenes.placement import Placement

__version__ = "0.2.0.dev0"

__all__ = [
    "Board",
    "Display",
    "Hits",
    "IntegralImage",
    "Layer",
    "LayerStack",
    "Placement",
    "Rays",
    "Status",
    "capture",
    "draw",
    "load_display",
    "load_layers",
    "load_scene",
    "load_setup",
    "observe",
    "parse_display",
    "render",
    "sweep",
    "trace",
    "trace_to_panel",
    "view",
    "widget",
]

_HOMES = {
    "lippmann.api": ("capture", "draw", "load_layers", "load_scene", "observe", "render", "sweep", "view", "widget"),
    "lippmann.board.board": ("Board",),
    "lippmann.capturing.capture_setup": ("load_setup",),
    "lippmann.display.description": ("Display", "load_display", "parse_display"),
    "lippmann.engines": ("trace",),
    "lippmann.optics.trace": ("trace_to_panel",),
    "lippmann.rendering.integral_image": ("IntegralImage",),
    "lippmann.layers.stack": ("Layer", "LayerStack"),
    "lippmann.optics.rays": ("Hits", "Rays", "Status"),
    "lippmann.scenes.placement": ("Placement",),
}


class _Missing:
    """Placeholder for a public name; any use raises the error of its missing library."""

    def __init__(self, error: MissingLibraryError) -> None:
        self._error = error

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name) if name.startswith("__") else self._error

    def __call__(self, *_: object, **__: object) -> Any:
        raise self._error


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, so that commands start quickly."""
    for home, names in _HOMES.items():
        if name in names:
            try:
                return getattr(import_module(home), name)
            except ImportError as error:
                return _Missing(missing_library(error))
    raise AttributeError(f"module 'lippmann' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
