"""Reads and writes images: radiance in EXR and TIFF, panel values in PNG, and metadata."""

from __future__ import annotations

import contextlib
import os
import re
import struct
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.file_limits import check_expanded, png_chunks, png_is_complete
from lippmann.base.files import not_written, remove_stale_once, replacing
from lippmann.base.programs import silent_stderr
from lippmann.base.tones import BAND_ROWS, Numbers, Transfer, decode, encoded_values, transfer_text
from lippmann.errors import (
    InputError,
    input_error,
    likely_file,
    located,
    missing_library,
    not_there,
    path_of,
    reason,
    warn_user,
)

if TYPE_CHECKING:
    import OpenImageIO

#: Suffixes of images with linear radiance.
LINEAR_SUFFIXES = (".exr", ".tif", ".tiff")
#: Suffixes of images with panel values.
ENCODED_SUFFIXES = (".png",)
SUFFIXES = LINEAR_SUFFIXES + ENCODED_SUFFIXES
#: Maximum bytes of a file name; its temporary name may have 255 bytes.
MAX_NAME_BYTES = 220
HALF_MAX = 65504.0
#: Maximum channels of an image: three colours and alpha.
MAX_CHANNELS = 4
#: Maximum bytes of a PNG's compressed texts; they may expand a thousandfold.
MAX_TEXT_BYTES = 1 << 18
#: OpenImageIO's names of the transfer curves for which it writes a PNG gamma chunk.
COLOUR_SPACES = {"srgb": "sRGB", "gamma2.2": "Gamma2.2", "linear": "Linear"}
#: Without row filters, PNG files are written three times as fast, and are not larger.
PNG_SETTINGS = {"png:filter": 0x08, "png:compressionLevel": 2}
AGAIN = "render the image again"
PREFIX = "lippmann:"
#: Maximum bytes of a metadata key (PNG's limit) and of all metadata (TIFF's).
MAX_KEY_BYTES, MAX_METADATA_BYTES = 70, 60_000

#: Linear radiance, (height, width, 3).
Radiance = npt.NDArray[np.float32]
#: Function that checks a file's metadata, and may raise an error.
Accept = Callable[[Mapping[str, str]], None]


class Picture(NamedTuple):
    """An image's linear radiance (height, width, 3) float32 and metadata (keys without `PREFIX`)."""

    radiance: Radiance
    metadata: dict[str, str]


def check_output(path: str | Path, suffixes: tuple[str, ...] = SUFFIXES) -> Path:
    """Check that an image file can be written, and return the path.

    Raises InputError for an unknown extension, a missing or read-only folder, or a path
    that is a folder, and NoSpaceError if the disk is full.
    """
    path = path_of(path, "an image file")
    if len(os.fsencode(path.name)) > MAX_NAME_BYTES:
        raise input_error(path.name[:40] + "...", "the file name is too long", f"use at most {MAX_NAME_BYTES} bytes")
    if path.suffix.lower() not in suffixes:
        raise input_error(path, f"unknown extension '{path.suffix}'", f"choose from {', '.join(suffixes)}")
    if path.suffix.lower() in SUFFIXES:
        openimageio()  # report a missing library before the render
    if path.is_dir():
        raise input_error(path, "is a folder", "give a file name")
    folder = path.parent
    if not folder.is_dir():
        raise input_error(path, f"the folder {folder} does not exist", "make the folder first")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise input_error(path, "cannot be written", "choose another folder, or change the permissions")
    try:
        with tempfile.TemporaryFile(dir=folder):  # /proc permits writing, but not new files
            pass
    except OSError as error:
        raise not_written(path, error) from None
    remove_stale_once(folder.absolute())
    return path


def check_input(path: str | Path) -> Path:
    """Return the path of an image file.

    Raises InputError if the file does not exist.
    """
    path = path_of(path, "an image file")
    if not path.is_file():
        missing = likely_file(path, SUFFIXES) or "render it first: lippmann render"
        raise input_error(path, not_there(path, "image"), "give an image" if path.exists() else missing)
    return path


class Rows(Protocol):
    """An image's linear radiance (height, width, 3), in memory or on disk."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Height, width and 3 channels."""

    def __getitem__(self, rows: slice, /) -> Numbers:
        """Return at most `BAND_ROWS` rows; the slice starts at a multiple of `BAND_ROWS`."""


