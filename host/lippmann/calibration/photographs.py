"""Find a folder's photographs, match them to patterns, and read their light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from lippmann.base.images import read_numbers
from lippmann.base.tones import decode
from lippmann.calibration.coded_patterns import FILE, Pattern, PatternSet, read_patterns
from lippmann.display.description import Display
from lippmann.errors import input_error, not_there

#: Suffixes of photographs.
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
#: Maximum pixels in a photograph.
MAX_PIXELS = 64_000_000
Light = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Position:
    """The photographs from one camera position, in the order of the patterns."""

    name: str
    photographs: tuple[Path, ...]

    def of(self, pattern: Pattern) -> Path:
        """Return the photograph of a pattern."""
        return self.photographs[pattern.place]


class Photograph(NamedTuple):
    """A photograph's light (height, width), 0 to 1, and a mask of pixels with a clipped channel."""

    light: Light
    clipped: npt.NDArray[np.bool_]


def pattern_set(folder: Path, display: Display) -> PatternSet:
    """Return the patterns of a folder's `patterns.toml`, or the display's default patterns."""
    own = folder / FILE
    if own.exists() and not own.is_file():
        raise input_error(own, not_there(own), "replace it by the file that lippmann calibrate patterns wrote")
    return read_patterns(own, display) if own.is_file() else PatternSet.of(display)


def positions(folder: Path, patterns: PatternSet) -> list[Position]:
    """Return the camera positions in a folder's sub-folders, or in the folder itself.

    Raises InputError if a photograph is missing.
    """
    if not folder.is_dir():
        raise input_error(folder, "the folder does not exist", "give the folder that contains position-1")
    folders = [one for one in folder.iterdir() if one.is_dir() and _photographs(one)]
    # sort position-10 after position-9
    folders.sort(key=lambda one: (int("".join(filter(str.isdigit, one.name)) or 0), one.name))
    return [_position(one, patterns) for one in folders or [folder]]


def _photographs(folder: Path) -> dict[str, Path]:
    photos: dict[str, Path] = {}
    for one in sorted(folder.iterdir()):
        if one.suffix.lower() in SUFFIXES:
            if one.stem in photos:
                what = f"{photos[one.stem].name} and {one.name} are photographs of the same pattern"
                raise input_error(folder, what, "keep only one file")
            photos[one.stem] = one
    return photos


def _position(folder: Path, patterns: PatternSet) -> Position:
    photos = _photographs(folder)
    if not photos:
        remedy = f"put a photograph of each pattern into this folder, such as {patterns.patterns[0].stem}.jpg"
        raise input_error(folder, "contains no photographs", remedy)
    stems = [one.stem for one in patterns.patterns]
    absent = [stem for stem in stems if stem not in photos]
    unknown = [stem for stem in photos if stem not in stems]
    if absent and unknown:
        what = f"no pattern has the name of {photos[unknown[0]].name}, and {absent[0]} is missing"
        remedy = "give each photograph the name of its pattern, and use the patterns of this display"
        raise input_error(folder, what, remedy)
    if absent:
        more = f" (and {len(absent) - 1} more)" if absent[1:] else ""
        raise input_error(folder, f"the photograph of {absent[0]} is missing{more}", f"add {absent[0]}.jpg")
    if unknown:
        what = f"no pattern has the name of {photos[unknown[0]].name}"
        remedy = f"draw the patterns again: this panel has {len(stems)} patterns, the last is {stems[-1]}"
        raise input_error(folder, what, remedy)
    return Position(folder.name, tuple(photos[stem] for stem in stems))


#: Light of each photograph value; cameras encode approximately like sRGB.
_CURVES = {
    np.dtype(kind): decode(np.arange(np.iinfo(kind).max + 1, dtype=np.float32) / np.iinfo(kind).max, "srgb")
    for kind in (np.uint8, np.uint16)
}


def decode_values(values: npt.NDArray[np.integer]) -> Light:
    """Convert camera values (uint8 or uint16) to linear light, 0 to 1."""
    curve = _CURVES[values.dtype]
    return np.asarray(cv2.LUT(values, curve) if values.dtype == np.uint8 else curve[values], np.float32)


def read_photograph(path: Path, shape: tuple[int, int] | None = None) -> Photograph:
    """Read the light of an sRGB photograph, averaged over the channels.

    Raises InputError for an unreadable file or a size other than `shape`.
    """
    raw = read_numbers(path, MAX_PIXELS, "is not a readable photograph", "give a PNG, JPEG or TIFF file")
    if raw.dtype not in _CURVES:
        raise input_error(path, f"contains {raw.dtype} values", "save the photograph with 8 or 16 bits per colour")
    if shape is not None and raw.shape[:2] != shape:
        what = f"is {raw.shape[1]} x {raw.shape[0]} pixels, but the first photograph is {shape[1]} x {shape[0]}"
        raise input_error(path, what, "take all photographs with one camera, one setting and one orientation")
    values = raw[..., :3] if raw.ndim == 3 else raw[..., None]
    top = int(0.985 * np.iinfo(values.dtype).max)  # minimum value that counts as clipped
    light = np.zeros(values.shape[:2], np.float32)
    clipped = np.zeros(values.shape[:2], np.bool_)
    for channel in range(values.shape[2]):
        one = np.ascontiguousarray(values[..., channel])
        light += decode_values(one)
        clipped |= one >= top
    light *= np.float32(1.0 / values.shape[2])
    return Photograph(light, clipped)
