"""Test vectors for other designs: hard rays with the truth, in millimetres and in the RTL's words.

A folder for each set of rays: `display.toml`, `rays.npz`, and if the display fits the registers `words.csv` and the
memory files `registers.mem`, `inputs.mem`, `expected.mem` for `$readmemh`. `vectors.json` lists them and describes
their columns and bits.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.base.files import moved, partial_folder, refused
from lippmann.base.limits import MAX_TABLE_BYTES, lines_of, read_limited
from lippmann.conformance.engine_errors import fixed_words
from lippmann.conformance.fifty_digits import condition, true_hits, true_rays
from lippmann.conformance.hard_cases import CASES, Back, Out, hard_sets
from lippmann.display.description import Display, display_text
from lippmann.errors import input_error
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import INDEX_BITS, PIXEL_BITS, Ints
from lippmann.optics.rays import Model

#: Words of an input and of an output ray, in the order of their bits, most significant first.
INPUTS = ("u", "v", "a", "b")
OUTPUTS = FixedRays._fields
#: The one unsigned word.
STATUS_BITS = 3
#: Bits of a line of `registers.mem`.
REGISTER_BITS = 64


def formats(fraction_bits: int) -> dict[str, tuple[int, int]]:
    """Return the bits, and those of them behind the binary point, of each word of `INPUTS` and `OUTPUTS`."""
    near = fraction_bits + 2
    return {
        **dict.fromkeys("uv", (PIXEL_BITS, 4)),
        **dict.fromkeys("ab", (near, fraction_bits)),
        **dict.fromkeys("ij", (INDEX_BITS, 0)),
        **dict.fromkeys("xyz", (near + 2, fraction_bits + 1)),
        **dict.fromkeys(("dx", "dy", "dz"), (near, fraction_bits + 1)),
        "status": (STATUS_BITS, 0),
    }


def widths(words: Sequence[str], fraction_bits: int) -> tuple[int, ...]:
    """Return the bits of each of some words."""
    return tuple(formats(fraction_bits)[word][0] for word in words)


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
#: Marks rays from the world, which `lippmann regress` does not judge.
FROM_WORLD = "from_world"
BACK_ARRAYS = {
    FROM_WORLD: "() 1: rays from the world, which `lippmann regress` refuses: it judges rays from the panel",
    "origin_mm": "(N, 3) a point of each ray from the world, panel frame",
    "direction": "(N, 3) its unit direction",
    "pixel": "(N, 2) truth: pixel coordinates of its point on the panel",
    "lenslet": "(N, 2) truth: (i, j) of its lenslet",
    "status": "(N,) truth: as above",
    "shift_unit_mm": "(N,) shift on the panel for a unit in the last place of every float64 input, mm",
}


def hex_digits(widths: Sequence[int]) -> int:
    """Return how many hexadecimal digits a line of words has."""
    return (sum(widths) + 3) // 4


def memory_lines(words: Sequence[Ints], widths: Sequence[int]) -> list[str]:
    """Return a hexadecimal line for each ray: its words in turn, the first in the most significant bits."""
    rays: Any = 0
    for word, width in zip(words, widths, strict=True):
        rays = rays << width | word.astype(object) & ((1 << width) - 1)
    return [f"{ray:0{hex_digits(widths)}x}" for ray in rays]


def text_of(path: Path) -> str:
    """Return the text of a file of words; raise InputError when it is not text."""
    remedy = "give a file of words as lippmann vectors writes them"
    try:
        text = read_limited(path, MAX_TABLE_BYTES, "give fewer rays").decode()
    except UnicodeDecodeError:
        text = "\0"
    except OSError as error:
        raise input_error(str(path), f"cannot be read ({error.strerror})", remedy) from None
    if "\0" in text:
        raise input_error(str(path), "is not text", remedy)
    return text


def words_of_memory(path: Path, widths: Sequence[int]) -> list[Ints]:
    """Read the words of a `$readmemh` file: one line a ray, as `memory_lines` writes them.

    Raises InputError when a line is not hexadecimal or too long.
    """
    texts = [line.split("//")[0].strip().replace("_", "") for line in lines_of(text_of(path))]
    numbers = [number for number, text in enumerate(texts, 1) if text]
    return words_of_lines([text for text in texts if text], widths, lambda ray: f"{path}:{numbers[ray]}")


def words_of_lines(lines: Sequence[str], widths: Sequence[int], where: Callable[[int], str]) -> list[Ints]:
    """Return the words of lines of hexadecimal digits, one a ray; `where` names a ray's line in errors.

    Raises InputError when a line is not hexadecimal or too long.
    """
    rays, total = [], sum(widths)
    for ray, text in enumerate(lines):
        try:
            bits = int(text, 16)
        except ValueError:
            bits = -1
        if bits < 0:
            raise input_error(where(ray), f"'{text[:20]}' is not hexadecimal", "give a line a ray")
        if bits >> total:
            raise input_error(where(ray), f"more than the {total} bits of a ray", "see vectors.json")
        rays.append(bits)
    rest, words = np.array(rays, object), []
    for width in reversed(widths):
        word = (rest & ((1 << width) - 1)).astype(np.int64)
        words.append(word - ((word >> (width - 1) << width) if width > STATUS_BITS else 0))
        rest = rest >> width
    return words[::-1]


def write_vectors(
    folder: Path,
    display: Display,
    case: str,
    model: Model,
    fraction_bits: int,
    seed: int,
    count: int,
    origin: dict[str, str],
    progress: Callable[[str], None] = lambda _: None,
) -> list[dict[str, Any]]:
    """Write the sets of a case, or of "all", into a new or empty folder; returns what `vectors.json` lists.

    The folder appears whole or not at all. Rays from the world are written for the model `exact` alone. `origin` is the
    provenance in `vectors.json`; `progress` is called with the name of each set. Raises InputError for an unknown case,
    and for a folder with files.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise input_error(str(folder), "exists already", "give a new folder")
    if not folder.parent.is_dir():
        raise input_error(str(folder), f"the folder {folder.parent} does not exist", "make it first")
    entries = []
    try:
        with partial_folder(folder) as made:
            for rays in hard_sets(display, case, seed, count):
                if isinstance(rays, Out) or model == "exact":
                    progress(rays.name)
                    entries.append(_write_set(made, rays, model, fraction_bits))
            _write_header(made, entries, model, fraction_bits, seed, origin)
            moved(made, folder)
    except OSError as error:
        raise refused(folder, error) from None
    return entries