def write_picture(
    path: str | Path, radiance: Rows, metadata: Mapping[str, str], transfer: Transfer = "srgb", bits: int = 8
) -> None:
    """Write an image file of linear radiance (height, width, 3), with metadata (keys without `PREFIX`).

    EXR (half float) and TIFF (float) files are linear. PNG files contain panel values
    (see `encoded_values`). Raises InputError if the file cannot be written.
    """
    path = check_output(path)
    check_metadata(metadata)
    suffix = path.suffix.lower()
    firsts = range(0, radiance.shape[0], BAND_ROWS)
    for first in firsts:
        rows = np.asarray(radiance[first : first + BAND_ROWS])
        # EXR and PNG files store infinite light as their largest value.
        if np.isnan(rows).any() or (suffix in (".tif", ".tiff") and np.isinf(rows).any()):
            raise input_error(path, "the image has pixels that are not finite", "replace them (numpy.nan_to_num)")

    def file_values(first: int) -> Numbers:
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
            raise input_error(path, openimageio().geterror(), "choose another extension")
        with silent_stderr():
            complete = out.open(str(partial), spec) and _write_bands(out, firsts, file_values)
            trouble = _first_line(out.geterror(), partial)
            complete = out.close() and complete
        # OpenImageIO does not notice when a full disk truncates a PNG.
        if not complete or (suffix == ".png" and not png_is_complete(partial)):
            raise not_written(path, trouble, partial)


def describe_wrong(radiance: Rows, negative: bool = False, first_row: int = 0) -> str:
    """Describe number and first position of NaN, infinite or negative values; "" if none."""
    count, place = 0, ""
    for first in range(0, radiance.shape[0], BAND_ROWS):
        rows = radiance[first : first + BAND_ROWS]
        wrong = rows < 0.0 if negative else ~np.isfinite(rows)
        if wrong.any():
            row, column, _ = np.argwhere(wrong)[0]
            place = place or f"row {first_row + first + row}, column {column}"
            count += int(np.count_nonzero(wrong))
    what = "values below 0" if negative else "NaN or infinity"
    return f"{what} (count: {count}, the first in {place})" if count else ""


def check_metadata(metadata: Mapping[str, str]) -> None:
    """Raise InputError for a metadata key or value that a file would lose or truncate."""
    size = 0
    for key, value in metadata.items():
        where, plain = f"metadata {key[:40]!r}", " ".join(key.split())
        if key != plain or not key.isprintable() or "=" in key or not 0 < len(key.encode()) <= MAX_KEY_BYTES:
            raise input_error(where, "files cannot store this key", f"use words without =, up to {MAX_KEY_BYTES} bytes")
        size += len(f"{PREFIX}{key}={value}\n".replace("\n", "\n\t").encode(errors="replace"))
        if not value or size > MAX_METADATA_BYTES or re.search("[\0\ud800-\udfff]", value):
            remedy = f"give text, not empty and without NUL; all metadata may have {MAX_METADATA_BYTES} bytes"
            raise input_error(where, "files cannot store this value", remedy)


def _file_spec(
    suffix: str, shape: tuple[int, ...], metadata: Mapping[str, str], transfer: Transfer, bits: int
) -> OpenImageIO.ImageSpec:
    oiio = openimageio()
    entries, kind = dict(metadata), oiio.FLOAT
    # Level 1, below the default, saves a quarter of EXR's write time; files are 2 % larger.
    settings: dict[str, str | int] = {"compression": "zip:1" if suffix == ".exr" else "zip"}
    if suffix == ".png":
        entries["transfer"] = transfer_text(transfer)
        kind = oiio.UINT8 if bits <= 8 else oiio.UINT16
        settings = {"oiio:ColorSpace": COLOUR_SPACES.get(transfer_text(transfer), ""), **PNG_SETTINGS}
    elif suffix == ".exr":
        kind = oiio.HALF
    if suffix in (".tif", ".tiff"):
        # In TIFF, ImageDescription has a line for each entry; a leading tab continues the entry.
        lines = [f"{PREFIX}{key}={value}".replace("\n", "\n\t") for key, value in entries.items()]
        settings["ImageDescription"] = "\n".join(lines)
    else:
        settings |= {PREFIX + key: value for key, value in entries.items()}
    spec: OpenImageIO.ImageSpec = oiio.ImageSpec(shape[1], shape[0], 3, kind)
    for key, setting in settings.items():
        spec.attribute(key, setting)
    return spec


