"""Defines the integral image: radiance, metadata, and the display for which it was made."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import cast

import numpy as np

from lippmann.base.animation import png_bytes
from lippmann.base.fullscreen import LOOK_S, show_frames
from lippmann.base.images import (
    ENCODED_SUFFIXES,
    Radiance,
    StoredRows,
    check_metadata,
    describe_wrong,
    read_picture,
    write_picture,
)
from lippmann.base.tones import encoded_values, transfer_name, transfer_text
from lippmann.display.description import Display, display_at
from lippmann.errors import DeviceError, InputError, check_flags, check_type, input_error, warn_user


class Showable:
    """A picture with linear radiance that a notebook or a window shows in sRGB."""

    radiance: Radiance
    metadata: dict[str, str]

    def __repr__(self) -> str:
        height, width = self.radiance.shape[:2]
        return f"<{type(self).__name__}, {width} x {height} px, {self.metadata}>"

    def _repr_png_(self) -> bytes:
        return png_bytes(self.radiance)

    def show(self, seconds: float | None = None) -> None:
        """Show the image below a notebook's cell, or in a window.

        Escape, q, the close button or the end of `seconds` closes the window.
        Without a desktop, as on a server, a line on stderr says so.
        """
        show_pictures(self, [self], seconds)


def show_pictures(widget: object, pictures: Sequence[Showable], seconds: float | None, frame_s: float = LOOK_S) -> None:
    """Show `widget` in a notebook, or its pictures in a window; without a desktop, print a line to stderr."""
    ipython = sys.modules.get("IPython")
    if ipython is not None and hasattr(ipython.get_ipython(), "kernel"):
        import_module("IPython.display").display(widget)
        return
    try:
        show_frames([encoded_values(one.radiance, "srgb", 8) for one in pictures], seconds, frame_s)
    except DeviceError as error:
        print(f"lippmann: not shown: {error}; or save it to a file", file=sys.stderr)


@dataclass(frozen=True, eq=False, repr=False)
class IntegralImage(Showable):
    """The picture of a display's panel. Raises InputError for radiance that is integer, not finite or of another size.

    Attributes
    ----------
    radiance
        Linear radiance of the panel's pixels, (height, width, 3) float32; `StoredRows`
        if loaded with `stored`.
    display
        The display for which the image was made.
    metadata
        The display's name and identity, the panel's transfer curve and bits, model,
        samples, seed, versions, ...
    measured
        Figures of the render, such as `seconds`, or of a capture; not saved.
    """

    radiance: Radiance
    display: Display
    metadata: dict[str, str] = field(default_factory=dict)
    measured: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_type("display", self.display, Display, "a lippmann.Display")
        for name in ("metadata", "measured"):
            check_type(name, getattr(self, name), Mapping, "a dictionary")
        if not isinstance(self.radiance, np.ndarray | StoredRows):
            try:
                object.__setattr__(self, "radiance", np.asarray(self.radiance))
            except ValueError:  # the rows have different lengths
                raise InputError("radiance is not an array; give (height, width, 3) float32") from None
        panel, where = self.display.panel, f"image for display '{self.display.name}'"
        if not np.issubdtype(self.radiance.dtype, np.floating):
            what = f"the radiance is {self.radiance.dtype}, not linear light, where 1 is white"
            remedy = "give float32; IntegralImage.load decodes the values of a PNG"
            raise input_error(where, what, remedy)
        if self.radiance.shape != panel.shape:
            size = " x ".join(str(side) for side in self.radiance.shape)
            what = f"the radiance is {size}, the panel {panel.height_px} x {panel.width_px} x 3"
            raise input_error(where, what, "render it for this display")
        if self.radiance.dtype != np.float32:
            with np.errstate(over="ignore"):
                object.__setattr__(self, "radiance", self.radiance.astype(np.float32))
        radiance: object = self.radiance
        if not isinstance(radiance, StoredRows):  # rows of a file are checked when they are read
            if what := describe_wrong(self.radiance):
                raise input_error(where, f"the radiance has {what}", "replace NaN and infinity (numpy.nan_to_num)")
            if what := describe_wrong(self.radiance, negative=True):
                warn_user(f"{where}: {what}, which a display shows as black")
        texts = {str(key): str(value) for key, value in self.metadata.items()}
        check_metadata(texts)
        object.__setattr__(self, "metadata", {**texts, **metadata_of(self.display)})

    def save(self, path: str | Path) -> None:
        """Write radiance (.exr, .tif) or the panel's values (.png) to a file.

        Raises InputError if writing fails or the radiance is not finite.
        """
        panel = self.display.panel
        write_picture(path, self.radiance, self.metadata, panel.transfer, panel.bits)

    @classmethod
    def load(
        cls, path: str | Path, display: str | Path | Display, force: bool = False, stored: bool = False
    ) -> IntegralImage:
        """Read an image made for a display. In files from version 0.1, the number of bits is not checked.

        Parameters
        ----------
        path
            An image file (.exr, .tif, .png).
        display
            A display file, or a display from `load_display`.
        force
            Accept an image for another display, or for an unknown display. The image
            keeps the display's name and identity in its file.
        stored
            Leave the pixels in the file. `observe` reads only the rows that it needs.

        Raises
        ------
        InputError
            If the file is missing or broken, or was made for another size or display;
            for a PNG also if the transfer curve or the number of bits differs.
        """
        check_flags(force=force, stored=stored)
        built = display_at(display)
        accept = None if force else partial(_check_metadata, built, path)
        size = built.panel.size_px
        file = StoredRows(path, size, accept) if stored else read_picture(path, size, accept)
        radiance = cast(Radiance, file) if isinstance(file, StoredRows) else file.radiance
        image = cls(radiance, built, file.metadata)
        if force:
            image.metadata.update({key: file.metadata[key] for key in ("display", "identity") if key in file.metadata})
        return image


def metadata_of(display: Display) -> dict[str, str]:
    """Return a display's metadata: name, identity, transfer curve and bits."""
    tones = {"transfer": transfer_text(display.panel.transfer), "bits": str(display.panel.bits)}
    return {"display": display.name, "identity": display.identity, **tones}


def check_image(image: object) -> None:
    """Raise InputError if `image` is no IntegralImage, such as a path."""
    if not isinstance(image, IntegralImage):
        what = f"{str(image)[:80]!r} is not an IntegralImage"
        raise InputError(f"{what}; load a file with lippmann.IntegralImage.load(path, display)")


def _check_metadata(display: Display, path: str | Path, metadata: Mapping[str, str]) -> None:
    identity = metadata.get("identity")
    if identity != display.identity:
        other = f"was made for display '{metadata.get('display', '?')}' ({identity})"
        what = f"{'names no display' if identity is None else other}, not for '{display.name}' ({display.identity})"
        remedy = "give the display that it was made for, or --force (force=True in Python)"
        raise input_error(path, what, remedy)
    for key in ("transfer", "bits"):
        expected = metadata_of(display)[key]
        actual = metadata.get(key, expected)
        if Path(path).suffix.lower() in ENCODED_SUFFIXES and actual != expected:
            names = transfer_name(actual), transfer_name(expected)
            what = f"was made for a panel with {key} {names[0]}, '{display.name}' has {key} {names[1]}"
            raise input_error(path, what, "render it for this display, or give --force (force=True in Python)")
