"""Images of cameras and other programs, as the numbers that they hold."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.base.limits import png_chunks
from lippmann.base.stderr import silent_stderr
from lippmann.errors import InputError, input_error, not_there

#: Kinds of files, by Pillow's names: what OpenCV reads beside them has other claims, which nothing here checks.
FORMATS = ("PNG", "JPEG", "TIFF", "BMP")


def read_numbers(path: Path, most_pixels: int, what: str, remedy: str) -> npt.NDArray[Any]:
    """Return the numbers of an image (height, width) or (height, width, channels BGR or BGRA), of the file's own type.

    Raises InputError, with `what` and `remedy`, for a file that is no image of `FORMATS` or is broken, and for one of
    more pixels than `most_pixels`.
    """
    import cv2

    refused = input_error(str(path), what, remedy)
    # OpenCV takes the memory that a file claims before it reads the pixels.
    size = _claimed_size(path, refused)
    if size > most_pixels:
        raise input_error(str(path), f"has more than {most_pixels / 1e6:g} megapixels", "give a smaller one")
    _check_chunks(path, refused)
    try:
        with silent_stderr():
            numbers: Any = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        numbers = None
    if numbers is None:
        raise refused
    return np.asarray(numbers)


def _claimed_size(path: Path, refused: InputError) -> float:
    """Return how many pixels a file claims to have."""
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise input_error(str(path), not_there(path), "give a PNG, JPEG or TIFF file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large pictures, and of odd metadata
            with Image.open(path, formats=FORMATS) as picture:
                return picture.width * picture.height
    except Image.DecompressionBombError:
        return np.inf
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, OverflowError, struct.error):
        raise refused from None


def _check_chunks(path: Path, refused: InputError) -> None:
    """Refuse a PNG with a chunk that ends behind the file: up to 4 GB are claimed for it."""
    for kind, _, whole in png_chunks(path):
        if not whole:
            raise refused
        if kind == b"IEND":
            return