def _write_bands(out: OpenImageIO.ImageOutput, firsts: range, file_values: Callable[[int], Numbers]) -> bool:
    with ThreadPoolExecutor(1) as encoder:
        ahead = encoder.submit(file_values, 0)
        for first in firsts:
            rows = ahead.result()
            ahead = encoder.submit(file_values, first + BAND_ROWS)
            if not out.write_scanlines(first, first + len(rows), 0, rows):
                return False
    return True


def read_picture(path: str | Path, limit: tuple[int, int] | None = None, accept: Accept | None = None) -> Picture:
    """Read an image file as linear radiance; PNG metadata name the transfer curve, by default sRGB.

    `limit` is the required (width, height). `accept` checks the metadata before the
    pixels are read. Raises InputError if the file is missing or broken, has another
    size, or is not a flat image.
    """
    with StoredRows(path, limit, accept) as rows:
        return Picture(np.array(rows, copy=None), rows.metadata)


@contextlib.contextmanager
def _quiet(path: Path) -> Iterator[None]:
    try:
        with silent_stderr():
            yield
    except UnicodeDecodeError:  # OpenImageIO's message quotes a broken header
        raise input_error(path, "is broken", AGAIN) from None


def _opened(
    path: Path, limit: tuple[int, int] | None, accept: Accept | None
) -> tuple[OpenImageIO.ImageInput, dict[str, str]]:
    try:
        _check_texts(path)
    except OSError as error:
        raise input_error(path, f"cannot be read ({reason(error)})", "change its permissions") from None
    oiio = openimageio()
    source = oiio.ImageInput.open(str(path))
    if source is None:
        trouble = oiio.geterror()
        # OpenImageIO reports a very large image's size only in the error message.
        if limit is not None and (claim := re.search(r"claimed to be (\d+)x(\d+)", trouble)):
            _check_size(path, (int(claim[1]), int(claim[2])), limit)
        raise input_error(path, f"is not an image ({_first_line(trouble, path)})", "give an EXR, TIFF or PNG file")
    try:
        spec = source.spec()
        if limit is not None:
            _check_size(path, (spec.width, spec.height), limit)
        if spec.deep or spec.depth > 1 or spec.nchannels > MAX_CHANNELS:
            raise input_error(path, f"is not a flat image of 1 to {MAX_CHANNELS} channels", AGAIN)
        metadata = _metadata_of(spec)
        if accept is not None:
            accept(metadata)
    except BaseException:
        source.close()
        raise
    return source, metadata


def _decode_rows(path: Path, rows: Radiance, metadata: Mapping[str, str]) -> None:
    if not np.isfinite(rows).all():
        raise input_error(path, "contains pixels that are not finite", AGAIN)
    # A linear file's metadata contains the panel's transfer curve, not the file's.
    linear = path.suffix.lower() in LINEAR_SUFFIXES
    with located(path):
        rows[:] = decode(rows, "linear" if linear else metadata.get("transfer", "srgb"))


def _check_size(path: Path, size: tuple[int, int], limit: tuple[int, int]) -> None:
    if size != limit:
        what = f"is {size[0]} x {size[1]} pixels, but the panel is {limit[0]} x {limit[1]}"
        raise input_error(path, what, "render the image for this display")


def _check_texts(path: Path) -> None:
    texts = 0
    for kind, size, _ in png_chunks(path):
        texts += size * (kind in (b"zTXt", b"iTXt"))
        if texts > MAX_TEXT_BYTES:
            raise input_error(path, f"contains more than {MAX_TEXT_BYTES} bytes of texts", AGAIN)


def _first_line(trouble: str, path: Path) -> str:
    return next(iter(trouble.replace(f" ({path})", "").strip().splitlines()), "no reason given")


def _metadata_of(spec: OpenImageIO.ImageSpec) -> dict[str, str]:
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
    """Import OpenImageIO. Raises MissingLibraryError if OpenImageIO is missing."""
    try:
        with interrupts.hold_signals():  # an exception during the import would abort the process
            import OpenImageIO
    except ImportError as error:
        raise missing_library(error) from None
    return OpenImageIO


