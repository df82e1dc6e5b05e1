"""The integral image: radiance, the display that it was made for, and metadata.

A file carries the identity of the display and the transfer curve and bits of its panel. `IntegralImage.load` checks the
identity, and in a PNG, which contains panel values, curve and bits too; linear radiance fits every curve.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

from lippmann.display import Display
from lippmann.errors import DeviceError, input_error
from lippmann.fullscreen import show_window
from lippmann.images import ENCODED_SUFFIXES, Radiance, encoded_values, png_bytes, read_picture, write_picture
from lippmann.tones import transfer_name, transfer_text


class Showable:
    """Something with radiance that a notebook or a window shows, in sRGB."""

    radiance: Radiance

    def _repr_png_(self) -> bytes:
        """Return the PNG that a notebook shows."""
        return png_bytes(self.radiance)

    def show(self, seconds: float | None = None) -> None:
        """Show the image: in a notebook below its cell, else in a window.

        The window closes with Escape, q or its close button, or after `seconds`. Without a desktop (a server, a batch
        job) a line on stderr says so and the program goes on.
        """
        if _in_notebook():
            import_module("IPython.display").display(self)
            return
        try:
            show_window(encoded_values(self.radiance, "srgb", 8), "Lippmann", seconds)
        except DeviceError as error:
            print(f"lippmann: not shown: {error}; or save it to a file", file=sys.stderr)


def _in_notebook() -> bool:
    """Tell whether a notebook's kernel runs this code; programs that only start kernels load ipykernel, too."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


@dataclass(frozen=True, eq=False)
class IntegralImage(Showable):
    """The picture that a display's panel shows.

    Attributes
    ----------
    radiance
        (height, width, 3) float32 of the panel's pixels, linear.
    display
        The display that it was made for.
    metadata
        How it was made: display, identity, the panel's transfer curve and bits, model, samples, seed, versions, ...
    measured
        What making it took, such as `seconds`, and a capture's losses; not saved. Empty for a loaded image.

    Raises
    ------
    InputError
        When the radiance has not the panel's size.
    """

    radiance: Radiance
    display: Display
    metadata: dict[str, str] = field(default_factory=dict)
    measured: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the size, and name the display in the metadata."""
        panel = self.display.panel
        if self.radiance.shape != (panel.height_px, panel.width_px, 3):
            size = " x ".join(str(side) for side in self.radiance.shape)
            what = f"the radiance is {size}, the panel {panel.height_px} x {panel.width_px} x 3"
            raise input_error(f"image for display '{self.display.name}'", what, "render it for this display")
        self.metadata.update({"display": self.display.name, "identity": self.display.identity, **_tones(self.display)})

    def save(self, path: str | Path) -> None:
        """Write the image: .exr and .tif keep linear radiance, .png the panel's values by its own curve and bits.

        Raises
        ------
        InputError
            When the file cannot be written.
        """
        panel = self.display.panel
        write_picture(path, self.radiance, self.metadata, panel.transfer, panel.bits)

    @classmethod
    def load(cls, path: str | Path, display: Display, force: bool = False) -> IntegralImage:
        """Read an image that was made for a display. Version 0.1 saved no bits, which are then not checked.

        Parameters
        ----------
        path
            An image file (.exr, .tif, .png).
        display
            The display.
        force
            Accept an image for another display, or one that names none.

        Raises
        ------
        InputError
            When the file is missing, broken, of another size, or made for another display, or is a PNG for another
            transfer curve or number of bits.
        """

        def accept(metadata: Mapping[str, str]) -> None:
            if not force:
                _check(metadata, display, str(path), Path(path).suffix.lower() in ENCODED_SUFFIXES)

        picture = read_picture(path, (display.panel.width_px, display.panel.height_px), accept)
        return cls(picture.radiance, display, dict(picture.metadata))


def _tones(display: Display) -> dict[str, str]:
    """Return the panel's transfer curve and bits as metadata."""
    return {"transfer": transfer_text(display.panel.transfer), "bits": str(display.panel.bits)}


def _check(metadata: Mapping[str, str], display: Display, source: str, encoded: bool) -> None:
    """Refuse a file (`source`) made for another display, and one of panel values (`encoded`) for other tones."""
    identity = metadata.get("identity")
    if identity != display.identity:
        made = f"was made for display '{metadata.get('display', '?')}' ({identity})"
        what = f"{'names no display' if identity is None else made}, not for '{display.name}' ({display.identity})"
        remedy = "give the display that it was made for, or --force (force=True in Python)"
        raise input_error(source, what, remedy)
    for key, wanted in _tones(display).items():
        found = metadata.get(key, wanted)
        if encoded and found != wanted:
            names = transfer_name(found), transfer_name(wanted)
            what = f"was made for a panel with {key} {names[0]}, '{display.name}' has {key} {names[1]}"
            raise input_error(source, what, "render it for this display, or give --force (force=True in Python)")
