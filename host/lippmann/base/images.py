"""Image files: linear radiance in EXR and TIFF, panel values in PNG, with metadata.

OpenImageIO reads and writes them. A file appears whole or not at all: it is written under a temporary name in the same
folder and renamed at the end.
"""

from __future__ import annotations

import contextlib
import os
import re
import struct
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.files import clean_before_writing, not_written, replacing
from lippmann.base.limits import check_expanded, png_chunks, png_is_complete
from lippmann.base.programs import silent_stderr
from lippmann.base.tones import BAND_ROWS, Numbers, Transfer, decode, encoded_values, transfer_text
from lippmann.errors import InputError, input_error, likely_file, missing_library, not_there, path_of

if TYPE_CHECKING:
    import OpenImageIO

#: Formats with linear radiance, and with panel values.
LINEAR_SUFFIXES = (".exr", ".tif", ".tiff")
ENCODED_SUFFIXES = (".png",)
SUFFIXES = LINEAR_SUFFIXES + ENCODED_SUFFIXES
#: Longest file name, bytes: file systems allow 255, and the temporary name is longer.
MAX_NAME_BYTES = 220
#: Largest half float.
HALF_MAX = 65504.0
#: Most channels of an image: colours and alpha.
MAX_CHANNELS = 4
#: Most bytes of compressed texts in a PNG: each may expand a thousandfold, and all are read at once.
MAX_TEXT_BYTES = 1 << 18
#: Names by which OpenImageIO writes a PNG's gamma chunk for each transfer curve: 1/2.2 for sRGB too, beside its own.
COLOUR_SPACES = {"srgb": "sRGB", "gamma2.2": "Gamma2.2", "linear": "Linear"}
#: Neighbouring pixels of an integral image belong to distant views: without row filters its files are as small, and
#: are written in a third of the time.
PNG_SETTINGS = {"png:filter": 0x08, "png:compressionLevel": 2}
#: Prefix of our metadata keys in a file.
PREFIX = "lippmann:"

#: Linear radiance, (height, width, 3).
Radiance = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Picture:
    """An image file's linear radiance (height, width, 3) float32 and its metadata (keys without prefix)."""

    radiance: Radiance
    metadata: dict[str, str]


def check_output(path: str | Path, suffixes: tuple[str, ...] = SUFFIXES) -> Path:
    """Check before a long computation that a file can be written; return its path.

    InputError for an unknown extension, a missing or read-only folder, and a path that is a folder; NoSpaceError.
    """
    path = path_of(path, "an image file")
    if len(os.fsencode(path.name)) > MAX_NAME_BYTES:
        raise input_error(path.name[:40] + "...", "the file name is too long", f"keep it under {MAX_NAME_BYTES} bytes")
    if path.suffix.lower() not in suffixes:
        known = ", ".join(suffixes)
        raise input_error(str(path), f"unknown extension '{path.suffix}'", f"choose from {known}")
    if path.suffix.lower() in SUFFIXES:
        # Raises now, not after the render, when the library is missing.
        openimageio()
    if path.is_dir():
        raise input_error(str(path), "is a folder", "give a file name")
    folder = path.parent
    if not folder.is_dir():
        raise input_error(str(path), f"the folder {folder} does not exist", "make it first")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise input_error(str(path), "cannot be written", "choose another place or change permissions")
    try:
        with tempfile.TemporaryFile(dir=folder):  # not by its permissions alone: /proc says that it may be written
            pass
    except OSError as error:
        raise not_written(path, error) from None
    clean_before_writing(folder)
    return path


def check_input(path: str | Path) -> Path:
    """Return an image's path; InputError when there is no such file."""
    path = path_of(path, "an image file")
    if not path.is_file():
        missing = likely_file(path, SUFFIXES) or "render it first: lippmann render"
        raise input_error(str(path), not_there(path, "image"), "give an image" if path.exists() else missing)
    return path


class Rows(Protocol):
    """Linear radiance (height, width, 3) that gives some rows at a time: an array, or one that is on disk."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Height, width and 3."""

    def __getitem__(self, rows: slice, /) -> Numbers:
        """Return some rows, `BAND_ROWS` at most, from a multiple of it on."""