class StoredRows:
    """A file's linear radiance (height, width, 3) float32; indexing reads only the requested rows.

    The returned arrays are read-only. `numpy.asarray` reads all rows.
    """

    dtype, ndim = np.dtype(np.float32), 3

    def __init__(self, path: str | Path, limit: tuple[int, int] | None = None, accept: Accept | None = None) -> None:
        """Open an image file; arguments and errors are those of `read_picture`."""
        self._path = check_input(path)
        with _quiet(self._path):
            self._source, self.metadata = _opened(self._path, limit, accept)
        self._spec, self._closed, self._warned = self._source.spec(), False, False
        self.shape = (self._spec.height, self._spec.width, 3)
        self.size = 3 * self._spec.height * self._spec.width
        self._first, self._rows = 0, np.empty((0, *self.shape[1:]), np.float32)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the image file."""
        self._source.close()
        self._closed = True

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any, /) -> Radiance:
        """Return a part of the image."""
        rows, *columns = index if isinstance(index, tuple) else (index,)
        own: int | slice = slice(None)
        if isinstance(rows, int | np.integer):
            first, own = range(self.shape[0])[rows], 0  # raises IndexError
            last = first + 1
        elif isinstance(rows, slice) and rows.step in (None, 1):
            first, last, _ = rows.indices(self.shape[0])
        else:
            return np.asarray(np.asarray(self)[index], np.float32)
        part = self._read(first, max(first, last))
        if not self._warned and (what := describe_wrong(part, negative=True, first_row=first)):
            self._warned = True
            warn_user(f"{self._path}: {what}, which a display shows as black")
        return np.asarray(part[(own, *columns)], np.float32)

    def _read(self, first: int, last: int) -> Radiance:
        """Read the rows `first` to `last` - 1; reuse rows that the previous call read."""
        if self._closed:
            raise ValueError(f"{self._path} is closed; open it again")
        cached = self._rows[:0]
        if first >= self._first:
            cached = self._rows[first - self._first :][: last - first]
        rows = np.empty((last - first, *self.shape[1:]), np.float32)
        rows[: len(cached)] = cached
        spec, kind = self._spec, openimageio().FLOAT
        channels = 3 if spec.nchannels >= 3 else 1
        # OpenImageIO can read a tiled file only in complete rows of tiles.
        tile = spec.tile_height if spec.tile_width else 1
        with _quiet(self._path):
            for low in range(first + len(cached), last, BAND_ROWS):
                high = min(low + BAND_ROWS, last)
                top, bottom = low - low % tile, min(high + -high % tile, spec.height)
                y = spec.y + top, spec.y + bottom
                if spec.tile_width:
                    pixels = self._source.read_tiles(spec.x, spec.x + spec.width, *y, 0, 1, 0, channels, kind)
                else:
                    pixels = self._source.read_scanlines(0, 0, *y, 0, 0, channels, kind)
                if pixels is None:
                    trouble = _first_line(self._source.geterror(), self._path)
                    raise input_error(self._path, f"is truncated or broken ({trouble})", AGAIN)
                band = rows[low - first : high - first]
                band[:] = pixels[low - top : high - top]
                _decode_rows(self._path, band, self.metadata)
        rows.setflags(write=False)
        self._first, self._rows = first, rows
        return rows

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> Numbers:
        height, width, _ = self.shape
        check_expanded(str(self._path), f"{width} x {height} pixels", 2 * 12 * width * height, "use a smaller image")
        rows = self._read(0, height)
        self._rows = rows[:0]  # the caller now owns the memory
        rows.setflags(write=True)
        return np.array(rows, dtype, copy=copy)


#: Pillow's names of the accepted image formats.
FORMATS = ("PNG", "JPEG", "TIFF", "BMP")


def read_numbers(path: Path, max_pixels: int, what: str, remedy: str) -> Numbers:
    """Read an image, (height, width) or (height, width, BGR or BGRA), in the file's number type.

    Raises InputError for more than `max_pixels` pixels. The error for a broken file or
    a format outside `FORMATS` contains `what` and `remedy`.
    """
    import cv2

    refused = input_error(path, what, remedy)
    # OpenCV allocates memory for the size in the header before it reads the pixels.
    if _claimed_size(path, refused) > max_pixels:
        raise input_error(path, f"has more than {max_pixels / 1e6:g} megapixels", "give a smaller image")
    try:
        with silent_stderr():
            numbers = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        numbers = None
    if numbers is None:
        raise refused
    return np.asarray(numbers)


def _claimed_size(path: Path, refused: InputError) -> float:
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise input_error(path, not_there(path), "give a PNG, JPEG or TIFF file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of large or unusual pictures
            with Image.open(path, formats=FORMATS) as picture:
                if picture.format == "PNG" and not png_is_complete(path):  # a chunk may declare 4 GB
                    raise refused
                return picture.width * picture.height
    except Image.DecompressionBombError:
        return np.inf
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, OverflowError, struct.error):
        raise refused from None
