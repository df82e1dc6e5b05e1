"""Shows the viewer page, or the views of a moving eye, in a notebook."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lippmann.base.animation import FRAME_MS, animation_bytes, write_animation
from lippmann.eye.observer import View
from lippmann.rendering.integral_image import show_pictures

#: Height of the viewer page in a notebook, pixels.
HEIGHT_PX = 720


@dataclass(frozen=True, repr=False)
class Widget:
    """The viewer page of an image, for a notebook."""

    page: str
    height_px: int

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self.height_px}px; border: 0"
        return f'<iframe sandbox="allow-scripts" style="{style}" srcdoc="{html.escape(self.page)}"></iframe>'

    def __repr__(self) -> str:
        return f"<Widget, {len(self.page) / 1e6:.1f} MB>"


@dataclass(frozen=True, repr=False)
class Sweep:
    """The views of a moving eye, in the order of its positions."""

    views: Sequence[View]

    def _repr_html_(self) -> str:
        animation = animation_bytes([view.radiance for view in self.views], "PNG")
        return f'<img src="data:image/png;base64,{base64.b64encode(animation).decode()}">'

    def __repr__(self) -> str:
        height, width = self.views[0].radiance.shape[:2]
        return f"<Sweep, {len(self.views)} views of {width} x {height} px>"

    def save(self, path: str | Path) -> None:
        """Write the views, forwards then backwards, as .gif or animated .png; may raise InputError."""
        write_animation(path, [view.radiance for view in self.views])

    def show(self, seconds: float | None = None) -> None:
        """Show the views, forwards then backwards, in a notebook or a window (see `View.show`)."""
        show_pictures(self, [*self.views, *self.views[-2:0:-1]], seconds, FRAME_MS / 1000.0)