def write_picture(
    path: str | Path,
    radiance: Rows,
    metadata: Mapping[str, str],
    transfer: Transfer = "srgb",
    bits: int = 8,
) -> None:
    """Write linear radiance (height, width, 3) and metadata (keys without prefix) as an image file.

    .exr (half float) and .tif (float) keep it linear. .png has panel values, by the panel's transfer curve and bits
    (see `encoded_values`); its metadata name the curve.

    Raises InputError when the file cannot be written.
    """
    path = check_output(path)
    suffix = path.suffix.lower()
    firsts = range(0, radiance.shape[0], BAND_ROWS)
    for first in firsts:
        rows = np.asarray(radiance[first : first + BAND_ROWS])
        # Other formats write infinite light as their largest value.
        if np.isnan(rows).any() or (suffix in (".tif", ".tiff") and np.isinf(rows).any()):
            raise input_error(str(path), "the image has pixels that are not finite", "replace them (numpy.nan_to_num)")

    def file_values(first: int) -> Numbers:
        """Return the file's values of the band from this row on: no copy of the whole image is made."""
        rows: Numbers = np.asarray(radiance[first : first + BAND_ROWS], np.float32)
        if suffix == ".png":
            rows = encoded_values(rows, transfer, bits)
        elif suffix == ".exr":
            rows = np.clip(rows, np.float32(-HALF_MAX), np.float32(HALF_MAX))
        return np.ascontiguousarray(rows)

    spec = _file_spec(suffix, radiance.shape, metadata, transfer, bits)
    with replacing(path) as partial:
        out = openimageio().ImageOutput.create(str(partial))
        if out is None:
            raise input_error(str(path), openimageio().geterror(), "choose another extension")
        with silent_stderr():
            complete = out.open(str(partial), spec) and _write_bands(out, firsts, file_values)
            trouble = _first_line(out.geterror(), partial)
            complete = out.close() and complete
        # OpenImageIO does not notice when a full disk truncates a PNG.
        if not complete or (suffix == ".png" and not png_is_complete(partial)):
            raise not_written(path, trouble, partial)


def _file_spec(
    suffix: str, shape: tuple[int, ...], metadata: Mapping[str, str], transfer: Transfer, bits: int
) -> OpenImageIO.ImageSpec:
    """Return the header of a file: its size, the type of its values, how it is compressed, and our metadata."""
    oiio = openimageio()
    entries, kind = dict(metadata), oiio.FLOAT
    # Of level 1: a picture is written in three quarters of the time, and is 2 % larger.
    settings: dict[str, str | int] = {"compression": "zip:1" if suffix == ".exr" else "zip"}
    if suffix == ".png":
        entries["transfer"] = transfer_text(transfer)
        kind = oiio.UINT8 if bits <= 8 else oiio.UINT16
        settings = {"oiio:ColorSpace": COLOUR_SPACES.get(transfer_text(transfer), ""), **PNG_SETTINGS}
    elif suffix == ".exr":
        kind = oiio.HALF
    if suffix in (".tif", ".tiff"):
        # TIFF has no free keys: all entries go into the description, a line each; a tab continues a value.
        lines = [f"{PREFIX}{key}={value}".replace("\n", "\n\t") for key, value in entries.items()]
        settings["ImageDescription"] = "\n".join(lines)
    else:
        settings |= {PREFIX + key: value for key, value in entries.items()}
    spec: OpenImageIO.ImageSpec = oiio.ImageSpec(shape[1], shape[0], 3, kind)
    for key, setting in settings.items():
        spec.attribute(key, setting)
    return spec


def _write_bands(out: OpenImageIO.ImageOutput, firsts: range, file_values: Callable[[int], Numbers]) -> bool:
    """Write the bands; tell whether that succeeded. One is compressed while the next is encoded."""
    with ThreadPoolExecutor(1) as encoder:
        ahead = encoder.submit(file_values, 0)
        for first in firsts:
            rows = ahead.result()
            ahead = encoder.submit(file_values, first + BAND_ROWS)
            if not out.write_scanlines(first, first + len(rows), 0, rows):
                return False
    return True


