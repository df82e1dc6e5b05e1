"""Frames for a panel: images encoded as panel values, after a check that they belong to this panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.base.images import ENCODED_SUFFIXES, SUFFIXES, read_picture
from lippmann.base.tones import Transfer, encoded_values, transfer_name, transfer_text
from lippmann.board.tiles import Pixels
from lippmann.display.description import Panel, TransferName
from lippmann.errors import input_error
from lippmann.rendering.integral_image import IntegralImage, check_image

if TYPE_CHECKING:
    from lippmann.board.board import Hello

#: Bits per colour on the serial link; a panel with more bits receives these.
LINK_BITS = 8


class Target(NamedTuple):
    """Identity of a display, and the size of its panel in pixels."""

    identity: int
    width: int
    height: int


def panel_values(radiance: npt.NDArray[np.float32], transfer: Transfer, bits: int) -> Pixels:
    """Encode linear radiance (height, width, 3) with a panel's transfer curve and quantise it to the panel's bits.

    The 2^bits levels of a panel with fewer than 8 bits are spread over 0 to 255.
    """
    return encoded_values(radiance, transfer, min(bits, LINK_BITS)).astype(np.uint8)


def image_frame(image: IntegralImage, target: Hello | Target, force: bool = False) -> Pixels:
    """Return the frame (height, width, 3) uint8 that an image's display asks for.

    Raises InputError for an image of another display, size, transfer curve or number of bits; with `force`, another
    display of the same size is accepted.
    """
    check_image(image)
    display = image.display
    name = f"image for display '{display.name}'"
    _check_identity(name, display.identity, target, force)
    shape = (target.height, target.width, 3)
    if image.radiance.shape != shape:
        raise input_error(name, f"its shape is {image.radiance.shape}, the panel's is {shape}", "render it again")
    tones = _tones_of(display.panel)
    _agreed(name, ("its metadata", _tones_in(name, image.metadata, False)), ("its display", tones))
    return panel_values(image.radiance, **tones)


#: Tones of a panel of which nothing is said.
USUAL_TONES: dict[str, Any] = {"transfer": "srgb", "bits": 8}


def load_frame(
    path: str | Path,
    target: Hello | Target,
    transfer: TransferName | None = None,
    panel: Panel | None = None,
    force: bool = False,
    note: Callable[[str], None] = lambda text: None,
) -> Pixels:
    """Read an image file as a frame (height, width, 3) uint8 for a panel.

    The file holds linear radiance (.exr, .tif) or panel values (.png). Its metadata name the panel's transfer curve and
    bits; `transfer` and `panel` confirm them, or supply what the file does not name. The defaults are sRGB and 8 bits.
    A PNG without metadata holds sRGB values. `note` is called with a sentence about values that are assumed.

    Raises InputError when the file is missing, broken, not an image, or made for another size, transfer curve or number
    of bits; without `force` also when it was made for another display, or names none. The header is checked before
    pixels are read.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise input_error(str(path), f"unknown extension '{path.suffix}'", f"choose from {', '.join(SUFFIXES)}")
    agreed: dict[str, Any] = {}

    def accept(metadata: Mapping[str, str]) -> None:
        _check_identity(str(path), metadata.get("identity"), target, force)
        file = "the file", _tones_in(str(path), metadata, suffix in ENCODED_SUFFIXES)
        option = "--transfer", {} if transfer is None else {"transfer": transfer}
        display = "--display", {} if panel is None else _tones_of(panel)
        agreed.update(_agreed(str(path), file, option, display))

    picture = read_picture(path, (target.width, target.height), accept)
    tones = USUAL_TONES | agreed
    curve = transfer_name(tones["transfer"])
    # An encoded file needs no bits: its values are quantised already.
    if "transfer" not in agreed or ("bits" not in agreed and suffix not in ENCODED_SUFFIXES):
        note(f"{path}: {curve} and {tones['bits']} bits are assumed; name the panel with --display FILE")
    elif tones != USUAL_TONES and panel is None and transfer is None:
        # A board does not tell its panel's tones, and its identity leaves them out.
        note(f"{path}: made for {curve} and {tones['bits']} bits; have the board's panel checked with --display FILE")
    return panel_values(picture.radiance, **tones)


def _check_identity(name: str, identity: str | None, target: Hello | Target, force: bool) -> None:
    """Refuse an image that was rendered for another display or names none, except with `force`."""
    wanted = f"{target.identity:016x}"
    if identity != wanted and not force:
        what = f"was rendered for display {identity}" if identity else "names no display"
        remedy = "render it for this display, or accept it with --force (force=True in Python)"
        raise input_error(name, f"{what}, the panel belongs to display {wanted}", remedy)


def _tones_of(panel: Panel) -> dict[str, Any]:
    return {"transfer": transfer_text(panel.transfer), "bits": panel.bits}


def _tones_in(name: str, metadata: Mapping[str, str], encoded: bool) -> dict[str, Any]:
    """Return the transfer curve and the bits of the panel that an image's metadata name.

    Version 0.1 wrote no bits; its `transfer` is the panel's curve only in encoded files (PNG).
    """
    bits = metadata.get("bits")
    if bits is not None and (len(bits) > 2 or not bits.isdecimal() or not 1 <= int(bits) <= 16):
        raise input_error(name, f"'{bits[:20]}' is not a panel's number of bits", "render it again")
    known: dict[str, Any] = {} if bits is None else {"bits": int(bits)}
    if "transfer" in metadata and (encoded or bits):
        known["transfer"] = metadata["transfer"]
    return known


def _agreed(name: str, *sources: tuple[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the tones that several sources name; refuse two that differ."""
    agreed: dict[str, tuple[Any, str]] = {}
    for source, tones in sources:
        for key, value in tones.items():
            known, first = agreed.setdefault(key, (value, source))
            if known != value:
                names = [transfer_name(one) if key == "transfer" else one for one in (known, value)]
                what = f"{key} is {names[0]} in {first}, {names[1]} in {source}"
                raise input_error(name, what, "name the display that the image was made for, or render it again")
    return {key: value for key, (value, _) in agreed.items()}
