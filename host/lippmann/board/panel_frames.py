"""Check that an image belongs to a panel, and encode the image as panel values."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lippmann.base.images import ENCODED_SUFFIXES, SUFFIXES, Radiance, StoredRows, read_picture
from lippmann.base.tones import Transfer, encoded_values, transfer_name, transfer_text
from lippmann.board.session import Hello
from lippmann.board.tiles import Pixels
from lippmann.display.description import Display, Panel, TransferName
from lippmann.errors import check_flags, input_error
from lippmann.rendering.integral_image import IntegralImage, check_image

logger = logging.getLogger(__name__)

#: Maximum bits per colour on the serial link.
LINK_BITS = 8


class Target(NamedTuple):
    """A display's identity, and its panel's size in pixels."""

    identity: int
    width: int
    height: int


class Tones(NamedTuple):
    """A panel's transfer curve and bits per colour; None means unknown."""

    transfer: Transfer | None = None
    bits: int | None = None


#: Transfer curve and bits that are assumed for an unknown panel.
USUAL_TRANSFER, USUAL_BITS = "srgb", 8


def panel_values(radiance: Radiance, transfer: Transfer, bits: int) -> Pixels:
    """Encode linear radiance (height, width, 3) as values 0 to 255, also for panels of fewer than 8 bits."""
    return encoded_values(radiance, transfer, min(bits, LINK_BITS)).astype(np.uint8)


def image_frame(image: IntegralImage, target: Hello | Target, force: bool = False) -> Pixels:
    """Return an image's frame (height, width, 3) uint8 for the panel.

    Raises InputError if the display, size, transfer curve or number of bits differs from
    the panel's; `force` accepts another display of equal size.
    """
    check_image(image)
    name = check_shape(image.radiance.shape, image.display, target, force)
    panel = image.display.panel
    _merge_tones(name, ("its metadata", _tones_in(name, image.metadata, False)), ("its display", _tones_of(panel)))
    return panel_values(image.radiance, panel.transfer, panel.bits)


class FrameFile(NamedTuple):
    """An image file whose header fits a panel.

    `pixels` reads the frame (height, width, 3) uint8; it raises InputError for a broken
    file. `assumption` is a message about an assumed transfer curve or bits, or empty.
    """

    pixels: Callable[[], Pixels]
    assumption: str


def check_shape(shape: tuple[int, ...], display: Display, target: Hello | Target, force: bool = False) -> str:
    """Check an image's shape and display; return the image's name for messages.

    Raises InputError for a wrong shape and, without `force`, for another display.
    """
    check_flags(force=force)
    name = f"image for display '{display.name}'"
    _check_identity(name, display.identity, target, force)
    panel_shape = (target.height, target.width, 3)
    if shape != panel_shape:
        raise input_error(name, f"its shape is {shape}, the panel's is {panel_shape}", "render it again")
    return name


def check_frame(
    path: str | Path,
    target: Hello | Target,
    transfer: TransferName | None = None,
    panel: Panel | None = None,
    force: bool = False,
) -> FrameFile:
    """Check the header and the last row of an image file for a panel.

    The file contains linear radiance (.exr, .tif) or panel values (.png). The metadata
    name the panel's transfer curve and bits; `transfer` and `panel` confirm them or
    supply missing values. The defaults are sRGB and 8 bits.

    Raises InputError when the file is missing, truncated, not an image, or made for
    another size, transfer curve or number of bits; without `force` also for another
    display.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise input_error(path, f"unknown extension '{path.suffix}'", f"choose from {', '.join(SUFFIXES)}")
    agreed = Tones()

    def accept(metadata: Mapping[str, str]) -> None:
        nonlocal agreed
        _check_identity(str(path), metadata.get("identity"), target, force)
        file = "the file", _tones_in(str(path), metadata, suffix in ENCODED_SUFFIXES)
        display = "--display", Tones() if panel is None else _tones_of(panel)
        agreed = _merge_tones(str(path), file, ("--transfer", Tones(transfer)), display)

    size_px = target.width, target.height
    with StoredRows(path, size_px, accept) as rows:
        rows[target.height - 1]  # raises InputError for a truncated file
    curve, bits = agreed.transfer or USUAL_TRANSFER, agreed.bits or USUAL_BITS
    text, assumption = f"{transfer_name(curve)} and {bits} bits", ""
    # The values of an encoded file are already quantised, so bits are not needed.
    if agreed.transfer is None or (agreed.bits is None and suffix not in ENCODED_SUFFIXES):
        assumption = f"{path}: {text} are assumed; name the panel with --display FILE"
    elif (curve, bits) != (USUAL_TRANSFER, USUAL_BITS) and panel is None and transfer is None:
        # A board does not report its panel's transfer curve.
        assumption = f"{path}: made for {text}; check the board's panel with --display FILE"
    return FrameFile(lambda: panel_values(read_picture(path, size_px, accept).radiance, curve, bits), assumption)


def load_frame(
    path: str | Path,
    target: Hello | Target,
    transfer: TransferName | None = None,
    panel: Panel | None = None,
    force: bool = False,
) -> Pixels:
    """Return a file's frame (height, width, 3) uint8; check the file like `check_frame`."""
    file = check_frame(path, target, transfer, panel, force)
    if file.assumption:
        logger.info(file.assumption)
    return file.pixels()


def _check_identity(name: str, identity: str | None, target: Hello | Target, force: bool) -> None:
    panel_identity = f"{target.identity:016x}"
    if identity != panel_identity and not force:
        what = f"was rendered for display {identity}" if identity else "names no display"
        remedy = "render it for the panel's display, or accept it with --force (force=True in Python)"
        raise input_error(name, f"{what}, but the panel belongs to display {panel_identity}", remedy)


def _tones_of(panel: Panel) -> Tones:
    return Tones(transfer_text(panel.transfer), panel.bits)


def _tones_in(name: str, metadata: Mapping[str, str], encoded: bool) -> Tones:
    """Return curve and bits in a file's metadata. Lippmann 0.1 wrote no bits, and the curve only to PNG files."""
    bits = metadata.get("bits")
    if bits is not None and (len(bits) > 2 or not bits.isdecimal() or not 1 <= int(bits) <= 16):
        raise input_error(name, f"the number of bits in its metadata is '{bits[:20]}', not 1 to 16", "render it again")
    return Tones(metadata.get("transfer") if encoded or bits else None, None if bits is None else int(bits))


def _merge_tones(name: str, *sources: tuple[str, Tones]) -> Tones:
    agreed = Tones()
    first: dict[str, str] = {}
    for source, tones in sources:
        for key, value in tones._asdict().items():
            before = getattr(agreed, key)
            if value is None or value == before:
                continue
            if before is not None:
                names = [transfer_name(one) if key == "transfer" else one for one in (before, value)]
                what = f"{key} is {names[0]} in {first[key]}, {names[1]} in {source}"
                raise input_error(name, what, "name the display that the image was made for, or render it again")
            agreed, first[key] = agreed._replace(**{key: value}), source
    return agreed
