"""Modules of version 0.1 that have a new name: an import of the old one fails with an error that names the new one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType

MOVED = {
    "bench": "lippmann.measure, lippmann.report and lippmann.dev",
    "capture": "lippmann.capturing; lippmann.capture is a function now",
    "choose": "lippmann.select.model",
    "derived": "lippmann.display_properties",
    "fit": "lippmann.select.build",
    "fixed.trace": "lippmann.engines and lippmann.fixed.conversion",
    "hard": "lippmann.conditioning and lippmann.diagnose",
    "link.board": "lippmann.board.board",
    "link.stream": "lippmann.board.stream",
    "observe": "lippmann.observer; lippmann.observe is a function now",
    "optics.status": "lippmann.optics.rays",
    "optics.trace": "lippmann.engines, lippmann.optics.rays and lippmann.optics.pixel_rays",
    "render": "lippmann.rendering; lippmann.render is a function now",
    "sim.generate_registers": "lippmann.dev.generate_registers",
    "sim.mutation": "lippmann.dev.mutation",
    "sim.synthesis": "lippmann.dev.synthesis",
    "view": "lippmann.viewer; lippmann.view is a function now",
}


class _Moved:  # without importlib.abc, which loads much before the first signal can be answered
    """Python asks it first: an old folder may have stayed, with nothing but compiled files in it."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Name the new module where `name` is an old one."""
        new = MOVED.get(name.removeprefix("lippmann."))
        if new and name.startswith("lippmann."):
            raise ModuleNotFoundError(f"module '{name}' is gone; import from {new}", name=name)


def watch() -> None:
    """Let Python ask for old names."""
    sys.meta_path.insert(0, _Moved())
