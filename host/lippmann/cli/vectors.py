"""`lippmann vectors`: hard rays with the truth, to test another design."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from lippmann.cli.options.common import display_option, fraction_bits_option, json_option, model_option, seed_option
from lippmann.cli.output import emit, log
from lippmann.display import load_display
from lippmann.optics.rays import Model
from lippmann.provenance import provenance


@click.command("vectors")
@display_option
@click.option(
    "--case", default="all", show_default=True, help="Name of a hard case, or all; an unknown name lists them."
)
@model_option
@fraction_bits_option("the fixed-point files")
@click.option(
    "--count", type=click.IntRange(1, 10_000), default=24, show_default=True,
    help="Approximate number of rays in each set.",
)  # fmt: skip
@seed_option
@click.option("-o", "output", required=True, metavar="FOLDER", help="New output folder.")
@json_option
def command(
    display_path: str,
    case: str,
    model: Model,
    fraction_bits: int,
    count: int,
    seed: int,
    output: str,
    as_json: bool,
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
    note = (lambda _: None) if as_json else log
    entries = write_vectors(Path(output), display, case, model, fraction_bits, seed, count, origin, note)
    result = {
        "output": output,
        "sets": len(entries),
        "rays": sum(entry["rays"] for entry in entries),
        "words": sum(entry["words"] for entry in entries),
        "refused": {entry["set"]: entry["refused"] for entry in entries if entry["refused"]},
    }
    text = f"{output}: {result['rays']} rays in {result['sets']} sets, {result['words']} of them in words"
    emit(result, as_json, text)
