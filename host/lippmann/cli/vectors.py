"""`lippmann vectors`: hard rays with the truth, to test another design."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from lippmann.cli.frame import make_command, option
from lippmann.cli.options.common import DISPLAY, LENS_MODEL, SEED, word_length
from lippmann.cli.output import as_json, emit, log
from lippmann.display import load_display
from lippmann.optics.rays import Model
from lippmann.provenance import provenance


@make_command("vectors")
def command(
    display_path: str = DISPLAY,
    case: str = option("Name of a hard case, or all; an unknown name lists them.", "all"),
    model: Model = LENS_MODEL,
    fraction_bits: int = word_length("the fixed-point files"),
    count: int = option("Approximate number of rays in each set.", 24, click.IntRange(1, 10_000)),
    seed: int = SEED,
    output: str = option("New output folder.", flag="-o", metavar="FOLDER"),
) -> None:
    """Write test vectors: rays that are hard to compute.

    Each set holds the rays with results from 50-digit arithmetic (.npz), and as words of the RTL (.csv, $readmemh).

    Example: lippmann vectors --display scenes/displays/paper-square.toml --case tangent -o vectors
    """
    from lippmann.conditioning.vectors import write_vectors

    display = load_display(display_path)
    said = (
        f"lippmann vectors --display {shlex.quote(display_path)} --case {case} --model {model} "
        f"--fraction-bits {fraction_bits} --count {count} --seed {seed}"
    )
    origin = provenance(said, ("numpy", "mpmath"))
    note = (lambda _: None) if as_json() else log
    entries = write_vectors(Path(output), display, case, model, fraction_bits, seed, count, origin, note)
    result = {
        "output": output,
        "sets": len(entries),
        "rays": sum(entry["rays"] for entry in entries),
        "words": sum(entry["words"] for entry in entries),
        "refused": {entry["set"]: entry["refused"] for entry in entries if entry["refused"]},
    }
    text = f"{output}: {result['rays']} rays in {result['sets']} sets, {result['words']} of them in words"
    emit(result, text)
