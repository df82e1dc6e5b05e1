"""Write test vectors (see vectors.md), and read files of rays for `lippmann regress`."""

from __future__ import annotations

import dataclasses
import itertools
import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.base.file_limits import MAX_TABLE_BYTES, lines_of, load_arrays, read_limited
from lippmann.base.files import moved, not_written, partial_folder
from lippmann.conformance.fifty_digits import condition, true_hits, true_rays
from lippmann.conformance.hard_cases import CASES
from lippmann.conformance.ray_sets import (
    INPUTS,
    OUTPUTS,
    REGISTER_BITS,
    STATUS_BITS,
    ForeignRays,
    PanelRays,
    WorldRays,
    fixed_words,
    foreign_from_words,
    formats,
    memory_lines,
    widths,
    words_of_lines,
)
from lippmann.conformance.tracer_faults import FIELDS
from lippmann.display.description import Display, display_text
from lippmann.errors import input_error, not_there
from lippmann.fixed.words import PIXEL_BITS, Ints
from lippmann.optics.rays import Model

logger = logging.getLogger(__name__)

#: Entry of a ray set in `vectors.json`.
Entry = dict[str, Any]

#: Arrays in `rays.npz`: shape and meaning, keyed by name.
ARRAYS = {
    "pixel": "(N, 2) pixel coordinates of the rays' starts",
    "aperture_mm": "(N, 2) aperture points, mm from the centre of the pixel's lenslet, array's axes",
    "direction": "(N, 3) truth, rounded once: unit vectors, panel frame",
    "local_mm": "(N, 3) truth: exit points, mm from the lenslet's centre, panel's axes",
    "centre_mm": "(N, 2) truth: the lenslet's centre, panel frame",
    "origin_mm": "(N, 3) truth: their sum",
    "lenslet": "(N, 2) truth: (i, j) of the exit's lenslet",
    "status": "(N,) truth: 0 ok, 1 missed, 2 total internal reflection, 3 blocked, 4 crosstalk",
    "turn_unit": "(N,) turn of the ray for a unit in the last place of every float64 input, radians",
    "shift_unit_mm": "(N,) the same for the exit point, mm",
    "panel_mm": "(N, 2) step: the pixel's point, panel frame",
    "home": "(N, 2) step: (i, j) of the lenslet that owns the point",
    "start_mm": "(N, 2) step: the point from that lenslet's centre, array's axes",
    "near_mm": "(N, 2) step: the ray's point in the array's near plane, likewise",
}
WORLD_ARRAYS = {
    "from_world": "() 1: rays from the world, which `lippmann regress` refuses: it judges rays from the panel",
    "origin_mm": "(N, 3) a point of each ray from the world, panel frame",
    "direction": "(N, 3) its unit direction",
    "pixel": "(N, 2) truth: pixel coordinates of its point on the panel",
    "lenslet": "(N, 2) truth: (i, j) of its lenslet",
    "status": "(N,) truth: as above",
    "shift_unit_mm": "(N,) shift on the panel for a unit in the last place of every float64 input, mm",
}


