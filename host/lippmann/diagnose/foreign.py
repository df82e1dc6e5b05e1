"""Rays of another tracer, read from its files."""

from __future__ import annotations

import csv
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lippmann.conditioning.search import Floats
from lippmann.conditioning.vectors import (
    FROM_WORLD,
    INPUTS,
    OUTPUTS,
    STATUS_BITS,
    text_of,
    widths,
    words_of_memory,
)
from lippmann.display import Display
from lippmann.errors import input_error
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import Ints
from lippmann.optics.rays import Model

#: Arrays that may be compared, with their columns.
FIELDS = {
    "panel_mm": 2, "home": 2, "start_mm": 2, "near_mm": 2, "lenslet": 2, "centre_mm": 2, "local_mm": 3,
    "origin_mm": 3, "direction": 3, "status": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Words:
    """Rays in the RTL's words, with the build and the registers that should give them."""

    build: Build
    registers: Configuration
    inputs: tuple[Ints, Ints, Ints, Ints]
    outputs: FixedRays


@dataclass(frozen=True)
class Foreign:
    """N rays to be judged: pixels and aperture points, and those arrays of `FIELDS` that the file has."""

    pixels: Floats
    aperture: Floats | None
    fields: dict[str, Floats] = field(default_factory=dict)
    words: Words | None = None


def read_foreign(path: Path, display: Display, model: Model, fraction_bits: int, inputs: Path | None = None) -> Foreign:
    """Read `.npz` (arrays as `lippmann trace` writes them), `.csv` (as `words.csv`) or `.mem` (as `expected.mem`).

    `inputs` is the `.mem` of the inputs; by default `inputs.mem` beside the file.

    Raises
    ------
    InputError
        For files that cannot be read or are not complete.
    """
    if not path.is_file():
        raise input_error(str(path), "no such file", "give a .npz, .csv or .mem file of rays")
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _of_arrays(path)
    build = Build.of(display, model, fraction_bits, True)
    if suffix == ".csv":
        columns = _csv_columns(path)
        _check_widths(path, columns, fraction_bits)
    elif suffix in (".mem", ".hex"):
        beside = inputs or path.with_name("inputs.mem")
        if not beside.is_file():
            raise input_error(str(beside), "no such file", "name the file of the inputs with --inputs")
        words = [
            *words_of_memory(beside, widths(INPUTS, fraction_bits)),
            *words_of_memory(path, widths(OUTPUTS, fraction_bits)),
        ]
        columns = dict(zip((*INPUTS, *OUTPUTS), words, strict=True))
    else:
        raise input_error(str(path), f"unknown extension '{path.suffix}'", "choose from .npz, .csv, .mem")
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1 or not lengths.pop():
        raise input_error(str(path), "inputs and outputs differ in number, or are empty", "give a line for each ray")
    return _of_words(columns, display, model, build)


def _csv_columns(path: Path) -> dict[str, Ints]:
    rows = list(csv.reader(line for line in text_of(path).splitlines() if not line.startswith("#")))
    heading = [name.strip() for name in rows[0]] if rows else []
    wanted = (*INPUTS, *OUTPUTS)
    missing = [name for name in wanted if name not in heading and name not in ("a", "b")]
    if missing:
        raise input_error(str(path), f"has no columns {', '.join(missing)}", f"head it {','.join(wanted)}")
    try:
        table = np.array([[int(word) for word in row] for row in rows[1:]], np.int64).reshape(-1, len(heading))
    except (ValueError, OverflowError):
        raise input_error(str(path), "contains a non-integer, or rows of different lengths", "give integers") from None
    columns = {name: table[:, heading.index(name)] for name in wanted if name in heading}
    zero = np.zeros(len(table), np.int64)
    return {name: columns.get(name, zero) for name in wanted}


def _check_widths(path: Path, columns: dict[str, Ints], fraction_bits: int) -> None:
    """Refuse words that exceed their bits."""
    for (name, column), bits in zip(columns.items(), widths(tuple(columns), fraction_bits), strict=True):
        unsigned = bits == STATUS_BITS
        low, high = (0, (1 << bits) - 1) if unsigned else (-(1 << (bits - 1)), (1 << (bits - 1)) - 1)
        out = (column < low) | (column > high)
        if out.any():
            ray = int(np.argmax(out))
            raise input_error(
                str(path),
                f"{name} of ray {ray} is {column[ray]}, beyond its {bits} bits",
                f"give {low} to {high}, or the word length with --fraction-bits",
            )


def _of_words(columns: dict[str, Ints], display: Display, model: Model, build: Build) -> Foreign:
    u, v, a, b = (columns[name] for name in INPUTS)
    out = FixedRays(*(columns[name] for name in OUTPUTS))
    f = build.fraction_bits
    pixels, aims = pixels_of_words(display, u, v), aims_of_words(display, a, b, f)
    registers = configuration(display, build, model, float(np.hypot(*aims.T).max()))
    rays = rays_of_words(display, pixels, out, f)
    fields = {
        "lenslet": rays.lenslet.astype(np.float64),
        "local_mm": rays.local_mm,
        "direction": rays.direction,
        "status": out.status.astype(np.float64)[:, None],
    }
    return Foreign(pixels, aims, fields, Words(build, registers, (u, v, a, b), out))


def _of_arrays(path: Path) -> Foreign:
    try:
        with np.load(path) as file:
            if FROM_WORLD in file.files:
                raise input_error(
                    str(path),
                    "holds rays from the world",
                    "give rays from the panel; regress judges only those",
                )
            raw = {name: file[name] for name in ("pixel", "aperture_mm", *FIELDS) if name in file.files}
    except (ValueError, OSError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise input_error(str(path), f"cannot be read ({error})", "give an .npz of numbers") from None
    arrays = {}
    for name, array in raw.items():
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
            kind = array.dtype if isinstance(array, np.ndarray) else "not an array"
            raise input_error(str(path), f"{name} is {kind}", "give real numbers")
        arrays[name] = np.atleast_1d(array).astype(np.float64)
    for name in ("pixel", "direction"):
        if name not in arrays:
            raise input_error(str(path), f"has no array {name}", "give at least pixel and direction, see vectors.json")
    n = len(arrays["pixel"])
    if not n:
        raise input_error(str(path), "holds no rays", "give at least one")
    shapes = {"pixel": 2, "aperture_mm": 2, **FIELDS}
    fields = {}
    for name, width in shapes.items():
        if name not in arrays:
            continue
        array = arrays[name][:, None] if arrays[name].ndim == 1 else arrays[name]
        if array.shape != (n, width):
            raise input_error(str(path), f"{name} has shape {arrays[name].shape}", f"give ({n}, {width})")
        fields[name] = array
    for name in ("pixel", "aperture_mm"):
        if name in fields and not np.isfinite(fields[name]).all():
            raise input_error(str(path), f"{name} holds values that are not finite", "remove them")
    return Foreign(fields.pop("pixel"), fields.pop("aperture_mm", None), fields)
