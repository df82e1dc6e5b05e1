"""Image files: linear radiance in EXR and TIFF, panel values in PNG, with metadata that names the display.

Reading and writing is OpenImageIO's. A file appears whole or not at all: it is written beside its place under another
name and moved there at the end.
"""

from __future__ import annotations

import contextlib
import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.errors import InputError, MissingLibraryError, input_error
from lippmann.stderr import silent_stderr

#: Formats and what they hold.
LINEAR_SUFFIXES = (".exr", ".tif", ".tiff")
ENCODED_SUFFIXES = (".png",)
SUFFIXES = LINEAR_SUFFIXES + ENCODED_SUFFIXES
#: Longest file name: file systems end at 255 bytes, and the partial file's name is longer.
MAX_NAME_BYTES = 220
#: Largest half float.
HALF_MAX = 65504.0
#: Most channels of an image: colours and alpha.
MAX_CHANNELS = 4
#: Most bytes of texts in a PNG that may be compressed: each can swell a thousandfold, and all are read at once.
MAX_TEXT_BYTES = 1 << 18
#: Prefix of our metadata keys in a file.
PREFIX = "lippmann:"

Image = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Picture:
    """Linear radiance (height, width, 3) float32 and the metadata that came with it (keys without prefix)."""

    radiance: Image
    metadata: dict[str, str]


def encode(linear: npt.NDArray[Any], transfer: str) -> npt.NDArray[np.float32]:
    """Map linear light to panel values in [0, 1]: "srgb" (IEC 61966-2-1), "gamma2.2" or "linear"."""
    light = np.clip(np.asarray(linear, np.float32), 0.0, 1.0)
    if transfer == "linear":
        return light
    if transfer == "gamma2.2":
        return np.asarray(light ** (1.0 / 2.2), np.float32)
    if transfer == "srgb":
        curve = 1.055 * light ** (1.0 / 2.4) - 0.055
        return np.asarray(np.where(light <= 0.0031308, 12.92 * light, curve), np.float32)
    raise InputError(f"unknown transfer '{transfer}'; choose from srgb, gamma2.2, linear")


def psnr_db(a: npt.NDArray[Any], b: npt.NDArray[Any], mask: npt.NDArray[np.bool_] | None = None) -> float:
    """Return the peak signal-to-noise ratio of two linear pictures, compared as sRGB values."""
    difference = (encode(a, "srgb").astype(np.float64) - encode(b, "srgb").astype(np.float64)) ** 2
    mean = difference.mean() if mask is None else difference[mask].mean()
    return float("inf") if mean == 0.0 else float(-10.0 * np.log10(mean))


def decode(values: npt.NDArray[Any], transfer: str) -> npt.NDArray[np.float32]:
    """Map panel values in [0, 1] to linear light; the inverse of `encode`."""
    v = np.asarray(values, np.float32)
    if transfer == "linear":
        return v
    if transfer == "gamma2.2":
        return np.asarray(v**2.2, np.float32)
    if transfer == "srgb":
        curve = ((v + 0.055) / 1.055) ** 2.4
        return np.asarray(np.where(v <= 0.04045, v / 12.92, curve), np.float32)
    raise InputError(f"unknown transfer '{transfer}'; choose from srgb, gamma2.2, linear")