def _write_set(top: Path, rays: Out | Back, model: Model, fraction_bits: int) -> dict[str, Any]:
    name = rays.name.replace("/", "-")
    place = top / name
    place.mkdir()
    (place / "display.toml").write_text(display_text(rays.display))
    entry: dict[str, Any] = {"set": name, "case": rays.name.split("/")[0], "identity": rays.display.identity}
    if isinstance(rays, Back):
        hits = true_hits(rays)
        shift = condition(rays, hits).shift_mm
        arrays = {FROM_WORLD: np.uint8(1), "origin_mm": rays.origin_mm, "direction": rays.direction, **vars(hits)}
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
    out = fixed.traced()
    heading = ",".join((*INPUTS, *OUTPUTS))
    np.savetxt(place / "words.csv", np.stack([*fixed.words, *out], 1), "%d", ",", header=heading, comments="")
    mask = (1 << REGISTER_BITS) - 1
    registers = dataclasses.asdict(fixed.registers).items()
    for file, lines in (
        ("registers", [f"{word & mask:0{REGISTER_BITS // 4}x} // {register}" for register, word in registers]),
        ("inputs", memory_lines(fixed.words, widths(INPUTS, fraction_bits))),
        ("expected", memory_lines(out, widths(OUTPUTS, fraction_bits))),
    ):
        (place / f"{file}.mem").write_text("\n".join(lines) + "\n")
    return entry | {"words": len(out.status), "build": fixed.build.as_dict()}


def _save(place: Path, **arrays: Any) -> None:
    """Write rays.npz: numbers of 50 digits are rounded once, statuses are bytes."""
    rounded: dict[str, Any] = {
        name: np.asarray(a, np.float64) if a.dtype == object else a for name, a in arrays.items()
    }
    rounded["status"] = rounded["status"].astype(np.uint8)
    np.savez(place / "rays.npz", **rounded)


def _write_header(
    top: Path, entries: list[dict[str, Any]], model: str, fraction_bits: int, seed: int, origin: dict[str, str]
) -> None:
    described = {
        word: {"word": word, "bits": bits, "fraction_bits": behind}
        for word, (bits, behind) in formats(fraction_bits).items()
    }
    header = {
        **origin,
        "model": model,
        "fraction_bits": fraction_bits,
        "seed": seed,
        "arrays": ARRAYS,
        "arrays_of_rays_from_the_world": BACK_ARRAYS,
        "words": {
            "inputs.mem": [described[word] for word in INPUTS],
            "expected.mem": [described[word] for word in OUTPUTS],
            "registers.mem": f"a register of optics_config_t a line, {REGISTER_BITS} bits, sign extended",
        },
        "cases": {name: " ".join((case.__doc__ or "").split()) for name, case in CASES.items()},
        "sets": entries,
    }
    (top / "vectors.json").write_text(json.dumps(header, indent=1) + "\n")
    page = Path(__file__).with_name("vectors.md").read_text()
    rows = "".join(f"| `{name}` | {what} |\n" for name, what in ARRAYS.items())
    text = page.format(
        F=fraction_bits, pixel_bits=PIXEL_BITS, outputs=", ".join(OUTPUTS), bits=sum(widths(OUTPUTS, fraction_bits)),
        arrays=rows,
    )  # fmt: skip
    (top / "README.md").write_text(text)