def read_picture(
    path: str | Path,
    limit: tuple[int, int] | None = None,
    accept: Callable[[Mapping[str, str]], None] | None = None,
) -> Picture:
    """Read an image file as linear radiance; a PNG is decoded by the transfer curve in its metadata (else sRGB).

    Before its pixels are read, its size is compared with `limit`, (width, height), and `accept` is called with its
    metadata, which raises to refuse the image.

    Raises InputError when the file is missing, broken, of another size, or not a flat image.
    """
    with StoredRows(path, limit, accept) as rows:
        return Picture(np.array(rows, copy=None), rows.metadata)


@contextlib.contextmanager
def _quiet(path: Path) -> Iterator[None]:
    """Keep OpenImageIO from printing errors that it also returns."""
    try:
        with silent_stderr():
            yield
    except UnicodeDecodeError:  # OpenImageIO quotes a broken header
        raise input_error(str(path), "is broken", "render it again") from None


def _opened(
    path: Path, limit: tuple[int, int] | None, accept: Callable[[Mapping[str, str]], None] | None
) -> tuple[OpenImageIO.ImageInput, dict[str, str]]:
    """Open an image file that is there; return OpenImageIO's input and our metadata. See `read_picture`."""
    _check_texts(path)
    oiio = openimageio()
    source = oiio.ImageInput.open(str(path))
    if source is None:
        trouble = oiio.geterror()
        # OpenImageIO refuses large images before it gives their size.
        if limit is not None and (claim := re.search(r"claimed to be (\d+)x(\d+)", trouble)):
            _check_size(path, (int(claim[1]), int(claim[2])), limit)
        raise input_error(str(path), f"is not an image ({_first_line(trouble, path)})", "give an EXR, TIFF or PNG file")
    try:
        spec = source.spec()
        if limit is not None:
            _check_size(path, (spec.width, spec.height), limit)
        if spec.deep or spec.depth > 1 or spec.nchannels > MAX_CHANNELS:
            raise input_error(str(path), f"is not a flat image of 1 to {MAX_CHANNELS} channels", "render it again")
        metadata = _metadata_of(spec)
        if accept is not None:
            accept(metadata)
    except BaseException:
        source.close()
        raise
    return source, metadata


def _decode_rows(path: Path, rows: Radiance, metadata: Mapping[str, str]) -> None:
    """Make a file's values linear, in place; refuse those that are not finite."""
    if not np.isfinite(rows).all():
        raise input_error(str(path), "contains pixels that are not finite", "render it again")
    # The transfer curve in a linear file's metadata is the panel's.
    linear = path.suffix.lower() in LINEAR_SUFFIXES
    try:
        rows[:] = decode(rows, "linear" if linear else metadata.get("transfer", "srgb"))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _check_size(path: Path, size: tuple[int, int], limit: tuple[int, int]) -> None:
    """Refuse an image that has not the panel's size."""
    if size != limit:
        what = f"is {size[0]} x {size[1]} pixels, the panel {limit[0]} x {limit[1]}"
        raise input_error(str(path), what, "render it for this display")


def _check_texts(path: Path) -> None:
    """Refuse a PNG with so many compressed texts that opening it would take too much time and memory."""
    texts = 0
    for kind, size, _ in png_chunks(path):
        texts += size * (kind in (b"zTXt", b"iTXt"))
        if texts > MAX_TEXT_BYTES:
            raise input_error(str(path), f"contains more than {MAX_TEXT_BYTES} bytes of texts", "render it again")


def _first_line(trouble: str, path: Path) -> str:
    """Return the first line of a library's error message, without the file's name."""
    return next(iter(trouble.replace(f" ({path})", "").strip().splitlines()), "no reason given")


def _metadata_of(spec: OpenImageIO.ImageSpec) -> dict[str, str]:
    """Return our keys from a file's header."""
    metadata: dict[str, str] = {}
    for attribute in spec.extra_attribs:
        if attribute.name.startswith(PREFIX):
            metadata[attribute.name.removeprefix(PREFIX)] = str(attribute.value)
        elif attribute.name == "ImageDescription":
            for entry in re.split(r"\r?\n(?!\t)", str(attribute.value)):
                if entry.startswith(PREFIX) and "=" in entry:
                    key, value = entry.removeprefix(PREFIX).split("=", 1)
                    metadata[key] = value.replace("\n\t", "\n")
    return metadata


def openimageio() -> ModuleType:
    """Return the library; MissingLibraryError without it."""
    try:
        with interrupts.held():  # an exception while its types load aborts the process
            import OpenImageIO
    except ImportError as error:
        raise missing_library(error) from None
    return OpenImageIO


