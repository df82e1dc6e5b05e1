"""Rays of another tracer, read from its files."""

from __future__ import annotations

import csv
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.base.limits import lines_of, load_arrays
from lippmann.conformance.engine_errors import FixedCase
from lippmann.conformance.hard_cases import Out
from lippmann.conformance.lens_faults import FIELDS
from lippmann.conformance.ray_search import Floats
from lippmann.conformance.vectors import FROM_WORLD, INPUTS, OUTPUTS, STATUS_BITS, text_of, widths, words_of_memory
from lippmann.display.description import Display
from lippmann.errors import input_error, not_there
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import Ints
from lippmann.optics.rays import Model

#: Arrays of the inputs, two columns each.
INPUT_ARRAYS = ("pixel", "aperture_mm")
#: Memory that the judgement of a ray takes, bytes.
RAY_BYTES = 1000
#: Rows of a table that are converted at once.
ROWS_AT_ONCE = 65536


@dataclass(frozen=True)
class Foreign:
    """N rays to be judged: `given` is what they should be of; `fields` are those arrays of `FIELDS` that the file has.

    `words` are the case in the RTL's words, if the file has words, and the words of the rays. `alone` (N,) marks rays
    of which the status alone is given; their other values are not judged.
    """

    given: Out
    fields: dict[str, Floats]
    words: tuple[FixedCase, FixedRays] | None = None
    alone: npt.NDArray[np.bool_] | None = None


def read_foreign(path: Path, display: Display, model: Model, fraction_bits: int, inputs: Path | None = None) -> Foreign:
    """Read `.npz` (arrays as `lippmann trace` writes them), `.csv` (as `words.csv`) or `.mem` (as `expected.mem`).

    `inputs` is the `.mem` of the inputs; by default `inputs.mem` beside the file. Raises InputError for files that
    cannot be read or are not complete.
    """
    if not path.is_file():
        raise input_error(str(path), not_there(path), "give a .npz, .csv or .mem file of rays")
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _of_arrays(path, display, model)
    if suffix == ".csv":
        columns = _csv_columns(path)
        _check_widths(path, columns, fraction_bits)
    elif suffix in (".mem", ".hex"):
        beside = inputs or path.with_name("inputs.mem")
        if not beside.is_file():
            raise input_error(str(beside), not_there(beside), "name the file of the inputs with --inputs")
        files = ((beside, INPUTS), (path, OUTPUTS))
        words = [word for file, names in files for word in words_of_memory(file, widths(names, fraction_bits))]
        columns = dict(zip((*INPUTS, *OUTPUTS), words, strict=True))
    else:
        raise input_error(str(path), f"unknown extension '{path.suffix}'", "choose from .npz, .csv, .mem")
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1 or not lengths.pop():
        raise input_error(str(path), "inputs and outputs differ in number, or are empty", "give a line for each ray")
    return foreign_words(columns, display, model, fraction_bits)


def _csv_columns(path: Path) -> dict[str, Ints]:
    rows = csv.reader(line for line in lines_of(text_of(path)) if not line.startswith("#"))
    try:
        heading = [name.strip() for name in next(rows, [])]
    except csv.Error as error:  # of a field that is too long
        raise input_error(str(path), f"is not a table ({error})", "give integers") from None
    wanted = (*INPUTS, *OUTPUTS)
    missing = [name for name in wanted if name not in heading and name not in ("a", "b")]
    if missing:
        raise input_error(str(path), f"has no columns {', '.join(missing)}", f"head it {','.join(wanted)}")
    try:
        parts = []
        while some := [[int(word) for word in row] for row in itertools.islice(rows, ROWS_AT_ONCE)]:
            parts.append(np.array(some, np.int64).reshape(len(some), len(heading)))
        table = np.concatenate(parts) if parts else np.empty((0, len(heading)), np.int64)
    except (ValueError, OverflowError, csv.Error):
        raise input_error(str(path), "contains a non-integer, or rows of different lengths", "give integers") from None
    columns = {name: table[:, heading.index(name)] for name in wanted if name in heading}
    zero = np.zeros(len(table), np.int64)
    return {name: columns.get(name, zero) for name in wanted}


def _check_widths(path: Path, columns: dict[str, Ints], fraction_bits: int) -> None:
    """Refuse words that exceed their bits."""
    for (name, column), bits in zip(columns.items(), widths(tuple(columns), fraction_bits), strict=True):
        low = 0 if bits == STATUS_BITS else -(1 << (bits - 1))
        high = low + (1 << bits) - 1
        out = (column < low) | (column > high)
        if out.any():
            ray = int(np.argmax(out))
            what = f"{name} of ray {ray} is {column[ray]}, beyond its {bits} bits"
            raise input_error(str(path), what, f"give {low} to {high}, or the word length with --fraction-bits")


def foreign_words(columns: dict[str, Ints], display: Display, model: Model, fraction_bits: int) -> Foreign:
    """Return rays whose inputs and outputs are words, a column of N for each."""
    build = Build.of(display, model, fraction_bits, True)
    u, v, a, b = (columns[name] for name in INPUTS)
    out = FixedRays(*(columns[name] for name in OUTPUTS))
    f = fraction_bits
    given = Out("foreign", display, pixels_of_words(display, u, v), aims_of_words(display, a, b, f), model)
    registers = configuration(display, build, model, float(np.hypot(*given.aims.T).max()))
    rays = rays_of_words(display, given.pixels, out, f)
    fields = {
        "lenslet": rays.lenslet.astype(np.float64),
        "local_mm": rays.local_mm,
        "direction": rays.direction,
        "status": rays.status.astype(np.float64)[:, None],
    }
    return Foreign(given, fields, (FixedCase(build, (u, v, a, b), registers, np.ones(len(u), bool)), out))


def _of_arrays(path: Path, display: Display, model: Model) -> Foreign:
    raw, there = load_arrays(path, (*INPUT_ARRAYS, *FIELDS), "give an .npz of numbers", RAY_BYTES)
    if FROM_WORLD in there:
        raise input_error(str(path), "holds rays from the world", "give rays from the panel; regress judges only those")
    arrays = {name: np.atleast_1d(array).astype(np.float64) for name, array in raw.items()}
    for name in ("pixel", "direction"):
        if name not in arrays:
            raise input_error(str(path), f"has no array {name}", "give at least pixel and direction, see vectors.json")
    n = len(arrays["pixel"])
    if not n:
        raise input_error(str(path), "holds no rays", "give at least one")
    for name, array in arrays.items():
        shape = (n, 2 if name in INPUT_ARRAYS else FIELDS[name][1])
        if (array[:, None] if array.ndim == 1 else array).shape != shape:
            raise input_error(str(path), f"{name} has shape {array.shape}", f"give {shape}")
        if name in INPUT_ARRAYS and not np.isfinite(array).all():
            raise input_error(str(path), f"{name} holds values that are not finite", "remove them")
        arrays[name] = array.reshape(shape)
    given = Out("foreign", display, arrays.pop("pixel"), arrays.pop("aperture_mm", None), model)
    return Foreign(given, arrays)
