"""Images for the board: panel values of a picture that was rendered for this display."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lippmann.board.board import Hello
from lippmann.board.tiles import Pixels
from lippmann.display import Transfer
from lippmann.errors import input_error
from lippmann.images import SUFFIXES, encode, read_picture


class Target(NamedTuple):
    """Where an image is to be shown without a board: the display's identity, and the panel's size in px."""

    identity: int
    width: int
    height: int


def load_frame(
    path: str | Path, target: Hello | Target, transfer: Transfer = "srgb", bits: int = 8, force: bool = False
) -> Pixels:
    """Read an image as the panel's values.

    Parameters
    ----------
    path
        .exr or .tif with linear radiance, .png with panel values.
    target
        The board, or what else names the panel's size and the display's identity.
    transfer, bits
        The panel's curve and depth; the link carries 8 bits, deeper panels get those.
    force
        Take an image that was rendered for another display, or names none.

    Returns
    -------
    (height, width, 3) uint8.

    Raises
    ------
    InputError
        When the file is missing, no picture, broken, of another size, or of another display. Size and display are
        checked before any pixel is read.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise input_error(str(path), f"unknown extension '{path.suffix}'", f"choose from {', '.join(SUFFIXES)}")
    identity = f"{target.identity:016x}"

    def accept(metadata: Mapping[str, str]) -> None:
        own = metadata.get("identity")
        if own != identity and not force:
            what = f"was rendered for display {own}" if own else "names no display"
            raise input_error(
                str(path),
                f"{what}, the panel belongs to {identity}",
                "render it for this display, or stream it with --force",
            )

    picture = read_picture(path, (target.width, target.height), accept)
    return panel_values(picture.radiance, transfer, bits)


def panel_values(radiance: np.ndarray[tuple[int, ...], np.dtype[np.float32]], transfer: Transfer, bits: int) -> Pixels:
    """Return linear radiance (height, width, 3) as values of 8 bits; a panel of fewer bits has its levels spread."""
    levels = (1 << min(bits, 8)) - 1
    return np.rint(np.rint(encode(radiance, transfer) * levels) * (255 / levels)).astype(np.uint8)