class StoredRows:
    """Linear radiance (height, width, 3) float32 that stays in its file: only the rows that are asked for are read.

    It is indexed like an array, by rows first. What it returns cannot be written; `numpy.asarray` reads it whole.
    """

    dtype, ndim = np.dtype(np.float32), 3

    def __init__(
        self,
        path: str | Path,
        limit: tuple[int, int] | None = None,
        accept: Callable[[Mapping[str, str]], None] | None = None,
    ) -> None:
        """Open an image file; see `read_picture`, whose errors this raises too."""
        self._path = check_input(path)
        with _quiet(self._path):
            self._source, self.metadata = _opened(self._path, limit, accept)
        self._spec, self._closed = self._source.spec(), False
        self.shape = (self._spec.height, self._spec.width, 3)
        self.size = 3 * self._spec.height * self._spec.width
        self._first, self._rows = 0, np.empty((0, *self.shape[1:]), np.float32)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, after which no row can be read; a second time does nothing."""
        self._source.close()
        self._closed = True

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any, /) -> Radiance:
        """Return a part; a row, or a range of rows, is all that is read of the file."""
        rows, *rest = index if isinstance(index, tuple) else (index,)
        own: int | slice = slice(None)
        if isinstance(rows, int | np.integer):
            first, own = range(self.shape[0])[rows], 0  # or IndexError
            last = first + 1
        elif isinstance(rows, slice) and rows.step in (None, 1):
            first, last, _ = rows.indices(self.shape[0])
        else:
            return np.asarray(np.asarray(self)[index], np.float32)
        return np.asarray(self._read(first, max(first, last))[(own, *rest)], np.float32)

    def _read(self, first: int, last: int) -> Radiance:
        """Return rows; those of the last call are not read again, so that reading goes forwards."""
        if self._closed:
            raise ValueError(f"{self._path} is closed")
        kept = self._rows[max(0, first - self._first) :][: last - first] if first >= self._first else self._rows[:0]
        rows = np.empty((last - first, *self.shape[1:]), np.float32)
        rows[: len(kept)] = kept
        spec, kind = self._spec, openimageio().FLOAT
        channels = 3 if spec.nchannels >= 3 else 1
        # OpenImageIO reads no scanlines of a file of tiles, only whole rows of tiles.
        tile = spec.tile_height if spec.tile_width else 1
        with _quiet(self._path):
            for low in range(first + len(kept), last, BAND_ROWS):
                high = min(low + BAND_ROWS, last)
                top, bottom = low - low % tile, min(high + -high % tile, spec.height)
                y = spec.y + top, spec.y + bottom
                if spec.tile_width:
                    pixels = self._source.read_tiles(spec.x, spec.x + spec.width, *y, 0, 1, 0, channels, kind)
                else:
                    pixels = self._source.read_scanlines(0, 0, *y, 0, 0, channels, kind)
                if pixels is None:
                    trouble = _first_line(self._source.geterror(), self._path)
                    raise input_error(str(self._path), f"is truncated or broken ({trouble})", "render it again")
                band = rows[low - first : high - first]
                band[:] = pixels[low - top : high - top]
                _decode_rows(self._path, band, self.metadata)
        rows.setflags(write=False)
        self._first, self._rows = first, rows
        return rows

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> Numbers:
        """Return all rows."""
        height, width, _ = self.shape
        check_expanded(str(self._path), f"{width} x {height} pixels", 2 * 12 * width * height, "take a smaller image")
        whole = self._read(0, height)
        self._rows = whole[:0]  # the caller's memory now, and not this object's too
        whole.setflags(write=True)
        return np.array(whole, dtype, copy=copy)


#: Kinds of files, by Pillow's names: what OpenCV reads beside them has other claims, which nothing here checks.
FORMATS = ("PNG", "JPEG", "TIFF", "BMP")


def read_numbers(path: Path, most_pixels: int, what: str, remedy: str) -> Numbers:
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
    try:
        with silent_stderr():
            numbers = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
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
                if picture.format == "PNG" and not png_is_complete(path):  # up to 4 GB are claimed for a chunk
                    raise refused
                return picture.width * picture.height
    except Image.DecompressionBombError:
        return np.inf
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, OverflowError, struct.error):
        raise refused from None