def check_output(path: str | Path, suffixes: tuple[str, ...] = SUFFIXES) -> Path:
    """Refuse a path that cannot be written, before any work is done.

    Raises
    ------
    InputError
        For an unknown extension, a missing or read-only folder, a path that is a folder.
    """
    path = Path(path)
    if len(os.fsencode(path.name)) > MAX_NAME_BYTES:
        raise input_error(path.name[:40] + "...", "the file name is too long", f"keep it under {MAX_NAME_BYTES} bytes")
    if path.suffix.lower() not in suffixes:
        known = ", ".join(suffixes)
        raise input_error(str(path), f"unknown extension '{path.suffix}'", f"choose from {known}")
    if path.suffix.lower() in SUFFIXES:
        # Found missing now rather than after the render.
        _openimageio()
    if path.is_dir():
        raise input_error(str(path), "is a folder", "give a file name")
    folder = path.parent
    if not folder.is_dir():
        raise input_error(str(path), f"the folder {folder} does not exist", "make it first")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise input_error(str(path), "cannot be written", "choose another place or change permissions")
    return path


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a name to write to; move it to `path` on success, remove it on any failure.

    Raises
    ------
    InputError
        When the file system refuses (disk full, no permission).
    """
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    except OSError as error:
        raise input_error(
            str(path), f"cannot be written ({error.strerror})", "free space or choose another place"
        ) from None
    finally:
        partial.unlink(missing_ok=True)


def write_picture(
    path: str | Path,
    radiance: npt.NDArray[Any],
    metadata: Mapping[str, str],
    transfer: str = "srgb",
    bits: int = 8,
) -> None:
    """Write a picture.

    Parameters
    ----------
    path
        .exr (half float), .tif (float) for linear radiance; .png for panel values.
    radiance
        (height, width, 3), linear.
    metadata
        Keys without prefix.
    transfer, bits
        The panel's curve and depth, for PNG: up to 8 bits make an 8-bit file, more a 16-bit one.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    oiio = _openimageio()
    path = check_output(path)
    suffix = path.suffix.lower()
    height, width = radiance.shape[:2]
    entries = dict(metadata)
    pixels: npt.NDArray[Any]
    if suffix in ENCODED_SUFFIXES:
        levels = (1 << bits) - 1
        deep = bits > 8
        values = np.rint(encode(radiance, transfer) * levels)
        # A panel of fewer bits than the file spreads its levels over the file's range.
        full = 65535 if deep else 255
        pixels = np.rint(values * (full / levels)).astype(np.uint16 if deep else np.uint8)
        kind = oiio.UINT16 if deep else oiio.UINT8
        entries["transfer"] = transfer
    else:
        pixels = np.asarray(radiance, np.float32)
        kind = oiio.HALF if suffix == ".exr" else oiio.FLOAT
        if suffix == ".exr":
            pixels = np.minimum(pixels, np.float32(HALF_MAX))
        # With `bits`, the key names the panel's curve; the file itself is linear.
        entries.setdefault("transfer", "linear")
    spec = oiio.ImageSpec(width, height, 3, kind)
    if suffix == ".exr":
        spec.attribute("compression", "zip")
        entries_as_attributes(spec, entries)
    elif suffix == ".png":
        spec.attribute("oiio:ColorSpace", "sRGB" if transfer == "srgb" else "Linear")
        entries_as_attributes(spec, entries)
    else:
        spec.attribute("compression", "zip")
        # TIFF has no free keys: all of them go into the description.
        spec.attribute("ImageDescription", "\n".join(f"{PREFIX}{k}={v}" for k, v in entries.items()))
    with replacing(path) as partial:
        out = oiio.ImageOutput.create(str(partial))
        if out is None:
            raise input_error(str(path), oiio.geterror(), "choose another extension")
        with silent_stderr():
            good = out.open(str(partial), spec) and out.write_image(np.ascontiguousarray(pixels))
            trouble = _first_line(out.geterror(), partial)
            good = out.close() and good
        # OpenImageIO takes no notice when a PNG is cut short by a full disk.
        if good and suffix in ENCODED_SUFFIXES and not _holds(oiio, partial, pixels, kind):
            good, trouble = False, "not all of it arrived on the disk"
        if not good:
            raise input_error(str(path), f"cannot be written ({trouble})", "free space or choose another place")


def _holds(oiio: Any, path: Path, pixels: npt.NDArray[Any], kind: Any) -> bool:
    """Tell whether a file holds these pixels."""
    with silent_stderr():
        source = oiio.ImageInput.open(str(path))
        if source is None:
            oiio.geterror()  # else it prints it at exit
            return False
        try:
            found = source.read_image(kind)
            source.geterror()
            return found is not None and np.array_equal(found, pixels)
        finally:
            source.close()


def entries_as_attributes(spec: Any, entries: Mapping[str, str]) -> None:
    """Put metadata into a file's header, one key each."""
    for key, value in entries.items():
        spec.attribute(PREFIX + key, value)