def write_vectors(
    folder: Path, sets: Iterable[PanelRays | WorldRays], model: Model, fraction_bits: int, about: Mapping[str, object]
) -> list[Entry]:
    """Write all ray sets or none into a new or empty folder; return the entries of `vectors.json`.

    Omit rays from the world unless `model` is exact. Raises InputError if the folder
    contains files.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise input_error(folder, "exists already", "give a new or empty folder")
    if not folder.parent.is_dir():
        raise input_error(folder, f"the folder {folder.parent} does not exist", "create it first")
    entries = []
    try:
        with partial_folder(folder) as partial:
            for rays in sets:
                if isinstance(rays, PanelRays) or model == "exact":
                    logger.info(rays.name)
                    entries.append(_write_set(partial, rays, model, fraction_bits))
            _write_header(partial, entries, fraction_bits, about)
            moved(partial, folder)
    except OSError as error:
        raise not_written(folder, error) from None
    return entries


def _write_set(top: Path, rays: PanelRays | WorldRays, model: Model, fraction_bits: int) -> Entry:
    name = rays.name.replace("/", "-")
    place = top / name
    place.mkdir()
    (place / "display.toml").write_text(display_text(rays.display), encoding="utf-8")
    entry: Entry = {"set": name, "case": rays.name.split("/")[0], "identity": rays.display.identity}
    if isinstance(rays, WorldRays):
        hits = true_hits(rays)
        shift = condition(rays, hits).shift_mm
        arrays = {"from_world": np.uint8(1), "origin_mm": rays.origin_mm, "direction": rays.direction, **vars(hits)}
        _save(place, **arrays, shift_unit_mm=shift)
        return {**entry, "way": "back", "rays": len(rays.origin_mm), "words": 0, "refused": ""}
    rays = dataclasses.replace(rays, aperture=rays.aims, model=model)
    true = true_rays(rays)
    arrays = {"pixel": rays.pixels, "aperture_mm": rays.aperture}
    arrays |= {name: getattr(true, name) for name in ("direction", "local_mm", "centre_mm", "lenslet", "status")}
    arrays |= rays.steps()
    if model == "exact":
        unit = condition(rays, true)
        arrays |= {"turn_unit": unit.turn, "shift_unit_mm": unit.shift_mm}
    _save(place, **arrays, origin_mm=true.origin_mm)
    fixed, why = fixed_words(rays, fraction_bits)
    entry |= {"way": "out", "rays": len(rays.pixels), "words": 0, "refused": why}
    if fixed is None:
        return entry
    out = fixed.trace()
    heading = ",".join((*INPUTS, *OUTPUTS))
    np.savetxt(place / "words.csv", np.stack([*fixed.words, *out], 1), "%d", ",", header=heading, comments="")
    for file, lines in (
        ("registers", [f"{word} // {register}" for word, register in fixed.register_lines]),
        ("inputs", fixed.input_lines),
        ("expected", memory_lines(out, widths(OUTPUTS, fraction_bits))),
    ):
        (place / f"{file}.mem").write_text("\n".join(lines) + "\n")
    return entry | {"words": len(out.status), "build": fixed.build.as_dict()}


def _save(place: Path, **arrays: Any) -> None:
    arrays = {name: np.asarray(a, np.float64) if a.dtype == object else a for name, a in arrays.items()}
    arrays["status"] = arrays["status"].astype(np.uint8)
    np.savez(place / "rays.npz", **arrays)


def _write_header(top: Path, entries: list[Entry], fraction_bits: int, about: Mapping[str, object]) -> None:
    words = {name: {"word": name, "bits": n, "fraction_bits": f} for name, (n, f) in formats(fraction_bits).items()}
    header = {
        **about,
        "arrays": ARRAYS,
        "arrays_of_rays_from_the_world": WORLD_ARRAYS,
        "words": {
            "inputs.mem": [words[name] for name in INPUTS],
            "expected.mem": [words[name] for name in OUTPUTS],
            "registers.mem": f"a register of optics_config_t a line, {REGISTER_BITS} bits, sign extended",
        },
        "cases": {name: " ".join((case.__doc__ or "").split()) for name, case in CASES.items()},
        "sets": entries,
    }
    (top / "vectors.json").write_text(json.dumps(header, indent=1) + "\n")
    page = Path(__file__).with_name("vectors.md").read_text()
    bits = {"F": fraction_bits, "pixel_bits": PIXEL_BITS, "bits": sum(widths(OUTPUTS, fraction_bits))}
    rows = "".join(f"| `{name}` | {what} |\n" for name, what in ARRAYS.items())
    (top / "README.md").write_text(page.format(**bits, outputs=", ".join(OUTPUTS), arrays=rows))


#: Names of the input arrays; each array has two columns.
INPUT_ARRAYS = ("pixel", "aperture_mm")


def read_foreign(
    path: Path, display: Display, model: Model, fraction_bits: int, inputs: Path | None = None
) -> ForeignRays:
    """Read rays from `.npz` (of `lippmann trace`), `.csv` (like `words.csv`) or `.mem` (like `expected.mem`).

    `inputs` is the `.mem` file of the input rays, by default `inputs.mem` in
    `path`'s folder. Raises InputError for an invalid file.
    """
    if not path.is_file():
        raise input_error(path, not_there(path), "give a .npz, .csv or .mem file of rays")
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _of_arrays(path, display, model)
    if suffix == ".csv":
        columns = _csv_columns(path, fraction_bits)
    elif suffix in (".mem", ".hex"):
        inputs_path = inputs or path.with_name("inputs.mem")
        if not inputs_path.is_file():
            raise input_error(inputs_path, not_there(inputs_path), "give the file of input rays with --inputs")
        files = ((inputs_path, INPUTS), (path, OUTPUTS))
        words = [word for file, names in files for word in words_of_memory(file, widths(names, fraction_bits))]
        columns = dict(zip((*INPUTS, *OUTPUTS), words, strict=True))
    else:
        raise input_error(path, f"unknown extension '{path.suffix}'", "give a .npz, .csv or .mem file")
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1 or not lengths.pop():
        raise input_error(path, "has no rays, or not as many as the input file", "give one line per ray")
    return foreign_from_words(columns, display, model, fraction_bits)


def _csv_columns(path: Path, fraction_bits: int) -> dict[str, Ints]:
    lines = (line for line in lines_of(text_of(path)) if not line.startswith("#"))
    heading = [name.strip(' "') for name in next(lines, "").split(",")]
    names = (*INPUTS, *OUTPUTS)
    missing = [name for name in names if name not in heading and name not in ("a", "b")]
    if missing:
        raise input_error(path, f"has no columns {', '.join(missing)}", f"begin the file with {','.join(names)}")
    first = next(lines, None)
    if first is None:
        return dict.fromkeys(names, np.zeros(0, np.int64))
    try:
        table = np.loadtxt(itertools.chain([first], lines), np.int64, None, ",", quotechar='"', ndmin=2)
        if table.shape[1] != len(heading):
            raise ValueError
    except ValueError:
        remedy = f"give {len(heading)} integers per row"
        raise input_error(path, "contains a non-integer, or a row of wrong length", remedy) from None
    columns = dict.fromkeys(names, np.zeros(len(table), np.int64)) | dict(zip(heading, table.T, strict=True))
    for name, bits in zip(names, widths(names, fraction_bits), strict=True):
        low = 0 if bits == STATUS_BITS else -(1 << (bits - 1))
        high = low + (1 << bits) - 1
        out = (columns[name] < low) | (columns[name] > high)
        if out.any():
            ray = int(np.argmax(out))
            what = f"{name} of ray {ray} is {columns[name][ray]}, beyond its {bits} bits"
            raise input_error(path, what, f"give {low} to {high}, or another --fraction-bits")
    return columns


def _of_arrays(path: Path, display: Display, model: Model) -> ForeignRays:
    raw, there = load_arrays(path, (*INPUT_ARRAYS, *FIELDS), "give an .npz of numbers", 1000)  # maximum bytes per ray
    if "from_world" in there:
        raise input_error(path, "contains rays from the world", "give rays from the panel")
    arrays = {name: np.atleast_1d(array).astype(np.float64) for name, array in raw.items()}
    for name in ("pixel", "direction"):
        if name not in arrays:
            raise input_error(path, f"has no array {name}", "add arrays pixel and direction (see vectors.json)")
    n = len(arrays["pixel"])
    if not n:
        raise input_error(path, "contains no rays", "give at least one ray")
    for name, array in arrays.items():
        shape = (n, 2 if name in INPUT_ARRAYS else FIELDS[name][1])
        if (array[:, None] if array.ndim == 1 else array).shape != shape:
            raise input_error(path, f"array {name} has shape {array.shape}", f"give {shape}")
        if name in INPUT_ARRAYS and not np.isfinite(array).all():
            raise input_error(path, f"array {name} contains NaN or infinity", "remove these rays")
        arrays[name] = array.reshape(shape)
    inputs = PanelRays("foreign", display, arrays.pop("pixel"), arrays.pop("aperture_mm", None), model)
    return ForeignRays(inputs, arrays)


def text_of(path: Path) -> str:
    """Return the text of a file of words; raise InputError if the file is unreadable."""
    remedy = "give a file of words like those of lippmann vectors"
    try:
        text = read_limited(path, MAX_TABLE_BYTES, "give fewer rays").decode()
    except UnicodeDecodeError:
        text = "\0"
    except OSError as error:
        raise input_error(path, f"cannot be read ({error.strerror})", remedy) from None
    if "\0" in text:
        raise input_error(path, "is not text", remedy)
    return text


def words_of_memory(path: Path, widths: Sequence[int]) -> list[Ints]:
    """Return the words of a `$readmemh` file with one ray per line.

    Raises InputError for an invalid line.
    """
    texts = [line.split("//")[0].strip().replace("_", "") for line in lines_of(text_of(path))]
    numbers = [number for number, text in enumerate(texts, 1) if text]
    return words_of_lines([text for text in texts if text], widths, lambda ray: f"{path}:{numbers[ray]}")