def read_picture(
    path: str | Path,
    limit: tuple[int, int] | None = None,
    accept: Callable[[Mapping[str, str]], None] | None = None,
) -> Picture:
    """Read a picture as linear radiance.

    Parameters
    ----------
    path
        An image file that OpenImageIO reads.
    limit
        (width, height) that the picture must have; checked before its pixels are read.
    accept
        Called with the metadata before the pixels are read; raises for a picture that is not wanted.

    Raises
    ------
    InputError
        When the file is missing, broken, of another size, or no flat image.
    """
    oiio = _openimageio()
    path = Path(path)
    if not path.is_file():
        raise input_error(str(path), "no such image", "render it first: lippmann render")
    try:
        with silent_stderr():
            return _read(oiio, path, limit, accept)
    except UnicodeDecodeError:  # OpenImageIO quotes a broken header
        raise input_error(str(path), "is broken", "render it again") from None


def _read(
    oiio: Any,
    path: Path,
    limit: tuple[int, int] | None,
    accept: Callable[[Mapping[str, str]], None] | None,
) -> Picture:
    """Read a file that is there; the rest of `read_picture`."""
    _check_texts(path)
    source = oiio.ImageInput.open(str(path))
    if source is None:
        trouble = oiio.geterror()
        # OpenImageIO has limits of its own, before it tells the size.
        if limit is not None and (claim := re.search(r"claimed to be (\d+)x(\d+)", trouble)):
            _check_size(path, (int(claim[1]), int(claim[2])), limit)
        raise input_error(str(path), f"is no image ({_first_line(trouble, path)})", "give an EXR, TIFF or PNG file")
    try:
        spec = source.spec()
        if limit is not None:
            _check_size(path, (spec.width, spec.height), limit)
        if spec.deep or spec.depth > 1 or spec.nchannels > MAX_CHANNELS:
            raise input_error(str(path), f"is no flat image of 1 to {MAX_CHANNELS} channels", "render it again")
        metadata = _metadata_of(spec)
        if accept is not None:
            accept(metadata)
        pixels = source.read_image(oiio.FLOAT)
        if pixels is None:
            trouble = _first_line(source.geterror(), path)
            raise input_error(str(path), f"is truncated or broken ({trouble})", "render it again")
    finally:
        source.close()
    values = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, -1)
    if not np.isfinite(values).all():
        raise input_error(str(path), "holds pixels that are not finite", "render it again")
    if values.shape[2] < 3:
        values = np.repeat(values[:, :, :1], 3, axis=2)
    values = np.ascontiguousarray(values[:, :, :3])
    encoded = path.suffix.lower() not in LINEAR_SUFFIXES
    transfer = metadata.get("transfer", "srgb") if encoded else "linear"
    return Picture(decode(values, transfer), metadata)


def _check_size(path: Path, size: tuple[int, int], limit: tuple[int, int]) -> None:
    """Refuse a picture of another size than the panel's."""
    if size != limit:
        what = f"is {size[0]} x {size[1]} pixels, the panel {limit[0]} x {limit[1]}"
        raise input_error(str(path), what, "render it for this display")


def _check_texts(path: Path) -> None:
    """Refuse a PNG with more texts than any picture needs, which would fill time and memory as it is opened."""
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89PNG\r\n\x1a\n":
            return
        texts = 0
        while len(head := stream.read(8)) == 8:
            size, kind = struct.unpack(">I4s", head)
            texts += size * (kind in (b"zTXt", b"iTXt"))
            if texts > MAX_TEXT_BYTES:
                raise input_error(str(path), f"holds more than {MAX_TEXT_BYTES} bytes of texts", "render it again")
            stream.seek(size + 4, os.SEEK_CUR)


def _first_line(trouble: str, path: Path) -> str:
    """Return the first of a library's lines of what went wrong with a file, whose name we tell ourselves."""
    return next(iter(trouble.replace(f" ({path})", "").strip().splitlines()), "it does not say why")


def _metadata_of(spec: Any) -> dict[str, str]:
    """Return our keys from a file's header."""
    found: dict[str, str] = {}
    for attribute in spec.extra_attribs:
        if attribute.name.startswith(PREFIX):
            found[attribute.name.removeprefix(PREFIX)] = str(attribute.value)
        elif attribute.name == "ImageDescription":
            for line in str(attribute.value).splitlines():
                if line.startswith(PREFIX) and "=" in line:
                    key, value = line.removeprefix(PREFIX).split("=", 1)
                    found[key] = value
    return found


def _openimageio() -> Any:
    try:
        import OpenImageIO
    except ImportError as error:
        raise MissingLibraryError(f"OpenImageIO cannot be imported ({error}); run make setup") from None
    return OpenImageIO
